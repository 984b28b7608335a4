"""Gradient-domain deformation: what must hold exactly, a slow reference, coupling, collision."""

from __future__ import annotations

import numpy as np
import pytest
from hairloom.editing._deformation_kernels import FREE_WEIGHT
from hairloom.editing.deformation import DeformParams, deform
from hairloom.errors import InputError
from hairloom.geometry.collider import build_collider
from hairloom.geometry.head import sphere_head
from hairloom.geometry.root_graph import RootGraph, connect_roots
from scipy.spatial.transform import Rotation

N = 24


def helices(count: int = 5, radius: float = 0.01, turns: float = 3.0) -> np.ndarray:
    """(count, N, 3) helices along z, side by side, metres."""
    t = np.linspace(0.0, 1.0, N)
    angles = 2 * np.pi * turns * t + np.arange(count)[:, None]
    x = radius * (np.cos(angles) - np.cos(angles[:, :1])) + 0.03 * np.arange(count)[:, None]
    y = radius * (np.sin(angles) - np.sin(angles[:, :1]))
    return np.stack([x, y, np.broadcast_to(0.2 * t, x.shape)], axis=2)


def segment_lengths(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(points, axis=1), axis=2)


def test_without_handles_nothing_moves() -> None:
    hair = helices()
    result = deform(hair, np.zeros(hair.shape[:2]), np.zeros_like(hair))
    np.testing.assert_allclose(result.points, hair, atol=1e-15)
    np.testing.assert_allclose(result.turns[:, :, 0], 1.0)


def test_a_rigid_motion_of_all_handles_moves_strands_rigidly() -> None:
    hair = helices()
    turn = Rotation.from_rotvec([0.4, -1.9, 0.7])
    moved = turn.apply(hair.reshape(-1, 3)).reshape(hair.shape) + np.array([0.3, -0.2, 1.0])
    weights = np.zeros(hair.shape[:2])
    weights[:, [0, 1, 8, 15]] = 100.0
    graph = connect_roots(hair[:, 0, :2].astype(np.float32))
    result = deform(hair, weights, moved, graph, DeformParams(iterations=3))
    np.testing.assert_allclose(result.points, moved, atol=1e-12)
    quaternion = turn.as_quat()[[3, 0, 1, 2]]
    np.testing.assert_allclose(np.abs(result.turns @ quaternion), 1.0, atol=1e-12)


def test_root_and_first_edge_are_fixed_and_lengths_kept() -> None:
    hair = helices()
    weights = np.zeros(hair.shape[:2])
    weights[:, 14] = 100.0
    targets = hair + np.array([0.05, 0.02, -0.03])
    result = deform(hair, weights, targets)
    np.testing.assert_array_equal(result.points[:, :2], hair[:, :2])
    np.testing.assert_allclose(segment_lengths(result.points), segment_lengths(hair), rtol=1e-12)
    # a firm handle within reach is nearly met, also once lengths are back
    gap = np.linalg.norm(result.points[:, 14] - targets[:, 14], axis=1)
    assert gap.max() < 0.35 * np.linalg.norm([0.05, 0.02, -0.03])


def test_turns_are_those_of_the_edges() -> None:
    hair = helices()
    weights = np.zeros(hair.shape[:2])
    weights[:, 14] = 100.0
    result = deform(hair, weights, hair + np.array([0.03, 0.0, 0.0]))
    before, after = np.diff(hair, axis=1), np.diff(result.points, axis=1)
    turned = Rotation.from_quat(result.turns[:, :, [1, 2, 3, 0]].reshape(-1, 4)).apply(before.reshape(-1, 3))
    np.testing.assert_allclose(turned, after.reshape(-1, 3), atol=1e-12)


def quaternion_product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    w = p[0] * q[0] - p[1:] @ q[1:]
    return np.concatenate([[w], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])])


def _naive_deform(strand: np.ndarray, weights: np.ndarray, targets: np.ndarray, params: DeformParams) -> np.ndarray:
    """Both solves with dense matrices, as M-7 writes them; one strand, without neighbours."""
    n = len(strand)
    edges = np.diff(strand, axis=0)
    turns = [np.array([1.0, 0.0, 0.0, 0.0])] * (n - 1)
    stiffness = (params.bend_length * n) ** 2
    last = int(np.flatnonzero(weights).max())
    points = strand.copy()
    for _ in range(params.iterations):
        turned = np.array([Rotation.from_quat(q[[1, 2, 3, 0]]).apply(e) for q, e in zip(turns, edges)])
        rows, right = [], []
        for i in range(1, n - 1):
            row = np.zeros(n)
            row[i], row[i + 1] = -1.0, 1.0
            rows.append(row)
            right.append(turned[i])
        for i in np.flatnonzero(weights):
            row = np.zeros(n)
            row[i] = np.sqrt(weights[i])
            rows.append(row)
            right.append(np.sqrt(weights[i]) * targets[i])
        matrix, wanted = np.array(rows), np.array(right) - np.array(rows)[:, :2] @ strand[:2]
        points[2:] = np.linalg.lstsq(matrix[:, 2:], wanted, rcond=None)[0]
        rows, right = [], []
        for i in range(1, n - 1):
            step = points[i + 1] - points[i]
            axis = np.cross(turned[i], step)
            angle = np.arctan2(np.linalg.norm(axis), turned[i] @ step)
            axis /= max(np.linalg.norm(axis), 1e-30)
            smallest = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])
            trust = np.sqrt(1.0 if i < last else FREE_WEIGHT)
            row = np.zeros(n - 1)
            row[i] = trust
            rows.append(row)
            right.append(trust * quaternion_product(smallest, turns[i]))
            row = np.zeros(n - 1)
            row[i], row[i - 1] = np.sqrt(stiffness), -np.sqrt(stiffness)
            rows.append(row)
            right.append(np.zeros(4))
        matrix = np.array(rows)
        wanted = np.array(right) - np.outer(matrix[:, 0], turns[0])
        free = np.linalg.lstsq(matrix[:, 1:], wanted, rcond=None)[0]
        turns = [turns[0], *(free / np.linalg.norm(free, axis=1, keepdims=True))]
    directions = np.diff(points, axis=0) / np.linalg.norm(np.diff(points, axis=0), axis=1, keepdims=True)
    steps = directions * np.linalg.norm(edges, axis=1, keepdims=True)
    steps[0] = edges[0]
    return np.concatenate([strand[:1], strand[0] + np.cumsum(steps, axis=0)])


