"""Regions of a textured surface, and orientations averaged over them and filled in between (M-37, M-38).

Orientations are averaged as tensors o o^T: like vectors of twice the angle in a picture these do not know the sign of
o, and they need no common frame on a curved surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from ..types import Float32, Float64, Floats, Int32
from ._region_kernels import average_neighbours, choose_seeds, grow_regions, main_axes

_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True, slots=True)
class Graph:
    """N nodes and their neighbours: those of node n are neighbours[offsets[n]:offsets[n + 1]], both int32."""

    offsets: Int32
    neighbours: Int32

    @property
    def n_nodes(self) -> int:
        return len(self.offsets) - 1


@dataclass(frozen=True, slots=True)
class Regions:
    """R regions of T texels.

    region : (T,) int32 of each texel. sizes : (R,) int64, texels. points, normals : (R, 3) float64, means; unit.
    edges : (E, 2) int64, regions that touch, smaller first. borders : (E,) float64, texel edges between them.
    """

    region: Int32
    sizes: NDArray[np.int64]
    points: Float64
    normals: Float64
    edges: NDArray[np.int64]
    borders: Float64

    @property
    def count(self) -> int:
        return len(self.sizes)

    def sums(self, values: Floats) -> Float64:
        """(R, C) float64: sums over each region of values (T, C)."""
        return np.stack([np.bincount(self.region, column, self.count) for column in values.T], axis=1)


def make_graph(edges: NDArray[np.integer[Any]], count: int) -> Graph:
    """The graph of `count` nodes with undirected edges (E, 2)."""
    ones = np.ones(len(edges), np.int8)
    half = coo_array((ones, (edges[:, 0], edges[:, 1])), shape=(count, count)).tocsr()
    both = (half + half.T).tocsr()
    both.sort_indices()
    return Graph(np.asarray(both.indptr, np.int32), np.asarray(both.indices, np.int32))


def make_regions(graph: Graph, edges: Int32, points: Float32, normals: Float32, radius_texels: int) -> Regions:
    """Regions whose middles are more than `radius_texels` steps apart; every texel joins the nearest middle (steps)."""
    count = graph.n_nodes
    queue, seen = np.empty(count, np.int64), np.full(count, -1, np.int32)
    is_seed = np.zeros(count, np.bool_)
    n_regions = int(choose_seeds(graph.offsets, graph.neighbours, radius_texels, queue, seen, is_seed))
    region = np.full(count, -1, np.int32)
    region[is_seed] = np.arange(n_regions)
    grow_regions(graph.offsets, graph.neighbours, queue, region)
    sizes = np.bincount(region, minlength=n_regions)
    middles, means = (
        np.stack([np.bincount(region, column, n_regions) for column in values.T], axis=1)
        for values in (points, normals)
    )
    ends = np.sort(region[edges], axis=1).astype(np.int64)
    ends = ends[ends[:, 0] != ends[:, 1]]
    keys, borders = np.unique(ends[:, 0] * n_regions + ends[:, 1], return_counts=True)
    pairs = np.stack([keys // n_regions, keys % n_regions], axis=1)
    return Regions(
        region, sizes, middles / sizes[:, None], unit(np.asarray(means, np.float64)), pairs, borders.astype(np.float64)
    )  # fmt: skip


def outer_products(vectors: Floats) -> Float32:
    """(N, 6) float32: xx, xy, xz, yy, yz, zz of vectors (N, 3)."""
    return np.stack([vectors[:, a] * vectors[:, b] for a, b in _PAIRS], axis=1).astype(np.float32)


def axes_of(tensors: Floats, normals: Floats) -> tuple[Float32, Float32]:
    """Main axes (N, 3) float32 of tensors (N, 6) in the planes of the normals, and their coherence (N,) in [0, 1]."""
    axes, coherence = np.empty((len(tensors), 3), np.float32), np.empty(len(tensors), np.float32)
    main_axes(np.asarray(tensors, np.float64), np.asarray(normals, np.float64), axes, coherence)
    return axes, coherence


def fill_regions(regions: Regions, values: Float64, weights: Float64, stiffness: float) -> Float64:
    """(R, C) float64: min sum w |x - v|^2 + stiffness sum over neighbours b |x_i - x_j|^2, b the borders / their mean.


    values : (R, C), weights : (R,) >= 0. Regions that nothing weighted is joined to get 0.
    """
    count = regions.count
    share = stiffness * regions.borders / max(float(regions.borders.sum()) / max(len(regions.borders), 1), 1e-12)
    i, j = regions.edges[:, 0], regions.edges[:, 1]
    ties: csr_array = coo_array((share, (i, j)), shape=(count, count)).tocsr()
    ties = ties + ties.T
    # a little of its own keeps a part without any weight from having no solution
    own = weights + 1e-9 * max(float(weights.max(initial=0.0)), 1.0)
    matrix = diags_array(np.asarray(ties.sum(axis=1)).ravel() + own) - ties
    solver = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    return np.asarray(solver.solve(values * weights[:, None]))


def smooth(graph: Graph, own: Float32, weights: Float32, start: Float32, pull: float, sweeps: int) -> Float32:
    """(N, C) float32: Jacobi sweeps of min sum w |x - own|^2 + pull sum over edges |x_i - x_j|^2, from `start`."""
    values, out = start.copy(), np.empty_like(start)
    for _ in range(sweeps):
        average_neighbours(graph.offsets, graph.neighbours, own, weights, pull, values, out)
        values, out = out, values
    return values


def unit(vectors: Floats) -> Float64:
    """(N, 3) float64 of length 1; 0 stays 0."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.maximum(lengths, 1e-12), np.float64)
