"""Compiling the kernels in the background after the add-on is first enabled in a window."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

import bpy

from . import jobs, lazy

if TYPE_CHECKING:
    from .workers import WorkerJob

_FIRST_TICK_SECONDS = 3.0  # let Blender finish starting
_TICK_SECONDS = 0.5
# the worker that compiles; a list, so that register and unregister need no `global`
_running: list[WorkerJob] = []


def _version() -> str:
    manifest = os.path.join(os.path.dirname(__file__), "blender_manifest.toml")
    with open(manifest, encoding="utf-8") as file:
        return next(line.split('"')[1] for line in file if line.startswith("version"))


def _marker() -> str:
    """The file that says that this version's kernels are compiled for this Python; '' without a cache folder."""
    folder = lazy.kernel_cache_folder()
    return os.path.join(folder, f"compiled-{_version()}-{sys.implementation.cache_tag}") if folder else ""


def is_warm() -> bool:
    """Are the kernels compiled already? False as well where nothing can be cached."""
    marker = _marker()
    return bool(marker) and os.path.exists(marker)


def mark_warm() -> None:
    marker = _marker()
    if marker:
        os.makedirs(os.path.dirname(marker), exist_ok=True)
        with open(marker, "w", encoding="utf-8"):
            pass


def is_running() -> bool:
    return bool(_running)


def progress() -> tuple[float, str]:
    """Fraction and message of the worker that compiles."""
    return (_running[0].run.fraction, _running[0].run.message) if _running else (0.0, "")


def _tick() -> float | None:
    if not _running:
        if jobs.status(bpy.context).is_running:
            # the job compiles what it needs itself; two processes would only get in each other's way
            return _FIRST_TICK_SECONDS
        _running.append(lazy.workers().WorkerJob("Compile Kernels", "warm_up", {}, {}, is_patient=True))
        return _TICK_SECONDS
    before = progress()
    run = _running[0].step()
    if progress() != before:
        jobs.redraw(bpy.context, "PREFERENCES")
    if run.state == "RUNNING":
        return _TICK_SECONDS
    if run.state == "DONE":
        mark_warm()
    else:
        # no job fails for want of this; the first one compiles for itself and reports its own errors
        sys.stderr.write(f"Hairloom: compiling in the background ended early: {run.error}\n{run.traceback}\n")
    _running.pop().close()
    return None


def register() -> None:
    # without a cache the compiled code would be thrown away with the worker
    if not bpy.app.background and lazy.kernel_cache_folder() and not is_warm():
        bpy.app.timers.register(_tick, first_interval=_FIRST_TICK_SECONDS, persistent=True)


def unregister() -> None:
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    while _running:
        _running.pop().close()
