"""What the views see of a surface's texels: pixels, visibility, weights (Z-12, Z-14, Z-15)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Bools, Float32, check_array


@dataclass(frozen=True, slots=True)
class ViewsOnTexels:
    """T texels in n views, of one scale.

    pixels : (n, T, 2) float32, where each texel lies in each view (x right, y down).
    visible : (n, T) bool, unobstructed, in the picture and in the hair mask, from any angle.
    seen : (n, T) bool, the source region S of Z-15: visible, and less than 45 degrees between normal and view.
    facing : (n, T) float32 in [0, 1], dot(normal, direction towards the camera), 0 where negative.
    """

    pixels: Float32
    visible: Bools
    seen: Bools
    facing: Float32

    def __post_init__(self) -> None:
        check_array("pixels", self.pixels, np.float32, (None, None, 2))
        shape = self.pixels.shape[:2]
        check_array("visible", self.visible, np.bool_, shape)
        check_array("seen", self.seen, np.bool_, shape)
        check_array("facing", self.facing, np.float32, shape)

    @property
    def alpha(self) -> Float32:
        """(n, T) float32: `facing`, normalised to sum 1 over the views; 0 where no view faces the texel (Z-14)."""
        total = self.facing.sum(axis=0)
        return np.asarray(self.facing / np.where(total > 0, total, 1), np.float32)
