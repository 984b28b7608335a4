"""Numba kernel of `head`: the winding number of the fans that close an open mesh."""

from __future__ import annotations

from math import atan2, pi, sqrt
from typing import Any

from numba import prange

from ..kernels import parallel_kernel


@parallel_kernel
def add_fan_winding(points: Any, corners: Any, winding: Any) -> None:
    """Add to winding (n,) how often triangles with corners (m, 3, 3) wind around points (n, 3).

    Exact solid angles (van Oosterom and Strackee 1983): a few hundred large triangles, for which the tree of a fast
    winding number is slower than this sum.
    """
    for i in prange(points.shape[0]):
        total = 0.0
        for k in range(corners.shape[0]):
            ax, ay, az = (
                corners[k, 0, 0] - points[i, 0],
                corners[k, 0, 1] - points[i, 1],
                corners[k, 0, 2] - points[i, 2],
            )
            bx, by, bz = (
                corners[k, 1, 0] - points[i, 0],
                corners[k, 1, 1] - points[i, 1],
                corners[k, 1, 2] - points[i, 2],
            )
            cx, cy, cz = (
                corners[k, 2, 0] - points[i, 0],
                corners[k, 2, 1] - points[i, 1],
                corners[k, 2, 2] - points[i, 2],
            )
            a = sqrt(ax * ax + ay * ay + az * az)
            b = sqrt(bx * bx + by * by + bz * bz)
            c = sqrt(cx * cx + cy * cy + cz * cz)
            volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
            ab, bc, ca = ax * bx + ay * by + az * bz, bx * cx + by * cy + bz * cz, cx * ax + cy * ay + cz * az
            total += 2.0 * atan2(volume, a * b * c + ab * c + bc * a + ca * b)
        winding[i] += total / (4.0 * pi)
