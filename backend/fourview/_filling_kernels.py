"""Kernels of `filling`: strands blended of guides, kept in the shape, out of the head and inside the photos' masks.

A strand's work is its own, so results do not depend on the thread count.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ..geometry._collider_kernels import sample_distance, sample_gradient
from ..kernels import device, parallel_kernel
from ..types import Float32, Float64, Floats, Int32
from ._space_kernels import GRADIENTS, N_VALUES, SCALP, SHAPE, leave_head, sample_space

_SMOOTHING = 3  # times that moves are averaged along a strand
_OFF_HEAD = 2e-5  # metres more than its clearance that a point is moved off the head
_CHECKS = 4  # places of a segment that are looked up in the masks
_CHORD = 8.0  # pixels that the chord of a bend may lie further off than its ends
_GAP = 3.0  # cells around the scalp where hair may lie outside the shape


@parallel_kernel
def blend_guides(
    roots: Floats, chosen: Int32, weights: Floats, guides: Floats, frames: Floats, spread: Floats, points: Floats
) -> None:
    """points (S, N, 3): each strand blended of copies of its guides (M-39).

    roots (S, 3); chosen (S, K) guides and their weights, sum 1; guides (G, N, 3), frames (G, N, 3, 3) along them.
    A copy keeps the root's place in the frame that runs along the guide, times `spread` (G, N).
    """
    n_points = guides.shape[1]
    for s in numba.prange(len(roots)):
        local = np.empty(3)
        for i in range(n_points):
            for axis in range(3):
                points[s, i, axis] = 0.0
        for k in range(chosen.shape[1]):
            weight = weights[s, k]
            if weight <= 0.0:
                continue
            guide = chosen[s, k]
            for axis in range(3):
                local[axis] = 0.0
                for c in range(3):
                    local[axis] += frames[guide, 0, c, axis] * (roots[s, c] - guides[guide, 0, c])
            for i in range(n_points):
                for c in range(3):
                    place = guides[guide, i, c]
                    for axis in range(3):
                        place += spread[guide, i] * frames[guide, i, c, axis] * local[axis]
                    points[s, i, c] += weight * place


@parallel_kernel
def choose_blends(
    primary: Int32, near: Int32, distances: Floats, guides: Floats, lengths: Float64, limit: float, randoms: Floats,
    reach: float, weights: Floats,
) -> None:  # fmt: skip
    """weights (S, K) of the guides near (S, K), 0 for those whose shape is too far from the primary's; sum 1.

    distances (S, K) of the roots; randoms (S, K) in [0, 1]; reach: metres, softens 1 / d^2.
    """
    n_points = guides.shape[1]
    for s in numba.prange(len(primary)):
        own, total = primary[s], 0.0
        for k in range(near.shape[1]):
            guide = near[s, k]
            apart = 0.0
            for i in range(3, n_points, 4):
                square = 0.0
                for c in range(3):
                    step = (guides[guide, i, c] - guides[guide, 0, c]) - (guides[own, i, c] - guides[own, 0, c])
                    square += step * step
                apart += math.sqrt(square)
            apart /= max(1, len(range(3, n_points, 4)))
            weight = 0.0
            if guide == own or apart < limit * min(lengths[own], lengths[guide]):
                weight = (0.05 + randoms[s, k]) / (distances[s, k] ** 2 + reach * reach)
                if guide == own:
                    weight *= 2.0
            weights[s, k] = weight
            total += weight
        for k in range(near.shape[1]):
            weights[s, k] /= total


@device
def smooth_moves(moves: Float64) -> None:
    """Average moves (N, 3) with their neighbours; the root keeps none. The far end of a bend moves what is near too."""
    n_points = len(moves)
    for _ in range(_SMOOTHING):
        for axis in range(3):
            before = 0.0
            for i in range(1, n_points):
                here = moves[i, axis]
                after = moves[i + 1, axis] if i + 1 < n_points else here
                moves[i, axis] = 0.25 * before + 0.5 * here + 0.25 * after
                before = here


@parallel_kernel
def keep_in_shape(
    points: Floats, clearance: float, distances: Float32, directions: Float32, origin: Float64, cell: float
) -> None:
    """Bend points (S, N, 3) into the closed shape, but near the scalp, and then out of the head; roots stay."""
    n_points = points.shape[1]
    for s in numba.prange(len(points)):
        values, moves = np.empty(N_VALUES), np.zeros((n_points, 3))
        outside = False
        for i in range(1, n_points):
            x, y, z = points[s, i, 0], points[s, i, 1], points[s, i, 2]
            sample_space(distances, directions, origin, cell, x, y, z, values)
            if values[SHAPE] > 0.0 and values[SCALP] > _GAP * cell:
                outside = True
                g = GRADIENTS + 3 * SHAPE
                square = values[g] * values[g] + values[g + 1] * values[g + 1] + values[g + 2] * values[g + 2]
                if square > 0.05:
                    for axis in range(3):
                        moves[i, axis] = -values[SHAPE] * values[g + axis] / square
        if outside:
            smooth_moves(moves)
            for i in range(1, n_points):
                for axis in range(3):
                    points[s, i, axis] += moves[i, axis]
        for i in range(1, n_points):
            leave_head(points[s, i], clearance, _OFF_HEAD, distances, directions, origin, cell, values)


@device
def _to_pixel(turn: Float64, intrinsics: Float64, orthographic: bool, point: Floats) -> tuple[float, float, float]:
    x = turn[0, 0] * point[0] + turn[0, 1] * point[1] + turn[0, 2] * point[2] + turn[0, 3]
    y = turn[1, 0] * point[0] + turn[1, 1] * point[1] + turn[1, 2] * point[2] + turn[1, 3]
    z = turn[2, 0] * point[0] + turn[2, 1] * point[1] + turn[2, 2] * point[2] + turn[2, 3]
    if not orthographic:
        deep = max(z, 1e-6)
        x, y = x / deep, y / deep
    return (
        intrinsics[0, 0] * x + intrinsics[0, 1] * y + intrinsics[0, 2],
        intrinsics[1, 0] * x + intrinsics[1, 1] * y + intrinsics[1, 2],
        z,
    )


@device
def _off_mask(
    turn: Float64, intrinsics: Float64, orthographic: bool, away: Float32, to_mask: Float32, head_depth: Float32,
    point: Floats, move: Float64, share: float,
) -> float:  # fmt: skip
    """How many pixels a point (3,) lies off the mask; `share` of the way back is added to move (3,).

    What the head hides may lie anywhere: nobody sees it in the photo.
    """
    x, y, z = _to_pixel(turn, intrinsics, orthographic, point)
    height, width = away.shape
    column, row = min(max(math.floor(x), 0), width - 1), min(max(math.floor(y), 0), height - 1)
    off = float(away[row, column])
    beyond = max(max(-x, x - width), max(-y, y - height))
    if beyond > 0.0 and off > 0.0:
        off += beyond
    if off <= 0.0 or z > head_depth[row, column]:
        return 0.0
    deep = 1.0 if orthographic else max(z, 1e-6)
    dx = (column + 0.5 + to_mask[row, column, 0] - x) * deep / intrinsics[0, 0]
    dy = (row + 0.5 + to_mask[row, column, 1] - y) * deep / intrinsics[1, 1]
    for axis in range(3):
        move[axis] += share * (dx * turn[0, axis] + dy * turn[1, axis])
    return off


@parallel_kernel
def keep_in_masks(
    points: Floats, turns: Float64, intrinsics: Float64, orthographic: Int32, away: Float32, to_mask: Float32,
    head_depth: Float32, margin: float, rounds: int, clearance: float, distances: Float32, directions: Float32,
    origin: Float64, cell: float, kept: Float64,
) -> None:  # fmt: skip
    """Bend points (S, N, 3) until all views have them in their masks (Z-22); kept (S,): the share before the first off.

    turns (V, 4, 4), intrinsics (V, 3, 3), orthographic (V,): the cameras. away (V, H, W): pixels to the mask, 0 in it;
    to_mask (V, H, W, 2): x and y from a pixel to the nearest of the mask. head_depth (V, H, W): metres. margin: pixels.
    """
    n_strands, n_points, _ = points.shape
    for s in numba.prange(n_strands):
        values, moves, none, place = np.empty(N_VALUES), np.empty((n_points, 3)), np.zeros(3), np.empty(3)
        for _ in range(rounds):
            moves[:] = 0.0
            worst = 0.0
            for v in range(len(turns)):
                for i in range(1, n_points):
                    off = _off_mask(
                        turns[v], intrinsics[v], orthographic[v] != 0, away[v], to_mask[v], head_depth[v],
                        points[s, i], moves[i], 1.0,
                    )  # fmt: skip
                    worst = max(worst, off)
            if worst <= 0.0:
                break
            smooth_moves(moves)
            for i in range(1, n_points):
                for axis in range(3):
                    points[s, i, axis] += moves[i, axis]
                leave_head(points[s, i], clearance, _OFF_HEAD, distances, directions, origin, cell, values)
        last = n_points - 1
        for i in range(n_points - 1, 0, -1):
            # a long segment may leave the mask between its ends
            for part in range(1, _CHECKS + 1):
                for axis in range(3):
                    place[axis] = points[s, i - 1, axis] + part / _CHECKS * (
                        points[s, i, axis] - points[s, i - 1, axis]
                    )
                for v in range(len(turns)):
                    off = _off_mask(
                        turns[v], intrinsics[v], orthographic[v] != 0, away[v], to_mask[v], head_depth[v], place, none,
                        0.0,
                    )  # fmt: skip
                    if off > (margin if part == _CHECKS else margin + _CHORD):
                        last = i - 1
        kept[s] = last / (n_points - 1.0)


@parallel_kernel
def cut_strands(points: Floats, kept: Float64) -> None:
    """Draw points (S, N, 3) anew, evenly over the first `kept` (S,) share of each strand's segments."""
    n_points = points.shape[1]
    for s in numba.prange(len(points)):
        if kept[s] >= 1.0:
            continue
        old = points[s].copy()
        for n in range(1, n_points):
            place = kept[s] * n
            i = min(int(place), n_points - 2)
            share = place - i
            for axis in range(3):
                points[s, n, axis] = old[i, axis] + share * (old[i + 1, axis] - old[i, axis])


@parallel_kernel
def push_out(points: Floats, clearance: float, distance: Float32, origin: Float64, cell: float) -> None:
    """Push points (S, N, 3), but roots, out of the head, whose `Collider` the other arguments are."""
    for s in numba.prange(len(points)):
        for i in range(1, points.shape[1]):
            # strands leave the scalp gently: the full clearance is kept from the third point on
            wanted = clearance * min(1.0, i / 2.0)
            for _ in range(6):
                x, y, z = points[s, i, 0], points[s, i, 1], points[s, i, 2]
                deep = wanted - sample_distance(distance, origin, cell, x, y, z)
                if deep <= 0.0:
                    break
                gx, gy, gz = sample_gradient(distance, origin, cell, x, y, z)
                square = gx * gx + gy * gy + gz * gz
                if square < 0.05:
                    break
                scale = (deep + 1e-5) / square
                points[s, i, 0], points[s, i, 1], points[s, i, 2] = x + scale * gx, y + scale * gy, z + scale * gz
