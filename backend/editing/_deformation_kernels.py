"""Compiled loops of gradient-domain deformation (M-7). Strands (A, N, 3) float64; rotations: quaternions of edges."""

from __future__ import annotations

from math import cos, sin, sqrt
from typing import Any

import numba
import numpy as np

from ..geometry._collider_kernels import sample_distance, sample_gradient
from ..kernels import device, parallel_kernel
from ..types import Float64, Int32
from ._rotation_kernels import multiply, rotate, turn_between

_DIRECTIONS = 512  # tried by `_escape`
_GOLDEN_ANGLE = 2.399963229728653
_JUST_INSIDE = 0.002  # metres
_WINDOWS = 6  # of the strand's length, over which its lengthening is measured
_STEER = 0.1  # of the way back to the path, in each step
FREE_WEIGHT = 1e-3  # trust in the direction of an edge that nothing pulls at


# called, not inlined: the loops below ask at a dozen places, and compile three times as fast so
@device
def _distance_at(distance: Any, origin: Any, cell: float, x: float, y: float, z: float) -> Any:
    return sample_distance(distance, origin, cell, x, y, z)


@device
def _gradient_at(distance: Any, origin: Any, cell: float, x: float, y: float, z: float) -> Any:
    return sample_gradient(distance, origin, cell, x, y, z)


@device
def _limit(before: float, margin: float) -> float:
    """How far outside a point must stay that was `before` outside: as far, the margin at most; 0 if it was just inside.

    Only hair that was well inside may stay there: the grid is a little wrong where the head has folds.
    """
    if before < -_JUST_INSIDE:
        return before
    return min(margin, max(before, 0.0))


@device
def _solve_points(points: Any, turns: Any, edges: Any, targets: Any, weights: Any, upper: Any) -> None:
    """Step (a): the points 2 .. N - 1 that best have the turned edges and the handles; Thomas' algorithm."""
    n = points.shape[0]
    for i in range(2, n):
        before = rotate(turns[i - 1], edges[i - 1, 0], edges[i - 1, 1], edges[i - 1, 2])
        diagonal = 1.0 + weights[i]
        x, y, z = before[0], before[1], before[2]
        if i < n - 1:
            after = rotate(turns[i], edges[i, 0], edges[i, 1], edges[i, 2])
            diagonal += 1.0
            x -= after[0]
            y -= after[1]
            z -= after[2]
        x += weights[i] * targets[i, 0] + points[i - 1, 0]
        y += weights[i] * targets[i, 1] + points[i - 1, 1]
        z += weights[i] * targets[i, 2] + points[i - 1, 2]
        # points[i - 1] is the forward-eliminated row above (for i = 2 the fixed point 1), whose entry here is -1
        if i > 2:
            diagonal -= upper[i - 1]
        upper[i] = 1.0 / diagonal
        points[i, 0], points[i, 1], points[i, 2] = x / diagonal, y / diagonal, z / diagonal
    for i in range(n - 2, 1, -1):
        for c in range(3):
            points[i, c] += upper[i] * points[i + 1, c]


@device
def _solve_turns(
    points: Any, edges: Any, old: Any, new: Any, last_pull: int, stiffness: float, extra: Any, extra_weight: float
) -> None:
    """Step (b): rotations that follow the edges, change little along the strand, and agree with `extra` (M, 4) sums."""
    m = edges.shape[0]
    upper = np.empty(m)
    for i in range(1, m):
        turned = rotate(old[i], edges[i, 0], edges[i, 1], edges[i, 2])
        dx, dy, dz = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1], points[i + 1, 2] - points[i, 2]
        wanted = multiply(turn_between(turned[0], turned[1], turned[2], dx, dy, dz), old[i])
        weight = 1.0 if i < last_pull else FREE_WEIGHT
        diagonal = weight + stiffness + extra_weight
        if i < m - 1:
            diagonal += stiffness
        # the row above is eliminated already; edge 0 is fixed, so it enters as it is
        factor = stiffness
        if i > 1:
            diagonal -= stiffness * upper[i - 1]
        upper[i] = stiffness / diagonal
        for c in range(4):
            new[i, c] = (weight * wanted[c] + extra[i, c] + factor * new[i - 1, c]) / diagonal
    for i in range(m - 2, 0, -1):
        for c in range(4):
            new[i, c] += upper[i] * new[i + 1, c]
    for i in range(1, m):
        norm = sqrt(new[i, 0] ** 2 + new[i, 1] ** 2 + new[i, 2] ** 2 + new[i, 3] ** 2)
        if norm > 1e-12:
            for c in range(4):
                new[i, c] /= norm
        else:
            new[i] = old[i]


