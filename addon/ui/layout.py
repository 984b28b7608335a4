"""What the panels share: where they stand, and pieces that they draw alike."""

from __future__ import annotations

from collections.abc import Iterable

import bpy

from .. import jobs


class HairloomPanel:
    """Mixin: a panel of the tab."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Hairloom"


def settings_column(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    column = layout.column()
    column.use_property_split = True
    column.use_property_decorate = False
    return column


def draw_settings(column: bpy.types.UILayout, group: bpy.types.PropertyGroup, names: Iterable[str]) -> None:
    for name in names:
        column.prop(group, name)


def job_button(layout: bpy.types.UILayout, context: bpy.types.Context, icon: str, *operators: type) -> None:
    """The button of the first operator; while a job of any of them runs, its progress in the same place."""
    job = jobs.status(context)
    if job.is_running and job.label in {operator.bl_label for operator in operators}:
        jobs.draw_progress(layout, job)
    else:
        layout.operator(operators[0].bl_idname, icon=icon)


def hint(layout: bpy.types.UILayout, text: str) -> None:
    """A sentence that may be longer than the panel is wide, in lines of about its width."""
    box = layout.column(align=True)
    box.scale_y = 0.8
    words, line, icon = text.split(), "", "INFO"
    for word in [*words, ""]:
        if line and (not word or len(line) + len(word) > 34):
            box.label(text=line, icon=icon)
            line, icon = "", "BLANK1"
        line = f"{line} {word}".strip()
