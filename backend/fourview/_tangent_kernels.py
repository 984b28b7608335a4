"""Kernels of `tangent_filter`: a bank of filters on the tangent plane of every texel (Z-19, M-37)."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from ..kernels import device, parallel_kernel, summing_device

N_CHUNKS = 256  # fixed shares of the texels; each has its own buffers
_NEAR = 1.2  # texel spacings: texels so near stand for a place across a seam


@summing_device
def _dot(a: Any, b: Any) -> Any:
    total = np.float32(0.0)
    for k in range(a.shape[0]):
        total += a[k] * b[k]
    return total


@device
def _difference(points: Any, charts: Any, grid: Any, row: int, column: int, down: int, right: int, out: Any) -> bool:
    """out = the change of the surface's points from one texel to the next, down or right, within one chart."""
    chart, here = charts[row, column], grid[row, column]
    ahead = grid[row + down, column + right] if charts[row + down, column + right] == chart else here
    back = grid[row - down, column - right] if charts[row - down, column - right] == chart else here
    share = int(ahead != here) + int(back != here)
    if share == 0:
        return False
    for c in range(3):
        out[c] = (points[ahead, c] - points[back, c]) / share
    return True


@device
def _across_seam(
    picture: Any, places: Any, points: Any, normals: Any, normal: Any, place: Any, hashing: Any, limit: float
) -> Any:
    """The picture at a place in space, of the texels within `limit` on the same side of the hair; NaN without any.

    Texels count with (1 - square distance / square limit)^2: nearly linear interpolation between them.
    """
    low, cell, shape, starts, members = hashing
    total, weights = 0.0, 0.0
    first_x = int(np.floor((place[0] - low[0]) / cell - 0.5))
    first_y = int(np.floor((place[1] - low[1]) / cell - 0.5))
    first_z = int(np.floor((place[2] - low[2]) / cell - 0.5))
    for i in range(max(first_x, 0), min(first_x + 2, shape[0])):
        for j in range(max(first_y, 0), min(first_y + 2, shape[1])):
            for k in range(max(first_z, 0), min(first_z + 2, shape[2])):
                cell_index = (i * shape[1] + j) * shape[2] + k
                for m in range(starts[cell_index], starts[cell_index + 1]):
                    texel = members[m]
                    dx, dy, dz = points[texel, 0] - place[0], points[texel, 1] - place[1], points[texel, 2] - place[2]
                    share = 1.0 - (dx * dx + dy * dy + dz * dz) / (limit * limit)
                    if share > 0.0:
                        facing = normals[texel, 0] * normal[0] + normals[texel, 1] * normal[1]
                        if facing + normals[texel, 2] * normal[2] > 0.2:
                            weights += share * share
                            total += share * share * picture[places[texel, 0], places[texel, 1]]
    return np.float32(total / weights) if weights > 0.0 else np.float32(np.nan)


@device
def _sample_inner(picture: Any, row: int, column: int, inverse: Any, offsets: Any, out: Any) -> None:
    """Fill out (M,) with the picture at the offsets, all of which lie in the texel's chart."""
    for k in range(offsets.shape[0]):
        c = np.float32(column) + inverse[0] * offsets[k, 0] + inverse[1] * offsets[k, 1]
        r = np.float32(row) + inverse[2] * offsets[k, 0] + inverse[3] * offsets[k, 1]
        c0, r0 = np.uint64(c), np.uint64(r)
        u, v = c - np.float32(c0), r - np.float32(r0)
        left = picture[r0, c0] + v * (picture[r0 + np.uint64(1), c0] - picture[r0, c0])
        c1 = c0 + np.uint64(1)
        right = picture[r0, c1] + v * (picture[r0 + np.uint64(1), c1] - picture[r0, c1])
        out[k] = left + u * (right - left)


@device
def _sample(
    picture: Any, points: Any, normals: Any, charts: Any, places: Any, texel: int, frame: Any, inverse: Any,
    spacing: float, offsets: Any, hashing: Any, out: Any,
) -> int:  # fmt: skip
    """Fill out (M,) with the picture at the offsets, across seams too; gives how many were found."""
    row, column = places[texel, 0], places[texel, 1]
    size = charts.shape[0]
    chart = charts[row, column]
    found, total = 0, 0.0
    for k in range(offsets.shape[0]):
        out[k] = np.nan
        c = column + inverse[0] * offsets[k, 0] + inverse[1] * offsets[k, 1]
        r = row + inverse[2] * offsets[k, 0] + inverse[3] * offsets[k, 1]
        if inverse[4] > 0 and 0 <= c < size - 1 and 0 <= r < size - 1:
            c0, r0 = int(c), int(r)
            if (
                charts[r0, c0] == chart
                and charts[r0 + 1, c0] == chart
                and charts[r0, c0 + 1] == chart
                and charts[r0 + 1, c0 + 1] == chart
            ):
                u, v = np.float32(c - c0), np.float32(r - r0)
                above = picture[r0, c0] * (1 - u) + picture[r0, c0 + 1] * u
                below = picture[r0 + 1, c0] * (1 - u) + picture[r0 + 1, c0 + 1] * u
                out[k] = above * (1 - v) + below * v
        if np.isnan(out[k]):
            x, y = offsets[k, 0] * spacing, offsets[k, 1] * spacing
            place = (
                points[texel, 0] + x * frame[0, 0] + y * frame[1, 0],
                points[texel, 1] + x * frame[0, 1] + y * frame[1, 1],
                points[texel, 2] + x * frame[0, 2] + y * frame[1, 2],
            )
            out[k] = _across_seam(picture, places, points, normals, normals[texel], place, hashing, _NEAR * spacing)
        if not np.isnan(out[k]):
            found += 1
            total += out[k]
    mean = np.float32(total / max(found, 1))
    for k in range(offsets.shape[0]):
        if np.isnan(out[k]):
            out[k] = mean
    return found


