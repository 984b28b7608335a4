"""The photos' masks as strands must obey them: how far each pixel is off, and what the head hides (Z-22)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from ..geometry.camera import project
from ..geometry.head import HeadSurface
from ..geometry.view_raster import raster_mesh
from ..types import Bools, Float32, Float64, Head, Int32
from ._filling_kernels import cut_strands, keep_in_masks
from .hair_space import HairSpace
from .views import View

_ROUNDS = 4
_BEHIND = 0.004  # metres behind the head's surface from which hair is hidden; hair on the scalp is not
_BARE_MARGIN = 6.0  # pixels around a mask in which roots may stand: no photo's hairline is exact


@dataclass(frozen=True, slots=True)
class MaskLimits:
    """V views of (H, W) pixels, smaller pictures padded.

    turns : (V, 4, 4), intrinsics : (V, 3, 3), orthographic : (V,) int32: the cameras.
    away : (V, H, W) float32, pixels to the mask, 0 in it. to_mask : (V, H, W, 2) float32, x and y to its nearest pixel.
    head_depth : (V, H, W) float32, metres: hair deeper than that is hidden.
    """

    turns: Float64
    intrinsics: Float64
    orthographic: Int32
    away: Float32
    to_mask: Float32
    head_depth: Float32


def mask_limits(views: Sequence[View], head: Head) -> MaskLimits:
    """What `bend_into_masks` needs of the views."""
    height = max((view.mask.shape[0] for view in views), default=1)
    width = max((view.mask.shape[1] for view in views), default=1)
    count = len(views)
    away = np.zeros((count, height, width), np.float32)
    to_mask = np.zeros((count, height, width, 2), np.float32)
    depth = np.full((count, height, width), np.inf, np.float32)
    rows, columns = np.mgrid[:height, :width]
    for v, view in enumerate(views):
        h, w = view.mask.shape
        mask = np.zeros((height, width), np.bool_)
        mask[:h, :w] = view.mask
        away[v], nearest = ndimage.distance_transform_edt(~mask, return_indices=True)
        to_mask[v, ..., 0], to_mask[v, ..., 1] = nearest[1] - columns, nearest[0] - rows
        depth[v, :h, :w] = raster_mesh(view.camera, head.vertices, head.triangles).depth + _BEHIND
    return MaskLimits(
        np.array([view.camera.world_to_camera for view in views]).reshape(-1, 4, 4),
        np.array([view.camera.intrinsics for view in views]).reshape(-1, 3, 3),
        np.array([view.camera.orthographic for view in views], np.int32), away, to_mask, depth,
    )  # fmt: skip


def bend_into_masks(
    points: Float32,
    limits: MaskLimits,
    space: HairSpace,
    clearance: float,
    margin: float,
    *,
    rounds: int = _ROUNDS,
) -> Float64:
    """Bend strands (S, N, 3) in place into every mask, and cut what stays more than `margin` pixels off (Z-22).

    rounds : of bending; 0 only cuts.

    Returns
    -------
    (S,) the share of each strand that was kept.
    """
    kept = np.ones(len(points))
    if len(limits.turns) == 0:
        return kept
    keep_in_masks(
        points, limits.turns, limits.intrinsics, limits.orthographic, limits.away, limits.to_mask, limits.head_depth,
        margin, rounds, clearance, space.distances, space.directions, space.origin, space.cell, kept,
    )  # fmt: skip
    cut_strands(points, kept)
    return kept


def hairy_region(views: Sequence[View], head: Head, surface: HeadSurface) -> Bools:
    """(F,) bool: triangles of the scalp but those that a photo shows bare; the whole scalp if none were left."""
    region = head.scalp.copy()
    middles = head.vertices[head.triangles].mean(axis=1)
    for view in views:
        seen = project(view.camera, middles)
        height, width = view.mask.shape
        column, row = np.floor(seen[:, 0]).astype(int), np.floor(seen[:, 1]).astype(int)
        inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        row, column = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
        depth = raster_mesh(view.camera, head.vertices, head.triangles).depth
        facing = surface.face_normals @ -view.camera.world_to_camera[2, :3] > 0.3
        shown = inside & facing & (seen[:, 2] < depth[row, column] + _BEHIND)
        away = cv2.distanceTransform((~view.mask).astype(np.uint8), cv2.DIST_L2, 5)
        region &= ~(shown & (away[row, column] > _BARE_MARGIN))
    return region if region.any() else head.scalp
