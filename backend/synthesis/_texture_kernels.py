"""Compiled loops of texture optimisation; `texture.py` explains the method.

Images are (H, W, C) float32; a patch is a window of w x w cells named by its first cell. The weight of a cell is the
product of the `falloff` (w,) float32 at its row and its column. The kernels are serial: a call takes a millisecond or
so, and the threads of the matrix products between the calls are still spinning then, so more threads made it slower.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..kernels import device, kernel

_BLOCK = 64  # bounds whose minimum is remembered together, so that the next smallest is found without a full scan


@kernel
def gather_patches(image: Any, corners: Any, falloff: Any) -> Any:
    """Patches (P, w * w * C) float32, each cell times the square root of its weight."""
    window, n_channels = len(falloff), image.shape[2]
    patches = np.empty((len(corners), window * window * n_channels), np.float32)
    for p in range(len(corners)):
        at = 0
        for i in range(window):
            for j in range(window):
                scale = np.float32(np.sqrt(falloff[i] * falloff[j]))
                for c in range(n_channels):
                    patches[p, at] = scale * image[corners[p, 0] + i, corners[p, 1] + j, c]
                    at += 1
    return patches


@device
def _column_weights(falloff: Any, n_channels: int) -> Any:
    """The falloff (w,) repeated for each channel: (w * C,) float32."""
    weights = np.empty(len(falloff) * n_channels, np.float32)
    for k in range(len(weights)):
        weights[k] = falloff[k // n_channels]
    return weights


@device
def _distance(image: Any, at: Any, example: Any, source: Any, falloff: Any, column_weights: Any, sums: Any) -> float:
    """Weighted squared distance of the patch of `image` at cell `at` and that of `example` at cell `source`.

    The images as (H, W * C). `sums` (w * C,) float32 is room to work in: summing the rows of the patch into one keeps
    the long inner loop free of dependences, so that it runs on vectors.
    """
    n_channels = len(sums) // len(falloff)
    left, right = at[1] * n_channels, source[1] * n_channels
    sums[:] = np.float32(0.0)
    for i in range(len(falloff)):
        first = image[at[0] + i, left : left + len(sums)]
        second = example[source[0] + i, right : right + len(sums)]
        weight = falloff[i]
        for k in range(len(sums)):
            difference = first[k] - second[k]
            sums[k] += weight * (difference * difference)
    total = 0.0
    for k in range(len(sums)):
        total += column_weights[k] * sums[k]
    return total


@device
def _squared_distance(first: Any, second: Any) -> float:
    """Squared distance of two positions (3,)."""
    return float((first[0] - second[0]) ** 2 + (first[1] - second[1]) ** 2 + (first[2] - second[2]) ** 2)


@kernel
def measure_patches(
    image: Any,
    corners: Any,
    corner_layout: Any,
    example: Any,
    candidates: Any,
    candidate_layout: Any,
    falloff: Any,
    chosen: Any,
    earlier: Any,
) -> tuple[Any, Any]:
    """Costs of the chosen candidates and how far the patches have moved.

    Arguments as in `choose_sources`; earlier (P, w * w * C) float32: the patches as `gather_patches` once gave them.
    Returns costs (P,) float64, inf where no candidate is chosen, and the distances (P,) float64 to the earlier patches.
    """
    n_channels, window = image.shape[2], len(falloff)
    flat_image, flat_example = image.reshape(len(image), -1), example.reshape(len(example), -1)
    column_weights = _column_weights(falloff, n_channels)
    roots = np.sqrt(column_weights)
    costs, moved = np.full(len(corners), np.inf), np.empty(len(corners))
    for p in range(len(corners)):
        sums = np.zeros(window * n_channels, np.float32)
        at = corners[p, 1] * n_channels
        for i in range(window):
            line = flat_image[corners[p, 0] + i, at : at + len(sums)]
            old = earlier[p, i * len(sums) : (i + 1) * len(sums)]
            scale = np.sqrt(falloff[i])
            for k in range(len(sums)):
                difference = scale * (roots[k] * line[k]) - old[k]
                sums[k] += difference * difference
        total = 0.0
        for k in range(len(sums)):
            total += sums[k]
        moved[p] = np.sqrt(total)
        if chosen[p] >= 0:
            layout = _squared_distance(corner_layout[p], candidate_layout[chosen[p]])
            source = candidates[chosen[p]]
            costs[p] = layout + _distance(flat_image, corners[p], flat_example, source, falloff, column_weights, sums)
    return costs, moved


@kernel
def choose_sources(
    image: Any,
    corners: Any,
    corner_layout: Any,
    example: Any,
    candidates: Any,
    candidate_layout: Any,
    falloff: Any,
    bounds: Any,
    chosen: Any,
    costs: Any,
    max_checks: int,
) -> tuple[Any, Any, Any]:
    """Nearest candidate of each patch, found by checking candidates in the order of their lower bounds.

    corners (P, 2) int32 and candidates (M, 2) int32 are first cells of patches in `image` and `example`; the layouts
    (P, 3) and (M, 3) float64 are positions whose squared distance adds to the cost. bounds (P, M) float32: no candidate
    costs less than its bound; destroyed. chosen (P,) int32 (-1: none yet) and costs (P,) float64 are the present
    choice. Returns the new choice, its costs, and what any other candidate costs at least, (P,) float64. A patch
    changes only to a candidate that costs less, or costs the same and comes first. The result is the exact nearest
    candidate unless `max_checks` candidates were not enough.
    """
    new_chosen, new_costs, runner_up = np.empty_like(chosen), np.empty_like(costs), np.empty_like(costs)
    n_candidates = len(candidates)
    n_blocks = (n_candidates + _BLOCK - 1) // _BLOCK
    flat_image, flat_example = image.reshape(len(image), -1), example.reshape(len(example), -1)
    column_weights = _column_weights(falloff, image.shape[2])
    for p in range(len(corners)):
        sums = np.empty(len(column_weights), np.float32)
        best_cost, best, second = costs[p], chosen[p], np.inf
        if best >= 0:
            bounds[p, best] = np.inf
        lowest = np.empty(n_blocks, np.float32)
        for block in range(n_blocks):
            least = np.float32(np.inf)
            for m in range(block * _BLOCK, min(n_candidates, (block + 1) * _BLOCK)):
                least = min(least, bounds[p, m])
            lowest[block] = least
        for check in range(max_checks + 1):
            block = int(np.argmin(lowest))
            bound = lowest[block]
            if bound > best_cost or bound == np.inf or check == max_checks:
                second = min(second, bound)
                break
            least = np.float32(np.inf)
            at = -1
            for m in range(block * _BLOCK, min(n_candidates, (block + 1) * _BLOCK)):
                if bounds[p, m] == bound and at < 0:
                    at = m
                else:
                    least = min(least, bounds[p, m])
            bounds[p, at] = np.inf
            lowest[block] = least
            cost = _squared_distance(corner_layout[p], candidate_layout[at])
            source = candidates[at]
            cost += _distance(flat_image, corners[p], flat_example, source, falloff, column_weights, sums)
            if cost < best_cost or (cost == best_cost and at < best):
                second = min(second, best_cost)
                best_cost, best = cost, at
            else:
                second = min(second, cost)
        new_chosen[p], new_costs[p], runner_up[p] = best, best_cost, second
    return new_chosen, new_costs, runner_up


@kernel
def blend_patches(
    image: Any,
    example: Any,
    rows: Any,
    columns: Any,
    patch_at: Any,
    source_corners: Any,
    patch_weights: Any,
    falloff: Any,
) -> Any:
    """Weighted average of the overlapping source patches: the E-step.

    rows (A,), columns (B,) int32, ascending: first cells of the grid of patches; patch_at (A, B) int32: patch there, -1
    for none; source_corners (P, 2) int32: first cells of the patches in `example`. Returns the new image (cells without
    a patch keep their value) and, per cell, the example's cell (H, W, 2) int32 that has the largest weight in it (-1:
    none).
    """
    height, width, n_channels = image.shape
    window = len(falloff)
    blended = image.copy()
    sources = np.full((height, width, 2), -1, np.int32)
    for i in range(height):
        sums = np.empty(n_channels)
        first_row, end_row = np.searchsorted(rows, i - window + 1), np.searchsorted(rows, i + 1)
        for j in range(width):
            sums[:] = 0.0
            total = 0.0
            most = -1.0
            first_column, end_column = np.searchsorted(columns, j - window + 1), np.searchsorted(columns, j + 1)
            for a in range(first_row, end_row):
                down = i - rows[a]
                for b in range(first_column, end_column):
                    across = j - columns[b]
                    patch = patch_at[a, b]
                    if patch < 0:
                        continue
                    y = source_corners[patch, 0] + down
                    x = source_corners[patch, 1] + across
                    weight = patch_weights[patch] * falloff[down] * falloff[across]
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
