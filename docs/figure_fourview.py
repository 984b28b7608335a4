"""Makes docs/figure_fourview.md and its pictures: `python docs/figure_fourview.py RENDERS OUT [--only EXPERIMENT ...]`.

RENDERS is what `tests/renders/render_views.py` wrote; OUT keeps every result, so that a run that was broken off goes on
where it was. Each experiment models hair from the rendered photos and judges it by the strands that were rendered.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests" / "renders"))

from evaluate import (  # noqa: E402
    VIEWS,
    angles,
    evaluate,
    frame,
    judge,
    load_head,
    load_views,
    model,
    noisy,
    own_family,
    picture,
)
from hairloom.fourview.database import HairDatabase, open_database  # noqa: E402
from hairloom.fourview.inputs import read_inputs  # noqa: E402
from hairloom.fourview.pipeline import FourViewParams  # noqa: E402
from hairloom.fourview.project import Project, ProjectView  # noqa: E402
from hairloom.fourview.views import View  # noqa: E402
from hairloom.geometry.head import default_head  # noqa: E402
from hairloom.geometry.strand_raster import raster_strands  # noqa: E402
from hairloom.io.bundle import read_bundle  # noqa: E402
from hairloom.io.images import read_image, write_image  # noqa: E402
from hairloom.io.strands import read_strands  # noqa: E402
from hairloom.types import Head  # noqa: E402

PICTURES = ROOT / "docs" / "pictures"
PAGE = ROOT / "docs" / "figure_fourview.md"
WIDTH = 1200  # pixels of a picture in the docs
# hair whose direction a picture shows; of the others (paper: "highly curly", Z-E11) no photo tells it
COMBED = ("bob", "ponytail", "short_crop", "sintel", "straight", "wavy")
NOISE_GROOMS, NOISE_DEGREES = ("sintel", "straight"), (0, 10, 25)
COUNTS = {"front, back": VIEWS[:2], "front, back, left": VIEWS[:3], "all four": VIEWS, "front": VIEWS[:1]}
Numbers = dict[str, Any]


def kept(path: Path, make: Any) -> Numbers:
    """What `make` gives, from the file if it is there already."""
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(make(), indent=1))
    return dict(json.loads(path.read_text()))


def modelled(
    folder: Path, views: Sequence[View], database: HairDatabase, params: FourViewParams, shown: Path
) -> Numbers:
    """Numbers of a model of these views, judged in all true views, and its picture."""
    head, cameras = load_head(folder)
    result, seconds = model(views, head, database, own_family(database, folder.name), params)
    truth = read_bundle(folder / "truth.npz")
    every = load_views(dict.fromkeys(VIEWS, folder), cameras)
    save(shown, picture(result.strands, every, head))
    return judge(result.strands, truth["strands"], every, truth["head"]) | {"seconds": seconds}


def save(path: Path, image: np.ndarray) -> None:
    """A picture of the docs' width; hair is too much noise for PNG."""
    height = round(image.shape[0] * WIDTH / image.shape[1])
    small = cv2.resize(image, (WIDTH, height), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(path), small[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])


def row(name: str, numbers: Mapping[str, Any]) -> str:
    """A line of a table: IoU and median orientation error in each view, F-scores."""
    cells = [f"{numbers['iou'][view]:.3f}" for view in VIEWS]
    cells += [f"{numbers['orientation_median_deg'][view]:.1f}" for view in VIEWS]
    cells += [f"{score[2]:.2f}" for score in numbers["scores"]]
    return f"| {name} | " + " | ".join(cells) + " |"


def table(rows: Mapping[str, Numbers], means: Mapping[str, Sequence[str]] = {}) -> list[str]:
    """A table with one line for each of `rows`, and one for each mean over some of them."""
    head = [f"IoU {view}" for view in VIEWS] + [f"deg {view}" for view in VIEWS] + ["F 2 mm", "F 3 mm", "F 4 mm"]
    lines = ["| | " + " | ".join(head) + " |", "|---" * (len(head) + 1) + "|"]
    lines += [row(name, numbers) for name, numbers in rows.items()]
    for name, chosen in means.items():
        some = [rows[key] for key in chosen]
        average: Numbers = {
            key: {view: float(np.mean([numbers[key][view] for numbers in some])) for view in VIEWS}
            for key in ("iou", "orientation_median_deg")
        }
        average["scores"] = np.mean([numbers["scores"] for numbers in some], axis=0).tolist()
        lines.append(row(f"**{name}**", average))
    return lines


