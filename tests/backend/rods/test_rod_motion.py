"""Rods in motion against theory: frequencies, energy, moving roots, order of the time step, invariance (B-25, M-25)."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from dense_reference import DenseRod
from hairloom.rods.dynamics import Stepper
from hairloom.rods.energies import energies, generalised_force
from hairloom.rods.helices import Helices
from hairloom.rods.model import Rods, RodState, initial_state
from rod_cases import GRAVITY, points_of, random_helices, random_motion, relax, soft_rods, straight
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

LENGTH = 0.25
NO_AIR_OR_LOSS = {"drag": 0.0, "damping": 0.0}


def swing(rods: Rods, helices: Helices, state: RodState, dt: float, steps: int, gravity: np.ndarray) -> np.ndarray:
    """(steps, 3): the tip of one rod with a still root."""
    stepper, still, tips = Stepper(rods), np.zeros((rods.n_elements, 3)), []
    for _ in range(steps):
        stepper.begin(state, state.roots, state.frames, dt, gravity, still)
        stepper.end(state)
        tips.append(points_of(helices, state)[0, -1])
    return np.array(tips)


def frequency(values: np.ndarray, dt: float) -> float:
    """rad/s, from the first and the last time that values pass 0."""
    before = np.flatnonzero(values[:-1] * values[1:] < 0)
    passes = before + values[before] / (values[before] - values[before + 1])
    return float(np.pi * (len(passes) - 1) / ((passes[-1] - passes[0]) * dt))


@pytest.mark.parametrize(("n_elements", "mode", "theory"), [(5, 0, 3.51602), (10, 0, 3.51602), (20, 1, 22.0345)])
def test_bending_frequencies_of_a_clamped_rod(n_elements: int, mode: int, theory: float) -> None:
    helices = straight(n_elements, LENGTH)
    rods = soft_rods(helices, **NO_AIR_OR_LOSS)
    _, shares, jacobians = DenseRod(np.zeros(3), helices.frames[0], helices.lengths, helices.curvatures).quadrature()
    bends = np.arange(n_elements) * 3 + 1
    mass = rods.mass[0] * np.einsum("p,pik,pil->kl", shares, jacobians, jacobians)[np.ix_(bends, bends)]
    squares, shapes = eigh(np.diag(rods.lengths * rods.stiffness[:, 1]), mass)
    shape = shapes[:, mode]
    state = initial_state(helices)
    state.curvatures[:, 1] = shape * (1e-3 / LENGTH / np.abs(shape).max())
    expected = theory * np.sqrt(rods.stiffness[0, 1] / (rods.mass[0] * LENGTH**4))
    dt = 2 * np.pi / expected / 400
    tips = swing(rods, helices, state, dt, 1100, np.zeros(3))
    found = frequency(tips[:, 2], dt)
    # Euler and Bernoulli's; elements of constant curvature are a little stiffer (0.8 % at 5), in the step as in M and A
    assert abs(found / expected - 1) < 0.01
    assert abs(found / np.sqrt(squares[mode]) - 1) < 3e-4


def test_stiff_rod_on_a_soft_tiny_element_is_a_pendulum() -> None:
    """A thin rod that swings about its end: omega^2 = 3 g / (2 L)."""
    helices = straight(6, LENGTH, (0.02, 0.0, -1.0))
    lengths = np.array([1e-4, 0.2, 0.2, 0.2, 0.2, 0.2 - 1e-4]) * LENGTH
    helices = dataclasses.replace(helices, lengths=lengths)
    rods = soft_rods(helices, **NO_AIR_OR_LOSS)
    stiffness = rods.stiffness * np.where(np.arange(6) == 0, 1e-9, 1e4)[:, None]
    rods = dataclasses.replace(rods, stiffness=stiffness)
    expected = np.sqrt(1.5 * 9.81 / LENGTH)
    dt = 2 * np.pi / expected / 400
    tips = swing(rods, helices, initial_state(helices), dt, 1100, GRAVITY)
    assert abs(frequency(tips[:, 0], dt) / expected - 1) < 0.01


@pytest.mark.parametrize("dt", [1 / 1000, 1 / 48, 0.5])
def test_energy_never_grows_without_forcing(dt: float) -> None:
    helices = random_helices([3, 10, 6, 1], curvature=20.0)
    rods = soft_rods(helices, **NO_AIR_OR_LOSS)
    state, stepper = random_motion(rods, helices, speed=3.0), Stepper(rods)
    # the random velocities are none that the rods can have; the first step projects them
    start = previous = energies(rods, state, GRAVITY)
    for _ in range(300):
        stepper.begin(state, state.roots, state.frames, dt, np.zeros(3), np.zeros((rods.n_elements, 3)))
        stepper.end(state)
        now = stepper.energies()
        before = previous.kinetic + previous.elastic
        # rounding of a sum, and of the curvatures once all has died away
        assert (now.kinetic + now.elastic <= before * (1 + 1e-12) + 1e-20 * (start.kinetic + start.elastic)).all()
        previous = now


@pytest.mark.parametrize("dt", [1 / 1000, 1 / 48, 1 / 24])
def test_energy_in_gravity_stays_bounded(dt: float) -> None:
    helices = random_helices([3, 10, 20, 6], curvature=20.0)
    rods = soft_rods(helices, **NO_AIR_OR_LOSS, stiffness_scale=1.0)
    state, stepper = initial_state(helices), Stepper(rods)
    start = energies(rods, state, GRAVITY)
    weight = np.add.reduceat(rods.mass * rods.lengths, rods.offsets[:-1]) * 9.81 * LENGTH
    for _ in range(500):
        stepper.begin(state, state.roots, state.frames, dt, GRAVITY, np.zeros((rods.n_elements, 3)))
        stepper.end(state)
        now = stepper.energies()
        gained = (now.kinetic + now.elastic + now.gravity) - (start.kinetic + start.elastic + start.gravity)
        # gravity's work is that of the tangent, not of the arc: what that leaves is of second order in a step
        assert (gained < 0.1 * weight).all()


def moved_root(time: float, spin: np.ndarray, growth: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """The root's frame after turning at the angular velocity spin + growth t; both along one axis."""
    return Rotation.from_rotvec(spin * time + 0.5 * growth * time**2).as_matrix() @ frame


