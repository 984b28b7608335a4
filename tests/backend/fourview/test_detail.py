"""Depth of curls: flat waves become the helices that they are projections of."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.fields.grid import dense_grid
from hairloom.fourview._detail_kernels import average_normals, find_extrema, fit_half_turn
from hairloom.fourview.detail import HelixDetailParams, add_detail, half_turns, normals_at
from hairloom.geometry.strands import from_dense

LENGTH, COUNT = 0.2, 240


def normal_volume(normal=(0.0, -1.0, 0.0)):
    cells = np.broadcast_to(np.asarray(normal, np.float32), (10, 10, 10, 3))
    return dense_grid(np.array(cells), np.full(3, -0.5), 0.1)


def wave(radius, pitch, phase=0.0, turn=np.eye(3)):
    """A wave down -z in the plane y = 0, and the right-handed helix (seen along any axis) that it is the picture of."""
    down = np.linspace(0.0, LENGTH, COUNT)
    angle = 2 * np.pi * down / pitch + phase
    flat = np.stack([radius * np.cos(angle), np.zeros(COUNT), -down], axis=1)
    helix = flat + np.stack([np.zeros(COUNT), -radius * np.sin(angle), np.zeros(COUNT)], axis=1)
    return flat @ turn.T, helix @ turn.T


def strands_of(*lines):
    return from_dense(np.stack(lines).astype(np.float32))


def inner(points):
    """Points farther than a window from the ends, where the wave's middle line is known."""
    return points.reshape(-1, COUNT, 3)[:, 72:-72]


@pytest.mark.parametrize("radius, pitch, phase", [(0.005, 0.02, 0.0), (0.003, 0.025, 1.0), (0.008, 0.03, 4.0)])
def test_the_picture_of_a_helix_becomes_the_helix(radius, pitch, phase):
    flat, helix = wave(radius, pitch, phase)
    out = add_detail(strands_of(flat), normal_volume())
    # the middle line keeps some of a wave that is as long as half its window; the turn is right at extrema only
    assert np.abs(inner(out.points)[0] - inner(helix)[0]).max() < (0.04 if pitch < 0.03 else 0.2) * radius
    # what the photo shows stays
    np.testing.assert_array_equal(out.points[:, [0, 2]], flat.astype(np.float32)[:, [0, 2]])


def test_the_other_hand_is_the_mirror_image():
    flat, _ = wave(0.005, 0.02)
    right = add_detail(strands_of(flat), normal_volume()).points
    left = add_detail(strands_of(flat), normal_volume(), HelixDetailParams(handedness=-1)).points
    np.testing.assert_allclose(left[:, 1], -right[:, 1], atol=1e-7)


def torsion(points):
    first, second, third = (np.gradient(points, axis=0), None, None)
    second = np.gradient(first, axis=0)
    third = np.gradient(second, axis=0)
    cross = np.cross(first, second)
    return np.einsum("nc,nc->n", cross, third) / np.maximum((cross**2).sum(axis=1), 1e-30)


def test_handedness_is_constant_along_a_strand_and_right_in_every_direction():
    random = np.random.default_rng(0)
    for _ in range(4):
        turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        flat, _ = wave(0.005, 0.02, turn=turn)
        out = add_detail(strands_of(flat), normal_volume(turn @ [0.0, -1.0, 0.0]))
        assert (torsion(inner(out.points)[0].astype(np.float64))[3:-3] > 0).all()


def test_growing_waves_make_helices_without_corners():
    """A radius that grows along the strand: tangents of the result turn by no more than the helix does."""
    down = np.linspace(0.0, LENGTH, COUNT)
    radius = 0.002 + 0.03 * down
    angle = 2 * np.pi * down / 0.025
    flat = np.stack([radius * np.cos(angle), 0 * down, -down], axis=1)
    helix = flat - np.stack([0 * down, radius * np.sin(angle), 0 * down], axis=1)
    out = add_detail(strands_of(flat), normal_volume()).points

    def sharpest(points):
        steps = np.diff(points.astype(np.float64), axis=0)
        steps /= np.linalg.norm(steps, axis=1, keepdims=True)
        return np.arccos(np.clip(np.einsum("nc,nc->n", steps[1:], steps[:-1]), -1, 1)).max()

    assert np.abs(inner(out)[0] - inner(helix)[0]).max() < 0.15 * radius.max()
    assert sharpest(inner(out)[0]) < 1.3 * sharpest(inner(helix)[0])


def test_straight_and_evenly_bent_strands_stay_as_they_are():
    down = np.linspace(0.0, LENGTH, COUNT)
    straight = np.stack([0 * down, 0 * down, -down], axis=1)
    arc = 0.1 * np.stack([np.cos(down / 0.1), 0 * down, -np.sin(down / 0.1)], axis=1)
    strands = strands_of(straight, arc)
    np.testing.assert_array_equal(add_detail(strands, normal_volume()).points, strands.points)
    assert (half_turns(strands, normal_volume()) == 0).all()


