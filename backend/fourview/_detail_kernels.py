"""Kernels of `detail`: waves that a strand shows in the plane of the picture, turned into helices (M-40).

A strand's work is its own, so results do not depend on the thread count.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ..kernels import device, parallel_kernel
from ..types import Float64, Floats, Int32, Int64


@device
def average_normals(normals: Float64, limit: float, segments: Int32, averages: Float64) -> int:
    """Cut a strand into segments whose normals keep within an angle to their average (Z-23); returns how many.

    normals (N, 3) unit; limit: its cosine. Filled: segments (N,), the segment of each point, and averages (N, 3), unit.
    """
    n_points = len(normals)
    total = np.zeros(3)
    first, count = 0, 0
    for i in range(n_points + 1):
        ends = i == n_points
        if not ends and i > first:
            size = math.sqrt(total[0] ** 2 + total[1] ** 2 + total[2] ** 2)
            dot = total[0] * normals[i, 0] + total[1] * normals[i, 1] + total[2] * normals[i, 2]
            ends = dot < limit * size
        if ends:
            size = max(math.sqrt(total[0] ** 2 + total[1] ** 2 + total[2] ** 2), 1e-12)
            for j in range(first, i):
                segments[j] = count
                for axis in range(3):
                    averages[j, axis] = total[axis] / size
            total[:] = 0.0
            first = i
            count += 1
        if i < n_points:
            for axis in range(3):
                total[axis] += normals[i, axis]
    return count


@device
def _centre_line(points: Floats, arcs: Float64, window: float, centre: Float64) -> None:
    """centre (N, 3): points averaged over a Gaussian in arc length; one-sided ends are straightened by mirroring."""
    n_points = len(points)
    sigma = 0.25 * window
    for i in range(n_points):
        # as far to one side as to the other, so that straight lines and evenly bent ones stay where they are
        reach = min(3.0 * sigma, min(arcs[i], arcs[n_points - 1] - arcs[i]) + 1e-12)
        total = 0.0
        for axis in range(3):
            centre[i, axis] = 0.0
        for j in range(n_points):
            apart = arcs[j] - arcs[i]
            if abs(apart) <= reach:
                width = 0.5 * (arcs[min(j + 1, n_points - 1)] - arcs[max(j - 1, 0)])
                weight = math.exp(-0.5 * (apart / sigma) ** 2) * width
                total += weight
                for axis in range(3):
                    centre[i, axis] += weight * points[j, axis]
        for axis in range(3):
            centre[i, axis] = centre[i, axis] / total if total > 0.0 else points[i, axis]


@device
def _lateral(points: Floats, centre: Float64, averages: Float64, lateral: Float64, along: Float64) -> None:
    """lateral (N,): offsets from the centre line, across it and the average normal; along (N,): rising places on it.

    A helix turns evenly along its axis, not along the arc of its picture: so a point's place is where it projects to.
    """
    n_points = len(points)
    axis_x, axis_y, axis_z = 1.0, 0.0, 0.0
    arc = 0.0
    for i in range(n_points):
        a, b = max(i - 1, 0), min(i + 1, n_points - 1)
        x, y, z = centre[b, 0] - centre[a, 0], centre[b, 1] - centre[a, 1], centre[b, 2] - centre[a, 2]
        nx, ny, nz = averages[i, 0], averages[i, 1], averages[i, 2]
        ux, uy, uz = ny * z - nz * y, nz * x - nx * z, nx * y - ny * x
        size = math.sqrt(ux * ux + uy * uy + uz * uz)
        if size > 1e-12:
            axis_x, axis_y, axis_z = ux / size, uy / size, uz / size
        lateral[i] = (
            (points[i, 0] - centre[i, 0]) * axis_x
            + (points[i, 1] - centre[i, 1]) * axis_y
            + (points[i, 2] - centre[i, 2]) * axis_z
        )
        if i > 0:
            step = 0.0
            for axis in range(3):
                step += (centre[i, axis] - centre[i - 1, axis]) ** 2
            arc += math.sqrt(step)
        size = max(math.sqrt(x * x + y * y + z * z), 1e-12)
        ahead = (
            (points[i, 0] - centre[i, 0]) * x + (points[i, 1] - centre[i, 1]) * y + (points[i, 2] - centre[i, 2]) * z
        )
        along[i] = arc + ahead / size
        if i > 0:
            along[i] = max(along[i], along[i - 1])


@device
def find_extrema(lateral: Float64, along: Float64, smallest: float, knots: Float64, heights: Float64) -> int:
    """Alternating extrema of lateral (N,) over along (N,), at least 2 `smallest` apart in height; returns how many.

    Filled: knots, where they lie along the line (at the top of the parabola through three points), and their heights.
    """
    count, candidate, rising = 0, 0, 0
    for i in range(1, len(lateral)):
        if rising >= 0 and lateral[i] > lateral[candidate]:
            if rising == 0 and lateral[i] - lateral[candidate] >= 2.0 * smallest:
                rising = 1
            if rising == 1:
                candidate = i
        elif rising <= 0 and lateral[i] < lateral[candidate]:
            if rising == 0 and lateral[candidate] - lateral[i] >= 2.0 * smallest:
                rising = -1
            if rising == -1:
                candidate = i
        elif rising != 0 and rising * (lateral[candidate] - lateral[i]) >= 2.0 * smallest:
            knots[count], heights[count] = _top(lateral, along, candidate)
            count += 1
            rising, candidate = -rising, i
    return count


@device
def _top(lateral: Float64, along: Float64, i: int) -> tuple[float, float]:
    if i == 0 or i == len(lateral) - 1:
        return along[i], lateral[i]
    x0, x2 = along[i - 1] - along[i], along[i + 1] - along[i]
    y0, y2 = lateral[i - 1] - lateral[i], lateral[i + 1] - lateral[i]
    if x0 >= 0.0 or x2 <= 0.0:
        return along[i], lateral[i]
    bend = (y2 / x2 - y0 / x0) / (x2 - x0)
    slope = y0 / x0 - bend * x0
    if abs(bend) < 1e-12:
        return along[i], lateral[i]
    shift = min(max(-0.5 * slope / bend, 0.5 * x0), 0.5 * x2)
    return along[i] + shift, lateral[i] + shift * (slope + bend * shift)


@device
def fit_half_turn(
    lateral: Float64, along: Float64, start: float, end: float, sign: float, low: float, high: float
) -> float:
    """Radius of the helix whose projection fits the half turn between two extrema best, by least squares (M-40).

    lateral = middle + sign r cos(pi (x - start) / (end - start)); low and high: the extrema, for too few points.
    """
    n, c, cc, y, cy = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(lateral)):
        if along[i] < start or along[i] > end:
            continue
        # places that project back onto one another can make a half turn of no length
        wave = sign * math.cos(math.pi * (along[i] - start) / max(end - start, 1e-12))
        n, c, cc, y, cy = n + 1.0, c + wave, cc + wave * wave, y + lateral[i], cy + wave * lateral[i]
    determinant = n * cc - c * c
    if n < 4.0 or determinant < 1e-3 * n * n:
        return 0.5 * (high - low)
    return max((n * cy - c * y) / determinant, 0.0)


@device
def _wind(
    lateral: Float64, along: Float64, knots: Float64, heights: Float64, count: int, hand: float, offsets: Float64
) -> None:
    """offsets (N,): r sin theta, out of the plane, theta running on evenly through every half turn."""
    radii = np.empty(count - 1)
    for k in range(count - 1):
        sign = 1.0 if heights[k] > heights[k + 1] else -1.0
        low, high = min(heights[k], heights[k + 1]), max(heights[k], heights[k + 1])
        radii[k] = fit_half_turn(lateral, along, knots[k], knots[k + 1], sign, low, high)
    start = 0.0 if heights[0] > heights[1] else math.pi
    piece = 0
    for i in range(len(lateral)):
        x = along[i]
        while piece < count - 2 and x > knots[piece + 1]:
            piece += 1
        share = (x - knots[piece]) / max(knots[piece + 1] - knots[piece], 1e-12)
        # radii run straight from the middle of a half turn to that of the next, or tangents would jump at the extrema
        other = min(max(piece + (1 if share > 0.5 else -1), 0), count - 2)
        mixed = abs(share - 0.5) if 0.0 <= share <= 1.0 else 0.5
        radius = (1.0 - mixed) * radii[piece] + mixed * radii[other]
        # before the first extremum and after the last it runs on for a quarter turn, and out
        beyond = max(max(-share, share - 1.0), 0.0)
        fade = max(1.0 - 2.0 * beyond, 0.0)
        offsets[i] = hand * fade * fade * (3.0 - 2.0 * fade) * radius * math.sin(start + math.pi * (piece + share))


@parallel_kernel
def wind_strands(
    points: Floats, offsets: Int32, normals: Float64, limit: float, window: float, smallest: float, hands: Float64,
    strength: float, out: Floats, segments: Int32, turns: Int64,
) -> None:  # fmt: skip
    """out (P, 3): strands, points (P, 3) and offsets (S + 1,), with the depth of the helices that their waves show.

    normals (P, 3), unit; hands (S,): +1 or -1. Filled too: segments (P,) and turns (S,), the half turns found.
    """
    for s in numba.prange(len(offsets) - 1):
        first, last = offsets[s], offsets[s + 1]
        n_points = last - first
        own = points[first:last]
        averages, centre = np.empty((n_points, 3)), np.empty((n_points, 3))
        arcs, along, lateral, depth = np.zeros(n_points), np.empty(n_points), np.empty(n_points), np.zeros(n_points)
        knots, heights = np.empty(n_points), np.empty(n_points)
        average_normals(normals[first:last], limit, segments[first:last], averages)
        for i in range(1, n_points):
            step = 0.0
            for axis in range(3):
                step += (own[i, axis] - own[i - 1, axis]) ** 2
            arcs[i] = arcs[i - 1] + math.sqrt(step)
        turns[s] = 0
        if n_points >= 5 and arcs[n_points - 1] > 0.0:
            _centre_line(own, arcs, window, centre)
            _lateral(own, centre, averages, lateral, along)
            count = find_extrema(lateral, along, smallest, knots, heights)
            if count >= 2:
                turns[s] = count - 1
                _wind(lateral, along, knots, heights, count, hands[s], depth)
        for i in range(n_points):
            for axis in range(3):
                out[first + i, axis] = own[i, axis] + strength * depth[i] * averages[i, axis]
        for axis in range(3):
            out[first, axis] = own[0, axis]
