"""Kernel of `fields.tracing.follow`: streamlines that keep to the shape of the strand that they replace (W-A3).

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
from ._lookup_kernels import ZERO, scalp_coordinates, unit_direction
from ._tracing_kernels import N_PARTITIONS, copy_rows, respace


@device
def _trust(cosine: float, full_cosine: float, none_cosine: float) -> float:
    """How far the field is trusted that turns away from the strand by this much: 1, then falling to 0."""
    if cosine >= full_cosine:
        return 1.0
    return max(0.0, (cosine - none_cosine) / (full_cosine - none_cosine))


@device
def _blend(
    ox: float, oy: float, oz: float, fx: float, fy: float, fz: float, weight: float, full_cosine: float,
    none_cosine: float,
) -> tuple[float, float, float]:  # fmt: skip
    """The unit direction between the strand's own unit direction o and the field's f (0: no field there)."""
    weight *= _trust(ox * fx + oy * fy + oz * fz, full_cosine, none_cosine)
    if fx == ZERO and fy == ZERO and fz == ZERO:
        weight = 0.0
    dx, dy, dz = ox + weight * (fx - ox), oy + weight * (fy - oy), oz + weight * (fz - oz)
    size = math.sqrt(dx * dx + dy * dy + dz * dz)
    if size < 1e-6:
        return ox, oy, oz
    return dx / size, dy / size, dz / size


@device
def _push_out(
    x: float, y: float, z: float, w: float, own: Floats, i: int, share: float, clearance: float, elevation: Floats,
    height: Floats,
) -> Any:  # fmt: skip
    """How much farther from the centre (x, y, z) at height w must be; not above the strand's own height there."""
    ox = own[i, 0] + share * (own[i + 1, 0] - own[i, 0])
    oy = own[i, 1] + share * (own[i + 1, 1] - own[i, 1])
    oz = own[i, 2] + share * (own[i + 1, 2] - own[i, 2])
    _, _, own_w = scalp_coordinates(ox, oy, oz, elevation, height)
    return max(0.0, min(clearance, own_w) - w)


@device
def _follow(
    own: Floats, weight: float, step: float, full_cosine: float, none_cosine: float, clearance: float, above: float,
    fill_gaps: bool, is_scalp: bool, elevation: Floats, height: Floats, origin: Floats, per_cell: float, shape: Any,
    blocks: Int32, cells: Floats, shift: int, strides: Any, line: Floats,
) -> int:  # fmt: skip
    """Fill line (N, 3) with a streamline that has a point for each of own (N, 3); returns the number of points.

    above : a distance from the centre beyond which every point is higher than `clearance` over the scalp.
    """
    x, y, z = np.float64(own[0, 0]), np.float64(own[0, 1]), np.float64(own[0, 2])
    line[0, 0], line[0, 1], line[0, 2] = x, y, z
    a, b, c = x, y, z
    if is_scalp:
        a, b, c = scalp_coordinates(x, y, z, elevation, height)
    for i in range(len(own) - 1):
        sx, sy, sz = own[i + 1, 0] - own[i, 0], own[i + 1, 1] - own[i, 1], own[i + 1, 2] - own[i, 2]
        length = math.sqrt(sx * sx + sy * sy + sz * sz)
        n_steps = max(1, int(length / step + 0.5)) if length > 0.0 else 0
        for part in range(n_steps):
            fx, fy, fz = unit_direction(a, b, c, origin, per_cell, shape, blocks, cells, shift, strides)
            if not fill_gaps and fx == ZERO and fy == ZERO and fz == ZERO:
                line[i + 1, 0], line[i + 1, 1], line[i + 1, 2] = x, y, z
                return i + 2 if part > 0 else i + 1
            dx, dy, dz = _blend(
                sx / length, sy / length, sz / length, fx, fy, fz, weight, full_cosine, none_cosine
            )  # fmt: skip
            stride = length / n_steps
            x += stride * dx
            y += stride * dy
            z += stride * dz
            a, b, c = x, y, z
            r = math.sqrt(x * x + y * y + z * z)
            if is_scalp or r < above:
                u, v, w = scalp_coordinates(x, y, z, elevation, height)
                if w < clearance:
                    push = _push_out(
                        x, y, z, w, own, i, (part + 1) / n_steps, clearance, elevation, height
                    )  # fmt: skip
                    w += push
                    x, y, z = x + x / r * push, y + y / r * push, z + z / r * push
                a, b, c = (u, v, w) if is_scalp else (x, y, z)
        line[i + 1, 0], line[i + 1, 1], line[i + 1, 2] = x, y, z
    return len(own)


@device
def _redraw(
    own: Floats, weight: float, step: float, full_cosine: float, none_cosine: float, clearance: float, above: float,
    fill_gaps: bool, is_scalp: bool, elevation: Floats, height: Floats, origin: Floats, per_cell: float, shape: Any,
    blocks: Int32, cells: Floats, shift: int, strides: Any, line: Floats, points: Floats,
) -> Any:  # fmt: skip
    """Fill points (N, 3), using line (N, 3) of float64; returns how many points the strand had before it ended."""
    if weight <= 0.0:
        copy_rows(own, points)
        return len(own)
    count = _follow(
        own, weight, step, full_cosine, none_cosine, clearance, above, fill_gaps, is_scalp, elevation, height, origin,
        per_cell, shape, blocks, cells, shift, strides, line,
    )  # fmt: skip
    if count < len(own):
        respace(line, count, points)
    else:
        copy_rows(line, points)
    return count


@parallel_kernel
def follow_strands(
    own: Floats, weights: Floats, step: float, full_cosine: float, none_cosine: float, clearance: float,
    above: float, fill_gaps: bool, order: Int32, is_scalp: bool, elevation: Floats, height: Floats, origin: Floats,
    per_cell: float, shape: Any, blocks: Int32, cells: Floats, shift: int, strides: Any, points: Floats,
    counts: Int32,
) -> None:  # fmt: skip
    """points (S, N, 3) of the strands own (S, N, 3) redrawn along the field; counts (S,): points before it ended.

    weights (S,): how much of the field goes into the direction. A strand of weight 0 is copied.
    """
    n_strands, n_points, _ = own.shape
    for partition in numba.prange(N_PARTITIONS):
        line = np.empty((n_points, 3))
        for rank in range(partition * n_strands // N_PARTITIONS, (partition + 1) * n_strands // N_PARTITIONS):
            strand = order[rank]
            counts[strand] = _redraw(
                own[strand], weights[strand], step, full_cosine, none_cosine, clearance, above, fill_gaps, is_scalp,
                elevation, height, origin, per_cell, shape, blocks, cells, shift, strides, line, points[strand],
            )  # fmt: skip
