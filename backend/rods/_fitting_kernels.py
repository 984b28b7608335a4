"""Numba kernels of `fitting`: element count, relaxation, one helix per pair (Bao & Qi 2017, sec. V; M-23)."""

from __future__ import annotations

from math import atan2, pi, sqrt
from typing import Any

import numpy as np
from numba import prange

from ..kernels import device, parallel_kernel
from ._helix_kernels import advance, turn_coefficients
from ._natural_kernels import STUB_LENGTH
from ._spline_kernels import cut, fit_spline, measure_arcs, merge_points

_CHUNK = 32  # strands that share work arrays; fixed, so that results do not depend on the thread count
# Tangents that differ by less (half angle, radians) are equal: what is left of float32 points is noise.
_EQUAL_TANGENTS = 1e-9
# An element is at least so long, as a share of the strand's length.
_SHORTEST_ELEMENT = 1e-4


@device
def _lean(s: float, c: float, chord_cosine: float, chord_sine: float) -> tuple[float, float]:
    """(sin phi, cos phi) of the angle phi of the helix's axis from the tangents' mean, in the plane of the chord.

    s, c are sine and cosine of theta in (0, pi/2], half the angle of the tangents; the chord's angle delta is in
    [0, pi]. The helix of the axis W(phi) turns by 2 psi, psi = atan2(s, -c sin phi), and its chord is at the angle
    phi + atan2(s / psi, c cos phi), which grows from 0 to pi as phi grows from -pi/2 to pi/2 (its slope is theta^2 / 3
    or more). So there is one helix, and a bracketed Newton method finds it; phi is kept as a unit vector, and a step d
    turns that by atan(d), since sines and cosines would take most of the time.
    """
    delta, square = atan2(chord_sine, chord_cosine), s * s / max(c * c, 1e-16) / 3.0
    # phi = delta - atan2(theta^2 / 3, delta): exact in the limits of small theta and of half circles
    scale = 1.0 / sqrt(delta * delta + square * square + 1e-300)
    x, y = delta * scale, square * scale
    sine, cosine = chord_sine * x - chord_cosine * y, chord_cosine * x + chord_sine * y
    if cosine < 0.0 or scale > 1e100:
        sine, cosine = (1.0, 0.0) if sine > 0.0 else (-1.0, 0.0)
    low_sine, low_cosine, high_sine, high_cosine = -1.0, 0.0, 1.0, 0.0
    for _ in range(60):
        psi = atan2(s, -c * sine)
        bow = s / psi
        rest_sine = chord_sine * cosine - chord_cosine * sine
        rest_cosine = chord_cosine * cosine + chord_sine * sine
        value = bow * rest_cosine - c * cosine * rest_sine
        bow_slope = -bow / psi * s * c * cosine / (s * s + c * c * sine * sine)
        slope = bow_slope * rest_cosine + bow * rest_sine + c * (sine * rest_sine + cosine * rest_cosine)
        if value > 0.0:
            high_sine, high_cosine = sine, cosine
        else:
            low_sine, low_cosine = sine, cosine
        step = -value / slope if slope > 0.0 else 1e9
        scale = 1.0 / sqrt(1.0 + step * step)
        new_sine, new_cosine = (sine + step * cosine) * scale, (cosine - step * sine) * scale
        if new_cosine < 0.0 or new_sine < low_sine or new_sine > high_sine:
            new_sine, new_cosine = low_sine + high_sine, low_cosine + high_cosine
            scale = sqrt(new_sine * new_sine + new_cosine * new_cosine)
            if scale < 1e-12:  # halfway between the ends of the whole range
                new_sine, new_cosine, scale = 0.0, 1.0, 1.0
            new_sine, new_cosine = new_sine / scale, new_cosine / scale
        moved = abs(new_sine - sine) + abs(new_cosine - cosine)
        sine, cosine = new_sine, new_cosine
        if moved < 1e-8:  # the next step would be of the order of its square
            break
    return sine, cosine


