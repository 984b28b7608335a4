"""Compiled loops of texture optimisation; `texture.py` explains the method.

Images are (H, W, C) float32; a patch is a window of `weight_rows` x `weight_columns` cells named by its first cell. Its
weights are the products of the two one-dimensional falloffs. Every output value is computed by one thread in one order.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from ..kernels import device, parallel_kernel

_BLOCK = 64  # bounds whose minimum is remembered together, so that the next smallest is found without a full scan


@parallel_kernel
def gather_patches(image: Any, corners: Any, weight_rows: Any, weight_columns: Any) -> Any:
    """Patches (P, h * w * C) float32, each cell times the square root of its weight."""
    n_rows, n_columns, n_channels = len(weight_rows), len(weight_columns), image.shape[2]
    patches = np.empty((len(corners), n_rows * n_columns * n_channels), np.float32)
    for p in numba.prange(len(corners)):
        at = 0
        for i in range(n_rows):
            for j in range(n_columns):
                scale = np.float32(np.sqrt(weight_rows[i] * weight_columns[j]))
                for c in range(n_channels):
                    patches[p, at] = scale * image[corners[p, 0] + i, corners[p, 1] + j, c]
                    at += 1
    return patches


@device
def _distance(
    image: Any, at: Any, example: Any, source: Any, weight_rows: Any, weight_columns: Any, limit: float
) -> float:
    """Weighted squared distance of the patch of `image` at `at` and that of `example` at `source`.

    Stops early with some value of at least `limit` once the sum has reached it.
    """
    n_channels = image.shape[2]
    row_sums = np.zeros(n_channels, np.float32)
    total = 0.0
    for i in range(len(weight_rows)):
        row_sums[:] = 0.0
        for j in range(len(weight_columns)):
            weight = weight_columns[j]
            for c in range(n_channels):
                difference = image[at[0] + i, at[1] + j, c] - example[source[0] + i, source[1] + j, c]
                row_sums[c] += weight * difference * difference
        line = 0.0
        for c in range(n_channels):
            line += row_sums[c]
        total += weight_rows[i] * line
        if total >= limit:
            break
    return total


@parallel_kernel
def choose_sources(
    image: Any,
    corners: Any,
    corner_layout: Any,
    example: Any,
    candidates: Any,
    candidate_layout: Any,
    weight_rows: Any,
    weight_columns: Any,
    bounds: Any,
    chosen: Any,
    costs: Any,
    max_checks: int,
) -> None:
    """Nearest candidate of each patch, found by checking candidates in the order of their lower bounds.

    corners (P, 2) int32 and candidates (M, 2) int32 are first cells of patches in `image` and `example`; the layouts
    (P, 2) and (M, 2) float64 are positions whose squared distance adds to the cost. bounds (P, M) float32: no candidate
    costs less than its bound; destroyed. chosen (P,) int32 (-1: none yet) and costs (P,) float64 are updated: a patch
    changes only to a candidate that costs less, or costs the same and comes first. The result is the exact nearest
    candidate unless `max_checks` candidates were not enough.
    """
    n_candidates = len(candidates)
    n_blocks = (n_candidates + _BLOCK - 1) // _BLOCK
    for p in numba.prange(len(corners)):
        lowest = np.empty(n_blocks, np.float32)
        for block in range(n_blocks):
            least = np.float32(np.inf)
            for m in range(block * _BLOCK, min(n_candidates, (block + 1) * _BLOCK)):
                least = min(least, bounds[p, m])
            lowest[block] = least
        best_cost = costs[p]
        best = chosen[p]
        for _ in range(max_checks):
            block = 0
            for other in range(1, n_blocks):
                if lowest[other] < lowest[block]:
                    block = other
            if lowest[block] > best_cost or lowest[block] == np.inf:
                break
            least = np.float32(np.inf)
            at = -1
            for m in range(block * _BLOCK, min(n_candidates, (block + 1) * _BLOCK)):
                if bounds[p, m] == lowest[block] and at < 0:
                    at = m
                else:
                    least = min(least, bounds[p, m])
            bounds[p, at] = np.inf
            lowest[block] = least
            layout = (corner_layout[p, 0] - candidate_layout[at, 0]) ** 2
            layout += (corner_layout[p, 1] - candidate_layout[at, 1]) ** 2
            # a little above the best cost, so that a candidate of exactly that cost is not cut short
            limit = best_cost * (1.0 + 1e-12) - layout
            cost = layout + _distance(image, corners[p], example, candidates[at], weight_rows, weight_columns, limit)
            if cost < best_cost or (cost == best_cost and at < best):
                best_cost = cost
                best = at
        chosen[p] = best
        costs[p] = best_cost


@parallel_kernel
def patch_costs(
    image: Any,
    corners: Any,
    corner_layout: Any,
    example: Any,
    candidates: Any,
    candidate_layout: Any,
    weight_rows: Any,
    weight_columns: Any,
    chosen: Any,
) -> Any:
    """Costs (P,) float64 of the chosen candidates; arguments as in `choose_sources`, inf where none is chosen."""
    costs = np.full(len(corners), np.inf)
    for p in numba.prange(len(corners)):
        at = chosen[p]
        if at >= 0:
            layout = (corner_layout[p, 0] - candidate_layout[at, 0]) ** 2
            layout += (corner_layout[p, 1] - candidate_layout[at, 1]) ** 2
            costs[p] = layout + _distance(
                image, corners[p], example, candidates[at], weight_rows, weight_columns, np.inf
            )
    return costs


@parallel_kernel
def blend_patches(
    image: Any,
    example: Any,
    rows: Any,
    columns: Any,
    patch_at: Any,
    candidates: Any,
    chosen: Any,
    patch_weights: Any,
    weight_rows: Any,
    weight_columns: Any,
) -> Any:
    """Weighted average of the overlapping source patches: the E-step.

    rows (A,), columns (B,) int32, ascending: first cells of the grid of patches; patch_at (A, B) int32: patch there, -1
    for none. Returns the new image (cells without a patch keep their value) and, per cell, the example's cell (H, W, 2)
    int32 that has the largest weight in it (-1: none).
    """
    height, width, n_channels = image.shape
    n_high, n_wide = len(weight_rows), len(weight_columns)
    blended = image.copy()
    sources = np.full((height, width, 2), -1, np.int32)
    for i in numba.prange(height):
        sums = np.empty(n_channels)
        first_row, end_row = np.searchsorted(rows, i - n_high + 1), np.searchsorted(rows, i + 1)
        for j in range(width):
            sums[:] = 0.0
            total = 0.0
            most = -1.0
            first_column, end_column = np.searchsorted(columns, j - n_wide + 1), np.searchsorted(columns, j + 1)
            for a in range(first_row, end_row):
                down = i - rows[a]
                for b in range(first_column, end_column):
                    across = j - columns[b]
                    patch = patch_at[a, b]
                    if patch < 0:
                        continue
                    y = candidates[chosen[patch], 0] + down
                    x = candidates[chosen[patch], 1] + across
                    weight = patch_weights[patch] * weight_rows[down] * weight_columns[across]
                    total += weight
                    for c in range(n_channels):
                        sums[c] += weight * example[y, x, c]
                    if weight > most:
                        most = weight
                        sources[i, j, 0] = y
                        sources[i, j, 1] = x
            if total > 0.0:
                for c in range(n_channels):
                    blended[i, j, c] = sums[c] / total
    return blended, sources
