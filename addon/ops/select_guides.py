"""Select the guides of the active groom."""

from __future__ import annotations

import bpy

from .. import lazy, scene, simulation
from ..jobs import reports_errors


class HAIRLOOM_OT_select_guides(bpy.types.Operator):
    """Select the guides of the active groom and nothing else, to see them in Sculpt or Edit Mode or to comb them"""

    bl_idname = "hairloom.select_guides"
    bl_label = "Select Guides"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, simulation.why_no_guides(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        count = lazy.bridge("guides").select_guides(scene.active_groom(context))
        self.report({"INFO"}, f"{count:,} guides selected")
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_select_guides,)
