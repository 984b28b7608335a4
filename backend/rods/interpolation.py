"""The whole hair from its guides: followers, their weights, and their motion (Bao & Qi 2017, sec. VI; B-27, M-27)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree

from ..errors import require
from ..geometry.collider import Collider
from ..geometry.strands import arc_lengths, resample, strand_lengths
from ..types import Float32, Float64, Floats, Int32, StrandSet, check_array
from ._interpolation_kernels import guide_motions, move_strands
from ._keep_out_kernels import deepen, push_out
from .helices import Helices, evaluate

_NEAREST = 1e-6  # m: distances are not told apart below that
_KEPT_OFF = 4e-4  # m
_STRANDS_AT_ONCE = 20_000  # whose distances are held at a time


@dataclass(frozen=True, slots=True)
class FollowerParams:
    """Settings of `bind_followers` and of the training of the weights.

    n_neighbours : guides that move a hair, at most; fewer where there are not so many.
    n_samples : places along a guide whose rigid motions are blended.
    n_knots : places along a hair that have weights of their own, linear between them.
    power : of the inverse distance of the rest positions.
    clumping : 0..1, share of the motion that a hair takes from its own wisp's guide alone.
    root_reach : m from the root, as far as a deforming scalp pulls a hair away from what its guides do.
    training : find the weights from a short simulated motion. training_strands : hairs that are simulated for it, at
    most. training_frames : frames of that motion, at 24 a second. ridge : how strongly trained weights are held at
    those by distance, as a share of the guides' own errors. seed : of the choice of the hairs.
    """

    n_neighbours: int = 4
    n_samples: int = 33
    n_knots: int = 9
    power: float = 2.0
    clumping: float = 0.5
    root_reach: float = 0.03
    training: bool = True
    training_strands: int = 20_000
    training_frames: int = 24
    ridge: float = 0.02
    seed: int = 0

    def __post_init__(self) -> None:
        require(1 <= self.n_neighbours <= 8, f"n_neighbours is {self.n_neighbours}; it must be in 1..8")
        require(2 <= self.n_samples <= 512, f"n_samples is {self.n_samples}; it must be in 2..512")
        require(2 <= self.n_knots <= 64, f"n_knots is {self.n_knots}; it must be in 2..64")
        require(0.5 <= self.power <= 16, f"power is {self.power:g}; it must be from 0.5 to 16")
        require(0 <= self.clumping <= 1, f"clumping is {self.clumping:g}; it must be from 0 to 1")
        require(0 < self.root_reach <= 10, f"root_reach is {self.root_reach:g} m; it must be above 0 and at most 10")
        require(self.training_strands >= 1, f"training_strands is {self.training_strands}; it must be 1 or more")
        require(2 <= self.training_frames <= 10_000, f"training_frames is {self.training_frames}; it must be 2 or more")
        require(0 < self.ridge < 1e6, f"ridge is {self.ridge:g}; it must be above 0")


@dataclass(frozen=True, slots=True)
class Followers:
    """S strands of P points that follow G guides, all at rest; `interpolate` moves them.

    points : (P, 3) float32 m, offsets : (S + 1,) int32, the strands at rest.
    places : (P,) float32, how far along its strand each point lies, in samples of a guide: 0 .. M - 1.
    root_shares : (P,) float32, 1 at roots, 0 beyond the reach of a deforming scalp.
    guides : (S, K) int32, the guides of each strand, its own wisp's first.
    weights : (S, N, K) float32 at N knots at equal steps of arc length, root and tip included; of each knot 0 or more,
        and 1 together.
    guide_points : (G, M, 3) float64 m, guide_frames : (G, M, 3, 3) float64, the guides at M equal steps of arc length.
    """

    points: Float32
    offsets: Int32
    places: Float32
    root_shares: Float32
    guides: Int32
    weights: Float32
    guide_points: Float64
    guide_frames: Float64

    def __post_init__(self) -> None:
        check_array("points", self.points, np.float32, (None, 3))
        check_array("offsets", self.offsets, np.int32, (None,))
        require(len(self.offsets) >= 1 and self.offsets[0] == 0, "offsets must start with 0")
        require(self.offsets[-1] == len(self.points), "the last offset must be the number of points")
        require(bool((np.diff(self.offsets) > 0).all()), "every strand must have a point")
        check_array("places", self.places, np.float32, (len(self.points),))
        check_array("root_shares", self.root_shares, np.float32, (len(self.points),))
        check_array("guides", self.guides, np.int32, (self.n_strands, None))
        check_array("weights", self.weights, np.float32, (self.n_strands, None, self.guides.shape[1]))
        check_array("guide_points", self.guide_points, np.float64, (None, None, 3))
        check_array("guide_frames", self.guide_frames, np.float64, (*self.guide_points.shape[:2], 3, 3))
        require(self.n_guides >= 1, "there are no guides; make guides first")
        require(self.n_samples >= 2 and self.n_knots >= 2, "guides and weights need 2 places along a strand or more")
        require(self.guides.shape[1] >= 1, "every strand needs a guide")
        if len(self.points):
            inside = self.guides.min() >= 0 and self.guides.max() < self.n_guides
            require(inside, f"a strand names a guide outside 0 to {self.n_guides - 1}")
            reached = self.places.min() >= 0 and self.places.max() <= self.n_samples - 1
            require(reached, f"a place along a strand is outside 0 to {self.n_samples - 1}")
            require(self.weights.min() >= 0, "a weight is below 0")
            require(np.abs(self.weights.sum(axis=2) - 1).max() < 1e-4, "the weights of a knot must be 1 together")

    @property
    def n_strands(self) -> int:
        return len(self.offsets) - 1

    @property
    def n_guides(self) -> int:
        return len(self.guide_points)

    @property
    def n_samples(self) -> int:
        """Samples along a guide."""
        return int(self.guide_points.shape[1])

    @property
    def n_knots(self) -> int:
        return int(self.weights.shape[1])

    @property
    def n_neighbours(self) -> int:
        return int(self.guides.shape[1])


def bind_followers(
    strands: StrandSet,
    helices: Helices,
    params: FollowerParams = FollowerParams(),
    *,
    guides: Int32 | None = None,
    wisps: Int32 | None = None,
) -> Followers:
    """Bind hair to guides by the inverse distances of their rest positions (B-27; the fallback of M-27).

    The guides of a strand are that of its own wisp and those with the nearest roots.

    Parameters
    ----------
    strands : S strands at rest, metres. helices : the G guides at rest, in the same space.
    guides : (G,) int32, the strand that each guide is: it follows nothing else. None: the guides are not among them.
    wisps : (S,) int32, the guide of each strand's wisp; None has no wisps, and `params.clumping` no effect.

    Raises
    ------
    InputError : no strands or no guides; indices of another length, or that name no guide or strand.
    """
    require(strands.n_strands > 0, "the groom has no strands; choose one that has")
    require(helices.n_strands > 0, "there are no guides; make guides first")
    if guides is not None:
        check_array("guides", guides, np.int32, (helices.n_strands,))
        known = guides.min() >= 0 and guides.max() < strands.n_strands
        require(known, f"a guide is outside 0 to {strands.n_strands - 1}, the strands; make the guides again")
    if wisps is not None:
        check_array("wisps", wisps, np.int32, (strands.n_strands,))
        known = wisps.min() >= 0 and wisps.max() < helices.n_strands
        require(known, f"a strand's wisp is outside 0 to {helices.n_strands - 1}, the guides; make the guides again")
    points, frames = evaluate(helices, params.n_samples)
    neighbours = _neighbours(strands.roots, helices.roots, params.n_neighbours, wisps)
    weights = _weights_by_distance(strands, helices, neighbours, params, wisps is not None)
    if guides is not None:
        neighbours[guides, 0] = np.arange(len(guides))
        weights[guides] = np.eye(neighbours.shape[1], dtype=np.float32)[0]
    reached, lengths = arc_lengths(strands), np.repeat(strand_lengths(strands), strands.point_counts)
    places = np.clip(reached / np.maximum(lengths, 1e-300), 0.0, 1.0) * (params.n_samples - 1)
    return Followers(
        points=strands.points,
        offsets=strands.offsets,
        places=places.astype(np.float32),
        root_shares=_root_shares(reached, params.root_reach),
        guides=neighbours,
        weights=weights,
        guide_points=points,
        guide_frames=frames,
    )


def interpolate(
    followers: Followers, points: Float64, frames: Float64, out: Float32, *, roots: Floats | None = None
) -> None:
    """Fill `out` (P, 3) float32 with where the hair is, given where its guides are (B-27).

    x = sum_g w_g (R_g R0_g^T (x0 - g0) + g): the blend of the rigid motions that the guides' places at the same share
    of their length have made since rest. Hair at rest comes out bit for bit, and a rigid motion of all guides to the
    precision of float32; far from the world's origin, give the guides in a space that moves with the head.

    Parameters
    ----------
    points : (G, M, 3) float64, frames : (G, M, 3, 3) float64, the guides now, at the M samples of `followers`.
    out : (P, 3) float32, C order; written to.
    roots : (S, 3, 4), or (1, 3, 4) for all, what the surface does to each root from rest to now, in the same space;
        needed where the head deforms: roots are then exactly on it, and the hair follows within the reach. None leaves
        roots to the guides, which is the same where the head is rigid.

    Raises
    ------
    InputError : arrays of other shapes or types; guides that are not finite.
    """
    check_array("points", points, np.float64, followers.guide_points.shape)
    check_array("frames", frames, np.float64, followers.guide_frames.shape)
    _check_hair("out", out, followers)
    motions, centre = motions_of_guides(followers, points, frames)
    move_strands(
        np.ascontiguousarray(followers.points),
        followers.offsets,
        followers.places,
        followers.guides,
        followers.weights,
        motions,
        centre.astype(np.float32),
        _root_motions(followers, roots, centre),
        followers.root_shares,
        out,
    )


class PlacedCollider(Protocol):
    """What the hair is kept out of: a signed distance in a space of its own, and the rigid matrix out of that space."""

    @property
    def collider(self) -> Collider: ...

    @property
    def matrix(self) -> Float64: ...


def rest_depths(followers: Followers, solids: Sequence[PlacedCollider]) -> Float32:
    """(P,) float32, metres: how deep in the solids each point is at rest; `keep_out` allows for it.

    Negative outside, but not below -0.4 mm: that far off points are kept that were, since grids err at thin ears.
    """
    depths = np.full(len(followers.points), -_KEPT_OFF, np.float32)
    for solid in solids:
        collider = solid.collider
        inverse = np.linalg.inv(solid.matrix)
        deepen(followers.points, collider.distance, collider.origin, collider.cell, inverse, depths)
    return depths


def keep_out(
    followers: Followers, points: Float32, solids: Sequence[PlacedCollider], depths: Float32 | None = None
) -> None:
    """Push hair out of solids, in place: the head correction of the followers (B-27, M-27).

    A point that is deeper than at rest goes out along the distance's gradient, and the hair around it goes along,
    smoothly less over a few centimetres. Roots stay. Solids are taken in turn.

    Parameters
    ----------
    points : (P, 3) float32, C order, the hair now, in the space of the solids' matrices; written to.
    depths : (P,) float32, metres, as `rest_depths` gives; None: no point was inside at rest.

    Raises
    ------
    InputError : arrays that do not fit the followers.
    """
    _check_hair("points", points, followers)
    allowed = np.zeros(len(points), np.float32) if depths is None else depths
    fits = allowed.dtype == np.float32 and allowed.shape == (len(points),)
    require(fits, f"depths must be float32 of shape ({len(points)},), one a point; find them for this groom")
    for solid in solids:
        collider = solid.collider
        matrix, inverse = np.ascontiguousarray(solid.matrix, np.float64), np.linalg.inv(solid.matrix)
        push_out(
            points, followers.offsets, allowed, collider.distance, collider.origin, collider.cell, matrix, inverse
        )  # fmt: skip


def _check_hair(name: str, points: Float32, followers: Followers) -> None:
    """Not whether it is finite, which takes as long as half the interpolation."""
    right = isinstance(points, np.ndarray) and points.dtype == np.float32 and points.shape == followers.points.shape
    require(right and points.flags.c_contiguous, f"{name} must be float32 of shape {followers.points.shape} in C order")


def motions_of_guides(followers: Followers, points: Float64, frames: Float64) -> tuple[Float32, Float64]:
    """(G, 12, M) float32: what the guides do to the hair, as the kernels want it; and the centre (3,) it is about."""
    # a centre that float32 holds exactly: the hair's offsets from it are then those that the motions are for
    centre = followers.guide_points[:, 0].mean(axis=0).astype(np.float32).astype(np.float64)
    motions = np.empty((len(points), 12, points.shape[1]), np.float32)
    guide_motions(
        np.ascontiguousarray(followers.guide_points),
        np.ascontiguousarray(followers.guide_frames),
        np.ascontiguousarray(points),
        np.ascontiguousarray(frames),
        centre,
        motions,
    )
    return motions, centre


def _root_motions(followers: Followers, roots: Floats | None, centre: Float64) -> Float32:
    """(S, 12) or (1, 12) float32 as in the kernels, (0, 12) for none."""
    if roots is None:
        return np.zeros((0, 12), np.float32)
    fits = roots.shape in ((followers.n_strands, 3, 4), (1, 3, 4))
    require(fits, f"roots must have shape ({followers.n_strands}, 3, 4) or (1, 3, 4), not {roots.shape}")
    require(bool(np.isfinite(roots).all()), "roots has NaN or infinite values")
    motions = roots[:1] if roots.strides[0] == 0 else roots  # a view that repeats one motion
    turned = motions[:, :, :3] - np.eye(3)
    moved = motions[:, :, 3] + turned @ centre
    columns = turned.transpose(0, 2, 1).reshape(-1, 9)
    return np.asarray(np.concatenate([columns, moved], axis=1), np.float32)


def _root_shares(reached: Float64, reach: float) -> Float32:
    """(P,) float32: 1 at the root, falling smoothly to 0 at `reach` metres along the strand."""
    left = np.clip(1.0 - reached / reach, 0.0, 1.0)
    return np.asarray(left**2 * (3.0 - 2.0 * left), np.float32)


def _neighbours(roots: Float32, guide_roots: Float64, count: int, wisps: Int32 | None) -> Int32:
    """(S, K) int32, the own wisp's guide first, then by the distance of the roots."""
    kept = min(count, len(guide_roots))
    found = np.asarray(cKDTree(guide_roots).query(roots, k=np.arange(1, kept + 1))[1])
    if wisps is None:
        return found.astype(np.int32)
    # the wisp's own guide goes to the front from where it is, or else in place of the farthest
    own = found == wisps[:, None]
    place = np.where(own.any(axis=1), own.argmax(axis=1), kept - 1)
    column = np.arange(kept)[None, :]
    found = np.take_along_axis(found, np.maximum(column - (column <= place[:, None]), 0), axis=1)
    found[:, 0] = wisps
    return found.astype(np.int32)


def _weights_by_distance(
    strands: StrandSet, helices: Helices, neighbours: Int32, params: FollowerParams, have_wisps: bool
) -> Float32:
    """(S, N, K) float32 weights at the knots, by inverse distances of rest positions at the same share of length."""
    knots = resample(strands, params.n_knots)
    guide_knots = evaluate(helices, params.n_knots)[0].astype(np.float32)
    weights = np.empty((*knots.shape[:2], neighbours.shape[1]), np.float32)
    # a block of strands at a time, since the distances of all would be many times the result
    for start in range(0, len(knots), _STRANDS_AT_ONCE):
        block = slice(start, start + _STRANDS_AT_ONCE)
        offsets = knots[block, :, None, :] - guide_knots[neighbours[block]].transpose(0, 2, 1, 3)
        squares = np.einsum("snkx,snkx->snk", offsets, offsets, dtype=np.float64) + _NEAREST**2
        shares = (squares.min(axis=2, keepdims=True) / squares) ** (0.5 * params.power)
        shares /= shares.sum(axis=2, keepdims=True)
        if have_wisps:
            shares *= 1.0 - params.clumping
            shares[:, :, 0] += params.clumping
        weights[block] = shares
    return weights
