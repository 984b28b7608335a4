"""Make the starter grooms: `python blend_templates/make_grooms.py [STYLE ...]` writes STYLE.blend and head.blend here.

Run it with bpy 4.5, so that every later Blender opens the files. Each holds a Curves object on Hairloom's plain head,
with material, catalogue, tags and preview; the same script gives the same strands to the bit.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "docs")]

import bpy  # noqa: E402, I001  before the modules that it brings
import numpy as np  # noqa: E402
from hairloom.errors import FileError, require  # noqa: E402
from hairloom.geometry.head import default_head  # noqa: E402
from hairloom.types import Float32, Head, StrandSet  # noqa: E402

import addon_bridge  # noqa: E402
from render import RenderParams, head_material, render_strands, shade_scalp  # noqa: E402
from styles import STYLES, make_style  # noqa: E402

HEAD = "Hairloom Head"
LICENSE = "GPL-3.0-or-later"
GRID = 2.0**-16  # metres; 15 micrometres. Coordinates on a grid leave zeros in the floats, which compress
PREVIEW_PIXELS = 256


@dataclass(frozen=True, slots=True)
class Entry:
    """What the asset browser says about a groom. catalog : path in blender_assets.cats.txt."""

    catalog: str
    description: str
    tags: tuple[str, ...]


LONG, SHORT = "Hairloom/Grooms/Long", "Hairloom/Grooms/Short"
ENTRIES: dict[str, Entry] = {
    "straight": Entry(LONG, "Long and sleek, parted in the middle", ("long", "straight", "parted")),
    "wavy": Entry(LONG, "Long S-shaped waves in broad locks, parted on the side", ("long", "wavy", "parted")),
    "curly": Entry(LONG, "Ringlets to the chin, full at the sides", ("long", "curly", "ringlets")),
    "spiky": Entry(SHORT, "Spikes held by gel, up on top and close at the sides", ("short", "spiky", "straight")),
    "puffy": Entry(SHORT, "A round afro of small coils", ("short", "puffy", "afro", "coils")),
    "bob": Entry(SHORT, "Chin-long and cut straight, with a fringe, ends turned in", ("short", "bob", "fringe")),
    "short_crop": Entry(SHORT, "Short crop, brushed forward around a whorl", ("short", "crop", "whorl")),
    "tangled": Entry(LONG, "Shoulder-long, tangled and untidy", ("long", "tangled", "messy")),
}


def blend_path(style: str) -> Path:
    """The file of a starter groom."""
    return HERE / f"{style}.blend"


def object_name(style: str) -> str:
    """The groom's name in its file and in the asset browser."""
    return style.replace("_", " ").title()


def add_head(head: Head, collection: Any = None) -> Any:
    """A mesh object with the head's faces, UV map, 'Scalp' vertex group and skin; by default in the scene."""
    surface = addon_bridge.mesh.new_head_object(HEAD, head, collection or bpy.context.scene.collection)
    shade_scalp(surface.data, head)
    surface.data.materials.append(head_material("Hairloom Skin"))
    return surface


def add_groom(strands: StrandSet, surface: Any, name: str, melanin: float = 0.6, redness: float = 0.5) -> Any:
    """A Curves object with hair material that hangs on the head object `surface`, in the surface's collection."""
    groom = addon_bridge.curves.new_object(name, strands, surface.users_collection[0])
    addon_bridge.attachment.attach_to_head(groom, surface)
    material = addon_bridge.material.hair_material().copy()
    material.name = f"{name} Hair"
    hair = next(node for node in material.node_tree.nodes if node.type == "BSDF_HAIR_PRINCIPLED")
    hair.inputs["Melanin"].default_value = melanin
    hair.inputs["Melanin Redness"].default_value = redness
    groom.data.materials.append(material)
    return groom