@device
def helix_between(start: Any, end: Any, t0: Any, t1: Any, shortest: float, darboux: Any) -> float:
    """The helix of less than a turn from start to end with unit tangents t0, t1 there, co-helical (B-21, M-23).

    Writes its Darboux vector (3,), 1/m, in the space of the points, and returns its length, at least `shortest`.
    """
    dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    distance = sqrt(dx * dx + dy * dy + dz * dz)
    ex, ey, ez = t1[0] - t0[0], t1[1] - t0[1], t1[2] - t0[2]
    mx, my, mz = t1[0] + t0[0], t1[1] + t0[1], t1[2] + t0[2]
    difference, mean = sqrt(ex * ex + ey * ey + ez * ez), sqrt(mx * mx + my * my + mz * mz)
    if difference < 2.0 * _EQUAL_TANGENTS:
        return float(_helix_of_equal_tangents(dx, dy, dz, distance, t0, shortest, darboux))
    s, c = 0.5 * difference, 0.5 * mean  # of half the angle between the tangents
    ex, ey, ez = ex / difference, ey / difference, ez / difference
    if mean < 1e-9:  # opposite tangents: any axis will do, the chord makes a half circle
        along = dx * ex + dy * ey + dz * ez
        mx, my, mz = dx - along * ex, dy - along * ey, dz - along * ez
        mean = sqrt(mx * mx + my * my + mz * mz)
        if mean <= 1e-9 * distance or distance == 0.0:
            mx, my, mz = (0.0, -ez, ey) if abs(ex) < 0.6 else (-ey, ex, 0.0)
            mean = sqrt(mx * mx + my * my + mz * mz)
    mx, my, mz = mx / mean, my / mean, mz / mean
    # b2 completes (e, b1, b2) to a right-handed frame
    nx, ny, nz = ey * mz - ez * my, ez * mx - ex * mz, ex * my - ey * mx
    along, aside = dx * mx + dy * my + dz * mz, dx * nx + dy * ny + dz * nz
    flat = sqrt(along * along + aside * aside)
    if flat == 0.0:
        along, flat = 1.0, 1.0
    sine, cosine = _lean(s, c, along / flat, abs(aside) / flat)
    sign = 1.0 if aside >= 0.0 else -1.0
    # the other branch mirrors the helix in the plane of e and b1: the axis (an axial vector) goes to pi - phi
    psi = atan2(s, -c * sine)
    along, bow = c * cosine, s / psi
    length = max(distance / sqrt(along * along + bow * bow), shortest)
    omega = 2.0 * psi / length
    w1, w2 = omega * sign * cosine, omega * sine
    darboux[0], darboux[1], darboux[2] = w1 * mx + w2 * nx, w1 * my + w2 * ny, w1 * mz + w2 * nz
    return length


@device
def _helix_of_equal_tangents(
    dx: float, dy: float, dz: float, distance: float, tangent: Any, shortest: float, darboux: Any
) -> float:
    """A straight element where the chord runs along the tangent, else one full turn about the chord."""
    along = dx * tangent[0] + dy * tangent[1] + dz * tangent[2]
    darboux[0], darboux[1], darboux[2] = 0.0, 0.0, 0.0
    aside = sqrt(max(distance * distance - along * along, 0.0))
    if along <= 0.0:
        return shortest
    if aside <= 1e-7 * distance or distance < shortest:
        return max(distance, shortest)
    length = distance * distance / along
    omega = 2.0 * pi / length / distance
    darboux[0], darboux[1], darboux[2] = omega * dx, omega * dy, omega * dz
    return float(length)


@device
def count_elements(tangents: Any, n_start: int, n_min: int, n_max: int) -> int:
    """Algorithm 2 on the tangents at n_start equal pieces, clamped: cos 18 degrees takes elements away (B-18)."""
    count = n_start
    for i in range(n_start):
        cosine = 0.0
        for c in range(3):
            cosine += tangents[i, c] * tangents[i + 1, c]
        if cosine <= 0.0:
            count += 1
        elif cosine > 0.95:
            count -= 1
    return min(max(count, n_min), n_max)


