"""The guides of the active groom as a groom of their own."""

from __future__ import annotations

import bpy

from .. import lazy, material, scene, simulation
from ..jobs import reports_errors


class HAIRLOOM_OT_extract_guides(bpy.types.Operator):
    """Make a new groom of the guides of the active one, to look at them or to simulate them alone"""

    bl_idname = "hairloom.extract_guides"
    bl_label = "Extract Guides"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, simulation.why_no_guides(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        groom, curves = scene.active_groom(context), lazy.bridge("curves")
        strands = lazy.bridge("guides").guide_strands(groom, lazy.bridge("simulation").rest_strands(groom))
        obj = curves.new_sibling(f"{groom.name} Guides", strands, groom, context.collection)
        obj.data.materials.append(material.material_of(groom))
        scene.select_only(context, obj)
        self.report({"INFO"}, f"{obj.name}: {strands.n_strands:,} strands")
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_extract_guides,)
