"""Colours of strands from the photos: appearance transfer, which the paper leaves out (its sec. 6).

Every point of a strand that a photo shows takes the photo's colour, most from the photo that faces the hair there.
Points that no photo shows take colours from along their strand, and strands that none shows from the hair around them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from ..errors import require
from ..geometry.camera import in_picture, project
from ..geometry.strand_raster import raster_strands
from ..types import Bools, Float32, Float64, Head, StrandSet
from ._appearance_kernels import average_along
from .views import View

_BORDER_PX = 1.5  # pixels of a mask's border whose colour is half the background's
_FLAT_PX = 3.0  # pixels over which depths are averaged for the direction that the hair faces
_CELLS = 64  # along the hair's longest side: cells of known colour for the hair that no photo shows
_CELL_NEIGHBOURS = 8
_UNSEEN = 1e-4  # weight below which a point counts as not seen


@dataclass(frozen=True, slots=True)
class ColourParams:
    """Settings of strand_colours."""

    depth: float = 0.003  # metres under the visible hair down to which hair takes the pixel's colour
    along: float = 1.5  # points of a strand over which colours are averaged (standard deviation)

    def __post_init__(self) -> None:
        require(0.0 <= self.depth <= 0.1, f"depth is {self.depth} m; it must be in 0..0.1")
        require(0.0 < self.along <= 100.0, f"along is {self.along} points; it must be above 0 and at most 100")


def strand_colours(
    strands: StrandSet, views: Sequence[View], head: Head, params: ColourParams = ColourParams()
) -> Float32:
    """One colour for each strand, from the photos: the mean of `point_colours`, where photos show the strand if any do.

    Returns
    -------
    (S, 3) float32 sRGB in [0, 1]. The same bytes for any number of threads.

    Raises
    ------
    InputError : no views.
    """
    colours, weights = _coloured(strands, views, head, params)
    starts = strands.offsets[:-1]
    counts = (weights + np.float32(1e-6)).astype(np.float64)
    total = np.add.reduceat(counts[:, None] * colours, starts, axis=0)
    return np.asarray(total / np.add.reduceat(counts, starts)[:, None], np.float32)


def point_colours(
    strands: StrandSet, views: Sequence[View], head: Head, params: ColourParams = ColourParams()
) -> Float32:
    """A colour for every point of the strands, from the photos, for hair that changes colour along its length.

    Parameters
    ----------
    strands : world space, metres. views : one or more, with masks; only colours inside the masks are used.
    head : hides what lies behind it.

    Returns
    -------
    (P, 3) float32 sRGB in [0, 1].

    Raises
    ------
    InputError : no views.
    """
    return _coloured(strands, views, head, params)[0]


def _coloured(strands: StrandSet, views: Sequence[View], head: Head, params: ColourParams) -> tuple[Float32, Float32]:
    """The points' colours (P, 3), and how well photos show each of them (P,)."""
    require(len(views) > 0, "there is no photo to take colours from; add one")
    total = np.zeros((len(strands.points), 3), np.float32)
    weight = np.zeros(len(strands.points), np.float32)
    for view in views:
        colour, seen = _from_view(strands, view, head, params.depth)
        total += seen[:, None] * colour
        weight += seen
    colours = total / np.maximum(weight, 1e-12)[:, None]
    smooth, known = _average_along(strands, colours, weight, params.along)
    # hair under other hair first takes the colour of its own strand
    wide, far = _average_along(strands, smooth, np.minimum(known, 1.0).astype(np.float32), 4.0 * params.along)
    near = (known < _UNSEEN) & (far >= _UNSEEN)
    smooth[near] = wide[near]
    hidden = (known < _UNSEEN) & (far < _UNSEEN)
    smooth[hidden] = _from_around(strands.points, smooth, ~hidden, hidden, _mean_colour(views))
    return np.clip(smooth, 0.0, 1.0), weight