@device
def relax(breaks: Any, tangents: Any, n: int, relaxed: Any, work: Any) -> None:
    """Co-helical break points nearest to `breaks` in least squares, the root held (eq. 5, B-20), into relaxed.

    The paper's 2N unknowns are the moves x_i left free by N conditions d_i . (x_{i+1} - x_i) = -g_i, g_i = d_i .
    (p_{i+1} - p_i), d_i the unit vector of t_{i+1} - t_i. Lagrange's multipliers of those solve an N x N system of
    three diagonals: 2 (first 1, the root being held) and -d_{i-1} . d_i. Equal tangents put no condition.
    work (n, 6): d_i, pivot, multiplier, free.
    """
    for i in range(n):
        square = 0.0
        for c in range(3):
            work[i, c] = tangents[i + 1, c] - tangents[i, c]
            square += work[i, c] ** 2
        length = sqrt(square)
        gap = 0.0
        for c in range(3):
            work[i, c] = work[i, c] / length if length > 2.0 * _EQUAL_TANGENTS else 0.0
            gap += work[i, c] * (breaks[i + 1, c] - breaks[i, c])
        diagonal = 1.0 if i == 0 or length <= 2.0 * _EQUAL_TANGENTS else 2.0
        if i > 0:
            cosine = work[i, 0] * work[i - 1, 0] + work[i, 1] * work[i - 1, 1] + work[i, 2] * work[i - 1, 2]
            diagonal -= cosine * cosine / work[i - 1, 3]
            gap += cosine * work[i - 1, 4] / work[i - 1, 3]
            work[i, 5] = cosine
        work[i, 3], work[i, 4] = diagonal, gap
    for i in range(n - 1, -1, -1):
        value = work[i, 4]
        if i < n - 1:
            value += work[i + 1, 5] * work[i + 1, 4]
        work[i, 4] = value / work[i, 3]
    for c in range(3):
        relaxed[0, c] = breaks[0, c]
    for i in range(1, n + 1):
        for c in range(3):
            move = -work[i - 1, 4] * work[i - 1, c]
            if i < n:
                move += work[i, 4] * work[i, c]
            relaxed[i, c] = breaks[i, c] + move


@device
def distances(
    merged: Any, chords: Any, n_points: int, relaxed: Any, tangents: Any, parameters: Any,
    lengths: Any, darboux: Any, n: int,
) -> tuple[float, float]:  # fmt: skip
    """RMS and maximum distance of the samples to the helices' points at the same share of their piece, metres."""
    total, largest, p = 0.0, 0.0, 0
    for i in range(n):
        wx, wy, wz = darboux[i, 0], darboux[i, 1], darboux[i, 2]
        tx, ty, tz = tangents[i, 0], tangents[i, 1], tangents[i, 2]
        square = wx * wx + wy * wy + wz * wz
        omega, along = sqrt(square), wx * tx + wy * ty + wz * tz
        sx, sy, sz = wy * tz - wz * ty, wz * tx - wx * tz, wx * ty - wy * tx
        ux, uy, uz = wx * along - tx * square, wy * along - ty * square, wz * along - tz * square
        start, end = parameters[i], parameters[i + 1]
        scale = lengths[i] / (end - start) if end > start else 0.0
        while p < n_points and (i == n - 1 or chords[p] < end):
            s = min(max((chords[p] - start) * scale, 0.0), lengths[i])
            _, b, c = turn_coefficients(omega, s)
            x = relaxed[i, 0] + s * tx + b * sx + c * ux - merged[p, 0]
            y = relaxed[i, 1] + s * ty + b * sy + c * uy - merged[p, 1]
            z = relaxed[i, 2] + s * tz + b * sz + c * uz - merged[p, 2]
            error = x * x + y * y + z * z
            total += error
            largest = max(largest, error)
            p += 1
    return sqrt(total / n_points), sqrt(largest)


