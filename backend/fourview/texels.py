"""Texels of a surface's texture: where each of them lies in space, and which of them are neighbours (Z-9, M-34)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..errors import require
from ..types import Bools, Float32, Int32, Mesh, check_array
from ._texel_kernels import accept_links, chart_links, draw_triangles, place_texels, write_edges

LONGEST_STEP = 4.0  # texel spacings between neighbours of one chart: farther apart, two parts of a chart touch
SEAM_REACH = 2.0  # texel spacings over which texels of two sides of a seam are linked


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
        across chart seams the nearest texels of the other side; no texel has more than four.
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


def make_texel_map(mesh: Mesh, normals: Float32, corner_uv: Float32, charts: Int32, size: int) -> TexelMap:
    """The texels of an atlas (Z-9, M-34).

    Parameters
    ----------
    mesh, normals (V, 3), corner_uv (F, 3, 2) : as in `surface.HairSurface`. charts : (F,) int32, chart of each
        triangle. size : texels along a side.

    Raises
    ------
    InputError : no texel's centre lies in a chart.
    """
    corners = corner_uv.astype(np.float64) * size
    drawn = np.full((size, size), -1, np.int32)
    draw_triangles(corners, drawn)
    texels = np.flatnonzero(drawn >= 0).astype(np.int32)
    count = len(texels)
    require(count > 1, f"a texture of {size} texels has none on the surface; take a larger one")
    triangle = drawn.ravel()[texels]
    barycentric, points = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
    smooth = np.empty((count, 3), np.float32)
    place_texels(texels, triangle, size, corners, mesh.triangles, mesh.vertices, normals, barycentric, points, smooth)
    grid = np.full((size, size), -1, np.int32)
    grid.ravel()[texels] = np.arange(count, dtype=np.int32)
    edges, spacing = _link(grid, texels, charts[triangle], points, smooth, np.sqrt(_area(mesh) / count))
    return TexelMap(size, texels, triangle, barycentric, points, smooth, spacing, edges)


def _area(mesh: Mesh) -> float:
    corners = mesh.vertices[mesh.triangles].astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(0.5 * np.linalg.norm(cross, axis=1).sum())


def _link(
    grid: Int32, texels: Int32, charts: Int32, points: Float32, normals: Float32, guess: float
) -> tuple[Int32, float]:
    """The edges of a TexelMap, and the median length of those to the right."""
    count = len(texels)
    right, down = np.empty(count, np.bool_), np.empty(count, np.bool_)
    chart_links(grid, texels, charts, points, LONGEST_STEP * guess, right, down)
    first = np.flatnonzero(right)
    steps = np.linalg.norm(points[first] - points[first + 1], axis=1)
    spacing = float(np.median(steps)) if len(steps) else guess
    seams = _seam_links(grid, texels, charts, points, normals, right, down, spacing)
    seam_counts = np.bincount(seams[:, 0], minlength=count)
    seam_offsets = np.zeros(count + 1, np.int32)
    np.cumsum(seam_counts, out=seam_offsets[1:])
    offsets = np.zeros(count + 1, np.int32)
    np.cumsum(right.astype(np.int32) + down + seam_counts, out=offsets[1:])
    edges = np.empty((int(offsets[-1]), 2), np.int32)
    write_edges(grid, texels, right, down, offsets, seam_offsets, np.ascontiguousarray(seams[:, 1]), edges)
    return edges, spacing


def _seam_links(
    grid: Int32,
    texels: Int32,
    charts: Int32,
    points: Float32,
    normals: Float32,
    right: Bools,
    down: Bools,
    spacing: float,
) -> Int32:
    """(n, 2) int32 pairs across seams, the smaller first, sorted: the nearest ones, none with more than four links.

    The two sides of a seam may belong to one chart; what lies near in the texture too is no other side.
    """
    size = len(grid)
    degree = right.astype(np.int8) + down
    lower = grid.ravel()[texels[down] + size]
    degree[np.flatnonzero(right) + 1] += 1
    degree[lower] += 1
    border = np.flatnonzero(degree < 4)
    if len(border) < 2:
        return np.empty((0, 2), np.int32)
    k = min(16, len(border))
    reach = SEAM_REACH * spacing
    distance, found = cKDTree(points[border]).query(points[border], k=k, distance_upper_bound=reach, workers=1)
    one = np.repeat(border, k)
    near = np.isfinite(distance).ravel()
    one, other = one[near], border[found.ravel()[near]]
    rows, columns = texels // size, texels % size
    apart = np.maximum(np.abs(rows[one] - rows[other]), np.abs(columns[one] - columns[other])) > 2 * SEAM_REACH + 1
    across = (charts[one] != charts[other]) | apart
    across &= np.einsum("nc,nc->n", normals[one], normals[other]) > 0
    pairs = np.stack([np.minimum(one, other), np.maximum(one, other)], axis=1)[across].astype(np.int32)
    order = np.lexsort((pairs[:, 1], pairs[:, 0], distance.ravel()[near][across]))
    pairs = pairs[order]
    # each pair comes once from either end, one after the other
    pairs = pairs[(np.diff(pairs, axis=0, prepend=-1) != 0).any(axis=1)]
    accepted = np.empty(len(pairs), np.bool_)
    accept_links(pairs, degree, 4, accepted)
    pairs = pairs[accepted]
    return np.ascontiguousarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])


def texel_areas(texels: TexelMap, mesh: Mesh, corner_uv: Float32) -> Float32:
    """(T,) float32, m^2: the part of the surface that each texel stands for (its triangle's scale)."""
    corners = mesh.vertices[mesh.triangles].astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    u, v = corner_uv[:, 1] - corner_uv[:, 0], corner_uv[:, 2] - corner_uv[:, 0]
    flat = np.abs(u[:, 0].astype(np.float64) * v[:, 1] - u[:, 1].astype(np.float64) * v[:, 0])
    scale = np.linalg.norm(cross, axis=1) / np.maximum(flat, 1e-30) / texels.size**2
    return np.asarray(scale[texels.triangle], np.float32)
