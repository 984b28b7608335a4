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
from ..geometry.head import HeadSurface
from ..geometry.roots import scatter_roots
from ..geometry.strands import from_dense, polyline_lengths
from ..progress import NO_PROGRESS, Progress, subrange
from ..types import Bools, Float32, Float64, Head, Int32, Mesh, StrandSet
from ._filling_kernels import blend_guides, choose_blends, keep_in_shape, push_out
from ._growth_kernels import follow_field
from .growth import GrowthParams, Guides, grow_guides, surface_samples
from .hair_space import OUTER, HairShape, HairSpace, make_hair_space
from .masks import MaskLimits, bend_into_masks, hairy_region, mask_limits
from .views import View

_NEAR = 10  # guides around a root that it may be copied from
_SPARE = 1.06  # roots more than wanted: some grow nothing that lies in the masks
_SHORTEST = 0.004  # metres of hair that is worth keeping
_FOLLOW = 0.8  # of the field in the direction of a strand between guides


def grow_strands(
    volume: DirectionGrid,
    shape: HairShape,
    views: Sequence[View],
    head: Head,
    params: GrowthParams = GrowthParams(),
    *,
    progress: Progress = NO_PROGRESS,
) -> StrandSet:
    """Hair that follows the volume and fills the photos' masks (Z-21, Z-22): guides, then all strands.

    Parameters
    ----------
    volume : directions from root to tip on a grid in world space, metres (Z-20).
    shape : closed mesh G_DEF and open outer surface G. views : with masks; may be none.

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
    return fill_strands(guides, shape, views, head, params, region=region, space=space,
                        progress=subrange(progress, 0.5, 1.0))  # fmt: skip


def fill_strands(
    guides: Guides,
    shape: HairShape,
    views: Sequence[View],
    head: Head,
    params: GrowthParams,
    *,
    region: Bools,
    space: HairSpace,
    progress: Progress = NO_PROGRESS,
) -> StrandSet:
    """All strands from guides (Z-22, M-39); see grow_strands."""
    require(len(guides.points) > 0, "there are no guides to fill the hair from; grow guides first")
    progress(0.0, "Roots of all strands")
    n_roots = int(np.ceil(_SPARE * params.n_strands))
    roots = scatter_roots(head, region, n_roots, params.seed + 1).points
    random = np.random.default_rng(params.seed + 2)
    progress(0.3, "Strands between guides")
    chosen, weights, primary = _choose(roots, guides, _needs(guides.points, shape.open, space, params), params, random)
    frames = transport_frames(guides.points, guides.normals)
    points = np.empty((len(roots), params.n_points, 3), np.float32)
    blend_guides(roots, chosen, weights, guides.points, frames, points)
    points[:, 0] = roots
    progress(0.5, "Strands into the shape")
    keep_in_shape(points, params.clearance, space.distances, space.directions, space.origin, space.cell)
    follow_field(points, _FOLLOW, params.clearance, space.distances, space.directions, space.origin, space.cell)
    keep_in_shape(points, params.clearance, space.distances, space.directions, space.origin, space.cell)
    progress(0.6, "Strands into the masks")
    limits = mask_limits(views, head)
    bend_into_masks(points, limits, space, params.clearance, params.mask_margin)
    push_out(points, params.clearance, space.solid.distance, space.solid.origin, space.solid.cell)
    good = np.flatnonzero(polyline_lengths(points) >= _SHORTEST)
    if len(good) > params.n_strands:
        good = np.sort(random.choice(good, params.n_strands, replace=False))
    progress(1.0, "Strands")
    return from_dense(points[good], {"guide": primary[good]})


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


def _needs(guides: Float32, surface: Mesh, space: HairSpace, params: GrowthParams) -> Float64:
    """(G,) how much of the outer surface each guide is the nearest to, at least a little."""
    samples = surface_samples(surface, params)
    middles = 0.5 * (guides[:, 1:] + guides[:, :-1]).reshape(-1, 3)
    owner = np.repeat(np.arange(len(guides)), guides.shape[1] - 1)
    shallow = space.at(middles)[:, OUTER] < 0.012
    needs = np.full(len(guides), 0.25)
    if shallow.any() and len(samples):
        _, index = cKDTree(middles[shallow]).query(samples)
        needs += np.bincount(owner[shallow][index], minlength=len(guides)) * (len(guides) / len(samples))
    return needs


__all__ = ["GrowthParams", "MaskLimits", "fill_strands", "grow_strands"]
