"""The neighbourhood of roots: the Delaunay triangulation, without edges over gaps, connected."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hairloom.geometry import root_graph
from hairloom.geometry.root_graph import RootGraph, connect_roots, spatial_order
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay


def edges_of(graph: RootGraph) -> set[tuple[int, int]]:
    rows = np.repeat(np.arange(len(graph.offsets) - 1), np.diff(graph.offsets))
    return set(zip(rows.tolist(), graph.neighbours.tolist()))


def n_parts(graph: RootGraph) -> int:
    count = len(graph.offsets) - 1
    matrix = csr_matrix((np.ones(len(graph.neighbours)), graph.neighbours, graph.offsets), shape=(count, count))
    return connected_components(matrix)[0]


def delaunay_edges(points: np.ndarray) -> set[tuple[int, int]]:
    triangles = Delaunay(points.astype(np.float64)).simplices
    pairs = np.concatenate([triangles[:, [i, j]] for i in range(3) for j in range(3) if i != j])
    return set(map(tuple, pairs.tolist()))


def uneven_points(count: int) -> np.ndarray:
    """Twenty times denser in one corner than in the other."""
    return (np.random.default_rng(3).random((count, 2)) ** 2.0).astype(np.float32)


def test_delaunay_edges_but_for_the_long_ones() -> None:
    points = np.random.default_rng(0).random((500, 2)).astype(np.float32)
    found, truth = edges_of(connect_roots(points)), delaunay_edges(points)
    assert found <= truth
    lengths = {edge: np.linalg.norm(points[edge[0]] - points[edge[1]]) for edge in truth}
    # only edges along the hull are much longer than those around them
    assert len(truth - found) < 0.02 * len(truth)
    assert all(lengths[edge] > 8 * np.median(list(lengths.values())) for edge in truth - found)


@pytest.mark.parametrize("count", [4000, 4001])
def test_tiles_give_the_triangulation_of_the_whole(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.unique(uneven_points(count), axis=0).astype(np.float64)
    whole = root_graph._triangulate(points)
    monkeypatch.setattr(root_graph, "_TILE_ROOTS", 200)
    np.testing.assert_array_equal(root_graph._triangulate(points), whole)


def test_small_halos_give_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a halo of half a spacing the second pass has a lot to do."""
    points = np.unique(uneven_points(3000), axis=0).astype(np.float64)
    whole = root_graph._triangulate(points)
    monkeypatch.setattr(root_graph, "_TILE_ROOTS", 300)
    monkeypatch.setattr(root_graph, "_HALO_SPACINGS", 0.5)
    np.testing.assert_array_equal(root_graph._triangulate(points), whole)


@pytest.mark.parametrize(
    "uv",
    [
        [[1.0, 1.0]],
        [[1.0, 1.0], [1.5, 1.0]],
        [[1.0, 1.0]] * 6,
        [[1.0 + 0.1 * i, 1.0] for i in range(9)],
        [[0.1 * i, 0.2 * i] for i in range(9)] * 2,
        [[0.0, -0.0], [-0.0, 0.0], [1.0, 0.0]],
        [[1.0, 1.0], [1.0 + 1e-7, 1.0], [1.0, 1.0 + 1e-7], [2.0, 1.0], [2.0, 2.0]],
    ],
    ids=["one", "two", "all in one place", "line", "slanted line twice", "zeros", "almost one place"],
)
def test_degenerate_roots_are_connected(uv: list[list[float]]) -> None:
    graph = connect_roots(np.array(uv, np.float32))
    edges = edges_of(graph)
    assert n_parts(graph) == 1
    assert all((b, a) in edges and a != b for a, b in edges)


def test_roots_that_coincide_are_neighbours() -> None:
    points = np.random.default_rng(1).random((50, 2)).astype(np.float32)
    graph = connect_roots(np.concatenate([points, points[:5]]))
    edges = edges_of(graph)
    assert all((i, 50 + i) in edges for i in range(5))
    assert n_parts(graph) == 1


def test_line_is_connected_in_order() -> None:
    order = np.random.default_rng(2).permutation(20)
    uv = np.stack([order * 0.0625, order * 0.03125], axis=-1).astype(np.float32)
    place = np.argsort(order)
    assert edges_of(connect_roots(uv)) == {(int(a), int(b)) for i, j in pairwise(place) for a, b in ((i, j), (j, i))}


def test_no_edges_over_a_gap_but_one() -> None:
    """Two patches of roots, one spacing 0.01 and 0.5 apart: the shortest edge between them is the only one."""
    rng = np.random.default_rng(4)
    left = rng.random((300, 2)) * 0.2
    right = rng.random((300, 2)) * 0.2 + [0.7, 0.0]
    points = np.concatenate([left, right]).astype(np.float32)
    edges = edges_of(connect_roots(points))
    across = [(a, b) for a, b in edges if a < 300 <= b]
    distances = np.linalg.norm(points[:300, None] - points[None, 300:], axis=2)
    assert across == [(int(np.argmin(distances) // 300), int(300 + np.argmin(distances) % 300))]


def test_no_edges_over_the_face() -> None:
    """Roots on a horseshoe, as around a face: nothing connects its ends."""
    rng = np.random.default_rng(5)
    angle = rng.uniform(0.0, 1.5 * np.pi, 2000)
    radius = rng.uniform(0.6, 1.0, 2000)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1).astype(np.float32)
    graph = connect_roots(points)
    turn = max(abs(angle[a] - angle[b]) for a, b in edges_of(graph))
    assert n_parts(graph) == 1
    assert turn < 0.5


def test_spatial_order_keeps_near_roots_near() -> None:
    points = np.random.default_rng(6).random((4096, 2)).astype(np.float32)
    order = spatial_order(points)
    assert sorted(order.tolist()) == list(range(4096))
    steps = np.linalg.norm(np.diff(points[order], axis=0), axis=1)
    # the mean spacing is 1 / 64; a random order has steps of 0.52
    assert steps.mean() < 3 / 64


def test_spatial_order_of_one_place() -> None:
    np.testing.assert_array_equal(spatial_order(np.ones((3, 2), np.float32)), [0, 1, 2])
