"""Kernels of `geometry.strands`: resampling and subdivision of ragged strands."""

from __future__ import annotations

import math

import numba
import numpy as np

from ..kernels import parallel_kernel
from ..types import Floats, Int32


@parallel_kernel
def resample_values(points: Floats, offsets: Int32, values: Floats, out: Floats) -> None:
    """Fill out (S, N, C) with values (P, C) interpolated at N equal steps of arc length of points (P, 3).

    A strand's work is its own, so the result does not depend on the thread count.
    """
    n_strands, n_samples, n_channels = out.shape
    for strand in numba.prange(n_strands):
        first = offsets[strand]
        last = offsets[strand + 1] - 1
        reached = np.zeros(last - first + 1)
        for i in range(first, last):
            squared = 0.0
            for axis in range(3):
                step = float(points[i + 1, axis]) - float(points[i, axis])
                squared += step * step
            reached[i + 1 - first] = reached[i - first] + math.sqrt(squared)
        total = reached[last - first]
        segment = 0
        for sample in range(n_samples):
            if sample == 0 or total == 0.0:
                for channel in range(n_channels):
                    out[strand, sample, channel] = values[first, channel]
                continue
            if sample == n_samples - 1:
                for channel in range(n_channels):
                    out[strand, sample, channel] = values[last, channel]
                continue
            target = total * sample / (n_samples - 1)
            while segment < last - first - 1 and reached[segment + 1] < target:
                segment += 1
            length = reached[segment + 1] - reached[segment]
            share = min((target - reached[segment]) / length, 1.0) if length > 0.0 else 0.0
            for channel in range(n_channels):
                start = np.float64(values[first + segment, channel])
                end = np.float64(values[first + segment + 1, channel])
                out[strand, sample, channel] = start + (end - start) * share


@parallel_kernel
def subdivide_points(points: Floats, offsets: Int32, finer_offsets: Int32, factor: int, out: Floats) -> None:
    """Fill out (Q, 3) with `factor` points a segment of the Catmull-Rom curves through points (P, 3), ends kept.

    Beyond its ends a strand goes on with its end point, as Blender's Catmull-Rom curves do.
    """
    for strand in numba.prange(len(offsets) - 1):
        first, last = offsets[strand], offsets[strand + 1] - 1
        place = finer_offsets[strand]
        for i in range(first, last):
            before, after = max(i - 1, first), min(i + 2, last)
            for k in range(factor):
                t = k / factor
                a = ((2.0 - t) * t - 1.0) * t
                b = (3.0 * t - 5.0) * t * t + 2.0
                c = ((4.0 - 3.0 * t) * t + 1.0) * t
                d = (t - 1.0) * t * t
                for axis in range(3):
                    value = a * points[before, axis] + b * points[i, axis] + c * points[i + 1, axis]
                    out[place + k, axis] = 0.5 * (value + d * points[after, axis])
            place += factor
        for axis in range(3):
            out[place, axis] = points[last, axis]
