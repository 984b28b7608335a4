"""Patch search on a surface: one iteration of PatchMatch over vertices; `patch_search.py` explains the method.

A match of vertex v in a view is a pixel g (x, y) of the view's source image, and an in-plane rotation and scale f. Cell
(i, j) of the patch, at a = j - (m - 1) / 2 texels along the tangent and b = i - (m - 1) / 2 along the bitangent, shows
the pixel g + J(g) f (a, b), J(g) (2, 2) being pixels per texel at the surface point that pixel g shows. Images are
packed colours (uint32, 0x00BBGGRR), all views in one array; `frame` tells where each lies: (first, height, width).
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from ..kernels import device, inlined_device, parallel_kernel

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)
_UNIT = np.float32(1.0 / (1 << 24))


@device
def mixed(state: Any) -> Any:
    """A well mixed uint64 of a uint64 counter."""
    z = np.uint64(state) + _GOLDEN
    z = (z ^ (z >> np.uint64(30))) * _FIRST
    z = (z ^ (z >> np.uint64(27))) * _SECOND
    return z ^ (z >> np.uint64(31))


@device
def stream(seed: int, group: int, item: int, iteration: int) -> Any:
    """Where the random numbers of one item in one iteration start: they do not depend on any order of work."""
    state = mixed(np.uint64(seed))
    state = mixed(state ^ np.uint64(group))
    state = mixed(state ^ np.uint64(item))
    return mixed(state ^ np.uint64(iteration))


@inlined_device
def symmetric(state: Any) -> Any:
    """A float32 in [-1, 1) of the top bits of a random state."""
    return np.float32(np.int64(state >> np.uint64(40))) * (np.float32(2.0) * _UNIT) - np.float32(1.0)


@device
def gather_patch(texture: Any, cells: Any, patch: Any, known: Any) -> int:
    """Colours of the cells of a patch of the texture, as rows of red, green, blue (3, m * m) int32; the number known.

    known (m * m,) int32 is 1 where the surface has a texel, else 0 (its colours are then 0).
    """
    count = 0
    for c in range(len(cells)):
        texel = cells[c]
        if texel >= 0:
            colour = texture[texel]
            patch[0, c] = np.int32(colour & np.uint32(255))
            patch[1, c] = np.int32((colour >> np.uint32(8)) & np.uint32(255))
            patch[2, c] = np.int32((colour >> np.uint32(16)) & np.uint32(255))
            known[c] = 1
            count += 1
        else:
            patch[0, c] = patch[1, c] = patch[2, c] = 0
            known[c] = 0
    return count


@device
def patch_distance(
    image: Any, width: Any, x: Any, y: Any, turn: Any, size: int, patch: Any, known: Any, limit: Any
) -> Any:
    """Sum of squared differences (int32) of a patch of the texture and what the source image shows around (x, y).

    turn : J f as (xx, xy, yx, yy) float32, pixels per texel. Stops after the row in which the sum passes `limit`.
    """
    half = np.float32(0.5) * np.float32(size - 1)
    total = np.int32(0)
    for i in range(size):
        down = np.float32(i) - half
        left = x + turn[1] * down - turn[0] * half
        top = y + turn[3] * down - turn[2] * half
        first = i * size
        row = np.int32(0)
        for j in range(size):
            right = np.float32(np.int32(j))
            column = np.int32(left + turn[0] * right)
            line = np.int32(top + turn[2] * right)
            colour = np.int32(image[np.int32(line * width + column)])
            red = np.int32((colour & 255) - patch[0, first + j])
            green = np.int32(((colour >> 8) & 255) - patch[1, first + j])
            blue = np.int32((colour >> 16) - patch[2, first + j])
            row += np.int32(known[first + j] * (red * red + green * green + blue * blue))
        total = np.int32(total + row)
        if total > limit:
            return total
    return total


@inlined_device
def turned(jacobian: Any, angle: Any, scale: Any) -> Any:
    """J f as (xx, xy, yx, yy): `jacobian` (4,) after a rotation by `angle` and a scale in the tangent plane."""
    across, along = scale * np.float32(np.cos(angle)), scale * np.float32(np.sin(angle))
    return (
        jacobian[0] * across + jacobian[1] * along,
        jacobian[1] * across - jacobian[0] * along,
        jacobian[2] * across + jacobian[3] * along,
        jacobian[3] * across - jacobian[2] * along,
    )


@inlined_device
def within(value: Any, low: Any, high: Any) -> Any:
    """`value` drawn into [low, high]."""
    return min(max(value, low), high)


@parallel_kernel
def search(
    sources: Any, surface: Any, tasks: Any, targets: Any, owner: Any, rank: Any, texture: Any, before: Any, now: Any,
    limits: Any, iteration: int, seed: int,
) -> None:  # fmt: skip
    """One iteration of propagation and random search for all target vertices of all views.

    sources : images (N,) uint32, jacobians (N, 4) float32, usable (N,) bool (centres of source patches), frames (n, 3)
        int64. surface : vertices, tangents, bitangents (V, 3) float32 in texels, offsets (V + 1,), neighbours, cells
        (V, m * m) int32.
    tasks : (K, 3) int64, view, first and end in `targets`, runs of `order`. owner : (n, V) int32, the task of a vertex;
        -1 has a match that stays, -2 has none.
    rank : (V,) int32, place in the scan order. texture : (T,) uint32.
    before, now : position (n, V, 2), transform (n, V, 2) angle and scale, error (n, V), float32: the matches at the
        start, read across the borders of tasks, and those being worked on (a copy of them at the call).
    limits : float32, largest rotation, smallest and largest scale.
    """
    for task in numba.prange(len(tasks)):
        _search_task(sources, surface, tasks[task], task, targets, owner, rank, texture, before, now, limits,
                     iteration, seed)  # fmt: skip


@device
def _search_task(
    sources: Any, surface: Any, task: Any, name: int, targets: Any, owner: Any, rank: Any, texture: Any, before: Any,
    now: Any, limits: Any, iteration: int, seed: int,
) -> None:  # fmt: skip
    """The vertices of one task one after another, forwards in odd iterations and backwards in even ones."""
    view, cells = task[0], surface[5]
    size = int(np.sqrt(cells.shape[1]) + 0.5)
    patch, known = np.empty((3, cells.shape[1]), np.int32), np.empty(cells.shape[1], np.int32)
    for step in range(task[2] - task[1]):
        vertex = targets[task[1] + step] if iteration % 2 == 1 else targets[task[2] - 1 - step]
        count = gather_patch(texture, cells[vertex], patch, known)
        if count == 0:
            now[2][view, vertex] = np.float32(0.0)
            continue
        best = _rated(sources, view, now, vertex, size, patch, known)
        best = _propagate(sources, surface, view, name, vertex, owner, rank, before, now, limits, iteration, size,
                          patch, known, count, best)  # fmt: skip
        best = _search_randomly(sources, view, vertex, now, limits, iteration, seed, size, patch, known, best)
        now[2][view, vertex] = np.float32(best) / np.float32(count)


@device
def _rated(sources: Any, view: int, now: Any, vertex: int, size: int, patch: Any, known: Any) -> Any:
    """The error of the match that a vertex has, for the texture as it is now."""
    first, height, width = sources[3][view]
    x, y = now[0][view, vertex, 0], now[0][view, vertex, 1]
    jacobian = sources[1][first + np.int64(y) * width + np.int64(x)]
    turn = turned(jacobian, now[1][view, vertex, 0], now[1][view, vertex, 1])
    image = sources[0][first : first + height * width]
    return patch_distance(image, np.int32(width), x, y, turn, size, patch, known, np.int32(2147483647))


@device
def _tried(
    sources: Any, view: int, vertex: int, now: Any, x: Any, y: Any, angle: Any, scale: Any, size: int, patch: Any,
    known: Any, best: Any,
) -> Any:  # fmt: skip
    """The lower of `best` and the error at pixel (x, y), which becomes the vertex's match if it is lower."""
    first, height, width = sources[3][view]
    if not (x >= 0 and y >= 0 and x < width and y < height):
        return best
    pixel = first + np.int64(y) * width + np.int64(x)
    if not sources[2][pixel]:
        return best
    turn = turned(sources[1][pixel], angle, scale)
    image = sources[0][first : first + height * width]
    error = patch_distance(image, np.int32(width), x, y, turn, size, patch, known, best)
    if error < best:
        now[0][view, vertex, 0], now[0][view, vertex, 1] = x, y
        now[1][view, vertex, 0], now[1][view, vertex, 1] = angle, scale
        return error
    return best


