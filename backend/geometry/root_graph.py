"""The neighbourhood of hair roots: the Delaunay triangulation of their scalp coordinates (W-10), kept connected.

Qhull needs 0.8 s for 100,000 roots and more than twice the time for twice the roots, so many roots are triangulated in
tiles, on two threads; what lies across tiles is found in a second pass. The result is the triangulation of the whole.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import Delaunay, QhullError, cKDTree

from ..types import Float32, Float64, Int32
from ._root_graph_kernels import second_shortest

Indices = NDArray[np.int64]

_TILE_ROOTS = 5000  # Qhull is fastest per root at some thousands
_HALO_SPACINGS = 4.0  # overlap of tiles in mean root spacings: almost all circumcircles are smaller
_LONG_EDGE = 8.0  # an edge this many times longer than the spacing of roots around it spans a gap
_THREADS = 2


@dataclass(frozen=True, slots=True)
class RootGraph:
    """Root s has the neighbours neighbours[offsets[s]:offsets[s + 1]], rising.

    offsets : (S + 1,) int32. neighbours : (E,) int32.
    """

    offsets: Int32
    neighbours: Int32


def connect_roots(uv: Float32) -> RootGraph:
    """Neighbours of S roots with scalp coordinates `uv` (S, 2) float32, radians, as one connected graph (W-10).

    The edges are those of the Delaunay triangulation, with these decisions where the paper says nothing:

    - roots that coincide are neighbours of one of them;
    - edges across gaps (over the face, along the border of the scalp, between plugs) are left out: those 8 times longer
      than the median edge and than the second shortest edge at either end;
    - whatever is apart then (or because there is no triangulation: less than 3 roots, or roots on a line) is connected
      by the shortest of the edges left out, else along the main direction of the roots.
    """
    count = len(uv)
    # adding 0 makes -0 and 0 one; two float32 seen as one integer sort much faster than rows
    keys = (np.ascontiguousarray(uv, dtype=np.float32) + np.float32(0.0)).view(np.uint64).reshape(-1)
    _, first, group = np.unique(keys, return_index=True, return_inverse=True)
    points = uv[first].astype(np.float64)
    edges = _triangulate(points)
    lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    is_long = _spans_gap(edges, lengths, len(points))
    spare = edges[is_long][np.argsort(lengths[is_long], kind="stable")]
    edges = np.concatenate([edges[~is_long], _joining_edges(edges[~is_long], spare, points)])
    repeated = np.flatnonzero(first[group.reshape(-1)] != np.arange(count))
    twins = np.stack([repeated, first[group.reshape(-1)][repeated]], axis=-1)
    return RootGraph(*to_rows(np.concatenate([first[edges], twins]), count))


def to_rows(edges: Indices, count: int) -> tuple[Int32, Int32]:
    """A graph in compressed rows from undirected edges (E, 2) between `count` nodes; edges may be repeated."""
    ends = np.concatenate([edges, edges[:, ::-1]])
    graph = _sparse(ends, count).tocsr()
    return graph.indptr.astype(np.int32), graph.indices.astype(np.int32)


def _sparse(pairs: Indices, count: int) -> coo_matrix:
    """A matrix with an entry for each pair (E, 2); turned into rows it has each once, sorted."""
    return coo_matrix((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))


def spatial_order(uv: Float32) -> Indices:
    """The roots (S, 2) along a Morton curve, (S,) indices: near in this order is near on the scalp, and in memory."""
    low = uv.min(axis=0)
    extent = max(float((uv.max(axis=0) - low).max()), 1e-30)
    cells = ((uv - low) * (65535.0 / extent)).astype(np.uint32)
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        cells = (cells | (cells << shift)) & np.uint32(mask)
    return np.argsort(cells[:, 0] | (cells[:, 1] << 1), kind="stable")


def _triangulate(points: Float64) -> Indices:
    """Delaunay edges (E, 2), each once, of distinct points (n, 2); none where there is no triangulation."""
    if len(points) <= 2 * _TILE_ROOTS:
        triangles, dropped = _delaunay(points)
        return _edges_of(triangles, dropped, len(points))
    u, v = np.ascontiguousarray(points.T)
    with ThreadPoolExecutor(_THREADS) as pool:
        jobs = []
        for own, box in _tiles(u, v):
            inside = np.flatnonzero((u > box[0, 0]) & (u < box[1, 0]) & (v > box[0, 1]) & (v < box[1, 1]))
            jobs.append(pool.submit(_triangulate_tile, points, own, inside, box))
        parts = [job.result() for job in jobs]
    open_points = np.concatenate([part[2] for part in parts])
    across = _triangles_across(points, open_points)
    triangles = np.concatenate([part[0] for part in parts] + [across])
    return _edges_of(triangles, np.concatenate([part[1] for part in parts]), len(points))


def _delaunay(points: Float64) -> tuple[Indices, Indices]:
    """Triangles (T, 3), and (m, 2) pairs of a point that Qhull left out (a near duplicate) and the vertex near it."""
    try:
        triangulation = Delaunay(points)
    except (QhullError, ValueError):  # too few points, or all on a line
        return np.empty((0, 3), np.int64), np.empty((0, 2), np.int64)
    return triangulation.simplices.astype(np.int64), triangulation.coplanar[:, ::2].astype(np.int64)


def _edges_of(triangles: Indices, dropped: Indices, count: int) -> Indices:
    pairs = np.concatenate([triangles[:, :2], triangles[:, 1:], triangles[:, ::2], dropped])
    ordered = np.stack([pairs.min(axis=1), pairs.max(axis=1)], axis=-1)
    once = _sparse(ordered, count).tocsr().tocoo()
    edges: Indices = np.stack([once.row, once.col], axis=-1).astype(np.int64)
    return edges


def _tiles(u: Float64, v: Float64) -> list[tuple[Indices, Float64]]:
    """Tiles of equally many points: (indices of its own points, box [[low u, low v], [high u, high v]] with halo)."""
    side = int(np.ceil(np.sqrt(len(u) / _TILE_ROOTS)))
    low = np.array([u.min(), v.min()])
    high = np.array([u.max(), v.max()])
    tiles = []
    for strip in np.array_split(np.argsort(u, kind="stable"), side):
        for own in np.array_split(strip[np.argsort(v[strip], kind="stable")], side):
            own_low = np.array([u[own].min(), v[own].min()])
            own_high = np.array([u[own].max(), v[own].max()])
            halo = _HALO_SPACINGS * np.sqrt(np.prod(own_high - own_low) / len(own))
            box = np.stack([own_low - halo, own_high + halo])
            box[0, own_low <= low] = -np.inf
            box[1, own_high >= high] = np.inf
            tiles.append((own, box))
    return tiles


def _triangulate_tile(points: Float64, own: Indices, inside: Indices, box: Float64) -> tuple[Indices, Indices, Indices]:
    """Sure triangles, dropped pairs (see `_delaunay`), and the own points that have other triangles too.

    `inside` are all points in the box. A triangle whose circumcircle lies in the box is in the triangulation of all.
    """
    is_own = np.zeros(len(points), np.bool_)
    is_own[own] = True
    triangulation = Delaunay(points[inside])
    triangles = inside[triangulation.simplices]
    centers, radii = _circumcircles(points, triangles)
    sure = ((centers - radii[:, None] > box[0]) & (centers + radii[:, None] < box[1])).all(axis=1)
    dropped = inside[triangulation.coplanar[:, ::2]]
    loose = np.unique(np.concatenate([triangles[~sure].reshape(-1), inside[triangulation.convex_hull].reshape(-1)]))
    owned = is_own[triangles[:, 0]] | is_own[triangles[:, 1]] | is_own[triangles[:, 2]]
    return triangles[sure & owned], dropped, loose[is_own[loose]]


def _triangles_across(points: Float64, open_points: Indices) -> Indices:
    """The triangles with a circumcircle too large for any tile: all their corners are open points."""
    triangles = open_points[_delaunay(points[open_points])[0]]
    centers, radii = _circumcircles(points, triangles)
    known = np.isfinite(radii)
    gaps = np.zeros(len(triangles))
    gaps[known] = cKDTree(points, balanced_tree=False, compact_nodes=False).query(centers[known])[0]
    return triangles[gaps >= radii * (1.0 - 1e-9)]


def _circumcircles(points: Float64, triangles: Indices) -> tuple[Float64, Float64]:
    """Centers (T, 2) and radii (T,); not finite for triangles without area."""
    a = points[triangles[:, 0]]
    b = points[triangles[:, 1]] - a
    c = points[triangles[:, 2]] - a
    bb = (b * b).sum(axis=1)
    cc = (c * c).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 0.5 / (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
        offset = np.stack([c[:, 1] * bb - b[:, 1] * cc, b[:, 0] * cc - c[:, 0] * bb], axis=-1) * scale[:, None]
    return a + offset, np.sqrt((offset * offset).sum(axis=1))


def _spans_gap(edges: Indices, lengths: Float64, count: int) -> NDArray[np.bool_]:
    """Which edges are much longer than the spacing of the roots at both ends."""
    if not len(edges):
        return np.zeros(0, np.bool_)
    # the second shortest edge tells the spacing even where two roots almost coincide; every corner has two edges
    spacing = np.maximum(second_shortest(edges, lengths, count), np.median(lengths))
    return np.asarray(lengths > _LONG_EDGE * np.maximum(spacing[edges[:, 0]], spacing[edges[:, 1]]))


def _joining_edges(edges: Indices, spare: Indices, points: Float64) -> Indices:
    """The edges that connect the parts of the graph: of `spare`, the first preferred, else from point to next point."""
    count = len(points)
    n_parts, part = connected_components(_sparse(edges, count), directed=False)
    if n_parts == 1:
        return np.empty((0, 2), np.int64)
    centered = points - points.mean(axis=0)
    along = np.argsort(centered @ np.linalg.eigh(centered.T @ centered)[1][:, 1], kind="stable")
    candidates = np.concatenate([spare, np.stack([along[:-1], along[1:]], axis=-1)])
    parts = np.sort(part[candidates], axis=1).astype(np.int64)
    candidates, parts = candidates[parts[:, 0] < parts[:, 1]], parts[parts[:, 0] < parts[:, 1]]
    # unique keeps the first candidate between two parts; the spanning tree of least rank then drops what closes a ring
    keys, rank = np.unique(parts[:, 0] * n_parts + parts[:, 1], return_index=True)
    between = coo_matrix((rank + 1.0, (keys // n_parts, keys % n_parts)), shape=(n_parts, n_parts))
    kept = minimum_spanning_tree(between.tocsr()).data.astype(np.int64) - 1
    joining: Indices = candidates[np.sort(kept)]
    return joining
