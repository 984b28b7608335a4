"""The comb on our starter grooms, and beside Blender's own: `python docs/figure_comb.py [BLENDER]`.

Writes docs/pictures/comb_styles.png, comb_blender.png, the numbers `comb` of docs/figures.json and the page
docs/figure_comb.md. Needs bpy. BLENDER (a command such as shared/tools/blender-gui, with a screen) makes the same
strokes with its own Comb in its window, by tests/gui/blender_comb.py; without it that part stays as it was. About ten
minutes.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "docs"), str(ROOT / "blend_templates"), str(ROOT / "tests")]

import bpy  # noqa: E402, F401  before the modules that it brings
import numpy as np  # noqa: E402
from comb_quality import composed_labels, detail_kept, drag, kept, look, play, strands_grip  # noqa: E402
from hairloom.editing.comb import comb  # noqa: E402
from hairloom.editing.strokes import CombParams, Stroke, View  # noqa: E402
from hairloom.geometry.collider import build_collider  # noqa: E402
from hairloom.geometry.head import HeadSurface, default_head  # noqa: E402
from hairloom.synthesis.pipeline import analyze  # noqa: E402
from hairloom.types import Float32, Head, Int32, StrandSet  # noqa: E402
from make_grooms import load_groom  # noqa: E402
from render import RenderParams, render_strands, side_by_side  # noqa: E402
from styles import make_style  # noqa: E402

PICTURES = ROOT / "docs" / "pictures"
NUMBERS = ROOT / "docs" / "figures.json"
PAGE = ROOT / "docs" / "figure_comb.md"
PIXELS, SMALL_PIXELS = 368, 320
TARGET = (0.0, 0.02, 0.15)
RIGHT, FRONT = (1.0, 0.02, 0.15), (0.0, -1.0, 0.15)
# strokes of a styling: eye, settings, world place where the brush starts, way in pixels of some 0.8 mm
Styling = Sequence[tuple[tuple[float, float, float], dict[str, Any], tuple[float, float, float], tuple[float, float]]]
BOTH = {"mirror": (True, False, False)}
STYLINGS: dict[str, tuple[str, str, Styling]] = {
    "wavy": (
        "swept back from the face",
        "three_quarter",
        [
            (RIGHT, {"radius": 60.0, **BOTH}, (0.11, -0.05, 0.18), (130, -20)),
            (RIGHT, {"radius": 60.0, **BOTH}, (0.11, -0.03, 0.11), (120, -10)),
            (RIGHT, {"radius": 60.0, **BOTH}, (0.11, 0.0, 0.04), (110, 0)),
        ],
    ),
    "curly": (
        "fuller at the sides, lifted on top",
        "front",
        [
            (FRONT, {"radius": 70.0, "through": True}, (-0.1, -0.03, 0.12), (-40, 20)),
            (FRONT, {"radius": 70.0, "through": True}, (0.1, -0.03, 0.12), (40, 20)),
            (FRONT, {"radius": 60.0, "mode": "lift", "through": True}, (-0.03, 0.0, 0.3), (40, 0)),
        ],
    ),
    "straight": (
        "swept behind the ears",
        "side",
        [
            (RIGHT, {"radius": 60.0, **BOTH}, (0.11, -0.04, 0.14), (120, -10)),
            (RIGHT, {"radius": 60.0, **BOTH}, (0.11, 0.0, 0.04), (90, 0)),
        ],
    ),
}
N_COMPARED = 1500  # strands that Blender's window keeps up with in software
RADIUS = 45.0  # pixels
# name, view, world place where the brush starts, way in pixels of some 0.8 mm
STROKES = (("back", "RIGHT", (0.1, 0.03, 0.10), (90.0, 40.0)), ("forward", "RIGHT", (0.1, 0.05, 0.12), (-90.0, 30.0)))
STEPS = 20
COMPARED = ("wavy", "curly")
SHOWN = ("Blender's comb, default falloff", "Blender's comb, constant falloff", "Hairloom's comb")
MEASURES = ("finer_curvature", "finer_torsion", "whole_curvature", "whole_torsion")


def labels_of(strands: StrandSet, head: Head) -> tuple[Int32, ...]:
    return composed_labels(analyze(strands, head).hierarchy)


def styling(style: str, strands: StrandSet, head: Head) -> StrandSet:
    """The groom after its strokes."""
    strokes = []
    for eye, settings, start, way in STYLINGS[style][2]:
        view = look(eye, TARGET)
        strokes.append(Stroke(CombParams(**settings), view, np.eye(4), drag(view, start, way)))
    return comb(strands, labels_of(strands, head), strokes, build_collider([head]))


class Sheet:
    """Pictures in a temporary folder, put side by side at the end."""

    def __init__(self, pixels: int) -> None:
        self.pixels = pixels
        self.folder = Path(tempfile.mkdtemp())
        self.images: list[Path] = []
        self.labels: list[str] = []

    def add(self, strands: StrandSet, head: Head, label: str, view: str, radius_scale: float, frame: Float32) -> None:
        """frame (n, 3): points that the picture has to hold."""
        params = RenderParams(view=view, size=(self.pixels, self.pixels), radius_scale=radius_scale)
        path = self.folder / f"{len(self.images)}.png"
        self.images.append(render_strands(strands, head, path, params, frame_on=frame))
        self.labels.append(label)

    def write(self, path: Path, columns: int) -> None:
        side_by_side(self.images, self.labels, path, columns=columns)


def figure_styles() -> dict[str, Any]:
    """Three styles before and after a few strokes."""
    sheet, numbers = Sheet(PIXELS), {}
    for style, (name, view, _) in STYLINGS.items():
        strands, head = load_groom(style)
        result = styling(style, strands, head)
        numbers[style] = asdict(kept(strands, result.points, HeadSurface(head)))
        frame = np.concatenate([head.vertices, strands.points, result.points])
        sheet.add(strands, head, style, view, 1.0, frame)
        sheet.add(result, head, f"{style}: {name}", view, 1.0, frame)
    sheet.write(PICTURES / "comb_styles.png", 2)
    return numbers


# --- beside Blender's own comb ---


def comparison_groom(style: str) -> tuple[StrandSet, Head, tuple[Int32, ...]]:
    head = default_head()
    strands = make_style(style, head, N_COMPARED)
    return strands, head, labels_of(strands, head)


def comb_in_blender(blender: str, folder: Path) -> None:
    """The strokes of Blender's Comb in its window; see tests/gui/blender_comb.py."""
    wanted = []
    for style in COMPARED:
        strands, _, _ = comparison_groom(style)
        np.savez(folder / f"{style}.npz", points=strands.points, offsets=strands.offsets)
        for name, view, start, way in STROKES:
            stroke = {"name": f"{style}_{name}", "groom": style, "view": view, "start": start, "way": way}
            wanted.append({**stroke, "radius": RADIUS, "steps": STEPS})
    (folder / "strokes.json").write_text(json.dumps(wanted))
    window = ["--factory-startup", "--no-window-focus", "--window-geometry", "0", "0", "1600", "900"]
    script = ["--enable-event-simulate", "--python", str(ROOT / "tests/gui/blender_comb.py"), "--", str(folder)]
    env = {**os.environ, "HAIRLOOM_GUI_OUT": str(folder), "BLENDER_LIMIT": "1500"}
    subprocess.run([blender, *window, *script], env=env, check=True)


