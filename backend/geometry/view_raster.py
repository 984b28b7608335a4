"""Which triangle of a mesh each pixel of a view shows, and what of a scene a view sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Bools, Camera, Float32, Floats, Int32
from ._view_raster_kernels import fill_triangles
from .camera import in_picture, project


@dataclass(frozen=True, slots=True)
class ViewRaster:
    """What lies behind the middle of each pixel.

    triangle : (H, W) int32, -1 for none. depth : (H, W) float32, metres along the viewing direction, inf for none.
    barycentric : (H, W, 3) float32, the place on the triangle.
    """

    triangle: Int32
    depth: Float32
    barycentric: Float32


def raster_mesh(camera: Camera, vertices: Floats, triangles: Int32) -> ViewRaster:
    """Draw a mesh, both sides of its triangles, into a z-buffer; the same bits for any number of threads.

    Parameters
    ----------
    vertices : (V, 3) float, metres, world space. triangles : (F, 3) int32. Triangles with a corner that is not in front
        of a perspective camera are left out.
    """
    width, height = camera.size
    seen = np.ascontiguousarray(project(camera, vertices))
    triangle = np.full((height, width), -1, np.int32)
    depth = np.full((height, width), np.inf, np.float32)
    barycentric = np.zeros((height, width, 3), np.float32)
    corners = np.ascontiguousarray(triangles, np.int32)
    fill_triangles(seen, corners, not camera.orthographic, triangle, depth, barycentric)
    return ViewRaster(triangle, depth, barycentric)


def visible(points: Floats, raster: ViewRaster, camera: Camera, tolerance_m: float) -> Bools:
    """(n,) bool: whether points (n, 3), metres, lie on the picture with nothing in front of them.

    A point may lie `tolerance_m` behind the deepest of the four pixel middles around it: what is drawn is known at
    these only. Points outside the picture are not visible.
    """
    seen = project(camera, points)
    inside = in_picture(camera, seen)
    height, width = raster.depth.shape
    place = np.where(inside[:, None], seen[:, :2], 0.5)
    corner = np.floor(place - 0.5).astype(np.int64)
    deepest = np.full(len(seen), -np.inf, np.float32)
    for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
        row = np.clip(corner[:, 1] + down, 0, height - 1)
        column = np.clip(corner[:, 0] + right, 0, width - 1)
        deepest = np.maximum(deepest, raster.depth[row, column])
    return np.asarray(inside & (seen[:, 2] <= deepest + tolerance_m))
