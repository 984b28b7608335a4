"""Hairstyles of the database that Hairloom's own tools make of grown ones: synthesis, detail transfer, the comb."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from hairloom.editing.comb import comb
from hairloom.editing.strokes import CombParams, Stroke, View
from hairloom.geometry.collider import comb_collider
from hairloom.geometry.scalp_space import fit_scalp_space
from hairloom.jobs.cluster_wisps import labels_of_strands
from hairloom.jobs.transfer_details import as_strand_set
from hairloom.synthesis.detail_transfer import DetailParams, transfer_style
from hairloom.synthesis.pipeline import SynthesisParams, analyze, synthesize_from
from hairloom.types import Bools, Float64, Floats, Head, StrandSet

ANALYSIS = SynthesisParams(n_samples=40)
Grow = Callable[[str], StrandSet]  # the name of a recipe -> its strands on the head, world space, metres


@dataclass(frozen=True, slots=True)
class Variation:
    """A hairstyle made of grown ones by `make`; family is that of the one that gives it its shape."""

    name: str
    tags: tuple[str, ...]
    family: str
    make: Callable[[Grow, Head], StrandSet]
    n_points: int = 16


def synthesized(base: str, seed: int, region: Callable[[Floats], Bools] | None = None) -> Callable[..., StrandSet]:
    """A new hairstyle like `base`, on the scalp or on a region of it (directions from the head's middle -> bool)."""

    def make(grow: Grow, head: Head) -> StrandSet:
        example = analyze(grow(base), head, ANALYSIS)
        chosen = None
        if region is not None:
            middles = head.vertices[head.triangles].mean(axis=1) - example.space.centre
            chosen = head.scalp & region(middles / np.linalg.norm(middles, axis=1, keepdims=True))
        return synthesize_from(example, head, replace(ANALYSIS, seed=seed), region=chosen).strands

    return make


def transferred(detail: str, base: str, length_mode: str = "tile") -> Callable[..., StrandSet]:
    """The curls and wisps of one hairstyle on another."""

    def make(grow: Grow, head: Head) -> StrandSet:
        strands = grow(base)
        taken, kept = analyze(grow(detail), head, ANALYSIS), analyze(strands, head, ANALYSIS)
        result = transfer_style(taken.hierarchy, kept.hierarchy, DetailParams(length_mode=length_mode))
        return as_strand_set(result.strands, kept.space, strands)

    return make


@dataclass(frozen=True, slots=True)
class Drag:
    """A stroke of the comb in a picture of the head, 10 px a centimetre: place and way in pixels from its middle.

    eye : direction from which it is seen. x, y : right and up.
    """

    eye: tuple[float, float, float]
    start: tuple[float, float]
    way: tuple[float, float]
    settings: CombParams


def combed(base: str, drags: Sequence[Drag]) -> Callable[..., StrandSet]:
    """Strokes of the comb on a hairstyle."""

    def make(grow: Grow, head: Head) -> StrandSet:
        strands = grow(base)
        space = fit_scalp_space(head)
        labels = labels_of_strands(analyze(strands, head, ANALYSIS).hierarchy)
        strokes = [_stroke(drag, space.centre) for drag in drags]
        return comb(strands, labels, strokes, comb_collider([head], strands.roots))

    return make


def _stroke(drag: Drag, middle: Float64) -> Stroke:
    """A straight stroke of 24 samples in a parallel view of 1000 x 1000 pixels, 1000 px a metre."""
    ahead = -np.asarray(drag.eye, np.float64) / np.linalg.norm(drag.eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    # clip space spans 1 m across, and 4 m in depth
    matrix[:3, :3] = np.stack([right * 2.0, np.cross(right, ahead) * 2.0, ahead * 0.5])
    matrix[:3, 3] = -matrix[:3, :3] @ middle
    share = np.linspace(0.0, 1.0, 24)[:, None]
    places = 500.0 + np.array(drag.start) + share * np.array(drag.way)
    samples = np.column_stack([places, np.ones(len(places))])
    return Stroke(drag.settings, View(matrix, 1000.0, 1000.0), np.eye(4), samples)


FRONT, LEFT, RIGHT, BACK = (0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
COMB = CombParams(radius=70.0, pressure_strength=False)
THROUGH = replace(COMB, through=True)


def variations() -> list[Variation]:
    """All of them; their names differ from each other's and from the recipes'."""
    made: list[Variation] = []
    for number, (base, family, tags) in enumerate(
        (
            ("straight to the chest, middle parting", "straight", ("straight", "long")),
            ("wavy to the shoulder, middle parting", "wavy", ("wavy", "long")),
            ("curly to the shoulder, middle parting", "curly", ("curly", "long")),
            ("tangled to the shoulder, middle parting", "tangled", ("tangled", "long")),
            ("ringlets to the shoulder", "ringlets", ("ringlets", "long")),
        )
    ):
        name = f"like {base}"
        made.append(Variation(name, (*tags, "synthesized"), family, synthesized(base, number + 1)))
    for name, base, family, region in (
        ("curls on top only", "curly crop", "short_crop", lambda d: d[:, 2] > 0.55),
        ("waves, undercut", "wavy to the collar, middle parting", "undercut", lambda d: d[:, 2] > 0.35),
        ("curly mohawk", "curly to the chin, middle parting", "mohawk", lambda d: np.abs(d[:, 0]) < 0.25),
        ("ringlets on the right", "ringlets to the collar", "undercut", lambda d: d[:, 0] < 0.3),
    ):
        tags = ("synthesized", "shaved sides")
        made.append(Variation(name, tags, family, synthesized(base, 3, region)))
    for name, detail, base, family in (
        ("swept back, curled", "curly to the shoulder, middle parting", "straight, swept back", "straight"),
        ("bob, waved", "wavy to the collar, middle parting", "bob to the neck, right parting", "bob"),
        ("half up, ringlets", "ringlets to the chest", "half up, straight to the chest", "half up"),
        ("side bangs, curled", "curly to the chest, middle parting",
         "straight to the back, bangs to the left", "straight fringe"),
        ("over the left shoulder, waved", "big waves to the chest", "straight over the left shoulder", "one side"),
        ("A-line bob, curled", "curly to the chin, middle parting", "A-line bob", "cut bob"),
        ("waist, curled", "curly to the back, middle parting", "straight to the waist, left parting", "straight"),
        ("mullet, permed", "perm", "mullet", "mullet"),
    ):  # fmt: skip
        made.append(Variation(name, ("detail transfer",), family, transferred(detail, base), 18))
    back = (Drag(LEFT, (-60.0, 20.0), (150.0, -20.0), THROUGH), Drag(RIGHT, (60.0, 20.0), (-150.0, -20.0), THROUGH))
    for name, base, family, drags in (
        ("behind the ears", "straight to the shoulder, middle parting", "straight", back),
        ("wavy, behind the ears", "wavy to the chest, middle parting", "wavy", back),
        ("brushed to the left", "straight to the collar, middle parting", "straight",
         (Drag(FRONT, (-130.0, -90.0), (240.0, 20.0), THROUGH), Drag(BACK, (130.0, -90.0), (-240.0, 20.0), THROUGH))),
        ("ends drawn forward", "curly to the shoulder, middle parting", "curly",
         (Drag(LEFT, (60.0, -130.0), (-190.0, -10.0), THROUGH), Drag(RIGHT, (-60.0, -130.0), (190.0, -10.0), THROUGH))),
    ):  # fmt: skip
        made.append(Variation(name, ("combed",), family, combed(base, drags)))
    return made
