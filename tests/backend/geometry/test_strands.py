"""Lengths, resampling, selection, joining and moving of strand sets."""

from __future__ import annotations

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.geometry.strands import (
    from_dense,
    join_strands,
    polyline_lengths,
    resample,
    resample_set,
    resample_smooth,
    select_strands,
    strand_lengths,
    strand_of_point,
    subdivide,
    transform_strands,
)
from hairloom.types import StrandSet

F32_STEP = 2.0**-23  # relative rounding of float32, the storage type


def ragged(seed: int, n_strands: int = 40, least: int = 1) -> StrandSet:
    rng = np.random.default_rng(seed)
    counts = rng.integers(least, 20, n_strands)
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    points = rng.normal(size=(offsets[-1], 3)).cumsum(axis=0).astype(np.float32)
    return StrandSet(
        points,
        offsets,
        {"radius": rng.random(len(points)).astype(np.float32), "kind": np.arange(len(points), dtype=np.int32)},
        {"hairloom_wisp": np.arange(n_strands, dtype=np.int32)},
    )


def _resample_naive(points: np.ndarray, n_points: int) -> np.ndarray:
    points = points.astype(np.float64)
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    targets = np.linspace(0.0, reached[-1], n_points)
    return np.stack([np.interp(targets, reached, points[:, axis]) for axis in range(3)], axis=1)


def test_resample_agrees_with_interpolation_by_hand():
    strands = ragged(1, least=2)
    dense = resample(strands, 33)
    for strand, (start, end) in enumerate(zip(strands.offsets, strands.offsets[1:])):
        expected = _resample_naive(strands.points[start:end], 33)
        # one rounding to float32 of coordinates of up to about 30
        np.testing.assert_allclose(dense[strand], expected, rtol=0, atol=np.abs(expected).max() * 2 * F32_STEP)


def test_resample_keeps_the_end_points_bit_for_bit():
    strands = ragged(2)
    dense = resample(strands, 7)
    np.testing.assert_array_equal(dense[:, 0], strands.roots)
    np.testing.assert_array_equal(dense[:, -1], strands.points[strands.offsets[1:] - 1])


def test_resampled_circle_has_equal_steps():
    """A finely drawn arc whose points crowd at one end: the resampled chords are equal."""
    angle = np.linspace(0, 1, 4000) ** 3 * np.pi / 2
    arc = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)[None].astype(np.float32)
    steps = np.linalg.norm(np.diff(resample(from_dense(arc), 65)[0].astype(np.float64), axis=0), axis=1)
    expected = 2 * np.sin(np.pi / 2 / 64 / 2)
    # the largest chord of the input differs from its arc by (1.2e-3)^3 / 24, float32 adds 1e-7
    np.testing.assert_allclose(steps, expected, atol=3e-7)


def test_resample_is_idempotent_on_a_straight_strand():
    line = (np.linspace(0, 1, 64)[:, None] * [1.0, 2.0, -1.0]).astype(np.float32)[None]
    np.testing.assert_allclose(resample(from_dense(line), 64), line, atol=3e-7)


def test_strands_without_length_become_copies_of_the_root():
    points = np.array([[1, 2, 3], [4, 4, 4], [4, 4, 4], [4, 4, 4]], dtype=np.float32)
    strands = StrandSet(points, np.array([0, 1, 4], dtype=np.int32))
    dense = resample(strands, 5)
    np.testing.assert_array_equal(dense[0], np.tile(points[0], (5, 1)))
    np.testing.assert_array_equal(dense[1], np.tile(points[1], (5, 1)))
    np.testing.assert_array_equal(strand_lengths(strands), [0.0, 0.0])


def test_repeated_points_inside_a_strand_do_no_harm():
    points = np.array([[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, 0]], dtype=np.float32)
    dense = resample(StrandSet(points, np.array([0, 6], dtype=np.int32)), 5)
    np.testing.assert_allclose(dense[0, :, 0], [0, 0.5, 1, 1.5, 2], atol=1e-7)


def test_resample_refuses_one_point_and_takes_an_empty_set():
    with pytest.raises(InputError, match="2 or more"):
        resample(ragged(3), 1)
    assert resample(select_strands(ragged(3), []), 8).shape == (0, 8, 3)


def test_resample_set_carries_the_attributes():
    points = np.array([[0, 0, 0], [1, 0, 0], [3, 0, 0]], dtype=np.float32)
    strands = StrandSet(
        points,
        np.array([0, 3], dtype=np.int32),
        {"radius": np.array([0, 1, 3], dtype=np.float32), "kind": np.array([5, 6, 7], dtype=np.int32)},
        {"hairloom_wisp": np.array([9], dtype=np.int32)},
    )
    result = resample_set(strands, 4)
    np.testing.assert_allclose(result.point_attributes["radius"], [0, 1, 2, 3], atol=1e-7)
    assert result.point_attributes["kind"].tolist()[::3] == [5, 7] and result.point_attributes["kind"].dtype == np.int32
    np.testing.assert_array_equal(result.strand_attributes["hairloom_wisp"], [9])


