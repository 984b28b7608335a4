"""Kernels of `fields.tracing`: Euler streamlines through a direction grid (W-26).

A grid is handed over as: is_scalp, elevation and height of its scalp space (see scalp_coordinates), then origin (3,)
float64, per_cell, shape, blocks, cells, shift and strides (see _lookup_kernels).
A strand's work is its own and uses its own input only, so results do not depend on the thread count.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from ..kernels import device, parallel_kernel
from ..types import Floats, Int32
from ._lookup_kernels import TINY, mean_direction, scalp_coordinates

N_PARTITIONS = 64  # fixed, so that the work is dealt out alike for any number of threads


@device
def _streamline(
    root: Floats, length: float, step: float, is_scalp: bool, elevation: Floats, height: Floats, origin: Floats,
    per_cell: float, shape: Any, blocks: Int32, cells: Floats, shift: int, strides: Any, line: Floats,
) -> int:  # fmt: skip
    """Fill line (K, 3) with Euler steps from the root up to `length`; returns the number of points.

    The loop runs in the space of the grid's cells where it can: its speed is that of the chain from step to step.
    """
    x, y, z = np.float64(root[0]), np.float64(root[1]), np.float64(root[2])
    line[0, 0], line[0, 1], line[0, 2] = x, y, z
    unit, at_x, at_y, at_z = 1.0, 0.0, 0.0, 0.0
    middle_x, middle_y, middle_z = origin[0] + 0.5 / per_cell, origin[1] + 0.5 / per_cell, origin[2] + 0.5 / per_cell
    if not is_scalp:
        unit, at_x, at_y, at_z = 1.0 / per_cell, middle_x, middle_y, middle_z
        x, y, z = (x - at_x) * per_cell, (y - at_y) * per_cell, (z - at_z) * per_cell
    for count in range(1, len(line)):
        stride = min(step, length - (count - 1) * step)
        if stride <= 1e-9 * step:
            return count
        a, b, c = x, y, z
        if is_scalp:
            a, b, c = scalp_coordinates(x, y, z, elevation, height)
            a, b, c = (a - middle_x) * per_cell, (b - middle_y) * per_cell, (c - middle_z) * per_cell
        vx, vy, vz = mean_direction(a, b, c, shape, blocks, cells, shift, strides)
        size = math.sqrt(vx * vx + vy * vy + vz * vz)
        if size < TINY:
            return count
        scale = np.float32(stride / unit) / size
        x += vx * scale
        y += vy * scale
        z += vz * scale
        line[count, 0], line[count, 1], line[count, 2] = x * unit + at_x, y * unit + at_y, z * unit + at_z
    return len(line)


@parallel_kernel
def trace_lines(
    roots: Floats, lengths: Floats, step: float, order: Int32, is_scalp: bool, elevation: Floats, height: Floats,
    origin: Floats, per_cell: float, shape: Any, blocks: Int32, cells: Floats, shift: int, strides: Any,
    lines: Floats, counts: Int32,
) -> None:  # fmt: skip
    """lines (S, K, 3): the Euler points of each strand, the last one repeated; counts (S,): how many there are.

    order (S,): the strands, neighbours after each other, so that they find the cells that they share in the cache.
    """
    n_strands = len(roots)
    for partition in numba.prange(N_PARTITIONS):
        for rank in range(partition * n_strands // N_PARTITIONS, (partition + 1) * n_strands // N_PARTITIONS):
            strand = order[rank]
            line = lines[strand]
            count = _streamline(
                roots[strand], lengths[strand], step, is_scalp, elevation, height, origin, per_cell, shape, blocks,
                cells, shift, strides, line,
            )  # fmt: skip
            counts[strand] = count
            for i in range(count, len(line)):
                line[i, 0], line[i, 1], line[i, 2] = line[count - 1, 0], line[count - 1, 1], line[count - 1, 2]


@parallel_kernel
def trace_spaced(
    roots: Floats, lengths: Floats, step: float, order: Int32, is_scalp: bool, elevation: Floats, height: Floats,
    origin: Floats, per_cell: float, shape: Any, blocks: Int32, cells: Floats, shift: int, strides: Any,
    longest: int, points: Floats, reached: Floats,
) -> None:  # fmt: skip
    """points (S, N, 3): each strand at N equal steps of arc length; reached (S,): its length.

    longest : Euler points of the longest strand. order : see trace_lines.
    """
    n_strands = len(roots)
    for partition in numba.prange(N_PARTITIONS):
        line = np.empty((longest, 3))
        for rank in range(partition * n_strands // N_PARTITIONS, (partition + 1) * n_strands // N_PARTITIONS):
            strand = order[rank]
            count = _streamline(
                roots[strand], lengths[strand], step, is_scalp, elevation, height, origin, per_cell, shape, blocks,
                cells, shift, strides, line,
            )  # fmt: skip
            respace(line, count, points[strand])
            reached[strand] = min((count - 1) * step, lengths[strand])


@device
def copy_rows(source: Floats, target: Floats) -> None:
    """target (N, 3) = source (N, 3); an array assignment in a parallel kernel takes ten seconds to compile."""
    for i in range(len(target)):
        target[i, 0], target[i, 1], target[i, 2] = source[i, 0], source[i, 1], source[i, 2]


@device
def respace(line: Floats, count: int, out: Floats) -> None:
    """out (N, 3): N points at equal arc length along the first `count` points of line."""
    total = 0.0
    for i in range(count - 1):
        dx, dy, dz = line[i + 1, 0] - line[i, 0], line[i + 1, 1] - line[i, 1], line[i + 1, 2] - line[i, 2]
        total += math.sqrt(dx * dx + dy * dy + dz * dz)
    i, passed, length = -1, 0.0, 0.0
    for sample in range(len(out)):
        target = total * sample / (len(out) - 1)
        while i < 0 or (passed + length < target and i < count - 2):
            passed += length
            i += 1
            after = min(i + 1, count - 1)
            dx, dy, dz = line[after, 0] - line[i, 0], line[after, 1] - line[i, 1], line[after, 2] - line[i, 2]
            length = math.sqrt(dx * dx + dy * dy + dz * dz)
        share = min((target - passed) / length, 1.0) if length > 0.0 else 0.0
        after = min(i + 1, count - 1)
        for axis in range(3):
            out[sample, axis] = line[i, axis] + share * (line[after, axis] - line[i, axis])
