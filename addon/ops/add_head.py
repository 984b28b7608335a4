"""Add Hairloom's plain head."""

from __future__ import annotations

import bpy

from .. import lazy, scene
from ..jobs import reports_errors


class HAIRLOOM_OT_add_head(bpy.types.Operator):
    """Add a plain head with a scalp region and a UV map, and choose it as the head"""

    bl_idname = "hairloom.add_head"
    bl_label = "Add Head"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_no_object_mode(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        head = lazy.backend("geometry.head").default_head()
        obj = lazy.bridge("mesh").new_head_object("Head", head, context.collection)
        settings = scene.settings(context)
        settings.head, settings.scalp_group = obj, lazy.bridge("mesh").SCALP_GROUP
        scene.select_only(context, obj)
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_add_head,)
