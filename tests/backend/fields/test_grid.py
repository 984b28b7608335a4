"""Direction grids: eq. 9 against a slow version, determinism, margins, memory (W-25, W-27, W-A5, W-A6, M-8)."""

from itertools import pairwise

import numba
import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.fields import grid as grids
from hairloom.fields._lookup_kernels import map_to_cells
from hairloom.fields.grid import build_direction_grid, dense_grid, elevation_table, tangent_spread
from hairloom.geometry.analytic_heads import sphere_head
from hairloom.geometry.scalp_space import ScalpSpace, fit_scalp_space


@pytest.fixture(scope="module")
def space() -> ScalpSpace:
    return fit_scalp_space(sphere_head())


def bumpy_hair(n_strands: int = 120, n_points: int = 20, seed: int = 0) -> np.ndarray:
    """(S, N, 3) strands that grow outwards from the upper hemisphere and bend, with smooth noise of their own."""
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(n_strands, 3))
    roots[:, 1] = np.abs(roots[:, 1]) + 0.2
    roots /= np.linalg.norm(roots, axis=1, keepdims=True)
    t = np.linspace(0, 1, n_points)[:, None]
    bend = rng.normal(size=(n_strands, 1, 3)) * 0.15 + [0.3, -0.3, 0.1]
    return (roots[:, None] * (1 + 0.4 * t) + bend * t**2).astype(np.float32)


def naive_field(points, coordinates, spacing, iterations):
    """{cell: direction} of eq. 9: every segment is cut at every plane of the grid, cell after cell."""
    pieces: dict[tuple, list] = {}
    for strand, places in zip(points.astype(float), coordinates.astype(float)):
        for i in range(len(strand) - 1):
            tangent = strand[i + 1] - strand[i]
            length = np.linalg.norm(tangent)
            start, end = places[i] / spacing, places[i + 1] / spacing
            cuts = [0.0, 1.0]
            for axis in range(3):
                low, high = sorted((start[axis], end[axis]))
                planes = np.arange(np.ceil(low), np.floor(high) + 1)
                cuts += [t for t in (planes - start[axis]) / (end[axis] - start[axis]) if 0 < t < 1]
            cuts = np.sort(cuts)
            for a, b in pairwise(cuts):
                cell = tuple(np.floor(start + 0.5 * (a + b) * (end - start)).astype(int))
                pieces.setdefault(cell, []).append((tangent / length, (b - a) * length))
    field = {}
    for cell, parts in pieces.items():
        tangents, lengths = np.array([p[0] for p in parts]), np.array([p[1] for p in parts])
        mean = np.zeros(3)
        for _ in range(iterations):
            weights = 0.5 * (tangents @ mean + 1) * lengths
            mean = (weights[:, None] * tangents).sum(axis=0)
            mean /= np.linalg.norm(mean)
        field[cell] = (mean, lengths.sum())
    return field


@pytest.mark.parametrize("in_scalp_space", [True, False])
@pytest.mark.parametrize("iterations", [1, 2, 3])
def test_equation_9_against_naive(space, in_scalp_space, iterations):
    points, spacing = bumpy_hair(), 0.05
    cells_of = space if in_scalp_space else None
    grid = build_direction_grid(points, cells_of, spacing, iterations=iterations)
    coordinates = space.to_scalp(points) if in_scalp_space else points
    expected = naive_field(points, coordinates, spacing, iterations)
    dense, offset = grid.dense(), np.rint(grid.origin / spacing).astype(int)
    # scalp coordinates of kernel and ScalpSpace differ by float32 rounding: slivers of cells may come and go
    solid = {cell: mean for cell, (mean, length) in expected.items() if length > 1e-5}
    found = np.array([dense[tuple(np.array(cell) - offset)] for cell in solid])
    # float32 storage, and slivers that change sides weigh 1e-5 of a cell's edge at most
    np.testing.assert_allclose(found, np.array(list(solid.values())), atol=2e-3 if in_scalp_space else 2e-5)
    assert np.median(np.abs(found - np.array(list(solid.values())))) < 1e-6
    assert len(solid) <= grid.n_cells <= len(solid) + 0.01 * len(expected)


