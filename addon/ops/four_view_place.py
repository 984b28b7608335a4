"""Lay the photos over the head: find their cameras, and take landmarks of the face for that."""

from __future__ import annotations

import bpy

from .. import fourview, fourview_overlay, lazy, scene
from ..jobs import JobOperator, Values, reports_errors


class HAIRLOOM_OT_four_view_place(JobOperator, bpy.types.Operator):
    """Lay all photos over the head by their masks and, for the front, by the landmarks of the face that were clicked"""

    bl_idname = "hairloom.four_view_place"
    bl_label = "Place Cameras"
    bl_options = {"UNDO"}
    job = "four_view_place"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, fourview.why_no_cameras(context))

    def sources(self, context: bpy.types.Context) -> dict[str, bpy.types.Object]:
        planes = {name: photo.plane for name, photo in fourview.named_photos(context).items()}
        return {**planes, "head": fourview.head_of(context)}

    def read(self, sources: dict[str, bpy.types.Object]) -> Values:
        return lazy.bridge("fourview").place_inputs(bpy.context)

    def watched(self, sources: dict[str, bpy.types.Object], inputs: Values | None = None) -> Values:
        return fourview.inputs_of(bpy.context, "shape")

    def apply(self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values) -> str:
        return lazy.bridge("fourview").apply_cameras(context, outputs)


class HAIRLOOM_OT_four_view_landmarks(bpy.types.Operator):
    """Click the asked places of the face in the active photo, one after another"""

    bl_idname = "hairloom.four_view_landmarks"
    bl_label = "Click Landmarks"
    bl_options = {"REGISTER", "UNDO"}

    landmarks: bpy.props.StringProperty(
        name="Landmarks", description="The places as JSON: pixels by name", options={"HIDDEN", "SKIP_SAVE"}
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_no_object_mode(context) or fourview.why_no_image(context))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.landmarks or context.region_data is None:
            return self.execute(context)
        self._clicks = fourview.LandmarkClicks(tuple(fourview.active_photo(context).image.size))
        self._ask(context)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def _ask(self, context: bpy.types.Context) -> None:
        asked = self._clicks.asked
        context.workspace.status_text_set(
            f"Click {asked}   |   Space: not seen   |   Backspace: back   |   Esc: cancel"
        )

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        region = fourview.window_region(context, event)
        if event.value != "PRESS" or event.type.startswith("TIMER"):
            return {"PASS_THROUGH"}
        if event.type in {"ESC", "RIGHTMOUSE"}:
            return self._leave(context, {"CANCELLED"})
        if event.type == "LEFTMOUSE" and region is not None:
            place = (event.mouse_x - region.x, event.mouse_y - region.y)
            photo = fourview.active_photo(context)
            self._clicks.click(lazy.bridge("camera").pixel_under_mouse(photo, region, region.data, place))
        elif event.type in {"SPACE", "RET"}:
            self._clicks.skip()
        elif event.type == "BACK_SPACE":
            self._clicks.back()
        else:
            return {"PASS_THROUGH"}
        if self._clicks.is_done:
            self.landmarks = self._clicks.text()
            return self._leave(context, self.execute(context))
        self._ask(context)
        return {"RUNNING_MODAL"}

    def _leave(self, context: bpy.types.Context, result: set[str]) -> set[str]:
        context.workspace.status_text_set(None)
        fourview_overlay.redraw()
        return result

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        fourview.active_photo(context).landmarks = self.landmarks
        return {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender itself ends it: another file is opened, or the window closes."""
        if context.workspace is not None:
            context.workspace.status_text_set(None)


CLASSES = (HAIRLOOM_OT_four_view_place, HAIRLOOM_OT_four_view_landmarks)
