"""Compiled loops over the strands of wisps."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numba
import numpy as np

from ..kernels import parallel_kernel
from ..types import Float32, Float64, Int32


@parallel_kernel
def average_members(samples: Float32, members: Int32, starts: Int32, centers: Any) -> None:
    """centers (K, N, 3): the means of the samples (S, N, 3) of each row's members."""
    n = samples.shape[1]
    for k in numba.prange(len(starts) - 1):
        total = np.zeros((n, 3))
        for m in range(starts[k], starts[k + 1]):
            strand = samples[members[m]]
            for i in range(n):
                for c in range(3):
                    total[i, c] += strand[i, c]
        count = starts[k + 1] - starts[k]
        for i in range(n):
            for c in range(3):
                centers[k, i, c] = total[i, c] / count


@parallel_kernel
def bound_wisps(
    points: Float32, offsets: Int32, members: Int32, starts: Int32, chosen: Int32, spheres: Float64
) -> None:
    """spheres (n, 4): the middle of the box around all points of each chosen row, and the farthest distance from it."""
    for a in numba.prange(len(chosen)):
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        first, last = starts[chosen[a]], starts[chosen[a] + 1]
        for m in range(first, last):
            for p in range(offsets[members[m]], offsets[members[m] + 1]):
                for c in range(3):
                    low[c] = min(low[c], points[p, c])
                    high[c] = max(high[c], points[p, c])
        farthest = 0.0
        for c in range(3):
            spheres[a, c] = 0.5 * (low[c] + high[c])
        for m in range(first, last):
            for p in range(offsets[members[m]], offsets[members[m] + 1]):
                square = 0.0
                for c in range(3):
                    square += (points[p, c] - spheres[a, c]) ** 2
                farthest = max(farthest, square)
        spheres[a, 3] = sqrt(farthest)


@parallel_kernel
def place_points(points: Float32, offsets: Int32, last: int, places: Float32, lengths: Float64) -> None:
    """places (P,): each point's share of its strand's arc length, times `last`; lengths (S,) of the strands."""
    for s in numba.prange(len(offsets) - 1):
        total = 0.0
        places[offsets[s]] = 0.0
        for p in range(offsets[s] + 1, offsets[s + 1]):
            square = 0.0
            for c in range(3):
                square += (np.float64(points[p, c]) - points[p - 1, c]) ** 2
            total += sqrt(square)
            places[p] = total
        lengths[s] = total
        scale = last / total if total > 0.0 else 0.0
        for p in range(offsets[s] + 1, offsets[s + 1]):
            places[p] = min(places[p] * scale, last)


@parallel_kernel
def measure_widths(
    points: Float32, offsets: Int32, members: Int32, starts: Int32, places: Float32, centers: Float32,
    means: Float64, most: Float64,
) -> None:  # fmt: skip
    """How far the hair of each center is from it: root mean square, in steps of the center, and at most.

    means (K,) samples; most (K,) metres.

    centers (K, N, 3); places (P,): where along its center each point lies, in samples.
    """
    n = centers.shape[1]
    for k in numba.prange(len(centers)):
        center = centers[k]
        total = length = farthest = 0.0
        count = 0
        for i in range(1, n):
            square = 0.0
            for c in range(3):
                square += (np.float64(center[i, c]) - center[i - 1, c]) ** 2
            length += sqrt(square)
        for m in range(starts[k], starts[k + 1]):
            for p in range(offsets[members[m]], offsets[members[m] + 1]):
                i = min(int(places[p]), n - 2)
                t = places[p] - i
                square = 0.0
                for c in range(3):
                    square += (points[p, c] - (1.0 - t) * center[i, c] - t * center[i + 1, c]) ** 2
                total += square
                farthest = max(farthest, square)
                count += 1
        step = length / (n - 1)
        means[k] = sqrt(total / max(count, 1)) / step if step > 0.0 else 0.0
        most[k] = sqrt(farthest)
