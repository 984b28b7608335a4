"""Texels of a surface's texture: where each of them lies in space, and which of them are neighbours (Z-9, M-34)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import require
from ..types import Float32, Int32, check_array


@dataclass(frozen=True, slots=True)
class TexelMap:
    """The T texels of a texture of size x size whose centres lie in a chart.

    size : texels along a side. Texel (row r, column c) has its centre at u = (c + 0.5) / size, v = (r + 0.5) / size.
    texels : (T,) int32, r * size + c, ascending.
    triangle : (T,) int32, triangle of the surface's mesh. barycentric : (T, 3) float32, place on it.
    points : (T, 3) float32, metres, world space. normals : (T, 3) float32, unit, outwards, smooth.
    spacing : metres between neighbouring texels (median of the edges inside charts).
    edges : (E, 2) int32, pairs of texels (places in `texels`) that are neighbours on the surface, each once with the
        smaller first, sorted by the first, then the second: the right and the lower neighbour in the same chart, and
        across chart seams the nearest texels of the other side.
    """

    size: int
    texels: Int32
    triangle: Int32
    barycentric: Float32
    points: Float32
    normals: Float32
    spacing: float
    edges: Int32

    def __post_init__(self) -> None:
        count = len(self.texels)
        check_array("texels", self.texels, np.int32, (None,))
        check_array("triangle", self.triangle, np.int32, (count,))
        check_array("barycentric", self.barycentric, np.float32, (count, 3))
        check_array("points", self.points, np.float32, (count, 3))
        check_array("normals", self.normals, np.float32, (count, 3))
        check_array("edges", self.edges, np.int32, (None, 2))
        require(self.spacing > 0, f"the texel spacing is {self.spacing}; it must be above 0")

    @property
    def n_texels(self) -> int:
        return len(self.texels)

    def grid(self) -> Int32:
        """(size, size) int32: for each place of the texture the index of its texel, -1 outside the charts."""
        grid = np.full(self.size * self.size, -1, np.int32)
        grid[self.texels] = np.arange(self.n_texels, dtype=np.int32)
        return grid.reshape(self.size, self.size)