def load_groom(style: str, path: Path | str | None = None) -> tuple[StrandSet, Head]:
    """Read a starter groom and the head it grows on out of its .blend file; the open file is left as it was.

    Raises
    ------
    FileError : no such file, or the groom is not in it.
    """
    path = Path(path) if path is not None else blend_path(style)
    if not path.is_file():
        raise FileError(f"{path}: no such starter groom; there are {', '.join(sorted(ENTRIES))}")
    kinds = ("objects", "meshes", "hair_curves", "materials", "images", "collections")
    before = {kind: {item.session_uid for item in getattr(bpy.data, kind)} for kind in kinds}
    name = object_name(style)
    with bpy.data.libraries.load(str(path), link=False) as (source, wanted):
        if name not in source.objects:
            raise FileError(f"{path}: holds no object '{name}'")
        wanted.objects = [name]
    groom = wanted.objects[0]
    try:
        strands = addon_bridge.curves.read_strands(groom)
        head = addon_bridge.mesh.read_head(groom.data.surface, evaluated=False)
    finally:
        for kind in kinds:
            collection = getattr(bpy.data, kind)
            for item in [item for item in collection if item.session_uid not in before[kind]]:
                collection.remove(item)
    return strands, head


def on_grid(points: Float32) -> Float32:
    """Points (P, 3) metres rounded to the grid that compresses well."""
    return (np.round(points / GRID) * GRID).astype(np.float32)


def write_groom(style: str, head: Head) -> Path:
    """Grow a style and write its .blend file with preview."""
    grown = make_style(style, head)
    strands = StrandSet(on_grid(grown.points), grown.offsets, grown.point_attributes, grown.strand_attributes)
    look = STYLES[style]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    groom = add_groom(strands, add_head(head), object_name(style), look.melanin, look.redness)
    entry = ENTRIES[style]
    with tempfile.TemporaryDirectory() as folder:
        params = RenderParams(
            size=(PREVIEW_PIXELS, PREVIEW_PIXELS), samples=48, melanin=look.melanin, redness=look.redness
        )
        picture = render_strands(strands, head, Path(folder) / "preview.png", params)
        mark_asset(groom, entry, picture)
    return save(blend_path(style))


def write_head(head: Head) -> Path:
    """Write head.blend, the plain head alone."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    surface = add_head(head)
    entry = Entry("Hairloom/Heads", "Plain head with a 'Scalp' vertex group and UVs", ("head", "scalp"))
    with tempfile.TemporaryDirectory() as folder:
        params = RenderParams(size=(PREVIEW_PIXELS, PREVIEW_PIXELS), samples=48)
        mark_asset(surface, entry, render_strands([], head, Path(folder) / "preview.png", params))
    return save(HERE / "head.blend")


def mark_asset(item: Any, entry: Entry, picture: Path) -> None:
    """Make an object an asset with a catalogue, tags, texts and a picture."""
    item.asset_mark()
    data = item.asset_data
    data.catalog_id = catalogs()[entry.catalog]
    data.description, data.author, data.license = entry.description, "Hairloom", LICENSE
    for tag in entry.tags:
        data.tags.new(tag)
    with bpy.context.temp_override(id=item):
        bpy.ops.ed.lib_id_load_custom_preview(filepath=str(picture))
    require(item.preview is not None, f"'{item.name}' took no preview")


def catalogs() -> dict[str, str]:
    """Catalogue path -> id, from blender_assets.cats.txt."""
    lines = (HERE / "blender_assets.cats.txt").read_text(encoding="utf-8").splitlines()
    entries = [line.split(":") for line in lines if line.count(":") == 2 and not line.startswith("#")]
    return {path: identifier for identifier, path, _ in entries}


def save(path: Path) -> Path:
    """Save the open file, compressed, without a backup beside it."""
    bpy.context.preferences.filepaths.save_version = 0
    bpy.ops.outliner.orphans_purge(do_recursive=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True)
    return path


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "styles", nargs="*", metavar="STYLE", help=f"of {', '.join(ENTRIES)}; default: all, and the head"
    )
    chosen = parser.parse_args().styles or [*ENTRIES, "head"]
    head = default_head()
    written = [write_head(head) if style == "head" else write_groom(style, head) for style in chosen]
    for path in written:
        print(f"{path.stat().st_size / 1e6:6.2f} MB  {path.name}")
    return 0


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # pip's bpy may hang at interpreter exit
