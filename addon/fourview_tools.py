"""The wizard's two brushes in the toolbar: scribbles on photos, and strokes along the hair."""

from __future__ import annotations

import bpy

from . import fourview
from .fourview_strokes import BACKGROUND, ERASE, HAIR

SCRIBBLE_TOOL = "hairloom.four_view_scribble_tool"
STROKE_TOOL = "hairloom.four_view_stroke_tool"


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
    bpy.utils.register_tool(HAIRLOOM_WT_four_view_stroke, after={SCRIBBLE_TOOL})


def unregister() -> None:
    bpy.utils.unregister_tool(HAIRLOOM_WT_four_view_stroke)
    bpy.utils.unregister_tool(HAIRLOOM_WT_four_view_scribble)
