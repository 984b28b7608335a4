"""3-vectors and 3 x 3 matrices as tuples, so that they live in registers; matrices in rows (private to the kernels).

A symmetric matrix is a tuple of 6: 00, 01, 02, 11, 12, 22. All functions are pure; sums have a fixed order.
"""

from __future__ import annotations

import math
from typing import Any

from ..kernels import summing_device

Vector = tuple[float, float, float]
Matrix = tuple[float, float, float, float, float, float, float, float, float]
Symmetric = tuple[float, float, float, float, float, float]


@summing_device
def cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@summing_device
def dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@summing_device
def times(m: Matrix, v: Vector) -> Vector:
    """m v."""
    return (
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
        m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
    )


@summing_device
def transposed_times(m: Matrix, v: Vector) -> Vector:
    """m^T v."""
    return (
        m[0] * v[0] + m[3] * v[1] + m[6] * v[2],
        m[1] * v[0] + m[4] * v[1] + m[7] * v[2],
        m[2] * v[0] + m[5] * v[1] + m[8] * v[2],
    )


@summing_device
def vector(array: Any, row: int, column: int) -> Vector:
    return array[row, column], array[row, column + 1], array[row, column + 2]


@summing_device
def matrix(array: Any, row: int, column: int) -> Matrix:
    a, i, k = array, row, column
    return (
        a[i, k],
        a[i, k + 1],
        a[i, k + 2],
        a[i, k + 3],
        a[i, k + 4],
        a[i, k + 5],
        a[i, k + 6],
        a[i, k + 7],
        a[i, k + 8],
    )


@summing_device
def symmetric(array: Any, row: int, column: int) -> Symmetric:
    a, i, k = array, row, column
    return a[i, k], a[i, k + 1], a[i, k + 2], a[i, k + 3], a[i, k + 4], a[i, k + 5]


@summing_device
def put(array: Any, row: int, column: int, values: Any) -> None:
    for k in range(len(values)):
        array[row, column + k] = values[k]


@summing_device
def plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@summing_device
def minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@summing_device
def scaled(factor: float, a: Vector) -> Vector:
    return factor * a[0], factor * a[1], factor * a[2]


@summing_device
def tangent(frame: Matrix) -> Vector:
    return frame[0], frame[3], frame[6]


@summing_device
def add_matrix(total: Matrix, factor: float, m: Matrix) -> Matrix:
    t, f = total, factor
    return (
        t[0] + f * m[0],
        t[1] + f * m[1],
        t[2] + f * m[2],
        t[3] + f * m[3],
        t[4] + f * m[4],
        t[5] + f * m[5],
        t[6] + f * m[6],
        t[7] + f * m[7],
        t[8] + f * m[8],
    )


@summing_device
def cross_matrix_product(v: Vector, m: Matrix) -> Matrix:
    """[v]x m."""
    return (
        v[1] * m[6] - v[2] * m[3],
        v[1] * m[7] - v[2] * m[4],
        v[1] * m[8] - v[2] * m[5],
        v[2] * m[0] - v[0] * m[6],
        v[2] * m[1] - v[0] * m[7],
        v[2] * m[2] - v[0] * m[8],
        v[0] * m[3] - v[1] * m[0],
        v[0] * m[4] - v[1] * m[1],
        v[0] * m[5] - v[1] * m[2],
    )


@summing_device
def product(a: Matrix, b: Matrix) -> Matrix:
    """a b."""
    return (
        a[0] * b[0] + a[1] * b[3] + a[2] * b[6],
        a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
        a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
        a[3] * b[0] + a[4] * b[3] + a[5] * b[6],
        a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
        a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
        a[6] * b[0] + a[7] * b[3] + a[8] * b[6],
        a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
        a[6] * b[2] + a[7] * b[5] + a[8] * b[8],
    )


@summing_device
def transposed_product(a: Matrix, b: Matrix) -> Matrix:
    """a^T b."""
    return (
        a[0] * b[0] + a[3] * b[3] + a[6] * b[6],
        a[0] * b[1] + a[3] * b[4] + a[6] * b[7],
        a[0] * b[2] + a[3] * b[5] + a[6] * b[8],
        a[1] * b[0] + a[4] * b[3] + a[7] * b[6],
        a[1] * b[1] + a[4] * b[4] + a[7] * b[7],
        a[1] * b[2] + a[4] * b[5] + a[7] * b[8],
        a[2] * b[0] + a[5] * b[3] + a[8] * b[6],
        a[2] * b[1] + a[5] * b[4] + a[8] * b[7],
        a[2] * b[2] + a[5] * b[5] + a[8] * b[8],
    )


