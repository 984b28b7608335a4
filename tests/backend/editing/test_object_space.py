"""Positions in the object's space, where what did not move keeps its bits."""

import numpy as np
import pytest
from hairloom.editing.object_space import return_to_object
from hairloom.errors import InputError

TO_WORLD = np.array([[1.1, 0.2, 0.0, 0.3], [-0.1, 0.9, 0.3, -0.2], [0.0, -0.2, 1.3, 0.5], [0.0, 0.0, 0.0, 1.0]])


def example(n_points=1000):
    rng = np.random.default_rng(0)
    positions = rng.normal(size=(n_points, 3)).astype(np.float32)
    points = (positions @ TO_WORLD[:3, :3].T + TO_WORLD[:3, 3]).astype(np.float32)
    return positions, points


def test_points_that_stay_keep_their_bits_and_others_come_back():
    positions, before = example()
    moved = before.copy()
    moved[::3] += np.float32([0.1, -0.2, 0.3])
    found = return_to_object(moved, before, positions, np.linalg.inv(TO_WORLD))
    stay = np.arange(len(positions)) % 3 != 0
    assert (found[stay].view(np.uint32) == positions[stay].view(np.uint32)).all()
    world = found.astype(np.float64) @ TO_WORLD[:3, :3].T + TO_WORLD[:3, 3]
    assert np.abs(world - moved)[~stay].max() < 1e-6  # float32 of numbers about 1
    # without the rule the way there and back would round some of them
    back = before.astype(np.float64) @ np.linalg.inv(TO_WORLD)[:3, :3].T + np.linalg.inv(TO_WORLD)[:3, 3]
    assert (back.astype(np.float32) != positions).any()


def test_a_point_that_moves_along_one_axis_only_counts_as_moved():
    positions, before = example(9)
    for axis in range(3):
        moved = before.copy()
        moved[4, axis] += np.float32(0.5)
        found = return_to_object(moved, before, positions, np.linalg.inv(TO_WORLD))
        assert (np.flatnonzero((found != positions).any(axis=1)) == [4]).all()


def test_other_counts_are_refused():
    positions, before = example(9)
    with pytest.raises(InputError, match="8 points now and 9 before"):
        return_to_object(before[:8], before, positions, np.eye(4))
