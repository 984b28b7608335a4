"""Compile the backend's kernels ahead of the first job."""

from __future__ import annotations

import bpy

from .. import scene, warmup
from ..jobs import JobOperator, Values


class HAIRLOOM_OT_warm_up(JobOperator, bpy.types.Operator):
    """Compile Hairloom's kernels now, so that the first job need not wait for it"""

    bl_idname = "hairloom.warm_up"
    bl_label = "Compile Kernels"
    bl_options = {"INTERNAL"}
    job = "warm_up"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        busy = "The kernels are being compiled in the background" if warmup.is_running() else ""
        return scene.allowed(cls, busy or scene.why_busy(context))

    def apply(self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values) -> str:
        warmup.mark_warm()
        return f"{outputs['report']['kernels']} kernels are compiled"


CLASSES = (HAIRLOOM_OT_warm_up,)
