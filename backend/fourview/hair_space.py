"""What growing strands needs to know at every place: distances to shape, head and scalp, and the way hair grows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import igl
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from ..errors import require
from ..fields.grid import DirectionGrid
from ..fields.nearest import vectors_at
from ..geometry.collider import Collider, build_collider
from ..types import Bools, Float32, Float64, Floats, Head, Mesh, StrandSet
from ._space_kernels import N_VALUES, sample_places

# Cells along the longest side of the box: the grid of the papers' G_DEF has 100.
_CELLS = 120
_CELL_LIMITS = (0.002, 0.008)  # metres
_MARGIN = 3  # cells around the shape and the scalp
_EXACT = 2.5  # cells from a mesh within which its distance is not interpolated
_NEAR_SCALP = 0.1  # metres: a shape farther from the scalp is no hair of this head
_MOST_NODES = 2e6
_FAR = 0.3  # metres: beyond, a distance says nothing but "far"
Indices = NDArray[np.int64]
SHAPE, HEAD, OUTER, SCALP = range(4)  # the columns of HairSpace.distances


class HairShape(Protocol):
    """What growing needs of a `shape.RoughShape`."""

    @property
    def closed(self) -> Mesh:
        """G_DEF."""

    @property
    def open(self) -> Mesh:
        """G, its outer part, which the photos show."""

    @property
    def strands(self) -> StrandSet:
        """Hair of the database in this shape; may have no strands."""


@dataclass(frozen=True, slots=True)
class HairSpace:
    """Fields at the nodes of one grid, trilinear between them; world space, metres.

    distances : (X, Y, Z, 4) float32: signed to the closed shape, signed to the head (both negative inside), unsigned to
        the outer surface, unsigned to the scalp. Exact near the surfaces; `_FAR` where nobody asks.
    directions : (X, Y, Z, 3) float32, unit: from root to tip; outside the shape that of the nearest place inside.
    origin : (3,) float64: node (0, 0, 0). cell : metres between nodes. solid : the head's own finer distances.
    """

    distances: Float32
    directions: Float32
    origin: Float64
    cell: float
    solid: Collider

    def at(self, points: Floats) -> Float64:
        """(n, 19) at points (n, 3): the 4 distances, the direction, the gradients of the 4 distances."""
        queries = np.ascontiguousarray(points, np.float64).reshape(-1, 3)
        values = np.empty((len(queries), N_VALUES))
        sample_places(self.distances, self.directions, self.origin, self.cell, queries, values)
        return values


def make_hair_space(volume: DirectionGrid, shape: HairShape, head: Head) -> HairSpace:
    """The fields of a shape, its volume of directions (Z-20) and the head under it.

    Raises
    ------
    InputError : a volume without any direction, an empty shape, one that is nowhere near the scalp, a head without
        scalp.
    """
    require(volume.space is None, "the volume of directions must be in world space")
    require(len(shape.closed.triangles) > 0, "the hair shape has no faces; make the shape again")
    require(len(shape.open.triangles) > 0, "the hair shape has no outer surface; make the shape again")
    require(head.scalp.any(), "the head has no scalp; mark where hair grows")
    scalp_corners = head.vertices[head.triangles[head.scalp]].reshape(-1, 3)
    corners = np.concatenate([shape.closed.vertices[shape.closed.triangles].reshape(-1, 3), scalp_corners])
    low, high = corners.min(axis=0).astype(np.float64), corners.max(axis=0).astype(np.float64)
    gap, _ = cKDTree(shape.closed.vertices[::4]).query(scalp_corners[::3])
    require(
        gap.min() < _NEAR_SCALP,
        "no hair can grow: the hair shape is nowhere near the scalp; move the cameras or the head",
    )
    cell = float(np.clip((high - low).max() / _CELLS, *_CELL_LIMITS))
    cell = max(cell, float(np.prod(high - low) / _MOST_NODES) ** (1.0 / 3.0))
    origin = low - _MARGIN * cell
    counts = np.ceil((high - low) / cell).astype(int) + 2 * _MARGIN + 1
    size = (int(counts[0]), int(counts[1]), int(counts[2]))
    distances = np.full((*size, 4), _FAR, np.float32)
    distances[..., SHAPE] = _on_nodes(build_collider([_as_head(shape.closed)], cell=cell), origin, cell, size)
    solid = build_collider([head], around=np.stack([low, high]))
    distances[..., HEAD] = _on_nodes(solid, origin, cell, size)
    # nobody asks outside the shape but between it and the scalp
    scalp = Mesh(head.vertices, np.ascontiguousarray(head.triangles[head.scalp]))
    wanted = (distances[..., SHAPE] < 3.0 * cell) | (np.abs(distances[..., HEAD]) < 10.0 * cell)
    distances[..., OUTER] = _unsigned(shape.open, origin, cell, wanted)
    distances[..., SCALP] = _unsigned(scalp, origin, cell, wanted)
    return HairSpace(distances, _directions(volume, origin, cell, size), origin, cell, solid)


def _as_head(mesh: Mesh) -> Head:
    count = len(mesh.triangles)
    return Head(mesh.vertices, mesh.triangles, np.zeros(count, np.bool_), np.zeros((count, 3, 2), np.float32))


def _nodes(size: tuple[int, int, int], origin: Float64, cell: float) -> Float64:
    return np.asarray(np.stack(np.meshgrid(*[np.arange(n) for n in size], indexing="ij"), axis=-1) * cell + origin)


def _on_nodes(collider: Collider, origin: Float64, cell: float, size: tuple[int, int, int]) -> Float32:
    values = collider.distance_at(_nodes(size, origin, cell).reshape(-1, 3)).reshape(size)
    return np.minimum(values, np.float32(_FAR))


def _unsigned(mesh: Mesh, origin: Float64, cell: float, wanted: Bools) -> Float32:
    """(X, Y, Z) float32: the distance of each node to the mesh, at most _FAR, which is also that of nodes not wanted.

    Between every second node it is interpolated, but near the mesh, where it has a kink.
    """
    tree = igl.AABB()
    vertices, triangles = mesh.vertices.astype(np.float64), mesh.triangles.astype(np.int64)
    tree.init(vertices, triangles)

    def exact(nodes: Indices) -> Float32:
        squares, _, _ = tree.squared_distance(vertices, triangles, nodes * cell + origin)
        return np.asarray(np.minimum(np.sqrt(np.atleast_1d(squares)), _FAR), np.float32)

    around = ndimage.binary_dilation(wanted, np.ones((3, 3, 3)))
    coarse = np.full([(n + 1) // 2 for n in wanted.shape], _FAR, np.float32)
    asked = around[::2, ::2, ::2]
    coarse[asked] = exact(2 * np.argwhere(asked))
    distance = np.full(wanted.shape, _FAR, np.float32)
    places = np.argwhere(wanted)
    values = ndimage.map_coordinates(coarse, 0.5 * places.T, order=1, mode="nearest")
    near = values < _EXACT * cell
    values[near] = exact(places[near])
    distance[wanted] = values
    return distance


def _directions(volume: DirectionGrid, origin: Float64, cell: float, size: tuple[int, int, int]) -> Float32:
    """(X, Y, Z, 3) float32 unit directions at the nodes, also beyond the cells that have one."""
    require(volume.n_cells > 0, "the volume has no directions; find the directions first")
    vectors, size_there = vectors_at(volume, _nodes(size, origin, cell))
    return np.asarray(vectors / np.maximum(size_there, 1e-6), np.float32)
