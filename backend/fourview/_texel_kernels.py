"""Kernels of `texels`: drawing the atlas, placing its texels on the surface, links between them."""

from __future__ import annotations

import numpy as np
from numba import prange
from numpy.typing import NDArray

from ..kernels import device, kernel, parallel_kernel
from ..types import Bools, Float32, Float64, Int32


@kernel
def draw_triangles(corners: Float64, grid: Int32) -> None:
    """Write each triangle's number to the cells of `grid` (N, N) whose centres lie in it; the first one stays.

    corners : (F, 3, 2) x and y in cells.
    """
    size = len(grid)
    for index in range(len(corners)):
        ax, ay = corners[index, 0, 0], corners[index, 0, 1]
        bx, by = corners[index, 1, 0], corners[index, 1, 1]
        cx, cy = corners[index, 2, 0], corners[index, 2, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        first = max(0, int(np.ceil(min(ay, by, cy) - 0.5)))
        last = min(size - 1, int(np.floor(max(ay, by, cy) - 0.5)))
        left = max(0, int(np.ceil(min(ax, bx, cx) - 0.5)))
        right = min(size - 1, int(np.floor(max(ax, bx, cx) - 0.5)))
        for row in range(first, last + 1):
            y = row + 0.5
            for column in range(left, right + 1):
                x = column + 0.5
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                if u >= -1e-9 and v >= -1e-9 and u + v <= 1.0 + 1e-9 and grid[row, column] < 0:
                    grid[row, column] = index


@parallel_kernel
def place_texels(
    texels: Int32,
    triangle: Int32,
    size: int,
    corners: Float64,
    triangles: Int32,
    vertices: Float32,
    vertex_normals: Float32,
    barycentric: Float32,
    points: Float32,
    normals: Float32,
) -> None:
    """Barycentric coordinates, points and unit normals of texels on their triangles."""
    for texel in prange(len(texels)):
        index = triangle[texel]
        x, y = texels[texel] % size + 0.5, texels[texel] // size + 0.5
        ax, ay = corners[index, 0, 0], corners[index, 0, 1]
        bx, by = corners[index, 1, 0], corners[index, 1, 1]
        cx, cy = corners[index, 2, 0], corners[index, 2, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        u = min(max(((bx - x) * (cy - y) - (by - y) * (cx - x)) / area, 0.0), 1.0)
        v = min(max(((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area, 0.0), 1.0 - u)
        w = 1.0 - u - v
        barycentric[texel, 0], barycentric[texel, 1], barycentric[texel, 2] = u, v, w
        a, b, c = triangles[index, 0], triangles[index, 1], triangles[index, 2]
        square = 0.0
        for axis in range(3):
            points[texel, axis] = u * vertices[a, axis] + v * vertices[b, axis] + w * vertices[c, axis]
            value = u * vertex_normals[a, axis] + v * vertex_normals[b, axis] + w * vertex_normals[c, axis]
            normals[texel, axis] = value
            square += value * value
        scale = 1.0 / np.sqrt(max(square, 1e-30))
        for axis in range(3):
            normals[texel, axis] *= scale


@device
def _square(points: Float32, i: int, j: int) -> float:
    x, y, z = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1], points[i, 2] - points[j, 2]
    return float(x * x + y * y + z * z)


@parallel_kernel
def chart_links(
    grid: Int32, texels: Int32, charts: Int32, points: Float32, longest: float, right: Bools, down: Bools
) -> None:
    """Whether each texel is linked to its right and lower neighbour: of the same chart and not `longest` away."""
    size = len(grid)
    for texel in prange(len(texels)):
        row, column = texels[texel] // size, texels[texel] % size
        right[texel] = False
        down[texel] = False
        if column + 1 < size:
            other = grid[row, column + 1]
            if other >= 0 and charts[other] == charts[texel]:
                right[texel] = _square(points, texel, other) < longest * longest
        if row + 1 < size:
            other = grid[row + 1, column]
            if other >= 0 and charts[other] == charts[texel]:
                down[texel] = _square(points, texel, other) < longest * longest


@parallel_kernel
def write_edges(
    grid: Int32,
    texels: Int32,
    right: Bools,
    down: Bools,
    offsets: Int32,
    seam_offsets: Int32,
    seams: Int32,
    edges: Int32,
) -> None:
    """The edges of each texel from `offsets` on: right, down, and across seams, by rising second texel."""
    size = len(grid)
    for texel in prange(len(texels)):
        row, column = texels[texel] // size, texels[texel] % size
        start = place = offsets[texel]
        if right[texel]:
            edges[place, 0], edges[place, 1] = texel, grid[row, column + 1]
            place += 1
        if down[texel]:
            edges[place, 0], edges[place, 1] = texel, grid[row + 1, column]
            place += 1
        for seam in range(seam_offsets[texel], seam_offsets[texel + 1]):
            other = seams[seam]
            slot = place
            while slot > start and edges[slot - 1, 1] > other:
                edges[slot, 0], edges[slot, 1] = texel, edges[slot - 1, 1]
                slot -= 1
            edges[slot, 0], edges[slot, 1] = texel, other
            place += 1


@kernel
def accept_links(pairs: Int32, degrees: NDArray[np.int8], most: int, accepted: Bools) -> None:
    """Take pairs (n, 2) in their order while both ends have fewer than `most` links; adds to `degrees`."""
    for pair in range(len(pairs)):
        one, other = pairs[pair, 0], pairs[pair, 1]
        accepted[pair] = degrees[one] < most and degrees[other] < most
        if accepted[pair]:
            degrees[one] += 1
            degrees[other] += 1
