"""The four-view wizard: one panel with its seven steps, of which one is shown at a time."""

from __future__ import annotations

import bpy

from .. import fourview, fourview_tools, jobs, scene
from ..fourview_settings import STEPS
from ..ops import four_view_stages as stages
from ..ops.four_view_place import HAIRLOOM_OT_four_view_place
from ..ops.four_view_segment import HAIRLOOM_OT_four_view_segment
from .layout import HairloomPanel, draw_settings, hint, job_button, settings_column

_PARENT = "HAIRLOOM_PT_four_view"
_STATE_ICONS = {
    fourview.NONE: "RADIOBUT_OFF", fourview.DONE: "CHECKMARK", fourview.STALE: "ERROR", fourview.LOST: "ERROR"
}  # fmt: skip


def _step_icon(context: bpy.types.Context, step: str) -> str:
    """Whether a step is done, in a picture."""
    found = fourview.project(context)
    if fourview.is_stage_step(step):
        return _STATE_ICONS[fourview.state(context, step.lower()).kind]
    is_done = len(found.photos) > 0
    if step in {"SEGMENT", "CAMERAS"}:
        is_done = is_done and all(photo.mask is not None for photo in found.photos)
    return "CHECKMARK" if is_done else "RADIOBUT_OFF"


def _draw_photos(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """A row for each photo: choose it and look through it; what it still lacks."""
    found = fourview.project(context)
    column = layout.column(align=True)
    for index, (name, photo) in enumerate(fourview.named_photos(context).items()):
        row = column.row(align=True)
        chosen = index == found.active
        button = row.operator(
            "hairloom.four_view_choose", text=name.replace("_", " ").capitalize(),
            icon="RADIOBUT_ON" if chosen else "RADIOBUT_OFF", depress=chosen,
        )  # fmt: skip
        button.index = index
        row.label(text="", icon="MOD_MASK" if photo.mask is not None else "BLANK1")


class HAIRLOOM_PT_four_view(HairloomPanel, bpy.types.Panel):
    bl_label = "Four Views"
    bl_order = 9
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, found = self.layout, fourview.project(context)
        row = layout.row(align=True)
        row.prop(found, "step", expand=True, icon_only=True)
        number = fourview.step_number(found.step)
        row = layout.row(align=True)
        back = row.row(align=True)
        back.enabled = number > 0
        back.operator("hairloom.four_view_step", text="", icon="TRIA_LEFT").by = -1
        row.label(text=f"{number + 1}. {STEPS[number][1]}", icon=_step_icon(context, found.step))
        onward = row.row(align=True)
        onward.enabled = number + 1 < len(STEPS)
        onward.operator("hairloom.four_view_step", text="Next", icon="TRIA_RIGHT").by = 1
        missing = scene.why_no_object_mode(context)
        if missing:
            hint(layout, missing)


class StepPanel(HairloomPanel):
    """Mixin: the part of a step, shown in that step alone."""

    bl_parent_id = _PARENT
    bl_options = {"HIDE_HEADER"}
    step = ""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return fourview.project(context).step == cls.step


class HAIRLOOM_PT_four_view_images(StepPanel, bpy.types.Panel):
    bl_label = "Images"
    step = "IMAGES"

    def draw(self, context: bpy.types.Context) -> None:
        layout, photo = self.layout, fourview.active_photo(context)
        layout.operator("hairloom.four_view_add_images", icon="IMAGE_DATA")
        if photo is None:
            hint(layout, "Take one to eight photos of the hair, best from the front, the back, the left and the right")
            return
        _draw_photos(layout, context)
        column = settings_column(layout)
        column.prop(photo, "view")
        column.prop(photo, "image")
        row = layout.row(align=True)
        row.operator("hairloom.four_view_mirror", text="Mirror", icon="MOD_MIRROR")
        row.operator("hairloom.four_view_remove_image", text="Remove", icon="X")
        _draw_swap(layout, context)


def _draw_swap(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    found = fourview.project(context)
    if len(found.photos) < 2:
        return
    column = layout.column(align=True)
    column.label(text="Swap with")
    row = column.row(align=True)
    for index, name in enumerate(fourview.names(found)):
        if index != found.active:
            row.operator("hairloom.four_view_swap", text=name.capitalize()).index = index


class HAIRLOOM_PT_four_view_segment(StepPanel, bpy.types.Panel):
    bl_label = "Segment"
    step = "SEGMENT"

    def draw(self, context: bpy.types.Context) -> None:
        layout, found, photo = self.layout, fourview.project(context), fourview.active_photo(context)
        if photo is None:
            hint(layout, fourview.why_no_photo(context))
            return
        _draw_photos(layout, context)
        layout.operator("hairloom.four_view_guess_masks", icon="SHADERFX")
        row = layout.row(align=True)
        row.operator("wm.tool_set_by_id", text="Scribble", icon="GREASEPENCIL").name = fourview_tools.SCRIBBLE_TOOL
        row.operator("hairloom.four_view_clear_scribbles", text="", icon="TRASH")
        column = settings_column(layout)
        column.prop(found, "brush_paints")
        column.prop(found, "brush_size")
        hint(layout, "Drag over hair; with Ctrl over what is none, with Shift to erase. Then press Segment")
        if photo.mask is not None and photo.mask_by_hand:
            hint(layout, "This mask was edited by hand: Segment replaces it")
        job_button(layout, context, "MOD_MASK", HAIRLOOM_OT_four_view_segment)
        column = layout.column(align=True)
        column.enabled = photo.mask is not None
        button = column.operator("wm.tool_set_by_id", text="Drag Border", icon="MOD_SIMPLEDEFORM")
        button.name = fourview_tools.BORDER_TOOL
        settings_column(column).prop(found, "border_size")
        layout.operator("hairloom.four_view_load_mask", icon="FILE_FOLDER")
        column = settings_column(layout)
        column.prop(photo, "mask")
        column.prop(found, "show_mask")


class HAIRLOOM_PT_four_view_cameras(StepPanel, bpy.types.Panel):
    bl_label = "Cameras"
    step = "CAMERAS"

    def draw(self, context: bpy.types.Context) -> None:
        layout, found, photo = self.layout, fourview.project(context), fourview.active_photo(context)
        if photo is None:
            hint(layout, fourview.why_no_photo(context))
            return
        settings_column(layout).prop(scene.settings(context), "head")
        _draw_photos(layout, context)
        missing = fourview.why_no_cameras(context)
        if missing and not jobs.status(context).is_running:
            hint(layout, missing)
        layout.operator("hairloom.four_view_landmarks", icon="PIVOT_CURSOR")
        job_button(layout, context, "CAMERA_DATA", HAIRLOOM_OT_four_view_place)
        for line in found.remarks.splitlines():
            hint(layout, line)
        hint(layout, "Arrows move and scale the photo, the ring turns it, those at its borders tilt the view")
        row = layout.row(align=True)
        row.operator("hairloom.four_view_look", icon="VIEW_CAMERA")
        row.operator("hairloom.four_view_reset_camera", text="Reset", icon="LOOP_BACK")
        column = settings_column(layout)
        column.prop(photo, "is_perspective")
        if photo.is_perspective:
            column.prop(photo, "distance")
        _draw_swap(layout, context)


def _draw_stage(
    layout: bpy.types.UILayout, context: bpy.types.Context, stage: str, icon: str, operator: type
) -> None:  # fmt: skip
    """The button of a stage, why it cannot run, and what became of it."""
    button = layout.column()
    button.scale_y = 1.5
    job_button(button, context, icon, operator)
    if jobs.status(context).is_running:
        return
    missing = fourview.why_no_stage(context, stage)
    if missing:
        hint(layout, missing)
    state = fourview.state(context, stage)
    if state.text:
        hint(layout, state.text)
    for line in getattr(fourview.project(context), stage).report.splitlines():
        hint(layout, line)


class HAIRLOOM_PT_four_view_shape(StepPanel, bpy.types.Panel):
    bl_label = "Shape"
    step = "SHAPE"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, scene.settings(context).four_view
        column = settings_column(layout)
        draw_settings(column, settings, ("n_tried",))
        draw_settings(column, settings.shape, settings.shape.setting_names())
        column.prop(settings, "grooms_folder")
        column.prop(settings, "cache_folder")
        _draw_stage(layout, context, "shape", "MESH_ICOSPHERE", stages.HAIRLOOM_OT_four_view_shape)
        _draw_outlines(layout, context)


class HAIRLOOM_PT_four_view_texture(StepPanel, bpy.types.Panel):
    bl_label = "Texture"
    step = "TEXTURE"

    def draw(self, context: bpy.types.Context) -> None:
        settings = scene.settings(context).four_view
        column = settings_column(self.layout)
        for group in (settings.surface, settings.texture):
            draw_settings(column, group, group.setting_names())
        _draw_stage(self.layout, context, "texture", "TEXTURE", stages.HAIRLOOM_OT_four_view_texture)


class HAIRLOOM_PT_four_view_directions(StepPanel, bpy.types.Panel):
    bl_label = "Directions"
    step = "DIRECTIONS"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        row = layout.row(align=True)
        row.operator("wm.tool_set_by_id", text="Stroke", icon="GREASEPENCIL").name = fourview_tools.STROKE_TOOL
        row.operator("hairloom.four_view_remove_strokes", text="Last", icon="LOOP_BACK").every = False
        row.operator("hairloom.four_view_remove_strokes", text="", icon="TRASH").every = True
        hint(layout, "Without strokes the directions are guessed; draw some from root to tip where the guess is wrong")
        _draw_photos(layout, context)
        _draw_stage(layout, context, "directions", "CURVE_PATH", stages.HAIRLOOM_OT_four_view_directions)


class HAIRLOOM_PT_four_view_strands(StepPanel, bpy.types.Panel):
    bl_label = "Strands"
    step = "STRANDS"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, scene.settings(context).four_view
        column = settings_column(layout)
        draw_settings(column, settings.strands, settings.strands.setting_names())
        column.prop(settings, "with_detail")
        _draw_stage(layout, context, "strands", "STRANDS", stages.HAIRLOOM_OT_four_view_strands)
        _draw_photos(layout, context)
        _draw_outlines(layout, context)


def _draw_outlines(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    found = fourview.project(context)
    column = settings_column(layout)
    column.prop(found, "show_mask")
    column.prop(found, "show_silhouette")


class HAIRLOOM_PT_four_view_display(HairloomPanel, bpy.types.Panel):
    bl_label = "Photos & Project"
    bl_parent_id = _PARENT
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 20

    def draw(self, context: bpy.types.Context) -> None:
        layout, found = self.layout, fourview.project(context)
        row = layout.row(align=True)
        row.prop(found, "shown", expand=True)
        settings_column(layout).prop(found, "opacity")
        layout.operator("hairloom.four_view_write_project", icon="FILE_TEXT")


register, unregister = bpy.utils.register_classes_factory(
    [
        HAIRLOOM_PT_four_view, HAIRLOOM_PT_four_view_images, HAIRLOOM_PT_four_view_segment,
        HAIRLOOM_PT_four_view_cameras, HAIRLOOM_PT_four_view_shape, HAIRLOOM_PT_four_view_texture,
        HAIRLOOM_PT_four_view_directions, HAIRLOOM_PT_four_view_strands, HAIRLOOM_PT_four_view_display,
    ]
)  # fmt: skip
