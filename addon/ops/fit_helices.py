"""Fit helices to the guides of the active groom and show them."""

from __future__ import annotations

import bpy

from .. import air, lazy, scene, simulation
from ..jobs import JobOperator, Values


class HAIRLOOM_OT_fit_helices(JobOperator, bpy.types.Operator):
    """Fit the helices to the guides of the active groom that are simulated, and show them with their break points"""

    bl_idname = "hairloom.fit_helices"
    bl_label = "Fit Helices"
    bl_options = {"UNDO"}
    job = "fit_helices"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, simulation.why_no_guides_job(context) or simulation.why_no_guides(context))

    def sources(self, context: bpy.types.Context) -> dict[str, bpy.types.Object]:
        return {"groom": scene.active_groom(context)}

    def read(self, sources: dict[str, bpy.types.Object]) -> Values:
        return lazy.bridge("simulation").fit_inputs(sources["groom"])

    def params(self, context: bpy.types.Context) -> Values:
        return scene.settings(context).simulation.fit.to_params()

    def apply(self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values) -> str:
        groom = sources["groom"]
        lazy.bridge("helices").show_helices(groom, outputs["fit"].helices, air.metres_per_unit(context.scene))
        scene.show_colors(context)
        return simulation.remember_fit(groom, outputs["report"])


CLASSES = (HAIRLOOM_OT_fit_helices,)
