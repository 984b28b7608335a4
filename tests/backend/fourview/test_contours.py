import itertools

import numpy as np
import pytest
from hairloom.fourview._contour_kernels import cyclic_costs, cyclic_path
from hairloom.fourview.contours import match_outlines, matching_cost, outline, outward_normals, resample_closed


def disc(radius, centre=(60.0, 60.0), size=120):
    y, x = np.mgrid[:size, :size] + 0.5
    return (x - centre[0]) ** 2 + (y - centre[1]) ** 2 < radius**2


def circle(count, radius=40.0, centre=(60.0, 60.0), start=0.0):
    angle = start + np.arange(count) * 2.0 * np.pi / count
    return np.stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)], axis=1)


def test_the_outline_of_a_disc():
    curve = outline(disc(40.0))
    # border pixels' middles are up to a pixel inside
    assert np.allclose(np.linalg.norm(curve - 60.0, axis=1), 39.4, atol=0.8)
    x, y = curve.T
    assert (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() > 0  # clockwise with y down


def test_the_outline_is_the_largest_parts_and_leaves_holes_out():
    region = disc(40.0) & ~disc(15.0)
    region[:5, :5] = True
    assert np.allclose(np.linalg.norm(outline(region) - 60.0, axis=1), 39.4, atol=0.8)


def test_nothing_has_no_outline():
    assert outline(np.zeros((10, 10), np.bool_)).shape == (0, 2)


def test_resampled_points_are_evenly_spaced():
    square = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    points = resample_closed(square, 8)
    assert np.allclose(points[:3], [[0.0, 0.0], [5.0, 0.0], [10.0, 0.0]])
    assert np.allclose(np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1), 5.0)


def test_normals_look_outwards():
    points = circle(60)
    assert ((points - 60.0) * outward_normals(points)).sum(axis=1).min() > 0.99 * 40.0


@pytest.mark.parametrize("start", [0.0, 0.3, -0.4])
def test_circles_match_along_their_radii(start):
    source, target = circle(80, 40.0), circle(160, 50.0, start=start)
    matched = match_outlines(source, target, 170.0)
    angles = np.arctan2(*(matched - 60.0).T[::-1]) - np.arctan2(*(source - 60.0).T[::-1])
    # within two steps of the target's points
    assert np.abs((angles + np.pi) % (2 * np.pi) - np.pi).max() < 2 * 2 * np.pi / 160


def test_the_order_is_kept_where_the_nearest_point_would_jump():
    # a bay in the source, none in the target
    angle = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    radius = 40.0 - 25.0 * np.exp(-(((angle - np.pi) / 0.25) ** 2))
    bay = resample_closed(60.0 + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), 120)
    matched = match_outlines(bay, circle(240), 170.0)
    turned = np.unwrap(np.arctan2(*(matched - 60.0).T[::-1]))
    assert np.diff(turned).min() > -1e-6
    assert turned[-1] - turned[0] == pytest.approx(2.0 * np.pi, abs=0.2)


def test_sides_of_a_moved_square_match_sides():
    square = resample_closed(np.array([[20.0, 20.0], [80.0, 20.0], [80.0, 60.0], [20.0, 60.0]]), 100)
    finer = resample_closed(np.array([[20.0, 20.0], [80.0, 20.0], [80.0, 60.0], [20.0, 60.0]]), 200)
    matched = match_outlines(square, finer + np.array([6.0, 4.0]), 170.0)
    corner = np.abs(square - [80.0, 20.0]).sum(axis=1).argmin()
    assert np.allclose(matched[corner] - square[corner], [6.0, 4.0], atol=1.5)
    # along a side a match may slide; across it the move is that of the square
    inner = (square[:, 0] > 30.0) & (square[:, 0] < 70.0)
    assert np.allclose((matched - square)[inner, 1], 4.0, atol=0.1)
    inner = (square[:, 1] > 30.0) & (square[:, 1] < 50.0)
    assert np.allclose((matched - square)[inner, 0], 6.0, atol=0.1)


def naive_cost(cost, start, standstill):
    """All ways from (0, start) around both outlines, by brute force."""
    n, m = cost.shape
    best = np.inf
    for steps in itertools.chain.from_iterable(
        set(itertools.permutations("d" * (n - k) + "i" * k + "j" * (m - n + k))) for k in range(max(0, n - m), n + 1)
    ):
        i = j = 0
        total = cost[0, start % m]
        for step in steps:
            i, j = i + (step != "j"), j + (step != "i")
            total += cost[i % n, (start + j) % m] + (0.0 if step == "d" else standstill)
        best = min(best, total)
    return best


def test_the_cost_is_the_least_of_all_ways():
    rng = np.random.default_rng(5)
    cost = rng.random((3, 4))
    starts = np.arange(4)
    totals = np.empty(4)
    cyclic_costs(cost, starts, 0.1, totals)
    assert np.allclose(totals, [naive_cost(cost, start, 0.1) for start in starts])


def test_the_path_runs_once_around():
    source, target = circle(30), circle(50, start=0.1)
    cost = matching_cost(source, target, 170.0)
    first, last = np.empty(30, np.int64), np.empty(30, np.int64)
    cyclic_path(cost, 48, 0.05, first, last)
    assert first[0] == 48 and (first <= last).all()
    assert (first[1:] - last[:-1] >= 0).all() and (first[1:] - last[:-1] <= 1).all()
    assert last[-1] in (48 + 49, 48 + 50)
