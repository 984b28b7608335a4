"""Detail transfer in a window: a saved detail applied by its button, live update, saving, undo; run by run.py."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "blender")]

import bpy  # noqa: E402
import driver  # noqa: E402
import scenes  # noqa: E402
import stage  # noqa: E402

LIMIT_SECONDS = 1500
WORK_SECONDS = 600  # compiling in the worker included


def state() -> bpy.types.PropertyGroup:
    return bpy.context.window_manager.hairloom_details


def grooms() -> list[str]:
    return [obj.name for obj in bpy.context.scene.objects if obj.type == "CURVES"]


def is_idle() -> bool:
    return not bpy.context.window_manager.hairloom_job.is_running


def a_saved_detail_is_applied_by_its_button(user: driver.User) -> driver.Steps:
    before = grooms()
    state().saved_detail = "Curly"
    yield 1.0
    yield from user.press("bpy.ops.hairloom.apply_detail(")
    yield from user.picture("details_saved")
    yield from user.wait(lambda: len(grooms()) > len(before), WORK_SECONDS, "the detail applied")
    yield from user.wait(is_idle, 30, "the job over")
    result = bpy.context.object
    assert result.name.endswith("Curly"), result.name
    assert result.hairloom_transfer.base.name == before[0]
    bpy.data.objects[before[0]].hide_set(True)
    result.select_set(False)  # its outline would hide it
    yield from user.picture("details_applied")


def live_follows_a_setting(user: driver.User) -> driver.Steps:
    settings = bpy.context.scene.hairloom.details.settings
    before = scenes.positions(bpy.context.object).tobytes()
    state().is_live = True
    yield 1.0
    assert scenes.positions(bpy.context.object).tobytes() == before, "Live changed hair before any setting changed"
    settings.strength = 0.4
    yield from user.wait(lambda: scenes.positions(bpy.context.object).tobytes() != before, WORK_SECONDS, "live update")
    print(f"live: {state().message}", flush=True)
    yield from user.picture("details_live")
    settings.strength = 1.0
    yield from user.wait(lambda: scenes.positions(bpy.context.object).tobytes() == before, 60, "back again")
    state().is_live = False
    yield 0.5


def the_transfer_is_one_undo_step(user: driver.User) -> driver.Steps:
    with user.override():
        bpy.ops.ed.undo_push(message="Live")
    n_before = len(grooms())
    yield from user.press("bpy.ops.hairloom.update_details(")
    yield from user.wait(is_idle, WORK_SECONDS, "the update over")
    yield 0.5
    assert len(grooms()) == n_before
    yield from user.into_view()
    for _ in range(4):
        if len(grooms()) == 1:
            break
        yield from user.key("Z", ctrl=True)
    assert len(grooms()) == 1, "undo does not take the result away"


def a_detail_is_saved_by_its_button(user: driver.User) -> driver.Steps:
    bpy.context.view_layer.objects.active = bpy.context.scene.objects[grooms()[0]]
    state().new_name = "Of a test"
    yield from user.press("bpy.ops.hairloom.save_detail(")
    library = scenes.module("detail_library")
    yield from user.wait(
        lambda: "Of a test" in [d.name for d in library.saved_details()], WORK_SECONDS, "the detail saved"
    )
    yield from user.wait(is_idle, 30, "the job over")
    state().saved_detail = "Of a test"
    yield from user.picture("details_of_ones_own")


def test(user: driver.User) -> driver.Steps:
    yield from stage.set_the_scene(user)
    # finer strands take drawing by software tens of seconds a frame
    bpy.context.scene.hairloom.details.settings.max_subdivision = 1
    for part in (
        a_saved_detail_is_applied_by_its_button, live_follows_a_setting, the_transfer_is_one_undo_step,
        a_detail_is_saved_by_its_button,
    ):  # fmt: skip
        yield from part(user)
        print(f"passed: {part.__name__.replace('_', ' ')}", flush=True)


bpy.context.preferences.view.show_splash = False
driver.run(test, LIMIT_SECONDS)
