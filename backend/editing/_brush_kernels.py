"""Compiled loops of the comb's brush: which hair is under it, and carrying hair with its center strands."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numba
import numpy as np

from ..kernels import device, parallel_kernel
from ..types import Float32, Float64, Int32
from ._deformation_kernels import arc_lengths, slide_out, walk
from ._rotation_kernels import multiply, rotate

_CHUNKS = 64  # of the strands that are carried, each with its own working space


@device
def _to_pixels(m: Any, half: Any, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Pixels of a world point, and its clip w; m (4, 4), half (2,) of the view's size."""
    w = m[3, 0] * x + m[3, 1] * y + m[3, 2] * z + m[3, 3]
    safe = w if w > 1e-9 else 1e-9
    u = (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]) / safe
    v = (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]) / safe
    return (u + 1.0) * half[0], (v + 1.0) * half[1], w


@device
def _fade(distance: float, radius: float, hardness: float) -> float:
    """1 up to `hardness` of the radius, then smoothly down to 0 at the radius."""
    share = distance / radius
    if share >= 1.0:
        return 0.0
    if share <= hardness:
        return 1.0
    t = (1.0 - share) / (1.0 - hardness)
    return t * t * (3.0 - 2.0 * t)


@parallel_kernel
def near_centers(
    centers: Float32, chosen: Int32, widths: Float64, matrix: Float64, half: Float64, scale: float, place: Float64,
    radius: float, is_near: Any,
) -> None:  # fmt: skip
    """is_near (n,): may hair within `widths` (K,), metres, of the chosen centers (K, N, 3) reach into the circle?

    scale : pixels that a metre across the view has at clip w 1, at most.
    """
    for a in numba.prange(len(chosen)):
        center = centers[chosen[a]]
        before_x = before_y = 0.0
        is_near[a] = False
        for i in range(center.shape[0]):
            x, y, w = _to_pixels(matrix, half, center[i, 0], center[i, 1], center[i, 2])
            reach = radius + widths[chosen[a]] * scale / max(w - widths[chosen[a]], 1e-3)
            if i > 0:
                # at least the length of the segment on the screen
                reach += abs(x - before_x) + abs(y - before_y)
            before_x, before_y = x, y
            if w <= widths[chosen[a]] or (x - place[0]) ** 2 + (y - place[1]) ** 2 < reach * reach:
                is_near[a] = True
                break


@parallel_kernel
def front_depths(
    points: Float32, offsets: Int32, members: Int32, starts: Int32, chosen: Int32,
    matrix: Float64, half: Float64, forward: Float64, place: Float64, radius: float, depths: Float64,
) -> None:  # fmt: skip
    """depths (n,): the least depth along `forward` (3,) of the hair of each chosen wisp that the circle may touch.

    A point counts if it lies no farther from the circle than from the point before it; inf where none does.
    """
    for a in numba.prange(len(chosen)):
        least = np.inf
        for m in range(starts[chosen[a]], starts[chosen[a] + 1]):
            first = offsets[members[m]]
            before_x = before_y = 0.0
            for p in range(first, offsets[members[m] + 1]):
                x, y, w = _to_pixels(matrix, half, points[p, 0], points[p, 1], points[p, 2])
                reach = radius
                if p > first:
                    # at least the length of the segment on the screen
                    reach += abs(x - before_x) + abs(y - before_y)
                before_x, before_y = x, y
                dx, dy = x - place[0], y - place[1]
                if w <= 0.0 or dx * dx + dy * dy >= reach * reach:
                    continue
                depth = forward[0] * points[p, 0] + forward[1] * points[p, 1] + forward[2] * points[p, 2]
                least = min(least, depth)
        depths[a] = least


