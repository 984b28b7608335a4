"""Closed regions on a cube of voxels: strands, heads and meshes into it, and its surface out of it (M-31)."""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np
from scipy.ndimage import label, maximum_filter, minimum_filter

from ..geometry.head import boundary_fans
from ..geometry.scalp_region import weld
from ..types import Bools, Float32, Float64, Floats, Head, Int32, Int64, Mesh, StrandSet, check_array
from ._solid_kernels import add_crossings

_BAND = 3  # voxels from the surface up to which signed distances are exact


@dataclass(frozen=True, slots=True)
class Voxels:
    """A cube of n x n x n voxels.

    origin : (3,) float64, metres, world space: the middle of voxel (0, 0, 0). cell : metres, a voxel's edge.
    """

    origin: Float64
    cell: float
    count: int

    def __post_init__(self) -> None:
        check_array("origin", self.origin, np.float64, (3,))

    @property
    def shape(self) -> tuple[int, int, int]:
        return (self.count, self.count, self.count)

    def indices(self, points: Floats) -> Float64:
        """(n, 3) float64, points (n, 3), metres, in voxels; whole numbers are the voxels' middles."""
        return np.asarray((np.asarray(points, np.float64) - self.origin) / self.cell)

    def points(self, indices: Floats) -> Float64:
        """(n, 3) float64, metres, world space, of places (n, 3) in voxels."""
        return np.asarray(self.origin + np.asarray(indices, np.float64) * self.cell)


def voxels_around(low: Floats, high: Floats, count: int, margin: float) -> Voxels:
    """The cube of count^3 voxels around the box from low to high (3,), metres, with `margin` voxels to spare."""
    middle = 0.5 * (np.asarray(low, np.float64) + np.asarray(high, np.float64))
    cell = float((np.asarray(high, np.float64) - low).max()) / (count - 1 - 2.0 * margin)
    return Voxels(middle - 0.5 * cell * (count - 1), cell, count)


def strand_voxels(strands: StrandSet, voxels: Voxels) -> Bools:
    """(n, n, n) bool: the voxels that the strands pass through."""
    points = voxels.indices(strands.points)
    starts = np.ones(len(points), np.bool_)
    starts[strands.offsets[1:] - 1] = False
    first = np.flatnonzero(starts)
    lengths = np.linalg.norm(points[first + 1] - points[first], axis=1)
    pieces = np.maximum(np.ceil(2.0 * lengths), 1).astype(np.int64)  # steps of half a voxel or less
    ends = np.cumsum(pieces)
    along = (np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - pieces, pieces)) / np.repeat(pieces, pieces)
    start = np.repeat(first, pieces)
    samples = points[start] + (points[start + 1] - points[start]) * along[:, None]
    return point_voxels(np.concatenate([samples, points[strands.offsets[1:] - 1]]), voxels)


def point_voxels(indices: Floats, voxels: Voxels) -> Bools:
    """(n, n, n) bool: the voxels that places (m, 3), in voxels, lie in; those outside the cube are left out."""
    nearest = np.rint(indices).astype(np.int64)
    nearest = nearest[((nearest >= 0) & (nearest < voxels.count)).all(axis=1)]
    filled = np.zeros(voxels.shape, np.bool_)
    filled[nearest[:, 0], nearest[:, 1], nearest[:, 2]] = True
    return filled


def mesh_voxels(vertices: Floats, triangles: Int32 | Int64, voxels: Voxels) -> Bools:
    """(n, n, n) bool: the voxels whose middle is inside a closed mesh, however its parts overlap.

    vertices : (V, 3) float, metres. triangles : (F, 3), counter-clockwise from outside.
    """
    winding = np.zeros(voxels.shape, np.int32)
    # a nudge, so that meshes from this very grid do not have their vertices on its columns
    places = voxels.indices(vertices) + np.array([1.3e-7, 2.9e-7, 0.0])
    add_crossings(places, np.ascontiguousarray(triangles, np.int64), winding)
    return np.asarray(np.cumsum(winding, axis=2) > 0)