def test_roots_attributes_and_off():
    flat, _ = wave(0.005, 0.02)
    strands = from_dense(flat[None].astype(np.float32), {"guide": np.array([7], np.int32)})
    out = add_detail(strands, normal_volume())
    np.testing.assert_array_equal(out.roots, strands.roots)
    assert out.strand_attributes["guide"][0] == 7
    off = add_detail(strands, normal_volume(), HelixDetailParams(strength=0.0))
    np.testing.assert_array_equal(off.points, strands.points)
    # ten waves of 2 cm: 19 to 20 half turns between extrema
    assert 17 <= half_turns(strands, normal_volume())[0] <= 20


def _naive_segments(normals, limit):
    segments, first, label = np.zeros(len(normals), int), 0, 0
    for i in range(1, len(normals)):
        mean = normals[first:i].sum(axis=0)
        if normals[i] @ mean < limit * np.linalg.norm(mean):
            first, label = i, label + 1
        segments[i] = label
    return segments


def test_segments_end_where_normals_leave_their_average_by_25_degrees():
    angle = np.radians(np.linspace(0.0, 180.0, 181))
    normals = np.stack([np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    segments, averages = np.empty(181, np.int32), np.empty((181, 3))
    limit = np.cos(np.radians(25.0))
    count = average_normals(normals, limit, segments, averages)
    np.testing.assert_array_equal(segments, _naive_segments(normals, limit))
    # turning evenly, a segment's average is half its length behind: 50 degrees a segment, and the rest of 180
    assert count == 4 and (np.bincount(segments)[:3] == 50).all()
    np.testing.assert_allclose(np.linalg.norm(averages, axis=1), 1.0, atol=1e-12)


def test_extrema_alternate_and_small_ones_are_left_out():
    x = np.linspace(0.0, 4.0, 401)
    y = np.sin(2 * np.pi * x) + 0.02 * np.sin(40 * np.pi * x)
    knots, heights = np.empty(401), np.empty(401)
    count = find_extrema(y, x, 0.25, knots, heights)
    np.testing.assert_allclose(knots[:count], np.arange(0.25, 4.0, 0.5), atol=0.03)
    assert (np.sign(heights[:count]) == np.tile([1, -1], 4)[:count]).all()
    assert find_extrema(y, x, 1.1, knots, heights) == 0


def test_the_radius_of_a_half_turn_is_the_least_squares_one():
    random = np.random.default_rng(0)
    x = np.sort(random.uniform(0.0, 1.0, 40))
    y = 0.3 + 0.7 * np.cos(np.pi * x) + 0.05 * random.normal(size=40)
    fitted = fit_half_turn(y, x, 0.0, 1.0, 1.0, -1.0, 1.0)
    expected = np.linalg.lstsq(np.stack([np.ones(40), np.cos(np.pi * x)], axis=1), y, rcond=None)[0][1]
    assert fitted == pytest.approx(expected, rel=1e-9)
    assert fit_half_turn(y[:2], x[:2], 0.0, 1.0, 1.0, -0.4, 1.0) == pytest.approx(0.7)


def test_normals_come_from_the_nearest_cell_that_has_one():
    cells = np.zeros((4, 4, 4, 3), np.float32)
    cells[0, :, :, 0] = 1.0
    volume = dense_grid(cells, np.zeros(3), 1.0)
    points = from_dense(np.array([[[0.5, 1.0, 1.0], [3.5, 2.0, 2.0], [9.0, 9.0, 9.0]]], np.float32))
    np.testing.assert_allclose(normals_at(volume, points), [[1.0, 0.0, 0.0]] * 3)


def test_same_bytes_for_any_number_of_threads():
    lines = [wave(0.004, 0.02, phase)[0] for phase in range(6)]
    params = HelixDetailParams(handedness=0, seed=3)
    first = add_detail(strands_of(*lines), normal_volume(), params).points
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        second = add_detail(strands_of(*lines), normal_volume(), params).points
    finally:
        numba.set_num_threads(before)
    assert first.tobytes() == second.tobytes()
    assert first.tobytes() != add_detail(strands_of(*lines), normal_volume(), replace(params, seed=4)).points.tobytes()


def test_bad_input():
    empty = dense_grid(np.zeros((2, 2, 2, 3), np.float32), np.zeros(3), 1.0)
    with pytest.raises(InputError, match="volume of normals is empty"):
        add_detail(strands_of(wave(0.005, 0.02)[0]), empty)
    with pytest.raises(InputError, match="angle is 0"):
        HelixDetailParams(angle=0.0)
    with pytest.raises(InputError, match="handedness is 2"):
        HelixDetailParams(handedness=2)