@device
def _touch_segment(
    a: Any, b: Any, place_a: float, place_b: float, brush: Any, deepest: float, hardness: float, amount: float, row: Any
) -> None:
    """Enter the part of a projected segment that is nearest to the brush; a, b are x, y, w, depth."""
    if a[2] <= 0.0 or b[2] <= 0.0:
        return
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    t = 0.0
    if square > 0.0:
        t = ((brush[0] - a[0]) * dx + (brush[1] - a[1]) * dy) / square
        t = min(max(t, 0.0), 1.0)
    depth = a[3] + t * (b[3] - a[3])
    if depth > deepest:
        return
    away = sqrt((a[0] + t * dx - brush[0]) ** 2 + (a[1] + t * dy - brush[1]) ** 2)
    value = amount * _fade(away, brush[2], hardness)
    if value > 0.0:
        index = int(place_a + t * (place_b - place_a) + 0.5)
        row[index] = max(row[index], value)


@parallel_kernel
def touch(
    points: Float32, offsets: Int32, members: Int32, starts: Int32, places: Float32, chosen: Int32, amounts: Float32,
    matrix: Float64, half: Float64, forward: Float64, brush: Float64, deepest: Float64, hardness: float,
    touched: Float64,
) -> None:  # fmt: skip
    """touched (n, N): how strongly the brush holds each sample of the chosen centers, through any hair of the wisp.

    brush (3,): x, y and radius in pixels. deepest (n,): the largest depth that counts. amounts (S,): the selection.
    """
    for a in numba.prange(len(chosen)):
        row = touched[a]
        before, here = np.empty(4), np.empty(4)
        for m in range(starts[chosen[a]], starts[chosen[a] + 1]):
            strand = members[m]
            if amounts[strand] <= 0.0:
                continue
            for p in range(offsets[strand], offsets[strand + 1]):
                px, py, pz = points[p, 0], points[p, 1], points[p, 2]
                here[0], here[1], here[2] = _to_pixels(matrix, half, px, py, pz)
                here[3] = forward[0] * px + forward[1] * py + forward[2] * pz
                if p > offsets[strand]:
                    _touch_segment(
                        before, here, places[p - 1], places[p], brush, deepest[a], hardness, amounts[strand], row
                    )
                before[:] = here
        _fill_gaps(row)


