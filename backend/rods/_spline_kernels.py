"""Numba helpers of `fitting`: a strand's cubic C1 Bezier spline by least squares, its arc length and its cuts.

The spline is kept in Hermite form, which a C1 Bezier spline is: knots t (K + 1,), metres of the polyline, and nodes
(2K + 2, 3), position and derivative at each knot; the inner control points are position +- derivative * (t step) / 3.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

from ..kernels import device

# Points nearer than this share of the strand's length count as one; float32 coordinates give them no direction.
_MERGE_SHARE = 1e-5
# Strands shorter than this (metres) have no shape in float32.
_SHORTEST = 1e-6
# Weight of a segment's bending energy (times its length cubed) against one sample's squared distance: decides only what
# the samples leave open.
_SMOOTHING = 1e-5
# Weight of its squared third derivative (times its length to the sixth power). Without it the tangents at the knots, on
# which floating tangents build, swing; it leaves parabolas, and nearly arcs, as they are.
_STEADINESS = 4e-4


@device
def merge_points(points: Any, first: int, end: int, merged: Any, chords: Any) -> int:
    """Points first..end without coincident ones into merged (m, 3), their polyline's length so far into chords (m,).

    Returns m; 1 for a strand without length.
    """
    total = 0.0
    for p in range(first + 1, end):
        square = 0.0
        for c in range(3):
            square += (float(points[p, c]) - float(points[p - 1, c])) ** 2
        total += sqrt(square)
    for c in range(3):
        merged[0, c] = points[first, c]
    chords[0] = 0.0
    if total < _SHORTEST:
        return 1
    limit, count = total * _MERGE_SHARE, 1
    for p in range(first + 1, end):
        square = 0.0
        for c in range(3):
            square += (float(points[p, c]) - merged[count - 1, c]) ** 2
        length = sqrt(square)
        if length > limit:
            for c in range(3):
                merged[count, c] = points[p, c]
            chords[count] = chords[count - 1] + length
            count += 1
    return count


@device
def _add_segment(
    merged: Any, chords: Any, first: int, end: int, start: float, step: float, row: int, band: Any, nodes: Any
) -> None:
    """Normal equations of the samples first..end in the segment [start, start + step], into rows row..row + 3."""
    inverse = 1.0 / step
    for p in range(first, end):
        u = (chords[p] - start) * inverse
        v = 1.0 - u
        w0, w1 = v * v * (1.0 + 2.0 * u), step * u * v * v
        w2, w3 = u * u * (1.0 + 2.0 * v), -step * u * u * v
        band[row, 3] += w0 * w0
        band[row + 1, 2] += w1 * w0
        band[row + 1, 3] += w1 * w1
        band[row + 2, 1] += w2 * w0
        band[row + 2, 2] += w2 * w1
        band[row + 2, 3] += w2 * w2
        band[row + 3, 0] += w3 * w0
        band[row + 3, 1] += w3 * w1
        band[row + 3, 2] += w3 * w2
        band[row + 3, 3] += w3 * w3
        for c in range(3):
            x = merged[p, c]
            nodes[row, c] += w0 * x
            nodes[row + 1, c] += w1 * x
            nodes[row + 2, c] += w2 * x
            nodes[row + 3, c] += w3 * x
    # the third derivative is that of (12, 6 step, -12, 6 step) on the four unknowns
    g, e = 144.0 * _STEADINESS, 36.0 * step * step * _STEADINESS
    f = 72.0 * step * _STEADINESS
    a, b, d = 12.0 * _SMOOTHING, 6.0 * step * _SMOOTHING, step * step * _SMOOTHING
    band[row, 3] += a + g
    band[row + 1, 2] += b + f
    band[row + 1, 3] += 4.0 * d + e
    band[row + 2, 1] -= a + g
    band[row + 2, 2] -= b + f
    band[row + 2, 3] += a + g
    band[row + 3, 0] += b + f
    band[row + 3, 1] += 2.0 * d + e
    band[row + 3, 2] -= b + f
    band[row + 3, 3] += 4.0 * d + e


@device
def fit_spline(
    merged: Any, chords: Any, n_points: int, samples_per_segment: int, knots: Any, nodes: Any, band: Any
) -> int:
    """Least-squares spline through n_points >= 2 samples, the root held exactly (B-17); returns the segments K."""
    n_segments = max(1, (n_points - 1 + samples_per_segment // 2) // samples_per_segment)
    size = 2 * n_segments + 2
    for i in range(size):
        for j in range(4):
            band[i, j] = 0.0
        for c in range(3):
            nodes[i, c] = 0.0
    knots[0] = 0.0
    first = 0
    for k in range(n_segments):
        end = (k + 1) * (n_points - 1) // n_segments
        knots[k + 1] = chords[end]
        last = n_points if k == n_segments - 1 else end
        _add_segment(merged, chords, first, last, knots[k], knots[k + 1] - knots[k], 2 * k, band, nodes)
        first = end
    for i in range(1, 4):
        for c in range(3):
            nodes[i, c] -= band[i, 3 - i] * merged[0, c]
        band[i, 3 - i] = 0.0
    band[0, 3] = 1.0
    for c in range(3):
        nodes[0, c] = merged[0, c]
    _solve_band(band, nodes, size)
    return n_segments


@device
def _solve_band(band: Any, nodes: Any, size: int) -> None:
    """Cholesky of the symmetric band matrix, band[i, j] = A[i, i - 3 + j], in place, and solution into nodes."""
    for i in range(size):
        for j in range(max(0, i - 3), i + 1):
            value = band[i, 3 - i + j]
            for k in range(max(0, i - 3), j):
                value -= band[i, 3 - i + k] * band[j, 3 - j + k]
            band[i, 3 - i + j] = 1.0 / sqrt(value) if i == j else value * band[j, 3]
        for c in range(3):
            value = nodes[i, c]
            for k in range(max(0, i - 3), i):
                value -= band[i, 3 - i + k] * nodes[k, c]
            nodes[i, c] = value * band[i, 3]
    for i in range(size - 1, -1, -1):
        for c in range(3):
            value = nodes[i, c]
            for k in range(i + 1, min(size, i + 4)):
                value -= band[k, 3 - k + i] * nodes[k, c]
            nodes[i, c] = value * band[i, 3]


@device
def measure_arcs(knots: Any, nodes: Any, n_segments: int, arcs: Any, speeds: Any) -> float:
    """Arc length at each knot into arcs (K + 1,), speeds at start, middle, end of each segment; returns the length.

    Simpson's rule, that is, the speed of a segment is taken as a parabola.
    """
    arcs[0] = 0.0
    for k in range(n_segments):
        step = knots[k + 1] - knots[k]
        start, middle, end = 0.0, 0.0, 0.0
        for c in range(3):
            v0, v1 = nodes[2 * k + 1, c], nodes[2 * k + 3, c]
            start += v0 * v0
            end += v1 * v1
            vm = 1.5 * (nodes[2 * k + 2, c] - nodes[2 * k, c]) / step - 0.25 * (v0 + v1)
            middle += vm * vm
        speeds[k, 0], speeds[k, 1], speeds[k, 2] = sqrt(start), sqrt(middle), sqrt(end)
        arcs[k + 1] = arcs[k] + step * (speeds[k, 0] + 4.0 * speeds[k, 1] + speeds[k, 2]) / 6.0
    return float(arcs[n_segments])


@device
def _parameter_at(arc: float, step: float, start: float, middle: float, end: float) -> float:
    """Share u in [0, 1] of a segment at which its arc length is `arc`, by Newton's method from the straight guess."""
    linear, square = -3.0 * start + 4.0 * middle - end, 2.0 * (start - 2.0 * middle + end)
    whole = step * (start + 4.0 * middle + end) / 6.0
    u = arc / whole if whole > 0.0 else 0.0
    for _ in range(2):  # pieces need only nearly equal lengths
        speed = start + u * (linear + u * square)
        if speed * step <= 1e-3 * whole:
            break
        u -= (u * (start + u * (0.5 * linear + u * square / 3.0)) - arc / step) / speed
        u = min(max(u, 0.0), 1.0)
    return u


