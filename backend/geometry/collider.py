"""What hair must stay out of: the signed distance of the head and other solid meshes, on a grid (W-U5).

Exact (libigl) at the nodes of the cells around the surface, and lowered where a cell's middle shows that a thin wall
(an ear) or an edge in it would be missed between them: hair had better stay off a little than go in. Farther away,
where only far and the way out matter, it is interpolated from every fourth node. Inside is where the mesh winds around
a node more than half a time: as in HeadSurface, but the lids that close open boundaries are part of the surface here,
so that the distance is continuous and hair cannot come in from below a bust.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import igl
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..errors import require
from ..types import Bools, Float32, Float64, Floats, Head
from ._collider_kernels import FAR_OUTSIDE, mark_crossed_cells, sample_distances, sample_gradients
from .head import boundary_fans
from .scalp_region import weld

__all__ = ["FAR_OUTSIDE", "Collider", "build_collider"]

Indices = NDArray[np.int64]
_Distances = Callable[[Float64], Float64]

# Cells along the scalp, or along the whole box where no mesh has one: a scalp's distance is then 0.05 mm right.
_CELLS_ALONG_SCALP = 80
_REACH = 1.5  # of the scalp's size: how far from the roots hair is kept out of the meshes
_CELLS_ALONG_BOX = 160
_MARGIN = 4  # cells between the surface and the end of the grid; more than one, so that the outside is in the grid
_SMOOTH = 0.04  # cells that a middle may be too far outside: smooth surfaces stay second-order exact
_STRIDE = 4  # the nodes far from the surface are interpolated between every 4th
# The default cell grows until the grid has so many nodes (0.5 s); a cell that is asked for may have more (80 MB).
_USUAL_NODES = 3_000_000
_MOST_NODES = 20_000_000
# Real heads have edges of three faces (eyelashes, the inside of the mouth); up to 4 % of their area has the wrong side
# inside. A mesh beyond the first number is refused; one whose volume is below the second times area^1.5 has no inside.
_WRONG_SHARE = 0.1
_FLAT = 1e-6
_SHARE_SAMPLES = 2000


@dataclass(frozen=True, slots=True)
class Collider:
    """Signed distance to solid meshes at the nodes of a grid; plain arrays, for kernels.

    distance : (X, Y, Z) float32, metres, at the nodes, negative inside; trilinear between them.
    origin : (3,) float64, metres, world space: node (0, 0, 0).
    cell : metres between neighbouring nodes.
    """

    distance: Float32
    origin: Float64
    cell: float

    def distance_at(self, points: Floats) -> Float32:
        """(n,) float32, metres, at points (n, 3), metres, world space; FAR_OUTSIDE (1e9) outside the grid's box."""
        queries = _points(points)
        values = np.empty(len(queries))
        sample_distances(self.distance, self.origin, self.cell, queries, values)
        return values.astype(np.float32)

    def gradient_at(self, points: Floats) -> Float32:
        """(n, 3) float32: the trilinear distance's gradient, outwards, about 1 long; 0 outside the grid's box."""
        queries = _points(points)
        gradients = np.empty((len(queries), 3))
        sample_gradients(self.distance, self.origin, self.cell, queries, gradients)
        return gradients.astype(np.float32)


def comb_collider(meshes: Sequence[Head], roots: Floats) -> Collider:
    """The collider for combing hair with roots (S, 3), metres: fine enough for its scalp, as far as hair may come.

    Only meshes and roots count, not the scalp of a head nor the strands, so that the viewport and the command line,
    and all strokes on a groom, have the same one.

    Raises
    ------
    InputError : as build_collider; no roots.
    """
    require(len(roots) > 0, "the groom has no strands; choose one that has")
    low, high = roots.min(axis=0).astype(np.float64), roots.max(axis=0).astype(np.float64)
    size = float((high - low).max())
    around = np.stack([low - _REACH * size, high + _REACH * size])
    return build_collider(meshes, around=around if size > 0 else None, scalp_size=size)


