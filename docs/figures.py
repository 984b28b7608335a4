"""Redo the figures of Wang et al. 2009 on our starter grooms: `python docs/figures.py [fig1 fig3 fig4 fig6 fig8]`.

Writes docs/pictures/*.png, docs/figures.json with the numbers, and the page docs/figures.md. Needs bpy and matplotlib
(extra `docs`); about fifteen minutes on two cores.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "docs"), str(ROOT / "blend_templates")]

import bpy  # noqa: E402, F401  before the modules that it brings
import matplotlib  # noqa: E402

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from hairloom.geometry.scalp_space import unroot_strands  # noqa: E402
from hairloom.synthesis.baselines import synthesize_2d  # noqa: E402
from hairloom.synthesis.pipeline import Example, SynthesisParams, analyze, synthesize_from  # noqa: E402
from hairloom.synthesis.statistics import compare_styles  # noqa: E402
from hairloom.synthesis.wisps import WispParams, cluster_wisps  # noqa: E402
from hairloom.types import FeatureMap, Head, RootedStrands, StrandSet  # noqa: E402
from make_grooms import load_groom  # noqa: E402
from render import RenderParams, render_strands, side_by_side  # noqa: E402

PICTURES = ROOT / "docs" / "pictures"
NUMBERS = ROOT / "docs" / "figures.json"
PAIRS = ("puffy", "wavy", "curly", "spiky")  # Fig. 6 (a) to (d)


def params_of(style: str) -> SynthesisParams:
    """The paper's settings: two levels for the spiky style, three for all others (sec. 6)."""
    params = SynthesisParams(seed=1)
    return replace(params, hierarchy=replace(params.hierarchy, n_levels=2 if style == "spiky" else 3))


@cache
def groom(style: str) -> tuple[StrandSet, Head, Example]:
    strands, head = load_groom(style)
    return strands, head, analyze(strands, head, params_of(style))


class Sheet:
    """Pictures of one figure, collected in a temporary folder and put side by side at the end."""

    def __init__(self, head: Head, view: str = "three_quarter") -> None:
        self.head, self.view = head, view
        self.images: list[Path] = []
        self.labels: list[str] = []
        self.folder = Path(tempfile.mkdtemp())

    def add_strands(self, strands: StrandSet, label: str, radius_scale: float = 1.0) -> None:
        path = self.folder / f"{len(self.images)}.png"
        params = RenderParams(view=self.view, size=(448, 448), radius_scale=radius_scale)
        self.images.append(render_strands(strands, self.head, path, params))
        self.labels.append(label)

    def add_level(self, level: RootedStrands, example: Example, label: str) -> None:
        """A level of few strands is drawn with thicker ones."""
        thicker = float(np.clip(np.sqrt(12_000 / level.n_strands), 1.0, 8.0))
        self.add_strands(unroot_strands(level, example.space), label, thicker)

    def add_map(self, features: FeatureMap, label: str) -> None:
        path = self.folder / f"{len(self.images)}.png"
        plt.imsave(path, map_picture(features, 448))
        self.images.append(path)
        self.labels.append(label)

    def write(self, name: str, columns: int | None = None) -> None:
        side_by_side(self.images, self.labels, PICTURES / f"{name}.png", columns=columns)


