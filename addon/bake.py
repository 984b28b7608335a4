"""Baking as operators and panels see it: why it cannot be done, and what its operators share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy

from . import playback, scene

SPACES = (
    ("WORLD", "World", "With the motion of the groom's object: for other programs"),
    ("OBJECT", "Object", "As it moves on its object: for an object that has the same motion"),
)


def why_no_bake(context: bpy.types.Context) -> str:
    """Why the active groom's simulation cannot be baked; '' when it can."""
    missing = scene.why_busy(context) or scene.why_no_object_mode(context) or scene.why_no_groom(context)
    if missing:
        return missing
    state, message = playback.status(scene.active_groom(context))
    if state == playback.NONE:
        return "The groom has no simulation yet: press Simulate first"
    return message if state in (playback.BROKEN, playback.EDITED) else ""


def why_no_export(context: bpy.types.Context) -> str:
    """Why no groom can be exported to Unreal; '' when one can."""
    return scene.why_busy(context) or scene.why_no_object_mode(context) or scene.why_no_groom(context)


@contextmanager
def progress_shown(context: bpy.types.Context) -> Iterator[Callable[[float], None]]:
    """Blender's progress cursor while the block runs; call what is yielded with the finished fraction."""
    context.window_manager.progress_begin(0.0, 1.0)
    try:
        yield context.window_manager.progress_update
    finally:
        context.window_manager.progress_end()


def default_path(context: bpy.types.Context, suffix: str) -> str:
    """Beside the .blend file, named after the groom."""
    groom = scene.active_groom(context)
    name = bpy.path.clean_name(groom.name if groom is not None else "hair") + suffix
    return str(Path(bpy.data.filepath).parent / name) if bpy.data.filepath else name
