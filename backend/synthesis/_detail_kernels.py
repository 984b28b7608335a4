"""Compiled loops of detail transfer between hairstyles. All lengths are head radii, in head space.

Details lie in the frames of points along the center strand (eq. 6): normal, binormal, tangent. They are stored
(U, 3, N), so that the loops over the points of a strand use vector registers.
"""

from __future__ import annotations

from math import cos, sin, sqrt

import numba
import numpy as np

from ..kernels import device, parallel_kernel
from ..types import Bools, Float32, Int32


@parallel_kernel
def split_details(
    strands: Float32, chosen: Int32, wisps: Int32, centers: Float32, point_frames: Float32, smoother: Float32
) -> tuple[Float32, Float32]:
    """Displacements of the `chosen` strands (U,) from their centers, in frames along these, and their smooth part.

    strands (S, N, 3), wisps (S,); centers (K, N, 3), point_frames (K, N, 3, 3). smoother (N, N): transposed, column i
    holds the weights of point i's smooth value. Returns details and smooth details, both (U, 3, N).
    """
    count, n = len(chosen), strands.shape[1]
    details = np.empty((count, 3, n), np.float32)
    smooth = np.zeros((count, 3, n), np.float32)
    for u in numba.prange(count):
        a = chosen[u]
        b = wisps[a]
        for i in range(n):
            x = strands[a, i, 0] - centers[b, i, 0]
            y = strands[a, i, 1] - centers[b, i, 1]
            z = strands[a, i, 2] - centers[b, i, 2]
            frame = point_frames[b, i]
            for axis in range(3):
                details[u, axis, i] = frame[0, axis] * x + frame[1, axis] * y + frame[2, axis] * z
        for axis in range(3):
            for j in range(n):
                value = details[u, axis, j]
                for i in range(n):
                    smooth[u, axis, i] += smoother[j, i] * value
    return details, smooth


@parallel_kernel
def find_loops(details: Float32, window: int, first: int, last: int) -> tuple[Int32, Float32]:
    """Where the details (U, 3, N) of a strand go on from when its tip is passed, so that nobody sees the seam.

    The point j of first..last is taken that, turned about the center strand by the best angle, has the `window`
    points before it most like those before the tip. Returns starts (U,) and seams (U, 5): cosine and sine of that
    angle, and what is missing at the tip once turned, (normal, binormal, tangent).
    """
    count, n = details.shape[0], details.shape[2]
    tip = n - 1
    starts = np.empty(count, np.int32)
    seams = np.empty((count, 5), np.float32)
    for u in numba.prange(count):
        best = np.inf
        for j in range(first, last + 1):
            # sum of conj(z_j) z_tip over the window, z = normal + i binormal: its phase is the best angle
            real, imaginary, energy, along = 0.0, 0.0, 0.0, 0.0
            for k in range(window):
                a, b = details[u, 0, j - k], details[u, 1, j - k]
                c, d = details[u, 0, tip - k], details[u, 1, tip - k]
                real += a * c + b * d
                imaginary += a * d - b * c
                energy += a * a + b * b + c * c + d * d
                step = details[u, 2, j - k] - details[u, 2, tip - k]
                along += step * step
            size = sqrt(real * real + imaginary * imaginary)
            misfit = energy - 2.0 * size + along
            if misfit < best:
                best = misfit
                starts[u] = j
                seams[u, 0] = real / size if size > 0.0 else 1.0
                seams[u, 1] = imaginary / size if size > 0.0 else 0.0
        j = starts[u]
        cosine, sine = seams[u, 0], seams[u, 1]
        seams[u, 2] = details[u, 0, tip] - (cosine * details[u, 0, j] - sine * details[u, 1, j])
        seams[u, 3] = details[u, 1, tip] - (sine * details[u, 0, j] + cosine * details[u, 1, j])
        seams[u, 4] = details[u, 2, tip] - details[u, 2, j]
    return starts, seams


@device
def _detail_at(detail, start, seam, fade, place):  # type: ignore[no-untyped-def]
    """The detail (3, N) at `place` samples from the root, beyond the tip played on from `start` again and again."""
    n = detail.shape[1]
    tip = n - 1
    laps = 0
    if place > tip:
        period = tip - start
        laps = int((place - tip) / period)
        beyond = place - tip - laps * period
        laps += 1
        place = start + beyond
    i = min(int(place), tip - 1)
    share = np.float32(place - i)
    x = (1 - share) * detail[0, i] + share * detail[0, i + 1]
    y = (1 - share) * detail[1, i] + share * detail[1, i + 1]
    z = (1 - share) * detail[2, i] + share * detail[2, i + 1]
    if laps == 0:
        return x, y, z
    left = np.float32(max(0.0, 1.0 - (place - start) / fade))
    angle = np.arctan2(seam[1], seam[0])
    # the seam's rest is as wide as the lap before left it
    turn = angle * (laps - 1)
    c, s = np.float32(cos(turn)), np.float32(sin(turn))
    rest_x, rest_y = c * seam[2] - s * seam[3], s * seam[2] + c * seam[3]
    c, s = np.float32(cos(turn + angle)), np.float32(sin(turn + angle))
    return c * x - s * y + left * rest_x, s * x + c * y + left * rest_y, z + left * seam[4]


