"""Regions of triangles on a head: the scalp that hair roots stand on, and what is adjacent to what."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..errors import require
from ..types import Bools, Float64, Floats, Head, Int32

Indices = NDArray[np.int64]

# In spacings of the roots: gaps (partings) up to twice the first are closed; the region ends the second beyond them.
_CLOSE = 3.0
_RIM = 1.2
# Enclosed gaps up to this share of the region are part of it; pieces below the second share of the roots are strays.
_HOLE_SHARE = 0.1
_PIECE_SHARE = 0.01


def require_scalp(head: Head) -> None:
    """Raise `InputError` unless the head's scalp has an area."""
    require(head.scalp.any(), "the head has no scalp; mark one, or let it be found from the hair")
    require(triangle_areas(head)[head.scalp].sum() > 0, "the scalp region has no area; choose faces with an area")


def triangle_areas(head: Head) -> Float64:
    """(F,) float64, square metres."""
    corners = head.vertices[head.triangles].astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(0.5 * np.linalg.norm(cross, axis=1))


def weld(head: Head) -> Indices:
    """(F, 3) int64: the triangles with vertices at the very same place made one, so that seams do not part the mesh."""
    _, place = np.unique(head.vertices, axis=0, return_inverse=True)
    return np.ascontiguousarray(place.reshape(-1)[head.triangles], np.int64)


def adjacent_triangles(welded: Indices) -> Indices:
    """(n, 2) int64 pairs of triangles that share an edge; where more than two do, consecutive ones."""
    count = len(welded)
    edges = np.sort(np.concatenate([welded[:, [0, 1]], welded[:, [1, 2]], welded[:, [2, 0]]]), axis=1)
    key = edges[:, 0] * (welded.max() + 1) + edges[:, 1]
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order[1:]] == key[order[:-1]])
    return np.stack([order[same] % count, order[same + 1] % count], axis=1)


def components(chosen: Bools, adjacency: Indices) -> Int32:
    """(F,) int32: the edge-connected piece of each chosen triangle, numbered from 0; -1 for the others."""
    inside = adjacency[chosen[adjacency].all(axis=1)]
    graph = coo_array((np.ones(len(inside), np.int8), (inside[:, 0], inside[:, 1])), shape=(len(chosen),) * 2)
    _, labels = connected_components(graph, directed=False)
    pieces = np.full(len(chosen), -1, np.int32)
    if chosen.any():
        pieces[chosen] = np.unique(labels[chosen], return_inverse=True)[1]
    return pieces


def region_of_roots(head: Head, face_normals: Floats, roots: Float64, triangle: Int32, distance: Float64) -> Bools:
    """The scalp that hair roots stand on, (F,) bool.

    1. Roots that hang in the air (over 5 % of the hair's extent and 4 times the median distance away) do not count.
    2. Triangles with a root, or whose middle lies within 3 spacings of one on the same side of the surface; the spacing
       is the median distance to the sixth nearest root. This closes partings and suits coarse and fine meshes alike.
    3. From that, the rim farther than 1.2 spacings from the roots is taken away again, triangles with a root excepted.
    4. Small enclosed holes are filled; pieces with less than 1 % of the roots are dropped.

    Parameters
    ----------
    face_normals : (F, 3). roots : (n, 3), the closest points of the surface, metres. triangle : (n,), where they lie.
    distance : (n,), metres, of the hair's roots from them.
    """
    require(len(roots) > 0, "there is no hair to find the scalp from")
    extent = float(np.linalg.norm(np.ptp(roots, axis=0)))
    median = float(np.median(distance))
    require(
        median <= max(0.5 * extent, 0.01 * float(np.linalg.norm(np.ptp(head.vertices, axis=0)))),
        f"the hair stands {median:.3g} m away from the head; move it there, or correct the units of one of the files",
    )
    on_head = distance <= max(4.0 * median, 0.05 * extent)
    roots, triangle = roots[on_head], triangle[on_head]
    hit = np.zeros(len(head.triangles), bool)
    hit[triangle] = True
    tree = cKDTree(roots)
    sixth, _ = tree.query(roots, k=min(7, len(roots)))
    spacing = float(np.median(np.atleast_2d(sixth.T).T[:, -1]))
    middles = head.vertices[head.triangles].mean(axis=1, dtype=np.float64)
    reach, nearest = tree.query(middles, distance_upper_bound=_CLOSE * spacing)
    near = np.isfinite(reach)
    near[near] = np.einsum("fc,fc->f", face_normals[near], face_normals[triangle[nearest[near]]]) > 0
    adjacency = adjacent_triangles(weld(head))
    region = _reachable(hit | near, hit, adjacency)
    if not region.all():
        width = (_CLOSE - _RIM) * spacing
        to_outside, _ = cKDTree(middles[~region]).query(middles[region], distance_upper_bound=width)
        region[region] = hit[region] | np.isinf(to_outside)
    region = _fill_holes(region, adjacency, triangle_areas(head))
    return _drop_strays(region, adjacency, triangle)


def _reachable(allowed: Bools, start: Bools, adjacency: Indices) -> Bools:
    """The pieces of `allowed` that hold a triangle of `start`."""
    pieces = components(allowed, adjacency)
    return np.asarray(allowed & np.isin(pieces, np.unique(pieces[start & allowed])))


def _fill_holes(region: Bools, adjacency: Indices, areas: Float64) -> Bools:
    """Add the pieces of the rest that touch the region, unless they are larger than a share of it."""
    rest = components(~region, adjacency)
    if rest.max() < 0:
        return region
    piece_areas = np.bincount(rest[~region], areas[~region])
    bordering = adjacency[region[adjacency[:, 0]] != region[adjacency[:, 1]]]
    touching = np.unique(rest[bordering][~region[bordering]])
    small = touching[piece_areas[touching] <= _HOLE_SHARE * areas[region].sum()]
    # the largest piece is the rest of the head, however large the scalp is
    small = small[small != np.argmax(piece_areas)]
    return np.asarray(region | np.isin(rest, small))


def _drop_strays(region: Bools, adjacency: Indices, triangle: Int32) -> Bools:
    pieces = components(region, adjacency)
    root_counts = np.bincount(pieces[triangle][pieces[triangle] >= 0], minlength=pieces.max() + 1)
    kept = np.flatnonzero(root_counts >= max(_PIECE_SHARE * len(triangle), 1.0))
    if len(kept) == 0:
        kept = np.array([np.argmax(root_counts)])
    return np.asarray(region & np.isin(pieces, kept))
