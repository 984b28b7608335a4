"""Kernel of `synthesis.refinement`: how tightly strands curl."""

from __future__ import annotations

import math

import numba
import numpy as np

from ..kernels import device, parallel_kernel
from ..types import Floats

SHARP_TURN = 0.5 * math.pi


@device
def _chords(strand: Floats, chord: float, tangents: Floats) -> int:
    """Fill tangents (K, 3) with unit vectors between points of the strand `chord` apart in arc length; their number."""
    count = 0
    passed, target = 0.0, chord
    fx, fy, fz = np.float64(strand[0, 0]), np.float64(strand[0, 1]), np.float64(strand[0, 2])
    for i in range(len(strand) - 1):
        sx, sy, sz = strand[i + 1, 0] - strand[i, 0], strand[i + 1, 1] - strand[i, 1], strand[i + 1, 2] - strand[i, 2]
        length = math.sqrt(sx * sx + sy * sy + sz * sz)
        while length > 0.0 and passed + length >= target and count < len(tangents):
            share = (target - passed) / length
            x, y, z = strand[i, 0] + share * sx, strand[i, 1] + share * sy, strand[i, 2] + share * sz
            dx, dy, dz = x - fx, y - fy, z - fz
            size = math.sqrt(dx * dx + dy * dy + dz * dz)
            if size > 1e-12:
                tangents[count, 0], tangents[count, 1], tangents[count, 2] = dx / size, dy / size, dz / size
                count += 1
            fx, fy, fz = x, y, z
            target += chord
        passed += length
    return count


@device
def _rotation(tangents: Floats, i: int, turn: Floats) -> None:
    """turn (3,): the rotation from tangent i to i + 1, axis times angle."""
    ax, ay, az = tangents[i, 0], tangents[i, 1], tangents[i, 2]
    bx, by, bz = tangents[i + 1, 0], tangents[i + 1, 1], tangents[i + 1, 2]
    turn[0], turn[1], turn[2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    sine = math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    angle = math.atan2(sine, ax * bx + ay * by + az * bz)
    scale = angle / sine if sine > 1e-12 else 0.0
    for axis in range(3):
        turn[axis] *= scale


@device
def _curl_radius(strand: Floats, chord: float) -> float:
    n_points = len(strand)
    total = 0.0
    for i in range(n_points - 1):
        sx, sy, sz = strand[i + 1, 0] - strand[i, 0], strand[i + 1, 1] - strand[i, 1], strand[i + 1, 2] - strand[i, 2]
        total += math.sqrt(sx * sx + sy * sy + sz * sz)
    if total == 0.0:
        return np.inf
    arc = max(min(chord, 0.25 * total), total / (n_points - 1))
    tangents, before, after = np.empty((n_points, 3)), np.empty(3), np.empty(3)
    count = _chords(strand, arc * (1.0 - 1e-6), tangents)
    if count > 1:
        _rotation(tangents, 0, after)
    turning = 0.0
    for i in range(1, count - 1):
        before, after = after, before
        _rotation(tangents, i, after)
        together, alone = 0.0, 0.0
        for axis in range(3):
            together += (0.5 * (before[axis] + after[axis])) ** 2
            alone += after[axis] ** 2
        # beyond a right angle the axes of a tight curl's rotations scatter, and noise does not get there
        turning += max(together, alone) if alone > SHARP_TURN**2 else together
    return arc / math.sqrt(turning / (count - 2)) if turning > 0.0 else np.inf


@parallel_kernel
def measure_curl_radii(points: Floats, chord: float, radii: Floats) -> None:
    """radii (S,): radius of curvature of strands points (S, N, 3), root mean square over the strand of its inverse.

    Measured between chords of this arc length (longer where the points are farther apart). Two successive rotations
    are averaged, so that noise, which turns to and fro, does not count as a curl, which goes on turning.
    """
    for strand in numba.prange(len(points)):
        radii[strand] = _curl_radius(points[strand], chord)
