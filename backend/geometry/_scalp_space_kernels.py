"""Numba kernels of `scalp_space`. The device functions are meant for the kernels of fields/ too.

Paper symbols: (u, v) scalp coordinates, w height over the scalp, d the height map, S0 = (0, -1, 0),
cot u = x^ / (y^ + 1), cot v = z^ / (y^ + 1). theta is a direction's angle from +y; W-6 remaps it before eq. (1).
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import Any

import numpy as np
from numba import prange

from ..kernels import device, kernel, parallel_kernel


@device
def bilinear(table: Any, u: float, v: float) -> Any:
    """Value at (u, v) of `table` (H, H) over [0, pi]^2; row i is v = pi i / (H - 1), column j is u = pi j / (H - 1)."""
    last = table.shape[0] - 1
    column = min(max(u * (last / pi), 0.0), float(last))
    row = min(max(v * (last / pi), 0.0), float(last))
    j, i = min(int(column), last - 1), min(int(row), last - 1)
    a, b = column - j, row - i
    low = table[i, j] + a * (table[i, j + 1] - table[i, j])
    high = table[i + 1, j] + a * (table[i + 1, j + 1] - table[i + 1, j])
    return low + b * (high - low)


@device
def arc_cotangent(h: float, x: float) -> Any:
    """atan2(h, x) for h >= 0, to 5e-11 and several times as fast (tracing strands asks for millions of them).

    The coefficients are those of the Chebyshev interpolation of atan(t) / t as a polynomial in t^2 on [0, 1].
    """
    size = abs(x)
    t = min(size, h) / max(max(size, h), 1e-300)
    s = t * t
    high = 0.07242284149051165 + s * (-0.05421530857823045 + s * (0.034133423246630976 + s * -0.01605516088854717))
    high += s * s * s * s * (0.004827227899255563 + s * -0.0006804972987973854)
    low = 0.9999999999390123 + s * (-0.3333333151819836 + s * 0.19999909957025838)
    low += s * s * s * (-0.1428394842130953 + s * (0.1109298478799497 + s * -0.08979051051176454))
    angle = t * (low + s * s * s * s * s * s * high)
    if size >= h:
        return pi - angle if x < 0.0 else angle
    return 0.5 * pi - angle if x > 0.0 else 0.5 * pi + angle


@device
def remap_polar(theta: float, polar_scale: float) -> Any:
    """The polar angle after the remap of W-6.

    Up to pi / 2 / polar_scale, where the scalp ends, it is multiplied by polar_scale, so the scalp fills the upper
    hemisphere; from there a parabola goes on with the same slope and takes pi to pi, so that all directions are
    mapped one to one and S0 stays the only singularity.
    """
    rim = 0.5 * pi / polar_scale
    if theta <= rim:
        return polar_scale * theta
    rest = pi - rim
    beyond = min(theta - rim, rest)
    bend = (0.5 * pi - polar_scale * rest) / (rest * rest)
    return 0.5 * pi + beyond * (polar_scale + bend * beyond)


@device
def unmap_polar(mapped: float, polar_scale: float) -> Any:
    """The polar angle whose remap is `mapped`."""
    beyond = mapped - 0.5 * pi
    if beyond <= 0.0:
        return mapped / polar_scale
    rim = 0.5 * pi / polar_scale
    rest = pi - rim
    bend = (0.5 * pi - polar_scale * rest) / (rest * rest)
    return rim + 2.0 * beyond / (polar_scale + sqrt(polar_scale * polar_scale + 4.0 * bend * beyond))


@device
def uv_from_direction(x: float, y: float, z: float, polar_scale: float) -> tuple[float, float]:
    """(u, v) of the unit direction (x, y, z): remap of W-6, then eq. (1)."""
    across = sqrt(x * x + z * z)
    if polar_scale < 1.0 and across > 0.0:
        half = 0.5 * remap_polar(arc_cotangent(across, y), polar_scale)
        # y^ + 1 = 2 cos^2 half, and the distance from the axis is 2 sin half cos half
        h, out = cos(half), sin(half) / across
        return arc_cotangent(h, out * x), arc_cotangent(h, out * z)
    h = y + 1.0
    if y < -0.5:
        # the digits that y + 1 loses near S0 come back from x and z
        h = across * across / (1.0 - y)
    return arc_cotangent(h, x), arc_cotangent(h, z)


@device
def direction_from_uv(u: float, v: float, polar_scale: float) -> tuple[float, float, float]:
    """The unit direction at (u, v): eq. (2) times sin^2 u sin^2 v, so that the border, S0, is sound; W-6 undone."""
    su, cu, sv, cv = sin(u), cos(u), sin(v), cos(v)
    a, b, s = cu * sv, cv * su, su * sv
    total = a * a + b * b + s * s
    if total <= 0.0:
        return 0.0, -1.0, 0.0
    factor = 2.0 * s / total
    # y = h - 1 with h = 2 s^2 / total
    x, y, z = factor * a, (s * s - a * a - b * b) / total, factor * b
    across = sqrt(x * x + z * z)
    if polar_scale < 1.0 and across > 0.0:
        theta = unmap_polar(arc_cotangent(across, y), polar_scale)
        out = sin(theta) / across
        return out * x, cos(theta), out * z
    return x, y, z


@device
def scalp_from_head(x: float, y: float, z: float, polar_scale: float, height: Any) -> tuple[float, float, float]:
    """(u, v, w) of the head-space point (x, y, z), eq. (1); the centre has the direction +y."""
    r = sqrt(x * x + y * y + z * z)
    if r < 1e-30:
        u, v = 0.5 * pi, 0.5 * pi
    else:
        u, v = uv_from_direction(x / r, y / r, z / r, polar_scale)
    return u, v, r - bilinear(height, u, v)


@device
def head_from_scalp(u: float, v: float, w: float, polar_scale: float, height: Any) -> tuple[float, float, float]:
    """The head-space point at (u, v, w), eq. (2)."""
    x, y, z = direction_from_uv(u, v, polar_scale)
    r = w + bilinear(height, u, v)
    return r * x, r * y, r * z


@device
def frame_from_normal(x: float, y: float, z: float, frame: Any) -> None:
    """frame (3, 3): the smallest rotation that takes +y to the unit (x, y, z) (W-5); at -y a half turn about x."""
    if y < -1.0 + 1e-9:
        frame[0, 0], frame[0, 1], frame[0, 2] = 1.0, 0.0, 0.0
        frame[1, 0], frame[1, 1], frame[1, 2] = 0.0, -1.0, 0.0
        frame[2, 0], frame[2, 1], frame[2, 2] = 0.0, 0.0, -1.0
        return
    # axis y x n = (z, 0, -x), cosine y
    s = 1.0 / (1.0 + y)
    frame[0, 0], frame[0, 1], frame[0, 2] = 1.0 - s * x * x, x, -s * x * z
    frame[1, 0], frame[1, 1], frame[1, 2] = -x, y, -z
    frame[2, 0], frame[2, 1], frame[2, 2] = -s * x * z, z, 1.0 - s * z * z


@device
def frame_at(u: float, v: float, normal: Any, frame: Any) -> None:
    """frame (3, 3), columns tangent, normal, binormal, of the scalp below (u, v); `normal` is the (3, H, H) map."""
    x, y, z = bilinear(normal[0], u, v), bilinear(normal[1], u, v), bilinear(normal[2], u, v)
    length = sqrt(x * x + y * y + z * z)
    frame_from_normal(x / length, y / length, z / length, frame)


@parallel_kernel
def map_to_scalp(points: Any, polar_scale: float, height: Any, result: Any) -> None:
    """result (n, 3) u, v, w of head-space points (n, 3)."""
    for i in prange(points.shape[0]):
        u, v, w = scalp_from_head(points[i, 0], points[i, 1], points[i, 2], polar_scale, height)
        result[i, 0], result[i, 1], result[i, 2] = u, v, w


@parallel_kernel
def map_from_scalp(coordinates: Any, polar_scale: float, height: Any, result: Any) -> None:
    """result (n, 3) head-space points of (n, 3) u, v, w."""
    for i in prange(coordinates.shape[0]):
        x, y, z = head_from_scalp(coordinates[i, 0], coordinates[i, 1], coordinates[i, 2], polar_scale, height)
        result[i, 0], result[i, 1], result[i, 2] = x, y, z


@parallel_kernel
def map_directions(uv: Any, polar_scale: float, result: Any) -> None:
    """result (n, 3) unit directions at uv (n, 2)."""
    for i in prange(uv.shape[0]):
        x, y, z = direction_from_uv(uv[i, 0], uv[i, 1], polar_scale)
        result[i, 0], result[i, 1], result[i, 2] = x, y, z


@kernel
def unmap_angles(mapped: Any, polar_scale: float, result: Any) -> None:
    """result (n, 2): the polar angle before the remap of W-6, and its derivative by `mapped` (n,)."""
    rim = 0.5 * pi / polar_scale
    rest = pi - rim
    bend = (0.5 * pi - polar_scale * rest) / (rest * rest)
    for i in range(mapped.shape[0]):
        theta = unmap_polar(mapped[i], polar_scale)
        result[i, 0] = theta
        result[i, 1] = 1.0 / (polar_scale + 2.0 * bend * max(theta - rim, 0.0))


@parallel_kernel
def map_frames(uv: Any, normal: Any, frames: Any) -> None:
    """frames (n, 3, 3) at uv (n, 2)."""
    for i in prange(uv.shape[0]):
        frame_at(uv[i, 0], uv[i, 1], normal, frames[i])


@parallel_kernel
def apply_affine(points: Any, before: Any, matrix: Any, after: Any, result: Any) -> None:
    """result (n, 3) = matrix (3, 3) @ (points - before) + after, all in float64 inside."""
    for i in prange(points.shape[0]):
        x, y, z = points[i, 0] - before[0], points[i, 1] - before[1], points[i, 2] - before[2]
        for c in range(3):
            result[i, c] = matrix[c, 0] * x + matrix[c, 1] * y + matrix[c, 2] * z + after[c]


@parallel_kernel
def to_root_frames(points: Any, matrix: Any, frames: Any, result: Any) -> None:
    """result (S, N, 3) = frames^T matrix (point - root) of world strands points (S, N, 3)."""
    for s in prange(points.shape[0]):
        turn = np.zeros((3, 3))
        for a in range(3):
            for b in range(3):
                for c in range(3):
                    turn[a, b] += frames[s, c, a] * matrix[c, b]
        rx, ry, rz = points[s, 0, 0], points[s, 0, 1], points[s, 0, 2]
        for i in range(points.shape[1]):
            x, y, z = points[s, i, 0] - rx, points[s, i, 1] - ry, points[s, i, 2] - rz
            for c in range(3):
                result[s, i, c] = turn[c, 0] * x + turn[c, 1] * y + turn[c, 2] * z


@parallel_kernel
def from_root_frames(points: Any, frames: Any, roots: Any, matrix: Any, after: Any, result: Any) -> None:
    """result (S, N, 3), world = matrix (root + frame point) + after for strands points (S, N, 3) in root frames."""
    for s in prange(points.shape[0]):
        turn = np.zeros((3, 3))
        root = np.zeros(3)
        for a in range(3):
            root[a] = after[a]
            for c in range(3):
                root[a] += matrix[a, c] * roots[s, c]
                for b in range(3):
                    turn[a, b] += matrix[a, c] * frames[s, c, b]
        for i in range(points.shape[1]):
            x, y, z = points[s, i, 0], points[s, i, 1], points[s, i, 2]
            for c in range(3):
                result[s, i, c] = turn[c, 0] * x + turn[c, 1] * y + turn[c, 2] * z + root[c]
