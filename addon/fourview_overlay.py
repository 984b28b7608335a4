"""What is drawn over the 3D view: scribbles, landmarks, the border of the mask and of what was made, strokes.

Nothing is computed while the view is drawn that takes long: the border of what was made is found by a timer, and the
view is drawn again then.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import bpy

from . import fourview, fourview_strokes, lazy
from .backend.errors import HairloomError

_HAIR, _BACKGROUND, _MASK = (0.2, 0.9, 0.35, 0.6), (1.0, 0.25, 0.2, 0.6), (1.0, 0.85, 0.1, 1.0)
_SILHOUETTE, _STROKE, _MARK = (0.1, 0.8, 1.0, 1.0), (1.0, 0.35, 0.9, 1.0), (1.0, 0.5, 0.0, 1.0)
_COLORS = {fourview_strokes.HAIR: _HAIR, fourview_strokes.BACKGROUND: _BACKGROUND}

# lines in world space by what they were made from; and the draft of the stroke that the mouse draws now
_lines: dict[str, tuple[str, Any]] = {}
_waiting: set[str] = set()
_handles: list[Any] = []
draft: list[tuple[tuple[float, float, float, float], Any]] = []


def redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in (area for area in window.screen.areas if area.type == "VIEW_3D"):
            area.tag_redraw()


def _kept(name: str, key: str, make: Callable[[], Any]) -> Any:
    """The lines of that name, made anew where the key is another; None where they cannot be made."""
    if name not in _lines or _lines[name][0] != key:
        _lines[name] = (key, None)  # it is tried once
        # a plane that is flat, an image that is gone: the steps' buttons say so
        with contextlib.suppress(HairloomError):
            _lines[name] = (key, make())
    return _lines[name][1]


def _draw() -> None:
    context = bpy.context
    space = context.space_data
    if context.scene is None or not space.overlay.show_overlays:
        return
    found, photo = fourview.project(context), fourview.active_photo(context)
    if photo is None or photo.plane is None or photo.image is None:
        return
    if found.shown != "NONE":
        _draw_photo(context, photo)
    if found.step == "DIRECTIONS" and found.strokes:
        key = f"{found.shape.key} {found.strokes}"
        for line in _kept("strokes", key, lambda: lazy.bridge("fourview").strokes_in_world(context)) or ():
            _draw_strip(line, _STROKE, 3.0)
            _draw_points(line[-1:], _STROKE, 8.0)
    for color, line in draft:
        _draw_strip(line, color, 3.0)


def _draw_photo(context: bpy.types.Context, photo: Any) -> None:
    found, name = fourview.project(context), fourview.active_name(context)
    place = f"{name} {fourview.camera_text(photo)} {photo.image_stamp}"
    bridge = lazy.bridge("fourview")
    if found.show_mask and photo.mask is not None:
        lines = _kept("mask", f"{place} {photo.mask_stamp}", lambda: bridge.mask_outline(photo))
        _draw_lines(lines, _MASK, 2.0)
    if found.show_silhouette and fourview.step_number(found.step) > 2:
        key = f"{place} {found.shape.key} {found.strands.key}"
        if _lines.get("silhouette", ("",))[0] == key:
            _draw_lines(_lines["silhouette"][1], _SILHOUETTE, 2.0)
        elif key not in _waiting:
            _waiting.add(key)
            bpy.app.timers.register(lambda: _find_silhouette(key), first_interval=0.05)
    if found.step == "SEGMENT" and photo.scribbles:
        scale = fourview.pixels_per_photo_pixel(context)
        for color, width, line in (
            _kept("scribbles", f"{place} {photo.scribbles}", lambda: bridge.scribbles_in_world(photo)) or ()
        ):
            _draw_strip(line, _COLORS[color], max(width * scale, 2.0))
    if found.step == "CAMERAS" and photo.landmarks:
        marks = _kept("marks", f"{place} {photo.landmarks}", lambda: bridge.landmarks_in_world(photo))
        _draw_points(marks, _MARK, 9.0)


def _find_silhouette(key: str) -> None:
    """Called by Blender's timer, once."""
    _waiting.discard(key)
    context = bpy.context
    photo = fourview.active_photo(context)
    if photo is None or photo.plane is None or photo.image is None:
        return
    _kept("silhouette", key, lambda: lazy.bridge("fourview").silhouette(context, photo))
    redraw()


# --- drawing -----------------------------------------------------------------------------------------------------


def _shader(name: str, color: tuple[float, float, float, float], width: float) -> Any:
    import gpu

    shader = gpu.shader.from_builtin(name)
    shader.bind()
    shader.uniform_float("color", color)
    if name.startswith("POLYLINE"):
        shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
        shader.uniform_float("lineWidth", width)
    else:
        gpu.state.point_size_set(width)
    return shader


def _draw_batch(kind: str, points: Any, shader_name: str, color: tuple[float, ...], width: float) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("NONE")
    shader = _shader(shader_name, color, width)
    batch_for_shader(shader, kind, {"pos": points}).draw(shader)
    gpu.state.blend_set("NONE")


def _draw_lines(lines: Any, color: tuple[float, ...], width: float) -> None:
    if lines is not None and len(lines):
        _draw_batch("LINES", lines, "POLYLINE_UNIFORM_COLOR", color, width)


def _draw_strip(points: Any, color: tuple[float, ...], width: float) -> None:
    if len(points) > 1:
        _draw_batch("LINE_STRIP", points, "POLYLINE_UNIFORM_COLOR", color, width)
    else:
        _draw_points(points, color, width + 2.0)


def _draw_points(points: Any, color: tuple[float, ...], width: float) -> None:
    if points is not None and len(points):
        _draw_batch("POINTS", points, "UNIFORM_COLOR", color, width)


@bpy.app.handlers.persistent
def _forget(*_: object) -> None:
    _lines.clear()
    draft.clear()


def register() -> None:
    if not bpy.app.background:
        _handles.append(bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW"))
    bpy.app.handlers.load_pre.append(_forget)


def unregister() -> None:
    bpy.app.handlers.load_pre.remove(_forget)
    while _handles:
        bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
    _forget()