@device
def set_frame(tangent: Any, base: Any) -> None:
    """base[:, :3] = n0, n1, n2 with n0 = tangent: the axes turned by the smallest rotation from the z axis to it.

    Neighbouring strands so have neighbouring frames, but for tangents straight down.
    """
    x, y, z = tangent[0], tangent[1], tangent[2]
    base[0, 0], base[1, 0], base[2, 0] = x, y, z
    if z > -0.9999999:
        a = 1.0 / (1.0 + z)
        n1x, n1y, n1z = 1.0 - x * x * a, -x * y * a, -x
    else:
        n1x, n1y, n1z = 1.0 - x * x, -x * y, -x * z
        length = sqrt(n1x * n1x + n1y * n1y + n1z * n1z)
        n1x, n1y, n1z = n1x / length, n1y / length, n1z / length
    base[0, 1], base[1, 1], base[2, 1] = n1x, n1y, n1z
    base[0, 2] = y * n1z - z * n1y
    base[1, 2] = z * n1x - x * n1z
    base[2, 2] = x * n1y - y * n1x


@device
def chain(
    base: Any, lengths: Any, darboux: Any, n: int, curvatures: Any, positions: Any, tip: Any, turned: Any
) -> None:  # fmt: skip
    """Darboux vectors in space to those in the material frame that the elements carry along from the root base (3, 4).

    positions (n + 1, 3) become where the elements really start and end.
    """
    for i in range(n):
        for j in range(3):
            value = 0.0
            for c in range(3):
                value += base[c, j] * darboux[i, c]
            curvatures[i, j] = value
        advance(base, curvatures[i], lengths[i], tip, turned)
        for c in range(3):
            base[c, 3] = tip[c]
            positions[i + 1, c] = tip[c]
            for j in range(3):
                base[c, j] = turned[c, j]


@device
def _fit_pieces(strand: Any, spline: Any, n: int, pieces: Any, base: Any, lengths: Any, curvatures: Any) -> Any:
    """B-19 to B-21 with n pieces; lengths (n,) and curvatures (n, 3) are written, RMS and maximum distance returned."""
    merged, chords, n_points = strand
    knots, nodes, n_segments, arcs, speeds = spline
    breaks, tangents, parameters, relaxed, work, darboux, tip, turned = pieces
    cut(knots, nodes, n_segments, arcs, speeds, n, breaks, tangents, parameters)
    relax(breaks, tangents, n, relaxed, work)
    shortest = _SHORTEST_ELEMENT * arcs[n_segments]
    for i in range(n):
        lengths[i] = helix_between(
            relaxed[i], relaxed[i + 1], tangents[i], tangents[i + 1], shortest, darboux[i]
        )  # fmt: skip
    set_frame(tangents[0], base)
    for c in range(3):
        base[c, 3] = merged[0, c]
    chain(base, lengths, darboux, n, curvatures, relaxed, tip, turned)
    return distances(merged, chords, n_points, relaxed, tangents, parameters, lengths, darboux, n)


@device
def _fit_stub(merged: Any, n_points: int, tangents: Any, base: Any, lengths: Any, curvatures: Any) -> float:
    """A strand of next to no length: one straight element to the tip, or up if that is the root; its distance."""
    square = 0.0
    for c in range(3):
        tangents[0, c] = merged[n_points - 1, c] - merged[0, c]
        square += tangents[0, c] ** 2
    if square == 0.0:
        tangents[0, 2] = 1.0
    for c in range(3):
        tangents[0, c] /= sqrt(square) if square > 0.0 else 1.0
        curvatures[0, c] = 0.0
    set_frame(tangents[0], base)
    lengths[0] = STUB_LENGTH
    return STUB_LENGTH - sqrt(square)


