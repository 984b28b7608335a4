"""Choose the strands of the active groom that are simulated."""

from __future__ import annotations

import bpy

from .. import lazy, scene, simulation
from ..jobs import JobOperator, Values


class HAIRLOOM_OT_make_guides(JobOperator, bpy.types.Operator):
    """Choose the strands of the active groom that are simulated, its guides, and let every other strand follow some"""

    bl_idname = "hairloom.make_guides"
    bl_label = "Make Guides"
    bl_options = {"UNDO"}
    job = "make_guides"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, simulation.why_no_guides_job(context))

    def sources(self, context: bpy.types.Context) -> dict[str, bpy.types.Object]:
        return simulation.groom_and_head(context)

    def read(self, sources: dict[str, bpy.types.Object]) -> Values:
        return lazy.bridge("simulation").guide_inputs(sources)

    def params(self, context: bpy.types.Context) -> Values:
        return scene.settings(context).simulation.guides.to_params()

    def apply(self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values) -> str:
        groom = sources["groom"]
        lazy.bridge("guides").write_guides(groom, outputs["guides"], outputs["wisps"])
        simulation.remember_guides(groom, len(outputs["guides"]))
        return f"{groom.name}: {len(outputs['guides']):,} guides for {len(groom.data.curves):,} strands"


CLASSES = (HAIRLOOM_OT_make_guides,)
