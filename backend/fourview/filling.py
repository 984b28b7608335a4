"""All strands from the guides: copies, blended, inside the shape and the photos' masks (Zhang et al. 2017, sec. 4.5).

Z-22 and M-39 (Hu et al. 2015): each new root takes the nearest guides' rigid copies, blended by 1 / distance^2, where
their shapes are alike, so that partings stay. A guide that alone covers much of the outer surface is taken more often.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from ..errors import require
from ..fields.grid import DirectionGrid
from ..geometry.frames import transport_frames
from ..geometry.head import HeadSurface, submesh
from ..geometry.roots import scatter_roots
from ..geometry.strands import from_dense, polyline_lengths
from ..progress import NO_PROGRESS, Progress, subrange
from ..types import Bools, Float32, Float64, Head, Int32, Int64, Mesh, StrandSet
from ._filling_kernels import blend_guides, choose_blends, keep_in_shape, push_out
from ._growth_kernels import follow_field
from .detail import HelixDetailParams, add_detail
from .growth import GrowthParams, Guides, grow_guides, surface_samples
from .hair_space import OUTER, HairShape, HairSpace, make_hair_space
from .masks import MaskLimits, bend_into_masks, hairy_region, mask_limits
from .views import View

_MUCH = 6.0  # mean needs from which on a guide gets roots of its own
_MOST_MOVED = 0.6  # of the roots of the second part
_AROUND_GUIDE = 0.006  # metres around the root of a guide
_NEIGHBOURS = 6  # guides around one that tell whether hair comes together
_NEAR = 10  # guides around a root that it may be copied from
_SPARE = 1.06  # roots more than wanted: some grow nothing that lies in the masks
_FIRST = 0.6  # share of the strands that are grown before it is known where hair is thin
_THIN = (0.1, 6.0)  # limits of how much less and more a guide is needed where hair is dense and thin
_LEAST_NEED = 0.25  # of a guide that covers nothing, in mean needs: hair under other hair
_SHALLOW = 0.012  # metres under the surface within which hair covers it
_SHORTEST = 0.004  # metres of hair that is worth keeping
_FOLLOW = 0.8  # of the field in the direction of a strand between guides


def grow_strands(
    volume: DirectionGrid,
    shape: HairShape,
    views: Sequence[View],
    head: Head,
    params: GrowthParams = GrowthParams(),
    *,
    normals: DirectionGrid | None = None,
    detail: HelixDetailParams = HelixDetailParams(),
    progress: Progress = NO_PROGRESS,
) -> StrandSet:
    """Hair that follows the volume and fills the photos' masks (Z-21, Z-22): guides, then all strands.

    Parameters
    ----------
    volume : directions from root to tip on a grid in world space, metres (Z-20).
    shape : closed mesh G_DEF and open outer surface G. views : with masks; may be none.
    normals : normals of the surface on such a grid: give waves the depth of helices, by `detail` (Z-23), within shape,
        masks and off the head; None: do not.

    Returns
    -------
    StrandSet : world space, metres, n_points a strand, at most n_strands; strand attribute `guide` (S,) int32, the
    guide that each was mainly copied from; no strand in the head, roots on the scalp.

    Raises
    ------
    InputError : as grow_guides.
    """
    progress(0.0, "Distances")
    space = make_hair_space(volume, shape, head)
    region = hairy_region(views, head, HeadSurface(head))
    guides = grow_guides(volume, shape, head, params, region=region, space=space, progress=subrange(progress, 0.2, 0.5))
    return fill_strands(
        guides, shape, views, head, params, region=region, space=space, normals=normals, detail=detail,
        progress=subrange(progress, 0.5, 1.0),
    )  # fmt: skip


def fill_strands(
    guides: Guides,
    shape: HairShape,
    views: Sequence[View],
    head: Head,
    params: GrowthParams,
    *,
    region: Bools,
    space: HairSpace,
    normals: DirectionGrid | None = None,
    detail: HelixDetailParams = HelixDetailParams(),
    progress: Progress = NO_PROGRESS,
) -> StrandSet:
    """All strands from guides (Z-22, M-39); see grow_strands."""
    require(len(guides.points) > 0, "there are no guides to fill the hair from; grow guides first")
    progress(0.0, "Roots of all strands")
    n_roots = int(np.ceil(_SPARE * params.n_strands))
    roots = scatter_roots(head, region, n_roots, params.seed + 1).points
    random = np.random.default_rng(params.seed + 2)
    cover = _Cover(guides.points, shape.open, space, params)
    points = np.empty((n_roots, params.n_points, 3), np.float32)
    main = np.empty(n_roots, np.int32)
    order = random.permutation(n_roots)
    # the first ones show where hair is thin, and the others go there
    parts = np.split(order, [int(_FIRST * n_roots)])
    for number, part in enumerate(parts):
        progress(0.2 + 0.3 * number, "Strands between guides")
        part.sort()
        if number == 1:
            _add_roots_in_need(roots, part, head, region, guides.points[:, 0], cover.needs, random)
        points[part], main[part] = _between(roots[part], guides, cover.needs, space, params, random)
        if number == 0:
            cover.find_thin(points[part])
    if normals is not None:
        progress(0.65, "Depth of curls")
        points = add_detail(from_dense(points), normals, detail).points.reshape(points.shape)
        keep_in_shape(points, params.clearance, space.distances, space.directions, space.origin, space.cell)
    progress(0.7, "Strands into the masks")
    _obey_masks(points, mask_limits(views, head), space, params)
    good = np.flatnonzero(polyline_lengths(points) >= _SHORTEST)
    if len(good) > params.n_strands:
        good = np.sort(random.choice(good, params.n_strands, replace=False))
    progress(1.0, "Strands")
    return from_dense(points[good], {"guide": main[good]})


def _between(
    roots: Float32,
    guides: Guides,
    needs: Float64,
    space: HairSpace,
    params: GrowthParams,
    random: np.random.Generator,
) -> tuple[Float32, Int32]:
    """Strands (S, N, 3) from roots (S, 3) between guides, inside the shape, along the field; and their main guides."""
    chosen, weights, main = _choose(roots, guides, needs, params, random)
    frames = transport_frames(guides.points, guides.normals)
    points = np.empty((len(roots), params.n_points, 3), np.float32)
    blend_guides(roots, chosen, weights, guides.points, frames, _spread(guides.points), points)
    points[:, 0] = roots
    fields = (space.distances, space.directions, space.origin, space.cell)
    keep_in_shape(points, params.clearance, *fields)
    follow_field(points, _FOLLOW, params.clearance, *fields)
    keep_in_shape(points, params.clearance, *fields)
    return points, main


def _add_roots_in_need(
    roots: Float32, part: Int64, head: Head, region: Bools, starts: Float32, needs: Float64, random: np.random.Generator
) -> None:
    """Move some of the roots (S, 3) of a part to the starts (G, 3) of guides that are needed much more than others.

    What hangs far from the scalp, a tail above all, has all its guides rooted in a small place, which even roots leave
    with too little hair. In other hair no guide is needed so much.
    """
    missed = np.where(needs > _MUCH * needs.mean(), needs, 0.0)
    count = int(min(missed.sum() / needs.sum(), _MOST_MOVED) * len(part))
    if count == 0:
        return
    guide = random.choice(len(starts), count, p=missed / missed.sum())
    places = starts[guide] + random.normal(0.0, _AROUND_GUIDE, (count, 3))
    chosen = random.choice(part, count, replace=False)
    roots[chosen] = HeadSurface(submesh(head, region)).closest_points(places)[0]


def _spread(guides: Float32) -> Float32:
    """(G, N): how far guides (G, N, 3) are from those next to them, over how far their roots are; at most 1.

    Hair that is tied or gathers in a wisp comes together as its guides do: a rigid copy would leave the tail.
    """
    count = min(_NEIGHBOURS + 1, len(guides))
    if count < 2:
        return np.ones(guides.shape[:2], np.float32)
    rooted, near = cKDTree(guides[:, 0]).query(guides[:, 0], k=count)
    apart = np.linalg.norm(guides[near[:, 1:]] - guides[:, None], axis=3)
    ratio = np.median(apart / np.maximum(rooted[:, 1:, None], 1e-4), axis=1)
    return np.asarray(np.clip(ratio, 0.0, 1.0), np.float32)


def _obey_masks(points: Float32, limits: MaskLimits, space: HairSpace, params: GrowthParams) -> None:
    """Bend and cut strands (S, N, 3) in place, and leave none in the head."""
    solid = (space.solid.distance, space.solid.origin, space.solid.cell)
    bend_into_masks(points, limits, space, params.clearance, params.mask_margin)
    push_out(points, params.clearance, *solid)
    # out of the head may be off a mask again
    bend_into_masks(points, limits, space, params.clearance, params.mask_margin, rounds=0)
    push_out(points, params.clearance, *solid)


def _choose(
    roots: Float32, guides: Guides, needs: Float64, params: GrowthParams, random: np.random.Generator
) -> tuple[Int32, Float32, Int32]:
    """Guides (S, K) of each strand, their weights, and the main one (S,)."""
    starts = guides.points[:, 0]
    count = min(_NEAR, len(starts))
    distances, near = cKDTree(starts).query(roots, k=count)
    distances, near = distances.reshape(len(roots), count), near.reshape(len(roots), count).astype(np.int32)
    reach = float(np.median(distances[:, 0])) + 1e-6
    wish = needs[near] / (distances**2 + reach**2)
    until = np.cumsum(wish, axis=1)
    pick = (random.random(len(roots))[:, None] * until[:, -1:] > until).sum(axis=1)
    rows = np.arange(len(roots))
    primary = near[rows, np.minimum(pick, count - 1)]
    # the nearest ones and the main one
    n_blended = min(params.n_blended, count)
    chosen, apart = near[:, :n_blended].copy(), distances[:, :n_blended].copy()
    missing = ~(chosen == primary[:, None]).any(axis=1)
    chosen[missing, -1] = primary[missing]
    apart[missing, -1] = distances[rows, np.minimum(pick, count - 1)][missing]
    weights = np.empty(chosen.shape, np.float32)
    choose_blends(
        primary, chosen, apart, guides.points, polyline_lengths(guides.points), params.shape_distance,
        random.random(chosen.shape), reach, weights,
    )  # fmt: skip
    return chosen, weights, primary


class _Cover:
    """Which guide covers which place of the outer surface, and how much each guide is needed.

    needs : (G,) how often a guide should be copied: by the surface that it is the nearest to, at least a little.
    """

    def __init__(self, guides: Float32, surface: Mesh, space: HairSpace, params: GrowthParams) -> None:
        self.space = space
        self.samples = surface_samples(surface, params)
        self.owner = np.zeros(len(self.samples), np.int64)
        self.n_guides = len(guides)
        middles, guide = self._shallow(guides)
        if len(middles):
            _, index = cKDTree(middles).query(self.samples)
            self.owner = guide[index]
        self.needs = self._needs(np.ones(len(self.samples)))

    def find_thin(self, strands: Float32) -> None:
        """Let guides be needed more where strands (S, N, 3) leave the surface thinly covered, and less elsewhere."""
        middles, strand = self._shallow(strands)
        if len(middles) == 0:
            return
        lengths = polyline_lengths(strands)[strand]
        _, sample = cKDTree(self.samples).query(middles)
        density = np.bincount(sample, lengths, minlength=len(self.samples))
        self.needs = self._needs(np.clip(np.median(density) / np.maximum(density, 1e-9), *_THIN))

    def _needs(self, wanted: Float64) -> Float64:
        share = np.bincount(self.owner, wanted, minlength=self.n_guides)
        return np.asarray(share * (self.n_guides / len(self.samples)) + _LEAST_NEED)

    def _shallow(self, strands: Float32) -> tuple[Float32, Int64]:
        """Middles of segments near the outer surface, and their strands."""
        middles = (0.5 * (strands[:, 1:] + strands[:, :-1])).reshape(-1, 3)
        strand = np.repeat(np.arange(len(strands)), strands.shape[1] - 1)
        near = self.space.at(middles)[:, OUTER] < _SHALLOW
        return middles[near], strand[near]


__all__ = ["GrowthParams", "MaskLimits", "fill_strands", "grow_strands"]
