"""Kernel of `geometry.strands`: resampling of ragged strands."""

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
