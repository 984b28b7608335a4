"""Kernels of `appearance`: values averaged along strands."""

from __future__ import annotations

import numba

from ..kernels import parallel_kernel
from ..types import Float32, Float64, Int32


@parallel_kernel
def average_along(
    values: Float32, weights: Float32, offsets: Int32, shares: Float64, out: Float32, out_weights: Float32
) -> None:
    """out (P, 3): weighted means of values (P, 3) over the points near each along its strand; out_weights (P,).

    shares (R,): what a point 0, 1 ... R - 1 points away counts. Where nothing is known, out is 0 with weight 0.
    """
    for s in numba.prange(len(offsets) - 1):
        for i in range(offsets[s], offsets[s + 1]):
            total, red, green, blue = 0.0, 0.0, 0.0, 0.0
            for j in range(max(offsets[s], i - len(shares) + 1), min(offsets[s + 1], i + len(shares))):
                weight = shares[abs(j - i)] * weights[j]
                total += weight
                red += weight * values[j, 0]
                green += weight * values[j, 1]
                blue += weight * values[j, 2]
            scale = 1.0 / total if total > 0.0 else 0.0
            out[i, 0], out[i, 1], out[i, 2] = scale * red, scale * green, scale * blue
            out_weights[i] = total
