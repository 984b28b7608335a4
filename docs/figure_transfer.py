"""Redo Fig. 7 (detail transfer) of Wang et al. 2009 on our starter grooms: `python docs/figure_transfer.py`.

Writes docs/pictures/fig7_transfer.png and the page docs/figure_transfer.md with what was measured. Needs bpy; about
three minutes on two cores.
"""

from __future__ import annotations

import os
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "docs"), str(ROOT / "blend_templates")]

import bpy  # noqa: E402, F401  before the modules that it brings
from hairloom.jobs.transfer_details import as_strand_set, transfer_report  # noqa: E402
from hairloom.synthesis.detail_transfer import DetailParams, transfer_style  # noqa: E402
from hairloom.synthesis.pipeline import Example, SynthesisParams, analyze  # noqa: E402
from hairloom.types import Head, StrandSet  # noqa: E402
from make_grooms import load_groom  # noqa: E402
from render import RenderParams, render_strands, side_by_side  # noqa: E402

PICTURE = ROOT / "docs" / "pictures" / "fig7_transfer.png"
PAGE = ROOT / "docs" / "figure_transfer.md"
PIXELS = 264  # the picture stays below a megabyte
PAIRS = (("curly", "straight"), ("spiky", "wavy"), ("puffy", "straight"))
# the last pair again in other ways: hair five times as long as that which the details are from
WAYS = {
    "plain, the paper's": DetailParams(length_mode="plain", matching="similar"),
    "scale": DetailParams(length_mode="scale"),
    "tile, half strength": DetailParams(strength=0.5),
}


@cache
def groom(style: str) -> tuple[StrandSet, Head, Example]:
    """A starter groom with its head and its wisps."""
    strands, head = load_groom(style)
    return strands, head, analyze(strands, head, SynthesisParams(seed=1))


def transfer(detail: str, base: str, params: DetailParams) -> tuple[StrandSet, dict[str, Any]]:
    """The base groom with the other's details, and how far its details are from them before and after."""
    strands, _, example = groom(base)
    source = groom(detail)[2].hierarchy
    result = transfer_style(source, example.hierarchy, params)
    report = transfer_report(source, example.hierarchy, result, params)
    return as_strand_set(result.strands, example.space, strands), report


class Sheet:
    """Pictures in a temporary folder, put side by side at the end."""

    def __init__(self, pixels: int = PIXELS) -> None:
        self.folder = Path(tempfile.mkdtemp())
        self.render = RenderParams(size=(pixels, pixels))
        self.images: list[Path] = []
        self.labels: list[str] = []

    def add(self, strands: StrandSet, head: Head, label: str) -> None:
        path = self.folder / f"{len(self.images)}.png"
        self.images.append(render_strands(strands, head, path, self.render))
        self.labels.append(label)

    def write(self, path: Path) -> None:
        side_by_side(self.images, self.labels, path, columns=3)


def make_sheet(sheet: Sheet) -> dict[str, dict[str, Any]]:
    """Render all rows; returns the report of each transfer."""
    reports = {}
    for detail, base in PAIRS:
        made, reports[f"{detail} on {base}"] = transfer(detail, base, DetailParams())
        sheet.add(groom(detail)[0], groom(detail)[1], f"details from {detail}")
        sheet.add(groom(base)[0], groom(base)[1], f"shape from {base}")
        sheet.add(made, groom(base)[1], f"{detail} on {base}")
    detail, base = PAIRS[-1]
    for name, params in WAYS.items():
        made, reports[f"{detail} on {base}, {name}"] = transfer(detail, base, params)
        sheet.add(made, groom(base)[1], name)
    return reports


def write_page(reports: dict[str, dict[str, Any]]) -> None:
    """docs/figure_transfer.md."""
    columns = list(next(iter(reports.values()))["distance_before"])
    lines = ["# Fig. 7 on our grooms: detail transfer", "", "Made by `python docs/figure_transfer.py`.", ""]
    lines += ["![transfer](pictures/fig7_transfer.png)", ""]
    lines += ["From left to right: the groom that gives the details, the groom that gives the shape, the result with"]
    lines += [
        "default settings. Last row: the third pair by the paper's own way, by scaling, and at half strength.",
        "",
    ]
    lines += ["Distance of spectra from those of the groom that gives the details, before to after, 0 (alike) to 1:"]
    lines += ["`details` is what the finer levels add to the coarsest; the rest is of whole strands. Spikes are wisps"]
    lines += ["that close up to a point, hardly a wave: their spectra say little of them.", ""]
    lines += ["| | " + " | ".join(columns) + " |", "|---|" + "---|" * len(columns)]
    for name, report in reports.items():
        pairs = [(report["distance_before"][c], report["distance_after"][c]) for c in columns]
        lines += [f"| {name} | " + " | ".join(f"{before:.2f} to {after:.2f}" for before, after in pairs) + " |"]
    PAGE.write_text("\n".join([*lines, ""]), encoding="utf-8")


def main() -> int:
    sheet = Sheet(int(sys.argv[1]) if len(sys.argv) > 1 else PIXELS)
    reports = make_sheet(sheet)
    PICTURE.parent.mkdir(exist_ok=True)
    sheet.write(PICTURE)
    write_page(reports)
    return 0


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # pip's bpy may hang at interpreter exit
