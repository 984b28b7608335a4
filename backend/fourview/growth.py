"""Guide strands through the volume of directions (Zhang et al. 2017, sec. 4.5; Z-21).

Streamlines from the scalp stay as deep as they start, so that alone they would leave the outer surface, which is what
the photos show, bare. So a strand rises to its layer: where hair grows everywhere on the scalp, that which is rooted
nearest to the parting lies on top. And where no guide has come near a place of the outer surface, one is traced from
there, back to the scalp and on to its tip.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..errors import InputError, require
from ..fields.grid import DirectionGrid
from ..geometry.head import HeadSurface
from ..geometry.roots import scatter_roots
from ..geometry.strands import from_dense, polyline_lengths, resample, select_strands
from ..progress import NO_PROGRESS, Progress
from ..types import Bools, Float32, Float64, Head, Int32, Mesh, StrandSet
from ._growth_kernels import ROOTED, grow_backward, grow_forward, respace_lines
from .hair_space import HEAD, OUTER, SCALP, SHAPE, HairShape, HairSpace, make_hair_space

_STEP = 0.5  # cells that a guide grows in a step
_FROM_SCALP = 0.55  # share of the guides that start on the scalp; the others cover what these leave bare
_ROUNDS, _UNSIGNED_ROUNDS = 5, 2  # of covering: later ones see what earlier ones have covered
_ALONG = 0.82  # cosine to the field within which a guide covers a place of the surface
_DEPTH = 0.012  # metres under the surface within which a guide covers it
_DESCENT = 0.1  # metres over the scalp after which a guide traced back goes down to it, at most
_PRIOR_STRANDS, _PRIOR_POINTS = 4000, 24  # of the database's hair that are looked at for lengths
_LENGTH_MARGIN = 0.01  # metres that any hair may be longer than the database's
_UNKNOWN = 0.02  # metres from the database's hair from where on its lengths say nothing
_JOIN = 0.01  # metres from a place of the surface to the hair that is traced from it, at most


@dataclass(frozen=True, slots=True)
class GrowthParams:
    """Settings of grow_guides, fill_strands and grow_strands."""

    n_guides: int = 2500  # the paper has 2,000 to 2,500
    n_strands: int = 30_000  # in all
    n_points: int = 32  # of each strand
    max_length: float = 1.0  # metres
    length_slack: float = 1.3  # hair may be so much longer than the database's in the same place; 0: ignore that
    clearance: float = 0.001  # metres that hair keeps off the head
    n_blended: int = 4  # guides that a strand is blended of (M-39)
    shape_distance: float = 0.35  # in strand lengths: guides that differ more are not blended (M-39)
    mask_margin: float = 2.0  # pixels that hair may lie off the photos' masks (Z-22)
    seed: int = 0

    def __post_init__(self) -> None:
        require(1 <= self.n_guides <= 100_000, f"n_guides is {self.n_guides}; it must be in 1..100000")
        require(1 <= self.n_strands <= 5_000_000, f"n_strands is {self.n_strands}; it must be in 1..5000000")
        require(4 <= self.n_points <= 1000, f"n_points is {self.n_points}; it must be in 4..1000")
        require(0.001 <= self.max_length <= 10.0, f"max_length is {self.max_length} m; it must be in 0.001..10")
        require(self.length_slack >= 0.0, f"length_slack is {self.length_slack}; it must be 0 or more")
        require(0.0 <= self.clearance <= 0.02, f"clearance is {self.clearance} m; it must be in 0..0.02")
        require(1 <= self.n_blended <= 8, f"n_blended is {self.n_blended}; it must be in 1..8")
        require(self.shape_distance > 0, f"shape_distance is {self.shape_distance}; it must be above 0")
        require(0.0 <= self.mask_margin <= 50.0, f"mask_margin is {self.mask_margin} px; it must be in 0..50")


@dataclass(frozen=True, slots=True)
class Guides:
    """G guide strands of N points.

    points : (G, N, 3) float32, metres, world space, root first. normals : (G, 3) float32, the scalp's at the roots.
    covering : (G,) bool, traced back from the outer surface. bare : share of the outer surface that no guide is near.
    """

    points: Float32
    normals: Float32
    covering: Bools
    bare: float

    @property
    def strands(self) -> StrandSet:
        return from_dense(self.points)


def grow_guides(
    volume: DirectionGrid,
    shape: HairShape,
    head: Head,
    params: GrowthParams = GrowthParams(),
    *,
    region: Bools | None = None,
    space: HairSpace | None = None,
    progress: Progress = NO_PROGRESS,
) -> Guides:
    """Guides from the scalp through the volume to the border of the shape (Z-21).

    Parameters
    ----------
    volume : directions from root to tip on a grid in world space, metres (Z-20).
    shape : its closed mesh bounds the hair, its open one is the surface to cover.
    region : (F,) bool, triangles of the head that grow hair; None for its scalp.
    space : what make_hair_space gives for these, when it is there already.

    Raises
    ------
    InputError : an empty shape or volume; no guide can be grown, since the shape is nowhere near the scalp.
    """
    field = make_hair_space(volume, shape, head) if space is None else space
    surface = HeadSurface(head)
    allowed = head.scalp if region is None else region
    tracer = _Tracer(field, surface, allowed, _Lengths(shape.strands, params), params)
    progress(0.2, "Guides from the scalp")
    n_first = max(int(_FROM_SCALP * params.n_guides), 1)
    points, normals = tracer.from_scalp(n_first)
    samples = surface_samples(shape.open, params)
    parts, directions = [points], [normals]
    bare = _bare(samples, field, np.concatenate(parts))
    left = params.n_guides - len(points)
    for turn in range(_ROUNDS):
        progress(0.3 + 0.6 * turn / _ROUNDS, "Guides to the outer surface")
        wanted = -(-left // (_ROUNDS - turn))
        chosen = _spread(np.flatnonzero(bare), wanted, params.seed + turn)
        if len(chosen) == 0:
            break
        # what no line along the field reaches may be where its sense is wrong: take its orientation alone
        signed = turn < _ROUNDS - _UNSIGNED_ROUNDS
        points, normals = tracer.from_surface(samples[chosen], params.seed + turn, signed)
        parts.append(points)
        directions.append(normals)
        left -= len(points)
        bare = _bare(samples, field, np.concatenate(parts))
    guides, n_scalp = np.concatenate(parts), len(parts[0])
    if len(guides) == 0:
        raise InputError("no hair can grow: the hair shape is nowhere near the scalp; move the cameras or the head")
    covering = np.arange(len(guides)) >= n_scalp
    return Guides(guides, np.concatenate(directions), covering, float(bare.mean()))


class _Tracer:
    """Traces guides in one space; keeps what all of them need."""

    def __init__(
        self, space: HairSpace, surface: HeadSurface, region: Bools, lengths: _Lengths, params: GrowthParams
    ) -> None:
        self.space, self.surface, self.region, self.lengths, self.params = space, surface, region, lengths, params
        self.step = _STEP * space.cell
        self.longest = int(np.ceil(params.max_length / self.step)) + 2
        self.scalp = np.flatnonzero(region)

    def from_scalp(self, count: int) -> tuple[Float32, Float32]:
        """Guides (G, N, 3) from even roots, without those that find no hair; and the scalp's normals (G, 3)."""
        roots = scatter_roots(self.surface.head, self.region, count, self.params.seed)
        normals = self.surface.normals_at(roots.triangles, roots.barycentric)
        upstream = self._upstream(roots.points)
        layers = np.random.default_rng(self.params.seed).uniform(0.85, 1.0, count)
        lengths = self.lengths.at_roots(roots.points)
        lines, counts, _ = self._forward(roots.points, normals, lengths, layers, upstream, True)
        return self._finish(lines, counts, normals)

    def from_surface(self, places: Float32, seed: int, signed: bool) -> tuple[Float32, Float32]:
        """Guides (G, N, 3) through places (n, 3) of the outer surface, and the scalp's normals (G, 3)."""
        at = self.space.at(places)
        inward = -at[:, 7 + 3 * SHAPE : 10 + 3 * SHAPE]
        starts = places + inward * np.clip(at[:, SHAPE] + 0.5 * self.space.cell, 0.0, _JOIN)[:, None]
        random = np.random.default_rng(seed)
        over_scalp = random.uniform(0.0, _DESCENT, len(starts))
        behind, beyond = self.lengths.around(places, random)
        back, n_back, reason = self._backward(starts, behind, over_scalp, signed)
        found = reason == ROOTED
        back, n_back, starts, beyond = back[found], n_back[found], starts[found], beyond[found]
        headings = starts - back[np.arange(len(back)), np.minimum(n_back - 1, 2)] if len(back) else starts
        headings = headings / np.maximum(np.linalg.norm(headings, axis=1, keepdims=True), 1e-9)
        lengths = np.clip(self.params.max_length - n_back * self.step, self.step, beyond)
        layers, upstream = np.ones(len(starts)), np.zeros(len(starts))
        ahead, n_ahead, _ = self._forward(starts, headings, lengths, layers, upstream, False, signed)
        lines, counts = _join(back, n_back, ahead, n_ahead)
        ends = np.ascontiguousarray(lines[:, 0], np.float32)
        triangles, barycentric = self._on_scalp(ends)
        lines[:, 0] = self.surface.points_at(triangles, barycentric)
        return self._finish(lines, counts, self.surface.normals_at(triangles, barycentric))

    def _on_scalp(self, points: Float32) -> tuple[Int32, Float32]:
        """The nearest places of the region: triangles (n,) of the head and barycentric (n, 3)."""
        head = self.surface.head
        part = HeadSurface(Head(head.vertices, head.triangles[self.scalp], head.scalp[self.scalp],
                                head.corner_uv[self.scalp]))  # fmt: skip
        _, triangles, barycentric = part.closest_points(points)
        return self.scalp[triangles].astype(np.int32), barycentric

    def _upstream(self, roots: Float32) -> Float64:
        """(S,) metres along the scalp from each root back to where the hair parts."""
        space, step = self.space, self.space.cell
        points = roots.astype(np.float64)
        at = space.at(points)
        heading = at[:, 4:7]
        length, running = np.zeros(len(points)), np.ones(len(points), np.bool_)
        for _ in range(int(0.4 / step)):
            at = space.at(points)
            out = at[:, 7 + 3 * HEAD : 10 + 3 * HEAD]
            vector = at[:, 4:7]
            vector = vector - np.einsum("nc,nc->n", vector, out)[:, None] * out
            vector /= np.maximum(np.linalg.norm(vector, axis=1), 1e-9)[:, None]
            running &= (np.einsum("nc,nc->n", vector, heading) > 0.25) & (at[:, SCALP] < 0.012)
            if not running.any():
                break
            heading = np.where(running[:, None], vector, heading)
            lift = (0.002 - at[:, HEAD])[:, None] * out
            points = np.where(running[:, None], points - step * vector + lift, points)
            length += step * running
        return np.maximum(length - 2.0 * step, 0.0)

    def _forward(
        self, starts: Float32 | Float64, normals: Float32 | Float64, lengths: Float64, layers: Float64,
        upstream: Float64, rooted: bool, signed: bool = True,
    ) -> tuple[Float64, Int32, Int32]:  # fmt: skip
        lines, counts, reasons = self._room(len(starts))
        grow_forward(
            np.ascontiguousarray(starts, np.float64), np.ascontiguousarray(normals, np.float64), lengths, self.step,
            layers, upstream, self.params.clearance, rooted, signed, self.space.distances, self.space.directions,
            self.space.origin, self.space.cell, lines, counts, reasons,
        )  # fmt: skip
        return lines, counts, reasons

    def _backward(
        self, starts: Float64, lengths: Float64, over_scalp: Float64, signed: bool
    ) -> tuple[Float64, Int32, Int32]:
        lines, counts, reasons = self._room(len(starts))
        grow_backward(
            np.ascontiguousarray(starts, np.float64), lengths, self.step, over_scalp, self.params.clearance, signed,
            self.space.distances, self.space.directions, self.space.origin, self.space.cell, lines, counts, reasons,
        )  # fmt: skip
        return lines, counts, reasons

    def _room(self, count: int) -> tuple[Float64, Int32, Int32]:
        return np.zeros((count, self.longest, 3)), np.zeros(count, np.int32), np.zeros(count, np.int32)

    def _finish(self, lines: Float64, counts: Int32, normals: Float32) -> tuple[Float32, Float32]:
        """Evenly spaced points of the guides that have some length."""
        points = np.empty((len(lines), self.params.n_points, 3), np.float32)
        respace_lines(lines, counts, points)
        good = polyline_lengths(points) > 4.0 * self.space.cell
        return points[good], np.asarray(normals[good], np.float32)


