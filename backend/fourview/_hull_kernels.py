"""Kernels of `hull`: how far inside the masks of the views each voxel lies."""

from __future__ import annotations

import math

import numba

from ..kernels import device, parallel_kernel
from ..types import Float32, Float64


@parallel_kernel
def cone_distances(
    places: Float64,
    to_camera: Float64,
    intrinsics: Float64,
    perspective: bool,
    inside_px: Float32,
    occluder_depth: Float32,
    skin: float,
    out: Float32,
) -> None:
    """Lower out (n,) to the distance, metres, by which places (n, 3), metres, world space, are allowed in one view.

    inside_px (H, W): signed distance to the mask's border at the pixels' middles, positive in the mask. A place behind
    the occluder is allowed too, by how far it is more than `skin` metres behind. Beyond the picture
    its border counts.
    """
    height, width = inside_px.shape
    scale = math.sqrt(abs(intrinsics[0, 0] * intrinsics[1, 1] - intrinsics[0, 1] * intrinsics[1, 0]))
    for i in numba.prange(len(places)):
        x, y, depth = _seen(places[i], to_camera)
        metres_per_px = 1.0 / scale
        if perspective:
            if depth <= 1e-9:
                out[i] = min(out[i], -1.0)
                continue
            x, y = x / depth, y / depth
            metres_per_px = depth / scale
        column = intrinsics[0, 0] * x + intrinsics[0, 1] * y + intrinsics[0, 2]
        row = intrinsics[1, 0] * x + intrinsics[1, 1] * y + intrinsics[1, 2]
        value = sample_clamped(inside_px, column, row) * metres_per_px
        r, c = math.floor(row), math.floor(column)
        if 0 <= r < height and 0 <= c < width:
            behind = depth - occluder_depth[r, c] - skin
            value = max(value, behind)
        if value < out[i]:
            out[i] = value


@device
def _seen(place, to_camera):  # type: ignore[no-untyped-def]
    x = to_camera[0, 0] * place[0] + to_camera[0, 1] * place[1] + to_camera[0, 2] * place[2] + to_camera[0, 3]
    y = to_camera[1, 0] * place[0] + to_camera[1, 1] * place[1] + to_camera[1, 2] * place[2] + to_camera[1, 3]
    z = to_camera[2, 0] * place[0] + to_camera[2, 1] * place[1] + to_camera[2, 2] * place[2] + to_camera[2, 3]
    return x, y, z


@device
def sample_clamped(picture, column, row):  # type: ignore[no-untyped-def]
    """Bilinear between pixel middles; beyond the border pixels the border's value, less the way there if it is < 0."""
    height, width = picture.shape
    u = min(max(column - 0.5, 0.0), width - 1.0)
    v = min(max(row - 0.5, 0.0), height - 1.0)
    i, j = min(int(v), max(height - 2, 0)), min(int(u), max(width - 2, 0))
    k, m = min(i + 1, height - 1), min(j + 1, width - 1)
    a, b = v - i, u - j
    value = (1.0 - a) * ((1.0 - b) * picture[i, j] + b * picture[i, m]) + a * (
        (1.0 - b) * picture[k, j] + b * picture[k, m]
    )
    if value < 0.0:
        value -= math.hypot(column - 0.5 - u, row - 0.5 - v)
    return value
