"""Kernels of `interpolation.keep_out`: strands pushed out of a signed distance, smoothly along the strand."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from ..geometry._collider_kernels import FAR_OUTSIDE, sample_distance, sample_gradient
from ..kernels import device, parallel_kernel
from ..types import Float32, Float64, Int32

_TOLERANCE = 2e-5  # m, deeper than allowed that is let be
_PROJECTIONS = 6  # steps along the gradient of one point
_PASSES = 2  # pushes with the hair around going along; then what is still inside is pushed alone
_REACH, _REACH_PER_PUSH = 0.02, 4.0  # m along the strand, or times the push if that is more, that go along
_SAFE = 0.9  # share of a distance within which nothing can be inside, for the error of the grid


@device
def _into(matrix: Float64, x: float, y: float, z: float) -> Any:
    """The point in the space that a (4, 4) matrix leads to."""
    return (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + matrix[0, 3],
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + matrix[1, 3],
        matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3],
    )


@parallel_kernel
def deepen(points: Float32, distance: Float32, origin: Float64, cell: float, inverse: Float64, depths: Float32) -> None:
    """Raise depths (P,) to how deep points (P, 3) are inside, metres."""
    for i in numba.prange(len(points)):
        x, y, z = _into(inverse, points[i, 0], points[i, 1], points[i, 2])
        depths[i] = max(depths[i], np.float32(-sample_distance(distance, origin, cell, x, y, z)))


@device
def _way_out(
    point: Float64, allowed: float, distance: Float32, origin: Float64, cell: float, matrix: Float64, inverse: Float64,
    push: Float64,
) -> float:  # fmt: skip
    """push (3,): what brings a point out, 0 where it is allowed to be; returns the distance at the point."""
    first_x, first_y, first_z = _into(inverse, point[0], point[1], point[2])
    x, y, z = first_x, first_y, first_z
    at_point = FAR_OUTSIDE
    for step in range(_PROJECTIONS):
        value = sample_distance(distance, origin, cell, x, y, z)
        if step == 0:
            at_point = value
        if value >= -allowed - _TOLERANCE:
            break
        along_x, along_y, along_z = sample_gradient(distance, origin, cell, x, y, z)
        size = math.sqrt(along_x * along_x + along_y * along_y + along_z * along_z)
        if size < 1e-6:  # the middle of a solid: no way is the way out
            break
        # the full gap even where the gradient is short, which it is near edges; the next step mends it
        way = (-allowed - value) / size
        x += way * along_x
        y += way * along_y
        z += way * along_z
    dx, dy, dz = x - first_x, y - first_y, z - first_z
    for axis in range(3):
        push[axis] = matrix[axis, 0] * dx + matrix[axis, 1] * dy + matrix[axis, 2] * dz
    return at_point


@device
def _pushes(
    points: Float32, first: int, reached: Float64, allowed: Float32, distance: Float32, origin: Float64, cell: float,
    matrix: Float64, inverse: Float64, pushes: Float64,
) -> bool:  # fmt: skip
    """pushes (n, 3) of the points of a strand, the root's 0; False if there are none.

    A point far outside clears those after it as far as its distance goes.
    """
    any_inside = False
    safe_until = 0.0
    point = np.empty(3)
    for i in range(1, len(reached)):
        pushes[i] = 0.0
        if reached[i] < safe_until:
            continue
        for axis in range(3):
            point[axis] = points[first + i, axis]
        value = _way_out(point, allowed[first + i], distance, origin, cell, matrix, inverse, pushes[i])
        if value == FAR_OUTSIDE:
            continue
        safe_until = reached[i] + _SAFE * value - cell
        if pushes[i, 0] != 0.0 or pushes[i, 1] != 0.0 or pushes[i, 2] != 0.0:
            any_inside = True
    return any_inside


@device
def _spread(pushes: Float64, reached: Float64, spread: Float64) -> None:
    """spread (n, 3): each point goes as far as the farthest that pulls it along, where they pull it together."""
    n_points = len(reached)
    most = np.zeros(n_points)
    spread[:] = 0.0
    for i in range(1, n_points):
        size = math.sqrt(pushes[i, 0] ** 2 + pushes[i, 1] ** 2 + pushes[i, 2] ** 2)
        if size == 0.0:
            continue
        reach = max(_REACH, _REACH_PER_PUSH * size)
        for j in range(1, n_points):
            away = abs(reached[j] - reached[i]) / reach
            if away < 1.0:
                # the root holds what is nearer to it than to the point that is pushed
                share = (1.0 - away * away) ** 2 * min(1.0, reached[j] / max(min(reach, reached[i]), 1e-9))
                most[j] = max(most[j], share * size)
                for axis in range(3):
                    spread[j, axis] += share * pushes[i, axis]
    for j in range(1, n_points):
        size = math.sqrt(spread[j, 0] ** 2 + spread[j, 1] ** 2 + spread[j, 2] ** 2)
        if size > 0.0:
            for axis in range(3):
                spread[j, axis] *= most[j] / size


@parallel_kernel
def push_out(
    points: Float32, offsets: Int32, allowed: Float32, distance: Float32, origin: Float64, cell: float,
    matrix: Float64, inverse: Float64,
) -> None:  # fmt: skip
    """Move points (P, 3) that are deeper inside than allowed (P,), and the hair around them; a strand's roots stay."""
    for strand in numba.prange(len(offsets) - 1):
        first, count = offsets[strand], offsets[strand + 1] - offsets[strand]
        reached = np.zeros(count)
        for i in range(1, count):
            square = 0.0
            for axis in range(3):
                square += (points[first + i, axis] - points[first + i - 1, axis]) ** 2
            reached[i] = reached[i - 1] + math.sqrt(square)
        pushes, spread = np.empty((count, 3)), np.empty((count, 3))
        for turn in range(_PASSES + 1):
            if not _pushes(points, first, reached, allowed, distance, origin, cell, matrix, inverse, pushes):
                break
            if turn < _PASSES:
                _spread(pushes, reached, spread)
            else:
                spread[:] = pushes
            for i in range(1, count):
                for axis in range(3):
                    points[first + i, axis] += spread[i, axis]
