"""Frames along strands that turn as little as possible."""

from __future__ import annotations

import numpy as np

from ..errors import require
from ..types import Float32, Floats
from ._frames_kernels import transport


def transport_frames(points: Floats, start_normals: Floats) -> Float32:
    """Carry a frame along each strand with minimal rotation (Bloomenthal 1990; M-6; W-A1, W-A2).

    The frame of point i has the direction of segment i -> i + 1 as its tangent (the tip: of the last segment). From one
    segment to the next it turns by the smallest rotation that takes one tangent to the other. A zero-length segment
    takes the direction before it (at the root: after it; a strand of no length: z). At a turn back by 180 degrees,
    where no smallest rotation exists, the normal is kept.

    Parameters
    ----------
    points : (S, N, 3) float, any unit and space.
    start_normals : (S, 3) float, the wanted normal at each root in the same space; made orthogonal to the first
        tangent. Where it is zero or parallel to the tangent, the coordinate axis farthest from the tangent is used.

    Returns
    -------
    (S, N, 3, 3) float32 : rotations whose columns are normal, binormal = tangent x normal, and tangent.

    Raises
    ------
    InputError : the shapes do not fit.
    """
    points = np.asarray(points)
    start_normals = np.asarray(start_normals)
    require(points.ndim == 3 and points.shape[2] == 3, f"points must have shape (S, N, 3), not {points.shape}")
    require(points.shape[1] > 0, "strands must have a point to carry a frame along")
    wanted = (len(points), 3)
    require(start_normals.shape == wanted, f"start normals must have shape {wanted}, not {start_normals.shape}")
    frames = np.empty((*points.shape, 3), np.float32)
    transport(np.ascontiguousarray(points), np.ascontiguousarray(start_normals), frames)
    return frames
