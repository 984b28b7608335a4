"""Kernels of `projection`: texels in a view, colours from a picture, filling of holes."""

from __future__ import annotations

import numpy as np
from numba import prange

from ..kernels import parallel_kernel
from ..types import Bools, Float32, Float64


@parallel_kernel
def see_texels(
    points: Float32,
    normals: Float32,
    matrix: Float64,
    intrinsics: Float64,
    orthographic: bool,
    depth: Float32,
    mask: Bools,
    tolerance: float,
    least_facing: float,
    pixels: Float32,
    visible: Bools,
    seen: Bools,
    facing: Float32,
) -> None:
    """Pixel, visibility, source region and facing of texels in one view (`projection.ViewsOnTexels`).

    matrix : (4, 4) world to camera. depth : (H, W) of the occluder, inf for none; a point may lie `tolerance` behind
    the deepest of the four pixel middles around it.
    """
    height, width = depth.shape
    for texel in prange(len(points)):
        x, y, z = float(points[texel, 0]), float(points[texel, 1]), float(points[texel, 2])
        cx = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + matrix[0, 3]
        cy = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + matrix[1, 3]
        cz = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3]
        # the normal in the camera's axes, and the direction to the camera there
        nx, ny, nz = float(normals[texel, 0]), float(normals[texel, 1]), float(normals[texel, 2])
        nz_ = matrix[2, 0] * nx + matrix[2, 1] * ny + matrix[2, 2] * nz
        front = True
        if orthographic:
            dot = -nz_
        else:
            nx_ = matrix[0, 0] * nx + matrix[0, 1] * ny + matrix[0, 2] * nz
            ny_ = matrix[1, 0] * nx + matrix[1, 1] * ny + matrix[1, 2] * nz
            dot = -(nx_ * cx + ny_ * cy + nz_ * cz) / np.sqrt(max(cx * cx + cy * cy + cz * cz, 1e-30))
            front = cz > 1e-9
            cx, cy = (cx / cz, cy / cz) if front else (0.0, 0.0)
        u = intrinsics[0, 0] * cx + intrinsics[0, 1] * cy + intrinsics[0, 2]
        v = intrinsics[1, 0] * cx + intrinsics[1, 1] * cy + intrinsics[1, 2]
        pixels[texel, 0], pixels[texel, 1] = u, v
        facing[texel] = min(max(dot, 0.0), 1.0) if front else 0.0
        # at the outline the depth beside is that of the background: what faces away is told by its normal
        sees = front and dot > 0 and u >= 0 and v >= 0 and u < width and v < height and mask[int(v), int(u)]
        if sees:
            row, column = int(np.floor(v - 0.5)), int(np.floor(u - 0.5))
            deepest = -np.inf
            for down in range(2):
                for right in range(2):
                    r = min(max(row + down, 0), height - 1)
                    c = min(max(column + right, 0), width - 1)
                    deepest = max(deepest, depth[r, c])
            sees = cz <= deepest + tolerance
        visible[texel] = sees
        seen[texel] = sees and dot > least_facing


@parallel_kernel
def sample_picture(image: Float32, mask: Bools, pixels: Float32, where: Bools, colours: Float32) -> None:
    """Bilinear colours (T, 3) of `image` (H, W, 3) at `pixels`, of pixels in the mask alone, for the texels `where`."""
    height, width = mask.shape
    for texel in prange(len(pixels)):
        if not where[texel]:
            continue
        x, y = pixels[texel, 0] - 0.5, pixels[texel, 1] - 0.5
        column, row = int(np.floor(x)), int(np.floor(y))
        total = a = b = c = 0.0
        for down in range(2):
            for right in range(2):
                r, q = min(max(row + down, 0), height - 1), min(max(column + right, 0), width - 1)
                weight = (1.0 - abs(x - (column + right))) * (1.0 - abs(y - (row + down)))
                if mask[r, q]:
                    total += weight
                    a += weight * image[r, q, 0]
                    b += weight * image[r, q, 1]
                    c += weight * image[r, q, 2]
        # the pixel that the texel lies in is in the mask, and a quarter of the weight is its at least
        total = max(total, 1e-6)
        colours[texel, 0], colours[texel, 1], colours[texel, 2] = a / total, b / total, c / total


@parallel_kernel
def fill_from_border(points: Float32, border_points: Float32, border_colours: Float32, filled: Float32) -> None:
    """The mean of the border's colours by inverse squared distance, for each of `points` (n, 3)."""
    for item in prange(len(points)):
        total = a = b = c = 0.0
        for place in range(len(border_points)):
            x = points[item, 0] - border_points[place, 0]
            y = points[item, 1] - border_points[place, 1]
            z = points[item, 2] - border_points[place, 2]
            weight = 1.0 / max(float(x * x + y * y + z * z), 1e-12)
            total += weight
            a += weight * border_colours[place, 0]
            b += weight * border_colours[place, 1]
            c += weight * border_colours[place, 2]
        filled[item, 0], filled[item, 1], filled[item, 2] = a / total, b / total, c / total
