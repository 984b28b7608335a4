"""Drag the border of the active photo's mask with the mouse."""

from __future__ import annotations

import json

import bpy

from .. import fourview, lazy, scene
from ..backend.errors import HairloomError, require
from ..jobs import reports_errors
from .four_view_scribble import PhotoStroke

_COLOR = (0.2, 1.0, 1.0, 1.0)


class BorderDrag(PhotoStroke):
    """Mixin: the mouse grabs the border where it is pressed, and the border is shown where it would go."""

    def why_not(self, context: bpy.types.Context, event: bpy.types.Event) -> str:
        image, place = lazy.bridge("image"), self.pixel(context, event)
        if place is None:
            return "The photo is seen edge on: look through its camera"
        self._border = image.read_border(fourview.active_photo(context))
        try:
            image.moved_border(self._border, place, place, _radius(context))
        except HairloomError as error:
            return str(error)  # no border is near
        return ""

    def lines(self, context: bpy.types.Context, points: list[tuple[float, float]]) -> list[object]:
        moved = lazy.bridge("image").moved_border(self._border, points[0], points[-1], _radius(context))
        return [[*line, line[0]] for line, before in zip(moved, self._border) if line is not before]

    def color(self) -> tuple[float, float, float, float]:
        return _COLOR


def _radius(context: bpy.types.Context) -> float:
    return 0.5 * fourview.project(context).border_size


class HAIRLOOM_OT_four_view_border(BorderDrag, bpy.types.Operator):
    """Press near the mask's border and drag: the border follows the mouse, as far around as the circle reaches"""

    bl_idname = "hairloom.four_view_border"
    bl_label = "Drag Mask's Border"
    bl_options = {"REGISTER", "UNDO"}

    points: bpy.props.StringProperty(
        name="Points", description="Where the drag begins and where it ends as JSON, pairs of pixels of the photo",
        options={"HIDDEN", "SKIP_SAVE"},
    )  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, fourview.why_no_border(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        require(self.points, "No drag is given; drag the mask's border with the Hairloom Mask Border tool")
        points = [(float(x), float(y)) for x, y in json.loads(self.points)]
        photo, name = fourview.active_photo(context), fourview.active_name(context)
        if not lazy.bridge("image").drag_border(photo, name, points[0], points[-1], _radius(context)):
            self.report({"INFO"}, "The border was not moved")
            return {"CANCELLED"}
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_four_view_border,)
