"""The comb in the toolbar of Object Mode and of the Curves' Sculpt Mode: its keys, its settings, its brush circle."""

from __future__ import annotations

import bpy

from .. import scene

TOOL = "hairloom.comb_tool"
_SETTINGS = "scene.hairloom.comb"
_COLOR = (1.0, 0.65, 0.2, 0.9)
_INNER_COLOR = (1.0, 0.65, 0.2, 0.4)


def is_active(context: bpy.types.Context) -> bool:
    """Is the comb the tool of the current mode?"""
    tool = context.workspace.tools.from_space_view3d_mode(context.mode) if context.workspace else None
    return tool is not None and tool.idname == TOOL


def has_wisps(groom: bpy.types.Object | None) -> bool:
    return groom is not None and "hairloom_wisp" in groom.data.attributes


def draw_brush(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    """Radius and strength, each with the button that hands it to the pen's pressure."""
    for name, pressure in (("radius", "pressure_radius"), ("strength", "pressure_strength")):
        row = layout.row(align=True)
        row.prop(settings, name, slider=True)
        row.prop(settings, pressure, text="", icon="STYLUS_PRESSURE")


def _draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, tool: bpy.types.WorkSpaceTool) -> None:
    settings, groom = scene.settings(context).comb, scene.active_groom(context)
    if groom is None:
        layout.label(text="Select a groom to comb", icon="INFO")
        return
    layout.prop(settings, "mode", text="")
    draw_brush(layout, settings)
    layout.popover("HAIRLOOM_PT_comb_brush", text="Brush")
    row = layout.row(align=True)
    for axis in "xyz":
        row.prop(groom.data, f"use_mirror_{axis}", text=axis.upper(), toggle=True)
    if not has_wisps(groom):
        layout.label(text="No wisps: combs single strands", icon="INFO")
        layout.operator("hairloom.cluster_wisps")


def _draw_cursor(context: bpy.types.Context, tool: bpy.types.WorkSpaceTool, xy: tuple[float, float]) -> None:
    # in the background there is no gpu, so it is imported only when something is drawn
    from gpu_extras.presets import draw_circle_2d

    settings = scene.settings(context).comb
    draw_circle_2d(xy, _COLOR, settings.radius, segments=64)
    if 0.0 < settings.hardness < 1.0:
        draw_circle_2d(xy, _INNER_COLOR, settings.radius * settings.hardness, segments=64)


def _scale_radius(key: str, factor: float) -> tuple[str, dict[str, object], dict[str, object]]:
    properties = [("data_path", f"{_SETTINGS}.radius"), ("value", factor)]
    return "wm.context_scale_float", {"type": key, "value": "PRESS", "repeat": True}, {"properties": properties}


def _radial(name: str, **modifiers: bool) -> tuple[str, dict[str, object], dict[str, object]]:
    properties = [("data_path_primary", f"{_SETTINGS}.{name}")]
    return "wm.radial_control", {"type": "F", "value": "PRESS", **modifiers}, {"properties": properties}


def _stroke(action: str, **modifiers: bool) -> tuple[str, dict[str, object], dict[str, object]]:
    return (
        "hairloom.comb",
        {"type": "LEFTMOUSE", "value": "PRESS", **modifiers},
        {"properties": [("action", action)]},
    )


class _CombTool:
    """What the tools of the two modes share."""

    bl_space_type = "VIEW_3D"
    bl_idname = TOOL
    bl_label = "Hairloom Comb"
    bl_description = "Comb a finished groom; curls and wisps keep their shape"
    bl_icon = "brush.particle.comb"
    bl_widget = None
    bl_keymap = (
        _stroke("NORMAL"),
        _stroke("INVERT", ctrl=True),
        _stroke("SMOOTH", shift=True),
        _radial("radius"),
        _radial("strength", shift=True),
        _scale_radius("LEFT_BRACKET", 0.9),
        _scale_radius("RIGHT_BRACKET", 1.0 / 0.9),
    )
    draw_settings = staticmethod(_draw_settings)
    draw_cursor = staticmethod(_draw_cursor)


class HAIRLOOM_WT_comb(_CombTool, bpy.types.WorkSpaceTool):
    bl_context_mode = "OBJECT"


class HAIRLOOM_WT_comb_sculpt(_CombTool, bpy.types.WorkSpaceTool):
    bl_context_mode = "SCULPT_CURVES"


_TOOLS = (HAIRLOOM_WT_comb, HAIRLOOM_WT_comb_sculpt)


def register() -> None:
    for tool in _TOOLS:
        bpy.utils.register_tool(tool, separator=True)


def unregister() -> None:
    for tool in reversed(_TOOLS):
        bpy.utils.unregister_tool(tool)
