"""Make the active groom's details again."""

from __future__ import annotations

import bpy

from .. import details, lazy, scene
from ..jobs import Values
from .transfer_details import TransferJob


class HAIRLOOM_OT_update_details(TransferJob, bpy.types.Operator):
    """Make the details of the active groom, which came from a transfer, again: with the settings of now, and with what
    its two grooms have become"""

    bl_idname = "hairloom.update_details"
    bl_label = "Update Details"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(
            cls, scene.why_busy(context) or details.why_no_update(context, scene.active_groom(context))
        )

    def sources(self, context: bpy.types.Context) -> dict[str, bpy.types.Object]:
        result = scene.active_groom(context)
        self._saved = result.hairloom_transfer.saved_detail
        return {"result": result, **details.remembered(result)}

    def saved_detail(self, sources: dict[str, bpy.types.Object]) -> str:
        return self._saved

    def write(
        self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values
    ) -> bpy.types.Object:
        result = sources["result"]
        lazy.bridge("transferred").update_result(result, sources["base"], sources["base_head"], outputs)
        return result


CLASSES = (HAIRLOOM_OT_update_details,)
