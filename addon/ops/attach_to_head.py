"""Attach the active groom to the head."""

from __future__ import annotations

import bpy

from .. import lazy, scene
from ..jobs import reports_errors


class HAIRLOOM_OT_attach_to_head(bpy.types.Operator):
    """Attach the active groom to the head, so that it follows the head and Blender's hair brushes and nodes work"""

    bl_idname = "hairloom.attach_to_head"
    bl_label = "Attach to Head"
    bl_options = {"REGISTER", "UNDO"}

    snap: bpy.props.BoolProperty(
        name="Move Roots onto the Surface",
        description="Move each strand as a whole until its root lies on the head's surface",
        default=False,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_no_object_mode(context) or scene.why_no_head(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        groom = scene.active_groom(context)
        head = scene.head_for(context, groom)
        distance = lazy.bridge("attachment").attach_to_head(groom, head, snap=self.snap)
        self.report(
            {"INFO"}, f"Attached to '{head.name}'; the farthest root lay {1000 * distance:.1f} mm off the surface"
        )
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_attach_to_head,)