@device
def _fill_gaps(row: Any) -> None:
    """Samples between two held ones that no point of the hair belongs to are held as these are."""
    n = row.shape[0]
    last = -1
    for i in range(n):
        if row[i] <= 0.0:
            continue
        if 0 <= last < i - 1 and i - last <= max(2, n // 8):
            for j in range(last + 1, i):
                t = (j - last) / (i - last)
                row[j] = (1.0 - t) * row[last] + t * row[i]
        last = i


@device
def _point_turns(turns: Any, width: float, result: Any) -> None:
    """Rotations at the points (N, 4) from those of the edges (N - 1, 4), smoothed over the wisp's width, in samples.

    Hair beside a center that bends more sharply than the wisp is wide would be folded back on the inner side.
    """
    m = turns.shape[0]
    for i in range(m + 1):
        # less near the root, which does not turn, and evenly to both sides
        reach = min(width + 0.5, float(i) + 0.5)
        total = 0.0
        for c in range(4):
            result[i, c] = 0.0
        low, high = int(max(i - reach - 0.5, 0.0)), int(min(i + reach, m - 1.0))
        for j in range(low, high + 1):
            weight = max(reach + 0.5 - abs(j + 0.5 - i), 0.0)
            dot = 0.0
            for c in range(4):
                dot += result[i, c] * turns[j, c]
            if dot < 0.0:
                weight = -weight
            for c in range(4):
                result[i, c] += weight * turns[j, c]
        for c in range(4):
            total += result[i, c] ** 2
        norm = sqrt(total)
        if i == 0 or norm < 1e-9:
            result[i] = turns[min(i, m - 1)]
            continue
        for c in range(4):
            result[i, c] /= norm


@parallel_kernel
def carry(
    strands: Int32, slots: Int32, offsets: Int32, places: Float32, rest_points: Float32, points: Float32,
    amounts: Float32, rest_centers: Float64, centers: Float64, turns: Float64, widths: Float64,
    distance: Any, origin: Float64, cell: float, margin: float,
) -> None:  # fmt: skip
    """Bring the hair along: points (P, 3) of the given strands (n,) from where their centers (A, N, 3) are now.

    slots (n,): the row of each strand's center. turns (A, N - 1, 4): rotations of the centers' edges since the rest.
    widths (A,): of the wisps, in samples.
    Each point keeps its displacement from its center, turned with it (Wang et al. 2009, sec. 6; eq. 6); then each
    strand gets its segment lengths back. amounts (S,): how much of the way each strand goes.
    """
    n_rows, n = centers.shape[0], centers.shape[1]
    frames = np.empty((n_rows, n, 4))
    for a in numba.prange(n_rows):
        _point_turns(turns[a], widths[a], frames[a])
    longest = 0
    for j in range(len(strands)):
        longest = max(longest, offsets[strands[j] + 1] - offsets[strands[j]])
    n_chunks = min(_CHUNKS, len(strands))
    for chunk in numba.prange(n_chunks):
        # working space once for many strands
        space, arcs = np.empty((4, longest, 3)), np.empty((2, longest))
        for j in range(chunk * len(strands) // n_chunks, (chunk + 1) * len(strands) // n_chunks):
            strand, a = strands[j], slots[j]
            first, count = offsets[strand], offsets[strand + 1] - offsets[strand]
            path, rest, result = space[0, :count], space[1, :count], space[2, :count]
            for i in range(count):
                for c in range(3):
                    rest[i, c] = rest_points[first + i, c]
            _lay_path(
                path, rest, places[first : first + count], rest_centers[a], centers[a], frames[a], amounts[strand]
            )
            walk(path, rest, result, space[3, :count], arcs, distance, origin, cell, margin)
            for i in range(1, count):
                for c in range(3):
                    points[first + i, c] = result[i, c]


@device
def _lay_path(path: Any, rest: Any, places: Any, rest_center: Any, center: Any, frames: Any, share: float) -> None:
    """path (n, 3): each point of `rest` (n, 3) with its displacement from its center, where the center is now."""
    last = center.shape[0] - 2
    turn = np.empty(4)
    for i in range(path.shape[0]):
        k = min(int(places[i]), last)
        t = places[i] - k
        total = 0.0
        for c in range(4):
            turn[c] = (1.0 - t) * frames[k, c] + t * frames[k + 1, c]
            total += turn[c] ** 2
        norm = 1.0 / sqrt(max(total, 1e-30))
        for c in range(4):
            turn[c] *= norm
        bx = (1.0 - t) * rest_center[k, 0] + t * rest_center[k + 1, 0]
        by = (1.0 - t) * rest_center[k, 1] + t * rest_center[k + 1, 1]
        bz = (1.0 - t) * rest_center[k, 2] + t * rest_center[k + 1, 2]
        dx, dy, dz = rotate(turn, rest[i, 0] - bx, rest[i, 1] - by, rest[i, 2] - bz)
        path[i, 0] = (1.0 - t) * center[k, 0] + t * center[k + 1, 0] + dx
        path[i, 1] = (1.0 - t) * center[k, 1] + t * center[k + 1, 1] + dy
        path[i, 2] = (1.0 - t) * center[k, 2] + t * center[k + 1, 2] + dz
        if share < 1.0:
            for c in range(3):
                path[i, c] = rest[i, c] + share * (path[i, c] - rest[i, c])
    path[0] = rest[0]


@parallel_kernel
def turn_on(turns: Float64, steps: Float64, rows: Int32) -> None:
    """turns[rows] (A, M, 4) become `steps` (n, M, 4) after what they were."""
    for a in numba.prange(len(rows)):
        for i in range(turns.shape[1]):
            product = multiply(steps[a, i], turns[rows[a], i])
            total = 0.0
            for c in range(4):
                total += product[c] * product[c]
            norm = sqrt(total)
            for c in range(4):
                turns[rows[a], i, c] = product[c] / norm


@parallel_kernel
def set_lengths(
    strands: Int32, offsets: Int32, rest_points: Float32, points: Float32, ratios: Float64,
    distance: Any, origin: Float64, cell: float, margin: float,
) -> None:  # fmt: skip
    """Points (P, 3) of the given strands (n,): the curve of `rest_points` cut or grown to ratios (S,) of its length.

    Beyond the tip the curve goes on as its own picture turned by half a turn about a normal of the tip, so that it goes
    on smoothly, in its main direction, and a helix as a helix. No point goes into the collider, or deeper into it.
    """
    for j in numba.prange(len(strands)):
        strand = strands[j]
        first, count = offsets[strand], offsets[strand + 1] - offsets[strand]
        if count < 2:
            continue
        curve = np.empty((count, 3))
        reached = np.empty(count)
        for i in range(count):
            for c in range(3):
                curve[i, c] = rest_points[first + i, c]
        arc_lengths(curve, reached)
        axis = np.empty(3)
        _tip_normal(curve, reached, axis)
        length = reached[count - 1]
        before, here, result = curve[0].copy(), np.empty(3), curve[0].copy()
        for i in range(1, count):
            arc = reached[i] * ratios[strand]
            _continued(curve, reached, arc, length, axis, here)
            square = 0.0
            for c in range(3):
                square += (here[c] - before[c]) ** 2
            start = result.copy()
            for c in range(3):
                result[c] += here[c] - before[c]
            if i > 1 and distance.size > 0 and square > 0.0:
                slide_out(result, start, curve[i], sqrt(square), distance, origin, cell, margin)
            before[:] = here
            for c in range(3):
                points[first + i, c] = result[c]


@device
def _tip_normal(curve: Any, reached: Any, axis: Any) -> None:
    """The unit axis of the half turn: across the main direction of the strand's outer half and of its last segment."""
    n = curve.shape[0]
    main, tangent = np.zeros(3), np.empty(3)
    middle = 0.75 * reached[n - 1]
    for i in range(1, n):
        if reached[i] >= 0.5 * reached[n - 1]:
            # the slope of the best line through it, so that curls weigh little
            weight = (reached[i] - middle) * (reached[i] - reached[i - 1])
            for c in range(3):
                main[c] += weight * (curve[i, c] - curve[n - 1, c])
    for c in range(3):
        tangent[c] = curve[n - 1, c] - curve[n - 2, c]
    least = 0
    total = 0.0
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        axis[c] = main[a] * tangent[b] - main[b] * tangent[a]
        total += axis[c] ** 2
        if abs(main[c]) < abs(main[least]):
            least = c
    size = sqrt((main[0] ** 2 + main[1] ** 2 + main[2] ** 2) * (tangent[0] ** 2 + tangent[1] ** 2 + tangent[2] ** 2))
    if sqrt(total) <= 1e-4 * size or size == 0.0:
        # a straight end: any normal will do
        square = max(main[0] ** 2 + main[1] ** 2 + main[2] ** 2, 1e-30)
        total = 0.0
        for c in range(3):
            axis[c] = (1.0 if c == least else 0.0) - main[least] * main[c] / square
            total += axis[c] ** 2
    norm = sqrt(total)
    for c in range(3):
        axis[c] /= norm


@device
def _continued(strand: Any, reached: Any, arc: float, length: float, axis: Any, out: Any) -> None:
    """The point at arc length `arc`, at most twice the length, of the strand or its continuation."""
    n = strand.shape[0]
    if arc <= length:
        _at_arc(strand, reached, arc, out)
        return
    _at_arc(strand, reached, max(2.0 * length - arc, 0.0), out)
    along = 0.0
    for c in range(3):
        out[c] -= strand[n - 1, c]
        along += out[c] * axis[c]
    for c in range(3):
        out[c] = strand[n - 1, c] + 2.0 * along * axis[c] - out[c]


@device
def _at_arc(strand: Any, reached: Any, arc: float, out: Any) -> None:
    i: int = min(max(int(np.searchsorted(reached, arc)), 1), len(reached) - 1)
    step = reached[i] - reached[i - 1]
    t = (arc - reached[i - 1]) / step if step > 0.0 else 0.0
    for c in range(3):
        out[c] = (1.0 - t) * strand[i - 1, c] + t * strand[i, c]
