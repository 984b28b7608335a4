"""Details of one hairstyle on another (Wang et al. 2009, sec. 6 "User-Controlled Synthesis"; W-U6, W-L2).

The second hairstyle keeps its coarsest level; the finer ones are built on it, coarse to fine, from the displacements
that the first one's strands have from their centers. The paper maps these by the share of the strand, which stretches
curls on longer hair (its own second limitation); here they go by length unless the paper's way is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from ..errors import require
from ..geometry._grouping_kernels import list_members
from ..geometry.strands import polyline_lengths
from ..progress import NO_PROGRESS, Progress
from ..types import Float32, Float64, Int32, RootedStrands, WispHierarchy
from ._detail_kernels import find_loops, lay_details, split_details
from ._transfer_kernels import find_donors
from .detail_sampling import WAVE_SIGMA, needed_subdivision, shortest_wave, smoother, subdivide_levels
from .features import fit_features
from .matching import match_evenly
from .transfer import TransferParams, align_frames, donor_weights, point_frames, root_offsets

LENGTH_MODES = ("tile", "scale", "plain")
MATCHINGS = ("even", "similar")
FULL_SMOOTHING = 0.25  # sigma of the coarsest level's smoothing at `smoothing` 1, share of the strand
POINTS_AT_LEAST = 4  # points that draw a wave, the fewest; below, waves are stretched
SEED_NOISE = 0.5  # of the choice of wisps by a seed above 0: share of the spread of the wisps' features
ALL_FINER_LEVELS = (0, 1, 2)  # a hierarchy has four levels at most


@dataclass(frozen=True, slots=True)
class DetailParams:
    """Settings of transfer_style. Defaults live here only.

    levels : the finer levels that take the details, 0 being the hair itself; others keep their own details. Levels
        that the hierarchies do not have are ignored.
    strength : 0 leaves the hair as it is, 1 replaces its details, above 1 exaggerates the difference.
    smoothing : how much the detail hairstyle's coarsest strands are smoothed first, so that their curls come across
        too (W-U6): sigma of a Gaussian is `smoothing` x 0.25 of the strand's length. 0 takes them as they are.
    length_mode : what is done about other lengths (W-L2). "tile": waves and curls keep their size and go on for as
        long as the hair does, spread and taper of wisps fit the strand; "scale": all grows with the ratio of lengths;
        "plain": the paper's, by share of the strand, unscaled.
    matching : which wisp lends its details. "even": every wisp of the detail hairstyle about equally often, to wisps of
        similar shape, and a finer wisp follows its center; "similar": the paper's, the most similar wisp on each level.
    max_subdivision : strands get up to this times as many segments where curls would be drawn with too few on hair
        longer than that which they come from; 1 never.
    transfer : search for the most similar wisp and strand.
    seed : 0 matches wisps by their shapes as they are, each other number by shapes changed at random.
    """

    levels: tuple[int, ...] = ALL_FINER_LEVELS
    strength: float = 1.0
    smoothing: float = 0.5
    length_mode: str = "tile"
    matching: str = "even"
    max_subdivision: int = 4
    transfer: TransferParams = field(default_factory=TransferParams)
    seed: int = 0

    def __post_init__(self) -> None:
        known = all(level in ALL_FINER_LEVELS for level in self.levels)
        require(known, f"levels is {self.levels}; name finer levels from 0 (the hair) to 2")
        require(0.0 <= self.strength <= 2.0, f"strength is {self.strength}; it must be in 0..2")
        require(0.0 <= self.smoothing <= 1.0, f"smoothing is {self.smoothing}; it must be in 0..1")
        require(
            self.length_mode in LENGTH_MODES,
            f"length_mode is '{self.length_mode}'; it must be one of {', '.join(LENGTH_MODES)}",
        )
        require(self.matching in MATCHINGS, f"matching is '{self.matching}'; it must be one of {', '.join(MATCHINGS)}")
        require(1 <= self.max_subdivision <= 8, f"max_subdivision is {self.max_subdivision}; it must be in 1..8")
        require(0 <= self.seed < 2**31, f"seed is {self.seed}; it must be in 0..2147483647")


@dataclass(frozen=True, slots=True)
class DetailResult:
    """What transfer_style made.

    strands : the base's strands with the other hairstyle's details, on the base's roots and in their frames.
    levels : all levels, finest first; levels[0] is `strands`, levels[-1] the base's own coarsest level. All have
        `subdivision` times as many segments as the base; its points are among those of levels[-1].
    matches : per finer level (K,) int32, the detail hairstyle's wisp for each output wisp; empty if not taken.
    donors : per finer level (S, D) int32, the strands whose details each strand took, best first; empty if not taken.
    """

    strands: RootedStrands
    levels: tuple[RootedStrands, ...]
    matches: tuple[Int32, ...]
    donors: tuple[Int32, ...]
    subdivision: int


@dataclass(frozen=True, slots=True)
class _Wisps:
    """Strands of a level with their centers: what both sides of a transfer need of it."""

    strands: RootedStrands
    labels: Int32
    centers: RootedStrands


@dataclass(frozen=True, slots=True)
class _Along:
    """Center strands in head space with the frames at their roots and along them."""

    points: Float32
    root_frames: Float32
    frames: Float32
    lengths: Float64

    @classmethod
    def of(cls, centers: RootedStrands) -> _Along:
        points, aligned = centers.in_head_space(), align_frames(centers)[0]
        return cls(points, aligned, point_frames(points, aligned), polyline_lengths(points))


def smooth_strands(strands: RootedStrands, smoothing: float) -> RootedStrands:
    """The strands without their curls (sec. 6; W-U6); roots stay. `smoothing` as in DetailParams."""
    if smoothing == 0.0:
        return strands
    matrix = smoother(strands.n_points, smoothing * FULL_SMOOTHING * (strands.n_points - 1))
    points = np.einsum("ij,sjk->sik", matrix, strands.points.astype(np.float64), optimize=True)
    return strands.with_points(np.ascontiguousarray(points - points[:, :1], dtype=np.float32))


def match_details(out_centers: RootedStrands, in_centers: RootedStrands, params: DetailParams) -> Int32:
    """(K,) int32: for each output center the input center whose wisp lends its details (W-22).

    Unless the mode is the paper's, each hairstyle counts in its own median length: else hair that is three times as
    long would find nothing but the longest wisps similar; and short wisps still go to short ones.
    """
    aligned = [align_frames(centers)[1] for centers in (in_centers, out_centers)]
    if params.length_mode != "plain":
        sizes = [max(float(np.median(polyline_lengths(points))), 1e-9) for points in aligned]
        aligned = [(points / size).astype(np.float32) for points, size in zip(aligned, sizes)]
    basis = fit_features(np.concatenate(aligned), params.transfer.n_features)
    lenders, takers = (basis.encode(points).astype(np.float64) for points in aligned)
    if params.seed > 0:
        spread = SEED_NOISE * takers.std(axis=0)
        takers += np.random.default_rng(params.seed).normal(size=takers.shape) * spread
    if params.matching == "even":
        return match_evenly(takers, lenders)
    return np.asarray(cKDTree(lenders).query(takers)[1], dtype=np.int32)


def transfer_style(
    detail: WispHierarchy,
    base: WispHierarchy,
    params: DetailParams = DetailParams(),
    *,
    progress: Progress = NO_PROGRESS,
) -> DetailResult:
    """Put the details of one hairstyle onto another one's coarsest level (sec. 6; W-U6, W-L2).

    Parameters
    ----------
    detail : the hairstyle whose finer levels are taken; on any head, lengths count in its head's radii.
    base : the hairstyle that keeps its coarsest level, roots and wisps.
    progress : called before each level; may raise Cancelled.

    Raises
    ------
    InputError : hierarchies of different numbers of levels or points a strand.
    """
    _check_alike(detail, base)
    factor = _subdivision(detail, base, params)
    detail, base = subdivide_levels(detail, factor), subdivide_levels(base, factor)
    coarsest = base.n_levels - 1
    current = base.levels[coarsest]
    levels, all_matches, all_donors = [current], [], []
    matches: Int32 | None = None
    for level in range(coarsest - 1, -1, -1):
        progress((coarsest - 1 - level) / coarsest, f"Details of level {level}")
        own = _Wisps(base.levels[level], base.labels[level], base.levels[level + 1])
        share = params.strength if level in params.levels else 0.0
        donors = np.zeros((own.strands.n_strands, 0), np.int32)
        used = np.zeros(0, np.int32)
        if share > 0.0:
            in_centers = detail.levels[level + 1]
            if level + 1 == coarsest:
                in_centers = smooth_strands(in_centers, params.smoothing)
            other = _Wisps(detail.levels[level], detail.labels[level], in_centers)
            used = matches if matches is not None else match_details(current, in_centers, params)
            current, donors = _blend(current, own, other, used, share, params)
        elif current is not own.centers:
            current, _ = _blend(current, own, None, used, 0.0, params)
        else:
            current = own.strands
        matches = np.ascontiguousarray(donors[:, 0]) if share > 0.0 and params.matching == "even" else None
        levels.append(current)
        all_matches.append(used)
        all_donors.append(donors)
    progress(1.0, "Done")
    return DetailResult(current, tuple(levels[::-1]), tuple(all_matches[::-1]), tuple(all_donors[::-1]), factor)


def _check_alike(detail: WispHierarchy, base: WispHierarchy) -> None:
    require(
        detail.n_levels == base.n_levels,
        f"the detail hairstyle has {detail.n_levels} levels, the base {base.n_levels}; "
        f"cluster one of them again with the other's number of levels",
    )
    require(base.n_levels >= 2, "the hairstyles have one level only, so no details; cluster them with 2 levels or more")
    n_detail, n_base = detail.levels[0].n_points, base.levels[0].n_points
    require(
        n_detail == n_base,
        f"strands of the detail hairstyle have {n_detail} points, those of the base {n_base}; "
        f"cluster one of them again with the other's number of points",
    )


def _subdivision(detail: WispHierarchy, base: WispHierarchy, params: DetailParams) -> int:
    taken = [level for level in params.levels if level < base.n_levels - 1]
    if params.length_mode != "tile" or not taken or params.strength == 0.0:
        return 1
    lenders = smooth_strands(detail.levels[-1], params.smoothing)
    return needed_subdivision(detail.levels[min(taken)], lenders, base.levels[-1], params.max_subdivision)


def _blend(
    centers: RootedStrands, own: _Wisps, other: _Wisps | None, matches: Int32, share: float, params: DetailParams
) -> tuple[RootedStrands, Int32]:
    """The strands of a level on new `centers`: (1 - share) of their own displacements and `share` of the other's."""
    onto = _Along.of(centers)
    result = onto.points[own.labels]
    donors = np.zeros((own.strands.n_strands, 0), np.int32)
    if share != 1.0:
        themselves = np.arange(own.strands.n_strands, dtype=np.int32)[:, None]
        weights = np.full(themselves.shape, 1.0 - share, np.float32)
        _add_details(result, own, onto, own, _Along.of(own.centers), themselves, weights, "plain")
    if other is not None:
        along = _Along.of(other.centers)
        donors, distances = _choose_donors(centers, own, onto, other, along, matches, params.transfer.n_donors)
        weights = np.float32(share) * donor_weights(distances)
        _add_details(result, own, onto, other, along, donors, weights, params.length_mode)
    local = np.matmul(result - own.strands.roots[:, None, :], own.strands.frames)
    local[:, 0] = 0.0
    return own.strands.with_points(local), donors