@device
def _peak(responses: Any, distances: Any) -> Any:
    """The angle in bins of the largest response, between the bins by a parabola, and M-37's confidence."""
    count = responses.shape[0]
    best = 0
    for k in range(1, count):
        if responses[k] > responses[best]:
            best = k
    top = responses[best]
    total = 0.0
    for k in range(count):
        drop = responses[k] - top
        total += distances[(k - best) % count] * drop * drop
    before, after = responses[(best - 1) % count], responses[(best + 1) % count]
    bend = before - 2.0 * top + after
    shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
    return best + shift, np.sqrt(total)


@device
def _inverse(along_column: Any, along_row: Any, frame: Any, spacing: float) -> Any:
    """Texels right and down per spacing along the frame's two axes: 4 numbers, and 1 if they are to be trusted."""
    a = along_column[0] * frame[0, 0] + along_column[1] * frame[0, 1] + along_column[2] * frame[0, 2]
    b = along_row[0] * frame[0, 0] + along_row[1] * frame[0, 1] + along_row[2] * frame[0, 2]
    c = along_column[0] * frame[1, 0] + along_column[1] * frame[1, 1] + along_column[2] * frame[1, 2]
    d = along_row[0] * frame[1, 0] + along_row[1] * frame[1, 1] + along_row[2] * frame[1, 2]
    determinant = a * d - b * c
    if abs(determinant) < 0.05 * spacing * spacing:
        zero = np.float32(0.0)
        return zero, zero, zero, zero, zero
    scale = spacing / determinant
    return np.float32(d * scale), np.float32(-b * scale), np.float32(-c * scale), np.float32(a * scale), np.float32(1.0)


@parallel_kernel
def filter_texels(
    picture: Any, points: Any, normals: Any, frames: Any, grid: Any, charts: Any, inner: Any, places: Any,
    spacing: float, offsets: Any, bank: Any, distances: Any, low: Any, cell: float, shape: Any, starts: Any,
    members: Any, reach: float, angle: Any, confidence: Any,
) -> None:  # fmt: skip
    """angle (T,) rad and confidence (T,) of the strongest of the bank's K filters (K, M) on each tangent plane.

    picture, grid, charts, inner (N, N) : the atlas with a border outside the charts; grid the index of each texel,
    inner whether the chart goes on for `reach` texels around. places : (T, 2), row and column there. frames : (T, 2,
    3), tangent and bitangent. offsets : (M, 2) in texels along these. distances : (K,) between bins.
    Negative responses (dark lines) count as 0, as in pictures.
    """
    count = points.shape[0]
    n_bins = bank.shape[0]
    hashing = (low, cell, shape, starts, members)
    furthest = np.abs(offsets).max()
    for chunk in numba.prange(N_CHUNKS):
        samples = np.empty(offsets.shape[0], np.float32)
        responses = np.empty(n_bins, np.float32)
        along_column, along_row = np.empty(3), np.empty(3)
        zero = np.float32(0.0)
        for texel in range(chunk * count // N_CHUNKS, (chunk + 1) * count // N_CHUNKS):
            row, column = places[texel, 0], places[texel, 1]
            inverse, frame = (zero, zero, zero, zero, zero), frames[texel]
            if _difference(points, charts, grid, row, column, 0, 1, along_column) and _difference(
                points, charts, grid, row, column, 1, 0, along_row
            ):
                inverse = _inverse(along_column, along_row, frame, spacing)
            across = max(abs(inverse[0]) + abs(inverse[1]), abs(inverse[2]) + abs(inverse[3])) * furthest
            found = offsets.shape[0]
            if inverse[4] > 0 and inner[row, column] and across < reach - 1:
                _sample_inner(picture, row, column, inverse, offsets, samples)
            else:
                found = _sample(
                    picture, points, normals, charts, places, texel, frame, inverse, spacing, offsets, hashing, samples
                )
            for k in range(n_bins):
                responses[k] = max(_dot(samples, bank[k]), zero)
            bins, trust = _peak(responses, distances)
            angle[texel] = bins * np.pi / n_bins
            # beyond the border of the surface nothing is known: a filter cut in half sees what is not there
            whole = found / offsets.shape[0]
            confidence[texel] = trust * whole * whole
