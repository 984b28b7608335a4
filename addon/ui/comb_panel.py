"""The comb's panels: its tool, its brush, the strokes that were recorded."""

from __future__ import annotations

import bpy

from .. import recording, scene
from ..ops.comb import why_no_comb
from ..tools import comb_tool
from .layout import HairloomPanel, draw_settings, hint, settings_column


class HAIRLOOM_PT_comb(HairloomPanel, bpy.types.Panel):
    bl_label = "Comb"
    bl_order = 4

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, scene.settings(context).comb
        button = layout.row()
        button.scale_y = 1.5
        is_active = comb_tool.is_active(context)
        tool = button.operator("wm.tool_set_by_id", text="Comb", icon="BRUSH_DATA", depress=is_active)
        tool.name = comb_tool.TOOL
        column = settings_column(layout)
        column.prop(settings, "mode")
        comb_tool.draw_brush(column, settings)
        missing, groom = why_no_comb(context), scene.active_groom(context)
        if missing:
            hint(layout, missing)
            return
        if not comb_tool.has_wisps(groom):
            hint(layout, "The groom has no wisps: the comb moves single strands. Cluster Wisps keeps wisps together")
            layout.operator("hairloom.cluster_wisps")
        if ".selection" in groom.data.attributes:
            hint(layout, "The groom has a selection: only selected strands are combed")
        if settings.collide and scene.head_for(context, groom) is None:
            hint(layout, "No head is known: the hair is not kept out of it")
        if is_active:
            hint(layout, "Ctrl inverts, Shift smooths, F sets the radius, Shift F the strength")


class HAIRLOOM_PT_comb_brush(HairloomPanel, bpy.types.Panel):
    bl_label = "Brush"
    bl_parent_id = "HAIRLOOM_PT_comb"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        settings, groom = scene.settings(context).comb, scene.active_groom(context)
        column = settings_column(self.layout)
        draw_settings(column, settings, ("hardness", "level", "drag", "slip"))
        profile = column.column(align=True)
        for i, name in enumerate(("Root", "Middle", "Tip")):
            profile.prop(settings, "profile", index=i, text=name, slider=True)
        draw_settings(column, settings, ("through", "only_first", "invert"))
        if groom is not None:
            row = column.row(align=True, heading="Mirror")
            for axis in "xyz":
                row.prop(groom.data, f"use_mirror_{axis}", text=axis.upper(), toggle=True)
        column.prop(settings, "collide")
        colliders = column.column()
        colliders.active = settings.collide
        colliders.prop(settings, "colliders")


class HAIRLOOM_PT_comb_strokes(HairloomPanel, bpy.types.Panel):
    bl_label = "Strokes"
    bl_parent_id = "HAIRLOOM_PT_comb"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, groom = self.layout, scene.active_groom(context)
        settings_column(layout).prop(scene.settings(context).comb, "record")
        if groom is not None:
            count = len(recording.strokes(groom.data))
            layout.label(text=f"{count:,} strokes recorded")
        row = layout.row(align=True)
        row.operator("hairloom.save_strokes", text="Save", icon="EXPORT")
        row.operator("hairloom.play_strokes", text="Play", icon="IMPORT")
        row.operator("hairloom.clear_strokes", text="", icon="TRASH")


register, unregister = bpy.utils.register_classes_factory(
    [HAIRLOOM_PT_comb, HAIRLOOM_PT_comb_brush, HAIRLOOM_PT_comb_strokes]
)