@summing_device
def full(s: Symmetric) -> Matrix:
    return s[0], s[1], s[2], s[1], s[3], s[4], s[2], s[4], s[5]


@summing_device
def add_symmetric(a: Symmetric, b: Symmetric) -> Symmetric:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


@summing_device
def add_gram(total: Symmetric, factor: float, a: Matrix, b: Matrix) -> Symmetric:
    """total + factor a^T b, of which only the upper half is taken: for a sum that comes out symmetric."""
    t, f = total, factor
    return (
        t[0] + f * (a[0] * b[0] + a[3] * b[3] + a[6] * b[6]),
        t[1] + f * (a[0] * b[1] + a[3] * b[4] + a[6] * b[7]),
        t[2] + f * (a[0] * b[2] + a[3] * b[5] + a[6] * b[8]),
        t[3] + f * (a[1] * b[1] + a[4] * b[4] + a[7] * b[7]),
        t[4] + f * (a[1] * b[2] + a[4] * b[5] + a[7] * b[8]),
        t[5] + f * (a[2] * b[2] + a[5] * b[5] + a[8] * b[8]),
    )


@summing_device
def add_inertia(total: Symmetric, mass: float, r: Vector) -> Symmetric:
    """total + mass (r^2 I - r r^T): of a point at r."""
    x, y, z = mass * r[0], mass * r[1], mass * r[2]
    xx, yy, zz = x * r[0], y * r[1], z * r[2]
    return (
        total[0] + yy + zz,
        total[1] - x * r[1],
        total[2] - x * r[2],
        total[3] + xx + zz,
        total[4] - y * r[2],
        total[5] + xx + yy,
    )


@summing_device
def inverse_factor(m: Symmetric) -> Symmetric:
    """L^-1 (00, 10, 11, 20, 21, 22) of the Cholesky factor of a positive definite m = L L^T."""
    inverse00 = 1.0 / math.sqrt(m[0])
    l10, l20 = m[1] * inverse00, m[2] * inverse00
    inverse11 = 1.0 / math.sqrt(m[3] - l10 * l10)
    l21 = (m[4] - l20 * l10) * inverse11
    inverse22 = 1.0 / math.sqrt(m[5] - l20 * l20 - l21 * l21)
    inverse10 = -l10 * inverse00 * inverse11
    inverse21 = -l21 * inverse11 * inverse22
    inverse20 = -(l20 * inverse00 + l21 * inverse10) * inverse22
    return inverse00, inverse10, inverse11, inverse20, inverse21, inverse22


@summing_device
def lower_times(f: Symmetric, v: Vector) -> Vector:
    """L^-1 v."""
    return f[0] * v[0], f[1] * v[0] + f[2] * v[1], f[3] * v[0] + f[4] * v[1] + f[5] * v[2]


@summing_device
def lower_transposed_times(f: Symmetric, v: Vector) -> Vector:
    """L^-T v."""
    return f[0] * v[0] + f[1] * v[1] + f[3] * v[2], f[2] * v[1] + f[4] * v[2], f[5] * v[2]


@summing_device
def lower_times_transposed(f: Symmetric, m: Matrix) -> Matrix:
    """L^-1 m^T."""
    return (
        f[0] * m[0],
        f[0] * m[3],
        f[0] * m[6],
        f[1] * m[0] + f[2] * m[1],
        f[1] * m[3] + f[2] * m[4],
        f[1] * m[6] + f[2] * m[7],
        f[3] * m[0] + f[4] * m[1] + f[5] * m[2],
        f[3] * m[3] + f[4] * m[4] + f[5] * m[5],
        f[3] * m[6] + f[4] * m[7] + f[5] * m[8],
    )


@summing_device
def lower_product(f: Symmetric, m: Matrix) -> Matrix:
    """L^-1 m."""
    return (
        f[0] * m[0],
        f[0] * m[1],
        f[0] * m[2],
        f[1] * m[0] + f[2] * m[3],
        f[1] * m[1] + f[2] * m[4],
        f[1] * m[2] + f[2] * m[5],
        f[3] * m[0] + f[4] * m[3] + f[5] * m[6],
        f[3] * m[1] + f[4] * m[4] + f[5] * m[7],
        f[3] * m[2] + f[4] * m[5] + f[5] * m[8],
    )
