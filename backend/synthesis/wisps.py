"""Wisp clustering: connected groups of alike strands and their center strands (Wang et al. 2009, sec. 4.1 to 4.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import require
from ..progress import NO_PROGRESS, Progress
from ..types import Bools, Float32, Float64, Int32, RootedStrands
from . import _wisp_kernels as kernels
from .root_graph import RootGraph, connect_roots

_PAPER_POINTS = 64  # the paper's error threshold is a sum over this many points of a strand
_LARGEST_COORDINATE = 1e6  # head radii; squares of larger ones would lose their meaning in float32


@dataclass(frozen=True, slots=True)
class WispParams:
    """Settings of `cluster_wisps`.

    n_wisps : the paper's k_0, wisps before any split; without `adaptive` the number of wisps.
    error_threshold : the paper's epsilon, head radii squared: the largest L2 (W-8) of a strand to its center, for strands
        of 64 points. L2 is a sum over points, so it is scaled by n_points / 64 for strands of another number of points.
    adaptive : split wisps until every strand keeps the threshold (W-14).
    max_iterations : Lloyd iterations before the first split.
    iterations_per_split : Lloyd iterations after each split.
    seed : of the random first seeds.
    """

    n_wisps: int = 200
    error_threshold: float = 0.2
    adaptive: bool = True
    max_iterations: int = 40
    iterations_per_split: int = 3
    seed: int = 0

    def __post_init__(self) -> None:
        require(self.n_wisps >= 1, f"n_wisps is {self.n_wisps}; it must be 1 or more")
        threshold = self.error_threshold
        require(0 < threshold < float("inf"), f"error_threshold is {threshold}; it must be above 0 and finite")
        require(self.max_iterations >= 1, f"max_iterations is {self.max_iterations}; it must be 1 or more")
        require(self.iterations_per_split >= 0, f"iterations_per_split is {self.iterations_per_split}; use 0 or more")
        require(self.seed >= 0, f"seed is {self.seed}; it must be 0 or more")


@dataclass(frozen=True, slots=True)
class WispSet:
    """k wisps of S strands with N points.

    labels : (S,) int32, the wisp of each strand.
    centers : (k, N, 3) float32, mean strands in root frames, head radii (W-12).
    seeds : (k,) int32, the strand of each wisp that is nearest to its center (W-11).
    errors : (S,) float32, L2 (W-8) of each strand to its center, head radii squared.
    energies : equation (3) after each iteration, splits included: the curve of the paper's figure 3.
    splits : (iteration, wisps from then on) of each split, `iteration` being an index of `energies`: figure 3's marks.
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
    """k wisps with their fitted centers: strands as rows; farthest (k,) int32; wisp_energies (k,) float64."""

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


@dataclass(frozen=True, slots=True)
class _Hair:
    """Strands as rows (S, 3 N) float32, and the graph of their roots."""

    points: Float32
    graph: RootGraph


def cluster_wisps(
    strands: RootedStrands, params: WispParams = WispParams(), *, progress: Progress = NO_PROGRESS
) -> WispSet:
    """Group strands into connected wisps, each with a center strand (Wang et al. 2009, sec. 4.1 to 4.4, W-8 to W-14)."""
    n_strands = strands.n_strands
    require(
        n_strands >= params.n_wisps,
        f"{n_strands} strands are fewer than n_wisps = {params.n_wisps}; set n_wisps to {n_strands} or less",
    )
    largest = max(float(strands.points.max()), -float(strands.points.min()))
    require(largest <= _LARGEST_COORDINATE, f"a strand reaches {largest:g} head radii from its root; check the units")
    hair = _Hair(np.ascontiguousarray(strands.points).reshape(n_strands, -1), connect_roots(strands.uv))
    threshold = params.error_threshold * strands.n_points / _PAPER_POINTS
    partition, energies = _cluster_fixed(hair, params, progress)
    splits: list[tuple[int, int]] = []
    if params.adaptive:
        partition = _split_until(hair, partition, threshold, params, energies, splits, progress)
    progress(1.0, f"{partition.n_wisps} wisps")
    return WispSet(
        partition.labels,
        partition.centers.reshape(-1, strands.n_points, 3),
        partition.seeds,
        partition.distances,
        tuple(energies),
        tuple(splits),
    )


