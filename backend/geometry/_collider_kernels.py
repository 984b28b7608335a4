"""Numba functions of `collider`: looking its grid up, for the kernels of deformation and comb too.

The arguments are `Collider`'s: distance (X, Y, Z) float32 at the nodes, origin (3,) float64 and cell, metres. Between
nodes the distance is trilinear; the sums are in float64. Outside the grid's box it is FAR_OUTSIDE, and its gradient 0.
"""

from __future__ import annotations

import math
from typing import Any

import numba

from ..kernels import inlined_device, kernel, parallel_kernel
from ..types import Bools, Float32, Float64

FAR_OUTSIDE = 1e9  # metres


@inlined_device
def sample_distance(distance: Float32, origin: Float64, cell: float, x: float, y: float, z: float) -> Any:
    """The signed distance at the world position (x, y, z), metres."""
    a, b, c = (x - origin[0]) / cell, (y - origin[1]) / cell, (z - origin[2]) / cell
    last_x, last_y, last_z = distance.shape[0] - 1, distance.shape[1] - 1, distance.shape[2] - 1
    value = FAR_OUTSIDE
    # NaN is in no box either
    if a >= 0.0 and b >= 0.0 and c >= 0.0 and a <= last_x and b <= last_y and c <= last_z:
        i, j, k = min(int(a), last_x - 1), min(int(b), last_y - 1), min(int(c), last_z - 1)
        fx, fy, fz = a - i, b - j, c - k
        gx, gy, gz = 1.0 - fx, 1.0 - fy, 1.0 - fz
        # each along z, at the four corners of the cell in (x, y)
        v00 = gz * distance[i, j, k] + fz * distance[i, j, k + 1]
        v01 = gz * distance[i, j + 1, k] + fz * distance[i, j + 1, k + 1]
        v10 = gz * distance[i + 1, j, k] + fz * distance[i + 1, j, k + 1]
        v11 = gz * distance[i + 1, j + 1, k] + fz * distance[i + 1, j + 1, k + 1]
        value = gx * (gy * v00 + fy * v01) + fx * (gy * v10 + fy * v11)
    return value


@inlined_device
def sample_gradient(distance: Float32, origin: Float64, cell: float, x: float, y: float, z: float) -> Any:
    """(gx, gy, gz), the gradient of the trilinear distance at (x, y, z): about 1 long, outwards, not normalised."""
    a, b, c = (x - origin[0]) / cell, (y - origin[1]) / cell, (z - origin[2]) / cell
    last_x, last_y, last_z = distance.shape[0] - 1, distance.shape[1] - 1, distance.shape[2] - 1
    along_x = along_y = along_z = 0.0
    if a >= 0.0 and b >= 0.0 and c >= 0.0 and a <= last_x and b <= last_y and c <= last_z:
        i, j, k = min(int(a), last_x - 1), min(int(b), last_y - 1), min(int(c), last_z - 1)
        fx, fy, fz = a - i, b - j, c - k
        gx, gy, gz = 1.0 - fx, 1.0 - fy, 1.0 - fz
        # float64 before the differences: neighbours are nearly equal
        d000, d001 = float(distance[i, j, k]), float(distance[i, j, k + 1])
        d010, d011 = float(distance[i, j + 1, k]), float(distance[i, j + 1, k + 1])
        d100, d101 = float(distance[i + 1, j, k]), float(distance[i + 1, j, k + 1])
        d110, d111 = float(distance[i + 1, j + 1, k]), float(distance[i + 1, j + 1, k + 1])
        v00, v01 = gz * d000 + fz * d001, gz * d010 + fz * d011
        v10, v11 = gz * d100 + fz * d101, gz * d110 + fz * d111
        along_x = (gy * (v10 - v00) + fy * (v11 - v01)) / cell
        along_y = (gx * (v01 - v00) + fx * (v11 - v10)) / cell
        w00, w01, w10, w11 = d001 - d000, d011 - d010, d101 - d100, d111 - d110
        along_z = (gx * (gy * w00 + fy * w01) + fx * (gy * w10 + fy * w11)) / cell
    return along_x, along_y, along_z


@parallel_kernel
def sample_distances(distance: Float32, origin: Float64, cell: float, points: Float64, values: Float64) -> None:
    """values (n,): the signed distance at points (n, 3), metres."""
    for i in numba.prange(len(points)):
        values[i] = sample_distance(distance, origin, cell, points[i, 0], points[i, 1], points[i, 2])


@parallel_kernel
def sample_gradients(distance: Float32, origin: Float64, cell: float, points: Float64, gradients: Float64) -> None:
    """gradients (n, 3): those of the distance at points (n, 3)."""
    for i in numba.prange(len(points)):
        gradients[i, 0], gradients[i, 1], gradients[i, 2] = sample_gradient(
            distance, origin, cell, points[i, 0], points[i, 1], points[i, 2]
        )


@kernel
def mark_crossed_cells(corners: Float64, near: Bools) -> None:
    """Mark in near (X, Y, Z) the 8 nodes of each cell that triangles with corners (m, 3, 3), in cells, pass through.

    Those that a triangle's plane crosses within its bounding box: all that it passes through and few others.
    """
    low, high = [0, 0, 0], [0, 0, 0]
    for t in range(len(corners)):
        for axis in range(3):
            p, q, r = corners[t, 0, axis], corners[t, 1, axis], corners[t, 2, axis]
            last = near.shape[axis] - 2
            # clipped as numbers, since a triangle may lie farther off than integers reach
            low[axis] = math.floor(min(max(min(p, q, r), 0.0), last + 1.0))
            high[axis] = math.floor(min(max(max(p, q, r), -1.0), float(last)))
        ux, uy, uz = corners[t, 1] - corners[t, 0]
        vx, vy, vz = corners[t, 2] - corners[t, 0]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        # half a cell's extent along the normal, and a little for rounding
        reach = (0.5 + 1e-9) * (abs(nx) + abs(ny) + abs(nz))
        for i in range(low[0], high[0] + 1):
            for j in range(low[1], high[1] + 1):
                first = nx * (i + 0.5 - corners[t, 0, 0]) + ny * (j + 0.5 - corners[t, 0, 1]) - nz * corners[t, 0, 2]
                for k in range(low[2], high[2] + 1):
                    if abs(first + nz * (k + 0.5)) <= reach:
                        near[i : i + 2, j : j + 2, k : k + 2] = True
