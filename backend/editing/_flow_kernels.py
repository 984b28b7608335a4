"""Kernels of `flow`: hair in the frames of flow strands, and hair laid back along flow strands that moved.

All take the flow as `nodes` (K, F, 3) float64, F points of equal arc length a flow strand, `frames` (K, F, 3, 3)
float64 with columns normal, binormal, tangent, and `lengths` (K,) float64, metres. A strand's work is its own, so
results do not depend on the thread count.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

import numba
import numpy as np

from ..kernels import device, inlined_device, parallel_kernel

_N_TRIED = 16  # points of a strand that are looked at when its reach along the flow is chosen
_LENGTH_SHARE = 1e-4  # a segment may differ from its length by this share, so that hair that did not move stays
_LENGTH_ROUNDING = 1e-8  # and by this many metres, what float32 leaves of positions near the origin


@inlined_device
def _node_before(place: float, length: float, n_nodes: int) -> tuple[int, float]:
    """The node before `place` (metres along the flow strand), and how far to the next one it lies (0 .. 1)."""
    if length <= 0.0:
        return 0, 0.0
    at = min(max(place / length, 0.0), 1.0) * (n_nodes - 1)
    node = min(int(at), n_nodes - 2)
    return node, at - node


@device
def _set_center(nodes: Any, frames: Any, length: float, place: float, center: Any) -> None:
    """The point of the flow strand at `place`; beyond its tip the strand goes straight on."""
    node, share = _node_before(place, length, nodes.shape[0])
    beyond = max(place - length, 0.0)
    for c in range(3):
        center[c] = nodes[node, c] + share * (nodes[node + 1, c] - nodes[node, c])
        center[c] += beyond * frames[nodes.shape[0] - 1, c, 2]


@device
def _set_frame(frames: Any, length: float, place: float, frame: Any) -> None:
    """The frame at `place`, between those of the nodes around it; its columns are orthonormal."""
    node, share = _node_before(place, length, frames.shape[0])
    tangent_square, along, normal_square = 0.0, 0.0, 0.0
    for c in range(3):
        frame[c, 2] = frames[node, c, 2] + share * (frames[node + 1, c, 2] - frames[node, c, 2])
        frame[c, 0] = frames[node, c, 0] + share * (frames[node + 1, c, 0] - frames[node, c, 0])
        tangent_square += frame[c, 2] ** 2
        along += frame[c, 0] * frame[c, 2]
    if tangent_square < 1e-12:
        # the flow turns back on itself between the two nodes: there is nothing between their frames
        for c in range(3):
            for column in range(3):
                frame[c, column] = frames[node, c, column]
        return
    for c in range(3):
        frame[c, 0] -= along / tangent_square * frame[c, 2]
        normal_square += frame[c, 0] ** 2
    for c in range(3):
        frame[c, 2] /= sqrt(tangent_square)
        frame[c, 0] /= sqrt(normal_square)
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        frame[c, 1] = frame[a, 2] * frame[b, 0] - frame[b, 2] * frame[a, 0]


@device
def _set_arc_shares(points: Any, shares: Any) -> float:
    """Fill `shares` with how far along its strand each point lies, 0 .. 1; returns the strand's length."""
    shares[0] = 0.0
    for i in range(1, len(points)):
        square = 0.0
        for c in range(3):
            square += float(np.float64(points[i, c]) - np.float64(points[i - 1, c])) ** 2
        shares[i] = shares[i - 1] + sqrt(square)
    total = shares[len(points) - 1]
    if total > 0.0:
        for i in range(len(points)):
            shares[i] /= total
    return float(total)


@device
def _misfit(tried: Any, nodes: Any, frames: Any, length: float, reach: float, center: Any) -> float:
    """Sum of squared distances of evenly spaced points of a strand from the flow strand run through to `reach`."""
    misfit = 0.0
    for k in range(1, len(tried)):
        _set_center(nodes, frames, length, reach * length * k / (len(tried) - 1), center)
        for c in range(3):
            misfit += (tried[k, c] - center[c]) ** 2
    return misfit


