"""Make a new hairstyle like the active groom."""

from __future__ import annotations

from typing import Any

import bpy

from .. import lazy, material, scene
from ..jobs import JobOperator, Values


class HAIRLOOM_OT_synthesize(JobOperator, bpy.types.Operator):
    """Make a new hairstyle with the character of the active groom, attached to the head"""

    bl_idname = "hairloom.synthesize"
    bl_label = "Synthesize"
    bl_options = {"UNDO"}
    job = "synthesize"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_no_job(context))

    def sources(self, context: bpy.types.Context) -> dict[str, bpy.types.Object]:
        return scene.groom_and_head(context)

    def read(self, sources: dict[str, bpy.types.Object]) -> Values:
        return lazy.bridge("inputs").synthesis_inputs(sources)

    def params(self, context: bpy.types.Context) -> Values:
        return scene.settings(context).synthesis.to_params()

    def apply(self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values) -> str:
        example, head, curves = sources["groom"], sources["head"], lazy.bridge("curves")
        strands = lazy.bridge("inputs").with_radius_of(example, outputs["strands"])
        obj = curves.new_object(f"{example.name} New", strands, context.collection)
        lazy.bridge("attachment").attach_at(obj, head, outputs["surface_triangle"], outputs["surface_barycentric"])
        obj.data.materials.append(material.material_of(example))
        scene.select_only(context, obj)
        return f"{obj.name}: {strands.n_strands:,} strands{_alikeness(outputs['report'])}"


def _alikeness(report: dict[str, Any]) -> str:
    copied = report.get("style", {}).get("copied_share")
    return "" if copied is None else f", {copied:.0%} of them near copies"


CLASSES = (HAIRLOOM_OT_synthesize,)