def compare(folder: Path) -> dict[str, Any]:
    """Both combs' strokes measured on the same strands: detail of those taken far, grip of those touched."""
    numbers: dict[str, Any] = {}
    sheet = Sheet(SMALL_PIXELS)
    for style in COMPARED:
        strands, head, labels = comparison_groom(style)
        collider, surface = build_collider([head]), HeadSurface(head)
        for name, _, _, _ in STROKES:
            results: dict[str, Float32] = {}
            for falloff in ("default", "constant"):
                with np.load(folder / f"{style}_{name}.{falloff}.npz") as found:
                    results[f"Blender's comb, {falloff} falloff"] = found["points"]
                    view = View(found["matrix"], *found["size"].tolist())
                    samples = np.column_stack([found["samples"], np.ones(len(found["samples"]))])
            stroke = Stroke(CombParams(radius=RADIUS, hardness=1.0), view, np.eye(4), samples)
            combed = play(strands, labels, stroke, collider)
            touched = combed.held[combed.labels]
            results["Hairloom's comb"] = combed.points
            single = Stroke(CombParams(radius=RADIUS, hardness=1.0, level=0), view, np.eye(4), samples)
            results["Hairloom's comb, single strands"] = play(strands, labels, single, collider).points
            for who, points in results.items():
                row = asdict(detail_kept(strands, points, labels[-1]))
                grip = asdict(strands_grip(strands, points, touched, stroke))
                row |= {"in_brush": grip["share"], "beside": grip["median"], **asdict(kept(strands, points, surface))}
                numbers.setdefault(f"{style}, {name}", {})[who] = row
            if name == STROKES[0][0]:
                frame = np.concatenate([head.vertices, strands.points])
                shown = {"before": strands.points, **{who: results[who] for who in SHOWN}}
                for label, points in shown.items():
                    hair = StrandSet(points, strands.offsets, strands.point_attributes, strands.strand_attributes)
                    sheet.add(hair, head, label, "side", 2.5, frame)
    sheet.write(PICTURES / "comb_blender.png", 1 + len(SHOWN))
    return numbers