@device
def _push_out(points: Any, rest: Any, distance: Any, origin: Any, cell: float, margin: float) -> None:
    """Move points out of the collider; where the rest was inside it may stay as deep."""
    for i in range(2, points.shape[0]):
        now = _distance_at(distance, origin, cell, points[i, 0], points[i, 1], points[i, 2])
        if now >= margin:
            continue
        limit = _limit(_distance_at(distance, origin, cell, rest[i, 0], rest[i, 1], rest[i, 2]), margin)
        if now >= limit:
            continue
        gx, gy, gz = _gradient_at(distance, origin, cell, points[i, 0], points[i, 1], points[i, 2])
        norm = sqrt(gx * gx + gy * gy + gz * gz)
        if norm > 1e-6:
            points[i, 0] += gx / norm * (limit - now)
            points[i, 1] += gy / norm * (limit - now)
            points[i, 2] += gz / norm * (limit - now)


@device
def _listen(a: int, beside: Any, slots: Any, old: Any, pulls: Any, coupling: float, hold: float, extra: Any) -> float:
    """Add up the rotations of the neighbours that strand a listens to; returns their weight."""
    total = 0.0
    for j in range(len(beside)):
        b = slots[beside[j]]
        if pulls[a] > 0 and (b < 0 or pulls[b] == 0):
            continue
        total += coupling
        for i in range(1, extra.shape[0]):
            if b < 0:
                extra[i, 0] += coupling
                continue
            dot = 0.0
            for c in range(4):
                dot += old[a, i, c] * old[b, i, c]
            sign = coupling if dot >= 0.0 else -coupling
            for c in range(4):
                extra[i, c] += sign * old[b, i, c]
    if pulls[a] > 0:
        return total
    for i in range(1, extra.shape[0]):
        extra[i, 0] += hold * total
    return total * (1.0 + hold)


@parallel_kernel
def relax(
    points: Float64,
    rest: Float64,
    edges: Float64,
    targets: Float64,
    weights: Float64,
    pulls: Int32,
    old: Float64,
    new: Float64,
    active: Int32,
    slots: Int32,
    offsets: Int32,
    neighbours: Int32,
    stiffness: float,
    coupling: float,
    hold: float,
    distance: Any,
    origin: Float64,
    cell: float,
    margin: float,
) -> None:
    """One alternation for A strands: points (A, N, 3) from rotations `old` (A, N - 1, 4), then `new` from the points.

    pulls (A,): the last sample of each strand with a handle, 0 for none.
    active (A,) are the strands' numbers in the graph, slots its inverse (-1: not active). Strands with handles listen
    to neighbours with handles only, others to all, and are held back to no rotation by `hold`.
    """
    n = points.shape[1]
    for a in numba.prange(points.shape[0]):
        last_pull = pulls[a]
        _solve_points(points[a], old[a], edges[a], targets[a], weights[a], np.empty(n))
        if distance.size > 0:
            _push_out(points[a], rest[a], distance, origin, cell, margin)
        extra = np.zeros((n - 1, 4))
        extra_weight = 0.0
        if coupling > 0.0:
            beside = neighbours[offsets[active[a]] : offsets[active[a] + 1]]
            extra_weight = _listen(a, beside, slots, old, pulls, coupling, hold, extra)
        new[a, 0] = old[a, 0]
        _solve_turns(points[a], edges[a], old[a], new[a], last_pull, stiffness, extra, extra_weight)


@device
def arc_lengths(points: Any, reached: Any) -> None:
    """reached (n,): arc lengths of the points of a polyline (n, 3)."""
    reached[0] = 0.0
    for i in range(1, points.shape[0]):
        square = 0.0
        for c in range(3):
            square += (points[i, c] - points[i - 1, c]) ** 2
        reached[i] = reached[i - 1] + sqrt(square)


