"""Is the synthesised hair texture better than plain projection and blending?

`python tests/renders/texture_quality.py RENDERS OUT [GROOM ...]`; RENDERS is what render_views.py wrote. For each groom
the rough shape and its surface are made as always; then the texture twice: by synthesis, and plainly: the mean of the
photos that see a texel by how much they face it, holes by inverse squared distance from their borders. Both are made
at the finest scale, and judged at that with texels of about a millimetre (--spacing), one or two of the photo's pixels,
by the same filter and the same smoothing: finer texels than the photo's pixels show the filter little but noise.

Orientation: median angle to the hair that was rendered, that is to the visible strands nearest to the texel, in the
texel's tangent plane. Texels farther than 6 mm from hair do not count, nor those whose nearest strands cross.
Kinds of texels: one view, overlap (two or more views with over a fifth of the weight), grazing (no view that sees it
faces it within 45 degrees), hole (none sees it).

Three cases: the photos as they are; cameras that are off by Gaussian angles of 10 degrees; and photos of two grooms
(front of another groom, each pair in MIXED), for which there is no truth: there counts how sharp the overlap is, and
how far its orientation is from the nearest of those of the photos that see it.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from evaluate import VIEWS, load_head, load_views, noisy, own_family
from hairloom.fourview.database import HairDatabase, open_database
from hairloom.fourview.directions import reduced
from hairloom.fourview.pipeline import FourViewParams, rough_shape
from hairloom.fourview.projection import ViewsOnTexels, fill_holes, project_views, sample_view
from hairloom.fourview.regions import axes_of, make_graph, outer_products, smooth
from hairloom.fourview.shape import RoughShape
from hairloom.fourview.surface import HairSurface, make_surface
from hairloom.fourview.tangent_filter import texel_orientations
from hairloom.fourview.texels import TexelMap
from hairloom.fourview.texture import synthesize_texture
from hairloom.fourview.views import View
from hairloom.geometry.camera import orthographic_camera
from hairloom.geometry.strand_raster import raster_strands
from hairloom.io.bundle import read_bundle
from hairloom.types import Bools, Float32, Head, StrandSet
from scipy.spatial import cKDTree

NEAR = 0.006  # metres from a texel to the hair that it is compared with
N_NEAREST = 8  # strand pieces whose mean is the truth
AGREE = 0.6  # coherence of these, below which there is no truth
SHARE = 0.2  # of the weight that makes a view count in an overlap
SWEEPS = 25  # of smoothing, over neighbours
NOISE = 10.0  # degrees
MIXED = {"straight": "wavy", "wavy": "straight", "bob": "curly", "spiky": "short_crop"}  # groom: that of the front
KINDS = ("one view", "overlap", "grazing", "hole")
WAYS = ("synthesis", "plain")
Numbers = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Truth:
    """Pieces of the rendered strands that are seen from some side: middles and unit tangents (n, 3) float32, metres."""

    middles: Float32
    tangents: Float32


@dataclass(frozen=True, slots=True)
class Case:
    """What both textures are made from and judged on. texels : the scale; on_texels : what the views see of it."""

    surface: HairSurface
    shape: RoughShape
    views: list[View]
    texels: TexelMap
    on_texels: ViewsOnTexels


def visible_hair(strands: StrandSet, head: Head) -> Truth:
    """What of the hair is seen from 25 sides: all around at four heights, and from above."""
    middle = 0.5 * (strands.points.min(axis=0) + strands.points.max(axis=0))
    extent = float(np.linalg.norm(np.ptp(strands.points, axis=0)))
    sides = [
        (np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), -np.sin(e))
        for a in np.arange(6) * np.pi / 3
        for e in np.radians((-45.0, 0.0, 25.0, 55.0))
    ]
    cameras = [orthographic_camera(side, middle, 1000 / extent, (1000, 1000)) for side in sides]
    cameras.append(orthographic_camera((0, 0, -1), middle, 1000 / extent, (1000, 1000), up=(0, 1, 0)))
    found = np.zeros(len(strands.points), np.bool_)
    for camera in cameras:
        drawn = raster_strands(camera, strands, head)
        found[drawn.segment[drawn.mask]] = True
    first = np.flatnonzero(found)
    start, end = strands.points[first], strands.points[first + 1]
    length = np.linalg.norm(end - start, axis=1, keepdims=True)
    kept = length[:, 0] > 1e-7
    return Truth((0.5 * (start + end))[kept], ((end - start) / np.maximum(length, 1e-12))[kept])


def true_axes(truth: Truth, texels: TexelMap) -> tuple[Float32, Bools]:
    """(T, 3) axes in the tangent planes, and (T,) where there is hair near enough that agrees with itself."""
    distance, nearest = cKDTree(truth.middles).query(texels.points, k=N_NEAREST)
    along = truth.tangents[nearest]
    along = along - (along * texels.normals[:, None]).sum(axis=2, keepdims=True) * texels.normals[:, None]
    tensors = outer_products(along.reshape(-1, 3)).reshape(*nearest.shape, 6)
    weights = (distance < NEAR)[..., None] / N_NEAREST
    axes, coherence = axes_of((tensors * weights).sum(axis=1), texels.normals)
    return axes, (distance[:, 0] < NEAR) & (coherence > AGREE)


def kinds(on_texels: ViewsOnTexels) -> dict[str, Bools]:
    """(T,) bool for each of KINDS, apart from each other; a grazing texel is no overlap."""
    weights = on_texels.facing * on_texels.visible
    best, total = weights.max(axis=0), weights.sum(axis=0)
    several = (weights > SHARE * np.maximum(total, 1e-9)).sum(axis=0) >= 2
    hole, well = ~on_texels.visible.any(axis=0), best > np.cos(np.pi / 4)
    return {"one view": well & ~several, "overlap": well & several, "grazing": ~hole & ~well, "hole": hole}


def plain_texture(texels: TexelMap, on_texels: ViewsOnTexels, views: Sequence[View]) -> Float32:
    """(T, 3) float32: projection and linear blending, nothing else."""
    weights = on_texels.facing * on_texels.visible
    colours = np.zeros((texels.n_texels, 3), np.float32)
    for number, view in enumerate(views):
        photo = sample_view(view, on_texels.pixels[number], on_texels.visible[number])
        colours += weights[number][:, None] * photo
    total = weights.sum(axis=0)
    return fill_holes(texels, colours / np.maximum(total, 1e-9)[:, None], total > 0)


def axes_on(texels: TexelMap, colours: Float32) -> tuple[Float32, Float32]:
    """(T, 3) smoothed axes and (T,) the filter's confidence of colours (T, 3)."""
    orientations, confidence = texel_orientations(texels, colours)
    tensors = outer_products(orientations)
    weights = np.maximum(confidence, np.float32(0.02))
    smoothed = smooth(make_graph(texels.edges, texels.n_texels), tensors, weights, tensors, 1.0, SWEEPS)
    return axes_of(smoothed, texels.normals)[0], confidence