@device
def _propagate(
    sources: Any, surface: Any, view: int, name: int, vertex: int, owner: Any, rank: Any, before: Any, now: Any,
    limits: Any, iteration: int, size: int, patch: Any, known: Any, count: int, best: Any,
) -> Any:  # fmt: skip
    """Matches of the visited neighbours with a lower error, carried over by T_k (sec. 4.3.1, Z-17)."""
    vertices, tangents, bitangents, offsets, neighbours = surface[0], surface[1], surface[2], surface[3], surface[4]
    first, _, width = sources[3][view]
    forwards = iteration % 2 == 1
    for n in range(offsets[vertex], offsets[vertex + 1]):
        other = neighbours[n]
        if owner[view, other] == -2 or (rank[other] < rank[vertex]) != forwards:
            continue
        match = now if owner[view, other] == name else before
        if match[2][view, other] * np.float32(count) >= np.float32(best):
            continue
        right, down = np.float32(0.0), np.float32(0.0)
        for axis in range(3):
            offset = vertices[vertex, axis] - vertices[other, axis]
            right += offset * tangents[other, axis]
            down += offset * bitangents[other, axis]
        x, y = match[0][view, other, 0], match[0][view, other, 1]
        angle = within(match[1][view, other, 0], -limits[0], limits[0])
        scale = within(match[1][view, other, 1], limits[1], limits[2])
        turn = turned(sources[1][first + np.int64(y) * width + np.int64(x)], angle, scale)
        x, y = x + turn[0] * right + turn[1] * down, y + turn[2] * right + turn[3] * down
        best = _tried(sources, view, vertex, now, x, y, angle, scale, size, patch, known, best)
    return best


