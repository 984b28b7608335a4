"""The head: rays, closest points and signed distance on its mesh; its scalp; where heads come from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import igl
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from ..errors import require
from ..types import Bools, Float32, Float64, Floats, Head, Int32

DEFAULT_HEAD_PATH = Path(__file__).parent.parent / "data" / "head.npz"


class HeadSurface:
    """Queries on a head's mesh; built once, asked often. World space, metres.

    Attributes
    ----------
    head : the head itself.
    normals : (V, 3) float32, smooth unit vertex normals (mean of the faces around, weighted by their angle there).
    face_normals : (F, 3) float32, unit; (0, 0, 0) for a triangle of no area.
    areas : (F,) float64, m^2.
    """

    def __init__(self, head: Head) -> None:
        self.head = head
        self._vertices = np.ascontiguousarray(head.vertices, np.float64)
        self._triangles = np.ascontiguousarray(head.triangles, np.int64)
        corners = self._vertices[self._triangles]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        double_areas = np.linalg.norm(cross, axis=1)
        self.areas: Float64 = 0.5 * double_areas
        unit = np.divide(cross, double_areas[:, None], out=np.zeros_like(cross), where=double_areas[:, None] > 0)
        self.face_normals: Float32 = unit.astype(np.float32)
        self.normals: Float32 = _vertex_normals(len(self._vertices), self._triangles, corners, unit)
        self._tree = igl.AABB()
        self._tree.init(self._vertices, self._triangles)
        self._rays = _Rays(head.vertices, head.triangles)
        self._closed: tuple[Float64, NDArray[np.int64]] | None = None

    def first_hits(self, origins: Floats, directions: Floats) -> tuple[Float32, Int32]:
        """First triangle that each ray meets, from either side.

        Parameters
        ----------
        origins : (n, 3) float, metres. directions : (n, 3) float, any length but 0.

        Returns
        -------
        distance : (n,) float32, in lengths of the direction (metres for unit directions); inf for a miss.
        triangle : (n,) int32, -1 for a miss.
        """
        return self._rays.first_hits(origins, directions)

    def closest_points(self, points: Floats) -> tuple[Float32, Int32, Float32]:
        """Closest points of the surface to `points` (n, 3) float, metres.

        Returns
        -------
        closest : (n, 3) float32, metres. triangle : (n,) int32. barycentric : (n, 3) float32, >= 0, sum 1.
        """
        _, triangle, closest = self._closest(points)
        barycentric = _barycentric(closest, self._vertices[self._triangles[triangle]])
        return closest.astype(np.float32), triangle.astype(np.int32), barycentric.astype(np.float32)

    def signed_distance(self, points: Floats) -> Float32:
        """Distance to the surface, negative inside; `points` (n, 3) float, metres -> (n,) float32, metres.

        The sign: a bust is open below (and may have holes for the eyes), so each open boundary is closed by a fan of
        triangles to its middle, for the sign only; inside is where the closed mesh winds around the point more than
        half a time. Parts that lie inside one another (eyeballs, teeth) leave the inside inside.
        """
        squares, _, _ = self._closest(points)
        distance = np.sqrt(squares)
        queries = np.ascontiguousarray(points, np.float64)
        low, high = self._vertices.min(axis=0), self._vertices.max(axis=0)
        boxed = ((queries >= low) & (queries <= high)).all(axis=1)
        if boxed.any():
            if self._closed is None:
                self._closed = _close_boundaries(self._vertices, self._triangles)
            winding = igl.fast_winding_number(*self._closed, queries[boxed])
            distance[boxed] *= np.where(winding > 0.5, -1.0, 1.0)
        return distance.astype(np.float32)

    def normals_at(self, triangle: Int32, barycentric: Floats) -> Float32:
        """(n, 3) float32 unit normals, smooth over the surface, at barycentric (n, 3) places of triangles (n,)."""
        normals = np.einsum("nk,nkc->nc", barycentric, self.normals[self._triangles[triangle]])
        return _unit(normals, self.face_normals[triangle])

    def points_at(self, triangle: Int32, barycentric: Floats) -> Float32:
        """(n, 3) float32, metres: the points at barycentric (n, 3) places of triangles (n,)."""
        points = np.einsum("nk,nkc->nc", barycentric, self._vertices[self._triangles[triangle]])
        return np.asarray(points, np.float32)

    def barycentric_at(self, triangle: Int32, points: Floats) -> Float32:
        """(n, 3) float32 barycentric coordinates of points (n, 3), metres, on their triangles (n,), clamped to them."""
        corners = self._vertices[self._triangles[triangle]]
        return _barycentric(np.asarray(points, np.float64), corners).astype(np.float32)

    def uv_at(self, triangle: Int32, barycentric: Floats) -> Float32:
        """(n, 2) float32 texture coordinates at barycentric (n, 3) places of triangles (n,)."""
        uv = np.einsum("nk,nkc->nc", barycentric, self.head.corner_uv[triangle])
        return np.asarray(uv, np.float32)

    def _closest(self, points: Floats) -> tuple[Float64, NDArray[np.int64], Float64]:
        queries = np.ascontiguousarray(points, np.float64)
        require(queries.ndim == 2 and queries.shape[1] == 3, f"points must have shape (n, 3), not {queries.shape}")
        if len(queries) == 0:
            return np.empty(0), np.empty(0, np.int64), np.empty((0, 3))
        squares, triangle, closest = self._tree.squared_distance(self._vertices, self._triangles, queries)
        return np.atleast_1d(squares), np.atleast_1d(triangle), np.reshape(closest, (-1, 3))


class _Rays:
    """Embree rays against one mesh."""

    def __init__(self, vertices: Float32, triangles: Int32) -> None:
        # Embree works in float32: coordinates around the middle of the mesh lose least
        self._middle = 0.5 * (vertices.min(axis=0).astype(np.float64) + vertices.max(axis=0))
        self._scene = EmbreeScene()
        centred = np.ascontiguousarray(vertices - self._middle, np.float32)
        self._mesh = TriangleMesh(self._scene, centred, np.ascontiguousarray(triangles, np.int32))

    def first_hits(self, origins: Floats, directions: Floats) -> tuple[Float32, Int32]:
        if len(origins) == 0:
            return np.empty(0, np.float32), np.empty(0, np.int32)
        starts = np.ascontiguousarray(origins - self._middle, np.float32)
        headings = np.ascontiguousarray(directions, np.float32)
        hits: dict[str, Any] = self._scene.run(starts, headings, query="INTERSECT", output=1)
        triangle = np.asarray(hits["primID"], np.int32)
        return np.where(triangle >= 0, hits["tfar"], np.float32(np.inf)), triangle


def sphere_head(
    radius: float = 0.1,
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    n_rings: int = 64,
    scalp_angle_deg: float = 90.0,
) -> Head:
    """A spherical head, for tests and first steps: scalp within `scalp_angle_deg` of the top (+z).

    Rings of latitude, `2 n_rings` vertices each, so that ring boundaries and the scalp's border coincide when
    `scalp_angle_deg` is a multiple of 180 / n_rings. Texture coordinates are longitude and latitude. Metres.
    """
    require(radius > 0, f"the radius is {radius}; it must be above 0")
    require(n_rings >= 4, f"n_rings is {n_rings}; it must be 4 or more")
    n_columns = 2 * n_rings
    polar = np.repeat(np.linspace(0.0, np.pi, n_rings + 1)[1:-1], n_columns)
    azimuth = np.tile(np.arange(n_columns) * (2 * np.pi / n_columns), n_rings - 1)
    ring_points = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)
    vertices = np.vstack([ring_points, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    column = np.arange(n_columns)
    after = (column + 1) % n_columns
    north, south = len(ring_points), len(ring_points) + 1
    ring = (np.arange(n_rings - 2) * n_columns)[:, None]
    upper, upper_next, lower, lower_next = (
        ring + column,
        ring + after,
        ring + column + n_columns,
        ring + after + n_columns,
    )
    last = (n_rings - 2) * n_columns
    triangles = np.vstack(
        [
            np.stack([np.full(n_columns, north), column, after], axis=1),
            np.stack([upper, lower, lower_next], axis=-1).reshape(-1, 3),
            np.stack([upper, lower_next, upper_next], axis=-1).reshape(-1, 3),
            np.stack([np.full(n_columns, south), last + after, last + column], axis=1),
        ]
    ).astype(np.int32)
    corners = vertices[triangles]
    lowest = corners[..., 2].min(axis=1)
    scalp = lowest >= np.cos(np.radians(scalp_angle_deg)) - 1e-9
    longitude = np.arctan2(corners[..., 1], corners[..., 0]) / (2 * np.pi) + 0.5
    # the faces across the seam: corners on the low side move by one turn
    longitude += (longitude.max(axis=1, keepdims=True) - longitude) > 0.5
    latitude = 1.0 - np.arccos(np.clip(corners[..., 2], -1, 1)) / np.pi
    corner_uv = np.stack([longitude, latitude], axis=-1).astype(np.float32)
    placed = (vertices * radius + np.asarray(centre)).astype(np.float32)
    return Head(placed, triangles, scalp, corner_uv)


def submesh(head: Head, chosen: Bools) -> Head:
    """The head of the chosen triangles (F,) bool alone, without the vertices that these do not use."""
    used, triangles = np.unique(head.triangles[chosen], return_inverse=True)
    numbered = np.asarray(triangles.reshape(-1, 3), np.int32)
    return Head(head.vertices[used], numbered, head.scalp[chosen], head.corner_uv[chosen])


def require_scalp(head: Head) -> None:
    """Raise `InputError` unless the head's scalp has an area."""
    require(head.scalp.any(), "the head has no scalp; mark one, or let it be found from the hair")
    corners = head.vertices[head.triangles[head.scalp]].astype(np.float64)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    require(areas.sum() > 0, "the scalp region has no area; choose faces with an area")


