"""Hair masks for the search of the database: rendered, on a grid of views, packed into bits (Z-3, M-30).

A mask shows what a person would mark as hair: where strands are and the head is not before them, gaps between strands
closed. All hairstyles are rendered once from a grid of directions in fitted space (`database_fit`), at a low
resolution; that is what `score_all` compares an input mask with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..geometry.camera import orthographic_camera, project
from ..geometry.strand_raster import marked_region
from ..geometry.view_raster import raster_mesh
from ..types import Bools, Camera, Float32, Float64, Floats, Head
from ._database_kernels import mark_strands
from .views import UInt8

# The window of a precomputed mask around the middle of the head, head radii: hair down to the waist, wide afros.
CELL = 0.1
COLUMNS, ROWS = 56, 96
_ABOVE = 2.8  # of the window over the middle of the head, as seen from the side; from above it is centred
_FINER = 2  # rendered so many times finer than kept
CLOSING = 0.06  # head radii: sigma of the density of strands, which makes an area hair (`marked_region`)
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


@dataclass(frozen=True, slots=True)
class Backdrop:
    """The bald head in a view, rendered once for many hairstyles.

    depth : (H, W) float32, metres: how deep it lies at each pixel's middle; inf beside it.
    scalp : (H, W) bool, where its scalp shows.
    """

    depth: Float32
    scalp: Bools


def backdrop(camera: Camera, head: Head) -> Backdrop:
    """The head as the camera sees it."""
    seen = raster_mesh(camera, head.vertices, head.triangles)
    return Backdrop(seen.depth, np.asarray((seen.triangle >= 0) & head.scalp[seen.triangle]))


def render_mask(
    camera: Camera, points: Floats, behind: Backdrop, closing_px: float, tolerance: float, coverage: float = 1.0
) -> Bools:
    """(H, W) bool: the pixels where hair shows.

    Parameters
    ----------
    points : (S, N, 3), strands in the camera's world. behind : `backdrop` of the head.
    closing_px : see `strand_raster.marked_region`. tolerance : metres that hair may lie behind the skin.
    coverage : share of a pixel that counts as covered where a strand goes through.
    """
    width, height = camera.size
    mask = np.zeros((height, width), np.uint8)
    mark_strands(project(camera, points), behind.depth, tolerance, mask)
    return marked_region(np.float32(coverage) * mask.astype(np.float32), behind.scalp, close_px=closing_px)


def grid_backdrops(head: Head) -> tuple[Backdrop, ...]:
    """A head in fitted space from each direction of the grid."""
    return tuple(backdrop(grid_camera(direction, _FINER), head) for direction in view_grid())


def grid_masks(points: Float32, backdrops: Sequence[Backdrop]) -> UInt8:
    """(D, ROWS * COLUMNS / 8) uint8: the masks of a hairstyle from all directions of the grid, 8 cells a byte.

    points : (S, N, 3) float32, fitted space. backdrops : `grid_backdrops` of its head, moved into fitted space.
    """
    packed = []
    for direction, behind in zip(view_grid(), backdrops):
        camera = grid_camera(direction, _FINER)
        mask = render_mask(camera, points, behind, CLOSING / CELL * _FINER, 0.03)
        share = mask.reshape(ROWS, _FINER, COLUMNS, _FINER).mean(axis=(1, 3))
        packed.append(np.packbits(share.ravel() >= 0.5))
    return np.stack(packed)