@device
def _into(frame, x, y, z):  # type: ignore[no-untyped-def]
    return (
        frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z,
        frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z,
        frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z,
    )


@device
def _out_of(frame, x, y, z):  # type: ignore[no-untyped-def]
    return (
        frame[0, 0] * x + frame[1, 0] * y + frame[2, 0] * z,
        frame[0, 1] * x + frame[1, 1] * y + frame[2, 1] * z,
        frame[0, 2] * x + frame[1, 2] * y + frame[2, 2] * z,
    )


@parallel_kernel
def lay_details(
    result: Float32,
    roots: Float32,
    wisps: Int32,
    out_root_frames: Float32,
    out_centers: Float32,
    out_point_frames: Float32,
    donors: Int32,
    weights: Float32,
    shapes: Float32,
    waves: Float32,
    starts: Int32,
    seams: Float32,
    fade: float,
    donor_wisps: Int32,
    in_root_frames: Float32,
    in_point_frames: Float32,
    scales: Float32,
) -> None:
    """Add to `result` (S, N, 3) the weighted displacements of the donors, laid onto the output's center strands.

    A donor's `shapes` (U, 3, N) go by the share of the strand, scaled, blended from root to tip between the frame of
    the root and those along the center (eqs. 5 to 8). Its `waves` (U, 3, N), none if U is 0, go by length along the
    center, in the frames along it alone. donors, weights (S, D) name rows of these; donor_wisps (U,) input centers.
    scales (S, D, 3): of shapes across and along the center, and input samples in an output sample.
    starts, seams, fade : how waves go on beyond the tip, see `find_loops`; none if the waves are short of no output.
    """
    n = result.shape[1]
    for s in numba.prange(result.shape[0]):
        center = wisps[s]
        out_root = out_root_frames[center]
        shift_x = roots[s, 0] - out_centers[center, 0, 0]
        shift_y = roots[s, 1] - out_centers[center, 0, 1]
        shift_z = roots[s, 2] - out_centers[center, 0, 2]
        for d in range(donors.shape[1]):
            weight = weights[s, d]
            if weight == 0.0:
                continue
            u = donors[s, d]
            b = donor_wisps[u]
            in_root = in_root_frames[b]
            across, along, rate = scales[s, d, 0], scales[s, d, 1], scales[s, d, 2]
            first = _into(
                in_point_frames[b, 0], across * shapes[u, 0, 0], across * shapes[u, 1, 0], along * shapes[u, 2, 0]
            )
            for i in range(n):
                t = np.float32(i) / np.float32(n - 1)
                p, q, r = across * shapes[u, 0, i], across * shapes[u, 1, i], along * shapes[u, 2, i]
                x, y, z = _into(in_point_frames[b, i], p, q, r)
                x, y, z = _out_of(in_root, x - first[0], y - first[1], z - first[2])
                x, y, z = _into(out_root, x, y, z)
                p, q, r = t * p, t * q, t * r
                if len(waves):
                    wave = _detail_at(waves[u], starts[u], seams[u], fade, i * rate)
                    p, q, r = p + wave[0], q + wave[1], r + wave[2]
                p, q, r = _into(out_point_frames[center, i], p, q, r)
                result[s, i, 0] += weight * ((1 - t) * (shift_x + x) + p)
                result[s, i, 1] += weight * ((1 - t) * (shift_y + y) + q)
                result[s, i, 2] += weight * ((1 - t) * (shift_z + z) + r)


@parallel_kernel
def spread_over_wisps(roots: Float32, members: Int32, starts: Int32, quotas: Int32) -> Bools:
    """(S,) bool: of each wisp w, members[starts[w]:starts[w + 1]], `quotas[w]` strands with roots far from each other.

    The first is the one nearest to the mean root, each next the one farthest from those chosen already.
    """
    chosen = np.zeros(roots.shape[0], np.bool_)
    for w in numba.prange(len(quotas)):
        first, size = starts[w], starts[w + 1] - starts[w]
        mean = np.zeros(3)
        for m in range(size):
            for axis in range(3):
                mean[axis] += roots[members[first + m], axis] / size
        gaps = np.empty(size)
        for m in range(size):
            root = roots[members[first + m]]
            gaps[m] = (root[0] - mean[0]) ** 2 + (root[1] - mean[1]) ** 2 + (root[2] - mean[2]) ** 2
        for count in range(min(quotas[w], size)):
            pick = np.argmin(gaps) if count == 0 else np.argmax(gaps)
            if count == 0:
                gaps[:] = np.inf
            chosen[members[first + pick]] = True
            center = roots[members[first + pick]]
            for m in range(size):
                root = roots[members[first + m]]
                gap = (root[0] - center[0]) ** 2 + (root[1] - center[1]) ** 2 + (root[2] - center[2]) ** 2
                gaps[m] = min(gaps[m], gap)
            gaps[pick] = -1.0  # roots may coincide
    return chosen
