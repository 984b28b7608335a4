"""The open outer surface G of the closed hair shape (Z-6, Z-7)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..geometry.camera import project
from ..geometry.head import HeadSurface
from ..geometry.view_raster import raster_mesh, visible
from ..types import Bools, Float32, Float64, Head, Int32, Mesh
from .hull import inside_distance
from .solid import scalp_centre
from .views import View

_SMALLEST_PART = 0.01  # of the area: smaller pieces of surface are left out
_TOLERANCE = 0.004  # metres: a voxel or so, up to which a vertex behind what is drawn counts as seen


def clip_shape(mesh: Mesh, views: Sequence[View], head: Head, *, keep_seen: bool = True) -> Mesh:
    """The part of a closed hair mesh that is outer surface and, where views see it, hair (Z-6, Z-7).

    Z-6: a vertex is outer when the segment from the head's centre to it hits another part of the mesh. What lies inside
    the head is not outer. With `keep_seen` a vertex that a view sees as hair is kept too: the inner side of hair that
    hangs beside the neck is not outer, but it is what the photo from the front shows.
    Z-7: a vertex that a view sees, but outside its mask, is removed, and triangles are cut along the mask's border.

    Returns
    -------
    Mesh : open; empty only when nothing is left.
    """
    surface = HeadSurface(head)
    outer = _outer(mesh, scalp_centre(head))
    outside_head = surface.signed_distance(mesh.vertices).astype(np.float64)
    seen, margin = _seen_margins(mesh, views, head)
    if keep_seen:
        outer |= seen & (margin > 0) & (outside_head > 0)
    outer = _settled(outer, mesh.triangles)
    kept = outer[mesh.triangles].all(axis=1)
    # where no view sees a vertex only the head bounds the surface
    value = np.minimum(np.where(seen, margin, 1.0), outside_head + 0.5 * _TOLERANCE)
    vertices, triangles = cut_mesh(mesh.vertices.astype(np.float64), mesh.triangles[kept], value)
    return _large_parts(vertices, triangles)


def _outer(mesh: Mesh, centre: Float64) -> Bools:
    """(V,) bool: the segment from the centre meets the mesh before it comes to the vertex."""
    surface = HeadSurface(Head(mesh.vertices, mesh.triangles, np.zeros(len(mesh.triangles), np.bool_), _no_uv(mesh)))
    ways = mesh.vertices.astype(np.float64) - centre
    lengths = np.linalg.norm(ways, axis=1)
    distance, _ = surface.first_hits(np.tile(centre, (len(ways), 1)), ways / np.maximum(lengths, 1e-9)[:, None])
    return np.asarray(distance < lengths - _TOLERANCE)


def _seen_margins(mesh: Mesh, views: Sequence[View], head: Head) -> tuple[Bools, Float64]:
    """(V,) bool, whether a view sees each vertex, and (V,) float64 pixels, the least distance inside their masks."""
    seen = np.zeros(len(mesh.vertices), np.bool_)
    margin = np.full(len(mesh.vertices), np.inf)
    vertices = np.concatenate([mesh.vertices, head.vertices])
    triangles = np.concatenate([mesh.triangles, head.triangles + np.int32(len(mesh.vertices))])
    for view in views:
        raster = raster_mesh(view.camera, vertices, triangles)
        here = visible(mesh.vertices, raster, view.camera, _TOLERANCE)
        pixels = project(view.camera, mesh.vertices[here])[:, :2].astype(np.int64)
        inside = inside_distance(view.mask)[pixels[:, 1], pixels[:, 0]]
        # a border within a pixel or two is the picture's grain
        margin[here] = np.minimum(margin[here], inside + 1.5)
        seen |= here
    return seen, margin


def _settled(chosen: Bools, triangles: Int32, rounds: int = 2) -> Bools:
    """Each vertex goes with most of its neighbours, a few times: single vertices do not tear the surface."""
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(chosen),) * 2).tocsr()
    graph = graph + graph.T
    around = np.maximum(np.asarray(graph.sum(axis=1)).ravel(), 1.0)
    for _ in range(rounds):
        share = graph @ chosen.astype(np.float64) / around
        chosen = np.where(share > 0.65, True, np.where(share < 0.35, False, chosen))
    return chosen


def cut_mesh(vertices: Float64, triangles: Int32, value: Float64) -> tuple[Float32, Int32]:
    """The part of a mesh where `value` (V,), linear on each triangle, is above 0.

    Returns
    -------
    vertices (W, 3) float32, triangles (G, 3) int32: whole triangles, and those that the border cuts, cut. Vertices that
    nothing uses are left out.
    """
    inside = value > 0
    count = inside[triangles].sum(axis=1)
    parts = [triangles[count == 3].astype(np.int64)]
    new_vertices: list[Float64] = []
    start = len(vertices)
    for n_inside in (1, 2):
        cut = triangles[count == n_inside].astype(np.int64)
        lone = inside[cut] if n_inside == 1 else ~inside[cut]
        turn = (lone.argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(cut, turn, axis=1).T
        ab, places_ab = _cut_edges(a, b, vertices, value, start)
        start += len(places_ab)
        ac, places_ac = _cut_edges(a, c, vertices, value, start)
        start += len(places_ac)
        new_vertices += [places_ab, places_ac]
        if n_inside == 1:
            parts.append(np.stack([a, ab, ac], axis=1))
        else:
            parts += [np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)]
    places = np.concatenate([vertices, *new_vertices]).astype(np.float32)
    corners = np.concatenate(parts)
    # the same edge was cut for each of its triangles: the same two numbers give the same bits, so equal places are one
    used, corners = np.unique(corners, return_inverse=True)
    places, number = np.unique(places[used], axis=0, return_inverse=True)
    welded = number.reshape(-1)[corners.reshape(-1, 3)]
    sound = (welded != np.roll(welded, 1, axis=1)).all(axis=1)
    used, corners = np.unique(welded[sound], return_inverse=True)
    return places[used], corners.reshape(-1, 3).astype(np.int32)


def _cut_edges(first: Int32, second: Int32, vertices: Float64, value: Float64, start: int) -> tuple[Int32, Float64]:
    """New vertices' numbers and places where `value` passes 0 between two ends; the same from both sides of an edge."""
    low, high = np.minimum(first, second), np.maximum(first, second)
    share = value[low] / (value[low] - value[high])
    places = vertices[low] + (vertices[high] - vertices[low]) * np.clip(share, 0.02, 0.98)[:, None]
    return start + np.arange(len(places)), places


def _large_parts(vertices: Float32, triangles: Int32) -> Mesh:
    if len(triangles) == 0:
        return Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(vertices),) * 2)
    _, part = connected_components(graph, directed=False)
    corners = vertices[triangles].astype(np.float64)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    part_of_triangle = part[triangles[:, 0]]
    sizes = np.bincount(part_of_triangle, areas)
    kept = triangles[(sizes >= _SMALLEST_PART * sizes.sum())[part_of_triangle]]
    used, renumbered = np.unique(kept, return_inverse=True)
    return Mesh(vertices[used], renumbered.reshape(-1, 3).astype(np.int32))


def _no_uv(mesh: Mesh) -> Float32:
    return np.zeros((len(mesh.triangles), 3, 2), np.float32)