def test_outliers_are_weighted_down():
    """Nine strands along x and one along y in one cell: the plain mean leans by atan(1/9), eq. 9 leans less."""
    points = np.zeros((10, 2, 3), np.float32)
    points[:, 0] = 0.01
    points[:9, 1] = [0.09, 0.01, 0.01]
    points[9, 1] = [0.01, 0.09, 0.01]
    lean = []
    for iterations in (1, 2):
        direction = build_direction_grid(points, None, 0.1, iterations=iterations).dense()[0, 0, 0]
        lean.append(np.arctan2(direction[1], direction[0]))
    x, y = np.cos(lean[0]), np.sin(lean[0])
    assert lean[0] == pytest.approx(np.arctan(1 / 9), abs=1e-6)
    assert lean[1] == pytest.approx(np.arctan((y + 1) / (9 * (x + 1))), abs=1e-6)
    assert lean[1] < 0.6 * lean[0]


def test_vectors_are_of_head_space(space):
    """Straight strands up the y axis of the head keep their direction in cells of scalp space (W-A6)."""
    points = np.zeros((1, 30, 3), np.float32)
    points[0, :, 0] = 0.3
    points[0, :, 1] = np.linspace(1.0, 1.5, 30)
    grid = build_direction_grid(points, space, 0.02)
    directions = grid.dense().reshape(-1, 3)
    np.testing.assert_allclose(directions[directions.any(axis=1)], [[0, 1, 0]] * grid.n_cells, atol=1e-6)
    assert grid.n_cells >= 0.5 / 0.02


def test_cells_without_hair_and_opposite_tangents_are_0():
    there = np.array([[[0.01, 0.05, 0.05], [0.09, 0.05, 0.05]]], np.float32)
    both = np.concatenate([there, there[:, ::-1]])
    assert build_direction_grid(there, None, 0.1).n_cells == 1
    assert build_direction_grid(both, None, 0.1).n_cells == 0


def test_zero_length_segments_are_harmless():
    points = bumpy_hair(5)
    once, twice = (build_direction_grid(hair, None, 0.05) for hair in (points, np.repeat(points, 2, axis=1)))
    np.testing.assert_allclose(once.directions, twice.directions, atol=1e-6)


def test_margins_repeat_the_next_block():
    grid = build_direction_grid(bumpy_hair(), None, 0.02)
    dense = np.pad(grid.dense(), [(0, 1)] * 3 + [(0, 0)])
    for place in np.argwhere(grid.blocks >= 0):
        i, j, k = place * 8
        stored = grid.directions[grid.blocks[tuple(place)]]
        np.testing.assert_array_equal(stored, dense[i : i + 9, j : j + 9, k : k + 9])


def test_same_bytes_for_any_number_of_threads(space):
    points = bumpy_hair(2000)
    results = []
    before = numba.get_num_threads()
    try:
        for n_threads in {1, before}:
            numba.set_num_threads(n_threads)
            grid = build_direction_grid(points, space, 0.01)
            results.append((grid.directions.tobytes(), grid.blocks.tobytes(), tangent_spread(points, 0.02)))
    finally:
        numba.set_num_threads(before)
    assert all(result == results[0] for result in results)


def test_translation_by_whole_blocks_moves_the_grid():
    points = bumpy_hair()
    moved = points + np.float32(0.5)  # 2 blocks of 8 cells of 1 / 32
    a, b = build_direction_grid(points, None, 1 / 32), build_direction_grid(moved, None, 1 / 32)
    np.testing.assert_allclose(b.origin - a.origin, 0.5)
    # float32 rounding of the moved points
    np.testing.assert_allclose(a.dense(), b.dense(), atol=1e-4)


