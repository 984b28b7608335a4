"""Cancel the running job."""

from __future__ import annotations

import bpy

from .. import scene
from ..jobs import status


class HAIRLOOM_OT_cancel_job(bpy.types.Operator):
    """Cancel the running job; nothing is changed"""

    bl_idname = "hairloom.cancel_job"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, "" if status(context).is_running else "No job is running")

    def execute(self, context: bpy.types.Context) -> set[str]:
        # the job's own operator sees this at its next tick
        status(context).wants_cancel = True
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_cancel_job,)
