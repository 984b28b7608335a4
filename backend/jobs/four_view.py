"""The jobs of the four-view wizard, one a step; each step's outputs are inputs of the later ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import require
from ..fields.matting import find_face, first_guess, segment
from ..fourview.database import HairDatabase, open_database
from ..fourview.pipeline import FourViewParams, hair_directions, hair_strands, hair_texture, rough_shape
from ..fourview.placement import find_swapped, place_cameras
from ..fourview.quality import quality_report
from ..fourview.views import View
from ..progress import Progress, subrange

Values = dict[str, Any]


@dataclass(frozen=True, slots=True)
class SegmentParams:
    """Settings of the job `four_view_segment`. iterations : of the graph cut."""

    iterations: int = 5

    def __post_init__(self) -> None:
        require(1 <= self.iterations <= 50, f"iterations is {self.iterations}; take 1 to 50")


def run_segment(inputs: Values, params: SegmentParams, progress: Progress) -> Values:
    """The mask of a photo (Z-1).

    image (H, W, 3) uint8; hair, background: scribbles (H, W) bool, or None; guess: mask to start from, or None
    -> mask (H, W) bool. Without scribbles the mask is the first guess.
    """
    image, hair, background = inputs["image"], inputs.get("hair"), inputs.get("background")
    progress(0.0, "Looking for hair")
    guess = inputs.get("guess")
    if guess is None:
        guess = first_guess(image)
    none = np.zeros(image.shape[:2], np.bool_)
    hair, background = (none if scribbles is None else scribbles for scribbles in (hair, background))
    if not hair.any() and not background.any():
        return {"mask": guess}
    progress(0.4, "Cutting out the hair")
    return {"mask": segment(image, hair, background, guess, iterations=params.iterations)}


def run_place(inputs: Values, params: None, progress: Progress) -> Values:
    """First cameras (Z-2).

    masks {name: (H, W) bool}, head; landmarks {name: {landmark: [x, y]}}, images {name: (H, W, 3)} or nothing: a face
    is looked for in the front view; folders, exclude: as for the shape -> cameras {name: Camera}, remarks [text].
    """
    masks = inputs["masks"]
    front = (inputs.get("images") or {}).get("front")
    progress(0.0, "Looking for a face")
    face = find_face(front) if "front" in masks and front is not None else None
    progress(0.2, "Placing cameras")
    cameras = place_cameras(
        masks, inputs["head"], inputs.get("landmarks"), face=face, database=_database(inputs),
        exclude=inputs.get("exclude") or (),
    )  # fmt: skip
    return {"cameras": cameras, "remarks": find_swapped({name: mask for name, mask in masks.items() if name != "top"})}


def run_shape(inputs: Values, params: FourViewParams, progress: Progress) -> Values:
    """The rough shape (Z-3 ... Z-7): views [View], head; folders [path] of own hairstyles -> shape, remarks [text]."""
    database = _database(inputs)
    shape = rough_shape(
        inputs["views"], inputs["head"], database, params, exclude=inputs.get("exclude") or (), progress=progress
    )
    return {"shape": shape, "remarks": [*shape.remarks, *database.remarks, *swap_remarks(inputs["views"])]}


def run_texture(inputs: Values, params: FourViewParams, progress: Progress) -> Values:
    """The hair texture (Z-8 ... Z-18): views, shape -> surface, texture, image (N, N, 3) uint8."""
    surface, texture = hair_texture(inputs["shape"], inputs["views"], params, progress=progress)
    return {"surface": surface, "texture": texture, "image": texture.image()}


def run_directions(inputs: Values, params: FourViewParams, progress: Progress) -> Values:
    """Growth directions (Z-19): views, head, strokes [DirectionStroke], shape, surface, texture -> directions."""
    stages = inputs["shape"], inputs["surface"], inputs["texture"], inputs["views"], inputs["head"]
    return {"directions": hair_directions(*stages, inputs.get("strokes") or (), params, progress)}


def run_strands(inputs: Values, params: FourViewParams, progress: Progress) -> Values:
    """Strands (Z-20 ... Z-23): views, head, shape, directions -> strands StrandSet, report."""
    views, head = inputs["views"], inputs["head"]
    part = subrange(progress, 0.0, 0.9)
    strands = hair_strands(inputs["shape"], inputs["directions"], views, head, params, progress=part)
    progress(0.9, "Comparing with the photos")
    return {"strands": strands, "report": quality_report(strands, views, head)}


def swap_remarks(views: Sequence[View]) -> list[str]:
    """Level views that seem to be swapped or mirrored."""
    return find_swapped({view.name: view.mask for view in views if view.name in ("front", "back", "left", "right")})


def _database(inputs: Values) -> HairDatabase:
    return open_database(inputs.get("database"), inputs.get("folders") or ())
