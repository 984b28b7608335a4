"""Looking a `HairSpace` up, for the kernels that grow and bend strands."""

from __future__ import annotations

import numba

from ..kernels import device, parallel_kernel
from ..types import Float32, Float64, Floats

N_VALUES = 19  # 4 distances, 3 of the direction, 4 gradients
SHAPE, HEAD, OUTER, SCALP, DIRECTION, GRADIENTS = 0, 1, 2, 3, 4, 7


@device
def sample_space(
    distances: Float32, directions: Float32, origin: Float64, cell: float, x: float, y: float, z: float, values: Float64
) -> None:
    """values (19,): 4 distances, the direction (not normalised), 4 gradients at (x, y, z), clamped into the grid."""
    last_x, last_y, last_z = distances.shape[0] - 1, distances.shape[1] - 1, distances.shape[2] - 1
    a = min(max((x - origin[0]) / cell, 0.0), last_x - 1e-9)
    b = min(max((y - origin[1]) / cell, 0.0), last_y - 1e-9)
    c = min(max((z - origin[2]) / cell, 0.0), last_z - 1e-9)
    i, j, k = int(a), int(b), int(c)
    fx, fy, fz = a - i, b - j, c - k
    for n in range(N_VALUES):
        values[n] = 0.0
    for corner in range(8):
        di, dj, dk = corner >> 2, corner >> 1 & 1, corner & 1
        wx = fx if di else 1.0 - fx
        wy = fy if dj else 1.0 - fy
        wz = fz if dk else 1.0 - fz
        gx = (1.0 if di else -1.0) * wy * wz / cell
        gy = (1.0 if dj else -1.0) * wx * wz / cell
        gz = (1.0 if dk else -1.0) * wx * wy / cell
        weight = wx * wy * wz
        for n in range(4):
            value = float(distances[i + di, j + dj, k + dk, n])
            values[n] += weight * value
            values[GRADIENTS + 3 * n] += gx * value
            values[GRADIENTS + 3 * n + 1] += gy * value
            values[GRADIENTS + 3 * n + 2] += gz * value
        for n in range(3):
            values[DIRECTION + n] += weight * directions[i + di, j + dj, k + dk, n]


@device
def leave_head(
    point: Floats, clearance: float, spare: float, distances: Float32, directions: Float32, origin: Float64,
    cell: float, values: Float64,
) -> None:  # fmt: skip
    """Move point (3,) `clearance` off the head, and `spare` further where it was not; values are its own afterwards."""
    for _ in range(4):
        sample_space(distances, directions, origin, cell, point[0], point[1], point[2], values)
        deep = clearance - values[HEAD]
        if deep <= 0.0:
            return
        g = GRADIENTS + 3 * HEAD
        square = values[g] * values[g] + values[g + 1] * values[g + 1] + values[g + 2] * values[g + 2]
        if square < 0.05:
            return
        for axis in range(3):
            point[axis] += (deep + spare) * values[g + axis] / square


@parallel_kernel
def sample_places(
    distances: Float32, directions: Float32, origin: Float64, cell: float, points: Float64, values: Float64
) -> None:
    """values (n, 19) at points (n, 3)."""
    for i in numba.prange(len(points)):
        sample_space(
            distances, directions, origin, cell, points[i, 0], points[i, 1], points[i, 2], values[i]
        )  # fmt: skip
