"""Combed hair back in its object's own space, where what was not combed keeps its bits."""

from __future__ import annotations

import numpy as np

from ..errors import require
from ..types import Float32, Float64
from ._object_space_kernels import place_moved


def return_to_object(
    points: Float32, points_before: Float32, positions_before: Float32, world_to_object: Float64
) -> Float32:
    """Positions in the object's space of points that were partly moved in world space.

    points, points_before : (P, 3), world space, metres, now and before. positions_before : (P, 3), the same points
    before in the object's space. world_to_object : (4, 4).

    Returns
    -------
    (P, 3) float32. A point that did not move has exactly its position of before; going to world space and back would
    round it.

    Raises
    ------
    InputError : different numbers of points.
    """
    same = points.shape == points_before.shape == positions_before.shape
    require(same, f"there are {len(points)} points now and {len(positions_before)} before; they must be the same")
    positions = np.empty_like(positions_before)
    place_moved(points, points_before, positions_before, np.asarray(world_to_object, np.float64), positions)
    return positions
