"""Orientation of hair at every texel of a texture, on the surface's tangent planes (Z-19, M-37).

The iterative refinement of Chai et al. 2012 for pictures (`fields.orientation`), with each texel's surroundings
sampled from the texture on its own tangent plane: through the chart that it lies in, and across seams by the
texels nearest in space. Charts may be turned and stretched as they like.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label, maximum_filter, minimum_filter

from ..errors import require
from ..types import Bools, Float32, Floats, Int32, check_array
from ._tangent_kernels import filter_texels
from .surface import tangent_frames as surface_frames
from .texels import TexelMap

_MOST_CELLS = 1 << 25
_STRETCH = 1.6  # texels that the chart may need for a texel on the tangent plane, for the quick way
_FLAT = 0.02  # a texture whose clearest lines are weaker shows no hair; steps of 1 / 255 give less
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)


@dataclass(frozen=True, slots=True)
class TangentFilterParams:
    """Settings of `texel_orientations`; lengths in texels. The bank is that of Chai et al. 2012."""

    n_orientations: int = 32
    sigma_across: float = 1.8
    sigma_along: float = 2.4
    wavelength: float = 4.0  # of a pair of light and dark hairs
    iterations: int = 3  # the confidence is filtered again so many times less one

    def __post_init__(self) -> None:
        require(4 <= self.n_orientations <= 256, f"n_orientations is {self.n_orientations}; take 4 to 256")
        for name in ("sigma_across", "sigma_along", "wavelength"):
            require(0.5 <= getattr(self, name) <= 16, f"{name} is {getattr(self, name)} texels; take 0.5 to 16")
        require(1 <= self.iterations <= 10, f"iterations is {self.iterations}; take 1 to 10")


def texel_orientations(
    texels: TexelMap, colours: Float32, params: TangentFilterParams = TangentFilterParams()
) -> tuple[Float32, Float32]:
    """Unsigned orientation of the hair at each of T texels, and how far to trust it (Z-19, M-37).

    Parameters
    ----------
    colours : (T, 3) float32 in [0, 1], sRGB.

    Returns
    -------
    orientations : (T, 3) float32, unit, in the tangent plane, world space; the sign means nothing.
    confidence : (T,) float32 in [0, 1], divided by its 99th percentile; low where the texture is flat.
    """
    check_array("colours", colours, np.float32, (texels.n_texels, 3))
    frames = tangent_frames(texels.normals)
    offsets, bank = tangent_bank(params)
    bins = np.arange(params.n_orientations)
    distances = np.minimum(bins, params.n_orientations - bins) * (math.pi / params.n_orientations)
    grid = np.pad(texels.grid(), 1, constant_values=-1)
    charts, inner, reach = _charts(grid, float(np.abs(offsets).max()))
    places = np.stack([texels.texels // texels.size, texels.texels % texels.size], axis=1) + 1
    rows, columns = places[:, 0], places[:, 1]
    hashing = hash_points(texels.points, 2.0 * texels.spacing)
    picture = np.zeros(grid.shape, np.float32)
    picture[rows, columns] = colours @ _LUMA
    angle, confidence = np.zeros(texels.n_texels, np.float32), np.zeros(texels.n_texels, np.float32)
    for _ in range(params.iterations):
        filter_texels(
            picture, texels.points, texels.normals, frames, grid, charts, inner, places, texels.spacing, offsets, bank,
            distances, *hashing, float(reach), angle, confidence,
        )  # fmt: skip
        top = float(np.percentile(confidence, 99)) if len(confidence) else 0.0
        confidence = np.clip(confidence / max(top, _FLAT), 0.0, 1.0).astype(np.float32)
        picture[rows, columns] = confidence
    turned = np.cos(angle)[:, None] * frames[:, 0] + np.sin(angle)[:, None] * frames[:, 1]
    return np.asarray(turned, np.float32), confidence


def _charts(grid: Int32, furthest: float) -> tuple[Int32, Bools, int]:
    """Chart numbers and whether a chart goes on around, both like grid (N, N); and for how many texels around."""
    charts = np.asarray(label(grid >= 0)[0], np.int32)
    reach = math.ceil(_STRETCH * furthest) + 1
    width = 2 * reach + 1
    same = minimum_filter(charts, width, mode="constant") == maximum_filter(charts, width, mode="constant")
    return charts, same & (charts > 0), reach


def tangent_frames(normals: Float32) -> Float32:
    """(T, 2, 3) float32: unit tangents normal x (0, 0, 1), and bitangents normal x tangent, of normals (T, 3)."""
    return np.ascontiguousarray(np.stack(surface_frames(normals), axis=1))


def tangent_bank(params: TangentFilterParams) -> tuple[Float32, Float32]:
    """Offsets (M, 2) in texels within a disc, and even Gabor filters (K, M) there, without mean, of unit norm."""
    reach = math.ceil(2.5 * max(params.sigma_across, params.sigma_along))
    y, x = (a.ravel().astype(np.float64) for a in np.mgrid[-reach : reach + 1, -reach : reach + 1])
    disc = x * x + y * y <= (reach + 0.3) ** 2
    x, y = x[disc], y[disc]
    theta = np.arange(params.n_orientations)[:, None] * (math.pi / params.n_orientations)
    along, across = x * np.cos(theta) + y * np.sin(theta), y * np.cos(theta) - x * np.sin(theta)
    window = np.exp(-0.5 * ((across / params.sigma_across) ** 2 + (along / params.sigma_along) ** 2))
    wave = window * np.cos(2.0 * math.pi * across / params.wavelength)
    wave -= window * (wave.sum(axis=1, keepdims=True) / window.sum(axis=1, keepdims=True))
    wave /= np.linalg.norm(wave, axis=1, keepdims=True)
    return np.stack([x, y], axis=1).astype(np.float32), wave.astype(np.float32)


def hash_points(points: Floats, cell: float) -> tuple[Floats, float, NDArray[np.int64], Int32, Int32]:
    """Points (n, 3) by cells of a grid: low corner, edge, shape, starts (cells + 1,), members (n,) int32."""
    low = points.min(axis=0).astype(np.float64) - 0.5 * cell
    extent = points.max(axis=0) - low
    while np.prod(np.floor(extent / cell) + 2) > _MOST_CELLS:
        cell *= 1.5
    shape = (np.floor(extent / cell) + 2).astype(np.int64)
    place = np.floor((points - low) / cell).astype(np.int64)
    key = (place[:, 0] * shape[1] + place[:, 1]) * shape[2] + place[:, 2]
    members = np.argsort(key, kind="stable").astype(np.int32)
    counts = np.bincount(key, minlength=int(shape.prod()))
    return low, cell, shape, np.concatenate([[0], np.cumsum(counts)]).astype(np.int32), members