class Experiments:
    """The experiments of the page; each gives its lines."""

    def __init__(self, renders: Path, out: Path) -> None:
        self.renders, self.out = renders, out
        self.database, self.params = open_database(), FourViewParams()
        self.grooms = sorted(path.name for path in renders.iterdir() if (path / "truth.npz").is_file())

    def views(self, groom: str) -> tuple[list[View], Head]:
        head, cameras = load_head(self.renders / groom)
        return load_views(dict.fromkeys(VIEWS, self.renders / groom), cameras), head

    def quality(self) -> list[str]:
        rows, names = {}, {}
        for groom in self.grooms:
            folder, out = self.renders / groom, self.out / groom
            numbers = kept(out / "numbers.json", lambda f=folder, o=out: evaluate(f, o, self.database, self.params))
            names[groom] = f"{groom} ({numbers['report']['style']})"
            rows[names[groom]] = numbers
            if not (out / "rendered_right.png").is_file():
                program = ROOT / "tests" / "renders" / "render_result.py"
                subprocess.run([sys.executable, program, self.renders, self.out, groom], check=True)
            save(PICTURES / f"fourview_{groom}.jpg", self._shown(groom))
        combed = [names[groom] for groom in COMBED if groom in names]
        lines = ["## Quality", "", "In brackets the hairstyle of the database that the shape was made from.", ""]
        lines += [*table(rows, {f"mean of {len(rows)}": list(rows), f"mean of the {len(combed)} combed": combed}), ""]
        lines += ["Aimed at: IoU 0.93 and 15 degrees in each view. Combed: " + ", ".join(COMBED) + ". " + FAILURES, ""]
        return [*lines, *[f"![{groom}](pictures/fourview_{groom}.jpg)\n" for groom in self.grooms]]

    def _shown(self, groom: str) -> np.ndarray:
        """Photos, the result rendered like them, and the result by angle."""
        views, head = self.views(groom)
        strands = read_strands(self.out / groom / "result.npz")
        rows, columns = frame(views)
        parts = []
        for view in views:
            rendered = read_image(self.out / groom / f"rendered_{view.name}.png")
            by_angle = angles(raster_strands(view.camera, strands, head))
            parts.append(np.vstack([image[rows, columns] for image in (view.image, rendered, by_angle)]))
        return np.hstack(parts)

    def texture(self) -> list[str]:
        """Z-E4: the texture against plain projection and blending."""
        path = self.out / "texture_quality.md"
        if not path.is_file():
            program = ROOT / "tests" / "renders" / "texture_quality.py"
            subprocess.run([sys.executable, program, self.renders, self.out, *TEXTURE_GROOMS], check=True)
        return ["#" + line if line.startswith("#") else line for line in path.read_text().splitlines()] + [""]

    def noise(self) -> list[str]:
        lines = ["## Cameras that are off (Z-E9)", ""]
        for groom in NOISE_GROOMS:
            views, head = self.views(groom)
            rows = {}
            for degrees in NOISE_DEGREES:
                name = f"noise_{groom}_{degrees}"
                rows[f"{groom}, sigma {degrees} degrees"] = kept(
                    self.out / f"{name}.json",
                    lambda v=views, h=head, d=degrees, n=name, g=groom: modelled(
                        self.renders / g, noisy(v, h, d, 1), self.database, self.params, PICTURES / f"fourview_{n}.jpg"
                    ),
                )
            lines += [*table(rows), ""]
            lines += [f"![sigma {d} degrees](pictures/fourview_noise_{groom}_{d}.jpg)\n" for d in NOISE_DEGREES[1:]]
        return lines

    def counts(self) -> list[str]:
        rows = {}
        views, _ = self.views("sintel")
        for number, (name, chosen) in enumerate(COUNTS.items()):
            rows[name] = kept(
                self.out / f"count_{number}.json",
                lambda c=chosen, n=number: modelled(
                    self.renders / "sintel", [view for view in views if view.name in c], self.database, self.params,
                    PICTURES / f"fourview_count_{n}.jpg",
                ),
            )  # fmt: skip
        lines = ["## Fewer photos (Z-E10)", "", *table(rows), ""]
        return [*lines, *[f"![{name}](pictures/fourview_count_{n}.jpg)\n" for n, name in enumerate(COUNTS)]]

    def melding(self) -> list[str]:
        """A curly front on a straight back (Z-E3)."""
        head, cameras = load_head(self.renders / "straight")
        sources = {"front": "curly", "back": "straight", "left": "straight", "right": "straight"}
        folders = {view: self.renders / groom for view, groom in sources.items()}
        views = load_views(folders, cameras)
        path = PICTURES / "fourview_melding.jpg"
        if not path.is_file():
            result, _ = model(views, head, self.database, (), self.params)
            save(path, picture(result.strands, views, head))
        return ["## Melding: a curly front on a straight back (Z-E3)", "", f"![melded](pictures/{path.name})", ""]

    def detail(self) -> list[str]:
        """Detail refinement off; the first table has it on (Z-E5)."""
        views, _ = self.views("wavy")
        off = replace(self.params, with_detail=False)
        rows = {
            "detail on": kept(self.out / "wavy" / "numbers.json", dict),
            "detail off": kept(
                self.out / "detail_off.json",
                lambda: modelled(
                    self.renders / "wavy", views, self.database, off, PICTURES / "fourview_detail_off.jpg"
                ),
            ),
        }
        return ["## Detail on and off (Z-E5)", "", *table(rows), "", "![off](pictures/fourview_detail_off.jpg)", ""]

    def photo(self) -> list[str]:
        """A real photo as the only view: skimage's astronaut, public domain, with nothing done by hand."""
        from skimage.data import astronaut

        path = PICTURES / "fourview_astronaut.jpg"
        if not path.is_file():
            folder = self.out / "astronaut"
            folder.mkdir(parents=True, exist_ok=True)
            write_image(folder / "front.png", astronaut())
            inputs = read_inputs(Project(folder, (ProjectView("front", "front.png"),)), default_head())
            result, _ = model(inputs.views, inputs.head, self.database, (), self.params)
            save(path, picture(result.strands, inputs.views, inputs.head))
        return ["## A real photo, front only, nothing done by hand", "", f"![astronaut](pictures/{path.name})", ""]


