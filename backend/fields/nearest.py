"""Values carried to where none are known from the nearest place that has one."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..types import Bools, Float64, Floats
from .grid import DirectionGrid


def fill_pixels(values: NDArray[Any], known: Bools) -> NDArray[Any]:
    """`values` (H, W, ...) with every pixel that is not `known` (H, W) taking the nearest known one's."""
    if known.all() or not known.any():
        return values
    _, labels = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    chosen = np.zeros(int(labels.max()) + 1, np.int64)
    chosen[labels[known]] = np.flatnonzero(known)
    flat = values.reshape(known.size, -1)
    return np.asarray(flat[chosen[labels.ravel()]].reshape(values.shape))


def vectors_at(grid: DirectionGrid, points: Floats) -> tuple[Float64, Float64]:
    """The field of a dense grid at points (..., 3) of its space, trilinear; where no cell has any, the nearest cell's.

    Returns
    -------
    vectors (..., 3) float64, not normalised, and their lengths (..., 1). grid : with at least one direction.
    """
    own = grid.dense()
    nearest = ndimage.distance_transform_edt(~own.any(axis=3), return_distances=False, return_indices=True)
    filled = own[tuple(nearest)]
    places = np.moveaxis((points - grid.origin) / grid.spacing - 0.5, -1, 0)
    vectors = np.stack(
        [ndimage.map_coordinates(filled[..., axis], places, order=1, mode="nearest") for axis in range(3)], axis=-1
    ).astype(np.float64)
    return vectors, np.linalg.norm(vectors, axis=-1, keepdims=True)