def write_page(numbers: dict[str, Any]) -> None:
    """docs/figure_comb.md."""
    lines = ["# The comb", "", "Made by `python docs/figure_comb.py BLENDER`; measured by tests/comb_quality.py.", ""]
    lines += ["## Three styles", "", "A few strokes each with the comb's defaults; see STYLINGS in the script.", ""]
    lines += ["![styles](pictures/comb_styles.png)", ""]
    if "styles" in numbers:
        lines += ["| | largest change of a length | roots moved, m | deepest moved point in the head, mm |"]
        lines += ["|---|---|---|---|"]
        for style, row in numbers["styles"].items():
            lines += [f"| {style} | {row['length_error']:.1e} | {row['root_error']:g} | {1000 * row['deepest']:.2f} |"]
        lines += ["", "Negative depths are outside.", ""]
    if "blender" not in numbers:
        PAGE.write_text("\n".join(lines), encoding="utf-8")
        return
    lines += ["## Beside Blender's own comb", ""]
    lines += [f"The same drags on {N_COMPARED} strands in the window of Blender 5.2: same view, radius, start and end."]
    lines += ["From left to right: before, " + ", ".join(SHOWN) + ".", "", "![compared](pictures/comb_blender.png)", ""]
    lines += [
        "Distances of spectra, 0 equal to 1 nothing in common, of the strands that the comb took farther than 2 cm:"
    ]
    lines += [
        "*finer* with the bends of the wisps' centers taken out, *whole* as they are. *In the brush*: share of the"
    ]
    lines += [
        "strands that Hairloom holds fully at the first touch, and whose length allows it, that end within a tenth of"
    ]
    lines += [
        "the radius of their place beside the brush; *beside*: the median distance from it, in radii. *Length*: the"
    ]
    lines += [
        "largest change. *Depth* in the head, mm, of the deepest point that moved (Blender's comb was given no head).",
        "",
    ]
    lines += [
        "| | strands | finer curvature | torsion | whole curvature | torsion | in the brush | beside | length | depth |"
    ]
    lines += ["|---|---|---|---|---|---|---|---|---|---|"]
    for name, rows in numbers["blender"].items():
        for who, row in rows.items():
            cells = [f"{row[key]:.3f}" for key in MEASURES]
            cells += [f"{row['in_brush']:.0%}", f"{row['beside']:.2f}", f"{row['length_error']:.1e}"]
            lines += [
                f"| {name}: {who} | {row['n_strands']} | " + " | ".join(cells) + f" | {1000 * row['deepest']:.2f} |"
            ]
    PAGE.write_text("\n".join([*lines, ""]), encoding="utf-8")


def main() -> int:
    blender = sys.argv[1] if len(sys.argv) > 1 else ""
    everything = json.loads(NUMBERS.read_text())
    numbers = everything.setdefault("comb", {})
    if blender:
        folder = Path(tempfile.mkdtemp())
        comb_in_blender(blender, folder)
        numbers["blender"] = compare(folder)
    numbers["styles"] = figure_styles()
    NUMBERS.write_text(json.dumps(everything, indent=1) + "\n")
    write_page(numbers)
    return 0


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # pip's bpy may hang at interpreter exit