TEXTURE_GROOMS = ("bob", "ponytail", "puffy", "short_crop", "sintel", "spiky", "straight", "wavy")
FAILURES = (
    "The others are the failure cases, as in the paper (Z-E11): the hair of curly and puffy turns several times "
    "within a centimetre and lies crosswise, so that what a filter sees in a picture says little of the strands "
    "(in the photos themselves it is 30 degrees and more off); tangled and spiky hair runs out of the surface, on "
    "whose tangent planes all directions are kept. Their masks are still filled. A tail that the nearest "
    "hairstyle of the database lacks (ponytail) is grown from the masks alone."
)
INTRODUCTION = """# Four photos to strands: what comes out

Made by `python docs/figure_fourview.py RENDERS OUT` from photos of 800 x 800 that `tests/renders/render_views.py`
rendered with Cycles. The method got photos, masks, cameras and the head; hairstyles of the database that were made from
the groom's own procedure were left out. IoU: of the result's mask with the photo's. deg: median angle between the
result's and the rendered strands where both are seen. F: harmonic mean of precision and recall of strand length at
(2 mm, 20 degrees), (3 mm, 30 degrees), (4 mm, 40 degrees). In the pictures: photos, result in its own colours, result
by angle.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("renders", type=Path)
    parser.add_argument("out", type=Path)
    names = ("quality", "texture", "noise", "counts", "melding", "detail", "photo")
    parser.add_argument("--only", nargs="+", choices=names, default=names)
    options = parser.parse_args(arguments)
    experiments = Experiments(options.renders, options.out)
    parts = ["\n".join(getattr(experiments, name)()) for name in names if name in options.only]
    PAGE.write_text(INTRODUCTION + "\n" + "\n".join(parts))
    return 0


if __name__ == "__main__":
    sys.exit(main())