def build_collider(
    meshes: Sequence[Head],
    *,
    cell: float | None = None,
    around: Floats | None = None,
    scalp_size: float | None = None,
) -> Collider:
    """The signed distance to the union of solid meshes, on a grid over their box (W-U5).

    Open boundaries (a bust's neck, a T-shirt's sleeves) are closed by fans to their middles; a mesh whose faces all
    point inwards is turned. Surfaces within a solid (eyeballs, teeth) stay inside, but count for the distance there.

    Parameters
    ----------
    meshes : one or more, world space, metres. Of the scalp only the size is used, for the default cell.
    cell : metres; None for 1/80 of the scalp's longest side (1/160 of the box's without a scalp), more if the grid
        would have over 3 million nodes.
    around : (n, 3) float, metres, world space: only the part of the meshes in the box of these points is covered. Give
        the places that hair may come to: beyond the grid everything counts as far outside.
    scalp_size : metres, the longest side of the scalp; None takes it from the meshes.

    Raises
    ------
    InputError : no meshes; a mesh without an inside (flat), or one with edges of three and more faces or of faces that
        point opposite ways, so that more than a tenth of its surface has no inside behind it; a bad cell or around.
    """
    require(len(meshes) > 0, "there is no mesh to collide with; choose the head or another mesh")
    solids = [_close(mesh, number) for number, mesh in enumerate(meshes, start=1)]
    low, high = _box(solids, around)
    if cell is None:
        size = _default_cell(meshes, low, high, scalp_size)
    else:
        size = float(cell)
        require(np.isfinite(size) and size > 0, f"the collider's cell is {size:g} m; it must be positive")
        count = float(np.prod((high - low) / size + 2.0 * _MARGIN + _STRIDE))
        require(
            count <= _MOST_NODES,
            f"the collider's cell of {size:g} m makes a grid of {count / 1e6:,.0f} million nodes; 20 million are "
            "allowed, choose a larger cell",
        )
    # a multiple of _STRIDE cells along each side, so that every 4th node spans the grid
    blocks = np.ceil(((high - low) / size + 2 * _MARGIN) / _STRIDE).astype(np.int64)
    shape = (int(blocks[0]) * _STRIDE + 1, int(blocks[1]) * _STRIDE + 1, int(blocks[2]) * _STRIDE + 1)
    origin = 0.5 * (low + high - size * _STRIDE * blocks)
    distance = _signed_distance(solids[0], origin, size, shape)
    for solid in solids[1:]:
        np.minimum(distance, _signed_distance(solid, origin, size, shape), out=distance)
    return Collider(distance, origin, size)


# --- the meshes ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Solid:
    """A closed mesh: vertices (V, 3) float64, metres; triangles (F, 3) int64, counter-clockwise from outside."""

    vertices: Float64
    triangles: Indices

    def winding(self, points: Float64) -> Float64:
        """(n,) how often the surface goes around points (n, 3)."""
        winding: Float64 = igl.fast_winding_number(self.vertices, self.triangles, np.ascontiguousarray(points))
        return np.atleast_1d(winding)