def test_agrees_with_dense_solves() -> None:
    hair = helices(3)
    weights = np.zeros(hair.shape[:2])
    weights[:, 9], weights[:, 16] = 20.0, 100.0
    targets = hair + np.array([0.03, -0.02, 0.01])
    params = DeformParams(iterations=4, drag=0.0)
    result = deform(hair, weights, targets, None, params)
    for strand in range(3):
        expected = _naive_deform(hair[strand], weights[strand], targets[strand], params)
        np.testing.assert_allclose(result.points[strand], expected, atol=1e-10)


def test_a_full_turn_winds_a_curl_up_and_does_not_collapse_it() -> None:
    """The tip half of a helix is led once around the axis in steps: its turns go round with it."""
    hair = helices(1)
    points, total = hair.copy(), np.tile([1.0, 0.0, 0.0, 0.0], (N - 1, 1))
    weights = np.zeros((1, N))
    weights[0, 12:] = 100.0
    steps = 36
    turn = Rotation.from_rotvec([0.0, 0.0, 2 * np.pi / steps])
    axis = np.array([-0.01, 0.0, 0.0])  # of the helix
    for _ in range(steps):
        targets = turn.apply(points[0] - axis)[None] + axis
        # as many alternations as a step of the comb makes
        result = deform(points, weights, targets, None, DeformParams(drag=0.0, iterations=12), rest=hair)
        points = result.points
        total = np.array([quaternion_product(a, b) for a, b in zip(result.turns[0], total)])
    np.testing.assert_allclose(segment_lengths(points), segment_lengths(hair), rtol=1e-9)
    # round once: the quaternion has changed its sign, the edges are where they were
    assert total[-1] @ [1.0, 0.0, 0.0, 0.0] < -0.9
    width = np.ptp(points[0, 12:, :2], axis=0).min()
    assert width > 0.8 * np.ptp(hair[0, 12:, :2], axis=0).min()


def line_graph(count: int) -> RootGraph:
    return connect_roots(np.column_stack([np.arange(count), np.zeros(count)]).astype(np.float32))


def test_neighbours_are_dragged_the_less_the_farther() -> None:
    hair = helices(6, radius=0.0)
    weights = np.zeros(hair.shape[:2])
    weights[0, 14] = 100.0
    targets = hair + np.array([0.0, 0.05, 0.0])
    moved = {}
    for drag in (0.0, 0.3, 0.8):
        result = deform(hair, weights, targets, line_graph(6), DeformParams(drag=drag))
        moved[drag] = np.abs(result.points - hair).max(axis=(1, 2))
    assert moved[0.0][1:].max() < 1e-12
    # one more neighbour is reached by each pair of alternations
    assert (np.diff(moved[0.8][:3]) < 0).all()
    assert moved[0.3][1] < moved[0.8][1]
    assert moved[0.3][1] > 1e-4


def test_strands_with_handles_do_not_wait_for_others() -> None:
    """Who is held by the brush moves as far with neighbours beside it as alone."""
    hair = helices(6, radius=0.0)
    weights = np.zeros(hair.shape[:2])
    weights[0, 14] = 100.0
    targets = hair + np.array([0.0, 0.05, 0.0])
    alone = deform(hair[:1], weights[:1], targets[:1])
    together = deform(hair, weights, targets, line_graph(6))
    np.testing.assert_allclose(together.points[0], alone.points[0], atol=1e-12)


def test_strands_stay_out_of_the_collider() -> None:
    head = sphere_head(radius=0.1)
    collider = build_collider([head], cell=0.004)
    t = np.linspace(0.0, 1.0, N)
    hair = np.stack([0.15 * t, np.zeros(N), np.full(N, 0.101)], axis=1)[None]
    weights = np.zeros((1, N))
    weights[0, 12:] = 100.0
    points = hair
    for _ in range(20):
        points = deform(points, weights, points - [0.0, 0.0, 0.01], rest=hair, collider=collider).points
    # a tenth of the cell is what linear interpolation on the sphere loses
    assert np.linalg.norm(points, axis=2).min() > 0.1 - 4e-4
    np.testing.assert_allclose(segment_lengths(points), segment_lengths(hair), rtol=1e-9)


def test_bad_input() -> None:
    hair = helices()
    with pytest.raises(InputError, match="weights must have shape"):
        deform(hair, np.zeros(3), hair)
    with pytest.raises(InputError, match="targets must have shape"):
        deform(hair, np.zeros(hair.shape[:2]), hair[:2])
    with pytest.raises(InputError, match="N >= 3"):
        deform(hair[:, :2], np.zeros((5, 2)), hair[:, :2])
    with pytest.raises(InputError, match="iterations is 0"):
        DeformParams(iterations=0)
    with pytest.raises(InputError, match="drag is 2"):
        DeformParams(drag=2.0)
