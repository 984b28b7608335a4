"""Which way hair grows at every place of the surface: orientation from the texture, signs from strokes and a guess.

Zhang et al. 2017, sec. 4.4 (Z-19); M-37 for the orientation, M-38 for the signs. The guess without any stroke: hair
grows like that of the database hairstyle that was bent to this shape, else down and away from the crown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree

from ..errors import require
from ..progress import NO_PROGRESS, Progress
from ..types import Float32, Float64, Head, Mesh, StrandSet, check_array
from .photo_orientations import photo_orientations
from .regions import Graph, Regions, axes_of, fill_regions, make_graph, make_regions, outer_products, smooth, unit
from .signs import SignParams, solve_signs
from .strokes import stroke_directions
from .surface import HairSurface
from .tangent_filter import TangentFilterParams, texel_orientations
from .texels import TexelMap
from .texture import HairTexture
from .views import DirectionStroke, View

_COARSE = 0.05  # weight of a region's orientation for its texels, against a confidence of 1
_ALONE = 6.0  # times that gravity and the crown count more where there is no hair of the database


class Shape(Protocol):
    """What directions need of a `shape.RoughShape`."""

    @property
    def closed(self) -> Mesh:
        """G_DEF."""

    @property
    def strands(self) -> StrandSet:
        """Hair of the database in this shape; may have no strands."""


@dataclass(frozen=True, slots=True)
class DirectionParams:
    """Settings of surface_orientations, find_directions and direction_volume; lengths in metres."""

    max_texels: int = 200_000  # of the texture's scale that the filters run on: about a photo's pixel wide or more
    photo_weight: float = 1.0  # of the photos' own orientation against the texture's, where they show it; paper: 0
    region_size: float = 0.008  # between the middles of regions that share a sign
    smoothing: float = 1.0  # of orientations between neighbouring texels, against a confidence of 1
    database_reach: float = 0.02  # from the surface to the hair of the database that tells the direction
    database_unseen: float = 0.4  # weight of its orientation where no photo sees the surface; 1 is a clear texture
    database_seen: float = 0.02  # and where one does
    stroke_reach: float = 0.003  # from a stroke to the texels under it
    gravity: float = 0.1  # pull of the signs down, against hair of the database that all agrees
    outward: float = 0.1  # and away from the crown
    cells: int = 128  # of the volume along its longest side
    surface_weight: float = 4.0  # w: how much the volume keeps to the surface, against smoothness (1)
    root_weight: float = 1.0  # and to the scalp's normals at the roots
    filters: TangentFilterParams = field(default_factory=TangentFilterParams)
    signs: SignParams = field(default_factory=SignParams)

    def __post_init__(self) -> None:
        require(1000 <= self.max_texels <= 20_000_000, f"max_texels is {self.max_texels}; it must be in 1000..20000000")
        require(0.001 <= self.region_size <= 0.1, f"region_size is {self.region_size} m; it must be in 0.001..0.1")
        require(0.001 <= self.database_reach <= 1, f"database_reach is {self.database_reach} m; it must be in 0.001..1")
        require(0.0005 <= self.stroke_reach <= 0.1, f"stroke_reach is {self.stroke_reach} m; it must be in 0.0005..0.1")
        require(16 <= self.cells <= 400, f"cells is {self.cells}; it must be in 16..400")
        for name in ("photo_weight", "smoothing", "database_unseen", "database_seen", "gravity", "outward"):
            require(0 <= getattr(self, name) <= 100, f"{name} is {getattr(self, name)}; it must be in 0..100")
        for name in ("surface_weight", "root_weight"):
            require(1e-4 <= getattr(self, name) <= 1e4, f"{name} is {getattr(self, name)}; it must be in 1e-4..1e4")


@dataclass(frozen=True, slots=True)
class SurfaceOrientations:
    """Unsigned orientation at the T texels of one scale.

    texels : the scale. orientations : (T, 3) float32, unit, tangential, world space; the sign means nothing.
    confidence : (T,) float32 in [0, 1]. coverage : (T,) float32 in [0, 1], how well a photo sees the texel.
    """

    texels: TexelMap
    orientations: Float32
    confidence: Float32
    coverage: Float32


@dataclass(frozen=True, slots=True)
class SurfaceDirections:
    """Which way hair grows at n places of the surface.

    points : (n, 3) float32, metres, world space. directions : (n, 3) float32, unit, tangential, from root to tip.
    confidence : (n,) float32 in [0, 1]. normals : (n, 3) float32, unit, outwards.
    """

    points: Float32
    directions: Float32
    confidence: Float32
    normals: Float32

    def __post_init__(self) -> None:
        count = len(self.points)
        check_array("points", self.points, np.float32, (None, 3))
        check_array("directions", self.directions, np.float32, (count, 3))
        check_array("confidence", self.confidence, np.float32, (count,))
        check_array("normals", self.normals, np.float32, (count, 3))


def surface_orientations(
    texture: HairTexture, surface: HairSurface, params: DirectionParams = DirectionParams()
) -> SurfaceOrientations:
    """Unsigned orientation of the hair texture on the tangent plane of each texel (Z-19, M-37).

    The finest scale with at most `max_texels` texels is used, its colours averaged from the finest.

    Raises
    ------
    InputError : a texture that does not belong to the surface.
    """
    finest = surface.levels[-1].texels
    fits = texture.size == finest.size and np.array_equal(texture.texels, finest.texels)
    require(fits, "the texture was made for another surface; run the texture step again")
    texels = finest
    for level in surface.levels[::-1]:
        texels = level.texels
        if texels.n_texels <= params.max_texels:
            break
    both = np.concatenate([texture.colour, texture.coverage[:, None]], axis=1)
    values = both if texels is finest else reduced(both, finest, texels)
    colours, coverage = np.ascontiguousarray(values[:, :3]), np.ascontiguousarray(values[:, 3])
    orientations, confidence = texel_orientations(texels, colours, params.filters)
    return SurfaceOrientations(texels, orientations, confidence, coverage)


def reduced(values: Float32, fine: TexelMap, coarse: TexelMap) -> Float32:
    """(T, C) float32: values of the fine texels averaged over each coarse one's square of the atlas."""
    factor = fine.size // coarse.size
    places = (fine.texels // fine.size // factor) * coarse.size + fine.texels % fine.size // factor
    counts = np.bincount(places, minlength=coarse.size**2)[coarse.texels]
    sums = [np.bincount(places, column, coarse.size**2)[coarse.texels] for column in values.T]
    means = np.stack(sums, axis=1) / np.maximum(counts, 1)[:, None]
    empty = counts == 0
    if empty.any():
        _, nearest = cKDTree(fine.points).query(coarse.points[empty])
        means[empty] = values[nearest]
    return np.asarray(means, np.float32)


def find_directions(
    texture: HairTexture,
    surface: HairSurface,
    shape: Shape,
    views: Sequence[View],
    head: Head,
    strokes: Sequence[DirectionStroke] = (),
    params: DirectionParams = DirectionParams(),
    *,
    progress: Progress = NO_PROGRESS,
) -> SurfaceDirections:
    """Directions from root to tip over the surface (Z-19, M-37, M-38).

    Parameters
    ----------
    texture, surface : the hair texture and what it lies on. shape : of the hair, with the database's hair in it.
    views : the photos; where they see the surface their own orientation counts beside the texture's, and where none
        does the database's hair is followed.
    strokes : from root to tip; they bind the sign of what lies under them, the rest follows.

    Raises
    ------
    InputError : a texture that does not belong to the surface, a stroke without a point on the hair.
    """
    progress(0.0, "Orientation of the texture")
    found = surface_orientations(texture, surface, params)
    progress(0.6, "Directions of the database's hair")
    texels = found.texels
    graph = make_graph(texels.edges, texels.n_texels)
    steps = max(int(params.region_size / texels.spacing), 1)
    regions = make_regions(graph, texels.edges, texels.points, texels.normals, steps)
    database, agreement = strand_directions(shape.strands, regions.points, params.database_reach)
    progress(0.7, "Filling")
    photos = photo_orientations(texels, views, shape.closed) if params.photo_weight > 0 else None
    known = _known(found, photos, params.photo_weight)
    axes, coherence, orientations = _fill(found, known, graph, regions, database, agreement, params)
    progress(0.85, "Signs")
    drawn = stroke_directions(strokes, surface.mesh, texels, params.stroke_reach)
    signs = _region_signs(regions, axes, coherence, database, agreement, drawn, head, params)
    directions = _signed(orientations, graph, regions, axes * signs[:, None])
    progress(1.0, "Directions")
    return SurfaceDirections(texels.points, directions, found.confidence, texels.normals)


def strand_directions(strands: StrandSet, points: Float64, reach: float) -> tuple[Float64, Float64]:
    """Mean direction (n, 3) float64 of the hair near points (n, 3), unit or 0, and how far it agrees (n,) in [0, 1].

    Segments count with a Gaussian of sigma reach / 2, up to two reaches away; agreement is the mean's length.
    """
    none = np.zeros((len(points), 3)), np.zeros(len(points))
    if strands.n_strands == 0 or len(strands.points) < 2:
        return none
    inner = np.ones(len(strands.points) - 1, np.bool_)
    inner[strands.offsets[1:-1] - 1] = False
    first = np.flatnonzero(inner)
    first = first[:: max(len(first) // 200_000, 1)]
    if len(first) == 0:
        return none
    middles = 0.5 * (strands.points[first] + strands.points[first + 1])
    tangents = unit(strands.points[first + 1] - strands.points[first])
    n_near = min(24, len(first))
    distance, nearest = cKDTree(middles).query(points, k=n_near, distance_upper_bound=2.0 * reach)
    distance, nearest = distance.reshape(len(points), n_near), nearest.reshape(len(points), n_near)
    known = np.isfinite(distance)
    weights = np.where(known, np.exp(-2.0 * (np.where(known, distance, 0.0) / reach) ** 2), 0.0)
    sums = np.einsum("nk,nkc->nc", weights, tangents[np.where(known, nearest, 0)])
    total = weights.sum(axis=1)
    agreement = np.linalg.norm(sums, axis=1) / np.maximum(total, 1e-12)
    return unit(sums), np.where(total > 0, np.minimum(agreement, 1.0), 0.0)


def _known(
    found: SurfaceOrientations, photos: tuple[Float32, Float32] | None, photo_weight: float
) -> tuple[Float32, Float32]:
    """Tensors (T, 6) of what texture and photos tell of the texels' orientation, times weights (T,); and these."""
    weights = found.confidence * (0.25 + 0.75 * _seen(found))
    tensors = outer_products(found.orientations) * weights[:, None]
    if photos is None:
        return tensors, weights
    scale = np.float32(photo_weight)
    return tensors + scale * photos[0], weights + scale * photos[1]


def _seen(found: SurfaceOrientations) -> Float32:
    """(T,) from 0 where no photo sees a texel well to 1."""
    return np.clip(found.coverage / np.float32(0.5), np.float32(0.0), np.float32(1.0))


def _fill(
    found: SurfaceOrientations, known: tuple[Float32, Float32], graph: Graph, regions: Regions, database: Float64,
    agreement: Float64, params: DirectionParams,
) -> tuple[Float64, Float64, Float32]:  # fmt: skip
    """Axes (R, 3) and coherence (R,) of the regions, and orientations (T, 3) of the texels, smooth and everywhere.

    Where a photo sees the surface what is known of the texels counts, where none does the hair of the database too.
    """
    tensors, weights = known
    seen = _seen(found)
    sums, totals = regions.sums(tensors), regions.sums(np.stack([weights, seen], axis=1))
    # the hair of the database where it lies along the surface
    along = database - np.einsum("rc,rc->r", database, regions.normals)[:, None] * regions.normals
    size = np.linalg.norm(along, axis=1)
    unseen = 1.0 - totals[:, 1] / regions.sizes
    own = (params.database_seen + params.database_unseen * unseen) * agreement * size * regions.sizes
    weight = totals[:, 0] + own
    mean = (sums + own[:, None] * outer_products(unit(along))) / np.maximum(weight, 1e-12)[:, None]
    filled = fill_regions(regions, mean, weight / max(float(regions.sizes.mean()), 1.0), 0.02)
    axes, coherence = axes_of(filled, regions.normals)
    # texels: their own where they are clear, else their region's
    base = (_COARSE + params.database_unseen * (1.0 - seen)).astype(np.float32)
    coarse = filled[regions.region].astype(np.float32)
    blended = (tensors + base[:, None] * coarse) / (weights + base)[:, None]
    smoothed = smooth(graph, blended, (weights + base).astype(np.float32), coarse, params.smoothing, 12)
    orientations, _ = axes_of(smoothed, found.texels.normals)
    return axes.astype(np.float64), coherence.astype(np.float64), orientations


def _region_signs(
    regions: Regions, axes: Float64, coherence: Float64, database: Float64, agreement: Float64, drawn: Float32,
    head: Head, params: DirectionParams,
) -> Float64:  # fmt: skip
    """(R,) -1 or 1: which way along its axis each region grows."""
    a, b = regions.edges[:, 0], regions.edges[:, 1]
    dots = np.einsum("ec,ec->e", axes[a], axes[b])
    couplings = dots * np.abs(dots) * np.sqrt(coherence[a] * coherence[b]) * regions.borders / regions.borders.mean()
    plain = params.gravity * np.array([0.0, 0.0, -1.0]) + params.outward * unit(regions.points - _crown(head))
    # without hair of the database to go by, these must hold a surface all around against its own continuity
    guess = agreement[:, None] * database + plain * (1.0 + _ALONE * (1.0 - agreement[:, None]))
    size = np.sqrt(regions.sizes / regions.sizes.mean())
    fields = np.einsum("rc,rc->r", axes, guess) * size * (0.1 + coherence)
    stroked = np.einsum("rc,rc->r", axes, regions.sums(drawn))
    lengths = regions.sums(np.linalg.norm(drawn, axis=1)[:, None])[:, 0]
    # a stroke across the hair says nothing about its sign
    binds = np.abs(stroked) > 0.3 * np.maximum(lengths, 1e-9)
    fixed = np.where(binds, np.sign(stroked), 0).astype(np.int8)
    return solve_signs(regions.edges, couplings, fields, fixed, params.signs).signs.astype(np.float64)


def _crown(head: Head) -> Float64:
    """(3,) the highest point of the scalp's middle, a little to the back; of the whole head when no scalp is marked."""
    triangles = head.triangles[head.scalp] if head.scalp.any() else head.triangles
    places = head.vertices[np.unique(triangles)].astype(np.float64)
    low, high = places.min(axis=0), places.max(axis=0)
    middle = 0.5 * (low + high)
    return np.array([middle[0], middle[1] + 0.15 * (high[1] - low[1]), high[2]])


def _signed(orientations: Float32, graph: Graph, regions: Regions, directions: Float64) -> Float32:
    """(T, 3) float32: orientations with the sign of their region's direction, the regions' borders smoothed."""
    coarse = directions[regions.region].astype(np.float32)
    ones = np.ones(len(coarse), np.float32)
    reference = smooth(graph, coarse, 0.05 * ones, coarse, 1.0, 20)
    signs = np.where(np.einsum("tc,tc->t", orientations, reference) < 0, np.float32(-1), np.float32(1))
    return np.asarray(orientations * signs[:, None], np.float32)