@device
def _slide_along(path: Any, rest: Any, slid: Any, now: Any, before: Any) -> None:
    """`slid` (n, 3): the path (n, 3), each point slid along it by as much as the path is longer or shorter than `rest`.

    How much longer is measured over a sixth of the strand, so that curls slide as a whole and are not left out. Where
    the path ends too early the strand goes on in its own shape.
    """
    n = path.shape[0]
    arc_lengths(path, now)
    arc_lengths(rest, before)
    half = max(1, (n - 1) // _WINDOWS // 2)
    place = 0.0
    end = -1
    turn = np.empty(4)
    slid[0] = path[0]
    for i in range(1, n):
        if end < 0:
            # `place` is on the path here: beyond its end it may be anywhere, and so would be what it is read from
            low, high = max(int(place) - half, 0), min(int(place) + 1 + half, n - 1)
            longer = now[high] - now[low]
            place += (before[high] - before[low]) / longer if longer > 0.0 else 1.0
        if place > n - 1 + 1e-9 and end < 0:
            end = i - 1
            last, here = path[n - 1] - path[n - 2], path[max(end, 1)] - path[max(end, 1) - 1]
            turn[0], turn[1], turn[2], turn[3] = turn_between(here[0], here[1], here[2], last[0], last[1], last[2])
        if end >= 0:
            edge = path[i] - path[i - 1]
            x, y, z = rotate(turn, edge[0], edge[1], edge[2])
            slid[i, 0], slid[i, 1], slid[i, 2] = slid[i - 1, 0] + x, slid[i - 1, 1] + y, slid[i - 1, 2] + z
        else:
            k = min(int(place), n - 2)
            t = place - k
            for c in range(3):
                slid[i, c] = path[k, c] + t * (path[k + 1, c] - path[k, c])


@device
def _step_towards(x: Any, aim: Any, fallback: Any, length: float, out: Any) -> None:
    """The point at distance `length` from x in the direction of `aim`, or of the vector `fallback` if that is x."""
    dx, dy, dz = aim[0] - x[0], aim[1] - x[1], aim[2] - x[2]
    norm = sqrt(dx * dx + dy * dy + dz * dz)
    if norm < 1e-12:
        dx, dy, dz = fallback[0], fallback[1], fallback[2]
        norm = sqrt(dx * dx + dy * dy + dz * dz)
        if norm < 1e-12:
            dx, norm = 1.0, 1.0
    out[0], out[1], out[2] = x[0] + length * dx / norm, x[1] + length * dy / norm, x[2] + length * dz / norm


@device
def walk(
    path: Any, rest: Any, out: Any, slid: Any, arcs: Any, distance: Any, origin: Any, cell: float, margin: float
) -> None:
    """A strand on `path` (n, 3) with the segment lengths of `rest` (n, 3) and outside the collider.

    The strand slides along its path (`_slide_along`); each edge then gets its length in its own direction, led back to
    the path a little. A point pushed out of the collider turns about the one before it, so that lengths stay.
    slid (n, 3) and arcs (2, n or more) are working space.
    """
    n = path.shape[0]
    _slide_along(path, rest, slid, arcs[0], arcs[1])
    out[0] = path[0]
    aim = np.empty(3)
    fallback = path[n - 1] - path[n - 2]
    free = 0.0  # way that is known to be free
    for i in range(1, n):
        x = out[i - 1]
        square = 0.0
        for c in range(3):
            square += (rest[i, c] - rest[i - 1, c]) ** 2
            aim[c] = x[c] + slid[i, c] - slid[i - 1, c] + _STEER * (slid[i - 1, c] - x[c])
        if square == 0.0:
            out[i] = x
            continue
        length = sqrt(square)
        _step_towards(x, aim, fallback, length, out[i])
        if distance.size > 0:
            free -= length
            if free < 0.0:
                now = _distance_at(distance, origin, cell, out[i, 0], out[i, 1], out[i, 2])
                # half of the way to the surface, as the distance is less exact far from it; beyond the grid, nothing
                free = 0.5 * (now - margin) if margin <= now < 1.0 else 0.0
                if now < margin:
                    _keep_out(out, i, rest, length, fallback, distance, origin, cell, margin)


@device
def _keep_out(
    out: Any, i: int, rest: Any, length: float, fallback: Any, distance: Any, origin: Any, cell: float, margin: float
) -> None:
    """Turn point i of a strand out of the collider, about the point before it."""
    x = out[i - 1]
    slide_out(out[i], x, rest[i], length, distance, origin, cell, margin)
    if i > 1 and _turns_back(out[i - 2], x, out[i]) and not _turns_back(rest[i - 2], rest[i - 1], rest[i]):
        # a path that runs inside the head leads into pockets: rather go on over the surface
        _step_towards(x, x + x - out[i - 2], fallback, length, out[i])
        slide_out(out[i], x, rest[i], length, distance, origin, cell, margin)


@device
def _turns_back(a: Any, b: Any, c: Any) -> bool:
    """Is the corner a, b, c sharper than 60 degrees?"""
    dot = before = after = 0.0
    for k in range(3):
        dot += (b[k] - a[k]) * (c[k] - b[k])
        before += (b[k] - a[k]) ** 2
        after += (c[k] - b[k]) ** 2
    return bool(dot < -0.5 * sqrt(before * after))


@device
def slide_out(y: Any, x: Any, rest: Any, length: float, distance: Any, origin: Any, cell: float, margin: float) -> None:
    """Turn y about x until it is outside the collider (or as deep as `rest` was)."""
    if _distance_at(distance, origin, cell, y[0], y[1], y[2]) >= margin:
        return
    limit = _limit(_distance_at(distance, origin, cell, rest[0], rest[1], rest[2]), margin) - 1e-6
    if _slide(y, x, length, distance, origin, cell, limit):
        return
    if not _escape(y, x, length, distance, origin, cell, limit):
        _slide(y, x, length, distance, origin, cell, limit)


@device
def _slide(y: Any, x: Any, length: float, distance: Any, origin: Any, cell: float, limit: float) -> bool:
    """Turn y about x along the gradient of the distance; is it free then?"""
    for _ in range(8):
        now = _distance_at(distance, origin, cell, y[0], y[1], y[2])
        if now >= limit:
            return True
        gx, gy, gz = _gradient_at(distance, origin, cell, y[0], y[1], y[2])
        norm = sqrt(gx * gx + gy * gy + gz * gz)
        if norm < 1e-6:
            return False
        # further than the surface: turning back to the length takes some of it again
        push = (1.2 * (limit - now) + 1e-5) / norm
        aim = np.array((y[0] + gx * push, y[1] + gy * push, y[2] + gz * push))
        _step_towards(x, aim, np.array((gx, gy, gz)), length, y)
    return bool(_distance_at(distance, origin, cell, y[0], y[1], y[2]) >= limit)


@device
def _escape(y: Any, x: Any, length: float, distance: Any, origin: Any, cell: float, limit: float) -> bool:
    """Turn y about x to the nearest of many directions that is free; in a fold of the surface gradients go to and fro.

    If none is free, the one that is least deep. Returns whether one is.
    """
    ux, uy, uz = (y[0] - x[0]) / length, (y[1] - x[1]) / length, (y[2] - x[2]) / length
    best, nearest, deepest = np.empty(3), -2.0, -np.inf
    for i in range(_DIRECTIONS):
        # a spiral over the sphere: even, and the same on every machine
        h = 1.0 - (2.0 * i + 1.0) / _DIRECTIONS
        r, angle = sqrt(1.0 - h * h), i * _GOLDEN_ANGLE
        vx, vy, vz = r * cos(angle), r * sin(angle), h
        here = _distance_at(distance, origin, cell, x[0] + length * vx, x[1] + length * vy, x[2] + length * vz)
        turn = ux * vx + uy * vy + uz * vz
        is_better = turn > nearest if here >= limit else nearest == -2.0 and here > deepest
        if is_better:
            best[0], best[1], best[2] = vx, vy, vz
            if here >= limit:
                nearest = turn
            deepest = here
    for c in range(3):
        y[c] = x[c] + length * best[c]
    return nearest > -2.0


@parallel_kernel
def settle(
    points: Float64, rest: Float64, edges: Float64, turns: Float64,
    distance: Any, origin: Float64, cell: float, margin: float,
) -> None:  # fmt: skip
    """Give strands (A, N, 3) back their lengths (`edges`) in place, and turn `turns` (A, N - 1, 4) to the new edges.

    Each edge keeps its direction, so that the strand keeps its own curls; a contact slides along it by what that takes.
    """
    n = points.shape[1]
    for a in numba.prange(points.shape[0]):
        before = points[a, 1].copy()
        for i in range(2, n):
            here = points[a, i].copy()
            lx, ly, lz = edges[a, i - 1, 0], edges[a, i - 1, 1], edges[a, i - 1, 2]
            length = sqrt(lx * lx + ly * ly + lz * lz)
            start = points[a, i - 1]
            _step_towards(start, start + here - before, edges[a, i - 1], length, points[a, i])
            if distance.size > 0 and length > 0.0:
                slide_out(points[a, i], start, rest[a, i], length, distance, origin, cell, margin)
            before = here
        for i in range(1, n - 1):
            turned = rotate(turns[a, i], edges[a, i, 0], edges[a, i, 1], edges[a, i, 2])
            turn = turn_between(
                turned[0], turned[1], turned[2],
                points[a, i + 1, 0] - points[a, i, 0],
                points[a, i + 1, 1] - points[a, i, 1],
                points[a, i + 1, 2] - points[a, i, 2],
            )  # fmt: skip
            result = multiply(turn, turns[a, i])
            for c in range(4):
                turns[a, i, c] = result[c]
