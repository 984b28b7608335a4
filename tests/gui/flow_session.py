"""A flow in Blender's window: extracted by its button, sculpted with Blender's Comb while the hair follows, undone."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "blender")]

import bpy  # noqa: E402
import driver  # noqa: E402
import numpy as np  # noqa: E402
import scenes  # noqa: E402
import stage  # noqa: E402

LIMIT_SECONDS = 1500
BRUSH = "brushes/essentials_brushes-curve_sculpt.blend/Brush/Comb"


def hair() -> bpy.types.Object:
    """The groom; an undo makes every reference void, so it is looked up each time."""
    return next(o for o in bpy.data.objects if o.type == "CURVES" and o.hairloom_flow.source is not None)


def flow() -> bpy.types.Object:
    return hair().hairloom_flow.source


def problems() -> list[str]:
    return list(scenes.module("live_flow").live.problems.values())


def prepare(user: driver.User) -> driver.Steps:
    yield from stage.set_the_scene(user)
    groom = bpy.context.object
    points = scenes.positions(groom)
    first = scenes.module("bridge.curves").read_strands(groom).offsets[:-1]
    middle = points[first].mean(axis=0)
    azimuth = np.arctan2(points[first, 1] - middle[1], points[first, 0] - middle[0]) / (2 * np.pi) % 1.0
    scenes.module("bridge.wisps").write_labels(groom, [(azimuth * 40).astype(np.int32)])
    with user.override():
        bpy.ops.ed.undo_push(message="Wisps")
    yield 0.5


def the_button_extracts_the_flow(user: driver.User) -> driver.Steps:
    yield from user.press("bpy.ops.hairloom.extract_flow(")
    yield from user.wait(lambda: any(o.name.endswith(" Flow") for o in bpy.data.objects), 600, "no flow")
    assert bpy.context.object == flow()
    assert len(flow().data.curves) == 40
    hair().hairloom_flow.is_live = True
    yield from user.picture("flow_extracted")


def on_screen(user: driver.User, points: np.ndarray) -> np.ndarray:
    """(N, 2) window pixels of world points (N, 3)."""
    region, space = user.region(), user.area().spaces.active
    matrix = np.array(space.region_3d.perspective_matrix)
    h = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    return (h[:, :2] / h[:, 3:] * 0.5 + 0.5) * [region.width, region.height] + [region.x, region.y]


def sculpting_the_flow_moves_the_hair(user: driver.User) -> driver.Steps:
    with user.override():
        bpy.ops.object.mode_set(mode="SCULPT_CURVES")
        bpy.ops.brush.asset_activate(asset_library_type="ESSENTIALS", relative_asset_identifier=BRUSH)
        bpy.ops.ed.undo_push(message="Sculpt Mode")
    yield 1.0
    flow_before, before = scenes.positions(flow()), scenes.positions(hair())
    middle = np.median(on_screen(user, flow_before), axis=0)
    way = [(float(middle[0] + 9 * k), float(middle[1] - 3 * k)) for k in range(-5, 15)]
    yield from user.drag(way)
    assert np.abs(scenes.positions(flow()) - flow_before).max() > 1e-3, "the brush moved no flow strand"
    after = scenes.positions(hair())
    moved = np.linalg.norm(after - before, axis=1)
    assert moved.max() > 1e-3, f"the hair did not follow: {problems()}"
    offsets = scenes.module("bridge.curves").read_strands(hair()).offsets
    assert moved[offsets[:-1]].max() < 1e-6, "roots moved"
    print(f"sculpted: {(moved > 1e-3).sum()} of {len(moved)} points followed", flush=True)
    yield from user.picture("flow_sculpted")
    yield from user.key("Z", ctrl=True)
    yield 0.5
    assert np.abs(scenes.positions(flow()) - flow_before).max() < 1e-7, "Ctrl-Z did not bring the flow back"
    assert np.abs(scenes.positions(hair()) - before).max() < 2e-7, "the hair did not go back with its flow"
    yield from user.key("Z", ctrl=True, shift=True)
    yield 0.5
    assert np.abs(scenes.positions(hair()) - after).max() < 2e-7, "the hair did not go forth with its flow"
    assert problems() == []


def session(user: driver.User) -> driver.Steps:
    for part in (prepare, the_button_extracts_the_flow, sculpting_the_flow_moves_the_hair):
        yield from part(user)
        print(f"passed: {part.__name__.replace('_', ' ')}", flush=True)


bpy.context.preferences.view.show_splash = False
driver.run(session, LIMIT_SECONDS)
