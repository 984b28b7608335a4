"""Kernels of `fields.diffusion`: one level of the multigrid, and the passes of conjugate gradients.

Every grid has one more layer of cells all around, whose values are 0. `diagonal` is 0 where nothing is solved for
(outside, fixed and in the border) and `inverse` is 1 / diagonal there 0 too, which keeps values 0 in those cells
without a branch. The finest level has edges of weight 1 (`_unit`), coarser ones have weights to the next cell along
each axis (`_weighted`). Sums over a grid are written per layer and added up by the caller, so that no result depends on
the number of threads.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from ..kernels import device, parallel_kernel, summing_device

OUTSIDE, FREE, FIXED = 0, 1, 2


def thread_count() -> int:
    """Threads that parallel kernels use now."""
    return int(numba.get_num_threads())


def use_threads(count: int) -> None:
    """Let parallel kernels use so many threads from here on."""
    numba.set_num_threads(count)


@summing_device
def _dot(a: Any, b: Any) -> Any:
    total = np.float32(0.0)
    for k in range(a.shape[0]):
        total += a[k] * b[k]
    return total


@parallel_kernel
def set_finest(kinds: Any, weights: Any, diagonal: Any, inverse: Any, fixed_terms: Any) -> None:
    """The 7-point Laplacian from kinds (X + 2, ...) uint8, the border OUTSIDE, and weights (X, Y, Z), or empty.

    diagonal : neighbours that are not OUTSIDE, plus the weight. fixed_terms : FIXED neighbours plus the weight.
    """
    n_x, n_y, n_z = kinds.shape
    for x in numba.prange(1, n_x - 1):
        for y in range(1, n_y - 1):
            for z in range(1, n_z - 1):
                if kinds[x, y, z] != FREE:
                    continue
                total, fixed = 0, 0
                for kind in (
                    kinds[x - 1, y, z], kinds[x + 1, y, z], kinds[x, y - 1, z],
                    kinds[x, y + 1, z], kinds[x, y, z - 1], kinds[x, y, z + 1],
                ):  # fmt: skip
                    total += kind != OUTSIDE
                    fixed += kind == FIXED
                weight = np.float32(0.0)
                if weights.shape[0] > 0:
                    weight = weights[x - 1, y - 1, z - 1]
                diagonal[x, y, z] = total + weight
                fixed_terms[x, y, z] = fixed + weight
                inverse[x, y, z] = 1.0 / diagonal[x, y, z] if diagonal[x, y, z] > 0 else 0.0


@parallel_kernel
def coarsen(
    diagonal: Any, known: Any, fixed_terms: Any, to_x: Any, to_y: Any, to_z: Any, is_unit: bool,
    c_known: Any, c_terms: Any, c_x: Any, c_y: Any, c_z: Any,
) -> None:  # fmt: skip
    """Join 2 x 2 x 2 cells: the terms of fixed neighbours add up, edges between the cells count half their sum.

    Half, because the edge is twice as long while linear interpolation, not a constant, brings the values down.
    """
    n_x, n_y, n_z = diagonal.shape
    for i in numba.prange(1, c_known.shape[0] - 1):
        for j in range(1, c_known.shape[1] - 1):
            for k in range(1, c_known.shape[2] - 1):
                for x in range(2 * i - 1, min(2 * i + 1, n_x - 1)):
                    for y in range(2 * j - 1, min(2 * j + 1, n_y - 1)):
                        for z in range(2 * k - 1, min(2 * k + 1, n_z - 1)):
                            if known[x, y, z]:
                                c_known[i, j, k] = 1
                            if diagonal[x, y, z] == 0:
                                continue
                            c_terms[i, j, k] += fixed_terms[x, y, z]
                            half = np.float32(0.5)
                            if is_unit:
                                if x == 2 * i and diagonal[x + 1, y, z] > 0:
                                    c_x[i, j, k] += half
                                if y == 2 * j and diagonal[x, y + 1, z] > 0:
                                    c_y[i, j, k] += half
                                if z == 2 * k and diagonal[x, y, z + 1] > 0:
                                    c_z[i, j, k] += half
                            else:
                                if x == 2 * i:
                                    c_x[i, j, k] += half * to_x[x, y, z]
                                if y == 2 * j:
                                    c_y[i, j, k] += half * to_y[x, y, z]
                                if z == 2 * k:
                                    c_z[i, j, k] += half * to_z[x, y, z]


@parallel_kernel
def set_coarse(terms: Any, to_x: Any, to_y: Any, to_z: Any, diagonal: Any, inverse: Any) -> None:
    """The diagonal of a coarse level: fixed terms and the six edges."""
    n_x, n_y, n_z = terms.shape
    for x in numba.prange(1, n_x - 1):
        for y in range(1, n_y - 1):
            for z in range(1, n_z - 1):
                total = terms[x, y, z] + to_x[x, y, z] + to_y[x, y, z] + to_z[x, y, z]
                total += to_x[x - 1, y, z] + to_y[x, y - 1, z] + to_z[x, y, z - 1]
                if total > 0:
                    diagonal[x, y, z] = total
                    inverse[x, y, z] = 1.0 / total


@parallel_kernel
def relax_unit(values: Any, right: Any, inverse: Any, omega: float, out: Any, sums: Any) -> None:
    """out = values + omega D^-1 (right - A values); sums[x] = out . right over layer x, if sums is not empty."""
    n_x, n_y, n_z = values.shape
    keep, take = np.float32(1.0 - omega), np.float32(omega)
    for x in numba.prange(1, n_x - 1):
        total = 0.0
        for y in range(1, n_y - 1):
            left, further = values[x - 1, y, 1 : n_z - 1], values[x + 1, y, 1 : n_z - 1]
            front, back = values[x, y - 1, 1 : n_z - 1], values[x, y + 1, 1 : n_z - 1]
            below, here, above = values[x, y, 0 : n_z - 2], values[x, y, 1 : n_z - 1], values[x, y, 2:n_z]
            b, scale, new = right[x, y, 1 : n_z - 1], inverse[x, y, 1 : n_z - 1], out[x, y, 1 : n_z - 1]
            for k in range(n_z - 2):
                near = left[k] + further[k] + front[k] + back[k] + below[k] + above[k]
                new[k] = keep * here[k] + take * scale[k] * (b[k] + near)
            if sums.shape[0] > 0:
                total += _dot(new, b)
        if sums.shape[0] > 0:
            sums[x] = total


@parallel_kernel
def relax_weighted(
    values: Any, right: Any, inverse: Any, to_x: Any, to_y: Any, to_z: Any, omega: float, out: Any
) -> None:
    """`relax_unit` for a coarse level."""
    n_x, n_y, n_z = values.shape
    keep, take = np.float32(1.0 - omega), np.float32(omega)
    for x in numba.prange(1, n_x - 1):
        for y in range(1, n_y - 1):
            for z in range(1, n_z - 1):
                near = to_x[x - 1, y, z] * values[x - 1, y, z] + to_x[x, y, z] * values[x + 1, y, z]
                near += to_y[x, y - 1, z] * values[x, y - 1, z] + to_y[x, y, z] * values[x, y + 1, z]
                near += to_z[x, y, z - 1] * values[x, y, z - 1] + to_z[x, y, z] * values[x, y, z + 1]
                out[x, y, z] = keep * values[x, y, z] + take * inverse[x, y, z] * (right[x, y, z] + near)


@parallel_kernel
def scale(values: Any, inverse: Any, omega: float, out: Any) -> None:
    """out = omega D^-1 values: a relaxation that starts from 0."""
    factor = np.float32(omega)
    for x in numba.prange(1, values.shape[0] - 1):
        for y in range(1, values.shape[1] - 1):
            source, by, target = values[x, y], inverse[x, y], out[x, y]
            for z in range(values.shape[2]):
                target[z] = factor * by[z] * source[z]


@parallel_kernel
def residual_unit(values: Any, right: Any, diagonal: Any, inverse: Any, norm: Any, out: Any) -> None:
    """out = norm (right - A values)."""
    n_x, n_y, n_z = values.shape
    for x in numba.prange(1, n_x - 1):
        for y in range(1, n_y - 1):
            left, further = values[x - 1, y, 1 : n_z - 1], values[x + 1, y, 1 : n_z - 1]
            front, back = values[x, y - 1, 1 : n_z - 1], values[x, y + 1, 1 : n_z - 1]
            below, here, above = values[x, y, 0 : n_z - 2], values[x, y, 1 : n_z - 1], values[x, y, 2:n_z]
            b, main, new = right[x, y, 1 : n_z - 1], diagonal[x, y, 1 : n_z - 1], out[x, y, 1 : n_z - 1]
            factor = norm[x, y, 1 : n_z - 1]
            for k in range(n_z - 2):
                near = left[k] + further[k] + front[k] + back[k] + below[k] + above[k]
                new[k] = factor[k] * (b[k] + near - main[k] * here[k])


@parallel_kernel
def residual_weighted(
    values: Any, right: Any, diagonal: Any, to_x: Any, to_y: Any, to_z: Any, norm: Any, out: Any
) -> None:
    """`residual_unit` for a coarse level."""
    n_x, n_y, n_z = values.shape
    for x in numba.prange(1, n_x - 1):
        for y in range(1, n_y - 1):
            for z in range(1, n_z - 1):
                near = to_x[x - 1, y, z] * values[x - 1, y, z] + to_x[x, y, z] * values[x + 1, y, z]
                near += to_y[x, y - 1, z] * values[x, y - 1, z] + to_y[x, y, z] * values[x, y + 1, z]
                near += to_z[x, y, z - 1] * values[x, y, z - 1] + to_z[x, y, z] * values[x, y, z + 1]
                out[x, y, z] = norm[x, y, z] * (right[x, y, z] + near - diagonal[x, y, z] * values[x, y, z])


@device
def _interpolate_line(coarse: Any, x: int, y: int, line: Any) -> None:
    """line = coarse values over the fine cells at x, y, linear in x and y; z stays coarse."""
    i, j = (x + 1) // 2, (y + 1) // 2
    i_next, j_next = (i - 1 if x % 2 == 1 else i + 1), (j - 1 if y % 2 == 1 else j + 1)
    a, b, c, d = coarse[i, j], coarse[i_next, j], coarse[i, j_next], coarse[i_next, j_next]
    w, v, u = np.float32(9 / 16), np.float32(3 / 16), np.float32(1 / 16)
    for k in range(line.shape[0]):
        line[k] = w * a[k] + v * (b[k] + c[k]) + u * d[k]


@parallel_kernel
def set_norm(c_known: Any, inverse: Any, norm: Any) -> None:
    """norm = 1 / (share of the coarse cells that interpolation asks and that are known), 0 where nothing is solved."""
    n_x, n_y, n_z = norm.shape
    for x in numba.prange(1, n_x - 1):
        line = np.empty(c_known.shape[2], np.float32)
        for y in range(1, n_y - 1):
            _interpolate_line(c_known, x, y, line)
            for z in range(1, n_z - 1):
                k = (z + 1) // 2
                share = np.float32(0.75) * line[k] + np.float32(0.25) * line[k - 1 if z % 2 == 1 else k + 1]
                if inverse[x, y, z] > 0:
                    norm[x, y, z] = 1.0 / share


@parallel_kernel
def prolong(coarse: Any, norm: Any, values: Any) -> None:
    """values += P coarse: trilinear between the middles of the cells, over known cells only."""
    n_x, n_y, n_z = values.shape
    near, far = np.float32(0.75), np.float32(0.25)
    for x in numba.prange(1, n_x - 1):
        line = np.empty(coarse.shape[2], np.float32)
        fine = np.empty(2 * coarse.shape[2], np.float32)
        for y in range(1, n_y - 1):
            _interpolate_line(coarse, x, y, line)
            before, here, after = line[:-2], line[1:-1], line[2:]
            for k in range(here.shape[0]):
                fine[2 * k] = near * here[k] + far * before[k]
                fine[2 * k + 1] = near * here[k] + far * after[k]
            factor, target = norm[x, y, 1 : n_z - 1], values[x, y, 1 : n_z - 1]
            for k in range(n_z - 2):
                target[k] += factor[k] * fine[k]


@parallel_kernel
def restrict(fine: Any, coarse: Any) -> None:
    """coarse = P^T of what `residual_*` wrote (already times norm)."""
    n_x, n_y, n_z = fine.shape
    near, far = np.float32(0.75), np.float32(0.25)
    for i in numba.prange(1, coarse.shape[0] - 1):
        line = np.zeros(2 * coarse.shape[2] + 2, np.float32)
        inner = line[:n_z]
        for j in range(1, coarse.shape[1] - 1):
            for k in range(n_z):
                inner[k] = 0.0
            for a in range(4):
                x = 2 * i - 2 + a
                if x < 1 or x > n_x - 2:
                    continue
                for b in range(4):
                    y = 2 * j - 2 + b
                    if y < 1 or y > n_y - 2:
                        continue
                    weight = (near if a == 1 or a == 2 else far) * (near if b == 1 or b == 2 else far)
                    source = fine[x, y]
                    for k in range(n_z):
                        inner[k] += weight * source[k]
            target = coarse[i, j]
            for k in range(1, coarse.shape[2] - 1):
                target[k] = far * (line[2 * k - 2] + line[2 * k + 1]) + near * (line[2 * k - 1] + line[2 * k])


@parallel_kernel
def multiply(values: Any, diagonal: Any, inverse: Any, out: Any, sums: Any) -> None:
    """out = A values on the finest level; sums[x] = values . out over layer x."""
    n_x, n_y, n_z = values.shape
    for x in numba.prange(1, n_x - 1):
        total = 0.0
        for y in range(1, n_y - 1):
            left, further = values[x - 1, y, 1 : n_z - 1], values[x + 1, y, 1 : n_z - 1]
            front, back = values[x, y - 1, 1 : n_z - 1], values[x, y + 1, 1 : n_z - 1]
            below, here, above = values[x, y, 0 : n_z - 2], values[x, y, 1 : n_z - 1], values[x, y, 2:n_z]
            main, scale_, new = diagonal[x, y, 1 : n_z - 1], inverse[x, y, 1 : n_z - 1], out[x, y, 1 : n_z - 1]
            for k in range(n_z - 2):
                near = left[k] + further[k] + front[k] + back[k] + below[k] + above[k]
                new[k] = main[k] * (here[k] - scale_[k] * near)
            total += _dot(here, new)
        sums[x] = total


@parallel_kernel
def step(direction: Any, product: Any, alpha: float, solution: Any, right: Any, sums: Any) -> None:
    """solution += alpha direction, right -= alpha product; sums[x] = right . right over layer x."""
    factor = np.float32(alpha)
    for x in numba.prange(1, right.shape[0] - 1):
        total = 0.0
        for y in range(1, right.shape[1] - 1):
            p, q, u, r = direction[x, y], product[x, y], solution[x, y], right[x, y]
            for k in range(r.shape[0]):
                u[k] += factor * p[k]
                r[k] -= factor * q[k]
            total += _dot(r, r)
        sums[x] = total


@parallel_kernel
def turn(preconditioned: Any, beta: float, direction: Any) -> None:
    """direction = preconditioned + beta direction."""
    factor = np.float32(beta)
    for x in numba.prange(1, direction.shape[0] - 1):
        for y in range(1, direction.shape[1] - 1):
            z, p = preconditioned[x, y], direction[x, y]
            for k in range(p.shape[0]):
                p[k] = z[k] + factor * p[k]


@parallel_kernel
def set_right(kinds: Any, weights: Any, values: Any, component: int, right: Any, sums: Any) -> None:
    """right = values of the FIXED neighbours plus weight times the own value, on FREE cells; sums of its squares.

    kinds (X + 2, ...), weights (X, Y, Z) or empty, values (X, Y, Z, C), right (X + 2, ...).
    """
    n_x, n_y, n_z = kinds.shape
    for x in numba.prange(1, n_x - 1):
        total = 0.0
        for y in range(1, n_y - 1):
            for z in range(1, n_z - 1):
                right[x, y, z] = 0.0
                if kinds[x, y, z] != FREE:
                    continue
                b: Any = np.float32(0.0)
                if kinds[x - 1, y, z] == FIXED:
                    b += values[x - 2, y - 1, z - 1, component]
                if kinds[x + 1, y, z] == FIXED:
                    b += values[x, y - 1, z - 1, component]
                if kinds[x, y - 1, z] == FIXED:
                    b += values[x - 1, y - 2, z - 1, component]
                if kinds[x, y + 1, z] == FIXED:
                    b += values[x - 1, y, z - 1, component]
                if kinds[x, y, z - 1] == FIXED:
                    b += values[x - 1, y - 1, z - 2, component]
                if kinds[x, y, z + 1] == FIXED:
                    b += values[x - 1, y - 1, z, component]
                if weights.shape[0] > 0:
                    b += weights[x - 1, y - 1, z - 1] * values[x - 1, y - 1, z - 1, component]
                right[x, y, z] = b
                total += b * b
        sums[x] = total


@parallel_kernel
def write_back(kinds: Any, values: Any, solution: Any, component: int, out: Any) -> None:
    """out (X, Y, Z, C): the solution on FREE cells, the given values on FIXED ones, 0 outside."""
    for x in numba.prange(out.shape[0]):
        for y in range(out.shape[1]):
            for z in range(out.shape[2]):
                kind = kinds[x + 1, y + 1, z + 1]
                if kind == FREE:
                    out[x, y, z, component] = solution[x + 1, y + 1, z + 1]
                elif kind == FIXED:
                    out[x, y, z, component] = values[x, y, z, component]
                else:
                    out[x, y, z, component] = 0.0