def _close(mesh: Head, number: int) -> _Solid:
    """The mesh with lids over its open boundaries, facing outwards; `number` names it in errors."""
    vertices, triangles = mesh.vertices.astype(np.float64), mesh.triangles.astype(np.int64)
    welded = weld(mesh)
    lids = boundary_fans(vertices, triangles, welded)
    lid_triangles = len(vertices) + np.arange(3 * len(lids)).reshape(-1, 3)
    vertices = np.concatenate([vertices, lids.reshape(-1, 3)])
    triangles = np.concatenate([triangles, lid_triangles])
    corners = vertices[triangles] - vertices.mean(axis=0)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * float(np.linalg.norm(cross, axis=1).sum())
    volume = float(np.einsum("fc,fc->", corners[:, 0], cross)) / 6.0
    require(
        abs(volume) > _FLAT * area**1.5,
        f"collider mesh {number} has no inside: its volume is {volume:.2g} m^3 with {area:.2g} m^2 of faces; give it "
        "thickness (Solidify) or choose a closed mesh",
    )
    if volume < 0:
        triangles, cross = np.ascontiguousarray(triangles[:, ::-1]), -cross
    solid = _Solid(vertices, triangles)
    faulty = _faulty_edges(welded)
    if faulty > 0:
        share = _wrong_share(solid, cross)
        require(
            share <= _WRONG_SHARE,
            f"collider mesh {number} has {faulty} edges of three or more faces or of faces that point opposite ways, "
            f"and {share:.0%} of its surface has no inside behind it; recalculate its normals (Mesh > Normals > "
            "Recalculate Outside) and remove inner faces",
        )
    return solid


def _faulty_edges(welded: Indices) -> int:
    """How many edges have three or more faces, or two that run along it the same way (normals opposed)."""
    edges = np.concatenate([welded[:, [0, 1]], welded[:, [1, 2]], welded[:, [2, 0]]])
    edges = edges[edges[:, 0] != edges[:, 1]]
    key = edges.min(axis=1) * (welded.max() + 1) + edges.max(axis=1)
    _, edge, n_faces = np.unique(key, return_inverse=True, return_counts=True)
    direction = np.bincount(edge.reshape(-1), np.where(edges[:, 0] < edges[:, 1], 1.0, -1.0))
    return int(((n_faces > 2) | ((n_faces == 2) & (direction != 0))).sum())


def _wrong_share(solid: _Solid, cross: Float64) -> float:
    """Share of the surface without inside just behind it; `cross` (F, 3) are the triangles' normals, 2 areas long.

    Counting faulty edges says little: most real heads have some, where they do no harm. This asks what collisions need.
    """
    double_areas = np.linalg.norm(cross, axis=1)
    until = np.cumsum(double_areas)
    # triangles at equal steps of area, each for the same share of the surface
    steps = (np.arange(_SHARE_SAMPLES) + 0.5) / _SHARE_SAMPLES * until[-1]
    chosen = np.minimum(np.searchsorted(until, steps), len(until) - 1)
    normals = cross[chosen] / np.maximum(double_areas[chosen], 1e-300)[:, None]
    depth = 1e-4 * float(np.ptp(solid.vertices, axis=0).max())
    behind = solid.vertices[solid.triangles[chosen]].mean(axis=1) - depth * normals
    return float((solid.winding(behind) <= 0.5).mean())


# --- the grid -----------------------------------------------------------------------------------------------------


def _box(solids: Sequence[_Solid], around: Floats | None) -> tuple[Float64, Float64]:
    """Lower and upper corner (3,) of the part of the meshes that the grid must cover, metres."""
    used = [solid.vertices[solid.triangles].reshape(-1, 3) for solid in solids]
    low = np.min([vertices.min(axis=0) for vertices in used], axis=0)
    high = np.max([vertices.max(axis=0) for vertices in used], axis=0)
    if around is None:
        return low, high
    places = _points(around)
    require(len(places) > 0, "there are no points to build the collider around; give one or more")
    require(bool(np.isfinite(places).all()), "the points around which to build the collider have NaN or infinities")
    return np.clip(places.min(axis=0), low, high), np.clip(places.max(axis=0), low, high)


