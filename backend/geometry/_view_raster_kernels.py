"""Kernel of `view_raster`: a z-buffer in bands of rows, each band the work of one thread."""

from __future__ import annotations

import numpy as np
from numba import prange

from ..kernels import parallel_kernel
from ..types import Float32, Float64, Int32

BAND = 32  # rows
EDGE = 1e-9  # share of the triangle's area: pixel middles on a common edge belong to both, so that no seam is open


@parallel_kernel
def fill_triangles(
    pixels: Float64,
    triangles: Int32,
    perspective: bool,
    triangle: Int32,
    depth: Float32,
    barycentric: Float32,
) -> None:
    """Draw triangles with corners `pixels` (V, 3: x, y, depth) into the pictures, which come filled with -1, inf, 0.

    Of equally deep triangles the first stays. Triangles with a corner that is not finite are left out.
    """
    height, width = triangle.shape
    for band in prange((height + BAND - 1) // BAND):
        top, bottom = band * BAND, min(height, (band + 1) * BAND)
        for index in range(len(triangles)):
            a, b, c = pixels[triangles[index, 0]], pixels[triangles[index, 1]], pixels[triangles[index, 2]]
            area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
            if not (abs(area) > 1e-12 and np.isfinite(area)):
                continue
            low, high = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
            first, last = max(top, int(np.ceil(low - 0.5))), min(bottom - 1, int(np.floor(high - 0.5)))
            left = max(0, int(np.ceil(min(a[0], b[0], c[0]) - 0.5)))
            right = min(width - 1, int(np.floor(max(a[0], b[0], c[0]) - 0.5)))
            for row in range(first, last + 1):
                y = row + 0.5
                for column in range(left, right + 1):
                    x = column + 0.5
                    u = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area
                    v = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area
                    w = 1.0 - u - v
                    if u < -EDGE or v < -EDGE or w < -EDGE:
                        continue
                    if perspective:
                        u, v, w = u / a[2], v / b[2], w / c[2]
                        total = u + v + w
                        u, v, w = u / total, v / total, w / total
                    deep = np.float32(u * a[2] + v * b[2] + w * c[2])
                    if deep < depth[row, column]:
                        depth[row, column] = deep
                        triangle[row, column] = index
                        barycentric[row, column, 0] = u
                        barycentric[row, column, 1] = v
                        barycentric[row, column, 2] = w
