"""Kernels of `poisson`: blending of views, right-hand side and Chebyshev steps on the graph of texels."""

from __future__ import annotations

import numpy as np
from numba import prange
from numpy.typing import NDArray

from ..kernels import kernel, parallel_kernel
from ..types import Float32, Int32

UInt32 = NDArray[np.uint32]


@kernel
def write_neighbours(edges: Int32, neighbours: UInt32, degrees: Int32) -> None:
    """Both ends' neighbours (T, K), filled with the texels themselves at first, and their number, 0 at first."""
    for edge in range(len(edges)):
        one, other = edges[edge, 0], edges[edge, 1]
        neighbours[one, degrees[one]] = other
        neighbours[other, degrees[other]] = one
        degrees[one] += 1
        degrees[other] += 1


@kernel
def add_divergence(edges: Int32, gradients: Float32, out: Float32) -> None:
    """Add each edge's wanted step to its second texel and take it from its first."""
    for edge in range(len(edges)):
        one, other = np.uint32(edges[edge, 0]), np.uint32(edges[edge, 1])
        for channel in range(3):
            step = gradients[edge, channel]
            out[one, channel] -= step
            out[other, channel] += step


@parallel_kernel
def chebyshev_step(
    neighbours: UInt32,
    inverse_diagonal: Float32,
    screen: float,
    right_side: Float32,
    keep: float,
    add: float,
    values: Float32,
    steps: Float32,
    out: Float32,
) -> None:
    """out = values + steps, after steps = keep steps + add (right side - A values) / diagonal; A = screen + Laplacian.

    neighbours : (T, K); where a texel has fewer, the rest name the texel itself and add nothing.
    """
    width = neighbours.shape[1]
    centre = screen + np.float32(width)
    for texel in prange(len(values)):
        a, b, c = np.float32(0), np.float32(0), np.float32(0)
        for place in range(width):
            # unsigned, or each access would first ask for a negative index: four times slower
            other = np.uint32(neighbours[texel, place])
            a += values[other, 0]
            b += values[other, 1]
            c += values[other, 2]
        scale = add * inverse_diagonal[texel]
        x, y, z = values[texel, 0], values[texel, 1], values[texel, 2]
        dx = keep * steps[texel, 0] + scale * (right_side[texel, 0] + a - centre * x)
        dy = keep * steps[texel, 1] + scale * (right_side[texel, 1] + b - centre * y)
        dz = keep * steps[texel, 2] + scale * (right_side[texel, 2] + c - centre * z)
        steps[texel, 0], steps[texel, 1], steps[texel, 2] = dx, dy, dz
        out[texel, 0], out[texel, 1], out[texel, 2] = x + dx, y + dy, z + dz


@parallel_kernel
def blend_texels(
    colours: Float32, alpha: Float32, edges: Int32, first_edges: Int32, blended: Float32, gradients: Float32
) -> None:
    """The mean of the views' colours (n, T, 3) by alpha (n, T); on each texel's own edges the strongest view's steps.

    first_edges : (T + 1,), texel t owns the edges from first_edges[t] on, of which it is the first end.
    """
    n_views, n_texels = alpha.shape
    for texel in prange(n_texels):
        low, high = first_edges[texel], first_edges[texel + 1]
        best, largest = 0, np.float32(-1)
        a, b, c = np.float32(0), np.float32(0), np.float32(0)
        for view in range(n_views):
            weight = alpha[view, texel]
            x, y, z = colours[view, texel, 0], colours[view, texel, 1], colours[view, texel, 2]
            a += weight * x
            b += weight * y
            c += weight * z
            if weight <= 0:
                continue
            square = np.float32(0)
            for edge in range(low, high):
                other = np.uint32(edges[edge, 1])
                dx, dy, dz = colours[view, other, 0] - x, colours[view, other, 1] - y, colours[view, other, 2] - z
                square += dx * dx + dy * dy + dz * dz
            if weight * weight * square > largest:
                best, largest = view, weight * weight * square
        blended[texel, 0], blended[texel, 1], blended[texel, 2] = a, b, c
        for edge in range(low, high):
            other = np.uint32(edges[edge, 1])
            for channel in range(3):
                gradients[edge, channel] = colours[best, other, channel] - colours[best, texel, channel]
