"""The peak of a bank of filter responses at every pixel."""

from __future__ import annotations

import math

import numba
import numpy as np

from ..kernels import parallel_kernel
from ..types import Float32


@parallel_kernel
def find_peaks(responses: Float32, angle: Float32, confidence: Float32) -> None:
    """Angle of the largest response, between the filters by a parabola, and sqrt(sum d (F - F_max)^2) (M-37).

    responses : (K, H, W) for lines at angle pi k / K; negative ones count as 0. angle, confidence : (H, W), written.
    """
    count, height, width = responses.shape
    step = math.pi / count
    for row in numba.prange(height):
        values = np.empty(count, np.float32)
        for column in range(width):
            best = 0
            for k in range(count):
                values[k] = max(responses[k, row, column], np.float32(0.0))
                if values[k] > values[best]:
                    best = k
            top = values[best]
            total = np.float32(0.0)
            for k in range(count):
                apart = abs(k - best)
                total += np.float32(min(apart, count - apart) * step) * (values[k] - top) ** 2
            before, after = values[(best - 1) % count], values[(best + 1) % count]
            bend = before - 2.0 * top + after
            shift = 0.5 * (before - after) / bend if bend < -1e-12 else 0.0
            angle[row, column] = (best + min(max(shift, -0.5), 0.5)) * step
            confidence[row, column] = math.sqrt(total)
