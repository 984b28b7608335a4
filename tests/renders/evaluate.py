"""Model hair from rendered photos and judge it: `python tests/renders/evaluate.py RENDERS OUT [GROOM ...]`.

RENDERS is what render_views.py wrote. For each groom the method gets photos, masks, cameras and the head's mesh, and no
more: the scalp is guessed where the groom is not on our own head, and hairstyles of the database of the groom's own
family are left out. OUT/GROOM gets result.npz (strands), texture.png, numbers.json and compare.png (photos above, the
result in its colours and by its directions below).
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from hairloom.cli import StageClock
from hairloom.cli_fourview import StageProgress
from hairloom.fourview.database import HairDatabase, open_database
from hairloom.fourview.pipeline import FourViewParams, FourViewResult, model_hair
from hairloom.fourview.placement import turned_camera
from hairloom.fourview.quality import mask_iou, orientation_error
from hairloom.fourview.views import View
from hairloom.geometry.camera import project
from hairloom.geometry.scalp_guess import guess_scalp
from hairloom.geometry.scalp_space import fit_scalp_space
from hairloom.geometry.strand_raster import StrandRaster, hair_mask, raster_strands
from hairloom.geometry.strand_scores import strand_scores
from hairloom.geometry.view_raster import raster_mesh
from hairloom.io.bundle import read_bundle
from hairloom.io.images import read_image, read_mask, write_image
from hairloom.io.strands import write_strands
from hairloom.progress import NO_PROGRESS
from hairloom.types import Camera, Head, StrandSet

VIEWS = ("front", "back", "left", "right")
THRESHOLDS = ((0.002, 20.0), (0.003, 30.0), (0.004, 40.0))
_REAL = ("sintel", "ponytail")


def load_views(folders: Mapping[str, Path], cameras: Mapping[str, Camera]) -> list[View]:
    """The views by name, each from its folder."""
    return [
        View(name, read_image(folder / f"{name}.png"), read_mask(folder / f"{name}_mask.png"), cameras[name])
        for name, folder in folders.items()
    ]


def load_head(folder: Path) -> tuple[Head, dict[str, Camera]]:
    """The head as an artist would have it, and the cameras."""
    seen = read_bundle(folder / "cameras.npz")
    head: Head = seen["head"]
    if folder.name in _REAL:
        head = guess_scalp(replace(head, scalp=np.zeros_like(head.scalp)))
    return head, seen["cameras"]


def noisy(views: Sequence[View], head: Head, degrees: float, seed: int) -> list[View]:
    """The views with their directions turned by Gaussian angles, the head's middle staying on its pixel (Z-E9)."""
    rng = np.random.default_rng(seed)
    centre = fit_scalp_space(head).centre
    found = []
    for view in views:
        yaw, pitch = np.radians(rng.normal(0.0, degrees, 2))
        pixel = project(view.camera, centre)[:2]
        scale = float(view.camera.intrinsics[0, 0])
        camera = turned_camera(
            view.name, centre, float(yaw), float(pitch), scale, (pixel[0], pixel[1]), view.mask.shape
        )
        found.append(View(view.name, view.image, view.mask, camera))
    return found


def own_family(database: HairDatabase, groom: str) -> tuple[str, ...]:
    """Names of the database's hairstyles that were made from a starter groom's procedure, fringes and cuts included."""
    if groom in _REAL:
        return ()
    near = {"puffy": ("afro", "flat top"), "bob": ("bob",), "curly": ("ringlets", "perm"), "wavy": ("big waves",)}
    words = (groom.replace("_", " "), groom, *near.get(groom, ()))
    families = {style.family for style in database.styles if any(word in style.family for word in words)}
    return database.named(*families)


def model(
    views: Sequence[View], head: Head, database: HairDatabase, exclude: Sequence[str], params: FourViewParams
) -> tuple[FourViewResult, dict[str, float]]:
    """The model, and the seconds of each stage."""
    clock = StageClock()
    stages = StageProgress(NO_PROGRESS, clock)
    result = model_hair(views, head, database, (), params, exclude=exclude, progress=stages)
    clock("")
    return result, {stage: round(seconds, 2) for stage, seconds in clock.seconds.items()}