@device
def _search_randomly(
    sources: Any, view: int, vertex: int, now: Any, limits: Any, iteration: int, seed: int, size: int, patch: Any,
    known: Any, best: Any,
) -> Any:  # fmt: skip
    """Candidates at random around the match within halving distances, down to a pixel (eq. 4), f at random too."""
    _, height, width = sources[3][view]
    state = stream(seed, view, vertex, iteration)
    reach, part = np.float32(max(height, width)), np.float32(1.0)
    while reach >= np.float32(1.0):
        x0, y0 = now[0][view, vertex, 0], now[0][view, vertex, 1]
        angle0, scale0 = now[1][view, vertex, 0], now[1][view, vertex, 1]
        state = mixed(state)
        x = x0 + reach * symmetric(state)
        state = mixed(state)
        y = y0 + reach * symmetric(state)
        state = mixed(state)
        angle = within(angle0 + part * limits[0] * symmetric(state), -limits[0], limits[0])
        state = mixed(state)
        middle = np.float32(0.5) * (limits[2] - limits[1])
        scale = within(scale0 + part * middle * symmetric(state), limits[1], limits[2])
        best = _tried(sources, view, vertex, now, x, y, angle, scale, size, patch, known, best)
        reach *= np.float32(0.5)
        part = max(part * np.float32(0.5), np.float32(0.05))
    return best