def _default_cell(meshes: Sequence[Head], low: Float64, high: Float64, scalp_size: float | None) -> float:
    """The size of a cell, metres, by the scalp's size and the number of nodes in the box from `low` to `high`."""
    extent = scalp_size
    if extent is None:
        scalps = [mesh.vertices[mesh.triangles[mesh.scalp]].reshape(-1, 3) for mesh in meshes if mesh.scalp.any()]
        extent = max((float(np.ptp(scalp, axis=0).max()) for scalp in scalps), default=0.0)
    longest = float((high - low).max())
    size = extent / _CELLS_ALONG_SCALP if extent > 0 else longest / _CELLS_ALONG_BOX
    if size <= 0:  # points in one place, off the meshes
        size = float(max(np.ptp(mesh.vertices, axis=0).max() for mesh in meshes)) / _CELLS_ALONG_BOX
    while np.prod((high - low) / size + 2 * _MARGIN) > _USUAL_NODES:
        size *= 1.05
    return size


def _signed_distance(solid: _Solid, origin: Float64, cell: float, shape: tuple[int, int, int]) -> Float32:
    """(X, Y, Z) float32, metres, at the nodes."""
    tree = igl.AABB()
    tree.init(solid.vertices, solid.triangles)

    def unsigned(nodes: Float64) -> Float64:
        squares, _, _ = tree.squared_distance(solid.vertices, solid.triangles, origin + cell * nodes)
        return np.asarray(np.sqrt(np.atleast_1d(squares)))

    in_crossed_cell = np.zeros(shape, np.bool_)
    mark_crossed_cells((solid.vertices[solid.triangles] - origin) / cell, in_crossed_cell)
    near = np.flatnonzero(in_crossed_cell)
    near_distance = unsigned(_nodes(near, shape))
    sign = _signs(solid, origin, cell, near, near_distance, shape)
    every = slice(None, None, _STRIDE)
    coarse_sign = sign[every, every, every]
    coarse_nodes = _STRIDE * _nodes(np.arange(coarse_sign.size), coarse_sign.shape)
    coarse = coarse_sign * unsigned(coarse_nodes).reshape(coarse_sign.shape).astype(np.float32)
    distance = _between(coarse)
    # a node that is not near has no surface in the cells around it: at least a cell away, on the side of its sign;
    # where the interpolation says less, as between folds, it is asked too, so that no plateau hides the way out
    distance *= sign
    doubtful = np.flatnonzero((distance < cell) & ~in_crossed_cell)
    distance.reshape(-1)[doubtful] = np.maximum(unsigned(_nodes(doubtful, shape)), cell)
    distance.reshape(-1)[near] = near_distance
    distance *= sign
    _lower_where_middles_are_deeper(distance, solid, unsigned, in_crossed_cell, origin, cell)
    return distance


def _lower_where_middles_are_deeper(
    distance: Float32, solid: _Solid, unsigned: _Distances, in_crossed_cell: Bools, origin: Float64, cell: float
) -> None:
    """Lower nodes (X, Y, Z) by as much as the middle of a cell near the surface lies deeper than its nodes say.

    The middle of a thin wall is as far from a node on either side, so that its trilinear distance is outside.
    """
    of_cell = [tuple(slice(a, a - 1 or None) for a in corner) for corner in np.ndindex(2, 2, 2)]
    cells = np.argwhere(np.logical_and.reduce([in_crossed_cell[corner] for corner in of_cell]))
    corners = np.stack([distance[corner][tuple(cells.T)] for corner in of_cell], axis=1).astype(np.float64)
    found, exact = corners.mean(axis=1), unsigned(cells + 0.5)
    # the side of a node from which the line to the middle does not cross the surface; few have none, winding is dear
    surest = np.abs(corners).argmax(axis=1)
    side = np.sign(np.take_along_axis(corners, surest[:, None], axis=1)[:, 0])
    unsure = np.abs(corners).max(axis=1) + exact <= np.sqrt(0.75) * cell
    side[unsure] = np.where(solid.winding(origin + cell * (cells[unsure] + 0.5)) > 0.5, -1.0, 1.0)
    too_far = (found - side * exact).astype(np.float32)
    too_far[too_far < _SMOOTH * cell] = 0.0
    lowering = np.zeros_like(distance)
    for corner in of_cell:
        nodes = lowering[corner]
        np.maximum.at(nodes, tuple(cells.T), too_far)
    distance -= lowering