def test_rod_on_a_turning_root_has_coriolis_and_centrifugal_accelerations() -> None:
    """As dt -> 0 the rates change as M q'' + mu A q' + A (q - q0) = int J^T F - c says, with the terms of c in full."""
    rng = np.random.default_rng(7)
    helices = random_helices([4], seed=5, curvature=40.0)
    # soft, so that its fastest twist is slow beside dt
    rods = soft_rods(helices, drag=0.0, damping=0.01, stiffness_scale=1e-3)
    frame, lengths = helices.frames[0], helices.lengths
    q, rates = helices.curvatures + rng.normal(size=(4, 3)), rng.normal(size=(4, 3)) * 20.0
    # w0 and its growth along one axis, so that the root's turn is known in closed form
    spin, growth = np.array([3.0, -5.0, 4.0]), np.array([30.0, -50.0, 40.0])
    speed, push = rng.normal(size=3), rng.normal(size=3) * 9
    rod, still = DenseRod(np.zeros(3), frame, lengths, q), 1e-5
    points, shares, jacobians = rod.quadrature()
    ahead, back = (DenseRod(np.zeros(3), frame, lengths, q + sign * still * rates).quadrature()[2] for sign in (1, -1))
    relative = np.einsum("pik,k->pi", jacobians, rates.ravel())
    bending = np.einsum("pik,k->pi", (ahead - back) / (2 * still), rates.ravel())
    centrifugal, coriolis = np.cross(spin, np.cross(spin, points)), 2 * np.cross(spin, relative)
    terms = [bending, np.broadcast_to(push, points.shape), np.cross(growth, points), centrifugal, coriolis]
    m, a = rods.mass[0] * shares, (lengths[:, None] * rods.stiffness).ravel()
    mass = np.einsum("p,pik,pil->kl", m, jacobians, jacobians)
    pulled = [np.einsum("p,pik,pi->k", m, jacobians, term) for term in terms]
    force = np.einsum("p,pik,i->k", m, jacobians, GRAVITY) - sum(pulled)
    force -= a * (0.01 * rates.ravel() + (q - rods.rest).ravel())
    expected = np.linalg.solve(mass, force).reshape(-1, 3)
    scale = np.abs(expected).max()
    # each of the terms matters
    assert all(np.abs(np.linalg.solve(mass, term)).max() > 0.01 * scale for term in pulled)
    accelerations = []
    for dt in (2e-6, 1e-6):
        velocities = (speed + np.cross(spin, points) + relative).reshape(4, 3, 3)
        state = RodState(np.zeros((1, 3)), frame[None].copy(), q.copy(), rates.copy(), velocities)
        stepper = Stepper(rods)
        for step in (1, 2):
            time = step * dt
            root = (speed * time + 0.5 * push * time**2)[None]
            stepper.begin(state, root, moved_root(time, spin, growth, frame)[None], dt, GRAVITY, np.zeros((4, 3)))
            stepper.end(state)
            if step == 1:
                first = state.rates
        accelerations.append((state.rates - first) / dt)
    found = 2 * accelerations[1] - accelerations[0]
    # what the extrapolation leaves, of second order in dt, and rounding of the differences
    assert np.allclose(found, expected, rtol=0, atol=1e-4 * scale)


def shaken(rods: Rods, helices: Helices, dt: float, duration: float, frequency_hz: float, size: float) -> RodState:
    """Roots that start at rest and move to and fro by `size` m and size * 20 rad."""
    state, stepper = initial_state(helices), Stepper(rods)
    for step in range(1, round(duration / dt) + 1):
        sway = np.sin(np.pi * frequency_hz * step * dt) ** 2
        turn = Rotation.from_rotvec(np.array([0.3, 0.5, 1.0]) * sway * size * 20).as_matrix()
        roots = helices.roots + np.array([1.0, 0.5, 0.0]) * sway * size
        stepper.begin(state, roots, turn @ helices.frames, dt, GRAVITY, np.zeros((rods.n_elements, 3)))
        stepper.end(state)
    return state


