"""Looking a direction grid up, for the kernels that trace strands.

One lookup serves sparse and dense grids: a dense grid is a single block. The arguments are `DirectionGrid`'s: origin
(3,) float64 and per_cell = 1 / spacing, shape (3 ints), blocks (BX, BY, BZ), cells = directions as a flat array, shift.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..kernels import device, inlined_device
from ..types import Floats, Int32

ZERO, ONE, TINY = np.float32(0.0), np.float32(1.0), np.float32(1e-6)


@inlined_device
def mean_direction(
    x: float, y: float, z: float, shape: Any, blocks: Int32, cells: Floats, shift: int
) -> tuple[float, float, float]:
    """The trilinear mean of the 8 cells around (x, y, z); cells outside the grid count as 0.

    x, y, z : in cells, 0 at the centre of the first one.
    """
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    fx, fy, fz = np.float32(x - i), np.float32(y - j), np.float32(z - k)
    gx, gy, gz = ONE - fx, ONE - fy, ONE - fz
    mask = (1 << shift) - 1
    vx = vy = vz = ZERO
    inside = i >= 0 and j >= 0 and k >= 0 and i + 1 < shape[0] and j + 1 < shape[1] and k + 1 < shape[2]
    if inside and i & mask != mask and j & mask != mask and k & mask != mask:
        block = blocks[i >> shift, j >> shift, k >> shift]
        if block >= 0:
            # the 8 cells lie in one block: a b c d are its cells at (0, 0), (0, 1), (1, 0), (1, 1) in (x, y)
            along_y, along_x = _strides(shape, mask)
            a0 = 3 * ((block << 3 * shift) + (i & mask) * along_x + (j & mask) * along_y + (k & mask))
            b0, c0 = a0 + 3 * along_y, a0 + 3 * along_x
            d0 = c0 + 3 * along_y
            wa, wb, wc, wd = gx * gy, gx * fy, fx * gy, fx * fy
            low_x = wa * cells[a0] + wb * cells[b0] + wc * cells[c0] + wd * cells[d0]
            low_y = wa * cells[a0 + 1] + wb * cells[b0 + 1] + wc * cells[c0 + 1] + wd * cells[d0 + 1]
            low_z = wa * cells[a0 + 2] + wb * cells[b0 + 2] + wc * cells[c0 + 2] + wd * cells[d0 + 2]
            high_x = wa * cells[a0 + 3] + wb * cells[b0 + 3] + wc * cells[c0 + 3] + wd * cells[d0 + 3]
            high_y = wa * cells[a0 + 4] + wb * cells[b0 + 4] + wc * cells[c0 + 4] + wd * cells[d0 + 4]
            high_z = wa * cells[a0 + 5] + wb * cells[b0 + 5] + wc * cells[c0 + 5] + wd * cells[d0 + 5]
            vx, vy, vz = gz * low_x + fz * high_x, gz * low_y + fz * high_y, gz * low_z + fz * high_z
    elif i >= -1 and j >= -1 and k >= -1 and i < shape[0] and j < shape[1] and k < shape[2]:
        vx, vy, vz = _across_blocks(i, j, k, fx, fy, fz, shape, blocks, cells, shift)
    return vx, vy, vz


@inlined_device
def unit_direction(
    a: float, b: float, c: float, origin: Floats, per_cell: float, shape: Any, blocks: Int32, cells: Floats, shift: int
) -> tuple[float, float, float]:
    """The unit direction at (a, b, c) in the space of the grid; 0 where the cells around have none."""
    x, y, z = (a - origin[0]) * per_cell - 0.5, (b - origin[1]) * per_cell - 0.5, (c - origin[2]) * per_cell - 0.5
    vx, vy, vz = mean_direction(x, y, z, shape, blocks, cells, shift)
    size = math.sqrt(vx * vx + vy * vy + vz * vz)
    if size < TINY:
        return ZERO, ZERO, ZERO
    scale = ONE / size
    return vx * scale, vy * scale, vz * scale


@inlined_device
def _strides(shape: Any, mask: int) -> tuple[int, int]:
    """Cells from one to the next along y and along x within a block."""
    along_y = min(mask + 1, shape[2])
    return along_y, along_y * min(mask + 1, shape[1])


@device
def _across_blocks(
    i: int, j: int, k: int, fx: float, fy: float, fz: float, shape: Any, blocks: Int32, cells: Floats, shift: int
) -> tuple[float, float, float]:
    """The trilinear mean where the 8 cells lie in several blocks or partly outside the grid."""
    mask = (1 << shift) - 1
    along_y, along_x = _strides(shape, mask)
    vx = vy = vz = ZERO
    for corner in range(8):
        a, b, c = i + (corner >> 2), j + (corner >> 1 & 1), k + (corner & 1)
        if a < 0 or b < 0 or c < 0 or a >= shape[0] or b >= shape[1] or c >= shape[2]:
            continue
        block = blocks[a >> shift, b >> shift, c >> shift]
        if block >= 0:
            weight = (fx if corner & 4 else ONE - fx) * (fy if corner & 2 else ONE - fy)
            weight *= fz if corner & 1 else ONE - fz
            cell = 3 * ((block << 3 * shift) + (a & mask) * along_x + (b & mask) * along_y + (c & mask))
            vx += weight * cells[cell]
            vy += weight * cells[cell + 1]
            vz += weight * cells[cell + 2]
    return vx, vy, vz
