"""Give the active groom a saved detail."""

from __future__ import annotations

import bpy

from .. import detail_library, details, scene
from .transfer_details import TransferJob


class HAIRLOOM_OT_apply_detail(TransferJob, bpy.types.Operator):
    """Make a new groom with the shape of the active groom and the curls and wisps of a saved detail"""

    bl_idname = "hairloom.apply_detail"
    bl_label = "Apply Detail"
    bl_options = {"UNDO"}

    detail: bpy.props.StringProperty(
        name="Detail", description="Name of the saved detail; the one chosen in the panel when empty"
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_busy(context) or details.why_no_base(context))

    def sources(self, context: bpy.types.Context) -> dict[str, bpy.types.Object]:
        self._name = detail_library.find_detail(self.detail or details.chosen_detail(context)).name
        return details.base_and_head(context)

    def saved_detail(self, sources: dict[str, bpy.types.Object]) -> str:
        return self._name


CLASSES = (HAIRLOOM_OT_apply_detail,)