def _unit(vectors: Floats, fallback: Floats) -> Float32:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    unit = np.where(lengths > 1e-12, vectors / np.maximum(lengths, 1e-12), fallback)
    return np.asarray(unit, np.float32)


def _vertex_normals(count: int, triangles: NDArray[np.int64], corners: Float64, unit: Float64) -> Float32:
    """Mean of the face normals around each vertex, weighted by the faces' angles there; (0, 0, 1) for a lone vertex."""
    sums = np.zeros((count, 3))
    for corner in range(3):
        a = corners[:, (corner + 1) % 3] - corners[:, corner]
        b = corners[:, (corner + 2) % 3] - corners[:, corner]
        angles = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("fc,fc->f", a, b))
        for axis in range(3):
            sums[:, axis] += np.bincount(triangles[:, corner], angles * unit[:, axis], count)
    return _unit(sums, np.array([0.0, 0.0, 1.0]))


def _barycentric(points: Float64, corners: Float64) -> Float64:
    """(n, 3) barycentric coordinates of points (n, 3) on triangles with corners (n, 3, 3), clamped to the triangle."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = points - corners[:, 0]
    aa, ab, bb = (np.einsum("nc,nc->n", x, y) for x, y in ((a, a), (a, b), (b, b)))
    pa, pb = np.einsum("nc,nc->n", p, a), np.einsum("nc,nc->n", p, b)
    determinant = aa * bb - ab * ab
    sound = determinant > 0
    safe = np.where(sound, determinant, 1.0)
    second = np.where(sound, (bb * pa - ab * pb) / safe, 0.0)
    third = np.where(sound, (aa * pb - ab * pa) / safe, 0.0)
    barycentric = np.clip(np.stack([1.0 - second - third, second, third], axis=1), 0.0, 1.0)
    return np.asarray(barycentric / barycentric.sum(axis=1, keepdims=True))


def _close_boundaries(vertices: Float64, triangles: NDArray[np.int64]) -> tuple[Float64, NDArray[np.int64]]:
    """The mesh with each boundary loop closed by a fan to its middle."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    count = len(vertices)
    key, reverse = edges[:, 0] * count + edges[:, 1], edges[:, 1] * count + edges[:, 0]
    open_edges = edges[~np.isin(key, reverse)]
    if len(open_edges) == 0:
        return vertices, triangles
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(open_edges)), (open_edges[:, 0], open_edges[:, 1])), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    _, loop_of_edge = np.unique(labels[open_edges[:, 0]], return_inverse=True)
    edge_counts = np.bincount(loop_of_edge)
    middles = np.stack(
        [np.bincount(loop_of_edge, vertices[open_edges[:, 0], axis]) / edge_counts for axis in range(3)], axis=1
    )
    # an open edge runs a -> b in its face, so the fan's face runs b -> a
    fans = np.stack([open_edges[:, 1], open_edges[:, 0], count + loop_of_edge], axis=1)
    return np.vstack([vertices, middles]), np.ascontiguousarray(np.vstack([triangles, fans]), np.int64)
