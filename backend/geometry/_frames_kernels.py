"""Numba kernels of `frames`: minimal rotation along polylines (M-6)."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numba import prange

from ..kernels import device, parallel_kernel

# Shorter than this share of the strand's longest segment, a segment has no direction of its own.
_ZERO_SHARE = 1e-7


@device
def _set_first_normal(normal: Any, tangent: Any) -> None:
    """Make `normal` a unit vector orthogonal to the unit `tangent`; any orthogonal one where it is parallel or zero."""
    length = sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if length > 0.0:
        for c in range(3):
            normal[c] /= length
    along = normal[0] * tangent[0] + normal[1] * tangent[1] + normal[2] * tangent[2]
    for c in range(3):
        normal[c] -= along * tangent[c]
    length = sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if length < 1e-6:
        # parallel: start from the axis that is farthest from the tangent
        axis = 0
        for c in range(1, 3):
            if abs(tangent[c]) < abs(tangent[axis]):
                axis = c
        for c in range(3):
            normal[c] = -tangent[axis] * tangent[c]
        normal[axis] += 1.0
        length = sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    for c in range(3):
        normal[c] /= length


@device
def _turn(normal: Any, before: Any, after: Any) -> None:
    """Rotate `normal` by the smallest rotation that takes the unit vector `before` to the unit vector `after`.

    Bloomenthal's rotation about before x after, as two reflections without any trigonometry. A turn of 180 degrees has
    no smallest rotation: the normal is kept, that is, the strand turns in its binormal plane.
    """
    cosine = before[0] * after[0] + before[1] * after[1] + before[2] * after[2]
    if cosine < -1.0 + 1e-9:
        return
    dot = (normal[0] * after[0] + normal[1] * after[1] + normal[2] * after[2]) / (1.0 + cosine)
    for c in range(3):
        normal[c] -= dot * (before[c] + after[c])
    # rounding must not add up over a long strand
    along = normal[0] * after[0] + normal[1] * after[1] + normal[2] * after[2]
    for c in range(3):
        normal[c] -= along * after[c]
    length = sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    for c in range(3):
        normal[c] /= length


@device
def _unit_segments(points: Any, tangents: Any) -> None:
    """Unit directions of the segments; a zero-length one takes its predecessor's, leading ones their successor's."""
    count = points.shape[0] - 1
    longest = 0.0
    for i in range(count):
        square = 0.0
        for c in range(3):
            tangents[i, c] = points[i + 1, c] - points[i, c]
            square += tangents[i, c] ** 2
        longest = max(longest, square)
    limit = sqrt(longest) * _ZERO_SHARE
    first = -1
    for i in range(count):
        length = sqrt(tangents[i, 0] ** 2 + tangents[i, 1] ** 2 + tangents[i, 2] ** 2)
        if length > limit:
            for c in range(3):
                tangents[i, c] /= length
            if first < 0:
                first = i
        elif first >= 0:
            for c in range(3):
                tangents[i, c] = tangents[i - 1, c]
    if first < 0:
        for i in range(count):
            tangents[i, 0], tangents[i, 1], tangents[i, 2] = 0.0, 0.0, 1.0
    for i in range(first):
        for c in range(3):
            tangents[i, c] = tangents[first, c]


@parallel_kernel
def transport(points: Any, start_normals: Any, frames: Any) -> None:
    """frames (S, N, 3, 3), columns normal, binormal, tangent, from points (S, N, 3) and start_normals (S, 3)."""
    n_strands, n_points = points.shape[0], points.shape[1]
    for s in prange(n_strands):
        tangents = np.empty((n_points, 3))
        normal = np.empty(3)
        if n_points > 1:
            _unit_segments(points[s], tangents)
            # the frame of a point belongs to the segment that leaves it; the tip has its last segment's
            for c in range(3):
                tangents[n_points - 1, c] = tangents[n_points - 2, c]
        else:
            tangents[0, 0], tangents[0, 1], tangents[0, 2] = 0.0, 0.0, 1.0
        for c in range(3):
            normal[c] = start_normals[s, c]
        _set_first_normal(normal, tangents[0])
        for i in range(n_points):
            t = tangents[i]
            if i > 0:
                _turn(normal, tangents[i - 1], t)
            frames[s, i, 0, 1] = t[1] * normal[2] - t[2] * normal[1]
            frames[s, i, 1, 1] = t[2] * normal[0] - t[0] * normal[2]
            frames[s, i, 2, 1] = t[0] * normal[1] - t[1] * normal[0]
            for c in range(3):
                frames[s, i, c, 0] = normal[c]
                frames[s, i, c, 2] = t[c]
