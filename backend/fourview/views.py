"""What the method sees: photos with their hair masks and cameras, and the strokes that a user drew on them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..errors import require
from ..types import Bools, Camera, Float64, check_array

UInt8 = NDArray[np.uint8]

NAMES = ("front", "back", "left", "right", "top")
MAX_VIEWS = 8


@dataclass(frozen=True, slots=True)
class View:
    """One photo (Zhang et al. 2017, sec. 4: I_i, M_i^I, T_i).

    name : one of NAMES for the classes of view that the paper knows, or any other word; unique in a project.
    image : (H, W, 3) uint8, sRGB. mask : (H, W) bool, true where there is hair. camera : of the same size.
    """

    name: str
    image: UInt8
    mask: Bools
    camera: Camera

    def __post_init__(self) -> None:
        check_array(f"the image of view '{self.name}'", self.image, np.uint8, (None, None, 3))
        height, width = self.image.shape[:2]
        check_array(f"the mask of view '{self.name}'", self.mask, np.bool_, (height, width))
        require(
            self.camera.size == (width, height),
            f"the camera of view '{self.name}' is for {self.camera.size} pixels, its image has {(width, height)}",
        )
        require(self.mask.any(), f"the mask of view '{self.name}' is empty; mark where its hair is")


@dataclass(frozen=True, slots=True)
class DirectionStroke:
    """A stroke from root to tip that tells which way the hair grows (Z-19).

    camera : of the view that it was drawn on. points : (n, 2) float64, pixels of that camera, n >= 2.
    """

    camera: Camera
    points: Float64 = field(default_factory=lambda: np.empty((0, 2)))

    def __post_init__(self) -> None:
        check_array("a stroke", self.points, np.float64, (None, 2))
        require(len(self.points) >= 2, f"a stroke has {len(self.points)} points; it needs 2 or more")