def test_grid_gets_coarser_instead_of_too_large():
    points = bumpy_hair(400)
    grid = build_direction_grid(points, None, 0.01, max_blocks=100)
    assert grid.spacing > 0.01 and np.log2(grid.spacing / 0.01) % 1 == 0
    assert len(grid.directions) <= 100
    far = np.concatenate([points, points[:1] + np.float32(1e4)])
    assert build_direction_grid(far, None, 1e-4).blocks.size <= grids.MAX_TABLE


def test_segments_past_the_south_pole_are_left_out(space):
    points = np.array([[[0.2, -1.5, 0.1], [0.01, -1.5, 0.01], [-0.2, -1.5, -0.1]]], np.float32)
    grid = build_direction_grid(points, space, 0.02)
    assert grid.n_cells < 60


def test_scalp_coordinates_by_table(space):
    """The kernels' table gives the coordinates of ScalpSpace to 1e-6 away from the south pole."""
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(400, 8, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    directions = directions[:, directions[..., 1].min(axis=0) > -2]
    points = (directions * rng.uniform(0.8, 3.0, (400, 8, 1))).astype(np.float32)
    for polar_scale in (space.polar_scale, 0.7):
        tilted = ScalpSpace(space.centre, space.radius, space.rotation, polar_scale, space.height, space.normal)
        found = np.empty_like(points)
        map_to_cells(points, elevation_table(tilted), tilted.height, found)
        off = np.abs(found - tilted.to_scalp(points)).max(axis=2)
        assert off[directions[..., 1] > -0.9].max() < 2e-6
        assert off[directions[..., 1] > -0.999].max() < 1e-3


def test_dense_grid():
    values = np.random.default_rng(0).normal(size=(3, 4, 5, 3)).astype(np.float32)
    grid = dense_grid(values, (0, 0, 0), 0.5)
    np.testing.assert_array_equal(grid.dense(), values)
    assert grid.n_cells == 60


def test_spread_of_known_hair():
    """Half of the hair turned by an angle: the root mean square angle to the mean is half of it, for small angles."""
    angle = 0.1
    along = np.zeros((40, 2, 3), np.float32)
    along[:, :, 1:] = np.random.default_rng(0).uniform(0.1, 0.9, (40, 1, 2))
    along[:, 1, 0] = 0.09
    along[:, :, 0] += 0.005
    turned = along.copy()
    turned[:, 1, 0] = 0.005 + 0.09 * np.cos(angle)
    turned[:, 1, 1] += 0.09 * np.sin(angle)
    assert tangent_spread(along, 1.0) == pytest.approx(0, abs=1e-3)
    assert tangent_spread(np.concatenate([along, turned]), 1.0) == pytest.approx(angle / 2, rel=1e-2)
    assert tangent_spread(np.concatenate([along, along[:, ::-1]]), 1.0) == pytest.approx(np.sqrt(2), abs=1e-6)


@pytest.mark.parametrize("spacing", [0.0, -1.0, np.nan, np.inf])
def test_bad_spacing(spacing):
    with pytest.raises(InputError, match="spacing"):
        build_direction_grid(bumpy_hair(2), None, spacing)
    with pytest.raises(InputError, match="spacing"):
        tangent_spread(bumpy_hair(2), spacing)


@pytest.mark.parametrize("shape", [(0, 5, 3), (4, 1, 3), (4, 5, 2), (12, 3)])
def test_bad_points(shape):
    with pytest.raises(InputError, match="points"):
        build_direction_grid(np.zeros(shape, np.float32), None, 0.1)


def test_bad_arguments():
    with pytest.raises(InputError, match="iterations"):
        build_direction_grid(bumpy_hair(2), None, 0.1, iterations=0)
    with pytest.raises(InputError, match="max_blocks"):
        build_direction_grid(bumpy_hair(2), None, 0.1, max_blocks=0)
    with pytest.raises(InputError, match="shape"):
        dense_grid(np.zeros((3, 4, 3), np.float32), (0, 0, 0), 1.0)
