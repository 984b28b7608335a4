"""The time step against the dense solve: rates, velocities, root force, contacts' matrix; bad input; threads."""

from __future__ import annotations

import dataclasses

import numba
import numpy as np
import pytest
from dense_reference import DenseRod, step
from hairloom.errors import InputError
from hairloom.rods.dynamics import Stepper
from hairloom.rods.model import Rods, RodState
from rod_cases import GRAVITY, random_helices, random_motion, soft_rods
from scipy.spatial.transform import Rotation

DT = 1 / 48
COUNTS = [3, 1, 7, 4]
# the recursion and the dense solve differ by rounding and by the condition of the matrix
CLOSE = {"rtol": 1e-10, "atol": 1e-11}


class Case:
    """Rods that move in every way at once: moving roots, wind, drag, damping, gravity."""

    def __init__(self, seed: int = 0, curvature: float = 8.0) -> None:
        rng = np.random.default_rng(seed)
        self.helices = random_helices(COUNTS, seed=seed, curvature=curvature)
        self.rods: Rods = soft_rods(self.helices)
        self.state: RodState = random_motion(self.rods, self.helices)
        turns = Rotation.from_rotvec(rng.normal(size=(len(COUNTS), 3)) * 0.1).as_matrix()
        self.roots = self.state.roots + rng.normal(size=(len(COUNTS), 3)) * 0.01
        self.frames = turns @ self.state.frames
        self.wind = rng.normal(size=(len(self.rods.lengths), 3)) * 3.0
        self.stepper = Stepper(self.rods)

    def begin(self) -> None:
        self.stepper.begin(self.state, self.roots, self.frames, DT, GRAVITY, self.wind)

    def elements(self, s: int) -> slice:
        return slice(self.rods.offsets[s], self.rods.offsets[s + 1])

    def dense(self, s: int) -> DenseRod:
        at = self.elements(s)
        return DenseRod(self.roots[s], self.frames[s], self.rods.lengths[at], self.state.curvatures[at])

    def drift(self, s: int, points: np.ndarray) -> np.ndarray:
        """(r~ - r_n)/dt with r_n where the points were, riding on the old root pose."""
        local = (points - self.roots[s]) @ self.frames[s]
        return (points - (self.state.roots[s] + local @ self.state.frames[s].T)) / DT

    def solve(self, s: int, impulse: np.ndarray | None = None) -> tuple[np.ndarray, ...]:
        at, rod = self.elements(s), self.dense(s)
        return step(
            rod,
            mass=self.rods.mass[at],
            drag=self.rods.drag[at],
            stiffness=self.rods.stiffness[at],
            rest=self.rods.rest[at],
            damping=self.rods.damping,
            old_velocities=self.state.velocities[at].reshape(-1, 3),
            drift=self.drift(s, rod.quadrature()[0]),
            dt=DT,
            gravity=GRAVITY,
            wind=self.wind[at],
            impulse=impulse,
        )

    def legs(self, seed: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Legs on the rods 0 and 2, none on the others, in no order along the rod."""
        rng = np.random.default_rng(seed)
        elements = np.array([2, 0, 2, 10, 4, 7, 7], np.int32)
        return np.array([0, 3, 3, 7, 7]), elements, rng.uniform(0, 1, 7) * self.rods.lengths[elements]


@pytest.mark.parametrize(("seed", "curvature"), [(0, 8.0), (1, 0.0), (2, 80.0)])
def test_step_is_the_dense_solve(seed: int, curvature: float) -> None:
    case = Case(seed, curvature)
    old = dataclasses.replace(case.state)
    expected = [case.solve(s) for s in range(len(COUNTS))]
    case.begin()
    assert case.state.curvatures is old.curvatures and case.state.roots is old.roots
    case.stepper.end(case.state)
    for s, (rates, velocities, impulse, _) in enumerate(expected):
        at = case.elements(s)
        scale = np.abs(rates).max()
        assert np.allclose(case.state.rates[at], rates, rtol=1e-10, atol=1e-10 * scale)
        assert np.allclose(case.state.velocities[at].reshape(-1, 3), velocities, **CLOSE)
        assert np.allclose(case.stepper.root_force[s], impulse / DT, rtol=1e-9, atol=1e-11 * np.abs(impulse / DT).max())
    assert np.array_equal(case.state.curvatures, old.curvatures + DT * case.state.rates)
    assert np.array_equal(case.state.roots, case.roots) and np.array_equal(case.state.frames, case.frames)


def test_points_and_free_velocities() -> None:
    case = Case()
    case.begin()
    _, elements, arcs = case.legs()
    now, before = case.stepper.points(elements, arcs)
    velocities = case.stepper.free_velocities(elements, arcs)
    for i, (element, arc) in enumerate(zip(elements, arcs)):
        s = int(case.stepper.element_strands[element])
        rod, local = case.dense(s), int(element) - int(case.rods.offsets[s])
        place = rod.place(local, arc)[0]
        drift = case.drift(s, place[None])[0]
        assert np.allclose(now[i], place, rtol=0, atol=1e-14)
        assert np.allclose(before[i], place - DT * drift, rtol=0, atol=1e-14)
        assert np.allclose(velocities[i], drift + rod.jacobian(local, arc) @ case.solve(s)[0].ravel(), **CLOSE)


def jacobians(case: Case, s: int, offsets: np.ndarray, elements: np.ndarray, arcs: np.ndarray) -> np.ndarray:
    """H (3 k_s, 3 N_s) of the legs of rod s."""
    legs = range(offsets[s], offsets[s + 1])
    rows = [case.dense(s).jacobian(int(elements[i] - case.rods.offsets[s]), arcs[i]) for i in legs]
    return np.concatenate(rows) if rows else np.zeros((0, 3 * COUNTS[s]))


def test_delassus_is_the_dense_product() -> None:
    case = Case()
    case.begin()
    offsets, elements, arcs = case.legs()
    blocks, block_offsets = case.stepper.delassus(offsets, elements, arcs)
    assert np.array_equal(np.diff(block_offsets), (3 * np.diff(offsets)) ** 2)
    for s in range(len(COUNTS)):
        h, matrix = jacobians(case, s, offsets, elements, arcs), case.solve(s)[3]
        expected = h @ np.linalg.solve(matrix, h.T)
        block = blocks[block_offsets[s] : block_offsets[s + 1]].reshape(expected.shape)
        assert np.allclose(block, expected, rtol=1e-9, atol=1e-11 * np.abs(expected).max(initial=1.0))


def test_impulses_change_rates_velocities_and_root_force_as_in_the_dense_solve() -> None:
    case = Case()
    case.begin()
    offsets, elements, arcs = case.legs()
    impulses = np.random.default_rng(5).normal(size=(len(elements), 3)) * 1e-6
    free = case.stepper.free_velocities(elements, arcs)
    blocks, block_offsets = case.stepper.delassus(offsets, elements, arcs)
    # in two parts: impulses add up
    case.stepper.apply(offsets, elements, arcs, impulses * 0.25)
    case.stepper.apply(offsets, elements, arcs, impulses * 0.75)
    pushed = case.stepper.free_velocities(elements, arcs)
    expected = []
    for s in range(len(COUNTS)):
        legs, h = slice(offsets[s], offsets[s + 1]), jacobians(case, s, offsets, elements, arcs)
        block = blocks[block_offsets[s] : block_offsets[s + 1]].reshape(len(h), len(h))
        assert np.allclose((pushed - free)[legs].ravel(), block @ impulses[legs].ravel(), rtol=1e-9, atol=1e-12)
        rates, velocities, root, _ = case.solve(s, h.T @ impulses[legs].ravel())
        expected.append((rates, velocities, root - impulses[legs].sum(axis=0)))
    case.stepper.end(case.state)
    for s, (rates, velocities, root) in enumerate(expected):
        at = case.elements(s)
        assert np.allclose(case.state.rates[at], rates, rtol=1e-9, atol=1e-10 * np.abs(rates).max())
        assert np.allclose(case.state.velocities[at].reshape(-1, 3), velocities, rtol=1e-9, atol=1e-10)
        assert np.allclose(case.stepper.root_force[s], root / DT, rtol=1e-8, atol=1e-10 * np.abs(root / DT).max())


def test_same_bytes_for_any_number_of_threads() -> None:
    results = []
    for threads in (1, 2):
        numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
        helices = random_helices([3, 9, 5, 4, 12, 1, 7] * 9, seed=4)
        rods = soft_rods(helices)
        state, stepper = random_motion(rods, helices), Stepper(rods)
        for _ in range(3):
            stepper.begin(state, state.roots, state.frames, DT, GRAVITY, np.ones((rods.n_elements, 3)))
            stepper.end(state)
        results.append(state.curvatures.tobytes() + state.velocities.tobytes() + stepper.root_force.tobytes())
    assert results[0] == results[1]


def test_rods_do_not_know_of_each_other() -> None:
    """The order of rods changes nothing in any of them."""
    case, alone = Case(), Case()
    case.begin()
    case.stepper.end(case.state)
    at = alone.elements(2)
    one = dataclasses.replace(
        alone.rods,
        offsets=np.array([0, COUNTS[2]], np.int32),
        **{name: getattr(alone.rods, name)[at] for name in ("lengths", "rest", "stiffness", "mass", "drag")},
        **{name: getattr(alone.rods, name)[2:3] for name in ("friction", "radius")},
    )
    state = RodState(
        alone.state.roots[2:3],
        alone.state.frames[2:3],
        alone.state.curvatures[at],
        alone.state.rates[at],
        alone.state.velocities[at],
    )
    stepper = Stepper(one)
    stepper.begin(state, alone.roots[2:3], alone.frames[2:3], DT, GRAVITY, alone.wind[at])
    stepper.end(state)
    assert np.array_equal(state.curvatures, case.state.curvatures[at])


@pytest.mark.parametrize("dt", [0.0, -0.01, float("nan"), float("inf")])
def test_bad_time_step_is_refused(dt: float) -> None:
    case = Case()
    with pytest.raises(InputError, match="time step"):
        case.stepper.begin(case.state, case.roots, case.frames, dt, GRAVITY, case.wind)


def test_bad_input_is_refused() -> None:
    case = Case()
    stepper, state = case.stepper, case.state
    with pytest.raises(InputError, match="wind has NaN"):
        stepper.begin(state, case.roots, case.frames, DT, GRAVITY, case.wind * np.nan)
    with pytest.raises(InputError, match="new roots must have shape"):
        stepper.begin(state, case.roots[:2], case.frames, DT, GRAVITY, case.wind)
    with pytest.raises(InputError, match="no rotations"):
        stepper.begin(state, case.roots, case.frames * 1.1, DT, GRAVITY, case.wind)
    with pytest.raises(InputError, match="call begin first"):
        stepper.end(state)
    with pytest.raises(InputError, match="call begin and end first"):
        stepper.energies()
    with pytest.raises(InputError, match="mass of the rods is 0"):
        dataclasses.replace(case.rods, mass=case.rods.mass * 0.0)
    with pytest.raises(InputError, match="stiffness of the rods is -"):
        dataclasses.replace(case.rods, stiffness=-case.rods.stiffness)
    case.begin()
    _, elements, arcs = case.legs()
    with pytest.raises(InputError, match="another rod"):
        stepper.delassus(np.array([0, 4, 4, 7, 7]), elements, arcs)
    with pytest.raises(InputError, match="does not exist"):
        stepper.points(elements + np.int32(99), arcs)
    with pytest.raises(InputError, match="span the legs"):
        stepper.delassus(np.array([0, 3, 3, 7, 6]), elements, arcs)
