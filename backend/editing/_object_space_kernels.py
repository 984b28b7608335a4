"""Kernels of `editing.object_space`."""

from __future__ import annotations

import numba

from ..kernels import parallel_kernel
from ..types import Float32, Float64


@parallel_kernel
def place_moved(
    points: Float32, points_before: Float32, positions_before: Float32, matrix: Float64, positions: Float32
) -> None:
    """Fill positions (P, 3) with matrix (4, 4) times points where they moved, else with positions_before."""
    for i in numba.prange(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        still = x == points_before[i, 0] and y == points_before[i, 1] and z == points_before[i, 2]
        for axis in range(3):
            if still:
                positions[i, axis] = positions_before[i, axis]
            else:
                positions[i, axis] = matrix[axis, 0] * x + matrix[axis, 1] * y + matrix[axis, 2] * z + matrix[axis, 3]