def test_time_step_is_of_first_order() -> None:
    helices = random_helices([5, 8], curvature=5.0)
    rods = soft_rods(helices, damping=0.01)
    results = [shaken(rods, helices, 0.2 / steps, 0.2, 2.0, 0.02) for steps in (50, 100, 200, 400)]
    tips = [points_of(helices, state)[:, -1] for state in results]
    changes = np.linalg.norm(np.diff(tips, axis=0), axis=(1, 2))
    assert np.allclose(np.log2(changes[:-1] / changes[1:]), 1.0, atol=0.15)


def test_violent_root_motion_at_a_frame_a_step_does_not_explode() -> None:
    helices = random_helices([10, 25, 3, 5], curvature=20.0)
    rods = soft_rods(helices, damping=0.0, stiffness_scale=1.0)
    state, stepper, speeds = initial_state(helices), Stepper(rods), []
    # the root's chord, and the whole rod turned with it
    fastest = 24 * (0.11 + 2 * 1.05 * LENGTH * 1.5)
    for step in range(1, 241):
        phase = np.sin(2 * np.pi * 20.0 * step / 24 * 1.0137)
        turn = Rotation.from_rotvec(np.array([0.0, 0.3, 1.0]) * phase).as_matrix()
        roots = helices.roots + np.array([0.05, 0.0, 0.02]) * phase
        stepper.begin(state, roots, turn @ helices.frames, 1 / 24, GRAVITY, np.zeros((rods.n_elements, 3)))
        stepper.end(state)
        speeds.append(np.abs(state.velocities).max())
    assert np.isfinite(points_of(helices, state, 20)).all()
    assert max(speeds) < fastest
    # the second half is no faster than the first: nothing builds up
    assert max(speeds[120:]) < 1.5 * max(speeds[:120])


def test_moving_the_world_rigidly_moves_the_result() -> None:
    turn, shift = Rotation.from_rotvec([0.4, -1.0, 2.0]).as_matrix(), np.array([3.0, -1.0, 0.5])
    helices = random_helices([4, 7])
    rods = soft_rods(helices)
    start, results = random_motion(rods, helices), []
    for rotation, offset in ((np.eye(3), np.zeros(3)), (turn, shift)):
        state = RodState(
            start.roots @ rotation.T + offset,
            rotation @ start.frames,
            start.curvatures,
            start.rates,
            start.velocities @ rotation.T,
        )
        stepper = Stepper(rods)
        for step in range(20):
            roots = (helices.roots + 0.002 * (step + 1)) @ rotation.T + offset
            wind = np.tile(rotation @ np.array([2.0, 1.0, 0.0]), (rods.n_elements, 1))
            stepper.begin(state, roots, rotation @ start.frames, 1 / 48, rotation @ GRAVITY, wind)
            stepper.end(state)
        results.append((state.curvatures, state.velocities @ rotation, stepper.root_force @ rotation))
    for one, other in zip(*results):
        # rounding of the turned input, grown over 20 steps
        assert np.allclose(one, other, rtol=1e-9, atol=1e-10 * np.abs(one).max())


def test_wind_carries_a_light_rod_and_the_root_holds_it() -> None:
    helices = straight(8, LENGTH, (0.0, 0.0, -1.0))
    rods = soft_rods(helices, damping=0.1)
    state, stepper = initial_state(helices), Stepper(rods)
    wind = np.tile([0.3, 0.0, 0.0], (8, 1))
    for _ in range(3000):
        stepper.begin(state, state.roots, state.frames, 0.02, GRAVITY, wind)
        stepper.end(state)
    weight, push = rods.mass[0] * LENGTH * 9.81, rods.drag[0] * LENGTH * 0.3
    # at rest the root holds the weight, and the air's push
    assert np.allclose(stepper.root_force[0], [-push, 0.0, weight], rtol=1e-6, atol=1e-6 * weight)
    assert points_of(helices, state)[0, -1, 0] > 0.01


def test_rod_at_its_equilibrium_does_not_move() -> None:
    """With q0 = q - A^-1 f_g (B-22) the first step and all later ones leave the rod where it is."""
    helices = random_helices([6, 9], curvature=6.0)
    rods = soft_rods(helices, stiffness_scale=300.0)
    state = initial_state(helices)
    force = generalised_force(rods, state.roots, state.frames, state.curvatures, GRAVITY)
    rods = dataclasses.replace(rods, rest=helices.curvatures - force / (rods.lengths[:, None] * rods.stiffness))
    relax(rods, state, GRAVITY, 1 / 48, 1e-9, 200)
    before, after = points_of(helices, initial_state(helices), 10), points_of(helices, state, 10)
    assert np.abs(after - before).max() < 1e-12
