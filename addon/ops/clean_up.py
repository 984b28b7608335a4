"""Clean the active groom up."""

from __future__ import annotations

from typing import Any

import bpy

from .. import lazy, scene
from ..jobs import JobOperator, Values


class HAIRLOOM_OT_clean_up(JobOperator, bpy.types.Operator):
    """Repair or remove strands that are broken, doubled, far from the scalp or inside the head"""

    bl_idname = "hairloom.clean_up"
    bl_label = "Clean Up"
    bl_options = {"UNDO"}
    job = "clean_up"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_no_job(context))

    def sources(self, context: bpy.types.Context) -> dict[str, bpy.types.Object]:
        return scene.groom_and_head(context)

    def read(self, sources: dict[str, bpy.types.Object]) -> Values:
        return lazy.bridge("inputs").strands_and_head(sources)

    def params(self, context: bpy.types.Context) -> Values:
        return scene.settings(context).clean_up.to_params()

    def apply(self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values) -> str:
        groom = sources["groom"]
        lazy.bridge("curves").replace_strands(groom, outputs["strands"])
        return f"{groom.name}: {describe(outputs['report'])}"


def describe(report: dict[str, Any]) -> str:
    """The report's counts that are not zero, in words."""
    counts = {name: value for name, value in report.items() if isinstance(value, int) and value}
    words = [f"{value:,} {name.removeprefix('n_').replace('_', ' ')}" for name, value in counts.items()]
    return ", ".join(words) or "nothing to clean up"


CLASSES = (HAIRLOOM_OT_clean_up,)
