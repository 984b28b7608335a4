"""Helices: agreement with integration of the frame equation, steps of arc length, chains, bad input."""

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.rods.helices import Helices, evaluate, to_strands
from scipy.linalg import expm
from scipy.spatial.transform import Rotation


def random_helices(n_strands=5, seed=0, curl=60.0):
    random = np.random.default_rng(seed)
    counts = random.integers(1, 6, n_strands)
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    curvatures = random.normal(0.0, curl, (counts.sum(), 3))
    curvatures[0] = 0.0  # a straight one
    frames = Rotation.random(n_strands, random_state=seed).as_matrix()
    lengths = random.uniform(0.005, 0.05, counts.sum())
    return Helices(random.normal(0, 0.1, (n_strands, 3)), frames, offsets, lengths, curvatures)


def integrate_naive(helices, strand, n_points):
    """The same by the matrix exponential of the frame equation and the position's, element by element."""

    def pose(base, curvature, s):
        x, y, z = curvature
        twist = np.zeros((4, 4))
        twist[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
        twist[0, 3] = 1.0
        return base @ expm(s * twist)

    elements = range(helices.offsets[strand], helices.offsets[strand + 1])
    total = helices.lengths[list(elements)].sum()
    poses = []
    for arc in np.linspace(0, total, n_points):
        base = np.eye(4)
        base[:3, :3], base[:3, 3] = helices.frames[strand], helices.roots[strand]
        for e in elements:
            last = e == elements[-1]
            step = arc if last else min(arc, helices.lengths[e])
            base = pose(base, helices.curvatures[e], step)
            arc -= step
        poses.append(base)
    return np.array(poses)


def test_agrees_with_the_matrix_exponential():
    helices = random_helices()
    points, frames = evaluate(helices, 17)
    for strand in range(helices.n_strands):
        wanted = integrate_naive(helices, strand, 17)
        # rounding of some dozens of products; lengths are below a metre
        assert np.abs(points[strand] - wanted[:, :3, 3]).max() < 1e-14
        assert np.abs(frames[strand] - wanted[:, :3, :3]).max() < 1e-12


@pytest.mark.parametrize("turn", [0.0, 1e-9, 1e-4, 0.0999999, 0.1000001, 0.5])
def test_series_and_closed_form_meet(turn):
    length = 0.03
    curvature = np.array([[0.3, -0.5, 0.8]]) / np.sqrt(0.98) * turn / length
    helices = Helices(np.zeros((1, 3)), np.eye(3)[None], np.array([0, 1], np.int32), np.array([length]), curvature)
    points, frames = evaluate(helices, 3)
    wanted = integrate_naive(helices, 0, 3)
    assert np.abs(points[0] - wanted[:, :3, 3]).max() < 1e-16
    assert np.abs(frames[0] - wanted[:, :3, :3]).max() < 1e-15


def test_a_plane_circle_has_its_radius():
    radius = 0.02
    arc = 2 * np.pi * radius
    helices = Helices(
        np.zeros((1, 3)), np.eye(3)[None], np.array([0, 1], np.int32), np.array([arc]), np.array([[0, 0, 1 / radius]])
    )
    points, frames = evaluate(helices, 33)
    centre = np.array([0.0, radius, 0.0])  # positive curvature about n2 turns n0 towards n1
    assert np.abs(np.linalg.norm(points[0] - centre, axis=1) - radius).max() < 1e-16
    assert np.abs(points[0, -1]).max() < 1e-16
    assert np.abs(frames[0, 8] - [[0, -1, 0], [1, 0, 0], [0, 0, 1]]).max() < 1e-15


def test_rigid_motion_moves_everything_along():
    helices = random_helices(seed=3)
    turn = Rotation.from_rotvec([0.3, -1.1, 0.4]).as_matrix()
    moved = Helices(
        helices.roots @ turn.T + 0.5, turn @ helices.frames, helices.offsets, helices.lengths, helices.curvatures
    )
    points, frames = evaluate(helices, 9)
    moved_points, moved_frames = evaluate(moved, 9)
    assert np.abs(moved_points - (points @ turn.T + 0.5)).max() < 1e-14
    assert np.abs(moved_frames - turn @ frames).max() < 1e-13


def test_strands_have_the_counts_and_the_points_of_evaluate():
    helices = random_helices(seed=4)
    strands = to_strands(helices, np.arange(1, 6, dtype=np.int32))
    assert strands.point_counts.tolist() == [1, 2, 3, 4, 5]
    assert np.array_equal(strands.roots, helices.roots.astype(np.float32))
    points, _ = evaluate(helices, 4)
    assert np.array_equal(strands.points[6:10], points[3].astype(np.float32))
    assert np.array_equal(to_strands(helices).point_counts, 8 * helices.element_counts + 1)


def test_bad_input_is_refused():
    helices = random_helices()
    with pytest.raises(InputError, match="n_points is 1"):
        evaluate(helices, 1)
    with pytest.raises(InputError, match="below 1"):
        to_strands(helices, np.zeros(5, np.int32))
    with pytest.raises(InputError, match="counts"):
        to_strands(helices, np.ones(4, np.int32))
    empty = Helices(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(1, np.int32), np.zeros(0), np.zeros((0, 3)))
    assert evaluate(empty, 3)[0].shape == (0, 3, 3)
    assert to_strands(empty).n_strands == 0
