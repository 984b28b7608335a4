"""Kinematics of one helical element in closed form, and the quadrature along it (B-24, M-25).

Vectors are tuples of 3 floats, matrices tuples of 9 in rows, so that they live in registers. An element starts at the
frame R (columns n0, n1, n2) with the constant Darboux vector u = R q and the tangent t = n0; at the arc length s

    frame(s) = exp(s [u]x) R,   offset(s) = s t + A u x t + B u x (u x t),   w = |u|,
    A = (1 - cos ws)/w^2,       B = (ws - sin ws)/w^3.

Every formula holds in any axes that u, t and R are all given in: world axes (u = R q), or the element's own (u = q,
t = (1, 0, 0), R = identity).
"""

from __future__ import annotations

import math

import numpy as np

from ..kernels import summing_device
from ._matrix_kernels import Matrix, Vector, cross, dot

Coefficients = tuple[float, float, float, float]

N_QUADRATURE = 3
"""Gauss-Legendre points an element: exact for the mass of a straight element (degree 4 of 5)."""
NODES = np.array([0.5 - math.sqrt(0.15), 0.5, 0.5 + math.sqrt(0.15)])
"""(Q,) float64, places of the points as fractions of the element's length, root to tip."""
WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
"""(Q,) float64, sum 1."""

# (ws)^2 up to which the series of 10 terms serve: the first one left out is below 1e-15 of the sum there
_SERIES_END = 4.0
_N_TERMS = 10
_C_SERIES = tuple((-1.0) ** k * 2 * k / math.factorial(2 * k + 2) for k in range(1, _N_TERMS + 1))
_D_SERIES = tuple((-1.0) ** k * 2 * k / math.factorial(2 * k + 3) for k in range(1, _N_TERMS + 1))


@summing_device
def coefficients(w: float, s: float) -> Coefficients:
    """A, B, A_w / w, B_w / w at the arc length s >= 0 for the total curvature w >= 0; all 0 at s = 0.

    With x = (ws)^2: A = s^2 a, B = s^3 b, A_w / w = s^4 c, B_w / w = s^5 d. c and d come from their series, or in
    closed form where x is large; a and b from b (6 + x) = 1 - x (c + 2 d) and a = 3 b + x d, which lose no digits.
    """
    x = w * w * s * s
    if x < _SERIES_END:
        c = _C_SERIES[_N_TERMS - 1]
        d = _D_SERIES[_N_TERMS - 1]
        for k in range(_N_TERMS - 2, -1, -1):
            c = c * x + _C_SERIES[k]
            d = d * x + _D_SERIES[k]
    else:
        angle = math.sqrt(x)
        sine, cosine = math.sin(angle), math.cos(angle)
        c = (angle * sine - 2.0 * (1.0 - cosine)) / (x * x)
        d = (3.0 * sine - angle * (2.0 + cosine)) / (x * x * angle)
    b = (1.0 - x * (c + 2.0 * d)) / (6.0 + x)
    a = 3.0 * b + x * d
    square = s * s
    return square * a, square * s * b, square * square * c, square * square * s * d


@summing_device
def element_offset(c: Coefficients, s: float, t: Vector, u: Vector) -> Vector:
    """(3) position at s from the element's start; c = coefficients(|u|, s)."""
    first = cross(u, t)
    second = cross(u, first)
    return (
        s * t[0] + c[0] * first[0] + c[1] * second[0],
        s * t[1] + c[0] * first[1] + c[1] * second[1],
        s * t[2] + c[0] * first[2] + c[1] * second[2],
    )


@summing_device
def element_gradient(c: Coefficients, t: Vector, u: Vector) -> Matrix:
    """(9) d offset(s) / d u; times R it is the derivative by q. c = coefficients(|u|, s).

    -A [t]x + (u x t) A_w/w u^T + B ((u.t) I + u t^T - 2 t u^T) + (u x (u x t)) B_w/w u^T
    """
    first = cross(u, t)
    second = cross(u, first)
    a, b = c[0], c[1]
    v0 = c[2] * first[0] + c[3] * second[0] - 2.0 * b * t[0]
    v1 = c[2] * first[1] + c[3] * second[1] - 2.0 * b * t[1]
    v2 = c[2] * first[2] + c[3] * second[2] - 2.0 * b * t[2]
    along = b * dot(u, t)
    b0, b1, b2 = b * u[0], b * u[1], b * u[2]
    return (
        along + b0 * t[0] + v0 * u[0],
        a * t[2] + b0 * t[1] + v0 * u[1],
        -a * t[1] + b0 * t[2] + v0 * u[2],
        -a * t[2] + b1 * t[0] + v1 * u[0],
        along + b1 * t[1] + v1 * u[1],
        a * t[0] + b1 * t[2] + v1 * u[2],
        a * t[1] + b2 * t[0] + v2 * u[0],
        -a * t[0] + b2 * t[1] + v2 * u[1],
        along + b2 * t[2] + v2 * u[2],
    )


@summing_device
def element_turn(c: Coefficients, s: float, u: Vector) -> Matrix:
    """(9) W = int_0^s exp(s'[u]x) ds' = s I + A [u]x + B [u]x^2: the angular rate at s of a rate u' is W u'."""
    a, b = c[0], c[1]
    x, y, z = u[0], u[1], u[2]
    xy, xz, yz = b * x * y, b * x * z, b * y * z
    return (
        s - b * (y * y + z * z),
        xy - a * z,
        xz + a * y,
        xy + a * z,
        s - b * (x * x + z * z),
        yz - a * x,
        xz - a * y,
        yz + a * x,
        s - b * (x * x + y * y),
    )


@summing_device
def turned_frame(c: Coefficients, s: float, u: Vector, frame: Matrix) -> Matrix:
    """(9) exp(s [u]x) R: the frame at s of an element that starts at `frame`, given in the same axes as u."""
    a = c[0]
    sine = s - c[1] * dot(u, u)
    x, y, z = u[0], u[1], u[2]
    r00, r01, r02 = 1.0 - a * (y * y + z * z), a * x * y - sine * z, a * x * z + sine * y
    r10, r11, r12 = a * x * y + sine * z, 1.0 - a * (x * x + z * z), a * y * z - sine * x
    r20, r21, r22 = a * x * z - sine * y, a * y * z + sine * x, 1.0 - a * (x * x + y * y)
    f = frame
    return (
        r00 * f[0] + r01 * f[3] + r02 * f[6],
        r00 * f[1] + r01 * f[4] + r02 * f[7],
        r00 * f[2] + r01 * f[5] + r02 * f[8],
        r10 * f[0] + r11 * f[3] + r12 * f[6],
        r10 * f[1] + r11 * f[4] + r12 * f[7],
        r10 * f[2] + r11 * f[5] + r12 * f[8],
        r20 * f[0] + r21 * f[3] + r22 * f[6],
        r20 * f[1] + r21 * f[4] + r22 * f[7],
        r20 * f[2] + r21 * f[5] + r22 * f[8],
    )