@device
def _fit_adaptively(
    strand: Any, spline: Any, settings: Any, tolerance: float, pieces: Any, base: Any, lengths: Any, curvatures: Any
) -> tuple[int, float, float]:
    """Element count by Algorithm 2, or settings' own; then more, as long as the RMS distance is above `tolerance`."""
    knots, nodes, n_segments, arcs, speeds = spline
    n_min, n_max, n_fixed, l_min, l_max = settings
    total = arcs[n_segments]
    n = n_fixed
    if n_fixed == 0:
        if total < l_min:
            n = n_min
        elif total > l_max:
            n = n_max
        else:
            middle = (n_min + n_max) // 2
            cut(knots, nodes, n_segments, arcs, speeds, middle, pieces[0], pieces[1], pieces[2])
            n = count_elements(pieces[1], middle, n_min, n_max)
    rms, largest = _fit_pieces(strand, spline, n, pieces, base, lengths, curvatures)
    if n_fixed > 0 or tolerance <= 0.0:
        return n, rms, largest
    best, best_rms, tried = n, rms, n
    while rms > tolerance and tried < n_max:
        # of hair the distance falls with the power 5/3 of the number; where it is far off, break points miss whole
        # turns
        wanted = int(tried * min((rms / tolerance) ** 0.6, 10.0)) + 1
        tried = min(n_max, max(wanted, tried + 1))
        rms, largest = _fit_pieces(strand, spline, tried, pieces, base, lengths, curvatures)
        if rms < best_rms:
            best, best_rms = tried, rms
    if best != tried:
        rms, largest = _fit_pieces(strand, spline, best, pieces, base, lengths, curvatures)
    return best, rms, largest


@parallel_kernel
def fit_strands(
    points: Any, offsets: Any, first: int, end: int, samples_per_segment: int, settings: Any, tolerance: float,
    counts: Any, frames: Any, lengths: Any, curvatures: Any, errors: Any,
) -> None:  # fmt: skip
    """Fit the strands first..end. points (P, 3) float32, offsets (S + 1,).

    settings : n_min, n_max, n_fixed (0: adaptive), l_min, l_max.
    Written, with strand s in row s - first: counts (n,) elements, 0 for a stub (its element is the first),
    frames (n, 3, 3) at the roots, lengths (n, M), curvatures (n, M, 3), errors (n, 2) RMS and maximum distance.
    """
    n_max = lengths.shape[1]
    for chunk in prange((end - first + _CHUNK - 1) // _CHUNK):
        low, high = first + chunk * _CHUNK, min(first + (chunk + 1) * _CHUNK, end)
        most = 2
        for s in range(low, high):
            most = max(most, offsets[s + 1] - offsets[s])
        merged, chords, knots, arcs = np.empty((most, 3)), np.empty(most), np.empty(most + 1), np.empty(most + 1)
        nodes, band, speeds = np.empty((2 * most + 2, 3)), np.empty((2 * most + 2, 4)), np.empty((most, 3))
        rows, base = max(n_max, 14) + 16, np.empty((3, 4))
        tangents = np.empty((rows, 3))
        pieces = (
            np.empty((rows, 3)), tangents, np.empty(rows), np.empty((rows, 3)), np.empty((rows, 6)),
            np.empty((rows, 3)), np.empty(3), np.empty((3, 3)),
        )  # fmt: skip
        for s in range(low, high):
            row = s - first
            n_points = merge_points(points, offsets[s], offsets[s + 1], merged, chords)
            if n_points == 1 or chords[n_points - 1] < STUB_LENGTH:
                error = _fit_stub(merged, n_points, tangents, base, lengths[row], curvatures[row])
                counts[row], errors[row, 0], errors[row, 1] = 0, error, error
            else:
                n_segments = fit_spline(merged, chords, n_points, samples_per_segment, knots, nodes, band)
                measure_arcs(knots, nodes, n_segments, arcs, speeds)
                counts[row], errors[row, 0], errors[row, 1] = _fit_adaptively(
                    (merged, chords, n_points), (knots, nodes, n_segments, arcs, speeds), settings, tolerance,
                    pieces, base, lengths[row], curvatures[row],
                )  # fmt: skip
                set_frame(tangents[0], base)
            for c in range(3):
                for j in range(3):
                    frames[row, c, j] = base[c, j]
