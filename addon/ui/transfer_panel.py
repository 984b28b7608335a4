"""The panels of the detail transfer: details of another groom, or saved ones, for the active groom."""

from __future__ import annotations

import bpy

from .. import details, jobs, scene
from ..ops.apply_detail import HAIRLOOM_OT_apply_detail
from ..ops.save_detail import HAIRLOOM_OT_save_detail
from ..ops.transfer_details import HAIRLOOM_OT_transfer_details
from ..ops.update_details import HAIRLOOM_OT_update_details
from .layout import HairloomPanel, draw_settings, hint, job_button, settings_column


class HAIRLOOM_PT_transfer(HairloomPanel, bpy.types.Panel):
    bl_label = "Detail Transfer"
    bl_order = 6

    def draw(self, context: bpy.types.Context) -> None:
        layout, chosen = self.layout, scene.settings(context).details
        column = settings_column(layout)
        column.prop(chosen, "source")
        column.prop(chosen, "source_head")
        column.separator()
        draw_settings(column, chosen.settings, ("strength", "smoothing", "length_mode"))
        button = layout.column()
        button.scale_y = 1.5
        job_button(button, context, "STRANDS", HAIRLOOM_OT_transfer_details)
        missing = details.why_no_transfer(context)
        if missing and not jobs.status(context).is_running:
            hint(layout, missing)
        _draw_result(layout, context)


def _draw_result(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Where a groom that was made by a transfer comes from, and how it follows."""
    result, state = scene.active_groom(context), context.window_manager.hairloom_details
    if result is not None and result.hairloom_transfer.is_set:
        memory = result.hairloom_transfer
        box = layout.box()
        column = box.column(align=True)
        column.label(text=f"Shape of {memory.base_name}", icon="OUTLINER_OB_CURVES")
        column.label(text=f"Details of {memory.saved_detail or memory.source_name}", icon="STRANDS")
        missing = details.why_no_update(context, result)
        if missing:
            hint(box, missing)
            return
        row = box.split(factor=0.7, align=True)
        job_button(row, context, "FILE_REFRESH", HAIRLOOM_OT_update_details)
        row.prop(state, "is_live", toggle=True, icon="PLAY")
    elif state.is_live:
        layout.prop(state, "is_live", toggle=True, icon="PLAY")
    if state.message:
        hint(layout, state.message)


class HAIRLOOM_PT_transfer_more(HairloomPanel, bpy.types.Panel):
    bl_label = "More"
    bl_parent_id = "HAIRLOOM_PT_transfer"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        settings = scene.settings(context).details.settings
        column = settings_column(self.layout)
        row = column.row(align=True, heading="Levels")
        finest_first = ("Hair", "Wisps", "Coarser Wisps")
        for level in range(scene.settings(context).synthesis.hierarchy.n_levels - 1):
            row.prop(settings, "levels", index=level, text=finest_first[level], toggle=True)
        draw_settings(column, settings, ("matching", "max_subdivision", "seed"))
        draw_settings(column, settings.transfer, settings.transfer.setting_names())


class HAIRLOOM_PT_saved_details(HairloomPanel, bpy.types.Panel):
    bl_label = "Saved Details"
    bl_parent_id = "HAIRLOOM_PT_transfer"

    def draw(self, context: bpy.types.Context) -> None:
        layout, state = self.layout, context.window_manager.hairloom_details
        if details.chosen_detail(context):
            layout.template_icon_view(state, "saved_detail", show_labels=True, scale=5.0)
            layout.label(text=details.chosen_detail(context))
            job_button(layout, context, "CHECKMARK", HAIRLOOM_OT_apply_detail)
        else:
            hint(layout, "No detail is saved yet")
        row = layout.row(align=True)
        row.prop(state, "new_name", text="", placeholder="Name")
        job_button(row, context, "FILE_TICK", HAIRLOOM_OT_save_detail)


register, unregister = bpy.utils.register_classes_factory(
    [HAIRLOOM_PT_transfer, HAIRLOOM_PT_transfer_more, HAIRLOOM_PT_saved_details]
)
