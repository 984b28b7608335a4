"""Numba kernels of `helices`: points and frames along chains of helical elements (Bao & Qi 2017, eq. 8)."""

from __future__ import annotations

from math import cos, sin, sqrt
from typing import Any

import numpy as np
from numba import prange

from ..kernels import device, parallel_kernel

# Below this turn of an element (radians) the closed forms lose digits and their series are used.
_SMALL_TURN = 0.1


@device
def turn_coefficients(omega: float, s: float) -> tuple[float, float, float]:
    """(sin(ws)/w, (1 - cos ws)/w^2, (ws - sin ws)/w^3) for w = omega; series where ws is small."""
    turn = omega * s
    if turn < _SMALL_TURN:
        x = turn * turn
        first = s * (1.0 - x / 6.0 * (1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0))))
        second = s * s * 0.5 * (1.0 - x / 12.0 * (1.0 - x / 30.0 * (1.0 - x / 56.0 * (1.0 - x / 90.0))))
        third = s * s * s / 6.0 * (1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0 * (1.0 - x / 110.0))))
        return first, second, third
    sine = sin(turn)
    return sine / omega, (1.0 - cos(turn)) / (omega * omega), (turn - sine) / (omega * omega * omega)


@device
def advance(base: Any, curvature: Any, s: float, point: Any, frame: Any) -> None:
    """Point (3,) and frame (3, 3) at arc length s of an element with the base (3, 4): columns n0, n1, n2, position.

    frame(s) = R exp(s [q]x), position(s) = p + R (s t + B q x t + C q x (q x t)) with t = (1, 0, 0).
    """
    u0, u1, u2 = curvature[0], curvature[1], curvature[2]
    square = u0 * u0 + u1 * u1 + u2 * u2
    a, b, c = turn_coefficients(sqrt(square), s)
    along, side, up = s + c * (u0 * u0 - square), b * u2 + c * u0 * u1, -b * u1 + c * u0 * u2
    t0, t1, t2 = 1.0 + b * (u0 * u0 - square), a * u2 + b * u0 * u1, -a * u1 + b * u0 * u2
    m0, m1, m2 = -a * u2 + b * u0 * u1, 1.0 + b * (u1 * u1 - square), a * u0 + b * u1 * u2
    k0, k1, k2 = a * u1 + b * u0 * u2, -a * u0 + b * u1 * u2, 1.0 + b * (u2 * u2 - square)
    for i in range(3):
        r0, r1, r2 = base[i, 0], base[i, 1], base[i, 2]
        point[i] = base[i, 3] + r0 * along + r1 * side + r2 * up
        frame[i, 0] = r0 * t0 + r1 * t1 + r2 * t2
        frame[i, 1] = r0 * m0 + r1 * m1 + r2 * m2
        frame[i, 2] = r0 * k0 + r1 * k1 + r2 * k2


@parallel_kernel
def evaluate_helices(
    roots: Any,
    frames: Any,
    offsets: Any,
    lengths: Any,
    curvatures: Any,
    point_offsets: Any,
    points: Any,
    frames_out: Any,
) -> None:
    """Strand s at point_offsets[s + 1] - point_offsets[s] equal steps of its arc length, root and tip included.

    roots (S, 3), frames (S, 3, 3), offsets (S + 1,), lengths (E,), curvatures (E, 3) as in `Helices`;
    points (P, 3) and frames_out (P, 3, 3) are written. A strand of one point is its root.
    """
    for s in prange(roots.shape[0]):
        base, tip, turned = np.empty((3, 4)), np.empty(3), np.empty((3, 3))
        for i in range(3):
            base[i, 3] = roots[s, i]
            for j in range(3):
                base[i, j] = frames[s, i, j]
        total = 0.0
        for e in range(offsets[s], offsets[s + 1]):
            total += lengths[e]
        first, end = point_offsets[s], point_offsets[s + 1]
        step = total / max(end - first - 1, 1)
        p, before = first, 0.0
        for e in range(offsets[s], offsets[s + 1]):
            last = e == offsets[s + 1] - 1
            while p < end and (last or (p - first) * step < before + lengths[e]):
                at = min((p - first) * step - before, lengths[e])
                if last and p == end - 1 and p > first:
                    at = lengths[e]
                advance(base, curvatures[e], at, points[p], frames_out[p])
                p += 1
            advance(base, curvatures[e], lengths[e], tip, turned)
            for i in range(3):
                base[i, 3] = tip[i]
                for j in range(3):
                    base[i, j] = turned[i, j]
            before += lengths[e]
