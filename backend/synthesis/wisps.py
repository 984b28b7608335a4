"""Wisp clustering: connected groups of alike strands and their center strands (Wang et al. 2009, sec. 4.1 to 4.4).

Decisions and additions to the paper. With seeds_per_wisp = seeds_per_split = 1 and merge = False none of the first
three is used.

- First seeds: more random strands than wisps are grown, then the touching wisps that are most alike are merged down to
  n_wisps (Ward 1963). From as many random seeds as wisps, whole wisps of the hair get no seed, and Lloyd iterations do
  not mend that: the energy comes out up to three times higher.
- A wisp that is far beyond the threshold gets several new seeds at once, each the strand farthest from those before.
- At the end, touching wisps are merged as long as all their strands keep the threshold: about a tenth fewer wisps.
- New seeds compete with their own wisp only, so that a split never raises the energy; the Lloyd iterations that follow
  are over changed wisps and those that touch them. An iteration that raises the energy is taken back and is the last.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import require
from ..geometry._grouping_kernels import list_members
from ..geometry.root_graph import RootGraph, connect_roots, spatial_order, to_rows
from ..progress import NO_PROGRESS, Progress, subrange
from ..types import Bools, Float32, Float64, Int32, RootedStrands
from ._merge_kernels import merge_wisps
from ._wisp_kernels import fit_wisps, grow_wisps, pick_split_seeds, wisps_beside

_PAPER_POINTS = 64  # the paper's error threshold is a sum over this many points of a strand
_LARGEST_COORDINATE = 1e6  # head radii; squares of larger ones would lose their meaning in float32
_SPLIT_SPACING = 1.0  # least L2 between new seeds of a wisp, in thresholds: few wisps are left to split then
_ROUNDING = 1e-5  # float32 sums of squares are good to this share; the threshold is kept with it to spare


@dataclass(frozen=True, slots=True)
class WispParams:
    """Settings of `cluster_wisps`.

    n_wisps : the paper's k_0, wisps before any split; without `adaptive` the number of wisps.
    error_threshold : the paper's epsilon, head radii squared: the largest L2 (W-8) of a strand to its center, for
        strands of 64 points. L2 is a sum over points, so for N points the threshold is scaled by N / 64.
    adaptive : split wisps until every strand keeps the threshold (W-14).
    max_iterations : Lloyd iterations before the first split.
    iterations_per_split : Lloyd iterations after each split, at most.
    seeds_per_wisp : random first seeds for each wisp; 1 as in the paper.
    seeds_per_split : new wisps that a wisp beyond the threshold may be split into at once; 1 as in the paper.
    merge : merge touching wisps at the end where the threshold allows it (only if `adaptive`); not in the paper.
    seed : of the random first seeds.
    """

    n_wisps: int = 200
    error_threshold: float = 0.2
    adaptive: bool = True
    max_iterations: int = 40
    iterations_per_split: int = 1
    seeds_per_wisp: int = 16
    seeds_per_split: int = 32
    merge: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        require(self.n_wisps >= 1, f"n_wisps is {self.n_wisps}; it must be 1 or more")
        threshold = self.error_threshold
        require(0 < threshold < float("inf"), f"error_threshold is {threshold}; it must be above 0 and finite")
        require(self.max_iterations >= 1, f"max_iterations is {self.max_iterations}; it must be 1 or more")
        require(self.iterations_per_split >= 0, f"iterations_per_split is {self.iterations_per_split}; it must be >= 0")
        require(self.seeds_per_wisp >= 1, f"seeds_per_wisp is {self.seeds_per_wisp}; it must be 1 or more")
        require(self.seeds_per_split >= 1, f"seeds_per_split is {self.seeds_per_split}; it must be 1 or more")
        require(self.seed >= 0, f"seed is {self.seed}; it must be 0 or more")


@dataclass(frozen=True, slots=True)
class WispSet:
    """k wisps of S strands with N points.

    labels : (S,) int32, the wisp of each strand; every wisp has a strand and is connected on the scalp.
    centers : (k, N, 3) float32, mean strands in root frames, head radii (W-12).
    seeds : (k,) int32, the strand of each wisp that is nearest to its center (W-11).
    errors : (S,) float32, L2 (W-8) of each strand to its center, head radii squared.
    energies : equation (3) after each iteration, each split and the last merging: the curve of the paper's figure 3.
    splits : (iteration, wisps from then on) of each split and of the last merging, `iteration` being an index of
        `energies`: the marks of figure 3.
    """

    labels: Int32
    centers: Float32
    seeds: Int32
    errors: Float32
    energies: tuple[float, ...]
    splits: tuple[tuple[int, int], ...]

    @property
    def n_wisps(self) -> int:
        return len(self.centers)


@dataclass(frozen=True, slots=True)
class _Partition:
    """k wisps fitted to their strands.

    labels (S,) int32; distances (S,) float32 to the centers (k, 3 N) float32; seeds and farthest (k,) int32, the
    nearest and farthest strand of each wisp; wisp_energies (k,) float64, the shares of equation (3).
    """

    labels: Int32
    distances: Float32
    centers: Float32
    seeds: Int32
    farthest: Int32
    wisp_energies: Float64

    @property
    def energy(self) -> float:
        return float(self.wisp_energies.sum())

    @property
    def n_wisps(self) -> int:
        return len(self.seeds)


@dataclass(slots=True)
class _Curve:
    """What figure 3 shows, as it comes in."""

    energies: list[float] = field(default_factory=list)
    splits: list[tuple[int, int]] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class _Hair:
    """Strand s is points[rows[s]], (3 N,) float32; the graph is that of the strands in this order."""

    points: Float32
    rows: Int32
    graph: RootGraph

    @property
    def n_strands(self) -> int:
        return len(self.rows)


def cluster_wisps(
    strands: RootedStrands, params: WispParams = WispParams(), *, progress: Progress = NO_PROGRESS
) -> WispSet:
    """Group strands into connected wisps, each with a center strand (Wang et al. 2009, sec. 4.1 to 4.4; W-8 to W-14).

    Minimises equation (3), sum_i sum_j L2(strand j of wisp i, center i), by Lloyd iterations (W-13) of region growing
    over the Delaunay neighbours of the roots (W-11) and means (W-12), then splits wisps until no strand is beyond the
    error threshold (W-14). The module's docstring lists what differs from the paper. O(S log S) an iteration.

    Parameters
    ----------
    strands : S strands with N points in root frames, head radii.
    progress : called once an iteration; may raise Cancelled.

    Returns
    -------
    WispSet; no energy is above the first, and, if `params.adaptive`, no error above the threshold.

    Raises
    ------
    InputError : fewer strands than `params.n_wisps`, or coordinates that cannot be head radii.
    """
    count = strands.n_strands
    require(count > 0, "there are no strands to group into wisps; choose a groom that has some")
    require(
        count >= params.n_wisps,
        f"{count} strands cannot be grouped into {params.n_wisps} wisps; lower n_wisps to {count} or less",
    )
    require(strands.n_points >= 1, "the strands have no points; resample them to 2 points or more")
    largest = max(float(strands.points.max()), -float(strands.points.min()))
    require(largest <= _LARGEST_COORDINATE, f"a strand reaches {largest:g} head radii from its root; check the units")
    progress(0.0, f"Wisps: neighbours of {count} roots")
    hair = _arrange(strands)
    curve = _Curve()
    partition = _cluster_fixed(hair, params, curve, subrange(progress, 0.1, 0.4))
    if params.adaptive:
        threshold = params.error_threshold * strands.n_points / _PAPER_POINTS * (1.0 - _ROUNDING)
        partition = _cluster_adaptively(hair, partition, threshold, params, curve, subrange(progress, 0.4, 1.0))
    progress(1.0, f"Wisps: {partition.n_wisps}")
    return WispSet(
        labels=_scattered(partition.labels, hair.rows),
        centers=partition.centers.reshape(-1, strands.n_points, 3),
        seeds=hair.rows[partition.seeds],
        errors=_scattered(partition.distances, hair.rows),
        energies=tuple(curve.energies),
        splits=tuple(curve.splits),
    )


def _arrange(strands: RootedStrands) -> _Hair:
    """Number the strands along the scalp: what is stored for neighbours is near in memory, and the order given is of no
    consequence. The strands themselves are not copied.
    """
    rows = spatial_order(strands.uv).astype(np.int32)
    points = np.ascontiguousarray(strands.points).reshape(strands.n_strands, -1)
    return _Hair(points, rows, connect_roots(strands.uv[rows]))


_Value = TypeVar("_Value", np.int32, np.float32)


def _scattered(values: NDArray[_Value], order: Int32) -> NDArray[_Value]:
    """`result[order[i]] = values[i]`."""
    result = np.empty_like(values)
    result[order] = values
    return result


def _cluster_fixed(hair: _Hair, params: WispParams, curve: _Curve, progress: Progress) -> _Partition:
    """Lloyd clustering into params.n_wisps wisps (W-11 to W-13)."""
    count = hair.n_strands
    progress(0.0, f"Wisps: {params.n_wisps}, first seeds")
    rng = np.random.default_rng(params.seed)
    n_seeds = min(count, params.seeds_per_wisp * params.n_wisps)
    seeds = np.sort(rng.choice(count, n_seeds, replace=False)).astype(np.int32)
    nobody = _Partition(
        labels=np.full(count, -1, np.int32),
        distances=np.zeros(count, np.float32),
        centers=hair.points[hair.rows[seeds]],
        seeds=seeds,
        farthest=seeds,
        wisp_energies=np.zeros(n_seeds),
    )
    partition = _iteration(hair, nobody, np.ones(n_seeds, np.bool_))
    partition = _merge(hair, partition, params.n_wisps, np.inf)
    curve.energies.append(partition.energy)
    everywhere = np.ones(partition.n_wisps, np.bool_)
    return _iterate(hair, partition, everywhere, params.max_iterations - 1, curve, progress)


def _cluster_adaptively(
    hair: _Hair, partition: _Partition, threshold: float, params: WispParams, curve: _Curve, progress: Progress
) -> _Partition:
    """Split wisps until no strand is beyond `threshold` (W-14), then merge those that need not be apart.

    It ends: a wisp beyond the threshold has two strands at least, each split makes more wisps, and a wisp of one strand
    has no error.
    """
    partition = _split_until(hair, partition, threshold, params, curve, subrange(progress, 0.0, 0.8))
    if not params.merge:
        return partition
    progress(0.8, f"Wisps: {partition.n_wisps}, merging")
    merged = _merge(hair, partition, 1, threshold)
    if merged.n_wisps < partition.n_wisps and merged.energy <= curve.energies[0]:
        curve.splits.append((len(curve.energies), merged.n_wisps))
        curve.energies.append(merged.energy)
        partition = merged
    # merging keeps the threshold to the last digit but one
    return _split_until(hair, partition, threshold, params, curve, subrange(progress, 0.9, 1.0))


def _split_until(
    hair: _Hair, partition: _Partition, threshold: float, params: WispParams, curve: _Curve, progress: Progress
) -> _Partition:
    """Split the wisps whose farthest strand is beyond `threshold` (W-14), until there are none."""
    done = 0.0
    while True:
        is_split = partition.distances[partition.farthest] > threshold
        done = max(done, 1.0 - float(is_split.mean()))
        progress(done, f"Wisps: {partition.n_wisps}, {int(is_split.sum())} to split")
        if not is_split.any():
            return partition
        n_before = partition.n_wisps
        partition = _split(
            hair, partition, np.flatnonzero(is_split).astype(np.int32), threshold, params.seeds_per_split
        )
        curve.splits.append((len(curve.energies), partition.n_wisps))
        curve.energies.append(partition.energy)
        changed = np.ones(partition.n_wisps, np.bool_)
        changed[:n_before] = is_split
        active = wisps_beside(partition.labels, changed, hair.graph.offsets, hair.graph.neighbours)
        partition = _iterate(hair, partition, active, params.iterations_per_split, curve, NO_PROGRESS)


def _split(hair: _Hair, partition: _Partition, split: Int32, threshold: float, most: int) -> _Partition:
    """Grow new wisps from the farthest strands of the wisps `split`, `most` in each, within its strands (W-14)."""
    starts, members = list_members(partition.labels, partition.n_wisps)
    picked = np.empty((len(split), most), np.int32)
    pick_split_seeds(
        hair.points,
        hair.rows,
        starts,
        members,
        split,
        partition.seeds,
        partition.farthest,
        partition.distances,
        _SPLIT_SPACING * threshold,
        picked,
    )
    new_seeds = picked[picked >= 0]
    before = _Partition(
        partition.labels,
        partition.distances,
        np.concatenate([partition.centers, hair.points[hair.rows[new_seeds]]]),
        np.concatenate([partition.seeds, new_seeds]),
        np.concatenate([partition.farthest, new_seeds]),
        np.concatenate([partition.wisp_energies, np.zeros(len(new_seeds))]),
    )
    active = np.ones(before.n_wisps, np.bool_)
    active[: partition.n_wisps] = False
    active[split] = True
    return _iteration(hair, before, active)


def _iterate(
    hair: _Hair, partition: _Partition, active: Bools, most: int, curve: _Curve, progress: Progress
) -> _Partition:
    """Lloyd iterations (W-13) until no label changes, the energy would not fall, or `most` are done."""
    for iteration in range(most):
        progress(iteration / most, f"Wisps: {partition.n_wisps}, iteration {len(curve.energies)}")
        after = _iteration(hair, partition, active)
        moved = after.labels != partition.labels
        if not moved.any() or after.energy >= partition.energy:
            break
        changed = np.zeros(partition.n_wisps, np.bool_)
        changed[after.labels[moved]] = True
        changed[partition.labels[moved]] = True
        partition = after
        curve.energies.append(partition.energy)
        active = wisps_beside(partition.labels, changed, hair.graph.offsets, hair.graph.neighbours)
    return partition


def _iteration(hair: _Hair, before: _Partition, active: Bools) -> _Partition:
    """Region growing (W-11) and means (W-12) over the active wisps; the others keep their strands."""
    graph = hair.graph
    labels, distances, _ = grow_wisps(
        hair.points,
        hair.rows,
        before.centers,
        before.seeds,
        graph.offsets,
        graph.neighbours,
        before.labels,
        before.distances,
        active,
    )
    after = _Partition(
        labels,
        distances,
        before.centers.copy(),
        before.seeds.copy(),
        before.farthest.copy(),
        before.wisp_energies.copy(),
    )
    _fit(hair, after, active)
    return after


def _merge(hair: _Hair, partition: _Partition, n_wanted: int, largest_error: float) -> _Partition:
    """Merge touching wisps as `merge_wisps` does, and fit the result."""
    if partition.n_wisps <= n_wanted:
        return partition
    before = partition.n_wisps
    ours = np.repeat(partition.labels, np.diff(hair.graph.offsets)).astype(np.int64)
    theirs = partition.labels[hair.graph.neighbours]
    between = ours < theirs
    touching = to_rows(np.stack([ours[between], theirs[between]], axis=-1), before)
    starts, members = list_members(partition.labels, before)
    holders = merge_wisps(
        hair.points,
        hair.rows,
        partition.centers,
        starts,
        members,
        partition.farthest,
        *touching,
        n_wanted,
        largest_error,
    )
    left, new_numbers = np.unique(holders, return_inverse=True)
    merged = _Partition(
        new_numbers.reshape(-1).astype(np.int32)[partition.labels],
        np.empty_like(partition.distances),
        np.empty_like(partition.centers[: len(left)]),
        np.empty_like(partition.seeds[: len(left)]),
        np.empty_like(partition.farthest[: len(left)]),
        np.empty_like(partition.wisp_energies[: len(left)]),
    )
    _fit(hair, merged, np.ones(len(left), np.bool_))
    return merged


def _fit(hair: _Hair, partition: _Partition, refit: Bools) -> None:
    """Fill in everything but the labels for the wisps to refit (W-12); the partition must be nobody else's yet."""
    starts, members = list_members(partition.labels, partition.n_wisps)
    fit_wisps(
        hair.points,
        hair.rows,
        starts,
        members,
        refit,
        partition.centers,
        partition.distances,
        partition.seeds,
        partition.farthest,
        partition.wisp_energies,
    )
