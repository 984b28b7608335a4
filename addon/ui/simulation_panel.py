"""The panels of the simulation, in the order of the work: guides, physics, collisions, air, and the run itself."""

from __future__ import annotations

import bpy

from .. import air, jobs, playback, scene, simulation
from ..ops.fit_helices import HAIRLOOM_OT_fit_helices
from ..ops.make_guides import HAIRLOOM_OT_make_guides
from ..ops.resume_simulation import HAIRLOOM_OT_resume_simulation
from ..ops.simulate import HAIRLOOM_OT_simulate
from .layout import HairloomPanel, draw_settings, hint, job_button, settings_column
from .physics_presets import HAIRLOOM_PT_physics_presets

_PARENT = "HAIRLOOM_PT_simulation"
_FIRST_OF_CONTACT = ("radius", "self_contact")


class HAIRLOOM_PT_simulation(HairloomPanel, bpy.types.Panel):
    bl_label = "Simulation"
    bl_order = 7
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        missing = scene.why_no_object_mode(context) or scene.why_no_groom(context)
        if missing:
            hint(self.layout, missing)
        elif scene.head_for(context, scene.active_groom(context)) is None:
            hint(self.layout, "No head is known: the roots move with the hair object, and nothing keeps hair out")


class HAIRLOOM_PT_guides(HairloomPanel, bpy.types.Panel):
    bl_label = "Guides"
    bl_parent_id = _PARENT

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, scene.settings(context).simulation
        column = settings_column(layout)
        column.prop(settings, "guides_from_wisps")
        if not settings.guides_from_wisps:
            draw_settings(column, settings.guides, ("n_guides",))
        job_button(layout, context, "STRANDS", HAIRLOOM_OT_make_guides)
        if simulation.why_no_guides(context):
            hint(layout, simulation.why_no_guides(context))
            return
        groom = scene.active_groom(context)
        box = layout.box()
        box.label(text=f"{groom.hairloom_simulation.n_guides:,} guides", icon="CURVES_DATA")
        row = box.row(align=True)
        row.operator("hairloom.select_guides", text="Select")
        row.operator("hairloom.extract_guides", text="Extract")
        row = layout.row(align=True)
        job_button(row, context, "FORCE_CURVE", HAIRLOOM_OT_fit_helices)
        helices = simulation.helices_of(groom)
        if helices is not None:
            icon = "HIDE_ON" if helices.hide_viewport else "HIDE_OFF"
            row.operator("hairloom.show_helices", text="", icon=icon).show = helices.hide_viewport
            hint(layout, groom.hairloom_simulation.fit_report)


class HAIRLOOM_PT_guides_more(HairloomPanel, bpy.types.Panel):
    bl_label = "More"
    bl_parent_id = "HAIRLOOM_PT_guides"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        settings = scene.settings(context).simulation
        column = settings_column(self.layout)
        draw_settings(column, settings.guides, (n for n in settings.guides.setting_names() if n != "n_guides"))
        column.separator()
        draw_settings(column, settings.fit, settings.fit.setting_names())
        column.separator()
        draw_settings(column, settings.followers, settings.followers.setting_names())


class HAIRLOOM_PT_physics(HairloomPanel, bpy.types.Panel):
    bl_label = "Physics"
    bl_parent_id = _PARENT

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        HAIRLOOM_PT_physics_presets.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        material = scene.settings(context).simulation.material
        column = settings_column(self.layout)
        draw_settings(column, material, material.setting_names())


class HAIRLOOM_PT_collisions(HairloomPanel, bpy.types.Panel):
    bl_label = "Collisions"
    bl_parent_id = _PARENT

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, scene.settings(context).simulation
        column = settings_column(layout)
        draw_settings(column, settings, ("collide_head", "colliders", "collider_friction"))
        if settings.colliders is not None and not simulation.colliders(context):
            hint(layout, f"No mesh of '{settings.colliders.name}' is in the scene: nothing of it keeps hair out")
        draw_settings(column, settings.simulation.contact, _FIRST_OF_CONTACT)


class HAIRLOOM_PT_collisions_more(HairloomPanel, bpy.types.Panel):
    bl_label = "More"
    bl_parent_id = "HAIRLOOM_PT_collisions"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        contact = scene.settings(context).simulation.simulation.contact
        names = (name for name in contact.setting_names() if name not in _FIRST_OF_CONTACT)
        draw_settings(settings_column(self.layout), contact, names)


class HAIRLOOM_PT_air(HairloomPanel, bpy.types.Panel):
    bl_label = "Wind & Gravity"
    bl_parent_id = _PARENT

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        column = settings_column(layout)
        column.prop(context.scene, "use_gravity", text="Gravity")
        row = column.row()
        row.active = context.scene.use_gravity
        row.prop(context.scene, "gravity", text="")
        column.prop(scene.settings(context).simulation, "air_speed")
        fields = air.fields(context)
        if not fields:
            hint(layout, "No force field is in the scene: the air is still. Add > Force Field > Wind makes some")
            return
        box = layout.box().column(align=True)
        for field in fields:
            box.label(text=f"{field.name}: {field.kind or 'does not act'}", icon="FORCE_WIND" if field.kind else "X")
        for field in fields:
            if field.remark:
                hint(layout, field.remark)


class HAIRLOOM_PT_simulate(HairloomPanel, bpy.types.Panel):
    bl_label = "Simulate"
    bl_parent_id = _PARENT

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, scene.settings(context).simulation
        column = settings_column(layout)
        row = column.row(align=True)
        row.prop(context.scene, "frame_start", text="Frames")
        row.prop(context.scene, "frame_end", text="")
        draw_settings(column, settings.simulation, ("substeps", "start_in_equilibrium"))
        column.prop(settings, "cache_folder")
        button = layout.column()
        button.scale_y = 1.5
        job_button(button, context, "PLAY", HAIRLOOM_OT_simulate, HAIRLOOM_OT_resume_simulation)
        missing = simulation.why_no_simulation(context)
        if jobs.status(context).is_running:
            return
        if missing:
            hint(layout, missing)
            return
        groom = scene.active_groom(context)
        kept = simulation.unfinished(groom)
        if kept is not None:
            hint(layout, f"{kept.n_frames} of {kept.n_planned} frames are simulated")
            layout.operator("hairloom.resume_simulation", icon="FRAME_NEXT")
        state, text = simulation.playback_state(context, groom)
        if state in {playback.STALE, playback.BROKEN}:
            hint(layout, text)
        _draw_report(layout, groom)


def _draw_report(layout: bpy.types.UILayout, groom: bpy.types.Object) -> None:
    for line in groom.hairloom_simulation.report.splitlines():
        hint(layout, line)


class HAIRLOOM_PT_simulate_more(HairloomPanel, bpy.types.Panel):
    bl_label = "More"
    bl_parent_id = "HAIRLOOM_PT_simulate"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        equilibrium = scene.settings(context).simulation.simulation.equilibrium
        draw_settings(settings_column(self.layout), equilibrium, equilibrium.setting_names())


register, unregister = bpy.utils.register_classes_factory(
    [
        HAIRLOOM_PT_simulation, HAIRLOOM_PT_guides, HAIRLOOM_PT_guides_more, HAIRLOOM_PT_physics,
        HAIRLOOM_PT_collisions, HAIRLOOM_PT_collisions_more, HAIRLOOM_PT_air, HAIRLOOM_PT_simulate,
        HAIRLOOM_PT_simulate_more,
    ]
)  # fmt: skip
