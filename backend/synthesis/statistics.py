"""How alike and how new a synthesised hairstyle is (issue 2, Quality): measured, not judged by eye."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d
from scipy.spatial import cKDTree

from ..geometry.strands import polyline_lengths
from ..types import Float32, Float64, RootedStrands
from .wisps import WispParams, cluster_wisps

Ints = NDArray[np.integer[Any]]
SMOOTHING = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0
ROOT_NEIGHBOURS = 8  # strands "at the same root": the usual number of Delaunay neighbours and a little more


@dataclass(frozen=True, slots=True)
class StyleReport:
    """Distances between the distributions of two hairstyles, and how much of the second is copied from the first.

    Each distance is a Kolmogorov-Smirnov statistic, 0 (the same distribution) to 1 (no overlap), of: strand length,
    mean curvature, mean torsion, the components of the root-to-tip direction in the root frame (the largest of three),
    and strands per wisp.
    copied_share : share of output strands that lie closer to the most similar input strand at the same root than that
    input strand lies to its own nearest neighbour.
    """

    length: float
    curvature: float
    torsion: float
    tip_direction: float
    wisp_size: float
    copied_share: float
    example_means: dict[str, float] = field(default_factory=dict)
    result_means: dict[str, float] = field(default_factory=dict)

    @property
    def mean_distance(self) -> float:
        return (self.length + self.curvature + self.torsion + self.tip_direction + self.wisp_size) / 5


def curvature_and_torsion(points: Float32) -> tuple[Float64, Float64]:
    """Mean curvature and curvature-weighted mean absolute torsion of each strand.

    Discrete: turning angle, respectively angle between successive osculating planes, over segment length. Torsion is
    weighted by the curvatures beside it, since a straight piece has no osculating plane. Both are measured after a
    smoothing of about one sample, so that the corners of grooms of few points do not count as curls.

    points : (S, N, 3), any length unit. Returns two (S,) float64 arrays, 1 / unit.
    """
    smooth = convolve1d(points.astype(np.float64), SMOOTHING, axis=1, mode="nearest")[:, 2:-2]
    edges = np.diff(smooth, axis=1)
    lengths = np.maximum(np.linalg.norm(edges, axis=2), 1e-12)
    bends = np.cross(edges[:, :-1], edges[:, 1:])
    sines = np.linalg.norm(bends, axis=2)
    turning = np.arctan2(sines, np.einsum("sni,sni->sn", edges[:, :-1], edges[:, 1:]))
    total = lengths.sum(axis=1)
    twist_sines = np.einsum(
        "sni,sni->sn", np.cross(bends[:, :-1], bends[:, 1:]), edges[:, 1:-1] / lengths[:, 1:-1, None]
    )
    twists = np.abs(np.arctan2(twist_sines, np.einsum("sni,sni->sn", bends[:, :-1], bends[:, 1:])))
    weights = turning[:, :-1] * turning[:, 1:]
    rates = twists / lengths[:, 1:-1]
    torsion = (weights * rates).sum(axis=1) / np.maximum(weights.sum(axis=1), 1e-20)
    return turning.sum(axis=1) / total, torsion


def _tip_directions(strands: RootedStrands) -> Float64:
    tips = strands.points[:, -1].astype(np.float64)
    return np.asarray(tips / np.maximum(np.linalg.norm(tips, axis=1, keepdims=True), 1e-12))


def kolmogorov_smirnov(first: Float64, second: Float64) -> float:
    """Largest difference of two samples' cumulative distributions, 0 to 1 (scipy.stats costs 0.7 s to import)."""
    places = np.concatenate([first, second])
    shares = [np.searchsorted(np.sort(sample), places, side="right") / len(sample) for sample in (first, second)]
    return float(np.abs(shares[0] - shares[1]).max())


def subset(strands: RootedStrands, count: int, seed: int) -> RootedStrands:
    """`count` of the strands, drawn at random without repetition, order kept; all of them if there are fewer."""
    if strands.n_strands <= count:
        return strands
    chosen = np.sort(np.random.default_rng(seed).choice(strands.n_strands, count, replace=False))
    return RootedStrands(strands.roots[chosen], strands.frames[chosen], strands.uv[chosen], strands.points[chosen])


def copied_share(example: RootedStrands, result: RootedStrands) -> float:
    """Share of `result` that is closer to the example strand at the same root than that one is to its neighbours."""
    count = min(ROOT_NEIGHBOURS, example.n_strands - 1)
    if count < 1:
        return 0.0
    tree = cKDTree(example.uv)
    own = tree.query(example.uv, k=count + 1)[1][:, 1:]
    own_nearest = _nearest(example.points, example.points, own)[1]
    there = tree.query(result.uv, k=count)[1].reshape(result.n_strands, count)
    similar, distances = _nearest(result.points, example.points, there)
    return float((distances < own_nearest[similar]).mean())


def _nearest(points: Float32, others: Float32, candidates: Ints) -> tuple[Ints, Float64]:
    """For each strand the most similar of its candidates, and the squared distance (sum over points)."""
    best = np.full(len(points), np.inf)
    chosen = candidates[:, 0].copy()
    for column in candidates.T:
        distances = np.square(points - others[column]).sum(axis=(1, 2), dtype=np.float64)
        closer = distances < best
        best[closer] = distances[closer]
        chosen[closer] = column[closer]
    return chosen, best


def compare_styles(
    example: RootedStrands,
    result: RootedStrands,
    *,
    wisps: WispParams = WispParams(),
    max_strands: int = 20_000,
    seed: int = 0,
) -> StyleReport:
    """Compare the statistics of a synthesised hairstyle with those of its example.

    Both are thinned at random to the same number of strands, at most `max_strands`, so that wisp sizes compare.
    """
    count = min(example.n_strands, result.n_strands, max_strands)
    first, second = subset(example, count, seed), subset(result, count, seed)
    values = []
    for strands in (first, second):
        curvature, torsion = curvature_and_torsion(strands.points)
        few = WispParams(
            n_wisps=min(wisps.n_wisps, strands.n_strands), error_threshold=wisps.error_threshold, seed=wisps.seed
        )
        labels = cluster_wisps(strands, few).labels
        values.append(
            {
                "length": polyline_lengths(strands.points).astype(np.float64),
                "curvature": curvature,
                "torsion": torsion,
                "wisp_size": np.bincount(labels).astype(np.float64),
            }
        )
    tips = [_tip_directions(strands) for strands in (first, second)]
    distances = {name: kolmogorov_smirnov(values[0][name], values[1][name]) for name in values[0]}
    return StyleReport(
        **distances,
        tip_direction=max(kolmogorov_smirnov(tips[0][:, axis], tips[1][:, axis]) for axis in range(3)),
        copied_share=copied_share(example, subset(result, max_strands, seed)),
        example_means={name: float(array.mean()) for name, array in values[0].items()},
        result_means={name: float(array.mean()) for name, array in values[1].items()},
    )