def test_lengths_of_a_staircase():
    points = np.array([[0, 0, 0], [3, 4, 0], [3, 4, 12], [9, 9, 9], [9, 9, 10]], dtype=np.float32)
    strands = StrandSet(points, np.array([0, 3, 5], dtype=np.int32))
    np.testing.assert_array_equal(strand_lengths(strands), [17.0, 1.0])
    np.testing.assert_array_equal(polyline_lengths(points[None, :3]), [17.0])
    np.testing.assert_array_equal(strand_of_point(strands), [0, 0, 0, 1, 1])
    assert strand_lengths(select_strands(strands, [])).shape == (0,)


def test_select_takes_points_and_attributes_along():
    strands = ragged(4)
    order = [7, 0, 7, 39]
    chosen = select_strands(strands, order)
    for place, strand in enumerate(order):
        want = slice(strands.offsets[strand], strands.offsets[strand + 1])
        have = slice(chosen.offsets[place], chosen.offsets[place + 1])
        np.testing.assert_array_equal(chosen.points[have], strands.points[want])
        np.testing.assert_array_equal(chosen.point_attributes["kind"][have], strands.point_attributes["kind"][want])
    assert chosen.strand_attributes["hairloom_wisp"].tolist() == order
    mask = np.zeros(40, dtype=bool)
    mask[[0, 39]] = True
    np.testing.assert_array_equal(select_strands(strands, mask).points, select_strands(strands, [0, 39]).points)


@pytest.mark.parametrize("chosen", [[40], [-1], np.ones(39, dtype=bool), [0.5], [[0]]])
def test_select_refuses_what_does_not_exist(chosen):
    with pytest.raises(InputError):
        select_strands(ragged(4), chosen)


def test_join_undoes_selection_and_keeps_common_attributes():
    strands = ragged(5)
    halves = [select_strands(strands, range(15)), select_strands(strands, range(15, 40))]
    joined = join_strands(halves)
    np.testing.assert_array_equal(joined.points, strands.points)
    np.testing.assert_array_equal(joined.offsets, strands.offsets)
    assert set(joined.point_attributes) == {"radius", "kind"}
    bare = StrandSet(strands.points, strands.offsets)
    assert not join_strands([strands, bare]).point_attributes
    assert join_strands([]).n_strands == 0


def test_transform_turns_moves_and_scales():
    strands = ragged(6)
    matrix = np.array([[0, -2, 0, 1], [2, 0, 0, 2], [0, 0, 2, 3], [0, 0, 0, 1]])
    moved = transform_strands(strands, matrix)
    x, y, z = strands.points.T
    # one rounding to float32 of values up to about 100
    np.testing.assert_allclose(moved.points, np.stack([1 - 2 * y, 2 + 2 * x, 3 + 2 * z], axis=1), atol=2e-5)
    np.testing.assert_allclose(moved.point_attributes["radius"], 2 * strands.point_attributes["radius"], rtol=1e-6)
    np.testing.assert_allclose(strand_lengths(moved), 2 * strand_lengths(strands), rtol=1e-5)


@pytest.mark.parametrize("matrix", [np.eye(3), np.full((4, 4), np.nan), np.ones((4, 4)), np.eye(4) * 1e39])
def test_transform_refuses_bad_matrices(matrix):
    with pytest.raises(InputError):
        transform_strands(ragged(6), matrix)


def test_from_dense_refuses_other_shapes():
    with pytest.raises(InputError, match=r"\(S, N, 3\)"):
        from_dense(np.zeros((4, 3), dtype=np.float32))


def test_subdivision_keeps_the_points_and_follows_a_circle():
    angle = np.linspace(0, 2, 9)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1).astype(np.float32)
    strands = StrandSet(np.concatenate([circle, circle[:1]]), np.array([0, 9, 10], np.int32))
    finer = subdivide(strands, 4)
    assert finer.offsets.tolist() == [0, 33, 34]
    np.testing.assert_array_equal(finer.points[:33:4], circle)
    inner = np.linalg.norm(finer.points[4:29], axis=1)  # the end segments bend less, as nothing lies beyond them
    np.testing.assert_allclose(inner, 1.0, atol=2e-4)  # the polyline is off by 1 - cos(1/8) = 8e-3
    straight = StrandSet(
        np.linspace(0, 1, 5, dtype=np.float32)[:, None] * np.ones((1, 3), np.float32), np.array([0, 5], np.int32)
    )
    on_line = subdivide(straight, 3).points
    np.testing.assert_allclose(on_line, on_line[:, :1].repeat(3, 1), atol=1e-7)


def test_smooth_resampling_leaves_strands_of_many_points_as_they_are():
    rng = np.random.default_rng(0)
    many = from_dense(rng.normal(size=(3, 40, 3)))
    np.testing.assert_array_equal(resample_smooth(many, 20), resample(many, 20))
    few = from_dense(rng.normal(size=(3, 5, 3)))
    smooth = resample_smooth(few, 20)
    np.testing.assert_array_equal(smooth[:, [0, -1]], resample(few, 20)[:, [0, -1]])
    assert np.abs(smooth - resample(few, 20)).max() > 0.01