def head_voxels(head: Head, voxels: Voxels) -> Bools:
    """(n, n, n) bool: the voxels inside a head; its open boundaries (the neck) are closed by fans."""
    vertices, triangles = head.vertices.astype(np.float64), head.triangles.astype(np.int64)
    fans = boundary_fans(vertices, triangles, weld(head)).reshape(-1, 3)
    closing = len(vertices) + np.arange(len(fans)).reshape(-1, 3)
    return mesh_voxels(np.concatenate([vertices, fans]), np.concatenate([triangles, closing]), voxels)


def signed_distance(mesh: Mesh, voxels: Voxels) -> Float32:
    """(n, n, n) float32, metres, positive inside; exact within 3 voxels of the closed mesh, +-3 voxels beyond."""
    inside = mesh_voxels(mesh.vertices, mesh.triangles, voxels)
    filled, size = inside.astype(np.uint8), 2 * _BAND + 1
    near = maximum_filter(filled, size) > minimum_filter(filled, size)
    vertices, triangles = mesh.vertices.astype(np.float64), mesh.triangles.astype(np.int64)
    tree = igl.AABB()
    tree.init(vertices, triangles)
    places = np.argwhere(near)
    furthest = _BAND * voxels.cell
    distance = np.full(voxels.shape, furthest, np.float32)
    if len(places):
        squares, _, _ = tree.squared_distance(vertices, triangles, voxels.points(places.astype(np.float64)))
        distance[near] = np.minimum(np.sqrt(squares), furthest)
    return np.where(inside, distance, -distance)


def surface(field: Float32, voxels: Voxels) -> Mesh:
    """The surface where `field` (n, n, n) passes 0, closed also at the cube's sides; counter-clockwise from outside.

    field : positive inside. The mesh has no vertices when nothing is inside.
    """
    values = np.array(field, np.float64)
    scale = max(float(np.abs(values).max()), 1e-12)
    # a 0 right at a voxel would give triangles of no area
    values = np.where(np.abs(values) < 1e-3 * scale, np.where(values > 0, 1e-3, -1e-3) * scale, values)
    for axis in range(3):
        side = np.moveaxis(values, axis, 0)
        side[0] = side[-1] = -scale
    if not (values > 0).any():
        return Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    grid = np.stack(np.meshgrid(*(np.arange(n, dtype=np.float64) for n in values.shape), indexing="ij"), axis=-1)
    # igl counts x fastest, and its triangles look to where values are high
    corners = np.ascontiguousarray(grid.transpose(2, 1, 0, 3).reshape(-1, 3))
    flat = np.ascontiguousarray(values.transpose(2, 1, 0)).ravel()
    vertices, triangles, _ = igl.marching_cubes(flat, corners, *values.shape, 0.0)
    return Mesh(voxels.points(vertices).astype(np.float32), np.ascontiguousarray(triangles[:, ::-1], np.int32))


def without_specks(field: Float32, smallest_share: float = 0.01) -> Float32:
    """The field with the sign turned in parts inside that have less than a share of all voxels inside."""
    parts, n_parts = label(field > 0)
    if n_parts <= 1:
        return field
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    small = (sizes < smallest_share * sizes.sum())[parts] & (parts > 0)
    return np.where(small, -field, field)


def scalp_centre(head: Head) -> Float64:
    """(3,) float64, metres: the middle of the head's cranium, taken as the middle of the box around the scalp."""
    used = head.vertices[head.triangles[head.scalp].ravel()] if head.scalp.any() else head.vertices
    low, high = used.min(axis=0).astype(np.float64), used.max(axis=0).astype(np.float64)
    # the scalp covers the upper side: the centre is as far below its top as it reaches sideways
    radius = 0.5 * float(max(high[0] - low[0], high[1] - low[1]))
    return np.array([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), high[2] - radius])