@device
def _best_reach(points: Any, shares: Any, nodes: Any, frames: Any, length: float) -> float:
    """Where along the flow strand (share of its length, 1/8 .. 2) the tip belongs: the closest fit of the whole."""
    tried, center = np.empty((_N_TRIED, 3)), np.empty(3)
    segment = 0
    for k in range(_N_TRIED):
        at = k / (_N_TRIED - 1)
        while segment < len(points) - 2 and shares[segment + 1] < at:
            segment += 1
        width = shares[segment + 1] - shares[segment]
        share = min(max((at - shares[segment]) / width, 0.0), 1.0) if width > 0.0 else 0.0
        for c in range(3):
            tried[k, c] = points[segment, c] + share * (points[segment + 1, c] - points[segment, c])
    best, least = 1.0, _misfit(tried, nodes, frames, length, 1.0, center)
    for step in range(1, 17):
        misfit = _misfit(tried, nodes, frames, length, step / 8.0, center)
        if misfit < least:
            best, least = step / 8.0, misfit
    middle = best
    for step in range(-3, 4):
        reach = middle + step / 32.0
        misfit = _misfit(tried, nodes, frames, length, reach, center)
        if misfit < least:
            best, least = reach, misfit
    return best


@parallel_kernel
def place_strands(
    points: Any, offsets: Any, flow_of: Any, nodes: Any, frames: Any, lengths: Any, places: Any, distances: Any
) -> None:
    """Fill places (P,) f32, metres along the flow strand, and distances (P,) f64 from the flow there, metres."""
    for strand in numba.prange(len(offsets) - 1):
        first, last = offsets[strand], offsets[strand + 1]
        k = flow_of[strand]
        own, shares, center = points[first:last], np.zeros(last - first), np.empty(3)
        total = _set_arc_shares(own, shares)
        reach = 1.0
        if total > 0.0 and lengths[k] > 0.0:
            reach = _best_reach(own, shares, nodes[k], frames[k], lengths[k])
        for i in range(last - first):
            places[first + i] = shares[i] * reach * lengths[k]
            _set_center(nodes[k], frames[k], lengths[k], places[first + i], center)
            square = 0.0
            for c in range(3):
                square += (own[i, c] - center[c]) ** 2
            distances[first + i] = sqrt(square)


@parallel_kernel
def bind_points(
    points: Any, offsets: Any, flow_of: Any, nodes: Any, frames: Any, lengths: Any, places: Any, local: Any, steps: Any
) -> None:
    """Fill local (P, 3) f32, M(t)^T (p - c(t)), and steps (P,) f32, the length of the segment before each point."""
    for strand in numba.prange(len(offsets) - 1):
        center, frame = np.empty(3), np.empty((3, 3))
        k = flow_of[strand]
        for i in range(offsets[strand], offsets[strand + 1]):
            _set_center(nodes[k], frames[k], lengths[k], places[i], center)
            _set_frame(frames[k], lengths[k], places[i], frame)
            for column in range(3):
                value = 0.0
                for c in range(3):
                    value += frame[c, column] * (points[i, c] - center[c])
                local[i, column] = value
            square = 0.0
            if i > offsets[strand]:
                for c in range(3):
                    square += float(np.float64(points[i, c]) - np.float64(points[i - 1, c])) ** 2
            steps[i] = sqrt(square)


@device
def _leave_sphere(start: Any, direction: Any, center: Any, radius: float) -> float:
    """u >= 0 where start + u * direction, start in the sphere around `center`, leaves it; -1 without direction."""
    a, b, c = 0.0, 0.0, -radius * radius
    for k in range(3):
        a += direction[k] ** 2
        b += direction[k] * (start[k] - center[k])
        c += (start[k] - center[k]) ** 2
    if a == 0.0:
        return -1.0
    return float((sqrt(max(b * b - a * c, 0.0)) - b) / a)


