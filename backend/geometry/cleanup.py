"""Clean-up of hair before anything else looks at it (W-1).

Wang et al. 2009 apply "an initial cleanup stage as described in the supplemental", which was never published; the
rules here are ours and stand in `clean_up`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..errors import require
from ..progress import NO_PROGRESS, Progress
from ..types import Bools, Float32, Head, StrandSet
from .head import HeadSurface, submesh
from .scalp_region import require_scalp
from .strands import arc_lengths, resample, select_strands, strand_lengths, strand_of_point

_DUPLICATE_SAMPLES = 8  # points at which two strands are compared
_OUTLIER_SAMPLES = 16
_ON_SCALP = 1e-6  # m; a nearer root is on the scalp, up to float32 rounding
_OUTLIER_FLOOR = 1e-3  # m; neighbours that agree better than this still allow a strand to differ by some of it
_BLOCK = 8192  # strands looked at at once, which bounds memory


@dataclass(frozen=True, slots=True)
class CleanUpParams:
    """Settings of clean_up; lengths in metres. Defaults live here only."""

    min_points: int = 2  # a strand with fewer is dropped
    min_length: float = 1e-4  # a shorter strand is dropped, as is one without any length
    merge_distance: float = 1e-6  # a point nearer to the one before it is merged with it
    max_root_distance: float = 0.02  # a strand whose root is farther from the scalp is dropped
    snap_roots: bool = True  # other roots are moved onto the scalp
    inside_tolerance: float = 1e-4  # a point deeper in the head than this counts as inside
    max_inside_share: float = 0.5  # a strand with a greater share of its points inside is dropped
    push_out: bool = True  # inside points of other strands are moved to the surface
    remove_duplicates: bool = True
    duplicate_distance: float = 1e-5  # strands whose coordinates differ by no more all along are the same
    remove_outliers: bool = False
    outlier_factor: float = 4.0  # times the deviation usual among the neighbours
    outlier_neighbours: int = 16

    def __post_init__(self) -> None:
        require(self.min_points >= 2, f"min_points is {self.min_points}; it must be 2 or more")
        for name in ("min_length", "merge_distance", "max_root_distance", "inside_tolerance", "duplicate_distance"):
            value = getattr(self, name)
            require(0.0 <= value <= 1e6, f"{name} is {value}; it must be from 0 to 1e6 metres")
        require(0.0 <= self.max_inside_share <= 1.0, f"max_inside_share is {self.max_inside_share}; give 0 to 1")
        require(1.0 <= self.outlier_factor <= 1e6, f"outlier_factor is {self.outlier_factor}; it must be 1 or more")
        require(self.outlier_neighbours >= 3, f"outlier_neighbours is {self.outlier_neighbours}; it must be 3 or more")


@dataclass(frozen=True, slots=True)
class CleanUpReport:
    """What clean_up did. Strands dropped, unless a name speaks of points or roots."""

    n_too_few_points: int = 0
    n_too_short: int = 0
    n_far_from_scalp: int = 0
    n_inside_head: int = 0
    n_duplicates: int = 0
    n_outliers: int = 0
    n_points_merged: int = 0
    n_roots_snapped: int = 0
    n_points_pushed_out: int = 0

    @property
    def n_dropped(self) -> int:
        """Strands dropped in all."""
        points_or_roots = self.n_points_merged + self.n_roots_snapped + self.n_points_pushed_out
        return int(sum(asdict(self).values())) - points_or_roots


def clean_up(
    strands: StrandSet, head: Head, params: CleanUpParams = CleanUpParams(), *, progress: Progress = NO_PROGRESS
) -> tuple[StrandSet, CleanUpReport]:
    """Drop or repair strands that no later stage could use (W-1); attributes follow, the order is kept.

    Strands with NaN never get here: `StrandSet` refuses them and `io.raw.strands_from_raw` drops and counts them. The
    rules, in this order:

    1. A point within `merge_distance` of the point before it is merged into it (the first one stays).
    2. A strand of fewer than `min_points` points, or shorter than `min_length`, is dropped.
    3. A strand whose root is farther than `max_root_distance` from the scalp is dropped. With `snap_roots`, other roots
       move to the nearest place of the scalp; the rest of the strand follows by a share that falls linearly with arc
       length to 0 at the tip, so tips stay.
    4. A strand with more than `max_inside_share` of its points (without the root) deeper than `inside_tolerance` in the
       head is dropped. With `push_out`, such points of other strands move to the nearest place of the head's surface.
       Only points are looked at: a long segment between two points outside may still cut through the head.
    5. Rules 1 and 2 again, for what 3 and 4 brought together.
    6. With `remove_duplicates`: of two strands that, at 8 points of equal arc length (root and tip among them), differ
       in no coordinate by more than `duplicate_distance`, the later one is dropped, until there are no such two.
    7. With `remove_outliers`: shape is the strand at 16 points of equal arc length, seen from its root. Its deviation
       is the root mean square distance to the pointwise median shape of the `outlier_neighbours` nearest roots. A
       strand that deviates more than `outlier_factor` times as much as is the median among those neighbours (at least
       1 mm) is dropped: its length or its way is unlike theirs. Needs more strands than neighbours.

    A second clean-up of the result finds nothing to do (rules 1 to 6).

    Parameters
    ----------
    strands : S strands, world space, metres; an empty set comes back as it is.
    head : with its scalp marked. progress : called once a rule; may raise Cancelled.

    Returns
    -------
    The strands that are left, and the counts.

    Raises
    ------
    InputError : the head has no scalp, or no strand would be left (wrong units or the wrong head, most likely).
    """
    require_scalp(head)
    if not strands.n_strands:
        return strands, CleanUpReport()
    counts: dict[str, int] = dict.fromkeys(asdict(CleanUpReport()), 0)
    progress(0.0, "Cleaning up: broken strands")
    left = _drop_broken(strands, params, counts)
    progress(0.1, "Cleaning up: roots")
    left = _settle_roots(left, head, params, counts)
    progress(0.2, "Cleaning up: strands inside the head")
    left = _leave_head(left, HeadSurface(head), params, counts)
    left = _drop_broken(left, params, counts)
    if params.remove_duplicates:
        progress(0.7, "Cleaning up: duplicates")
        left = _drop(left, find_duplicates(left, params.duplicate_distance), "n_duplicates", counts)
    if params.remove_outliers:
        progress(0.8, "Cleaning up: outliers")
        left = _drop(left, find_outliers(left, params), "n_outliers", counts)
    progress(1.0, "Cleaning up: done")
    report = CleanUpReport(**counts)
    require(left.n_strands, f"clean-up would drop all strands ({_words(report)}); check the units and the head")
    return left, report


def find_duplicates(strands: StrandSet, distance: float) -> Bools:
    """(S,) bool, the strands that rule 6 of `clean_up` drops; `distance` in metres.

    Equal ones are found by sorting; of the others, in rounds, each strand whose nearest other one is within `distance`
    and comes earlier is dropped. The nearest two of all are each other's nearest, so every round drops one or more.
    """
    shapes = resample(strands, _DUPLICATE_SAMPLES).reshape(strands.n_strands, 3 * _DUPLICATE_SAMPLES)
    _, left = np.unique(shapes, axis=0, return_index=True)
    left.sort()
    while len(left) > 1:
        tree = cKDTree(shapes[left])
        # the nearest two, one of which is the strand itself; not found (too far) has the index len(left)
        _, near = tree.query(shapes[left], k=2, p=np.inf, distance_upper_bound=np.nextafter(distance, np.inf))
        own = np.arange(len(left))
        other = np.where(near[:, 0] == own, near[:, 1], near[:, 0])
        repeated = other < own
        if not repeated.any():
            break
        left = left[~repeated]
    duplicates = np.ones(strands.n_strands, dtype=np.bool_)
    duplicates[left] = False
    return duplicates


def find_outliers(strands: StrandSet, params: CleanUpParams) -> Bools:
    """(S,) bool, the strands that rule 7 of `clean_up` drops."""
    n_strands, n_near = strands.n_strands, params.outlier_neighbours
    if n_strands <= n_near:
        return np.zeros(n_strands, dtype=np.bool_)
    shapes = resample(strands, _OUTLIER_SAMPLES)
    shapes -= shapes[:, :1]
    _, near = cKDTree(strands.roots).query(strands.roots, k=n_near + 1)
    near = _others(near)
    deviation = np.empty(n_strands)
    for start in range(0, n_strands, _BLOCK):  # a loop over blocks bounds the memory of (block, neighbours, 16, 3)
        block = slice(start, start + _BLOCK)
        difference = shapes[block] - np.median(shapes[near[block]], axis=1)
        deviation[block] = np.sqrt((difference.astype(np.float64) ** 2).sum(axis=2).mean(axis=1))
    usual = np.maximum(np.median(deviation[near], axis=1), _OUTLIER_FLOOR)
    return np.asarray(deviation > params.outlier_factor * usual, dtype=np.bool_)


def _others(near: NDArray[Any]) -> NDArray[Any]:
    """(S, k) from the k + 1 nearest of each: without the strand itself, which equal roots may have put anywhere."""
    is_self = near == np.arange(len(near))[:, None]
    is_self[~is_self.any(axis=1), -1] = True
    return np.asarray(near[~is_self].reshape(len(near), -1))


def _drop_broken(strands: StrandSet, params: CleanUpParams, counts: dict[str, int]) -> StrandSet:
    """Rules 1 and 2."""
    steps = np.diff(strands.points.astype(np.float64), axis=0)
    keep = np.ones(len(strands.points), dtype=np.bool_)
    keep[1:] = np.einsum("ij,ij->i", steps, steps) > params.merge_distance**2
    keep[strands.offsets[:-1]] = True
    had_enough = strands.point_counts >= params.min_points
    counts["n_points_merged"] += int((~keep & np.repeat(had_enough, strands.point_counts)).sum())
    left = _drop(_keep_points(strands, keep), ~had_enough, "n_too_few_points", counts)
    lengths = strand_lengths(left)
    too_short = (lengths < params.min_length) | (lengths == 0.0) | (left.point_counts < params.min_points)
    return _drop(left, too_short, "n_too_short", counts)


def _settle_roots(strands: StrandSet, head: Head, params: CleanUpParams, counts: dict[str, int]) -> StrandSet:
    """Rule 3."""
    places, _, _ = HeadSurface(submesh(head, head.scalp)).closest_points(strands.roots)
    way = places.astype(np.float64) - strands.roots
    distance = np.linalg.norm(way, axis=1)
    is_far = distance > params.max_root_distance
    left, way, places = _drop(strands, is_far, "n_far_from_scalp", counts), way[~is_far], places[~is_far]
    moves = distance[~is_far] > _ON_SCALP
    if not params.snap_roots or not moves.any():
        return left
    counts["n_roots_snapped"] = int(moves.sum())
    way[~moves] = 0.0
    share = 1.0 - arc_lengths(left) / np.repeat(strand_lengths(left), left.point_counts)
    points = (left.points + np.repeat(way, left.point_counts, axis=0) * share[:, None]).astype(np.float32)
    points[left.offsets[:-1][moves]] = places[moves]
    return _with_points(left, points)


def _leave_head(strands: StrandSet, surface: HeadSurface, params: CleanUpParams, counts: dict[str, int]) -> StrandSet:
    """Rule 4."""
    if not strands.n_strands:
        return strands
    is_root = np.zeros(len(strands.points), dtype=np.bool_)
    is_root[strands.offsets[:-1]] = True
    suspects = np.flatnonzero(_is_inside(surface, strands.points) & ~is_root)
    places, _, _ = surface.closest_points(strands.points[suspects])
    depth = np.linalg.norm(places.astype(np.float64) - strands.points[suspects], axis=1)
    suspects, places = suspects[depth > params.inside_tolerance], places[depth > params.inside_tolerance]
    n_inside = np.bincount(strand_of_point(strands)[suspects], minlength=strands.n_strands)
    too_deep = n_inside > params.max_inside_share * np.maximum(strands.point_counts - 1, 1)
    if params.push_out and len(suspects):
        counts["n_points_pushed_out"] = int(n_inside[~too_deep].sum())
        points = strands.points.copy()
        points[suspects] = places
        strands = _with_points(strands, points)
    return _drop(strands, too_deep, "n_inside_head", counts)


def _is_inside(surface: HeadSurface, points: Float32) -> Bools:
    """(P,) bool, which points are inside the head; decided by the signed distance only where two rays disagree.

    From inside, the first face that a ray meets is seen from behind. One ray goes up, as a bust is open below, one away
    from the middle of the head. Two rays cost a twenty-fifth of a signed distance, which winds around the whole mesh.
    """
    low, high = surface.head.vertices.min(axis=0), surface.head.vertices.max(axis=0)
    boxed = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    origins = points[boxed]
    outward = origins - (0.5 * (low.astype(np.float64) + high)).astype(np.float32)
    outward[np.abs(outward).max(axis=1, initial=0.0) < 1e-6] = (1.0, 0.0, 0.0)
    up = np.broadcast_to(np.array([0, 0, 1], dtype=np.float32), origins.shape)
    sees_back = np.stack([_sees_back(surface, origins, directions) for directions in (up, outward)])
    verdict = sees_back.all(axis=0)
    unsure = np.flatnonzero(sees_back.any(axis=0) & ~verdict)
    verdict[unsure] = surface.signed_distance(origins[unsure]) < 0.0
    inside = np.zeros(len(points), dtype=np.bool_)
    inside[boxed] = verdict
    return inside


def _sees_back(surface: HeadSurface, origins: Float32, directions: Float32) -> Bools:
    _, triangle = surface.first_hits(origins, directions)
    towards = np.einsum("ij,ij->i", surface.face_normals[triangle], directions)
    return np.asarray((triangle >= 0) & (towards > 0.0), dtype=np.bool_)


def _drop(strands: StrandSet, dropped: Bools, name: str, counts: dict[str, int]) -> StrandSet:
    counts[name] += int(dropped.sum())
    return select_strands(strands, ~dropped) if dropped.any() else strands


def _keep_points(strands: StrandSet, keep: Bools) -> StrandSet:
    """The strands without some of their points; each keeps its root at least."""
    if keep.all():
        return strands
    ends = np.cumsum(keep)[strands.offsets[1:] - 1]
    return StrandSet(
        strands.points[keep],
        np.concatenate([[0], ends]).astype(np.int32),
        {name: array[keep] for name, array in strands.point_attributes.items()},
        strands.strand_attributes,
    )


def _with_points(strands: StrandSet, points: Float32) -> StrandSet:
    return StrandSet(points, strands.offsets, strands.point_attributes, strands.strand_attributes)


def _words(report: CleanUpReport) -> str:
    dropped = {name: count for name, count in asdict(report).items() if count and "points_" not in name}
    return ", ".join(f"{count} {name.removeprefix('n_').replace('_', ' ')}" for name, count in dropped.items())
