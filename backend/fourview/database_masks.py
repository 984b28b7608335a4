"""Hair masks for the search of the database: rendered, on a grid of views, packed into bits (Z-3, M-30).

A mask shows what a person would mark as hair: where strands are and the head is not before them, gaps between strands
closed. All hairstyles are rendered once from a grid of directions in fitted space (`database_fit`), at a low
resolution; that is what `score_all` compares an input mask with.
"""

from __future__ import annotations

import cv2
import numpy as np

from ..geometry.camera import orthographic_camera, project, rays, view_direction
from ..geometry.head import HeadSurface
from ..types import Bools, Camera, Float32, Float64, Floats
from ._database_kernels import mark_strands
from .views import UInt8

# The window of a precomputed mask around the middle of the head, head radii: hair down to the waist, wide afros.
CELL = 0.1
COLUMNS, ROWS = 56, 96
_ABOVE = 2.8  # of the window over the middle of the head, as seen from the side; from above it is centred
_FINER = 2  # rendered so many times finer than kept
_CLOSING = 0.25  # head radii: gaps between strands up to this wide are no gaps
# Cameras of the grid: their number around the head at each height, degrees over the horizon. The classes of view that
# the paper knows are among them.
_RINGS = ((0.0, 16), (30.0, 8), (-25.0, 8), (60.0, 6))


def view_grid() -> Float64:
    """(D, 3) float64, unit: the directions that the precomputed masks are seen along; the last one is from above."""
    directions = []
    for elevation, count in _RINGS:
        azimuth = 2.0 * np.pi * np.arange(count) / count
        height = np.full(count, -np.sin(np.radians(elevation)))
        flat = np.cos(np.radians(elevation))
        # the first camera of a ring stands before the face, at -y, and looks along +y
        directions.append(np.stack([-flat * np.sin(azimuth), flat * np.cos(azimuth), height], axis=1))
    return np.concatenate([*directions, [[0.0, 0.0, -1.0]]])


def grid_camera(direction: Float64, finer: int = 1) -> Camera:
    """The camera of a precomputed mask: fitted space is its world, head radii its metres."""
    from_above = abs(direction[2]) > 0.999
    up = (0.0, 1.0, 0.0) if from_above else (0.0, 0.0, 1.0)
    level = float(np.hypot(direction[0], direction[1]))
    drop = (0.5 * ROWS * CELL - _ABOVE) * level
    upward = np.array([0.0, 1.0, 0.0]) if from_above else np.array([0.0, 0.0, 1.0])
    in_plane = upward - (upward @ direction) * direction
    centre = -drop * in_plane / np.linalg.norm(in_plane)
    return orthographic_camera(direction, centre, finer / CELL, (COLUMNS * finer, ROWS * finer), up)


def occluder_depth(camera: Camera, surface: HeadSurface | None) -> Float32:
    """(H, W) float32, metres: how deep the head lies at each pixel's middle; inf beside it or without a head."""
    width, height = camera.size
    if surface is None:
        return np.full((height, width), np.inf, np.float32)
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    origins, directions = rays(camera, np.stack([columns.ravel(), rows.ravel()], axis=1))
    distance, _ = surface.first_hits(origins, directions)
    depth = distance * (directions @ view_direction(camera))
    return np.asarray(depth.reshape(height, width), np.float32)


def render_mask(camera: Camera, points: Floats, head_depth: Float32, closing_px: float, tolerance: float) -> Bools:
    """(H, W) bool: the pixels where hair shows.

    Parameters
    ----------
    points : (S, N, 3), strands in the camera's world. head_depth : of `occluder_depth`.
    closing_px : gaps up to this wide are closed. tolerance : metres that hair may lie behind the skin.
    """
    width, height = camera.size
    mask = np.zeros((height, width), np.uint8)
    mark_strands(project(camera, points), head_depth, tolerance, mask)
    return close_gaps(mask, closing_px)


def close_gaps(mask: UInt8, closing_px: float) -> Bools:
    """Gaps up to `closing_px` wide closed, as a person does who marks hair; a frame keeps the picture's edge out of it."""
    reach = max(int(round(0.5 * closing_px)), 1)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    framed = cv2.copyMakeBorder(mask, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    closed = cv2.morphologyEx(framed, cv2.MORPH_CLOSE, kernel)
    return np.asarray(closed[reach:-reach, reach:-reach] > 0)


def grid_masks(points: Float32, surface: HeadSurface | None) -> UInt8:
    """(D, ROWS * COLUMNS / 8) uint8: the masks of a hairstyle from all directions of the grid, 8 cells a byte.

    points : (S, N, 3) float32, fitted space. surface : of its head moved into fitted space, or None.
    """
    packed = []
    for direction in view_grid():
        camera = grid_camera(direction, _FINER)
        depth = occluder_depth(camera, surface)
        mask = render_mask(camera, points, depth, _CLOSING / CELL * _FINER, 0.03)
        share = mask.reshape(ROWS, _FINER, COLUMNS, _FINER).mean(axis=(1, 3))
        packed.append(np.packbits(share.ravel() >= 0.5))
    return np.stack(packed)