def _from_view(strands: StrandSet, view: View, head: Head, depth: float) -> tuple[Float32, Float32]:
    """The colours (P, 3) that a photo has where the points lie, and how much they count (P,)."""
    raster = raster_strands(view.camera, strands, head)
    seen = project(view.camera, strands.points)
    inside = in_picture(view.camera, seen)
    place = np.where(inside[:, None], seen[:, :2], 0.5)
    column, row = np.floor(place[:, 0]).astype(np.int64), np.floor(place[:, 1]).astype(np.int64)
    shown = inside & raster.mask[row, column] & (seen[:, 2] <= raster.depth[row, column] + depth)
    # the border's pixels have background in them; a mask that is all border is used as it is
    inner = cv2.distanceTransform(np.pad(view.mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1] > _BORDER_PX
    usable = inner if inner.any() else view.mask
    weight = np.where(shown & usable[row, column], _facing(raster.depth, view)[row, column], 0.0)
    picture = view.image.astype(np.float32) / np.float32(255.0)
    return picture[row, column], weight.astype(np.float32)


def _facing(depth: Float32, view: View) -> Float32:
    """(H, W) float32: the square of the cosine at which the drawn hair faces the camera, by the slope of its depth."""
    known = np.isfinite(depth)
    share = cv2.GaussianBlur(known.astype(np.float32), (0, 0), _FLAT_PX)
    deep = cv2.GaussianBlur(np.where(known, depth, 0.0).astype(np.float32), (0, 0), _FLAT_PX)
    smooth = deep / np.maximum(share, 1e-6)
    down, right = np.gradient(smooth.astype(np.float64))
    scale = view.camera.intrinsics[0, 0]
    if not view.camera.orthographic:
        scale = scale / np.maximum(smooth, 1e-6)
    square = 1.0 / (1.0 + (down * scale) ** 2 + (right * scale) ** 2)
    return np.asarray(np.where(share > 0.05, square, 0.0), np.float32) + np.float32(0.01)


def _average_along(strands: StrandSet, colours: Float32, weights: Float32, spread: float) -> tuple[Float32, Float32]:
    shares = np.exp(-0.5 * (np.arange(int(3.0 * spread) + 2) / spread) ** 2)
    out, out_weights = np.empty_like(colours), np.empty_like(weights)
    average_along(colours, weights, strands.offsets, shares, out, out_weights)
    return out, out_weights


def _from_around(points: Float32, colours: Float32, known: Bools, hidden: Bools, fallback: Float64) -> Float32:
    """(n, 3) colours of hidden points (P,) bool from the cells around with points whose colour is known."""
    if not hidden.any():
        return np.empty((0, 3), np.float32)
    if not known.any():
        return np.broadcast_to(fallback.astype(np.float32), (int(hidden.sum()), 3))
    low = points.min(axis=0)
    cell = max(float((points.max(axis=0) - low).max()) / _CELLS, 1e-6)
    index = np.floor((points[known] - low) / cell).astype(np.int64)
    _, cells = np.unique((index * np.array([1, 1 << 20, 1 << 40])).sum(axis=1), return_inverse=True)
    cells = cells.reshape(-1)
    counts = np.bincount(cells).astype(np.float64)
    means = np.stack([np.bincount(cells, colours[known][:, c]) / counts for c in range(3)], axis=1)
    middles = np.stack([np.bincount(cells, points[known][:, c]) / counts for c in range(3)], axis=1)
    distance, near = cKDTree(middles).query(points[hidden], k=min(_CELL_NEIGHBOURS, len(middles)))
    distance, near = distance.reshape(hidden.sum(), -1), near.reshape(hidden.sum(), -1)
    weights = 1.0 / (distance**2 + (0.5 * cell) ** 2)
    mixed = np.einsum("nk,nkc->nc", weights, means[near]) / weights.sum(axis=1, keepdims=True)
    return np.asarray(mixed, np.float32)


def _mean_colour(views: Sequence[View]) -> Float64:
    """(3,) of all hair in the photos."""
    pixels = np.concatenate([view.image[view.mask] for view in views])
    return np.asarray(pixels.mean(axis=0) / 255.0, np.float64)