def judge(strands: StrandSet, truth: StrandSet, views: Sequence[View], truth_head: Head) -> dict[str, Any]:
    """Mask IoU and orientation error in each view, and strand scores, all against the truth."""
    numbers: dict[str, Any] = {"iou": {}, "orientation_median_deg": {}, "orientation_mean_deg": {}}
    for view in views:
        mine, true = (raster_strands(view.camera, hair, truth_head) for hair in (strands, truth))
        numbers["iou"][view.name] = round(mask_iou(hair_mask(view.camera, strands, truth_head), view.mask), 4)
        median, mean = orientation_error(mine.angle, true.angle, (mine.strand >= 0) & (true.strand >= 0))
        numbers["orientation_median_deg"][view.name] = round(float(median), 2)
        numbers["orientation_mean_deg"][view.name] = round(float(mean), 2)
    scores = strand_scores(strands, truth, thresholds=THRESHOLDS)
    numbers["scores"] = [
        [round(float(x), 4) for x in (score.precision, score.recall, score.f_score)] for score in scores
    ]
    return numbers


def picture(strands: StrandSet, views: Sequence[View], head: Head) -> np.ndarray:
    """The photos above, the strands below: in their own colours, varied a little, and by their angle in the picture."""
    columns = []
    rows, sides = frame(views)
    for view in views:
        drawn = raster_strands(view.camera, strands, head)
        canvas = np.full((*view.mask.shape, 3), 235, np.uint8)
        skull = np.isfinite(raster_mesh(view.camera, head.vertices, head.triangles).depth)
        canvas[skull] = (214, 196, 186)
        hair = drawn.strand >= 0
        colours = np.asarray(strands.strand_attributes.get("groom_color", np.full((strands.n_strands, 4), 0.3)))[:, :3]
        shown = np.clip(colours, 0, 1) ** (1 / 2.2)
        rng = np.random.default_rng(0)
        vary = rng.uniform(0.75, 1.2, strands.n_strands)[:, None]
        canvas[hair] = (np.clip(shown * vary, 0, 1) * 255).astype(np.uint8)[drawn.strand[hair]]
        columns.append(np.vstack([part[rows, sides] for part in (view.image, canvas, angles(drawn))]))
    return np.hstack(columns)


def angles(drawn: StrandRaster) -> np.ndarray:
    """(H, W, 3) uint8: the hue says how strands run in the picture."""
    hair = drawn.strand >= 0
    hue = np.zeros((*hair.shape, 3), np.uint8)
    hue[hair] = np.stack([drawn.angle[hair] / np.pi * 179, np.full(hair.sum(), 255), np.full(hair.sum(), 255)], 1)
    return np.asarray(cv2.cvtColor(hue, cv2.COLOR_HSV2RGB))


def frame(views: Sequence[View], margin: int = 40) -> tuple[slice, slice]:
    """Rows and columns of the pictures that have hair in any view, and a margin."""
    together = np.any([view.mask for view in views], axis=0)
    places = [np.flatnonzero(together.any(axis=axis)) for axis in (1, 0)]
    rows, columns = (slice(max(int(p[0]) - margin, 0), int(p[-1]) + margin) for p in places)
    return rows, columns


def evaluate(
    folder: Path, out: Path, database: HairDatabase, params: FourViewParams, names: Sequence[str] = VIEWS
) -> dict[str, Any]:
    """Model one groom and write what came out."""
    head, cameras = load_head(folder)
    views = load_views(dict.fromkeys(names, folder), cameras)
    result, seconds = model(views, head, database, own_family(database, folder.name), params)
    truth = read_bundle(folder / "truth.npz")
    every = load_views(dict.fromkeys(VIEWS, folder), cameras)
    numbers = judge(result.strands, truth["strands"], every, truth["head"])
    numbers |= {"seconds": seconds, "total_seconds": round(sum(seconds.values()), 1), "report": result.report}
    numbers["peak_mb"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    out.mkdir(parents=True, exist_ok=True)
    write_strands(out / "result.npz", result.strands)
    write_image(out / "texture.png", result.texture.image())
    write_image(out / "compare.png", picture(result.strands, every, head))
    (out / "numbers.json").write_text(json.dumps(numbers, indent=1))
    return numbers


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("renders", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("grooms", nargs="*")
    parser.add_argument("--views", nargs="+", default=VIEWS, choices=VIEWS, help="photos that the method gets")
    parser.add_argument("--texture-size", type=int, default=2048)
    parser.add_argument("--database", type=Path, help="another database")
    options = parser.parse_args(arguments)
    params = FourViewParams()
    params = replace(params, surface=replace(params.surface, texture_size=options.texture_size))
    database = open_database(options.database)
    grooms = options.grooms or sorted(path.name for path in options.renders.iterdir() if path.is_dir())
    for groom in grooms:
        numbers = evaluate(options.renders / groom, options.out / groom, database, params, options.views)
        shown = {name: numbers[name] for name in ("iou", "orientation_median_deg", "scores", "seconds", "peak_mb")}
        print(f"{groom}: {json.dumps(shown)}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
