"""The head's mesh: rays, closest points, signed distance; and where heads come from."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import igl
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..errors import require
from ..io.mesh import read_mesh_file
from ..io.units import Units
from ..types import Bools, Float32, Float64, Floats, Head, Int32
from ._head_kernels import add_fan_winding
from .analytic_heads import sphere_head
from .scalp_region import region_of_roots, weld

__all__ = [
    "HeadSurface",
    "boundary_fans",
    "default_head",
    "find_scalp",
    "read_head",
    "sphere_head",
    "submesh",
    "unwrap",
]

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
        self._welded = weld(head)
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        double_areas = np.linalg.norm(cross, axis=1)
        self.areas: Float64 = 0.5 * double_areas
        unit = np.divide(cross, double_areas[:, None], out=np.zeros_like(cross), where=double_areas[:, None] > 0)
        self.face_normals: Float32 = unit.astype(np.float32)
        self.normals: Float32 = _vertex_normals(len(self._vertices), self._triangles, self._welded, corners, unit)
        self._tree = igl.AABB()
        self._tree.init(self._vertices, self._triangles)
        self._rays = _Rays(head.vertices, head.triangles)
        self._fans = boundary_fans(self._vertices, self._triangles, self._welded)

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
            inner = np.ascontiguousarray(queries[boxed])
            winding = np.atleast_1d(igl.fast_winding_number(self._vertices, self._triangles, inner))
            add_fan_winding(inner, self._fans, winding)
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


def default_head() -> Head:
    """Hairloom's own plain head with a scalp, made by blend_templates/make_head.py. World space, metres."""
    with np.load(DEFAULT_HEAD_PATH) as fields:
        return Head(fields["vertices"], fields["triangles"], fields["scalp"], fields["corner_uv"])


def read_head(
    path: str | os.PathLike[str], units: Units | None = None, *, group: str | None = None, scalp: str | None = None
) -> Head:
    """Read a head from an .obj file; its scalp is unmarked, all False (see `find_scalp`), unless the file has it.

    Without texture coordinates in the file each triangle gets a place of its own in the unit square: good for attaching
    curves, not for painting (`unwrap` makes real charts, in seconds).

    Parameters
    ----------
    path : an .obj file. units : its unit and axes; None for the format's usual ones.
    group : read only this group or object of the file. scalp : the group whose faces hair grows on.

    Raises
    ------
    FileError : the file cannot be read, or has no such group. InputError : it has no faces.
    """
    mesh = read_mesh_file(path, units, group)
    marked = np.zeros(len(mesh.triangles), np.bool_)
    if scalp is not None:
        marked = np.isin(mesh.polygon_in_file, read_mesh_file(path, units, scalp).polygon_in_file)
    corner_uv = pack_triangles(len(mesh.triangles)) if mesh.corner_uv is None else mesh.corner_uv
    return Head(mesh.vertices, mesh.triangles, marked, corner_uv)


