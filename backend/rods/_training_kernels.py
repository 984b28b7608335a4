"""Kernels of `training`: errors of every guide's motion, and the weights that make the least of them (M-27)."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from ..kernels import device, parallel_kernel
from ..types import Bools, Float32, Float64, Int32


@parallel_kernel
def add_errors(
    motions: Float32, centre: Float64, guides: Int32, rest: Float64, now: Float64, products: Float64
) -> None:
    """Add a frame to products (n, N, K, K): of the errors of two guides' motions around a knot, the dot products.

    motions (G, 12, M) as in `_interpolation_kernels`; guides (n, K); rest and now (n, M, 3): the hairs at the samples.
    A sample counts for the knots before and after it by how near it is.
    """
    n_hairs, n_samples = rest.shape[:2]
    n_knots, n_neighbours = products.shape[1], products.shape[2]
    for hair in numba.prange(n_hairs):
        errors = np.empty((n_neighbours, 3))
        for sample in range(n_samples):
            place = sample * (n_knots - 1) / (n_samples - 1)
            knot = min(int(place), n_knots - 2)
            share = place - knot
            for neighbour in range(n_neighbours):
                motion = motions[guides[hair, neighbour]]
                for axis in range(3):
                    moved = rest[hair, sample, axis] + motion[9 + axis, sample]
                    for column in range(3):
                        moved += motion[3 * column + axis, sample] * (rest[hair, sample, column] - centre[column])
                    errors[neighbour, axis] = moved - now[hair, sample, axis]
            for a in range(n_neighbours):
                for b in range(n_neighbours):
                    product = 0.0
                    for axis in range(3):
                        product += errors[a, axis] * errors[b, axis]
                    products[hair, knot, a, b] += (1.0 - share) * product
                    products[hair, knot + 1, a, b] += share * product


@device
def _best_of_free(quadratic: Float64, linear: Float64, free: Bools, factor: Float64, best: Float64) -> float:
    """best (K,): the least of w.Q w / 2 - linear.w over the free entries that sum to 1; returns the multiplier.

    Cholesky's factorisation over the free entries, of two right-hand sides: linear and ones.
    """
    count = len(linear)
    ones = np.zeros(count)
    for i in range(count):
        best[i] = 0.0
        if not free[i]:
            continue
        for j in range(i + 1):
            if free[j]:
                value = quadratic[i, j]
                for k in range(j):
                    if free[k]:
                        value -= factor[i, k] * factor[j, k]
                factor[i, j] = math.sqrt(value) if i == j else value / factor[j, j]
        best[i], ones[i] = linear[i], 1.0
        for j in range(i):
            if free[j]:
                best[i] -= factor[i, j] * best[j]
                ones[i] -= factor[i, j] * ones[j]
        best[i] /= factor[i, i]
        ones[i] /= factor[i, i]
    total, total_ones = 0.0, 0.0
    for i in range(count - 1, -1, -1):
        if free[i]:
            for j in range(i + 1, count):
                if free[j]:
                    best[i] -= factor[j, i] * best[j]
                    ones[i] -= factor[j, i] * ones[j]
            best[i] /= factor[i, i]
            ones[i] /= factor[i, i]
            total += best[i]
            total_ones += ones[i]
    multiplier = (1.0 - total) / total_ones
    for i in range(count):
        if free[i]:
            best[i] += multiplier * ones[i]
    return multiplier


@device
def least_on_simplex(quadratic: Float64, linear: Float64, weights: Float64) -> Any:
    """Bring weights (K,), 0 or more and 1 together, to the least of w.Q w / 2 - linear.w; Q positive definite.

    The active-set method: go to the least over the free entries, or as far as the first that turns negative, which is
    then held at 0; where the least is reached, an entry that would lower it further is set free again.
    """
    count = len(linear)
    free = np.ones(count, np.bool_)
    factor, best = np.empty((count, count)), np.empty(count)
    # each turn frees or holds one; twice as many as there are choices of one would have ended it but for rounding
    for _ in range(8 * count):
        multiplier = _best_of_free(quadratic, linear, free, factor, best)
        step, blocking = 1.0, -1
        for i in range(count):
            if free[i] and best[i] < 0.0 and weights[i] < step * (weights[i] - best[i]):
                step, blocking = weights[i] / (weights[i] - best[i]), i
        for i in range(count):
            weights[i] += step * (best[i] - weights[i])
        if blocking >= 0:
            free[blocking] = False
            weights[blocking] = 0.0
            continue
        gain, freed = -1e-12 * abs(multiplier), -1
        for i in range(count):
            if not free[i]:
                slope = -linear[i] - multiplier
                for j in range(count):
                    slope += quadratic[i, j] * weights[j]
                if slope < gain:
                    gain, freed = slope, i
        if freed < 0:
            break
        free[freed] = True


@parallel_kernel
def solve_weights(products: Float64, prior: Float32, ridge: float, weights: Float32) -> None:
    """weights (n, N, K): the least of w.E w + ridge mean(E_ii) |w - prior|^2, 0 or more and 1 together (M-27)."""
    n_hairs, n_knots, count = prior.shape
    for hair in numba.prange(n_hairs):
        quadratic, linear, found = np.empty((count, count)), np.empty(count), np.empty(count)
        for knot in range(n_knots):
            size, total = 0.0, 0.0
            for i in range(count):
                size += products[hair, knot, i, i] / count
                total += prior[hair, knot, i]
            # where all guides are right (the root) the prior is as good as any; 1e-18 m^2 is nothing elsewhere
            hold = ridge * size + 1e-18
            for i in range(count):
                found[i] = prior[hair, knot, i] / total
                for j in range(count):
                    quadratic[i, j] = products[hair, knot, i, j] + (hold if i == j else 0.0)
                linear[i] = hold * found[i]
            least_on_simplex(quadratic, linear, found)
            for i in range(count):
                weights[hair, knot, i] = found[i]
