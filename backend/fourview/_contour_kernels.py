"""Kernels of `contours`: order-preserving matching of two closed outlines by dynamic programming (M-32)."""

from __future__ import annotations

import math

import numba
import numpy as np

from ..kernels import device, kernel, parallel_kernel
from ..types import Float64, Int64

_BOTH, _FIRST, _SECOND = 0, 1, 2


@parallel_kernel
def cyclic_costs(cost: Float64, starts: Int64, standstill: float, out: Float64) -> None:
    """out (k,): the cost of the best matching that pairs point 0 of the first outline with each start of the second."""
    for i in numba.prange(len(starts)):
        out[i] = _fill(cost, starts[i], standstill, np.empty((cost.shape[0] + 1, cost.shape[1] + 1), np.int8))


@kernel
def cyclic_path(cost: Float64, start: int, standstill: float, first: Int64, last: Int64) -> None:
    """first, last (n,): the run of points of the second outline (counted on beyond its end) matched to each point.

    cost : (n, m), of pairing point i with point j. standstill : added where one of the two stays at its point.
    """
    n, m = cost.shape
    step = np.empty((n + 1, m + 1), np.int8)
    _fill(cost, start, standstill, step)
    i, j = n, m
    for k in range(n):
        first[k], last[k] = -1, -1
    while i > 0 or j > 0:
        # point n is point 0 again, so the last row belongs to it
        if i < n:
            first[i] = start + j
            last[i] = max(last[i], start + j)
        taken = step[i, j]
        if taken != _SECOND:
            i -= 1
        if taken != _FIRST:
            j -= 1
    first[0] = start
    last[0] = max(last[0], start)


@device
def _fill(cost, start, standstill, step):  # type: ignore[no-untyped-def]
    n, m = cost.shape
    before = np.empty(m + 1)
    now = np.empty(m + 1)
    before[0] = cost[0, start % m]
    step[0, 0] = _BOTH
    for j in range(1, m + 1):
        before[j] = before[j - 1] + cost[0, (start + j) % m] + standstill
        step[0, j] = _SECOND
    for i in range(1, n + 1):
        for j in range(m + 1):
            pair = cost[i % n, (start + j) % m]
            best, taken = before[j] + standstill, _FIRST
            if j > 0:
                if now[j - 1] + standstill < best:
                    best, taken = now[j - 1] + standstill, _SECOND
                if before[j - 1] <= best:
                    best, taken = before[j - 1], _BOTH
            now[j] = best + pair
            step[i, j] = taken
        before, now = now, before
    return before[m] if n > 0 else math.inf