@device
def cut(
    knots: Any, nodes: Any, n_segments: int, arcs: Any, speeds: Any, n_pieces: int,
    breaks: Any, tangents: Any, parameters: Any,
) -> None:  # fmt: skip
    """Points, unit tangents and parameters of n_pieces + 1 break points at equal steps of arc length (B-19)."""
    total, k = arcs[n_segments], 0
    for i in range(n_pieces + 1):
        arc = total * i / n_pieces
        while k < n_segments - 1 and arcs[k + 1] < arc:
            k += 1
        step = knots[k + 1] - knots[k]
        u = 1.0 if i == n_pieces else _parameter_at(arc - arcs[k], step, speeds[k, 0], speeds[k, 1], speeds[k, 2])
        v = 1.0 - u
        parameters[i] = knots[k] + u * step
        square = 0.0
        for c in range(3):
            x0, d0, x1, d1 = nodes[2 * k, c], nodes[2 * k + 1, c], nodes[2 * k + 2, c], nodes[2 * k + 3, c]
            breaks[i, c] = v * v * ((1.0 + 2.0 * u) * x0 + step * u * d0) + u * u * (
                (1.0 + 2.0 * v) * x1 - step * v * d1
            )
            t = 6.0 * u * v * (x1 - x0) / step + v * (1.0 - 3.0 * u) * d0 + u * (1.0 - 3.0 * v) * d1
            tangents[i, c] = t
            square += t * t
        length = sqrt(square)
        if length > 1e-9:
            for c in range(3):
                tangents[i, c] /= length
        else:
            _take_direction(breaks, tangents, nodes, n_segments, i)


@device
def _take_direction(breaks: Any, tangents: Any, nodes: Any, n_segments: int, i: int) -> None:
    """At a cusp, where the spline stands still: the tangent of the break point before, the strand's at the root."""
    square = 0.0
    for c in range(3):
        tangents[i, c] = tangents[i - 1, c] if i > 0 else nodes[2 * n_segments, c] - breaks[0, c]
        square += tangents[i, c] ** 2
    if square == 0.0:
        tangents[i, 0], tangents[i, 1], tangents[i, 2] = 0.0, 0.0, 1.0
        square = 1.0
    for c in range(3):
        tangents[i, c] /= sqrt(square)