def _choose_donors(
    centers: RootedStrands, own: _Wisps, onto: _Along, other: _Wisps, along: _Along, matches: Int32, n_donors: int
) -> tuple[Int32, Float32]:
    """The members of the matched wisps with the most similar root displacements (W-24), (S, D), and their distances."""
    starts, members = list_members(other.labels, other.centers.n_strands)
    require((np.diff(starts) > 0).all(), "a wisp of the detail hairstyle has no strands; cluster it again")
    found: tuple[Int32, Float32] = find_donors(
        root_offsets(own.strands.roots, own.labels, centers, onto.root_frames),
        matches[own.labels],
        root_offsets(other.strands.roots, other.labels, other.centers, along.root_frames),
        members,
        starts,
        n_donors,
    )
    return found


def _add_details(
    result: Float32,
    own: _Wisps,
    onto: _Along,
    source: _Wisps,
    along: _Along,
    donors: Int32,
    weights: Float32,
    mode: str,
) -> None:
    """Add the displacements of `donors` (S, D), strands of `source`, to the output strands in head space.

    onto, along : the output's and the source's centers.
    """
    n = own.strands.n_points
    used, rows = np.unique(donors, return_inverse=True)
    rows = rows.reshape(donors.shape).astype(np.int32)
    used_wisps = source.labels[used]
    sigma = WAVE_SIGMA * (n - 1) if mode == "tile" else 0.0
    matrix = np.ascontiguousarray(smoother(n, sigma).T, dtype=np.float32)
    details, shapes = split_details(
        source.strands.in_head_space(), used.astype(np.int32), source.labels, along.points, along.frames, matrix
    )
    waves = details - shapes if mode == "tile" else np.zeros((0, 3, n), np.float32)
    lengths = np.maximum(along.lengths[used_wisps][rows], 1e-9)
    rates = np.asarray(onto.lengths[own.labels][:, None] / lengths, dtype=np.float32)
    scales = {"plain": np.ones_like(rates), "scale": rates, "tile": np.minimum(rates, 1.0)}[mode]
    if mode == "tile":  # a stub's waves on long hair would be drawn with a point or two each: noise
        rates = np.minimum(rates, max(1.0, shortest_wave(source.strands) / POINTS_AT_LEAST)).astype(np.float32)
    window = max(2, n // 8)
    starts, seams = find_loops(waves, window, max(window - 1, n // 4), max(window, (3 * n) // 4 - 1))
    lay_details(
        result, own.strands.roots, own.labels, onto.root_frames, onto.points, onto.frames,
        rows, weights, shapes, waves, starts, seams, np.float32(window), used_wisps, along.root_frames, along.frames,
        scales, rates,
    )  # fmt: skip
