"""Twenty strokes on a real groom, thinned to what software drawing can keep up with; run by run.py."""

from __future__ import annotations

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "blender")]

import bpy  # noqa: E402
import driver  # noqa: E402
import numpy as np  # noqa: E402
import scenes  # noqa: E402
from combing import check_strands, hair, moved, on_screen, positions, settings, world  # noqa: E402

LIMIT_SECONDS = 1500
N_STRANDS = 1900
DATA = Path(os.environ.get("HAIRLOOM_DATA") or HERE.parents[2] / "shared" / "data") / "sintel"
DEEPEST = 0.0005  # metres, the limit
# four strokes from each side: mode, where on the screen it starts within the hair's box, and its way in pixels
STROKES = {
    "FRONT": (
        ("comb", (0.35, 0.8), (-70, -60)), ("comb", (0.65, 0.8), (60, -70)), ("smooth", (0.2, 0.6), (-20, -90)),
        ("lift", (0.5, 0.93), (0, 25)),
    ),
    "RIGHT": (
        ("comb", (0.3, 0.65), (120, -30)), ("comb", (0.4, 0.8), (110, -40)), ("smooth", (0.6, 0.6), (40, -110)),
        ("lift", (0.6, 0.9), (20, 15)),
    ),
    "BACK": (
        ("comb", (0.4, 0.65), (-40, -110)), ("comb", (0.6, 0.65), (40, -110)), ("twist", (0.5, 0.35), (40, 0)),
        ("length", (0.5, 0.15), (0, 20)),
    ),
    "LEFT": (
        ("comb", (0.7, 0.65), (-120, -30)), ("comb", (0.6, 0.8), (-110, -40)), ("smooth", (0.4, 0.6), (-40, -110)),
        ("lift", (0.4, 0.9), (-20, 15)),
    ),
    "TOP": (
        ("comb", (0.4, 0.4), (-30, 70)), ("comb", (0.6, 0.4), (30, 70)), ("smooth", (0.5, 0.5), (0, 60)),
        ("twist", (0.5, 0.7), (30, 0)),
    ),
}  # fmt: skip