def pack_triangles(count: int) -> Float32:
    """(count, 3, 2) float32 texture coordinates without overlap: two triangles in each cell of a square grid."""
    n_columns = max(int(np.ceil(np.sqrt(np.ceil(count / 2)))), 1)
    low, high = 0.05, 0.95
    cell_corners = np.array(
        [[[low, low], [high - 0.1, low], [low, high - 0.1]], [[high, high], [low + 0.1, high], [high, low + 0.1]]]
    )
    index = np.arange(count)
    cell = index // 2
    origin = np.stack([cell % n_columns, cell // n_columns], axis=1)
    corner_uv = (origin[:, None, :] + cell_corners[index % 2]) / n_columns
    return np.asarray(corner_uv, np.float32)


def unwrap(vertices: Float32, triangles: Int32) -> Float32:
    """Texture coordinates (F, 3, 2) float32 in the unit square, charts without overlap (xatlas; M-34).

    vertices : (V, 3) float32, any unit. triangles : (F, 3) int32. Takes seconds for 10,000 triangles.
    """
    import xatlas

    atlas = xatlas.Atlas()
    atlas.add_mesh(np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(triangles, np.uint32))
    atlas.generate()
    _, corner_indices, uv = atlas[0]
    require(
        corner_indices.shape == triangles.shape,
        f"only {len(corner_indices)} of {len(triangles)} triangles could be unwrapped; clean up the mesh first",
    )
    return np.asarray(uv[corner_indices], np.float32)


def find_scalp(head: Head, roots: Floats) -> Head:
    """The head with its scalp marked where hair roots (n, 3), metres, world space, stand on it.

    The rules are those of `scalp_region.region_of_roots`; the scalp of `head` itself is not looked at.

    Raises
    ------
    InputError : no roots, or roots far off the head (wrong units, or the wrong head).
    """
    surface = HeadSurface(head)
    closest, triangle, _ = surface.closest_points(roots)
    distance = np.linalg.norm(np.asarray(roots, np.float64) - closest, axis=1)
    region = region_of_roots(head, surface.face_normals, closest.astype(np.float64), triangle, distance)
    return Head(head.vertices, head.triangles, region, head.corner_uv)


def submesh(head: Head, chosen: Bools) -> Head:
    """The head of the chosen triangles (F,) bool alone, without the vertices that these do not use."""
    used, triangles = np.unique(head.triangles[chosen], return_inverse=True)
    numbered = np.asarray(triangles.reshape(-1, 3), np.int32)
    return Head(head.vertices[used], numbered, head.scalp[chosen], head.corner_uv[chosen])


def _unit(vectors: Floats, fallback: Floats) -> Float32:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    unit = np.where(lengths > 1e-12, vectors / np.maximum(lengths, 1e-12), fallback)
    return np.asarray(unit, np.float32)


def _vertex_normals(
    count: int, triangles: NDArray[np.int64], welded: NDArray[np.int64], corners: Float64, unit: Float64
) -> Float32:
    """Mean of the face normals around each vertex, weighted by the faces' angles there; (0, 0, 1) for a lone vertex.

    `welded` are the triangles by place (see `weld`), so that the normals are smooth across seams too.
    """
    sums = np.zeros((count, 3))
    for corner in range(3):
        a = corners[:, (corner + 1) % 3] - corners[:, corner]
        b = corners[:, (corner + 2) % 3] - corners[:, corner]
        angles = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("fc,fc->f", a, b))
        for axis in range(3):
            sums[:, axis] += np.bincount(welded[:, corner], angles * unit[:, axis], count)
    by_place = np.zeros((count, 3))
    by_place[triangles.ravel()] = sums[welded.ravel()]
    return _unit(by_place, np.array([0.0, 0.0, 1.0]))


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


def boundary_fans(vertices: Float64, triangles: NDArray[np.int64], welded: NDArray[np.int64]) -> Float64:
    """(m, 3, 3) float64 corners of the triangles that close each boundary loop of the mesh by a fan to its middle."""
    edges = np.concatenate([welded[:, [0, 1]], welded[:, [1, 2]], welded[:, [2, 0]]])
    count = int(welded.max()) + 1
    key, reverse = edges[:, 0] * count + edges[:, 1], edges[:, 1] * count + edges[:, 0]
    open_edges = edges[~np.isin(key, reverse)]
    if len(open_edges) == 0:
        return np.empty((0, 3, 3))
    places = np.empty((count, 3))
    places[welded.ravel()] = vertices[triangles.ravel()]
    graph = coo_array((np.ones(len(open_edges)), (open_edges[:, 0], open_edges[:, 1])), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    _, loop_of_edge = np.unique(labels[open_edges[:, 0]], return_inverse=True)
    edge_counts = np.bincount(loop_of_edge)
    starts = places[open_edges[:, 0]]
    sums = [np.bincount(loop_of_edge, starts[:, axis]) / edge_counts for axis in range(3)]
    middles = np.stack(sums, axis=1)[loop_of_edge]
    # an open edge runs a -> b in its face, so the fan's face runs b -> a
    return np.ascontiguousarray(np.stack([places[open_edges[:, 1]], starts, middles], axis=1))
