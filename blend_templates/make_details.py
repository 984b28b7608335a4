"""Make the saved details that ship: `python blend_templates/make_details.py [STYLE ...]` writes details/NAME.*.

Run it with bpy 4.5, after make_grooms.py, whose starter grooms the details are from. Each is the wisp hierarchy of a
groom, thinned out (.npz), its picture, and an asset for the asset browser.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "docs")]

import bpy  # noqa: E402, I001  before the modules that it brings
from hairloom.synthesis.details import reduce_details  # noqa: E402
from hairloom.synthesis.pipeline import SynthesisParams, analyze  # noqa: E402

import addon_bridge  # noqa: E402
from make_grooms import add_groom, add_head, catalogs, load_groom, object_name  # noqa: E402
from styles import STYLES  # noqa: E402

FOLDER = HERE / "details"
N_STRANDS = 1300  # files of 1.4 MB
MAX_BYTES = 1_500_000


@dataclass(frozen=True, slots=True)
class Entry:
    """What the asset browser says about a detail."""

    description: str
    tags: tuple[str, ...]


ENTRIES: dict[str, Entry] = {
    "curly": Entry("Ringlets that hang together in locks", ("curly", "ringlets")),
    "wavy": Entry("S-shaped waves in broad locks", ("wavy",)),
    "puffy": Entry("Small tight coils, each strand for itself", ("puffy", "afro", "coils")),
    "spiky": Entry("Strands that close up in spikes", ("spiky", "gel")),
    "tangled": Entry("Loose, untidy waves with flyaways", ("tangled", "messy")),
    "straight": Entry("Sleek hair with fine ends", ("straight", "sleek")),
}


def write(style: str) -> Path:
    """Write one detail; returns its .npz."""
    strands, head = load_groom(style)
    example = analyze(strands, head, SynthesisParams())
    bpy.ops.wm.read_factory_settings(use_empty=True)
    look, entry = STYLES[style], ENTRIES[style]
    groom = add_groom(strands, add_head(head), object_name(style), look.melanin, look.redness)
    place = FOLDER / f"{object_name(style)}.npz"
    addon_bridge.detail_assets.write_files(
        place,
        reduce_details(example.hierarchy, N_STRANDS),
        example.space,
        addon_bridge.detail_assets.draw(strands, head),
        groom,
        entry.description,
        tags=entry.tags,
        catalog_id=catalogs()["Hairloom/Details"],
    )
    return place


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("styles", nargs="*", metavar="STYLE", help=f"of {', '.join(ENTRIES)}; default: all")
    too_large = 0
    for style in parser.parse_args().styles or ENTRIES:
        place = write(style)
        sizes = [place.with_suffix(suffix).stat().st_size for suffix in (".npz", ".png", ".blend")]
        too_large += sizes[0] > MAX_BYTES
        print(f"{place.stem}: " + ", ".join(f"{size / 1e6:.2f} MB" for size in sizes), flush=True)
    return 1 if too_large else 0


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # pip's bpy may hang at interpreter exit