def map_picture(features: FeatureMap, size: int) -> np.ndarray:
    """The first three principal components as red, green and blue, each stretched to its own range."""
    values = features.values[..., :3]
    inside = values[features.mask]
    low, high = np.percentile(inside, [2, 98], axis=0)
    colours = np.clip((values - low) / np.maximum(high - low, 1e-9), 0, 1)
    colours[~features.mask] = 1.0
    scale = max(1, size // max(colours.shape[:2]))
    enlarged = np.kron(colours[::-1], np.ones((scale, scale, 1)))
    page = np.ones((size, size, 3))
    top, left = (size - enlarged.shape[0]) // 2, (size - enlarged.shape[1]) // 2
    page[top : top + enlarged.shape[0], left : left + enlarged.shape[1]] = enlarged
    return page


def figure_1() -> dict[str, Any]:
    """Pipeline: levels 0 to 2 of the input, its feature map, the synthesised map, levels 2 to 0 of the output."""
    strands, head, example = groom("wavy")
    result = synthesize_from(example, head, params_of("wavy"))
    sheet = Sheet(head)
    sheet.add_strands(strands, "a  input, level 0")
    sheet.add_level(example.hierarchy.levels[1], example, "b  input, level 1")
    sheet.add_level(example.hierarchy.levels[2], example, "c  input, level 2")
    sheet.add_map(result.example_map, "d  feature map of c")
    sheet.add_map(result.result_map, "e  synthesised map")
    sheet.add_level(result.levels[2], example, "f  output, level 2")
    sheet.add_level(result.levels[1], example, "g  output, level 1")
    sheet.add_strands(result.strands, "h  output, level 0")
    sheet.write("fig1_pipeline", columns=4)
    return {"levels": [level.n_strands for level in result.levels]}


def figure_3() -> dict[str, Any]:
    """Energy over the iterations of the adaptive clustering; dots where clusters are split, with their number."""
    strands, _, example = groom("wavy")
    settings = {
        "as in the paper": WispParams(seeds_per_wisp=1, seeds_per_split=1, merge=False, iterations_per_split=40),
        "ours": WispParams(),
    }
    figure, axes = plt.subplots(figsize=(8, 4.2), dpi=120)
    numbers = {}
    for (name, params), colour in zip(settings.items(), ("black", "tab:blue")):
        wisps = cluster_wisps(example.hierarchy.levels[0], params)
        energies = np.array(wisps.energies)
        axes.plot(energies, color=colour, linewidth=1.2, label=f"{name}: {wisps.n_wisps} wisps")
        splits = [(min(iteration, len(energies) - 1), count) for iteration, count in wisps.splits]
        axes.plot(
            [place for place, _ in splits], energies[[place for place, _ in splits]], "o", color="red", markersize=3
        )
        for place, count in splits[:: max(1, len(splits) // 8)]:
            label = {"xytext": (3, 5), "textcoords": "offset points", "fontsize": 7, "style": "italic"}
            axes.annotate(f"{count}", (place, energies[place]), **label)
        numbers[name] = {
            "wisps": wisps.n_wisps,
            "first": energies[0],
            "last": energies[-1],
            "iterations": len(energies),
        }
    title = f"{strands.n_strands} strands of the wavy groom, epsilon {params.error_threshold}"
    axes.set(xlabel="iteration", ylabel="energy (eq. 3), head radii squared", title=title)
    axes.set_yscale("log")
    axes.legend()
    figure.tight_layout()
    figure.savefig(PICTURES / "fig3_energy.png")
    plt.close(figure)
    return numbers


def figure_4() -> dict[str, Any]:
    """Without and with the refinement by a vector field."""
    _, head, example = groom("wavy")
    params = params_of("wavy")
    plain = synthesize_from(example, head, replace(params, use_refinement=False))
    refined = synthesize_from(example, head, params)
    sheet = Sheet(head)
    sheet.add_strands(plain.strands, "without vector field")
    sheet.add_strands(refined.strands, "with vector field")
    sheet.write("fig4_refinement")
    return {"refinement": [asdict(report) for report in refined.refine_reports]}


def figure_6() -> dict[str, Any]:
    """Four pairs of input and output, no user interaction."""
    numbers = {}
    sheet = None
    for style in PAIRS:
        strands, head, example = groom(style)
        result = synthesize_from(example, head, params_of(style))
        sheet = sheet or Sheet(head)
        sheet.add_strands(strands, f"{style}: input")
        sheet.add_strands(result.strands, f"{style}: output")
        sheet.add_map(result.result_map, f"{style}: feature map")
        numbers[style] = asdict(compare_styles(example.hierarchy.levels[0], result.levels[0]))
    assert sheet is not None
    sheet.write("fig6_pairs", columns=3)
    return numbers


def figure_8() -> dict[str, Any]:
    """Against conventional 2D synthesis at the finest level."""
    strands, head, example = groom("wavy")
    params = params_of("wavy")
    result = synthesize_from(example, head, params)
    flat = synthesize_2d(example.hierarchy.levels[0], result.levels[0], seed=params.seed)
    sheet = Sheet(head)
    sheet.add_strands(strands, "input")
    sheet.add_strands(result.strands, "ours")
    sheet.add_strands(unroot_strands(flat, example.space), "2D synthesis")
    sheet.write("fig8_2d")
    finest = example.hierarchy.levels[0]
    return {"ours": asdict(compare_styles(finest, result.levels[0])), "2d": asdict(compare_styles(finest, flat))}


FIGURES: dict[str, Callable[[], dict[str, Any]]] = {
    "fig1": figure_1, "fig3": figure_3, "fig4": figure_4, "fig6": figure_6, "fig8": figure_8,
}  # fmt: skip


def table(rows: dict[str, dict[str, Any]]) -> list[str]:
    """Markdown table of style reports."""
    columns = ("length", "curvature", "torsion", "tip_direction", "wisp_size", "copied_share")
    lines = ["| | " + " | ".join(c.replace("_", " ") for c in columns) + " |", "|---|" + "---|" * len(columns)]
    lines += [f"| {name} | " + " | ".join(f"{row[c]:.2f}" for c in columns) + " |" for name, row in rows.items()]
    return lines


def write_page(numbers: dict[str, Any]) -> None:
    """docs/figures.md: the pictures with the numbers measured with them."""
    lines = ["# The paper's figures on our grooms", "", "Made by `python docs/figures.py`; no user interaction.", ""]
    lines += [
        "Distances between input and output are Kolmogorov-Smirnov statistics (0 equal, 1 no overlap). The copied"
    ]
    lines += [
        "share is that of output strands closer to the most similar input strand at the same root than that one is"
    ]
    lines += ["to its own nearest neighbour.", ""]
    if "fig1" in numbers:
        lines += ["## Fig. 1: the stages", "", f"Strands per level: {numbers['fig1']['levels']}.", ""]
        lines += ["![stages](pictures/fig1_pipeline.png)", ""]
    if "fig3" in numbers:
        lines += [
            f"{name}: from {n['first']:.4g} to {n['last']:.4g} in {n['iterations']} iterations, {n['wisps']} wisps."
            for name, n in numbers["fig3"].items()
        ]
        lines += [
            "Red: splits, with the number of wisps; the last of ours is the merging of wisps that fit together.",
            "",
        ]
        lines += ["![energy](pictures/fig3_energy.png)", ""]
    if "fig4" in numbers:
        lines += [
            "## Fig. 4: the vector field",
            "",
            "Local angular spread of tangents, degrees, coarsest level first: ",
        ]
        lines += [
            ", ".join(f"{r['spread_before']:.2f} to {r['spread_after']:.2f}" for r in numbers["fig4"]["refinement"])
        ]
        lines += ["", "![refinement](pictures/fig4_refinement.png)", ""]
    if "fig6" in numbers:
        lines += ["## Fig. 6: four pairs", "", *table(numbers["fig6"]), "", "![pairs](pictures/fig6_pairs.png)", ""]
    lines += ["## Fig. 7", "", "Detail transfer: [figure_transfer.md](figure_transfer.md)."]
    lines += ["The comb, also beside Blender's own: [figure_comb.md](figure_comb.md).", ""]
    if "fig8" in numbers:
        lines += ["## Fig. 8: against 2D synthesis", "", *table(numbers["fig8"]), "", "![2D](pictures/fig8_2d.png)", ""]
    (ROOT / "docs" / "figures.md").write_text("\n".join(lines), encoding="utf-8")


def main() -> int:
    PICTURES.mkdir(exist_ok=True)
    numbers = json.loads(NUMBERS.read_text()) if NUMBERS.exists() else {}
    for name in sys.argv[1:] or FIGURES:
        print(f"{name}: {FIGURES[name].__doc__}", flush=True)
        numbers[name] = FIGURES[name]()
        NUMBERS.write_text(json.dumps(numbers, indent=1) + "\n")
    write_page(numbers)
    return 0


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # pip's bpy may hang at interpreter exit
