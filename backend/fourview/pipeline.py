"""The whole way from photos to strands (Zhang et al. 2017, sec. 4), stage by stage; each stage also runs alone."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import require
from ..progress import NO_PROGRESS, Progress, subrange
from ..types import Float32, Head, StrandSet
from .appearance import strand_colours
from .database import HairDatabase, SearchParams, search
from .detail import HelixDetailParams
from .directions import DirectionParams, SurfaceDirections, find_directions
from .filling import grow_strands
from .growth import GrowthParams
from .quality import quality_report
from .shape import RoughShape, ShapeParams, find_shape
from .surface import HairSurface, SurfaceParams, make_surface
from .texture import HairTexture, SurfaceTextureParams, synthesize_texture
from .views import MAX_VIEWS, DirectionStroke, View
from .volume import direction_volume, normal_volume

# which part of the whole progress each stage has
STAGES = {
    "shape": (0.0, 0.2),
    "texture": (0.2, 0.7),
    "directions": (0.7, 0.85),
    "strands": (0.85, 0.97),
    "report": (0.97, 1.0),
}


@dataclass(frozen=True, slots=True)
class FourViewParams:
    """Settings of the four stages. n_tried : hairstyles of the database whose deformed shapes are compared."""

    search: SearchParams = field(default_factory=SearchParams)
    shape: ShapeParams = field(default_factory=ShapeParams)
    surface: SurfaceParams = field(default_factory=SurfaceParams)
    texture: SurfaceTextureParams = field(default_factory=SurfaceTextureParams)
    directions: DirectionParams = field(default_factory=DirectionParams)
    strands: GrowthParams = field(default_factory=GrowthParams)
    detail: HelixDetailParams = field(default_factory=HelixDetailParams)
    with_detail: bool = True
    n_tried: int = 1

    def __post_init__(self) -> None:
        require(1 <= self.n_tried <= 20, f"n_tried is {self.n_tried}; take 1 to 20")


@dataclass(frozen=True, slots=True)
class FourViewResult:
    """Everything that the stages made. strands : with the attribute `groom_color` (S, 4) float32, linear RGBA."""

    shape: RoughShape
    surface: HairSurface
    texture: HairTexture
    directions: SurfaceDirections
    strands: StrandSet
    report: dict[str, Any]


def model_hair(
    views: Sequence[View],
    head: Head,
    database: HairDatabase,
    strokes: Sequence[DirectionStroke] = (),
    params: FourViewParams = FourViewParams(),
    *,
    exclude: Collection[str] = (),
    progress: Progress = NO_PROGRESS,
) -> FourViewResult:
    """Photos to a head of strands.

    Parameters
    ----------
    views : 1 to 8 photos with masks and cameras. head : with a scalp. exclude : hairstyles of the database to leave out
        (names).

    Raises
    ------
    InputError : no views or too many, masks that no shape can come near.
    """
    part = {stage: subrange(progress, start, end) for stage, (start, end) in STAGES.items()}
    shape = rough_shape(views, head, database, params, exclude=exclude, progress=part["shape"])
    surface, texture = hair_texture(shape, views, params, progress=part["texture"])
    directions = hair_directions(shape, surface, texture, views, head, strokes, params, part["directions"])
    strands = hair_strands(shape, directions, views, head, params, progress=part["strands"])
    part["report"](0.0, "Comparing with the photos")
    report = quality_report(strands, views, head)
    report |= {"style": shape.style, "shape_iou": shape.mask_iou.tolist(), "remarks": list(shape.remarks)}
    return FourViewResult(shape, surface, texture, directions, strands, report)


def rough_shape(
    views: Sequence[View],
    head: Head,
    database: HairDatabase,
    params: FourViewParams = FourViewParams(),
    *,
    exclude: Collection[str] = (),
    progress: Progress = NO_PROGRESS,
) -> RoughShape:
    """Database search and rough shape (sec. 4.1; Z-3 ... Z-7): of `n_tried` hairstyles the shape that fits best."""
    require(1 <= len(views) <= MAX_VIEWS, f"{len(views)} views; give 1 to {MAX_VIEWS}")
    progress(0.0, "Searching the database")
    matches = search(database, views, head, n_best=params.n_tried, exclude=exclude, params=params.search)
    shapes = []
    for number, match in enumerate(matches):
        part = subrange(progress, 0.1 + 0.9 * number / len(matches), 0.1 + 0.9 * (number + 1) / len(matches))
        strands = database.strands(match.index, head)
        shapes.append(find_shape(strands, match.name, views, head, params.shape, progress=part))
    return max(shapes, key=lambda shape: float(shape.mask_iou.min()))


def hair_texture(
    shape: RoughShape, views: Sequence[View], params: FourViewParams = FourViewParams(), *,
    progress: Progress = NO_PROGRESS,
) -> tuple[HairSurface, HairTexture]:  # fmt: skip
    """The texture on the open surface (sec. 4.2, 4.3; Z-8 ... Z-18)."""
    surface = make_surface(shape.open, params.surface, progress=subrange(progress, 0.0, 0.2))
    part = subrange(progress, 0.2, 1.0)
    return surface, synthesize_texture(surface, shape, _agreeing(shape, views), params.texture, progress=part)


def hair_directions(
    shape: RoughShape,
    surface: HairSurface,
    texture: HairTexture,
    views: Sequence[View],
    head: Head,
    strokes: Sequence[DirectionStroke] = (),
    params: FourViewParams = FourViewParams(),
    progress: Progress = NO_PROGRESS,
) -> SurfaceDirections:
    """Growth directions on the surface (sec. 4.4; Z-19)."""
    agreeing = _agreeing(shape, views)
    return find_directions(texture, surface, shape, agreeing, head, strokes, params.directions, progress=progress)


def hair_strands(
    shape: RoughShape,
    directions: SurfaceDirections,
    views: Sequence[View],
    head: Head,
    params: FourViewParams = FourViewParams(),
    *,
    progress: Progress = NO_PROGRESS,
) -> StrandSet:
    """The direction volume and the strands (sec. 4.4 ... 4.6; Z-20 ... Z-23), coloured by the photos."""
    views = _agreeing(shape, views)
    progress(0.0, "Filling the volume with directions")
    volume = direction_volume(directions, shape, head, params.directions)
    normals = normal_volume(directions, shape, head, params.directions) if params.with_detail else None
    part = subrange(progress, 0.3, 0.9)
    strands = grow_strands(
        volume, shape, views, head, params.strands, normals=normals, detail=params.detail, progress=part
    )
    progress(0.9, "Taking colours from the photos")
    colours = linear_rgba(strand_colours(strands, views, head))
    return StrandSet(
        strands.points, strands.offsets, strands.point_attributes, {**strands.strand_attributes, "groom_color": colours}
    )


def _agreeing(shape: RoughShape, views: Sequence[View]) -> list[View]:
    """The views but those that the shape had to leave out: what they show is not where it would be on this shape."""
    return [view for view in views if view.name not in shape.left_out]


def linear_rgba(colours: Float32) -> Float32:
    """(n, 4) float32, opaque and linear as renderers want them, of sRGB colours (n, 3) in [0, 1]."""
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.concatenate([linear, np.ones((len(linear), 1))], axis=1), np.float32)
