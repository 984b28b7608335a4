"""The neighbourhood of hair roots on the scalp: a Delaunay triangulation of their scalp coordinates (W-10)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, cKDTree

from ..types import Float32, Float64, Int32

Edges = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class RootGraph:
    """The neighbours of root s are neighbours[offsets[s]:offsets[s + 1]]; offsets (S + 1,), neighbours (E,), int32."""

    offsets: Int32
    neighbours: Int32


def connect_roots(uv: Float32) -> RootGraph:
    """offsets (S + 1,), neighbours (E,) int32."""
    edges = _delaunay(uv.astype(np.float64))
    return RootGraph(*to_rows(edges, len(uv)))


def _delaunay(points: Float64) -> Edges:
    triangulation = Delaunay(points)
    t = triangulation.simplices
    return np.concatenate([t[:, :2], t[:, 1:], t[:, ::2]]).astype(np.int64)


def to_rows(edges: Edges, n: int) -> tuple[Int32, Int32]:
    both = np.concatenate([edges, edges[:, ::-1]])
    keys = np.unique(both[:, 0] * n + both[:, 1])
    offsets = np.searchsorted(keys, np.arange(n + 1, dtype=np.int64) * n).astype(np.int32)
    return offsets, (keys % n).astype(np.int32)