def degrees_between(a: Float32, b: Float32) -> Float32:
    """(T,) degrees in [0, 90] between axes (T, 3)."""
    return np.degrees(np.arccos(np.clip(np.abs((a * b).sum(axis=1)), 0, 1))).astype(np.float32)


def gradient_energy(texels: TexelMap, colours: Float32) -> Float32:
    """(T,) mean squared step of brightness along the edges of each texel."""
    light = colours @ np.array([0.299, 0.587, 0.114], np.float32)
    steps = (light[texels.edges[:, 0]] - light[texels.edges[:, 1]]) ** 2
    ends = texels.edges.T.ravel()
    sums = np.bincount(ends, np.concatenate([steps, steps]), texels.n_texels)
    return np.asarray(sums / np.maximum(np.bincount(ends, minlength=texels.n_texels), 1), np.float32)


def make_case(surface: HairSurface, shape: RoughShape, views: list[View], spacing: float) -> Case:
    """The case at the scale whose texels come nearest to `spacing` metres."""
    level = min(surface.levels, key=lambda level: abs(np.log(level.texels.spacing / spacing)))
    return Case(surface, shape, views, level.texels, project_views(level.texels, views, shape.closed))


def textures(case: Case, params: FourViewParams) -> dict[str, Float32]:
    """The two textures of WAYS, (T, 3) at the case's scale; both made at the finest."""
    finest = case.surface.levels[-1].texels
    on_finest = project_views(finest, case.views, case.shape.closed)
    made = {
        "synthesis": synthesize_texture(case.surface, case.shape, case.views, params.texture).colour,
        "plain": plain_texture(finest, on_finest, case.views),
    }
    return {way: reduced(colours, finest, case.texels) for way, colours in made.items()}


