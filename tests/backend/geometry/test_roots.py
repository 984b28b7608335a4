"""Roots: count, region, evenness, determinism (W-19, M-4)."""

import os
import subprocess
import sys

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.geometry._roots_kernels import find_neighbours, sort_into_cells
from hairloom.geometry.head import HeadSurface, default_head, sphere_head
from hairloom.geometry.roots import scatter_roots
from hairloom.types import Head
from scipy.spatial import cKDTree


@pytest.fixture(scope="module")
def head():
    return default_head()


@pytest.fixture(scope="module")
def roots(head):
    return scatter_roots(head, head.scalp, 3000, 7)


def _nearest(points):
    return cKDTree(points).query(points, k=2)[0][:, 1]


def test_count_region_and_consistency(head, roots):
    assert roots.points.shape == (3000, 3) and roots.points.dtype == np.float32
    assert roots.triangles.dtype == np.int32 and head.scalp[roots.triangles].all()
    assert (roots.barycentric >= 0).all()
    np.testing.assert_allclose(roots.barycentric.sum(axis=1), 1.0, atol=1e-6)
    surface = HeadSurface(head)
    np.testing.assert_allclose(surface.points_at(roots.triangles, roots.barycentric), roots.points, atol=1e-7)


def test_relaxation_makes_even(head, roots):
    random = scatter_roots(head, head.scalp, 3000, 7, iterations=0)
    before, after = _nearest(random.points), _nearest(roots.points)
    assert after.std() < 0.4 * before.std()
    assert after.mean() > 1.5 * before.mean()
    # blue noise: nobody is near anybody. Hexagons would have 1.07 sides; random points come as close as 0.01
    side = np.sqrt(HeadSurface(head).areas[head.scalp].sum() / 3000)
    assert after.min() > 0.6 * side
    assert roots.report.variation == pytest.approx(after.std() / after.mean(), rel=0.02)
    assert roots.report.variation_before == pytest.approx(before.std() / before.mean(), rel=0.05)
    assert roots.report.spacing == pytest.approx(after.mean(), rel=1e-3)


def test_blue_noise_spectrum():
    """Few low frequencies: counts in cells of nine roots vary six times less than random ones (variance 9)."""
    count, cells = 9 * 400, 20
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    square = Head(
        corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.ones(2, np.bool_), np.zeros((2, 3, 2), np.float32)
    )
    points = scatter_roots(square, square.scalp, count, 3).points
    counts = np.histogram2d(points[:, 0], points[:, 1], bins=cells, range=[[0, 1], [0, 1]])[0]
    assert counts[1:-1, 1:-1].var() < 1.5
    # the border is neither bare nor crowded
    rim = np.concatenate([counts[0], counts[-1], counts[1:-1, 0], counts[1:-1, -1]])
    assert 0.85 < rim.mean() / counts[1:-1, 1:-1].mean() < 1.15


@pytest.mark.parametrize("count", [50, 1000, 20000])
def test_density_is_even_whatever_the_mesh(count):
    """The halves of a cap whose triangles are long and thin at its top get the same share."""
    head = sphere_head(0.1, n_rings=32)
    roots = scatter_roots(head, head.scalp, count, 0)
    # the height of a point of the sphere is uniform (Archimedes)
    upper = (roots.points[:, 2] > 0.05).sum()
    assert abs(upper - count / 2) <= 2 + 0.05 * count
    assert (np.abs(np.linalg.norm(roots.points, axis=1) - 0.1) < 3e-4).all()


def test_points_slide_over_many_fine_triangles():
    """Few roots on a fine mesh: moves span many triangles, and still even out."""
    head = sphere_head(0.1, n_rings=128)
    few = scatter_roots(head, head.scalp, 60, 1)
    assert few.report.variation < 0.6 * few.report.variation_before


def test_roots_stay_within_a_small_region(head):
    region = np.zeros_like(head.scalp)
    region[np.flatnonzero(head.scalp)[100:103]] = True
    roots = scatter_roots(head, region, 500, 0)
    assert region[roots.triangles].all()


