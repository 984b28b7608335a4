"""Forces of loads on rods, their Jacobians and Hessians against finite differences and the dynamics' own force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hairloom.rods.energies import generalised_force
from hairloom.rods.equilibrium import gravity_loads
from hairloom.rods.helices import Helices, evaluate
from hairloom.rods.statics import Loads, element_motion, jacobians, load_force, load_stiffness, pose_rods
from hairloom.types import Float64
from rod_cases import GRAVITY, random_helices, soft_rods

COUNTS = [3, 6, 1]


def random_loads(helices: Helices, seed: int = 2) -> Loads:
    """One load on every element, ten more anywhere."""
    rng = np.random.default_rng(seed)
    count = len(helices.lengths)
    elements = np.sort(np.concatenate([np.arange(count), rng.integers(0, count, 10)]))
    arcs = rng.uniform(size=len(elements)) * helices.lengths[elements]
    return Loads(elements, arcs, rng.normal(size=(len(elements), 3)))


def points_of(helices: Helices, loads: Loads) -> Float64:
    pose = pose_rods(helices)
    inside = element_motion(helices.curvatures[loads.elements], loads.arcs)[0]
    return pose.starts[loads.elements] + np.einsum("kij,kj->ki", pose.frames[loads.elements], inside)


def bent(helices: Helices, element: int, axis: int, by: float) -> Helices:
    curvatures = helices.curvatures.copy()
    curvatures[element, axis] += by
    return replace(helices, curvatures=curvatures)


def test_pose_is_that_of_the_helices() -> None:
    helices = random_helices([4, 4], curvature=20.0)
    pose = pose_rods(helices)
    points, _ = evaluate(replace(helices, lengths=np.full(8, 0.05)), 5)
    same = pose_rods(replace(helices, lengths=np.full(8, 0.05)))
    assert np.abs(points[:, 1:].reshape(-1, 3) - same.ends).max() < 1e-15
    assert np.abs(pose.starts[1:4] - pose.ends[:3]).max() == 0.0


@pytest.mark.parametrize("curvature", [0.0, 1e-4, 10.0, 60.0, 400.0])
def test_force_is_the_loads_work(curvature: float) -> None:
    """From straight (series) to several turns an element (closed form)."""
    helices = random_helices(COUNTS, curvature=curvature)
    loads = random_loads(helices)
    force = load_force(helices, pose_rods(helices), loads)
    by = 1e-2
    expected = np.empty_like(force)
    for element, axis in np.ndindex(expected.shape):
        moved = points_of(bent(helices, element, axis, by), loads) - points_of(bent(helices, element, axis, -by), loads)
        expected[element, axis] = (moved * loads.forces).sum() / (2.0 * by)
    # the step of 1e-2 1/m turns an element by 1e-3 rad: error of the differences 1e-6 / 6, and of the difference's
    # rounding 1e-14
    assert np.abs(force - expected).max() < 1e-6 * np.abs(force).max()


def test_gravity_is_the_dynamics_own() -> None:
    helices = random_helices(COUNTS, curvature=30.0)
    rods = soft_rods(helices)
    mine = load_force(helices, pose_rods(helices), gravity_loads(rods, GRAVITY))
    theirs = generalised_force(rods, helices.roots, helices.frames, helices.curvatures, GRAVITY)
    assert np.abs(mine - theirs).max() < 1e-13 * np.abs(theirs).max()


def test_jacobians_carry_the_same_force() -> None:
    helices = random_helices(COUNTS, curvature=30.0)
    loads = random_loads(helices)
    row_offsets, row_elements, rows = jacobians(helices, pose_rods(helices), loads.elements, loads.arcs)
    place = np.repeat(np.arange(len(loads.elements)), np.diff(row_offsets))
    force = np.zeros((len(helices.lengths), 3))
    np.add.at(force, row_elements, np.einsum("rij,ri->rj", rows, loads.forces[place]))
    expected = load_force(helices, pose_rods(helices), loads)
    assert np.abs(force - expected).max() < 1e-13 * np.abs(expected).max()


@pytest.mark.parametrize("curvature", [0.0, 30.0])
def test_stiffness_of_loads_is_the_change_of_their_force(curvature: float) -> None:
    helices = random_helices(COUNTS, curvature=curvature)
    loads = random_loads(helices)
    change = load_stiffness(helices, pose_rods(helices), loads)
    for first, count in zip(helices.offsets, COUNTS):
        matrix = change.dense(np.array([first]), count)[0]
        assert np.array_equal(matrix, matrix.T)
        expected = np.empty_like(matrix)
        for element, axis in np.ndindex(count, 3):
            sides = [bent(helices, first + element, axis, by) for by in (1e-2, -1e-2)]
            forces = [load_force(side, pose_rods(side), loads)[first : first + count] for side in sides]
            expected[:, 3 * element + axis] = (forces[0] - forces[1]).ravel() / 2e-2
        # both are central differences where the element's own block is concerned
        assert np.abs(matrix - expected).max() < 1e-6 * np.abs(expected).max()
