"""The flow's panel: extract it, apply it, or let the hair follow it live."""

from __future__ import annotations

import bpy

from .. import flow_link, live_flow, scene
from .layout import HairloomPanel, hint, settings_column


class HAIRLOOM_PT_flow(HairloomPanel, bpy.types.Panel):
    bl_label = "Flow"
    # as the wisps' panel, and registered after it
    bl_order = 2

    def draw(self, context: bpy.types.Context) -> None:
        layout, active = self.layout, scene.active_groom(context)
        grooms = flow_link.grooms_to_move(context)
        if not flow_link.is_flow(active) or flow_link.is_bound(active):
            layout.operator("hairloom.extract_flow", icon="CURVES_DATA")
            missing = flow_link.why_no_extract(context)
            if missing:
                hint(layout, missing)
        elif not grooms:
            hint(layout, flow_link.why_no_apply(context))
        for groom in grooms:
            self._draw_link(groom, active)
        if grooms:
            layout.operator("hairloom.apply_flow", icon="FILE_REFRESH")
            if flow_link.is_flow(active):
                hint(layout, "Edit these strands with any tool, in Sculpt or Edit Mode or with modifiers")

    def _draw_link(self, groom: bpy.types.Object, active: bpy.types.Object) -> None:
        link, column = groom.hairloom_flow, settings_column(self.layout)
        if groom != active:
            column.label(text=groom.name, icon="OUTLINER_OB_CURVES")
        column.prop(link, "source")
        if flow_link.flow_of(groom) is None:
            hint(self.layout, "The groom's flow is gone; choose another, or run Extract Flow again")
            return
        column.prop(link, "is_live")
        column.prop(link, "follow_length")
        problem = live_flow.live.problems.get(groom.session_uid)
        if problem:
            hint(self.layout, problem)


register, unregister = bpy.utils.register_classes_factory([HAIRLOOM_PT_flow])
