"""The panels of the sidebar tab Hairloom, in the order of the work: head, groom, wisps, synthesis."""

from __future__ import annotations

import bpy

from .. import jobs, scene
from ..ops import show_wisps
from ..ops.clean_up import HAIRLOOM_OT_clean_up
from ..ops.cluster_wisps import HAIRLOOM_OT_cluster_wisps
from ..ops.extract_centers import HAIRLOOM_OT_extract_centers
from ..ops.synthesize import HAIRLOOM_OT_synthesize
from .layout import HairloomPanel, draw_settings, hint, job_button, settings_column
from .presets import HAIRLOOM_PT_synthesis_presets


class HAIRLOOM_PT_head(HairloomPanel, bpy.types.Panel):
    bl_label = "Head"
    bl_order = 0

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, scene.settings(context)
        column = settings_column(layout)
        column.prop(settings, "head")
        head = scene.head_for(context, scene.active_groom(context))
        if head is not None:
            column.prop_search(settings, "scalp_group", head, "vertex_groups", icon="GROUP_VERTEX")
        row = layout.row(align=True)
        row.operator("hairloom.add_head", icon="ADD")
        row.operator("hairloom.set_up_head", icon="MESH_MONKEY")
        if head is None:
            hint(layout, "Add a head, or select a mesh of yours and set it up")
        elif head.data.uv_layers.active is None:
            hint(layout, f"'{head.name}' has no UV map yet: select it and press Set Up Head")


class HAIRLOOM_PT_groom(HairloomPanel, bpy.types.Panel):
    bl_label = "Groom"
    bl_order = 1

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        row = layout.row(align=True)
        row.operator("hairloom.import_groom", text="Import", icon="IMPORT")
        row.operator("hairloom.export_groom", text="Export", icon="EXPORT")
        layout.operator_menu_enum("hairloom.add_starter_groom", "groom", icon="STRANDS")
        groom = scene.active_groom(context)
        if groom is None:
            hint(layout, scene.why_no_groom(context))
            return
        box = layout.box()
        column = box.column(align=True)
        column.label(text=groom.name, icon="OUTLINER_OB_CURVES")
        column.label(text=f"{len(groom.data.curves):,} strands, {len(groom.data.points):,} points", icon="BLANK1")
        surface = groom.data.surface
        column.label(text=f"Attached to {surface.name}" if surface else "Not attached to a head", icon="BLANK1")
        layout.operator("hairloom.attach_to_head", icon="SNAP_FACE")


class HAIRLOOM_PT_clean_up(HairloomPanel, bpy.types.Panel):
    bl_label = "Clean Up"
    bl_parent_id = "HAIRLOOM_PT_groom"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        column = settings_column(self.layout)
        settings = scene.settings(context).clean_up
        draw_settings(column, settings, settings.setting_names())
        job_button(self.layout, context, "BRUSH_DATA", HAIRLOOM_OT_clean_up)


class HAIRLOOM_PT_wisps(HairloomPanel, bpy.types.Panel):
    bl_label = "Wisps"
    bl_order = 2

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        hierarchy = scene.settings(context).synthesis.hierarchy
        column = settings_column(layout)
        column.prop(hierarchy, "n_levels")
        column.prop(hierarchy.wisps, "n_wisps")
        column.prop(hierarchy.wisps, "error_threshold")
        job_button(layout, context, "OUTLINER_OB_CURVES", HAIRLOOM_OT_cluster_wisps, HAIRLOOM_OT_extract_centers)
        groom = scene.active_groom(context)
        if groom is None or "hairloom_wisp" not in groom.data.attributes:
            return
        n_levels = sum(f"hairloom_wisp_{i}" in groom.data.attributes for i in (2, 3)) + 1
        is_shown = show_wisps.is_shown(groom.data)
        for text, operator in (("Show", "hairloom.show_wisps"), ("Centers", "hairloom.extract_centers")):
            split = layout.split(factor=0.3)
            split.label(text=text)
            row = split.row(align=True)
            if operator == "hairloom.show_wisps":
                hair = row.row(align=True)
                hair.enabled = is_shown
                hair.operator(operator, text="Hair").level = 0
            for level in range(1, n_levels + 1):
                row.operator(operator, text=f"{level}").level = level


class HAIRLOOM_PT_wisps_more(HairloomPanel, bpy.types.Panel):
    bl_label = "More"
    bl_parent_id = "HAIRLOOM_PT_wisps"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        hierarchy = scene.settings(context).synthesis.hierarchy
        column = settings_column(self.layout)
        column.prop(hierarchy, "ratio")
        shown = ("n_wisps", "error_threshold")
        draw_settings(column, hierarchy.wisps, (n for n in hierarchy.wisps.setting_names() if n not in shown))


class HAIRLOOM_PT_synthesis(HairloomPanel, bpy.types.Panel):
    bl_label = "Synthesis"
    bl_order = 3

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        HAIRLOOM_PT_synthesis_presets.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, scene.settings(context)
        synthesis = settings.synthesis
        column = settings_column(layout)
        column.prop(synthesis, "n_strands")
        head = scene.head_for(context, scene.active_groom(context))
        if head is not None:
            column.prop_search(settings, "region_group", head, "vertex_groups", icon="GROUP_VERTEX")
        column.prop(synthesis, "seed")
        button = layout.column()
        button.scale_y = 1.5
        job_button(button, context, "OUTLINER_DATA_CURVES", HAIRLOOM_OT_synthesize)
        missing = scene.why_no_job(context)
        if missing and not jobs.status(context).is_running:
            hint(layout, missing)


class HAIRLOOM_PT_layout(HairloomPanel, bpy.types.Panel):
    bl_label = "Layout"
    bl_parent_id = "HAIRLOOM_PT_synthesis"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        synthesis = scene.settings(context).synthesis
        column = settings_column(self.layout)
        draw_settings(column, synthesis, ("n_samples", "n_features", "map_spacing", "sharpness"))
        column.separator()
        draw_settings(column, synthesis.texture, synthesis.texture.setting_names())


class HAIRLOOM_PT_details(HairloomPanel, bpy.types.Panel):
    bl_label = "Details"
    bl_parent_id = "HAIRLOOM_PT_synthesis"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        transfer = scene.settings(context).synthesis.transfer
        column = settings_column(self.layout)
        draw_settings(column, transfer, transfer.setting_names())


class HAIRLOOM_PT_refinement(HairloomPanel, bpy.types.Panel):
    bl_label = "Refinement"
    bl_parent_id = "HAIRLOOM_PT_synthesis"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context: bpy.types.Context) -> None:
        self.layout.prop(scene.settings(context).synthesis, "use_refinement", text="")

    def draw(self, context: bpy.types.Context) -> None:
        synthesis = scene.settings(context).synthesis
        column = settings_column(self.layout)
        column.active = synthesis.use_refinement
        draw_settings(column, synthesis.refine, synthesis.refine.setting_names())


register, unregister = bpy.utils.register_classes_factory(
    [
        HAIRLOOM_PT_head, HAIRLOOM_PT_groom, HAIRLOOM_PT_clean_up, HAIRLOOM_PT_wisps,
        HAIRLOOM_PT_wisps_more, HAIRLOOM_PT_synthesis, HAIRLOOM_PT_layout, HAIRLOOM_PT_details, HAIRLOOM_PT_refinement,
    ]
)  # fmt: skip