def _cluster_fixed(hair: _Hair, params: WispParams, progress: Progress) -> tuple[_Partition, list[float]]:
    n_strands = len(hair.points)
    rng = np.random.default_rng(params.seed)
    seeds = np.sort(rng.choice(n_strands, params.n_wisps, replace=False)).astype(np.int32)
    nobody = _Partition(
        labels=np.full(n_strands, -1, np.int32),
        distances=np.zeros(n_strands, np.float32),
        centers=hair.points[seeds],
        seeds=seeds,
        farthest=seeds,
        wisp_energies=np.zeros(len(seeds)),
    )
    everywhere = np.ones(params.n_wisps, np.bool_)
    partition = _grow_and_fit(hair, nobody, everywhere)
    energies = [partition.energy]
    partition = _iterate(hair, partition, everywhere, params.max_iterations - 1, energies, progress)
    return partition, energies


def _grow_and_fit(hair: _Hair, before: _Partition, active: Bools) -> _Partition:
    """One Lloyd iteration (W-11, W-12) over the active wisps; the other wisps keep their strands."""
    labels, distances, _ = kernels.grow_wisps(
        hair.points,
        before.centers,
        before.seeds,
        hair.graph.offsets,
        hair.graph.neighbours,
        before.labels,
        before.distances,
        active,
    )
    starts, members = kernels.list_members(labels, before.n_wisps)
    after = _Partition(
        labels,
        distances,
        before.centers.copy(),
        before.seeds.copy(),
        before.farthest.copy(),
        before.wisp_energies.copy(),
    )
    kernels.fit_wisps(
        hair.points,
        starts,
        members,
        active,
        after.centers,
        after.distances,
        after.seeds,
        after.farthest,
        after.wisp_energies,
    )
    return after


def _iterate(
    hair: _Hair, partition: _Partition, active: Bools, most: int, energies: list[float], progress: Progress
) -> _Partition:
    """Lloyd iterations (W-13) until no label changes, the energy does not fall any more, or `most` are done."""
    for iteration in range(most):
        progress(iteration / most, f"{partition.n_wisps} wisps, iteration {len(energies)}")
        after = _grow_and_fit(hair, partition, active)
        moved = after.labels != partition.labels
        if not moved.any() or after.energy >= partition.energy:
            break
        changed = np.zeros(partition.n_wisps, np.bool_)
        changed[after.labels[moved]] = True
        changed[partition.labels[moved]] = True
        partition = after
        energies.append(partition.energy)
        active = kernels.wisps_beside(partition.labels, changed, hair.graph.offsets, hair.graph.neighbours)
    return partition


def _split_until(
    hair: _Hair,
    partition: _Partition,
    threshold: float,
    params: WispParams,
    energies: list[float],
    splits: list[tuple[int, int]],
    progress: Progress,
) -> _Partition:
    """Split wisps whose worst strand is beyond the threshold (W-14) until none is."""
    while True:
        worst = partition.distances[partition.farthest]
        split = np.flatnonzero(worst > threshold).astype(np.int32)
        if not len(split):
            return partition
        partition = _split(hair, partition, split, threshold)
        splits.append((len(energies), partition.n_wisps))
        energies.append(partition.energy)
        marked = np.zeros(partition.n_wisps, np.bool_)
        marked[split] = True
        marked[partition.n_wisps - 1 :] = True
        active = kernels.wisps_beside(partition.labels, marked, hair.graph.offsets, hair.graph.neighbours)
        partition = _iterate(hair, partition, active, params.iterations_per_split, energies, progress)


def _split(hair: _Hair, partition: _Partition, split: Int32, threshold: float) -> _Partition:
    starts, members = kernels.list_members(partition.labels, partition.n_wisps)
    picked = np.empty((len(split), MOST), np.int32)
    kernels.pick_split_seeds(
        hair.points, starts, members, split, partition.farthest, partition.distances, SPACING * threshold, picked
    )
    new_seeds = picked[picked >= 0]
    n = partition.n_wisps + len(new_seeds)
    seeds = np.concatenate([partition.seeds, new_seeds])
    before = _Partition(
        partition.labels,
        partition.distances,
        np.concatenate([partition.centers, hair.points[new_seeds]]),
        seeds,
        np.concatenate([partition.farthest, new_seeds]),
        np.concatenate([partition.wisp_energies, np.zeros(len(new_seeds))]),
    )
    active = np.zeros(n, np.bool_)
    active[split] = True
    active[partition.n_wisps :] = True
    return _grow_and_fit(hair, before, active)


MOST = 1
SPACING = 4.0
