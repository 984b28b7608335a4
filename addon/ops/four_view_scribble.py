"""Draw on the active photo with the mouse: a scribble, or a stroke of the brush on its mask."""

from __future__ import annotations

import json

import bpy

from .. import fourview, fourview_overlay, fourview_strokes, lazy, scene
from ..backend.errors import require
from ..fourview_strokes import BACKGROUND, ERASE, HAIR
from ..jobs import reports_errors

_STATUS = "Draw on the photo   |   Esc or right mouse: leave it as it was"
_COLORS = {HAIR: (0.2, 0.9, 0.35, 0.9), BACKGROUND: (1.0, 0.25, 0.2, 0.9), ERASE: (0.9, 0.9, 0.9, 0.7)}


class MouseStroke:
    """Mixin: an operator that collects a stroke of the mouse as pixels and then runs `execute` with it."""

    def pixel(self, context: bpy.types.Context, event: bpy.types.Event) -> tuple[float, float] | None:
        raise NotImplementedError

    def in_world(self, context: bpy.types.Context, points: list[tuple[float, float]]) -> object:
        raise NotImplementedError

    def color(self) -> tuple[float, float, float, float]:
        raise NotImplementedError

    def lines(self, context: bpy.types.Context, points: list[tuple[float, float]]) -> list[object]:
        """What is drawn while the mouse moves, in the pixels of the stroke's points: the stroke itself."""
        return [points]

    def why_not(self, context: bpy.types.Context, event: bpy.types.Event) -> str:
        """Why no stroke can begin here."""
        return ""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.points or context.region_data is None:
            return self.execute(context)
        missing = self.why_not(context, event)
        if missing:
            self.report({"WARNING"}, missing)
            return {"CANCELLED"}
        self._draft = fourview_strokes.Draft()
        self._take(context, event)
        context.workspace.status_text_set(_STATUS)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type in {"MOUSEMOVE", "INBETWEEN_MOUSEMOVE"}:
            self._take(context, event)
            return {"RUNNING_MODAL"}
        if event.type == "LEFTMOUSE" and event.value == "RELEASE":
            self._leave(context)
            if not self._draft.points:
                return {"CANCELLED"}
            self.points = json.dumps(self._draft.points)
            return self.execute(context)
        if event.type in {"ESC", "RIGHTMOUSE"} and event.value == "PRESS":
            self._leave(context)
            return {"CANCELLED"}
        return {"PASS_THROUGH"} if event.type.startswith("TIMER") else {"RUNNING_MODAL"}

    def _take(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        place = self.pixel(context, event)
        if place is not None and self._draft.move(*place):
            lines = self.lines(context, self._draft.points)
            fourview_overlay.draft[:] = [(self.color(), self.in_world(context, line)) for line in lines]
            context.area.tag_redraw()

    def _leave(self, context: bpy.types.Context) -> None:
        fourview_overlay.draft.clear()
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        fourview_overlay.redraw()

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender itself ends the stroke: another file is opened, or the window closes."""
        self._leave(context)


class PhotoStroke(MouseStroke):
    """Mixin: a stroke of the mouse over the active photo, in its pixels."""

    def pixel(self, context: bpy.types.Context, event: bpy.types.Event) -> tuple[float, float] | None:
        place = (event.mouse_region_x, event.mouse_region_y)
        photo = fourview.active_photo(context)
        return lazy.bridge("camera").pixel_under_mouse(photo, context.region, context.region_data, place)

    def in_world(self, context: bpy.types.Context, points: list[tuple[float, float]]) -> object:
        return lazy.bridge("camera").pixels_in_world(fourview.active_photo(context), points)


class HAIRLOOM_OT_four_view_scribble(PhotoStroke, bpy.types.Operator):
    """Drag over the active photo to mark hair, what is no hair, or to erase marks"""

    bl_idname = "hairloom.four_view_scribble"
    bl_label = "Scribble"
    bl_options = {"REGISTER", "UNDO"}

    kind: bpy.props.EnumProperty(
        name="Kind", description="What the stroke marks", default=HAIR,
        items=((HAIR, "Hair", "Here is hair"), (BACKGROUND, "No Hair", "Here is none"), (ERASE, "Erase", "Take away")),
        options={"SKIP_SAVE"},
    )  # fmt: skip
    points: bpy.props.StringProperty(
        name="Points", description="The stroke as JSON, pairs of pixels of the photo", options={"HIDDEN", "SKIP_SAVE"}
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_no_object_mode(context) or fourview.why_no_image(context))

    def color(self) -> tuple[float, float, float, float]:
        return _COLORS[self.kind]

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        require(self.points, "No stroke is given; drag over the photo with the Hairloom Scribble tool")
        found, photo = fourview.project(context), fourview.active_photo(context)
        width, height = photo.image.size
        points = [(float(x), float(y)) for x, y in json.loads(self.points)]
        if not any(0 <= x < width and 0 <= y < height for x, y in points):
            self.report({"INFO"}, "The stroke does not touch the photo")
            return {"CANCELLED"}
        if found.brush_paints == "MASK":
            lazy.bridge("image").paint_mask(photo, fourview.active_name(context), self.kind, found.brush_size, points)
        else:
            photo.scribbles = fourview_strokes.add_scribble(photo.scribbles, self.kind, found.brush_size, points)
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_four_view_scribble,)
