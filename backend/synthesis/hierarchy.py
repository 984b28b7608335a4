"""The hierarchy of wisps: the strands of a coarser level are the centers of the finer level's wisps (W-15)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import require
from ..geometry.scalp_space import ScalpSpace
from ..progress import NO_PROGRESS, Progress, subrange
from ..types import Float32, RootedStrands, WispHierarchy
from .wisps import WispParams, WispSet, cluster_wisps


@dataclass(frozen=True, slots=True)
class HierarchyParams:
    """Settings of `build_hierarchy`.

    n_levels : 2 .. 4, the input strands being level 0 (the paper uses 2 for spiky hair, else 3).
    ratio : wisps of a level for each wisp of the next coarser one; the paper's 4.
    wisps : settings of the finest level's wisps; coarser levels take its iterations and seed.
    """

    n_levels: int = 3
    ratio: float = 4.0
    wisps: WispParams = field(default_factory=WispParams)

    def __post_init__(self) -> None:
        require(2 <= self.n_levels <= 4, f"n_levels is {self.n_levels}; it must be 2, 3 or 4")
        require(1.0 < self.ratio < float("inf"), f"ratio is {self.ratio}; it must be above 1 (the paper's is 4)")


def build_hierarchy(
    strands: RootedStrands,
    space: ScalpSpace,
    params: HierarchyParams = HierarchyParams(),
    *,
    progress: Progress = NO_PROGRESS,
) -> tuple[WispHierarchy, tuple[WispSet, ...]]:
    """Cluster strands, then their center strands, and so on (Wang et al. 2009, sec. 4.4; W-15).

    The first clustering is adaptive if `params.wisps` says so; each coarser one has a fixed number of wisps, that of
    the finer one divided by `ratio`, rounded, one at least.

    Parameters
    ----------
    strands : S strands with N points in root frames, head radii.
    space : the scalp on which the roots of center strands are placed.

    Returns
    -------
    WispHierarchy of n_levels levels, and the n_levels - 1 WispSets, finest first. Level l + 1's strand i is the center
    of level l's wisp i; its root is the scalp point at the mean (u, v) of the wisp's roots, with the frame there.

    Raises
    ------
    InputError : as `cluster_wisps`; Cancelled : from `progress`.
    """
    levels = [strands]
    wisp_sets: list[WispSet] = []
    n_sets = params.n_levels - 1
    settings = params.wisps
    for level in range(n_sets):
        # almost all the time goes into the finest level
        part = subrange(progress, 0.0, 0.9) if level == 0 else subrange(progress, 0.8 + 0.1 * level, 1.0)
        wisps = cluster_wisps(levels[-1], settings, progress=part)
        wisp_sets.append(wisps)
        levels.append(center_strands(levels[-1], wisps, space))
        n_coarser = max(1, round(wisps.n_wisps / params.ratio))
        settings = replace(settings, n_wisps=n_coarser, adaptive=False)
    progress(1.0, f"{params.n_levels} levels")
    return WispHierarchy(tuple(levels), tuple(wisps.labels for wisps in wisp_sets)), tuple(wisp_sets)


def center_strands(strands: RootedStrands, wisps: WispSet, space: ScalpSpace) -> RootedStrands:
    """The center strands of `wisps` as strands of their own, k strands in head space (W-15).

    The root of a center is the scalp point at the mean (u, v), radians, of its wisp's roots; where means coincide
    (rings around one point) the root of the strand nearest to the center takes the mean's place.
    """
    counts = np.bincount(wisps.labels, minlength=wisps.n_wisps)
    sums = [np.bincount(wisps.labels, strands.uv[:, axis], minlength=wisps.n_wisps) for axis in (0, 1)]
    uv = np.asarray(np.stack(sums, axis=-1) / counts[:, None], dtype=np.float32)
    uv = _distinct(uv, strands.uv[wisps.seeds])
    on_scalp = np.concatenate([uv, np.zeros((len(uv), 1), np.float32)], axis=1)
    roots = np.asarray(space.from_scalp(on_scalp), dtype=np.float32)
    frames = np.asarray(space.frames_at(uv), dtype=np.float32)
    return RootedStrands(roots, frames, uv, wisps.centers)


def _distinct(uv: Float32, instead: Float32) -> Float32:
    """`uv` (k, 2) with rows that occur again replaced by those of `instead`."""
    _, group, counts = np.unique(uv, axis=0, return_inverse=True, return_counts=True)
    repeated = counts[group.reshape(-1)] > 1
    return np.where(repeated[:, None], instead, uv)
