"""Simulation in a window: guides, helices, a cancelled run that goes on, playback, scrubbing, undo, saving."""

from __future__ import annotations

import math
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "blender")]

import bpy  # noqa: E402
import combing  # noqa: E402
import driver  # noqa: E402
import numpy as np  # noqa: E402
import scenes  # noqa: E402
import stage  # noqa: E402
from mathutils import Euler  # noqa: E402

LIMIT_SECONDS = 1500
WORK_SECONDS = 600  # compiling in the worker included
FRAMES = 120
SUBSTEPS = 20  # so that there is time to look and to cancel
MAX_DRAWN_SECONDS = 60


def hair() -> bpy.types.Object:
    return next(obj for obj in bpy.data.objects if obj.type == "CURVES" and not obj.name.endswith("Helices"))


def settings() -> bpy.types.PropertyGroup:
    return bpy.context.scene.hairloom.simulation


def playback():
    return scenes.module("playback")


def job() -> bpy.types.PropertyGroup:
    return bpy.context.window_manager.hairloom_job


def is_idle() -> bool:
    return not job().is_running


def only_our_panels_open() -> None:
    """The tab with nothing but the simulation, opened: finding a button takes seconds then, not minutes."""
    ui = scenes.module("ui")
    ours = (scenes.module("ui.simulation_panel"), scenes.module("ui.physics_presets"), scenes.module("ui.presets"))
    for part in reversed([part for part in ui._PARTS if part not in ours and hasattr(part, "unregister")]):
        part.unregister()
    panels = ours[0]
    panels.unregister()
    panels.HAIRLOOM_PT_simulation.bl_options = set()
    panels.HAIRLOOM_PT_collisions.bl_options = panels.HAIRLOOM_PT_physics.bl_options = {"DEFAULT_CLOSED"}
    panels.register()


def look_at_the_hair(user: driver.User) -> None:
    points = scenes.module("bridge.curves").read_strands(hair()).points
    view = user.area().spaces.active.region_3d
    view.view_rotation = Euler((math.radians(80.0), 0.0, math.radians(30.0))).to_quaternion()
    view.view_location = points.mean(axis=0)
    view.view_distance = 2.5 * float(np.ptp(points, axis=0).max())


def shake_the_head() -> None:
    head = hair().data.surface
    for frame in range(1, FRAMES + 1):
        head.rotation_euler.z = math.radians(20.0) * math.sin(2 * math.pi * 2.0 * (frame - 1) / 24.0)
        head.keyframe_insert("rotation_euler", frame=frame)
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, FRAMES
    bpy.context.scene.frame_set(1)
    settings().guides.n_guides = 100
    settings().simulation.substeps = SUBSTEPS


def guides_are_made_by_their_button(user: driver.User) -> driver.Steps:
    yield from user.press("bpy.ops.hairloom.make_guides(")
    yield from user.wait(lambda: "hairloom_guide" in hair().data.attributes, WORK_SECONDS, "guides")
    yield from user.wait(is_idle, 30, "the job over")
    assert hair().hairloom_simulation.n_guides == 100
    yield from user.press("bpy.ops.hairloom.fit_helices(")
    yield from user.wait(lambda: "Helices" in " ".join(bpy.data.objects.keys()), WORK_SECONDS, "helices")
    yield from user.wait(is_idle, 30, "the job over")
    hair().hide_set(True)
    yield 40.0  # shaders are compiled before anything is drawn
    yield from user.picture("simulation_helices")
    hair().hide_set(False)
    bpy.context.view_layer.objects.active = hair()
    with user.override():
        bpy.ops.hairloom.show_helices("EXEC_DEFAULT", True, show=False)
    user.area().spaces.active.shading.type = "SOLID"
    yield 1.0


def a_cancelled_simulation_changes_nothing_and_keeps_its_frames(user: driver.User) -> driver.Steps:
    before = scenes.positions(hair()).tobytes()
    yield from user.press("bpy.ops.hairloom.simulate(")
    yield from user.wait(lambda: job().message.startswith("Frame ") and job().fraction > 0.22, WORK_SECONDS, "frames")
    yield from user.picture("simulation_running")
    if job().is_running:
        yield from user.into_view()
        yield from user.key("ESC")
    yield from user.wait(is_idle, 30, "the job cancelled")
    assert playback().folder(hair()) is None, "it was done before it could be cancelled: use more frames"
    assert scenes.positions(hair()).tobytes() == before
    kept = scenes.module("simulation").unfinished(hair())
    print(f"cancelled after {kept.n_frames} of {kept.n_planned} frames", flush=True)
    yield from user.picture("simulation_cancelled")


