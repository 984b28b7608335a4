"""Comb the active groom: a stroke of the brush in a 3D view, or one that was recorded."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from .. import lazy, recording, scene
from ..jobs import reports_errors

if TYPE_CHECKING:
    from ..bridge.comb import LiveStroke

_MODES = ("OBJECT", "SCULPT_CURVES")
_STATUS = "Comb: drag   |   Esc or right mouse: put the hair back"


def why_no_comb(context: bpy.types.Context) -> str:
    """Why the active groom cannot be combed; '' when it can."""
    missing = scene.why_no_groom(context)
    if missing:
        return missing
    groom = scene.active_groom(context)
    if context.mode not in _MODES:
        return "Switch to Object Mode or Sculpt Mode first"
    if not groom.data.is_editable:
        return f"'{groom.name}' is linked from another file; make it local first"
    if not groom.visible_get():
        return f"'{groom.name}' is hidden; show it first"
    return ""


def obstacles(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The meshes that the hair is kept out of: the head first, then those of the colliders' collection."""
    settings = scene.settings(context).comb
    if not settings.collide:
        return []
    head = scene.head_for(context, scene.active_groom(context))
    others = settings.colliders.all_objects if settings.colliders is not None else []
    meshes = [obj for obj in others if obj.type == "MESH" and len(obj.data.polygons) and obj != head]
    return meshes if head is None else [head, *meshes]


class HAIRLOOM_OT_comb(bpy.types.Operator):
    """Drag in the view to comb the active groom; its curls and wisps keep their shape"""

    bl_idname = "hairloom.comb"
    bl_label = "Comb"
    bl_options = {"REGISTER", "UNDO"}

    stroke: bpy.props.StringProperty(
        name="Stroke",
        description="A recorded stroke (JSON), which is made again on the active groom",
        options={"HIDDEN", "SKIP_SAVE"},
    )
    action: bpy.props.EnumProperty(
        name="Action",
        description="How this stroke differs from the settings of the brush",
        items=(
            ("NORMAL", "Normal", "As the settings say"),
            ("INVERT", "Invert", "The other way round"),
            ("SMOOTH", "Smooth", "Smooth the flow, whatever the mode is"),
        ),
        options={"HIDDEN", "SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, why_no_comb(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        if not self.stroke:
            self.report({"ERROR"}, "No stroke is given; drag in the view with the Hairloom Comb tool")
            return {"CANCELLED"}
        groom = scene.active_groom(context)
        return self._conclude(context, lazy.bridge("comb").play_stroke(groom, self.stroke, obstacles(context)))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.stroke or context.region_data is None:
            return self.execute(context)
        self._event = event
        return self._start(context)

    @reports_errors
    def _start(self, context: bpy.types.Context) -> set[str]:
        settings = scene.settings(context).comb
        changes: dict[str, object] = {}
        if self.action == "INVERT":
            changes["invert"] = not settings.invert
        elif self.action == "SMOOTH":
            changes["mode"] = "smooth"
        view = (context.region, context.region_data)
        self._live = lazy.bridge("comb").start_stroke(
            scene.active_groom(context), settings, changes, view, obstacles(context)
        )
        if self._live.warning:
            self.report({"WARNING"}, self._live.warning)
        self._radius = settings.radius
        self._take(context, self._event)
        context.workspace.status_text_set(_STATUS)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type.startswith("TIMER"):
            return {"PASS_THROUGH"}
        self._event = event
        result = self._step(context)
        if result != {"RUNNING_MODAL"}:
            context.workspace.status_text_set(None)
        return result

    @reports_errors
    def _step(self, context: bpy.types.Context) -> set[str]:
        event = self._event
        if event.type == "MOUSEMOVE" or (event.type == "INBETWEEN_MOUSEMOVE" and self._is_far(event)):
            self._take(context, event)
        elif event.type == "LEFTMOUSE" and event.value == "RELEASE":
            self.stroke = self._live.end()
            return self._conclude(context, self._live)
        elif event.type in {"ESC", "RIGHTMOUSE"} and event.value == "PRESS":
            self._live.cancel()
            context.area.tag_redraw()
            return {"CANCELLED"}
        return {"RUNNING_MODAL"}

    def _is_far(self, event: bpy.types.Event) -> bool:
        """Moves that came while the last one was worked on are left out unless they would cut a corner."""
        x, y = self._place
        return max(abs(event.mouse_region_x - x), abs(event.mouse_region_y - y)) > 0.5 * self._radius

    def _take(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        self._place = (event.mouse_region_x, event.mouse_region_y)
        self._live.move(*map(float, self._place), min(max(event.pressure, 0.0), 1.0))
        context.area.tag_redraw()  # the brush's circle moves even where no hair does

    def _conclude(self, context: bpy.types.Context, live: LiveStroke) -> set[str]:
        if not live.has_changed:
            self.report({"INFO"}, "No hair was moved")
            return {"CANCELLED"}
        if scene.settings(context).comb.record:
            recording.add(scene.active_groom(context).data, self.stroke)
        return {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender itself ends the stroke: another file is opened, or the window closes."""
        if context.workspace is not None:
            context.workspace.status_text_set(None)


CLASSES = (HAIRLOOM_OT_comb,)