def judge_truth(case: Case, made: Mapping[str, Float32], truth: Truth) -> Numbers:
    """Median degrees of each way in each kind of texels, and which share of the counted texels is of the kind."""
    axes, known = true_axes(truth, case.texels)
    chosen = {kind: where & known for kind, where in kinds(case.on_texels).items()}
    numbers: Numbers = {"counted": float(known.mean())}
    numbers["share"] = {kind: float(where.sum() / max(known.sum(), 1)) for kind, where in chosen.items()}
    for way, colours in made.items():
        error = degrees_between(axes_on(case.texels, colours)[0], axes)
        numbers[way] = {kind: float(np.median(error[w])) if w.any() else None for kind, w in chosen.items()}
    return numbers


def judge_sharpness(case: Case, made: Mapping[str, Float32]) -> Numbers:
    """Of the overlap: gradient energy and confidence against the one-view region's, degrees to the nearest photo."""
    where = kinds(case.on_texels)
    overlap, single = where["overlap"], where["one view"]
    weights = case.on_texels.facing * case.on_texels.visible
    own = []
    for number, view in enumerate(case.views):
        counts = case.on_texels.visible[number]
        photo = fill_holes(case.texels, sample_view(view, case.on_texels.pixels[number], counts), counts)
        own.append((axes_on(case.texels, photo)[0], weights[number] > SHARE * np.maximum(weights.sum(axis=0), 1e-9)))
    numbers: Numbers = {}
    for way, colours in made.items():
        axes, confidence = axes_on(case.texels, colours)
        energy = gradient_energy(case.texels, colours)
        nearest = np.full(case.texels.n_texels, 90, np.float32)
        for photo_axes, counts in own:
            nearest = np.where(counts, np.minimum(nearest, degrees_between(axes, photo_axes)), nearest)
        numbers[way] = {
            "gradient energy": float(energy[overlap].mean() / energy[single].mean()),
            "confidence": float(confidence[overlap].mean() / confidence[single].mean()),
            "degrees to a photo": float(np.median(nearest[overlap])),
        }
    return numbers


class Measurement:
    """All cases of a groom."""

    def __init__(self, renders: Path, database: HairDatabase, params: FourViewParams, spacing: float) -> None:
        self.renders, self.database, self.params, self.spacing = renders, database, params, spacing

    def _case(self, groom: str, views: list[View], head: Head) -> Case:
        exclude = own_family(self.database, groom)
        shape = rough_shape(views, head, self.database, self.params, exclude=exclude)
        return make_case(make_surface(shape.open, self.params.surface), shape, views, self.spacing)

    def cases(self, groom: str) -> dict[str, Case]:
        """The photos as they are, cameras that are off, and another groom's front if there is one for this groom."""
        folder = self.renders / groom
        head, cameras = load_head(folder)
        views = load_views(dict.fromkeys(VIEWS, folder), cameras)
        first = self._case(groom, views, head)
        found = {"photos": first, "noise": self._case(groom, noisy(views, head, NOISE, 1), head)}
        if groom in MIXED and (self.renders / MIXED[groom]).is_dir():
            folders = {name: self.renders / (MIXED[groom] if name == "front" else groom) for name in VIEWS}
            found["mixed"] = make_case(first.surface, first.shape, load_views(folders, cameras), self.spacing)
        return found

    def measure(self, groom: str) -> Numbers:
        rendered = read_bundle(self.renders / groom / "truth.npz")
        return measured(self.cases(groom), visible_hair(rendered["strands"], rendered["head"]), self.params)


