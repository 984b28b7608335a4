"""Voting and blending of textures on a surface; `texture.py` explains the method."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from ..kernels import device, inlined_device, kernel, parallel_kernel


@kernel
def patches_of_texels(cells: Any, n_texels: int) -> Any:
    """Which patches contain each texel, as rows of one array: offsets (T + 1,) int64, vertices int32 ascending.

    cells : (V, m * m) int32, the texels of each patch, -1 for none. A patch that meets a texel twice counts once.
    """
    offsets, last = np.zeros(n_texels + 1, np.int64), np.full(n_texels, -1, np.int32)
    for vertex in range(len(cells)):
        for texel in cells[vertex]:
            if texel >= 0 and last[texel] != vertex:
                last[texel] = vertex
                offsets[texel + 1] += 1
    offsets = np.cumsum(offsets)
    place, vertices = offsets[:-1].copy(), np.empty(offsets[-1], np.int32)
    for vertex in range(len(cells)):
        for texel in cells[vertex]:
            if texel >= 0 and (place[texel] == offsets[texel] or vertices[place[texel] - 1] != vertex):
                vertices[place[texel]] = vertex
                place[texel] += 1
    return offsets, vertices


@inlined_device
def channel(colour: Any, shift: int) -> Any:
    """One channel, float32 in [0, 255], of a packed colour."""
    return np.float32(np.int32((colour >> np.uint32(shift)) & np.uint32(255)))


@device
def bilinear(image: Any, height: int, width: int, x: Any, y: Any) -> Any:
    """Red, green and blue, float32 in [0, 1], of a packed image (H * W,) at pixel (x, y); the border goes on."""
    x = min(max(x - np.float32(0.5), np.float32(0.0)), np.float32(width - 1))
    y = min(max(y - np.float32(0.5), np.float32(0.0)), np.float32(height - 1))
    column, line = min(int(x), width - 2), min(int(y), height - 2)
    right, down = x - np.float32(column), y - np.float32(line)
    scale = np.float32(1.0 / 255.0)
    a = (np.float32(1.0) - right) * (np.float32(1.0) - down) * scale
    b, c, d = right * (np.float32(1.0) - down) * scale, (np.float32(1.0) - right) * down * scale, right * down * scale
    corner = line * width + column
    p, q, r, s = image[corner], image[corner + 1], image[corner + width], image[corner + width + 1]
    red = a * channel(p, 0) + b * channel(q, 0) + c * channel(r, 0) + d * channel(s, 0)
    green = a * channel(p, 8) + b * channel(q, 8) + c * channel(r, 8) + d * channel(s, 8)
    blue = a * channel(p, 16) + b * channel(q, 16) + c * channel(r, 16) + d * channel(s, 16)
    return red, green, blue


@parallel_kernel
def sample_pixels(image: Any, frame: Any, pixels: Any, where: Any, out: Any) -> None:
    """out[t] (T, 3) = colour of the packed image at pixels[t] (T, 2) float32, for the texels (N,) in `where`."""
    for k in numba.prange(len(where)):
        t = where[k]
        red, green, blue = bilinear(image, frame[1], frame[2], pixels[t, 0], pixels[t, 1])
        out[t, 0], out[t, 1], out[t, 2] = red, green, blue


@parallel_kernel
def pack(colours: Any, out: Any) -> None:
    """Colours (T, 3) float32 in [0, 1] to packed ones (T,) uint32."""
    for t in numba.prange(len(colours)):
        value = np.uint32(0)
        for c in range(3):
            level = min(max(colours[t, c], np.float32(0.0)), np.float32(1.0)) * np.float32(255.0) + np.float32(0.5)
            value |= np.uint32(np.int32(level)) << np.uint32(8 * c)
        out[t] = value


@parallel_kernel
def vote(
    image: Any, frame: Any, matches: Any, surface: Any, texels: Any, offsets: Any, members: Any, where: Any,
    colours: Any, out: Any,
) -> None:  # fmt: skip
    """Mean of what the patches around a texel show there (eq. 5), into out (T, 3), for the texels in `where`.

    matches : (V, 7) float32 for each vertex: 1 or 0 (has a match or not), x, y, J f (xx, xy, yx, yy).
    surface : vertices, normals, tangents, bitangents, (V, 3) float32, and texels : points, normals (T, 3) float32, the
    points in texels. Weights: cosine between the normals of texel and patch, none below 0.5. A texel without any patch
    takes its colour of `colours` (T, 3).
    """
    vertices, normals, tangents, bitangents = surface
    points, texel_normals = texels
    for k in numba.prange(len(where)):
        t = where[k]
        total = np.float32(0.0)
        red, green, blue = np.float32(0.0), np.float32(0.0), np.float32(0.0)
        for n in range(offsets[t], offsets[t + 1]):
            v = members[n]
            if matches[v, 0] == 0:
                continue
            weight, right, down = np.float32(0.0), np.float32(0.0), np.float32(0.0)
            for axis in range(3):
                weight += texel_normals[t, axis] * normals[v, axis]
                offset = points[t, axis] - vertices[v, axis]
                right += offset * tangents[v, axis]
                down += offset * bitangents[v, axis]
            if weight < np.float32(0.5):
                continue
            x = matches[v, 1] + matches[v, 3] * right + matches[v, 4] * down
            y = matches[v, 2] + matches[v, 5] * right + matches[v, 6] * down
            one, two, three = bilinear(image, frame[1], frame[2], x, y)
            red, green, blue = red + weight * one, green + weight * two, blue + weight * three
            total += weight
        if total > 0:
            out[t, 0], out[t, 1], out[t, 2] = red / total, green / total, blue / total
        else:
            out[t, 0], out[t, 1], out[t, 2] = colours[t, 0], colours[t, 1], colours[t, 2]
