"""Draw strokes along the hair that tell which way it grows."""

from __future__ import annotations

import json

import bpy

from .. import fourview, fourview_strokes, lazy, scene
from ..backend.errors import require
from ..jobs import reports_errors
from .four_view_scribble import MouseStroke

_COLOR = (1.0, 0.35, 0.9, 1.0)
_SHORTEST_PX = 8.0


class HAIRLOOM_OT_four_view_stroke(MouseStroke, bpy.types.Operator):
    """Drag along the hair from root to tip, from any side, to say which way it grows there"""

    bl_idname = "hairloom.four_view_stroke"
    bl_label = "Growth Stroke"
    bl_options = {"REGISTER", "UNDO"}

    points: bpy.props.StringProperty(
        name="Points", description="The stroke as JSON, pairs of pixels", options={"HIDDEN", "SKIP_SAVE"}
    )
    camera: bpy.props.StringProperty(
        name="Camera", description="Whose pixels they are, as JSON; the active photo's when empty",
        options={"HIDDEN", "SKIP_SAVE"},
    )  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, fourview.why_no_strokes(context))

    def pixel(self, context: bpy.types.Context, event: bpy.types.Event) -> tuple[float, float] | None:
        if not self.camera:
            self.camera = lazy.bridge("fourview").stroke_camera(context)
        place = (event.mouse_region_x, event.mouse_region_y)
        return lazy.bridge("fourview").stroke_pixel(context, json.loads(self.camera), place)

    def in_world(self, context: bpy.types.Context, points: list[tuple[float, float]]) -> object:
        return lazy.bridge("fourview").stroke_in_world(context, {**json.loads(self.camera), "points": points})

    def color(self) -> tuple[float, float, float, float]:
        return _COLOR

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        require(self.points, "No stroke is given; drag along the hair with the Hairloom Growth Stroke tool")
        draft = fourview_strokes.Draft()
        for x, y in json.loads(self.points):
            draft.move(float(x), float(y))
        if draft.length < _SHORTEST_PX:
            self.report({"INFO"}, "The stroke is too short to tell a direction")
            return {"CANCELLED"}
        camera = json.loads(self.camera) if self.camera else {"view": fourview.active_name(context)}
        share = lazy.bridge("fourview").share_on_hair(context, {**camera, "points": draft.points})
        require(share > 0, "The stroke does not touch the hair: draw it over the shape")
        found = fourview.project(context)
        found.strokes = fourview_strokes.add_stroke(found.strokes, camera, draft.points)
        return {"FINISHED"}


class HAIRLOOM_OT_four_view_remove_strokes(bpy.types.Operator):
    """Remove the last stroke along the hair, or all of them"""

    bl_idname = "hairloom.four_view_remove_strokes"
    bl_label = "Remove Strokes"
    bl_options = {"REGISTER", "UNDO"}

    every: bpy.props.BoolProperty(name="All", description="All strokes, not the last alone")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, "" if fourview.project(context).strokes else "There is no stroke")

    def execute(self, context: bpy.types.Context) -> set[str]:
        found = fourview.project(context)
        found.strokes = "" if self.every else fourview_strokes.without_last(found.strokes)
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_four_view_stroke, HAIRLOOM_OT_four_view_remove_strokes)
