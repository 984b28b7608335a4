"""What a user does in Blender's window, step by step; run by run.py inside Blender."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "blender")]

import bpy  # noqa: E402
import driver  # noqa: E402
import scenes  # noqa: E402
import stage  # noqa: E402

LIMIT_SECONDS = 1500
JOB_SECONDS = 120


def is_running() -> bool:
    return bpy.context.window_manager.hairloom_job.is_running


def worker_processes() -> list[int]:
    """Ids of the worker processes that this Blender started."""
    found = []
    for folder in Path("/proc").iterdir():
        if not folder.name.isdecimal():
            continue
        try:
            command = (folder / "cmdline").read_bytes().decode(errors="replace")
            parent = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
        except OSError:
            continue  # it has ended meanwhile
        if parent == os.getpid() and "worker.py" in command:
            found.append(int(folder.name))
    return found


def pause_the_worker() -> None:
    """Stop the worker's clock, so that its job cannot end while the mouse looks for a button."""
    for process in worker_processes():
        os.kill(process, signal.SIGSTOP)
    assert is_running(), "the job was too quick to be paused"


def warms_up_in_the_background(user: driver.User) -> driver.Steps:
    """Enabled for the first time, the add-on compiles its kernels without being asked."""
    warmup = scenes.module("warmup")
    start = time.monotonic()
    yield from user.wait(lambda: worker_processes() != [], 20, "the background compiling starts")
    for process in worker_processes():
        assert os.getpriority(os.PRIO_PROCESS, process) >= 10, "it must leave the machine to the user"
        with contextlib.suppress(PermissionError):
            os.setpriority(os.PRIO_PROCESS, process, 0)  # on a busy machine it would wait for ever
    yield from user.wait(lambda: not warmup.is_running(), 900, "the background compiling ends")
    assert warmup.is_warm(), "the background compiling failed; the reason is above"
    print(f"kernels compiled in the background in {time.monotonic() - start:.0f} s", flush=True)


def synthesizes_and_undoes(user: driver.User) -> driver.Steps:
    before = scenes.scene_state()
    yield from user.press("bpy.ops.hairloom.synthesize()")
    yield from user.wait(is_running, 10, "the job starts")
    yield from user.wait(lambda: bpy.context.window_manager.hairloom_job.fraction > 0, JOB_SECONDS, "progress")
    assert scenes.scene_state() == before
    yield from user.wait(lambda: not is_running(), JOB_SECONDS, "the job ends")
    yield 0.5
    new = bpy.context.view_layer.objects.active
    assert new.name.endswith(" New"), new.name
    assert len(new.data.curves) > 100
    assert new.data.surface == bpy.context.scene.hairloom.head == new.parent
    assert "surface_uv_coordinate" in new.data.attributes
    assert new.data.materials[0] is not None
    example = next(obj for obj in bpy.data.objects if obj.type == "CURVES" and obj != new)
    example.hide_set(True)
    new.select_set(False)
    yield from user.picture("synthesized")
    example.hide_set(False)
    yield from user.into_view()
    yield from user.key("Z", ctrl=True)
    assert scenes.scene_state() == before, "one Ctrl-Z does not lead back"
    yield from user.key("Z", ctrl=True, shift=True)
    assert any(obj.name.endswith(" New") for obj in bpy.data.objects), "redo does not bring the hair back"
    yield from user.key("Z", ctrl=True)
    assert scenes.scene_state() == before


def escape_cancels(user: driver.User) -> driver.Steps:
    before = scenes.scene_state()
    bpy.context.scene.hairloom.synthesis.n_strands = 200_000
    yield from user.press("bpy.ops.hairloom.synthesize()")
    yield from user.wait(is_running, 10, "the job starts")
    yield from user.wait(lambda: bpy.context.window_manager.hairloom_job.fraction > 0, JOB_SECONDS, "progress")
    pause_the_worker()
    yield from user.picture("running")
    yield from user.into_view()
    yield from user.key("ESC")
    yield from user.wait(lambda: not is_running(), 5, "the job ends at Esc")
    assert scenes.scene_state() == before
    assert worker_processes() == []


def the_cancel_button_cancels(user: driver.User) -> driver.Steps:
    before = scenes.scene_state()
    yield from user.press("bpy.ops.hairloom.synthesize()")
    yield from user.wait(lambda: worker_processes() != [], 10, "the worker starts")
    pause_the_worker()
    yield from user.press("bpy.ops.hairloom.cancel_job()")
    yield from user.wait(lambda: not is_running(), 5, "the job ends at the button")
    assert scenes.scene_state() == before
    assert worker_processes() == []


def a_killed_worker_changes_nothing(user: driver.User) -> driver.Steps:
    before = scenes.scene_state()
    yield from user.press("bpy.ops.hairloom.synthesize()")
    yield from user.wait(lambda: worker_processes() != [], 10, "the worker starts")
    for process in worker_processes():
        os.kill(process, signal.SIGKILL)
    yield from user.wait(lambda: not is_running(), 5, "the job ends with its worker")
    assert scenes.scene_state() == before
    yield from user.picture("killed")


def test(user: driver.User) -> driver.Steps:
    yield from stage.set_the_scene(user)
    yield from user.picture("panel")
    yield from warms_up_in_the_background(user)
    yield from synthesizes_and_undoes(user)
    yield from escape_cancels(user)
    yield from the_cancel_button_cancels(user)
    yield from a_killed_worker_changes_nothing(user)


bpy.context.preferences.view.show_splash = False
driver.run(test, LIMIT_SECONDS)
