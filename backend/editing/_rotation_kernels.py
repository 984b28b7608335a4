"""Unit quaternions (w, x, y, z) in compiled loops. Not normalised on entry where the caller knows they are."""

from __future__ import annotations

from math import sqrt
from typing import Any

from ..kernels import device

_NO_LENGTH = 1e-30


@device
def rotate(q: Any, x: float, y: float, z: float) -> tuple[float, float, float]:
    """The vector turned by q (4,)."""
    w, a, b, c = q[0], q[1], q[2], q[3]
    tx = 2.0 * (b * z - c * y)
    ty = 2.0 * (c * x - a * z)
    tz = 2.0 * (a * y - b * x)
    return x + w * tx + b * tz - c * ty, y + w * ty + c * tx - a * tz, z + w * tz + a * ty - b * tx


@device
def multiply(p: Any, q: Any) -> tuple[float, float, float, float]:
    """The rotation q followed by p, both (4,)."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    )


@device
def turn_between(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> tuple[float, float, float, float]:
    """The smallest rotation that takes the direction a to the direction b; none where a length is 0 or b is -a."""
    lengths = sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz))
    w = lengths + ax * bx + ay * by + az * bz
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    norm = sqrt(w * w + x * x + y * y + z * z)
    if norm <= 1e-9 * lengths or lengths < _NO_LENGTH:
        return 1.0, 0.0, 0.0, 0.0
    return w / norm, x / norm, y / norm, z / norm