def resuming_finishes_it(user: driver.User) -> driver.Steps:
    with user.override():
        bpy.ops.ed.undo_push(message="Before Resume")
    yield from user.press("bpy.ops.hairloom.resume_simulation(")
    yield from user.wait(lambda: playback().folder(hair()) is not None, WORK_SECONDS, "the simulation")
    yield from user.wait(is_idle, 30, "the job over")
    print(f"report: {hair().hairloom_simulation.report!r}", flush=True)
    assert playback().status(hair()) == ("PLAYING", f"Plays frames 1 to {FRAMES}")
    yield from user.picture("simulation_done")


def undo_and_redo(user: driver.User) -> driver.Steps:
    bpy.context.scene.frame_set(20)
    yield 0.5
    yield from user.into_view()
    for _ in range(3):
        if playback().folder(hair()) is None:
            break
        yield from user.key("Z", ctrl=True)
    assert playback().folder(hair()) is None, "undo does not take the simulation away"
    for _ in range(3):
        if playback().folder(hair()) is not None:
            break
        yield from user.key("Z", ctrl=True, shift=True)
    assert playback().status(hair())[0] == "PLAYING"


def scrubbing_shows_the_cache_s_frames(user: driver.User) -> driver.Steps:
    reader = scenes.module("backend.io.sim_cache").CacheReader(playback().folder(hair()))
    for frame in (30, 5, 48, 17, 1):
        bpy.context.scene.frame_current = frame
        yield 0.3
        assert np.array_equal(scenes.positions(hair()), reader.frame(frame)), frame
        if frame == 17:
            yield from user.picture("simulation_scrubbed")
    reader.close()


def it_plays_at_speed(user: driver.User) -> driver.Steps:
    """The window draws by software; what counts is what the add-on adds to each frame."""
    spent: list[float] = []
    players, original = playback().players, playback().players.play_scene

    def timed(scene: bpy.types.Scene) -> None:
        start = time.perf_counter()
        original(scene)
        spent.append(time.perf_counter() - start)

    players.play_scene = timed
    start, shown = time.monotonic(), []
    try:
        with user.override():
            bpy.ops.screen.animation_play()
        while len(spent) < 24 and time.monotonic() - start < MAX_DRAWN_SECONDS:
            yield 0.2
            shown.append(bpy.context.scene.frame_current)
        with user.override():
            bpy.ops.screen.animation_cancel(restore_frame=False)
    finally:
        players.play_scene = original
    seconds = time.monotonic() - start
    without = f"{1000 * float(np.median(spent)):.2f} ms a frame without, {len(hair().data.points):,} points"
    print(f"playback: {len(spent)} frames in {seconds:.1f} s with drawing; {without}", flush=True)
    assert len(set(shown)) > 3, "the animation does not play"
    assert np.median(spent) < 1 / 24


def saved_and_opened_again_it_plays(user: driver.User) -> driver.Steps:
    bpy.context.scene.frame_set(17)
    expected = scenes.positions(hair()).tobytes()
    bpy.context.scene.frame_set(3)
    with user.override():
        bpy.ops.wm.save_mainfile()
        bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    yield 2.0
    bpy.context.scene.frame_set(17)
    yield 0.5
    assert scenes.positions(hair()).tobytes() == expected
    assert playback().status(hair())[0] == "PLAYING"
    yield from user.picture("simulation_reopened")


def roots_stay_on_the_head() -> None:
    starts = combing.offsets()[:-1]
    data = hair().data
    reader = scenes.module("backend.io.sim_cache").CacheReader(playback().folder(hair()))
    rest = playback().rest_positions(hair())
    worst = max(np.abs(reader.frame(f)[starts] - rest[starts]).max() for f in range(1, FRAMES + 1))
    farthest = max(np.linalg.norm(reader.frame(f) - rest, axis=1).max() for f in range(1, FRAMES + 1))
    first = np.abs(reader.frame(1) - rest).max()
    print(f"{data.name}: roots off {worst:.1e}, hair swings by up to {100 * farthest:.1f} cm, starts {first:.1e} off")
    assert worst < 1e-4
    assert farthest > 0.005
    assert first == 0.0


def test(user: driver.User) -> driver.Steps:
    folder = tempfile.mkdtemp(prefix="hairloom-session-")
    # before the tab is shown for the first time: which panels are open is kept with it
    only_our_panels_open()
    yield from stage.set_the_scene(user)
    look_at_the_hair(user)
    shake_the_head()
    bpy.ops.wm.save_as_mainfile(filepath=str(Path(folder, "shake.blend")))
    with user.override():
        bpy.ops.ed.undo_push(message="Set the scene")
    yield 2.0
    for part in (
        guides_are_made_by_their_button, a_cancelled_simulation_changes_nothing_and_keeps_its_frames,
        resuming_finishes_it, undo_and_redo, scrubbing_shows_the_cache_s_frames, it_plays_at_speed,
        saved_and_opened_again_it_plays,
    ):  # fmt: skip
        yield from part(user)
        print(f"passed: {part.__name__.replace('_', ' ')}", flush=True)
    roots_stay_on_the_head()


bpy.context.preferences.view.show_splash = False
driver.run(test, LIMIT_SECONDS)
