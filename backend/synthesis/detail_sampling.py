"""Smoothing and subdivision of strands for detail transfer (W-U6, W-L2)."""

from __future__ import annotations

from math import ceil

import numpy as np

from ..geometry.strands import polyline_lengths
from ..types import Float32, Float64, RootedStrands, WispHierarchy

WAVE_SIGMA = 0.12  # what is smoother than this share of the strand belongs to the shape of a wisp, not to its waves
TIP_SIGMAS = 1.5  # how far before the tip the smoothed strand starts to be a line
POINTS_A_WAVE = 8  # fewer draw a curl with corners
WAVE_POWER = 0.9  # share of the waves' power that `shortest_wave` asks to be drawn well
FLAT = 1e-4  # of the strand's length: waves that stray less are rounding
MAX_SAMPLED = 1000  # strands that are looked at to tell how short the waves are


def smoother(n_points: int, sigma: float) -> Float64:
    """(N, N) float64: the matrix that smooths the N points of a strand by a Gaussian of `sigma` samples.

    The root stays, since the strand is continued beyond it by its reflection in the root. Beyond the tip nothing can
    be known: the last 1.5 sigma follow the line that fits best, by the Gaussian's weights, 1.5 sigma before the tip.
    So a curl is smoothed to its axis up to the tip (to within 0.15 of its radius; 0.6 if the line is fitted at the tip
    itself), whereas a tip that is held would leave a hook of the curl's size.
    """
    if sigma <= 0.0:
        return np.eye(n_points)
    reach = min(n_points - 1, int(np.ceil(4 * sigma)))
    points = np.arange(n_points)
    middles = np.minimum(points, max(n_points - 1 - TIP_SIGMAS * sigma, 0.0))
    gap = np.arange(-reach, n_points)[None, :] - middles[:, None]
    weights = np.where(np.abs(gap) <= reach, np.exp(-0.5 * (gap / sigma) ** 2), 0.0)
    m0, m1, m2 = ((weights * gap**power).sum(axis=1, keepdims=True) for power in range(3))
    ahead = (points - middles)[:, None]
    fitted = weights * ((m2 - gap * m1) + ahead * (m0 * gap - m1)) / (m0 * m2 - m1**2)
    matrix = np.array(fitted[:, reach:])
    mirrored = fitted[:, :reach][:, ::-1]  # of the points -1, -2 ...: twice the root less the points 1, 2 ...
    matrix[:, 0] += 2 * mirrored.sum(axis=1)
    matrix[:, 1 : reach + 1] -= mirrored
    return matrix


def shortest_wave(strands: RootedStrands) -> float:
    """Samples in a wave: `WAVE_POWER` of the power of what differs from the smoothed strands is in longer ones."""
    n = strands.n_points
    some = strands.points[:: -(-strands.n_strands // MAX_SAMPLED)].astype(np.float64)
    waves = some - np.einsum("ij,sjk->sik", smoother(n, WAVE_SIGMA * (n - 1)), some, optimize=True)
    if np.sqrt(np.mean(waves**2)) <= FLAT * polyline_lengths(some).mean():
        return float("inf")
    power = np.square(np.abs(np.fft.rfft(waves * np.hanning(n)[:, None], axis=1))).sum(axis=(0, 2))
    power[0] = 0.0
    return n / int(np.searchsorted(np.cumsum(power), WAVE_POWER * power.sum()))


def needed_subdivision(detail: RootedStrands, lenders: RootedStrands, takers: RootedStrands, most: int) -> int:
    """Into how many pieces a segment must be cut for waves of `detail` to be drawn well on longer hair, 1..`most`.

    lenders, takers : the center strands whose lengths tell how much longer. Waves are never drawn finer than they came.
    """
    taken, lent = (float(np.median(polyline_lengths(level.points))) for level in (takers, lenders))
    ratio = taken / max(lent, 1e-9)
    if ratio <= 1.0 or most == 1:
        return 1
    wanted = min(ceil(ratio), ceil(POINTS_A_WAVE * ratio / shortest_wave(detail)))
    return max(1, min(wanted, most))


def subdivide_levels(hierarchy: WispHierarchy, factor: int) -> WispHierarchy:
    """Every segment of every strand in `factor` pieces along the Catmull-Rom curve through the points, which stay."""
    if factor == 1:
        return hierarchy
    levels = tuple(level.with_points(subdivide_dense(level.points, factor)) for level in hierarchy.levels)
    return WispHierarchy(levels, hierarchy.labels)


def subdivide_dense(points: Float32, factor: int) -> Float32:
    """(S, (N - 1) factor + 1, 3) float32 from (S, N, 3): Catmull-Rom, even in its parameter; points stay exactly."""
    before = np.concatenate([2 * points[:, :1] - points[:, 1:2], points[:, :-2]], axis=1)
    after = np.concatenate([points[:, 2:], 2 * points[:, -1:] - points[:, -2:-1]], axis=1)
    start, end = points[:, :-1], points[:, 1:]
    result = np.empty((len(points), (points.shape[1] - 1) * factor + 1, 3), np.float32)
    result[:, ::factor] = points
    for piece in range(1, factor):
        t = np.float32(piece / factor)
        result[:, piece::factor] = 0.5 * (
            2 * start
            + t * (end - before)
            + t * t * (2 * before - 5 * start + 4 * end - after)
            + t * t * t * (3 * start - before - 3 * end + after)
        )
    return result
