"""Compiled loops of detail transfer between hairstyles. All lengths are head radii, in head space.

Details lie in the frames of points along the center strand (eq. 6): normal, binormal, tangent. They are stored
(U, 3, N), so that the loops over the points of a strand use vector registers.
"""

from __future__ import annotations

from math import sqrt

import numba
import numpy as np

from ..kernels import device, parallel_kernel
from ..types import Bools, Float32, Int32

# cosines between the waves before the tip and the ones that are most like them: below the first they do not go on
_UNLIKE, _ALIKE = 0.5, 0.85


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
def find_loops(waves: Float32, window: int, first: int, last: int) -> tuple[Int32, Float32]:
    """Where the waves (U, 3, N) of a strand go on from when its tip is passed, so that nobody sees the seam.

    The point j of first..last is taken that, turned about the center strand by the best angle, has the `window`
    points before it most like those before the tip. Returns starts (U,) and seams (U, 6): cosine and sine of that
    angle, what is missing at the tip once turned (normal, binormal, tangent), and the share in which the waves go on:
    0 where nothing is like the tip, for then there are no waves but the last bend of a strand, 1 where much is.
    """
    count, n = waves.shape[0], waves.shape[2]
    tip = n - 1
    starts = np.full(count, first, np.int32)
    seams = np.zeros((count, 6), np.float32)
    for u in numba.prange(count):
        best = -1.0
        for j in range(first, last + 1):
            # sum of conj(z_j) z_tip over the window, z = normal + i binormal: its phase is the best angle
            real, imaginary, energy, along = 0.0, 0.0, 0.0, 0.0
            for k in range(window):
                a, b = waves[u, 0, j - k], waves[u, 1, j - k]
                c, d = waves[u, 0, tip - k], waves[u, 1, tip - k]
                e, f = waves[u, 2, j - k], waves[u, 2, tip - k]
                real += a * c + b * d
                imaginary += a * d - b * c
                energy += a * a + b * b + c * c + d * d + e * e + f * f
                along += e * f
            size = sqrt(real * real + imaginary * imaginary)
            likeness = 2.0 * (size + along) / energy if energy > 0.0 else 0.0
            if likeness > best:
                best = likeness
                starts[u] = j
                seams[u, 0] = real / size if size > 0.0 else 1.0
                seams[u, 1] = imaginary / size if size > 0.0 else 0.0
        j = starts[u]
        cosine, sine = seams[u, 0], seams[u, 1]
        share = min(1.0, max(0.0, (best - _UNLIKE) / (_ALIKE - _UNLIKE)))
        share = share * share * (3.0 - 2.0 * share)
        seams[u, 2] = waves[u, 0, tip] - (cosine * waves[u, 0, j] - sine * waves[u, 1, j])
        seams[u, 3] = waves[u, 1, tip] - (sine * waves[u, 0, j] + cosine * waves[u, 1, j])
        seams[u, 4] = waves[u, 2, tip] - waves[u, 2, j]
        seams[u, 5] = share
    return starts, seams


@device
def _cubic(values, i, t):  # type: ignore[no-untyped-def]
    """Catmull-Rom between values[i] and values[i + 1]: a chord would cut a curl of 5 samples a turn by a tenth."""
    b, c = values[i], values[i + 1]
    a = values[i - 1] if i > 0 else 2 * b - c
    d = values[i + 2] if i + 2 < len(values) else 2 * c - b
    half = np.float32(0.5)
    return b + half * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))


@device
def _wave_at(wave, seam, place, laps, left, c, s):  # type: ignore[no-untyped-def]
    """The wave (3, N) at `place` samples from the root, on the lap that goes on from the loop's start; 0 is the first.

    c, s : cosine and sine by which the lap before is turned. left : 1 at the loop's start, falling to 0.
    """
    tip = wave.shape[1] - 1
    i = min(int(place), tip - 1)
    part = np.float32(place - i)
    x, y, z = _cubic(wave[0], i, part), _cubic(wave[1], i, part), _cubic(wave[2], i, part)
    if laps == 0:
        return x, y, z
    # turned once more than the lap before; what that one ended with and this one lacks fades away
    x, y = seam[0] * x - seam[1] * y + left * seam[2], seam[1] * x + seam[0] * y + left * seam[3]
    x, y, z = c * x - s * y, s * x + c * y, z + left * seam[4]
    share = seam[5]
    if laps > 1:
        return share * x, share * y, share * z
    rest = (1 - share) * left
    return share * x + rest * wave[0, tip], share * y + rest * wave[1, tip], share * z + rest * wave[2, tip]


@device
def _advance(place, laps, next_lap, period, cosine, sine, seam):  # type: ignore[no-untyped-def]
    """The lap that `place` lies on, where the next begins, and the turn of the lap before."""
    while place > next_lap:
        if laps > 0:
            cosine, sine = cosine * seam[0] - sine * seam[1], sine * seam[0] + cosine * seam[1]
        laps += 1
        next_lap += period
    return laps, next_lap, cosine, sine


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
    rates: Float32,
) -> None:
    """Add to `result` (S, N, 3) the weighted displacements of the donors, laid onto the output's center strands.

    A donor's `shapes` (U, 3, N) go by the share of the strand, scaled, blended from root to tip between the frame of
    the root and those along the center (eqs. 5 to 8). Its `waves` (U, 3, N), none if U is 0, go by length along the
    center, in the frames along it alone. donors, weights (S, D) name rows of these; donor_wisps (U,) input centers.
    scales, rates (S, D): factor of the shapes, and input samples in an output sample for the waves.
    starts, seams, fade : how waves go on beyond the tip, see `find_loops`.
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
            scale, rate = scales[s, d], rates[s, d]
            first = _into(in_point_frames[b, 0], shapes[u, 0, 0], shapes[u, 1, 0], shapes[u, 2, 0])
            # laps of the loop that are done, the turn of the one before, and where the next begins
            laps, cosine, sine, next_lap = 0, np.float32(1.0), np.float32(0.0), np.float32(n - 1)
            for i in range(n):
                t = np.float32(i) / np.float32(n - 1)
                p, q, r = shapes[u, 0, i], shapes[u, 1, i], shapes[u, 2, i]
                x, y, z = _into(in_point_frames[b, i], p, q, r)
                x, y, z = _out_of(in_root, x - first[0], y - first[1], z - first[2])
                x, y, z = _into(out_root, x, y, z)
                p, q, r = t * scale * p, t * scale * q, t * scale * r
                if len(waves):
                    start, period = starts[u], np.float32(n - 1 - starts[u])
                    place = i * rate
                    laps, next_lap, cosine, sine = _advance(place, laps, next_lap, period, cosine, sine, seams[u])
                    place -= laps * period
                    left = max(np.float32(0.0), 1 - (place - start) / fade)
                    wave = _wave_at(waves[u], seams[u], place, laps, left, cosine, sine)
                    p, q, r = p + wave[0], q + wave[1], r + wave[2]
                p, q, r = _into(out_point_frames[center, i], p, q, r)
                result[s, i, 0] += weight * ((1 - t) * (shift_x + scale * x) + p)
                result[s, i, 1] += weight * ((1 - t) * (shift_y + scale * y) + q)
                result[s, i, 2] += weight * ((1 - t) * (shift_z + scale * z) + r)


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
