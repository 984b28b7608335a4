"""The surface that carries the hair texture: uniform vertices at several densities, atlas, texels and patches.

Zhang et al. 2017, sec. 4.2 and 4.3 (Z-8 ... Z-11, Z-17).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import require
from ..types import Float32, Int32, Mesh, check_array
from .texels import TexelMap

__all__ = ["HairSurface", "Level", "SurfaceParams", "TexelMap"]


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
