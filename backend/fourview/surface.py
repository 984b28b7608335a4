"""The surface that carries the hair texture: uniform vertices at several densities, atlas, texels and patches.

Zhang et al. 2017, sec. 4.2 and 4.3 (Z-8 ... Z-11, Z-17).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import require
from ..progress import NO_PROGRESS, Progress
from ..types import Float32, Floats, Int32, Mesh, check_array
from ._surface_kernels import nearest_items, ring_order, walk_patches
from .atlas import make_atlas
from .remeshing import SurfaceSnap, cluster_evenly, remesh, subdivide, vertex_normals
from .texels import TexelMap, make_texel_map, texel_areas

# clusters of texels are within 2 % of the energy of hexagons after so many sweeps, and within 1.7 % at rest
VERTEX_SWEEPS = 8

__all__ = ["HairSurface", "Level", "SurfaceParams", "TexelMap", "make_surface"]


@dataclass(frozen=True, slots=True)
class SurfaceParams:
    """Settings of make_surface."""

    texture_size: int = 2048  # texels along a side at the finest scale (sec. 5: 2048)
    n_scales: int = 4  # each of half the texture size of the next (sec. 5: 4)
    patch_size: int = 10  # m, texels along a side of a patch; not stated in the paper (Darabi et al. 2012: 10)
    vertex_spacing: float = 0.5  # patches are so many patch sizes apart: 0.5 has each texel in about 4 patches
    atlas_vertices: int = 2500  # the atlas is made on a mesh of so many vertices, since xatlas takes seconds
    subdivisions: int = 2  # of the atlas' mesh into four, drawn to the given surface again
    gutter: int = 4  # texels between charts at the finest scale
    seed: int = 0

    def __post_init__(self) -> None:
        require(1 <= self.n_scales <= 8, f"n_scales is {self.n_scales}; it must be 1 to 8")
        require(
            64 << (self.n_scales - 1) <= self.texture_size <= 8192,
            f"a texture of {self.texture_size} texels with {self.n_scales} scales; "
            "the finest may have up to 8192, the coarsest must have 64 or more",
        )
        require(
            self.texture_size % (1 << (self.n_scales - 1)) == 0,
            f"a texture of {self.texture_size} texels cannot be halved {self.n_scales - 1} times; take a power of 2",
        )
        require(3 <= self.patch_size <= 32, f"patch_size is {self.patch_size}; it must be 3 to 32")
        require(0.1 <= self.vertex_spacing <= 1, f"vertex_spacing is {self.vertex_spacing}; it must be 0.1 to 1")
        require(100 <= self.atlas_vertices <= 50000, f"atlas_vertices is {self.atlas_vertices}; take 100 to 50000")
        require(0 <= self.subdivisions <= 4, f"subdivisions is {self.subdivisions}; it must be 0 to 4")
        require(1 <= self.gutter <= 32, f"gutter is {self.gutter}; it must be 1 to 32")


@dataclass(frozen=True, slots=True)
class Level:
    """One scale of the texture: its texels, and the V vertices at which patches lie (Z-8, Z-10, Z-17).

    vertices : (V, 3) float32, metres, world space. normals : (V, 3) float32, unit, outwards.
    tangents : (V, 3) float32, unit, normal x (0, 0, 1). bitangents : (V, 3) float32, normal x tangent: downwards.
    neighbour_offsets (V + 1,), neighbours (N,) int32 : the one-ring of vertex v is
        neighbours[neighbour_offsets[v]:neighbour_offsets[v + 1]], counter-clockwise seen from outside.
    order : (V,) int32, the vertices ring by ring around the topmost, each ring counter-clockwise.
    patch_texels : (V, m * m) int32, element [v, i * m + j] is the texel (place in `texels.texels`) on the surface where
        vertex + a tangent + b bitangent meets it along the normal, a = (j - (m - 1) / 2) spacing, b the same with i;
        -1 beyond the surface's boundary and where the surface turns away.
    """

    texels: TexelMap
    vertices: Float32
    normals: Float32
    tangents: Float32
    bitangents: Float32
    neighbour_offsets: Int32
    neighbours: Int32
    order: Int32
    patch_texels: Int32

    def __post_init__(self) -> None:
        count = len(self.vertices)
        check_array("vertices", self.vertices, np.float32, (None, 3))
        check_array("normals", self.normals, np.float32, (count, 3))
        check_array("tangents", self.tangents, np.float32, (count, 3))
        check_array("bitangents", self.bitangents, np.float32, (count, 3))
        check_array("neighbour_offsets", self.neighbour_offsets, np.int32, (count + 1,))
        check_array("neighbours", self.neighbours, np.int32, (int(self.neighbour_offsets[-1]),))
        check_array("order", self.order, np.int32, (count,))
        check_array("patch_texels", self.patch_texels, np.int32, (count, None))

    @property
    def n_vertices(self) -> int:
        return len(self.vertices)

    @property
    def patch_size(self) -> int:
        """m, texels along a side of a patch."""
        return round(float(np.sqrt(self.patch_texels.shape[1])))


@dataclass(frozen=True, slots=True)
class HairSurface:
    """The rough shape's outer surface with its atlas and its scales.

    mesh : the surface that the texels lie on. normals : (V, 3) float32, smooth unit normals of its vertices.
    corner_uv : (F, 3, 2) float32 in [0, 1], the atlas. levels : coarse first, the last has the full texture.
    """

    mesh: Mesh
    normals: Float32
    corner_uv: Float32
    levels: tuple[Level, ...]

    def __post_init__(self) -> None:
        check_array("normals", self.normals, np.float32, (len(self.mesh.vertices), 3))
        check_array("corner_uv", self.corner_uv, np.float32, (len(self.mesh.triangles), 3, 2))
        require(len(self.levels) >= 1, "a hair surface needs a scale")


def make_surface(
    shape: Mesh, params: SurfaceParams = SurfaceParams(), *, progress: Progress = NO_PROGRESS
) -> HairSurface:
    """Remesh the open shape of the hair and lay texels and patches on it (Zhang et al. 2017, sec. 4.2; Z-8 ... Z-11).

    Parameters
    ----------
    shape : G, the outer surface; metres, world space. progress : called a few times; may raise Cancelled.

    Raises
    ------
    InputError : a shape without triangles or area, or one that cannot be unwrapped.
    """
    require(len(shape.triangles) > 0, "the hair's shape has no triangles; find a shape first")
    extent = float(np.ptp(shape.vertices, axis=0).max())
    require(extent > 1e-4, f"the hair's shape is {extent:g} m large; it must be in metres and larger than 0.1 mm")
    progress(0.0, "Remeshing the hair's shape")
    coarse = remesh(shape, params.atlas_vertices)
    progress(0.15, "Unwrapping the hair's shape")
    corner_uv, charts = make_atlas(coarse, params.gutter / params.texture_size)
    mesh, corner_uv = _refine(coarse, corner_uv, shape, params.subdivisions)
    charts = np.repeat(charts, len(mesh.triangles) // len(charts))
    normals = vertex_normals(mesh.vertices, mesh.triangles)
    across = _across(mesh.triangles)
    levels = []
    for scale in range(params.n_scales):
        progress(0.3 + 0.7 * 0.25 ** (params.n_scales - scale), f"Scale {scale + 1} of {params.n_scales}")
        size = params.texture_size >> (params.n_scales - 1 - scale)
        texels = make_texel_map(mesh, normals, corner_uv, charts, size)
        levels.append(_make_level(texels, mesh, corner_uv, across, params))
    progress(1.0, "Surface finished")
    return HairSurface(mesh, normals, corner_uv, tuple(levels))


def _refine(mesh: Mesh, corner_uv: Float32, shape: Mesh, times: int) -> tuple[Mesh, Float32]:
    """Subdivide the atlas' mesh and draw the new vertices to the shape; the atlas stays."""
    snap, values = SurfaceSnap(shape), corner_uv
    for _ in range(times):
        count = len(mesh.vertices)
        finer, divided = subdivide(mesh, values)
        mesh, values = snap.snap(finer, count), np.asarray(divided, np.float32)
    return mesh, values


