"""Looking a direction grid up, for the kernels that trace strands.

One lookup serves sparse and dense grids: a dense grid is a single block. The arguments are `DirectionGrid`'s: origin
(3,) float64 and per_cell = 1 / spacing, shape (3 ints), blocks (BX, BY, BZ), cells = directions as a flat array,
shift = log2 of the cells along a block, strides = cells from one block, x and y to the next.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from ..geometry._scalp_space_kernels import arc_cotangent, bilinear
from ..kernels import device, inlined_device, parallel_kernel
from ..types import Floats, Int32

ZERO, ONE, TINY = np.float32(0.0), np.float32(1.0), np.float32(1e-6)


@device
def scalp_coordinates(x: float, y: float, z: float, elevation: Floats, height: Floats) -> tuple[float, float, float]:
    """(u, v, w) of the head-space point (x, y, z) as ScalpSpace.to_scalp has them, at half the cost.

    elevation (T,): tan u = elevation / x^, tan v = elevation / z^ for unit directions with y^ from -1 to 1 in equal
    steps (grid.elevation_table); without the remap of W-6 it is y^ + 1.
    """
    r = math.sqrt(x * x + y * y + z * z)
    inverse = 1.0 / max(r, 1e-30)
    last = len(elevation) - 1
    row = (y * inverse + 1.0) * (0.5 * last)
    i = min(max(int(row), 0), last - 1)
    rise = elevation[i] + (row - i) * (elevation[i + 1] - elevation[i])
    u, v = arc_cotangent(rise, x * inverse), arc_cotangent(rise, z * inverse)
    return u, v, r - bilinear(height, u, v)


@parallel_kernel
def map_to_cells(points: Floats, elevation: Floats, height: Floats, coordinates: Floats) -> None:
    """coordinates (S, N, 3): u, v, w of head-space points (S, N, 3)."""
    n_strands, n_points, _ = points.shape
    for strand in numba.prange(n_strands):
        for i in range(n_points):
            u, v, w = scalp_coordinates(
                points[strand, i, 0], points[strand, i, 1], points[strand, i, 2], elevation, height
            )  # fmt: skip
            coordinates[strand, i, 0], coordinates[strand, i, 1], coordinates[strand, i, 2] = u, v, w


@inlined_device
def mean_direction(
    x: float, y: float, z: float, shape: Any, blocks: Int32, cells: Floats, shift: int, strides: Any
) -> tuple[Any, Any, Any]:
    """The trilinear mean of the 8 cells around (x, y, z); cells outside the grid count as 0.

    x, y, z : in cells, 0 at the centre of the first one.
    """
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    fx, fy, fz = np.float32(x - i), np.float32(y - j), np.float32(z - k)
    vx = vy = vz = ZERO
    block = -1
    if i >= 0 and j >= 0 and k >= 0 and i + 1 < shape[0] and j + 1 < shape[1] and k + 1 < shape[2]:
        block = blocks[i >> shift, j >> shift, k >> shift]
    if block >= 0:
        # a block has copies of the neighbours' cells: a b c d are those at (0, 0), (0, 1), (1, 0), (1, 1) in (x, y)
        mask = (1 << shift) - 1
        a = 3 * (block * strides[0] + (i & mask) * strides[1] + (j & mask) * strides[2] + (k & mask))
        b, c = a + 3 * strides[2], a + 3 * strides[1]
        d = c + 3 * strides[2]
        gx, gy, gz = ONE - fx, ONE - fy, ONE - fz
        wa, wb, wc, wd = gx * gy, gx * fy, fx * gy, fx * fy
        low_x = wa * cells[a] + wb * cells[b] + wc * cells[c] + wd * cells[d]
        low_y = wa * cells[a + 1] + wb * cells[b + 1] + wc * cells[c + 1] + wd * cells[d + 1]
        low_z = wa * cells[a + 2] + wb * cells[b + 2] + wc * cells[c + 2] + wd * cells[d + 2]
        high_x = wa * cells[a + 3] + wb * cells[b + 3] + wc * cells[c + 3] + wd * cells[d + 3]
        high_y = wa * cells[a + 4] + wb * cells[b + 4] + wc * cells[c + 4] + wd * cells[d + 4]
        high_z = wa * cells[a + 5] + wb * cells[b + 5] + wc * cells[c + 5] + wd * cells[d + 5]
        vx, vy, vz = gz * low_x + fz * high_x, gz * low_y + fz * high_y, gz * low_z + fz * high_z
    elif i >= -1 and j >= -1 and k >= -1 and i < shape[0] and j < shape[1] and k < shape[2]:
        vx, vy, vz = _across_blocks(i, j, k, fx, fy, fz, shape, blocks, cells, shift, strides)
    return vx, vy, vz


@device
def unit_direction(
    a: float, b: float, c: float, origin: Floats, per_cell: float, shape: Any, blocks: Int32, cells: Floats,
    shift: int, strides: Any,
) -> tuple[Any, Any, Any]:  # fmt: skip
    """The unit direction at (a, b, c) in the space of the grid; 0 where the cells around have none."""
    x, y, z = (a - origin[0]) * per_cell - 0.5, (b - origin[1]) * per_cell - 0.5, (c - origin[2]) * per_cell - 0.5
    vx, vy, vz = mean_direction(x, y, z, shape, blocks, cells, shift, strides)
    size = math.sqrt(vx * vx + vy * vy + vz * vz)
    if size < TINY:
        return ZERO, ZERO, ZERO
    scale = ONE / size
    return vx * scale, vy * scale, vz * scale


@device
def _across_blocks(
    i: int, j: int, k: int, fx: float, fy: float, fz: float, shape: Any, blocks: Int32, cells: Floats, shift: int,
    strides: Any,
) -> tuple[Any, Any, Any]:  # fmt: skip
    """The trilinear mean where the first of the 8 cells lies in no block, or some lie outside the grid."""
    mask = (1 << shift) - 1
    vx = vy = vz = ZERO
    for corner in range(8):
        a, b, c = i + (corner >> 2), j + (corner >> 1 & 1), k + (corner & 1)
        if a < 0 or b < 0 or c < 0 or a >= shape[0] or b >= shape[1] or c >= shape[2]:
            continue
        block = blocks[a >> shift, b >> shift, c >> shift]
        if block >= 0:
            weight = (fx if corner & 4 else ONE - fx) * (fy if corner & 2 else ONE - fy)
            weight *= fz if corner & 1 else ONE - fz
            cell = 3 * (block * strides[0] + (a & mask) * strides[1] + (b & mask) * strides[2] + (c & mask))
            vx += weight * cells[cell]
            vy += weight * cells[cell + 1]
            vz += weight * cells[cell + 2]
    return vx, vy, vz