@device
def _walk(path: Any, steps: Any, scale: float, tip_direction: Any, out: Any) -> None:
    """Fill out (n, 3) with points on the polyline `path` (n, 3), each `steps[i] * scale` from the one before it.

    As with dividers: the next point is where the path, going forward, first is that far away. Beyond its tip the path
    goes on straight. A vertex that is as far away to a rounding is taken as it is.
    """
    n_points = len(path)
    here, cursor, direction = np.empty(3), np.empty(3), np.empty(3)
    for c in range(3):
        here[c] = cursor[c] = path[0, c]
        out[0, c] = path[0, c]
    vertex = 1
    for i in range(1, n_points):
        radius = steps[i] * scale
        slack = _LENGTH_SHARE * radius + _LENGTH_ROUNDING
        is_found = radius == 0.0
        while not is_found and vertex < n_points:
            square = 0.0
            for c in range(3):
                direction[c] = path[vertex, c] - cursor[c]
                square += (path[vertex, c] - here[c]) ** 2
            far = sqrt(square) - radius
            if far < -slack:
                for c in range(3):
                    cursor[c] = path[vertex, c]
                vertex += 1
            else:
                u = 1.0 if far <= slack else _leave_sphere(cursor, direction, here, radius)
                for c in range(3):
                    cursor[c] = path[vertex, c] if u == 1.0 else cursor[c] + u * direction[c]
                vertex += far <= slack
                is_found = True
        if not is_found:
            u = _leave_sphere(cursor, tip_direction, here, radius)
            for c in range(3):
                cursor[c] += u * tip_direction[c]
        for c in range(3):
            here[c] = here[c] if radius == 0.0 else cursor[c]
            out[i, c] = here[c]


@parallel_kernel
def lay_strands(
    chosen: Any, offsets: Any, flow_of: Any, nodes: Any, frames: Any, lengths: Any, root_frames: Any, growth: Any,
    places: Any, local: Any, steps: Any, out: Any,
) -> None:  # fmt: skip
    """Fill out (P, 3) f32 for the `chosen` strands: along the flow as it is now, in their own segment lengths.

    root_frames (K, 3, 3) f64 turn with the flow as a whole and not with its bending: roots keep to them. What a
    bend moves the root away from there is taken off the points near the root, fading out within four times the root's
    distance from the flow strand. growth (K,) f64 scales places and lengths.
    """
    for index in numba.prange(len(chosen)):
        strand = chosen[index]
        k = flow_of[strand]
        first, last = offsets[strand], offsets[strand + 1]
        path, center, frame, shift = np.empty((last - first, 3)), np.empty(3), np.empty((3, 3)), np.zeros(3)
        fade, square = 0.0, 0.0
        for c in range(3):
            fade += float(local[first, c]) ** 2
            for column in range(3):
                shift[c] += (root_frames[k, c, column] - frames[k, 0, c, column]) * local[first, column]
        fade = 4.0 * sqrt(fade)
        for i in range(last - first):
            place = places[first + i] * growth[k]
            _set_center(nodes[k], frames[k], lengths[k], place, center)
            _set_frame(frames[k], lengths[k], place, frame)
            rest = 1.0 - place / fade if fade > 0.0 else 0.0
            weight = rest * rest * (3.0 - 2.0 * rest) if rest > 0.0 else 0.0
            for c in range(3):
                path[i, c] = center[c] + weight * shift[c]
                for column in range(3):
                    path[i, c] += frame[c, column] * local[first + i, column]
        # straight on beyond the tip: along the path's last segment that has a length
        tip_direction = frames[k, frames.shape[1] - 1, :, 2].copy()
        for i in range(last - first - 1, 0, -1):
            square = 0.0
            for c in range(3):
                square += (path[i, c] - path[i - 1, c]) ** 2
            if square > 0.0:
                for c in range(3):
                    tip_direction[c] = (path[i, c] - path[i - 1, c]) / sqrt(square)
                break
        laid = np.empty((last - first, 3))
        _walk(path, steps[first:last], growth[k], tip_direction, laid)
        for i in range(last - first):
            for c in range(3):
                out[first + i, c] = laid[i, c]


@parallel_kernel
def measure_marks(points: Any, offsets: Any, reaches: Any, headings: Any) -> None:
    """Fill reaches (S,) f32, the sum of the points' distances from the root, and headings (S, 3) f32, of the vectors.

    The headings are divided by the reaches.
    """
    for strand in numba.prange(len(offsets) - 1):
        first, reach, heading = offsets[strand], 0.0, np.zeros(3)
        for i in range(first, offsets[strand + 1]):
            square = 0.0
            for c in range(3):
                step = float(points[i, c]) - float(points[first, c])
                heading[c] += step
                square += step * step
            reach += sqrt(square)
        reaches[strand] = reach
        for c in range(3):
            headings[strand, c] = heading[c] / reach if reach > 0.0 else 0.0