def measured(cases: Mapping[str, Case], truth: Truth, params: FourViewParams) -> Numbers:
    """The numbers of each case."""
    numbers: Numbers = {}
    for name, case in cases.items():
        made = textures(case, params)
        numbers[name] = judge_sharpness(case, made) if name == "mixed" else judge_truth(case, made, truth)
    return numbers


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def truth_table(results: Mapping[str, Numbers], name: str) -> list[str]:
    """Degrees of synthesis and plain blending, a line for each groom, and their mean."""
    lines = ["| | " + " | ".join(f"{kind}: synthesis / plain (share)" for kind in KINDS) + " |", "|---" * 5 + "|"]
    rows = {groom: numbers[name] for groom, numbers in results.items() if name in numbers}
    for groom, numbers in rows.items():
        both = {kind: " / ".join(_cell(numbers[way][kind]) for way in WAYS) for kind in KINDS}
        cells = [f"{both[kind]} ({100 * numbers['share'][kind]:.0f} %)" for kind in KINDS]
        lines.append(f"| {groom} | " + " | ".join(cells) + " |")
    cells = []
    for kind in KINDS:
        both = [[numbers[way][kind] for way in WAYS] for numbers in rows.values() if numbers["plain"][kind] is not None]
        cells.append(" / ".join(_cell(float(x)) for x in np.mean(both, axis=0)) if both else "-")
    return [*lines, "| **mean** | " + " | ".join(cells) + " |"]


def sharpness_table(results: Mapping[str, Numbers]) -> list[str]:
    """The mixed sources."""
    names = ("gradient energy", "confidence", "degrees to a photo")
    lines = ["| | " + " | ".join(f"{name}: synthesis / plain" for name in names) + " |", "|---" * 4 + "|"]
    rows = {f"{g}, front of {MIXED[g]}": numbers["mixed"] for g, numbers in results.items() if "mixed" in numbers}
    for groom, numbers in rows.items():
        cells = [" / ".join(f"{numbers[way][name]:.2f}" for way in WAYS) for name in names]
        lines.append(f"| {groom} | " + " | ".join(cells) + " |")
    means = [[np.mean([numbers[way][name] for numbers in rows.values()]) for way in WAYS] for name in names]
    return [*lines, "| **mean** | " + " | ".join(" / ".join(f"{mean:.2f}" for mean in pair) for pair in means) + " |"]


def page(results: Mapping[str, Numbers]) -> str:
    """The tables as markdown."""
    parts = [
        "# Texture synthesis against plain projection and blending",
        "Made by `python tests/renders/texture_quality.py`. Median degrees to the rendered hair; in brackets the share "
        "of the texels that count. A random direction has 45.",
        "## Photos and cameras as they are",
        "\n".join(truth_table(results, "photos")),
        f"## Cameras off by {NOISE:g} degrees",
        "\n".join(truth_table(results, "noise")),
    ]
    if any("mixed" in numbers for numbers in results.values()):
        parts += [
            "## Front of another groom",
            "In the overlap: gradient energy and the filter's confidence against those of texels that one view sees, "
            "and median degrees to the nearest of the photos that see the texel.",
            "\n".join(sharpness_table(results)),
        ]
    return "\n\n".join(parts) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("renders", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("grooms", nargs="*")
    parser.add_argument("--texture-size", type=int, default=2048)
    parser.add_argument("--spacing", type=float, default=0.001, help="metres between the texels that are judged")
    options = parser.parse_args(arguments)
    params = FourViewParams()
    params = replace(params, surface=replace(params.surface, texture_size=options.texture_size))
    measurement = Measurement(options.renders, open_database(), params, options.spacing)
    grooms = options.grooms or sorted(path.name for path in options.renders.iterdir() if path.is_dir())
    options.out.mkdir(parents=True, exist_ok=True)
    results: dict[str, Numbers] = {}
    for groom in grooms:
        results[groom] = measurement.measure(groom)
        print(f"{groom}: {json.dumps(results[groom])}", flush=True)
        (options.out / "texture_quality.json").write_text(json.dumps(results, indent=1))
        (options.out / "texture_quality.md").write_text(page(results))
    return 0


if __name__ == "__main__":
    sys.exit(main())
