"""The wizard's brushes in the toolbar: scribbles on photos, the border of a mask, and strokes along the hair."""

from __future__ import annotations

import bpy

from . import fourview
from .fourview_strokes import BACKGROUND, ERASE, HAIR

SCRIBBLE_TOOL = "hairloom.four_view_scribble_tool"
BORDER_TOOL = "hairloom.four_view_border_tool"
STROKE_TOOL = "hairloom.four_view_stroke_tool"
_GREEN, _CYAN = (0.2, 0.9, 0.35, 0.9), (0.2, 1.0, 1.0, 0.9)


def _press(operator: str, properties: list[tuple[str, object]], **modifiers: bool) -> tuple[str, dict, dict]:
    return operator, {"type": "LEFTMOUSE", "value": "PRESS", **modifiers}, {"properties": properties}


def _draw_scribble(context: bpy.types.Context, layout: bpy.types.UILayout, tool: bpy.types.WorkSpaceTool) -> None:
    found = fourview.project(context)
    if fourview.active_photo(context) is None:
        layout.label(text=fourview.why_no_photo(context), icon="INFO")
        return
    layout.prop(found, "brush_paints", text="")
    layout.prop(found, "brush_size")
    layout.label(text="Drag: hair   Ctrl: not hair   Shift: erase")


def _draw_border(context: bpy.types.Context, layout: bpy.types.UILayout, tool: bpy.types.WorkSpaceTool) -> None:
    missing = fourview.why_no_border(context)
    if missing:
        layout.label(text=missing, icon="INFO")
        return
    layout.prop(fourview.project(context), "border_size")
    layout.label(text="Press near the mask's border and drag it")


def _draw_circle(context: bpy.types.Context, xy: tuple[float, float], size: float, color: tuple[float, ...]) -> None:
    """A circle around the mouse; `size` is its width in pixels of the photo."""
    # in the background there is no gpu, so it is imported only when something is drawn
    from gpu_extras.presets import draw_circle_2d

    draw_circle_2d(xy, color, max(0.5 * size * fourview.pixels_per_photo_pixel(context), 2.0), segments=48)


def _draw_brush(context: bpy.types.Context, tool: bpy.types.WorkSpaceTool, xy: tuple[float, float]) -> None:
    _draw_circle(context, xy, fourview.project(context).brush_size, _GREEN)


def _draw_reach(context: bpy.types.Context, tool: bpy.types.WorkSpaceTool, xy: tuple[float, float]) -> None:
    _draw_circle(context, xy, fourview.project(context).border_size, _CYAN)


def _draw_stroke(context: bpy.types.Context, layout: bpy.types.UILayout, tool: bpy.types.WorkSpaceTool) -> None:
    layout.label(text=fourview.why_no_strokes(context) or "Drag along the hair from root to tip", icon="INFO")


class HAIRLOOM_WT_four_view_scribble(bpy.types.WorkSpaceTool):
    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = SCRIBBLE_TOOL
    bl_label = "Hairloom Scribble"
    bl_description = "Mark hair on the active photo; with Ctrl what is no hair, with Shift erase marks"
    bl_icon = "ops.gpencil.draw"
    bl_widget = None
    bl_keymap = (
        _press("hairloom.four_view_scribble", [("kind", HAIR)]),
        _press("hairloom.four_view_scribble", [("kind", BACKGROUND)], ctrl=True),
        _press("hairloom.four_view_scribble", [("kind", ERASE)], shift=True),
    )
    draw_settings = staticmethod(_draw_scribble)
    draw_cursor = staticmethod(_draw_brush)


class HAIRLOOM_WT_four_view_border(bpy.types.WorkSpaceTool):
    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = BORDER_TOOL
    bl_label = "Hairloom Mask Border"
    bl_description = "Drag the border of the active photo's mask to where the hair ends"
    bl_icon = "ops.transform.push_pull"
    bl_widget = None
    bl_keymap = (_press("hairloom.four_view_border", []),)
    draw_settings = staticmethod(_draw_border)
    draw_cursor = staticmethod(_draw_reach)


class HAIRLOOM_WT_four_view_stroke(bpy.types.WorkSpaceTool):
    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = STROKE_TOOL
    bl_label = "Hairloom Growth Stroke"
    bl_description = "Draw along the hair from root to tip to say which way it grows"
    bl_icon = "ops.curve.draw"
    bl_widget = None
    bl_keymap = (_press("hairloom.four_view_stroke", []),)
    draw_settings = staticmethod(_draw_stroke)


def register() -> None:
    bpy.utils.register_tool(HAIRLOOM_WT_four_view_scribble, separator=True)
    bpy.utils.register_tool(HAIRLOOM_WT_four_view_border, after={SCRIBBLE_TOOL})
    bpy.utils.register_tool(HAIRLOOM_WT_four_view_stroke, after={BORDER_TOOL})


def unregister() -> None:
    bpy.utils.unregister_tool(HAIRLOOM_WT_four_view_stroke)
    bpy.utils.unregister_tool(HAIRLOOM_WT_four_view_border)
    bpy.utils.unregister_tool(HAIRLOOM_WT_four_view_scribble)
