"""Blender's own Comb on grooms in the window, stroke by stroke, for a comparison with Hairloom's; no add-on needed.

    blender --enable-event-simulate ... --python tests/gui/blender_comb.py -- FOLDER

`docs/figure_comb.py BLENDER` writes FOLDER and calls it. FOLDER/<groom>.npz: points (P, 3) metres and offsets (S + 1,).
FOLDER/strokes.json: a list of {name, groom, view ("RIGHT", ...), start (3 numbers, the world place where the brush
starts), way (2 numbers, pixels), radius (pixels), steps}. Writes FOLDER/<name>.<falloff>.npz: points after the stroke,
matrix (4, 4) and size (2,) of the view, samples (n, 2) in pixels of it. Falloff: "default", the brush as it comes, and
"constant", the same brush with all its strength up to its rim.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE)]

import bpy  # noqa: E402
import driver  # noqa: E402
import numpy as np  # noqa: E402

LIMIT_SECONDS = 1500
BRUSH = "brushes/essentials_brushes-curve_sculpt.blend/Brush/Comb"
FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
FALLOFFS = ("default", "constant")
MIDDLE = (0.0, 0.02, 0.12)  # metres, that the view turns about
VIEW_DISTANCE = 0.95  # metres from there


def hair() -> bpy.types.Object:
    """The groom, looked up anew: references do not outlive an undo."""
    return next(obj for obj in bpy.data.objects if obj.type == "CURVES")


def positions() -> np.ndarray:
    data = hair().data.attributes["position"].data
    found = np.empty(3 * len(data), np.float32)
    data.foreach_get("vector", found)
    return found.reshape(-1, 3)


def add_groom(user: driver.User, name: str) -> driver.Steps:
    """The only object of the file becomes the groom, in Sculpt Mode with Blender's Comb."""
    with user.override():
        if bpy.context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        bpy.ops.object.select_all(action="SELECT")
        bpy.ops.object.delete()
        with np.load(FOLDER / f"{name}.npz") as arrays:
            points, offsets = arrays["points"], arrays["offsets"]
        data = bpy.data.hair_curves.new(name)
        data.add_curves(np.diff(offsets).tolist())
        data.attributes["position"].data.foreach_set("vector", points.astype(np.float32).ravel())
        groom = bpy.data.objects.new(name, data)
        bpy.context.collection.objects.link(groom)
        bpy.context.view_layer.objects.active = groom
        groom.select_set(True)
        bpy.ops.object.mode_set(mode="SCULPT_CURVES")
        bpy.ops.brush.asset_activate(asset_library_type="ESSENTIALS", relative_asset_identifier=BRUSH)
        bpy.ops.ed.undo_push(message="Groom")
    yield 1.0


def paint() -> Any:
    return bpy.context.scene.tool_settings.curves_sculpt


def set_brush(radius: float, falloff: str) -> None:
    """Radius in pixels; the rest of the brush is as it comes, or without falloff."""
    brush, unified = paint().brush, paint().unified_paint_settings
    for owner in (brush, unified):
        # Blender 5 counts the size across the brush, 4.5 from its middle
        is_diameter = "iameter" in owner.bl_rna.properties["size"].description
        owner.size = round(radius * (2 if is_diameter else 1))
    brush.curve_distance_falloff_preset = "CONSTANT" if falloff == "constant" else "CUSTOM"


def look_from(user: driver.User, view: str) -> driver.Steps:
    with user.override():
        bpy.ops.view3d.view_axis(type=view)
    yield 1.0
    region_3d = user.area().spaces.active.region_3d
    region_3d.view_perspective = "PERSP"
    region_3d.view_location = MIDDLE
    region_3d.view_distance = VIEW_DISTANCE
    yield 1.0


def seen_from(user: driver.User) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The view's matrix (4, 4), its size (2,) in pixels, and where it begins in the window (2,)."""
    region = user.region()
    matrix = np.array(user.area().spaces.active.region_3d.perspective_matrix, np.float64)
    return matrix, np.array([region.width, region.height], float), np.array([region.x, region.y], float)


def make_stroke(user: driver.User, stroke: dict[str, Any], falloff: str) -> driver.Steps:
    matrix, size, corner = seen_from(user)
    clip = matrix @ np.array([*stroke["start"], 1.0])
    first = (clip[:2] / clip[3] + 1.0) / 2.0 * size
    way = np.linspace(0.0, 1.0, stroke["steps"])[:, None] * np.array(stroke["way"])
    samples = np.round(first + way)
    set_brush(stroke["radius"], falloff)
    before = positions()
    yield from user.drag([(float(x), float(y)) for x, y in samples + corner])
    yield 0.5
    after = positions()
    moved = np.linalg.norm(after - before, axis=1)
    print(f"{stroke['name']} {falloff}: {(moved > 1e-3).sum():,} points moved, {moved.max():.3f} m", flush=True)
    path = FOLDER / f"{stroke['name']}.{falloff}.npz"
    np.savez(path, points=after, matrix=matrix, size=size, samples=samples)
    yield from user.picture(f"blender_{stroke['name']}_{falloff}")
    yield from user.key("Z", ctrl=True)
    assert positions().tobytes() == before.tobytes(), "undo does not lead back"


def session(user: driver.User) -> driver.Steps:
    strokes = json.loads((FOLDER / "strokes.json").read_text())
    space = user.area().spaces.active
    space.overlay.show_floor = space.overlay.show_cursor = False
    groom = view = ""
    for stroke in strokes:
        if stroke["groom"] != groom:
            groom, view = stroke["groom"], ""
            yield from add_groom(user, groom)
        if stroke["view"] != view:
            view = stroke["view"]
            yield from look_from(user, view)
        for falloff in FALLOFFS:
            yield from make_stroke(user, stroke, falloff)


bpy.context.preferences.view.show_splash = False
driver.run(session, LIMIT_SECONDS)
