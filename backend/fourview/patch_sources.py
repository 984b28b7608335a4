"""What patches of a photo look like on the surface: source images, and how the surface lies in each of their pixels.

A target patch is compared with m x m samples of a photo around a pixel (Zhang et al. 2017, sec. 4.3.1, Z-17). The paper
takes the pixel to the surface, lays a patch on the tangent plane there and goes back to the photo; here the derivative
of that, two by two numbers a pixel, is made once from the texels that the view sees.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..fields.nearest import fill_pixels
from ..geometry.camera import project
from ..types import Bools, Camera, Float32, Float64, Int64
from .surface import tangent_frames
from .texels import TexelMap
from .views import UInt8, View

UInt32 = NDArray[np.uint32]

_STEP = 1e-4  # metres, for the differences that stand for derivatives of the projection
_STEEPEST = 1.5  # pixels a texel; more (close to a perspective camera) is cut, so that no patch leaves the padding


@dataclass(frozen=True, slots=True)
class PhotoSurface:
    """One view as a source: its photo and the surface behind its pixels.

    image : (H, W, 3) uint8, colours outside the hair mask replaced by the nearest inside.
    source : (h, w) bool, pixels that show the source region S, at the photo's resolution or less.
    jacobian : (h, w, 4) float32, photo pixels a metre along tangent and bitangent: (x t, x b, y t, y b).
    pixels_per_metre : at the surface, where it faces the camera.
    """

    image: UInt8
    source: Bools
    jacobian: Float32
    pixels_per_metre: float


@dataclass(frozen=True, slots=True)
class Sources:
    """All views at the resolution of one scale, padded, in common arrays (N pixels in all).

    images : (N,) uint32, 0x00BBGGRR. jacobians : (N, 4) float32, pixels a texel. usable : (N,) bool, pixels around
    which all of a patch shows S. frames : (n, 3) int64, first, height, width. scales : (n, 2) float64, pixels here a
    photo pixel, across and down. pad : pixels around each image.
    """

    images: UInt32
    jacobians: Float32
    usable: Bools
    frames: Int64
    scales: Float64
    pad: int

    def image(self, view: int) -> UInt32:
        """(H * W,) uint32."""
        first, height, width = self.frames[view]
        return self.images[first : first + height * width]

    def pixels(self, view: int, photo_pixels: Float32 | Float64) -> Float32:
        """(..., 2) float32: pixels of the photo as pixels here."""
        return np.asarray(photo_pixels * self.scales[view] + self.pad, np.float32)

    def jacobians_at(self, view: int, position: Float32) -> Float32:
        """(k, 4) float32 at pixels (k, 2)."""
        first, height, width = self.frames[view]
        column = np.clip(position[:, 0].astype(np.int64), 0, width - 1)
        row = np.clip(position[:, 1].astype(np.int64), 0, height - 1)
        return np.asarray(self.jacobians[first + row * width + column])


def surface_in_photo(view: View, texels: TexelMap, pixels: Float32, seen: Bools) -> PhotoSurface:
    """Make a source of a view.

    texels : of the finest scale. pixels : (T, 2) float32, where they lie in the photo. seen : (T,) bool, S.
    """
    height, width = view.mask.shape
    inner = cv2.erode(view.mask.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    image = np.ascontiguousarray(fill_pixels(view.image, inner if inner.any() else view.mask))
    chosen = np.flatnonzero(seen)
    if len(chosen) == 0:
        return PhotoSurface(image, np.zeros((1, 1), np.bool_), np.zeros((1, 1, 4), np.float32), 1.0)
    per_metre = float(np.median(_pixels_per_metre(view.camera, texels.points[chosen[:: max(1, len(chosen) // 2000)]])))
    # where the pixels are smaller than the texels some would show none
    scale = min(1.0, 1.0 / (texels.spacing * per_metre))
    small = max(1, round(height * scale)), max(1, round(width * scale))
    column = np.clip((pixels[chosen, 0] * (small[1] / width)).astype(np.int64), 0, small[1] - 1)
    row = np.clip((pixels[chosen, 1] * (small[0] / height)).astype(np.int64), 0, small[0] - 1)
    place = row * small[1] + column
    sums = [np.bincount(place, minlength=small[0] * small[1])]
    for array in (texels.normals, texels.points):
        sums += [np.bincount(place, array[chosen, axis], small[0] * small[1]) for axis in range(3)]
    stacked = np.stack(sums, axis=1).reshape(small[0], small[1], 7).astype(np.float32)
    stacked[..., 1:] /= np.maximum(stacked[..., :1], 1)
    hit = stacked[..., 0] > 0
    means = cv2.GaussianBlur(np.where(hit[..., None], stacked, 0)[..., 1:], (0, 0), 1.5)
    share = cv2.GaussianBlur(hit.astype(np.float32), (0, 0), 1.5)
    source = (share > 0.5) & (share > 0)
    if not source.any():
        source = hit
    known = means[source] / share[source][:, None]
    jacobian = np.zeros((small[0], small[1], 4), np.float32)
    jacobian[source] = _jacobians(view.camera, known[:, :3], known[:, 3:])
    return PhotoSurface(image, source, fill_pixels(jacobian, source), per_metre)


def _pixels_per_metre(camera: Camera, points: Float32) -> Float64:
    """(k,) float64: how large a metre across the view is at points (k, 3)."""
    if camera.orthographic:
        return np.full(len(points), camera.intrinsics[0, 0])
    return np.asarray(camera.intrinsics[0, 0] / np.maximum(project(camera, points)[:, 2], 1e-6))


def _jacobians(camera: Camera, normals: Float32, points: Float32) -> Float32:
    """(k, 4) float32: photo pixels a metre along the tangent and the bitangent of the surface at points (k, 3)."""
    length = np.linalg.norm(normals.astype(np.float64), axis=1, keepdims=True)
    tangents, bitangents = tangent_frames(normals / np.maximum(length, 1e-12))
    start = project(camera, points.astype(np.float64))[:, :2]
    across = (project(camera, points + _STEP * tangents)[:, :2] - start) / _STEP
    down = (project(camera, points + _STEP * bitangents)[:, :2] - start) / _STEP
    return np.asarray(np.stack([across[:, 0], down[:, 0], across[:, 1], down[:, 1]], axis=1), np.float32)


def _at_scale(photo: PhotoSurface, spacing: float, patch_size: int, enlargement: float, pad: int) -> tuple[
    UInt32, Float32, Bools, Float64
]:  # fmt: skip
    """Image (uint32), jacobians and usable centres of a view, padded, with pixels as large as texels; its scales."""
    height, width = photo.image.shape[:2]
    scale = min(1.0 / (spacing * photo.pixels_per_metre), enlargement)
    size = max(8, round(height * scale)), max(8, round(width * scale))
    scales = np.array([size[1] / width, size[0] / height])
    shrinks = scale < 1
    image = cv2.resize(photo.image, size[::-1], interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC)
    factors = np.repeat(scales, 2) * spacing
    jacobian = cv2.resize(photo.jacobian, size[::-1], interpolation=cv2.INTER_LINEAR) * factors.astype(np.float32)
    jacobian = np.clip(jacobian, -_STEEPEST, _STEEPEST)
    share = cv2.resize(photo.source.astype(np.float32), size[::-1], interpolation=cv2.INTER_AREA)
    usable = _patch_centres(share > 0.5, 0.5 * patch_size)
    wide = cv2.copyMakeBorder(image, pad, pad, pad, pad, cv2.BORDER_REPLICATE).astype(np.uint32)
    packed = wide[..., 0] | (wide[..., 1] << 8) | (wide[..., 2] << 16)
    around = cv2.copyMakeBorder(jacobian, pad, pad, pad, pad, cv2.BORDER_REPLICATE)
    return packed, around, np.pad(usable, pad), scales


def _patch_centres(source: Bools, reach: float) -> Bools:
    """Pixels (H, W) at least `reach` pixels inside `source`, less where it is nowhere as wide as that."""
    inside = cv2.distanceTransform(np.pad(source, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    return np.asarray(source & (inside >= min(reach, 0.5 * float(inside.max()))))


def sources_at(
    photos: tuple[PhotoSurface, ...], spacing: float, patch_size: int, largest_patch: float, enlargement: float = 2.0
) -> Sources:
    """The views with pixels of the size of a texel of `spacing` metres, enlarged `enlargement` times at most.

    largest_patch : the greatest in-plane scale of a patch.
    """
    # no patch around a pixel of the image reaches further, in either direction
    pad = int(np.ceil(patch_size * _STEEPEST * largest_patch)) + 2
    parts = [_at_scale(photo, spacing, patch_size, enlargement, pad) for photo in photos]
    shapes = np.array([part[0].shape for part in parts], np.int64)
    first = np.concatenate([[0], np.cumsum(shapes.prod(axis=1))[:-1]])
    return Sources(
        np.concatenate([part[0].ravel() for part in parts]),
        np.ascontiguousarray(np.concatenate([part[1].reshape(-1, 4) for part in parts])),
        np.concatenate([part[2].ravel() for part in parts]),
        np.ascontiguousarray(np.concatenate([first[:, None], shapes], axis=1)),
        np.stack([part[3] for part in parts]),
        pad,
    )
