"""Small sets of rods that several tests use."""

from __future__ import annotations

import numpy as np
from hairloom.rods.dynamics import Stepper
from hairloom.rods.helices import Helices, evaluate
from hairloom.rods.material import MaterialParams
from hairloom.rods.model import Rods, RodState, initial_state, make_rods
from scipy.spatial.transform import Rotation

GRAVITY = np.array([0.0, 0.0, -9.81])


def random_helices(counts: list[int], *, seed: int = 0, length: float = 0.25, curvature: float = 8.0) -> Helices:
    """Rods with different numbers of elements of uneven lengths, on random root poses."""
    rng = np.random.default_rng(seed)
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    elements = int(offsets[-1])
    lengths = rng.uniform(0.5, 1.5, elements) * length / np.repeat(counts, counts)
    return Helices(
        roots=rng.normal(size=(len(counts), 3)) * 0.1,
        frames=np.ascontiguousarray(Rotation.random(len(counts), random_state=seed).as_matrix()).reshape(-1, 3, 3),
        offsets=offsets,
        lengths=lengths,
        curvatures=rng.normal(size=(elements, 3)) * curvature,
    )


def random_motion(rods: Rods, helices: Helices, *, seed: int = 1, speed: float = 0.5) -> RodState:
    """The helices' pose, bent a little away from rest and with velocities that no rates make."""
    rng = np.random.default_rng(seed)
    state = initial_state(helices)
    state.curvatures = state.curvatures + rng.normal(size=state.curvatures.shape)
    state.velocities = rng.normal(size=state.velocities.shape) * speed
    return state


def straight(n_elements: int, length: float, direction: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> Helices:
    """One straight rod from the origin; n2 is up (z) unless the rod is."""
    tangent = np.array(direction) / np.linalg.norm(direction)
    up = np.array([0.0, 0.0, 1.0]) if abs(tangent[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    normal = np.cross(up, tangent)
    normal /= np.linalg.norm(normal)
    frame = np.stack([tangent, normal, np.cross(tangent, normal)], axis=1)
    return Helices(
        roots=np.zeros((1, 3)),
        frames=np.ascontiguousarray(frame[None]),
        offsets=np.array([0, n_elements], np.int32),
        lengths=np.full(n_elements, length / n_elements),
        curvatures=np.zeros((n_elements, 3)),
    )


def soft_rods(helices: Helices, **changes: float) -> Rods:
    return make_rods(helices, MaterialParams(**{"stiffness_scale": 10.0, **changes}))  # type: ignore[arg-type]


def relax(rods: Rods, state: RodState, gravity: np.ndarray, dt: float, tolerance: float, max_steps: int = 5000) -> int:
    """Step with roots at rest until the rods move slower than `tolerance` m/s; returns the steps this took."""
    stepper, still = Stepper(rods), np.zeros((rods.n_elements, 3))
    for count in range(1, max_steps + 1):
        stepper.begin(state, state.roots, state.frames, dt, gravity, still)
        stepper.end(state)
        if np.abs(state.velocities).max() < tolerance:
            return count
    raise AssertionError(f"not at rest after {max_steps} steps: {np.abs(state.velocities).max():g} m/s")


def points_of(helices: Helices, state: RodState, n_points: int = 2) -> np.ndarray:
    """(S, n, 3) of a state, the last one the tip."""
    moved = Helices(state.roots, state.frames, helices.offsets, helices.lengths, state.curvatures)
    return evaluate(moved, n_points)[0]