class _Lengths:
    """How long hair may be where it grows and where it is seen, by the database's hair in the same shape."""

    def __init__(self, prior: StrandSet, params: GrowthParams) -> None:
        self.most, self.slack = params.max_length, params.length_slack
        self.known = prior.n_strands > 0 and self.slack > 0.0
        if self.known:
            some = np.linspace(0, prior.n_strands - 1, min(_PRIOR_STRANDS, prior.n_strands)).astype(np.int64)
            points = resample(select_strands(prior, some), _PRIOR_POINTS)
            self.lengths = polyline_lengths(points)
            self.roots, self.points = cKDTree(points[:, 0]), cKDTree(points.reshape(-1, 3))

    def at_roots(self, roots: Float32) -> Float64:
        """(n,) metres, for strands from roots (n, 3)."""
        if not self.known:
            return np.full(len(roots), self.most)
        _, near = self.roots.query(roots, k=min(8, len(self.lengths)))
        typical = np.median(self.lengths[near.reshape(len(roots), -1)], axis=1)
        return np.asarray(np.minimum(self.slack * typical + _LENGTH_MARGIN, self.most))

    def around(self, places: Float32, random: np.random.Generator) -> tuple[Float64, Float64]:
        """(n,), (n,) metres that hair at places (n, 3) runs at most until it turns to the scalp, and on to its tip.

        Where the database has no hair nearby it does not know how long hair is: in a tail that its hairstyle lacks.
        """
        free = 0.8 * self.most, np.full(len(places), self.most)
        if not self.known:
            return np.full(len(places), free[0]), free[1]
        distance, near = self.points.query(places, k=8)
        near = near.reshape(len(places), -1)
        chosen = near[np.arange(len(near)), random.integers(0, near.shape[1], len(near))]
        lengths = self.slack * self.lengths[chosen // _PRIOR_POINTS]
        share = (chosen % _PRIOR_POINTS) / (_PRIOR_POINTS - 1.0)
        beyond = np.minimum((1.0 - share) * lengths + _LENGTH_MARGIN, self.most)
        far = distance.reshape(len(places), -1)[:, 0] > _UNKNOWN
        return np.where(far, free[0], share * lengths), np.where(far, free[1], beyond)


def _join(back: Float64, n_back: Int32, ahead: Float64, n_ahead: Int32) -> tuple[Float64, Int32]:
    """Lines that run back (S, K, 3) turned around, and on ahead (S, K, 3), which starts in the same places."""
    counts = (n_back + n_ahead - 1).astype(np.int32)
    width = int(counts.max(initial=1))
    place = np.arange(width)[None, :]
    behind = place < n_back[:, None]
    index = np.where(behind, n_back[:, None] - 1 - place, place - n_back[:, None] + 1)
    row = np.arange(len(back))[:, None]
    first = back[row, np.clip(index, 0, back.shape[1] - 1)]
    second = ahead[row, np.clip(index, 0, ahead.shape[1] - 1)]
    return np.where(behind[..., None], first, second), counts


def surface_samples(surface: Mesh, params: GrowthParams) -> Float32:
    """(n, 3) float32 places spread evenly over the outer surface."""
    count = len(surface.triangles)
    whole = Head(surface.vertices, surface.triangles, np.ones(count, np.bool_), np.zeros((count, 3, 2), np.float32))
    return scatter_roots(whole, whole.scalp, 2 * params.n_guides, params.seed, iterations=10).points


def share_bare(surface: Mesh, space: HairSpace, guides: Float32, params: GrowthParams) -> float:
    """Share of the outer surface that no guide (G, N, 3) passes within 12 mm along the field."""
    return float(_bare(surface_samples(surface, params), space, guides).mean())


def _bare(samples: Float32, space: HairSpace, guides: Float32) -> Bools:
    """(n,) whether no guide (G, N, 3) passes a place of the surface along the field."""
    if len(guides) == 0 or len(samples) == 0:
        return np.ones(len(samples), np.bool_)
    spacing = float(np.median(cKDTree(samples).query(samples, k=2)[0][:, 1]))
    middles = 0.5 * (guides[:, 1:] + guides[:, :-1]).reshape(-1, 3)
    tangents = (guides[:, 1:] - guides[:, :-1]).reshape(-1, 3)
    tangents = tangents / np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-9)
    shallow = space.at(middles)[:, OUTER] < _DEPTH
    if not shallow.any():
        return np.ones(len(samples), np.bool_)
    directions = space.at(samples)[:, 4:7]
    segment = np.linalg.norm(guides[:, 1:] - guides[:, :-1], axis=2).mean()
    distance, index = cKDTree(middles[shallow]).query(samples, k=6, distance_upper_bound=spacing + 0.5 * float(segment))
    known = np.isfinite(distance)
    along = np.einsum("nkc,nc->nk", tangents[shallow][np.where(known, index, 0)], directions)
    return np.asarray(~((along > _ALONG) & known).any(axis=1))


def _spread(chosen: Int32, count: int, seed: int) -> Int32:
    """At most `count` of the chosen, at random."""
    if len(chosen) <= count:
        return chosen
    return np.sort(np.random.default_rng(seed).choice(chosen, count, replace=False))