def import_groom(user: driver.User) -> driver.Steps:
    """Sintel's hair, cleaned up, thinned and clustered, on her head."""
    units = scenes.module("backend.io.units").Units.parse("m,y-up")
    strands = scenes.module("backend.io.strands").read_strands(DATA / "hair.tfx", units=units)
    geometry = scenes.module("backend.geometry.head")
    head = geometry.find_scalp(geometry.read_head(DATA / "head.obj", units), strands.roots)
    strands = scenes.module("backend.geometry.cleanup").clean_up(strands, head)[0]
    step = max(1, strands.n_strands // N_STRANDS)
    chosen = list(range(0, strands.n_strands, step))
    strands = scenes.module("backend.geometry.strands").select_strands(strands, chosen)
    with user.override():
        bpy.ops.object.select_all(action="SELECT")
        bpy.ops.object.delete()
        mesh = scenes.module("bridge.mesh").new_head_object("Sintel", head, bpy.context.collection)
        bpy.context.scene.hairloom.head = mesh
        groom = scenes.module("bridge.curves").new_object("Hair", strands, bpy.context.collection)
        groom.data.materials.append(scenes.module("material").hair_material())
        scenes.activate(groom)
        bpy.context.scene.hairloom.synthesis.hierarchy.wisps.n_wisps = 100
        assert bpy.ops.hairloom.cluster_wisps() == {"FINISHED"}
        space = user.area().spaces.active
        space.show_region_ui = False
        space.overlay.show_floor = space.overlay.show_cursor = False
        bpy.ops.view3d.view_axis(type="FRONT")
        bpy.ops.view3d.view_selected()
        groom.select_set(False)
        bpy.ops.wm.tool_set_by_id(name="hairloom.comb_tool")
        settings().record = True
        bpy.ops.ed.undo_push(message="Import")
    yield 1.5


deepest: list[float] = []  # of each stroke, metres


def depths(points: np.ndarray) -> np.ndarray:
    """Metres inside the head, of each point; negative outside."""
    head = scenes.module("bridge.mesh").read_head(bpy.data.objects["Sintel"])
    return -scenes.module("backend.geometry.head").HeadSurface(head).signed_distance(points)


def stroke(user: driver.User, mode: str, start: tuple[float, float], way: tuple[float, float]) -> driver.Steps:
    """One drag; the brush starts where that share of the hair's box on the screen is."""
    low, high = np.percentile(on_screen(user, world()), [2, 98], axis=0)
    first = low + (high - low) * start
    places = first + np.linspace(0, 1, 12)[:, None] * np.array(way)
    settings().mode = mode
    before, was_deep = positions(), depths(world())
    yield from user.drag([(float(x), float(y)) for x, y in places])
    after = positions()
    has_moved = moved(before, after) > 0
    deep = depths(world())
    # sintel's own hair may start inside; what counts is hair that a stroke took deeper
    pushed = np.where(has_moved, np.minimum(deep, deep - np.maximum(was_deep, 0.0)), -1.0)
    too_deep, worst = int((pushed > DEEPEST).sum()), float(pushed.max())
    print(
        f"{mode}: {int(has_moved.sum()):,} points moved; deepest in the head {1000 * worst:.2f} mm at "
        f"{world()[pushed.argmax()].round(3).tolist()}, {too_deep} deeper than {1000 * DEEPEST} mm",
        flush=True,
    )
    assert has_moved.any(), f"the {mode} at {first} moved nothing"
    check_strands(before, after, resized=mode == "length")
    deepest.append(worst)


def twenty_strokes_keep_roots_lengths_and_head(user: driver.User) -> driver.Steps:
    start = positions()
    yield from user.picture("sintel_before")
    for view, strokes in STROKES.items():
        with user.override():
            bpy.ops.view3d.view_axis(type=view)
        yield 1.5
        for mode, place, way in strokes:
            yield from stroke(user, mode, place, way)
        yield from user.picture(f"sintel_{view.lower()}")
    with user.override():
        bpy.ops.view3d.view_axis(type="FRONT")
    yield 1.5
    yield from user.picture("sintel_after")
    done = positions()
    assert len(scenes.module("recording").strokes(hair().data)) == 20
    yield from the_recorded_strokes_give_the_same_bytes(user, start, done)
    for _ in range(20):
        yield from user.key("Z", ctrl=True)
    yield from user.wait(lambda: positions().tobytes() == start.tobytes(), 60, "twenty undos lead back")
    assert max(deepest) < DEEPEST, f"a stroke pushed hair {1000 * max(deepest):.2f} mm into the head"


def the_recorded_strokes_give_the_same_bytes(user: driver.User, start: np.ndarray, done: np.ndarray) -> driver.Steps:
    path = str(driver.OUT / "sintel_strokes.json")
    with user.override():
        assert bpy.ops.hairloom.save_strokes(filepath=path) == {"FINISHED"}
        copy = hair().copy()
        copy.data = hair().data.copy()
        bpy.context.collection.objects.link(copy)
        scenes.module("bridge.attributes").write_values(copy.data.position_data, "vector", start, np.float32, 3)
        settings().record = False
        scenes.activate(copy)
        assert bpy.ops.hairloom.play_strokes(filepath=path) == {"FINISHED"}
        assert scenes.positions(copy).tobytes() == done.tobytes(), "the recorded strokes do not give the same bytes"
        bpy.data.hair_curves.remove(copy.data)
        scenes.activate(hair())
    yield 0.5


def test(user: driver.User) -> driver.Steps:
    if not DATA.is_dir():
        print(f"skipped: {DATA} is missing; set HAIRLOOM_DATA", flush=True)
        return
    yield from import_groom(user)
    yield from twenty_strokes_keep_roots_lengths_and_head(user)


bpy.context.preferences.view.show_splash = False
driver.run(test, LIMIT_SECONDS)
