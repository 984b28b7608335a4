"""Kernel of `strand_scores`: which points have a strand of the right direction near them."""

from __future__ import annotations

import numpy as np
from numba import prange

from ..kernels import device, parallel_kernel
from ..types import Bools, Float32, Float64, Int64


@parallel_kernel
def match_points(
    points: Float32,
    directions: Float32,
    starts: Float32,
    pieces: Float32,
    cell_starts: Int64,
    grid: tuple[Float64, float, Int64],
    thresholds: Float64,
    signed: bool,
    matched: Bools,
) -> None:
    """Mark matched[i, t] where a piece is within distance thresholds[t, 0] and cosine thresholds[t, 1] of point i.

    The pieces, vectors from `starts`, are sorted by the cell of their middle: cell_starts is a CSR of the grid (origin,
    cell size, counts), whose cells are at least as large as the largest distance and half a piece.
    """
    origin, size, counts = grid
    n_limits = len(thresholds)
    for index in prange(len(points)):
        own, low, high = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3, np.int64)
        inside = True
        for axis in range(3):
            own[axis] = int(np.floor((points[index, axis] - origin[axis]) / size))
            low[axis], high[axis] = max(own[axis] - 1, 0), min(own[axis] + 1, counts[axis] - 1)
            inside = inside and 0 <= own[axis] < counts[axis]
        missing = n_limits
        if inside:  # most matches are here
            cell = (own[0] * counts[1] + own[1]) * counts[2] + own[2]
            first, last = cell_starts[cell], cell_starts[cell + 1]
            missing = _match(
                points[index], directions[index], starts, pieces, first, last, thresholds, signed, matched[index]
            )
        for x in range(low[0], high[0] + 1):
            for y in range(low[1], high[1] + 1):
                if missing == 0 or low[2] > high[2]:
                    continue
                row = (x * counts[1] + y) * counts[2]
                first, last = cell_starts[row + low[2]], cell_starts[row + high[2] + 1]
                missing = _match(
                    points[index], directions[index], starts, pieces, first, last, thresholds, signed, matched[index]
                )


@device
def _match(
    point: Float32,
    heading: Float32,
    starts: Float32,
    pieces: Float32,
    first: int,
    last: int,
    thresholds: Float64,
    signed: bool,
    matched: Bools,
) -> int:
    """Compare a point with the pieces first .. last; returns how many thresholds it has not met yet."""
    widest, missing = 1.0, 0
    for t in range(len(thresholds)):
        if not matched[t]:
            widest, missing = min(widest, thresholds[t, 1]), missing + 1
    for other in range(first, last):
        if missing == 0:
            break
        square, along, cosine = 0.0, 0.0, 0.0
        for axis in range(3):
            piece = pieces[other, axis]
            square += piece * piece
            along += (point[axis] - starts[other, axis]) * piece
            cosine += heading[axis] * piece
        cosine /= np.sqrt(square)
        if not signed:
            cosine = abs(cosine)
        if cosine < widest:
            continue
        share = min(max(along / square, 0.0), 1.0)
        distance = 0.0
        for axis in range(3):
            aside = point[axis] - starts[other, axis] - share * pieces[other, axis]
            distance += aside * aside
        for t in range(len(thresholds)):
            near = distance <= thresholds[t, 0] * thresholds[t, 0]
            if near and cosine >= thresholds[t, 1] and not matched[t]:
                matched[t] = True
                missing -= 1
    return missing