def test_opposite_sides_of_a_thin_sheet_do_not_push():
    """A sheet of two sides a hair's breadth apart: the sides are as even as one alone."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    below = corners - np.float32([0, 0, 1e-4])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [6, 5, 4], [7, 6, 4]], np.int32)
    sheet = Head(np.vstack([corners, below]), triangles, np.ones(4, np.bool_), np.zeros((4, 3, 2), np.float32))
    roots = scatter_roots(sheet, sheet.scalp, 1000, 0)
    upper = roots.points[roots.triangles < 2]
    assert len(upper) == pytest.approx(500, abs=5)
    assert _nearest(upper).std() / _nearest(upper).mean() < 0.15


def test_neighbours_agree_with_a_tree():
    generator = np.random.default_rng(2)
    points = generator.uniform(-1, 1, (700, 3)) * [1, 1, 0.05]
    normals = np.tile([0.0, 0.0, 1.0], (700, 1))
    normals[::5] *= -1
    reach, fixed = 0.12, 100
    count = len(points) - fixed
    starts, order = np.empty(2**11 + 1, np.int32), np.empty(700, np.int32)
    cells, places = np.empty((700, 3), np.int32), np.empty((700, 6))
    neighbours, counts = np.empty((count, 64), np.int32), np.empty(count, np.int32)
    sort_into_cells(points, normals, reach, starts, order, cells, places)
    find_neighbours(reach, starts, order, cells, places, neighbours, counts)
    for i, near in enumerate(cKDTree(points).query_ball_point(points[:count], reach)):
        expected = {j for j in near if j != i and normals[i] @ normals[j] > 0}
        assert set(neighbours[i, : counts[i]]) == expected and counts[i] == len(expected)


def test_same_seed_same_bytes_on_any_number_of_threads(head, roots):
    again = scatter_roots(head, head.scalp, 3000, 7)
    assert again.points.tobytes() == roots.points.tobytes()
    assert scatter_roots(head, head.scalp, 3000, 8).points.tobytes() != roots.points.tobytes()
    script = (
        "import sys; from hairloom.geometry.head import default_head\n"
        "from hairloom.geometry.roots import scatter_roots\n"
        "h = default_head(); sys.stdout.buffer.write(scatter_roots(h, h.scalp, 3000, 7).points.tobytes())"
    )
    environment = {**os.environ, "NUMBA_NUM_THREADS": "1"}
    one = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, check=True).stdout
    assert one == roots.points.tobytes()


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_very_few_roots(head, count):
    roots = scatter_roots(head, head.scalp, count, 0)
    assert len(roots.points) == count and head.scalp[roots.triangles].all()
    assert np.isfinite(roots.points).all() and np.isfinite(roots.report.variation)


def test_triangles_of_no_area_get_no_root():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], np.float32)
    triangles = np.array([[0, 1, 2], [1, 1, 3], [1, 3, 2], [3, 3, 3]], np.int32)
    head = Head(vertices, triangles, np.ones(4, np.bool_), np.zeros((4, 3, 2), np.float32))
    roots = scatter_roots(head, head.scalp, 400, 0)
    assert np.isfinite(roots.points).all()
    assert len(roots.points) == 400 and roots.report.variation < 0.4 * roots.report.variation_before


def test_bad_input(head):
    with pytest.raises(InputError, match="no area"):
        scatter_roots(head, np.zeros_like(head.scalp), 10, 0)
    with pytest.raises(InputError, match="booleans"):
        scatter_roots(head, head.scalp[:-1], 10, 0)
    with pytest.raises(InputError, match="booleans"):
        scatter_roots(head, head.scalp.astype(np.int32), 10, 0)
    with pytest.raises(InputError, match="number of roots"):
        scatter_roots(head, head.scalp, -1, 0)
    with pytest.raises(InputError, match="steps"):
        scatter_roots(head, head.scalp, 10, 0, iterations=-1)
    flat = Head(np.zeros_like(head.vertices), head.triangles, head.scalp, head.corner_uv)
    with pytest.raises(InputError, match="no area"):
        scatter_roots(flat, head.scalp, 10, 0)