def _across(triangles: Int32) -> Int32:
    """(F, 3) int32: the triangle beyond the side opposite to each corner, -1 at the boundary."""
    start, end = triangles[:, [1, 2, 0]].astype(np.int64), triangles[:, [2, 0, 1]].astype(np.int64)
    forward, backward = (start << 32 | end).ravel(), (end << 32 | start).ravel()
    order = np.argsort(forward, kind="stable")
    place = np.minimum(np.searchsorted(forward[order], backward), len(order) - 1)
    match = order[place]
    found = forward[match] == backward
    return np.where(found, match // 3, -1).reshape(-1, 3).astype(np.int32)


def _make_level(texels: TexelMap, mesh: Mesh, corner_uv: Float32, across: Int32, params: SurfaceParams) -> Level:
    """Vertices as centres of texel clusters (M-33), their one-rings, frames, order and patches."""
    m = params.patch_size
    n_vertices = max(round(texels.n_texels / (params.vertex_spacing * m) ** 2), min(4, texels.n_texels))
    areas = texel_areas(texels, mesh, corner_uv)
    labels = cluster_evenly(texels.points, areas, texels.edges, n_vertices, VERTEX_SWEEPS)
    centres = _central_texels(texels.points, areas, labels)
    vertices, normals = texels.points[centres], texels.normals[centres]
    tangents, bitangents = tangent_frames(normals)
    offsets, neighbours = _one_rings(texels.edges, labels, vertices, tangents, bitangents)
    order = scan_order(vertices, offsets, neighbours)
    patches = np.empty((len(centres), m * m), np.int32)
    walk_patches(
        centres,
        tangents,
        bitangents,
        m,
        texels.spacing,
        texels.grid(),
        texels.points,
        texels.triangle,
        corner_uv.astype(np.float64) * texels.size,
        mesh.vertices,
        mesh.triangles,
        across,
        patches,
    )
    return Level(texels, vertices, normals, tangents, bitangents, offsets, neighbours, order, patches)


def _central_texels(points: Float32, areas: Float32, labels: Int32) -> Int32:
    """(k,) int32: the item of each cluster that is nearest to its centre."""
    count = int(labels.max()) + 1
    # a cluster of slivers alone has a centre too
    shares = np.maximum(areas.astype(np.float64), 1e-9 * float(areas.max(initial=0.0)))
    weight = np.bincount(labels, shares, count)
    sums = [np.bincount(labels, shares * points[:, axis], count) / weight for axis in range(3)]
    nearest = np.full(count, -1, np.int32)
    nearest_items(points, labels, np.stack(sums, axis=1), nearest, np.full(count, np.inf))
    return nearest


def tangent_frames(normals: Floats) -> tuple[Float32, Float32]:
    """Tangents (n, 3), normal x up, and bitangents (n, 3), normal x tangent, float32 unit, of unit normals (n, 3).

    Sec. 4.3.1 with its y for our z. Where the normal is up or down, the tangent is along x.
    """
    across = np.stack([normals[:, 1], -normals[:, 0], np.zeros(len(normals))], axis=1).astype(np.float64)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(length > 1e-6, across / np.maximum(length, 1e-6), [1.0, 0.0, 0.0])
    across -= np.einsum("nc,nc->n", across, normals)[:, None] * normals
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return across.astype(np.float32), np.cross(normals, across).astype(np.float32)


def _one_rings(
    edges: Int32, labels: Int32, vertices: Float32, tangents: Float32, bitangents: Float32
) -> tuple[Int32, Int32]:
    """Which clusters touch, as CSR, counter-clockwise around each vertex' normal."""
    count = len(vertices)
    ends = labels[edges]
    ends = ends[ends[:, 0] != ends[:, 1]].astype(np.int64)
    keys = np.unique(ends.min(axis=1) * count + ends.max(axis=1))
    low, high = keys // count, keys % count
    one, other = np.concatenate([low, high]), np.concatenate([high, low])
    step = vertices[other] - vertices[one]
    angle = np.arctan2(np.einsum("nc,nc->n", step, bitangents[one]), np.einsum("nc,nc->n", step, tangents[one]))
    order = np.lexsort((angle, one))
    offsets = np.zeros(count + 1, np.int32)
    np.cumsum(np.bincount(one, minlength=count), out=offsets[1:])
    return offsets, other[order].astype(np.int32)


def scan_order(vertices: Float32, offsets: Int32, neighbours: Int32) -> Int32:
    """(V,) int32: the vertices ring by ring around the topmost, each ring counter-clockwise (sec. 4.3.1; Z-17).

    offsets, neighbours : one-rings, counter-clockwise (`Level`). Parts of the surface that do not hang together come
    one after the other, each from its topmost vertex on.
    """
    order = np.empty(len(vertices), np.int32)
    starts = np.argsort(-vertices[:, 2], kind="stable").astype(np.int32)
    ring_order(offsets, neighbours, starts, order)
    return order
