"""A simulation cache in Blender's window: played, scrubbed, edited, undone, kept or dropped by buttons, rendered."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "blender")]

import bpy  # noqa: E402
import caches  # noqa: E402
import driver  # noqa: E402
import numpy as np  # noqa: E402
import scenes  # noqa: E402

LIMIT_SECONDS = 600


def hair() -> bpy.types.Object:
    """The groom; an undo makes every reference void, so it is looked up each time."""
    return bpy.data.objects["Hair"]


def state() -> str:
    return scenes.module("playback").status(hair())[0]


def prepare(user: driver.User, folder: Path) -> np.ndarray:
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    groom, playback = scenes.groom(scenes.wavy_strands(300)), scenes.module("playback")
    frames = caches.simulated(folder, groom, shift=0.02, fingerprint=playback.fingerprint(groom))
    playback.attach(groom, folder)
    bpy.context.scene.frame_end = len(frames)
    user.area().spaces.active.show_region_ui = True
    # to the top of the tab, where its buttons need no scrolling
    panel = scenes.module("ui.bake_panel").HAIRLOOM_PT_bake
    bpy.utils.unregister_class(panel)
    panel.bl_order = -1
    bpy.utils.register_class(panel)
    with user.override():
        bpy.ops.ed.undo_push(message="Simulation")
    return frames


def it_plays(user: driver.User, frames: np.ndarray) -> driver.Steps:
    with user.override():
        bpy.ops.screen.animation_play()
    seen = set()
    for number in range(20):
        yield 0.2 + 0.05 * (number % 5)  # at even steps a short loop may be met at the same few frames again and again
        frame = bpy.context.scene.frame_current
        seen.add(frame)
        assert np.array_equal(scenes.positions(hair()), frames[frame - 1]), f"frame {frame} shows other hair"
    with user.override():
        bpy.ops.screen.animation_cancel(restore_frame=False)
    assert len(seen) > 3, f"it stands still: {seen}"
    assert state() == "PLAYING"


def edit(user: driver.User) -> driver.Steps:
    """Move the hair at frame 3, as a brush does, and go to frame 5."""
    bpy.context.scene.frame_set(3)
    with user.override():
        bpy.ops.ed.undo_push(message="Frame 3")
    data = hair().data
    data.position_data.foreach_set("vector", (scenes.positions(hair()) + np.float32(0.1)).ravel())
    data.update_tag()
    yield 0.5
    with user.override():
        bpy.ops.ed.undo_push(message="Edit")
    edited = scenes.positions(hair())
    assert state() == "EDITED"
    bpy.context.scene.frame_set(5)
    yield 0.5
    assert np.array_equal(scenes.positions(hair()), edited), "the edit was overwritten"


def an_edit_is_kept_until_it_is_undone_or_dropped(user: driver.User, frames: np.ndarray) -> driver.Steps:
    yield edit(user)
    with user.override():
        bpy.ops.ed.undo()
    yield 0.5
    assert state() == "PLAYING"
    bpy.context.scene.frame_set(6)
    assert np.array_equal(scenes.positions(hair()), frames[5])
    yield edit(user)
    yield user.picture("playback_edited")
    yield user.press("bpy.ops.hairloom.play_again(")
    yield user.wait(lambda: state() == "PLAYING", 20, "the edit is dropped")
    assert np.array_equal(scenes.positions(hair()), frames[4])


def it_is_rendered(user: driver.User, folder: Path) -> driver.Steps:
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0.0, -1.0, 0.0), (np.pi / 2, 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.engine, scene.cycles.samples = "CYCLES", 2
    scene.render.resolution_x = scene.render.resolution_y = 48
    scene.render.use_motion_blur = scene.render.use_lock_interface = True
    scene.render.filepath = str(folder / "frame")
    bpy.context.preferences.view.render_display_type = "NONE"
    with user.override():
        bpy.ops.render.render("INVOKE_DEFAULT", animation=True)
    yield user.wait(lambda: len(list(folder.glob("frame*.png"))) == caches.N_FRAMES, 120, "the animation is rendered")
    yield user.wait(lambda: not bpy.app.is_job_running("RENDER"), 60, "the render ends")
    assert state() == "PLAYING"
    yield user.picture("playback")


def the_button_frees_the_cache(user: driver.User, frames: np.ndarray, folder: Path) -> driver.Steps:
    yield user.press("bpy.ops.hairloom.free_cache(")
    yield user.wait(lambda: state() == "NONE", 20, "the cache is freed")
    assert np.array_equal(scenes.positions(hair()), frames[0])
    assert not folder.exists()


def session(user: driver.User) -> driver.Steps:
    folder = Path(tempfile.mkdtemp())
    frames = prepare(user, folder / "cache")
    yield 1.0
    user.region("UI").active_panel_category = "Hairloom"
    yield 1.0
    yield it_plays(user, frames)
    yield an_edit_is_kept_until_it_is_undone_or_dropped(user, frames)
    yield it_is_rendered(user, folder)
    yield the_button_frees_the_cache(user, frames, folder / "cache")


bpy.context.preferences.view.show_splash = False
driver.run(session, LIMIT_SECONDS)
