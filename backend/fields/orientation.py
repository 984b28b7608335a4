"""Orientation of hair in pictures by a bank of oriented filters with iterative refinement (M-37; Chai et al. 2012)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import require
from ..geometry.strand_raster import without_sense
from ..types import Bools, Float32, OrientationMap
from ._orientation_kernels import find_peaks
from .nearest import fill_pixels

_STRIP = 256  # rows of a picture that are worked on at once: the bank's responses are kept for these only


@dataclass(frozen=True, slots=True)
class OrientationParams:
    """Settings of `orientation_map`; lengths in pixels. The defaults are those of Chai et al. 2012.

    n_orientations : filters over half a turn.
    sigma_across, sigma_along : of the Gaussian window of the Gabor filter. wavelength : of its cosine, two hairs apart.
    iterations : the confidence is filtered again so many times less one, which brings out long strands.
    smooth : sigma of a final smoothing of the orientations, weighted by confidence; 0 for none.
    """

    n_orientations: int = 32
    sigma_across: float = 1.8
    sigma_along: float = 2.4
    wavelength: float = 4.0
    iterations: int = 3
    smooth: float = 1.5

    def __post_init__(self) -> None:
        require(4 <= self.n_orientations <= 256, f"n_orientations is {self.n_orientations}; take 4 to 256")
        for name in ("sigma_across", "sigma_along", "wavelength"):
            require(0.5 <= getattr(self, name) <= 64, f"{name} is {getattr(self, name)} px; take 0.5 to 64")
        require(1 <= self.iterations <= 10, f"iterations is {self.iterations}; take 1 to 10")
        require(0 <= self.smooth <= 100, f"smooth is {self.smooth} px; take 0 to 100")


def orientation_map(
    image: NDArray[np.uint8] | Float32, mask: Bools | None = None, params: OrientationParams = OrientationParams()
) -> OrientationMap:
    """Orientation of the hair at every pixel, and how far to trust it (M-37).

    For each angle theta the picture is filtered with an even Gabor kernel; the orientation is the angle Theta of the
    largest response F, and the confidence sqrt(sum_theta d(theta, Theta) (F(theta) - F(Theta))^2), d being the angle
    between. The confidence is then filtered in the picture's place, `iterations` times in all. O(pixels x kernel x
    n_orientations).

    Parameters
    ----------
    image : (H, W) or (H, W, 3), uint8 or float32 in [0, 1].
    mask : (H, W) bool; outside, the confidence is 0 and the picture is continued by its nearest pixels inside, so that
        the mask's border is no line.

    Returns
    -------
    OrientationMap, its confidence divided by its 99th percentile and clipped to [0, 1].
    """
    grey = _grey(image)
    bank = gabor_bank(params)
    if mask is not None:
        require(mask.shape == grey.shape, f"the mask has {mask.shape} pixels, the image {grey.shape}")
        box = _box(mask, params.iterations * bank.shape[1] + math.ceil(3 * params.smooth))
        if box != (slice(0, grey.shape[0]), slice(0, grey.shape[1])):
            return _within(box, grey, mask, params)
        grey = fill_pixels(grey, mask)
    angle = np.zeros(grey.shape, np.float32)
    confidence = np.zeros(grey.shape, np.float32)
    for _ in range(params.iterations):
        angle, confidence = _filtered(grey, bank)
        top = float(np.percentile(confidence if mask is None or not mask.any() else confidence[mask], 99))
        confidence = np.clip(confidence / top, 0.0, 1.0) if top > 0 else np.zeros_like(confidence)
        grey = confidence
    if mask is not None:
        confidence = np.where(mask, confidence, np.float32(0))
    if params.smooth > 0:
        angle = smooth_angles(angle, confidence, params.smooth)
    return OrientationMap(np.asarray(angle, np.float32), np.asarray(confidence, np.float32))


def _box(mask: Bools, margin: int) -> tuple[slice, slice]:
    """Rows and columns that have pixels of the mask in them or in `margin` around them; all for an empty mask."""
    found = []
    for size, used in zip(mask.shape, (mask.any(axis=1), mask.any(axis=0))):
        places = np.flatnonzero(used)
        found.append(slice(max(places[0] - margin, 0), min(places[-1] + margin + 1, size)) if len(places)
                     else slice(0, size))  # fmt: skip
    return found[0], found[1]


def _within(box: tuple[slice, slice], grey: Float32, mask: Bools, params: OrientationParams) -> OrientationMap:
    """The map of a picture of which only a box matters; outside, angle and confidence are 0."""
    part = orientation_map(grey[box], mask[box], params)
    angle, confidence = np.zeros(mask.shape, np.float32), np.zeros(mask.shape, np.float32)
    angle[box], confidence[box] = part.angle, part.confidence
    return OrientationMap(angle, confidence)


def gabor_bank(params: OrientationParams) -> Float32:
    """(K, n, n) float32: even Gabor kernels without mean, of unit norm, for lines at angle pi k / K.

    Angles run from +x (right) to +y (down), as everywhere in pictures.
    """
    reach = math.ceil(2.5 * max(params.sigma_across, params.sigma_along))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(np.float64)
    kernels = []
    for theta in np.arange(params.n_orientations) * (math.pi / params.n_orientations):
        along, across = x * math.cos(theta) + y * math.sin(theta), y * math.cos(theta) - x * math.sin(theta)
        window = np.exp(-0.5 * ((across / params.sigma_across) ** 2 + (along / params.sigma_along) ** 2))
        wave = window * np.cos(2.0 * math.pi * across / params.wavelength)
        wave -= window * (wave.sum() / window.sum())
        kernels.append(wave / np.linalg.norm(wave))
    return np.asarray(kernels, np.float32)


def smooth_angles(angle: Float32, weight: Float32, sigma: float) -> Float32:
    """(H, W) float32: orientations averaged as vectors of twice the angle, so that 0 and pi are the same."""
    width = 2 * math.ceil(3 * sigma) + 1
    parts = [
        cv2.GaussianBlur(np.asarray(weight * turn(2.0 * angle), np.float32), (width, width), sigma)
        for turn in (np.cos, np.sin)
    ]
    turned = 0.5 * np.arctan2(parts[1], parts[0])
    known = (parts[0] != 0) | (parts[1] != 0)
    return without_sense(np.where(known, turned, angle))


def _grey(image: NDArray[np.uint8] | Float32) -> Float32:
    require(image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3), f"no picture has shape {image.shape}")
    scaled = image.astype(np.float32) / (255.0 if image.dtype == np.uint8 else 1.0)
    if scaled.ndim == 3:
        scaled = scaled @ np.array([0.299, 0.587, 0.114], np.float32)
    require(np.isfinite(scaled).all(), "the picture has NaN or infinite values; clean it up first")
    return np.asarray(scaled)


def _filtered(grey: Float32, bank: Float32) -> tuple[Float32, Float32]:
    """Angle and confidence of every pixel, strip by strip so that the bank's responses stay few."""
    reach = bank.shape[1] // 2
    height = grey.shape[0]
    padded = cv2.copyMakeBorder(grey, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    angle, confidence = np.empty_like(grey), np.empty_like(grey)
    for start in range(0, height, _STRIP):
        stop = min(start + _STRIP, height)
        part = padded[start : stop + 2 * reach]
        responses = np.stack([cv2.filter2D(part, cv2.CV_32F, kernel)[reach:-reach, reach:-reach] for kernel in bank])
        find_peaks(responses, angle[start:stop], confidence[start:stop])
    return without_sense(angle), confidence