def _between(coarse: Float32) -> Float32:
    """(X, Y, Z) float32: values at every _STRIDE-th node along each axis, linear between them."""
    values = coarse
    for axis in range(3):
        ends = np.moveaxis(values, axis, 0)
        parts = [ends[:-1] + np.float32(step / _STRIDE) * (ends[1:] - ends[:-1]) for step in range(_STRIDE)]
        stack = np.stack(parts, axis=1).reshape(-1, *ends.shape[1:])
        values = np.moveaxis(np.concatenate([stack, ends[-1:]]), 0, axis)
    return np.ascontiguousarray(values)


def _signs(
    solid: _Solid, origin: Float64, cell: float, near: Indices, near_distance: Float64, shape: tuple[int, int, int]
) -> Float32:
    """(X, Y, Z) float32: -1 inside, 1 outside.

    Winding numbers are dear, so few are asked: the line between two nodes does not cross the surface if their
    distances to it add up to more than its length. So all of a connected piece of nodes over half a cell away have one
    sign, and nodes nearer than that nearly always have such a line to one of those.
    """
    close = near[near_distance <= 0.5 * cell]
    free = np.ones(shape, np.bool_)
    free.reshape(-1)[close] = False
    piece, n_pieces = ndimage.label(free)
    pieces = piece.reshape(-1)
    # a node that is not near is a cell or more away
    distance = np.full(len(pieces), cell)
    distance[near] = near_distance
    node_of_piece = np.zeros(n_pieces + 1, np.int64)
    node_of_piece[pieces] = np.arange(len(pieces))
    pieces[close] = pieces[_neighbours_beyond(close, distance, cell, shape)]
    # 0 is the piece of close nodes themselves: such a neighbour says nothing
    alone = close[pieces[close] == 0]
    asked = np.concatenate([node_of_piece[1:], alone])
    answers = np.where(solid.winding(origin + cell * _nodes(asked, shape)) > 0.5, -1.0, 1.0).astype(np.float32)
    sign: Float32 = np.concatenate([np.ones(1, np.float32), answers[:n_pieces]])[pieces]
    sign[alone] = answers[n_pieces:]
    return sign.reshape(shape)


def _neighbours_beyond(index: Indices, distance: Float64, cell: float, shape: tuple[int, int, int]) -> Indices:
    """(n,) for nodes (n,) the one of their 26 neighbours to which the line stays farthest from the surface.

    Where no line is known to stay off the surface, the node itself. `distance` (X Y Z,) is unsigned, metres.
    """
    place = np.stack(np.unravel_index(index, shape))
    own = distance[index]
    best, found = np.zeros(len(index)), index.copy()
    for step in np.ndindex(3, 3, 3):
        offset = np.array(step) - 1
        # beyond the grid's end its last node, which is closer than the offset says: the test stays on the safe side
        beyond = [np.clip(place[axis] + offset[axis], 0, shape[axis] - 1) for axis in range(3)]
        neighbour = np.ravel_multi_index(beyond, shape)
        gap = own + distance[neighbour] - cell * np.linalg.norm(offset)
        # for the node itself the sum would always do
        better = (gap > np.maximum(best, 1e-6 * cell)) & (neighbour != index)
        best[better], found[better] = gap[better], neighbour[better]
    return found


def _nodes(index: Indices, shape: tuple[int, ...]) -> Float64:
    """(n, 3) float64, in cells from the first node: the nodes of numbers (n,)."""
    return np.stack(np.unravel_index(index, shape), axis=1).astype(np.float64)


def _points(points: Floats) -> Float64:
    queries = np.ascontiguousarray(points, np.float64)
    require(queries.ndim == 2 and queries.shape[1] == 3, f"points must have shape (n, 3), not {queries.shape}")
    return queries
