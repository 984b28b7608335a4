"""Group the active groom's strands into wisps."""

from __future__ import annotations

import bpy

from .. import lazy, material, scene
from ..jobs import JobOperator, Values


class WispJob(JobOperator):
    """What clustering and extracting centers share."""

    job = "cluster_wisps"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_no_job(context))

    def sources(self, context: bpy.types.Context) -> dict[str, bpy.types.Object]:
        return scene.groom_and_head(context)

    def read(self, sources: dict[str, bpy.types.Object]) -> Values:
        return lazy.bridge("inputs").strands_and_head(sources)

    def params(self, context: bpy.types.Context) -> Values:
        return scene.settings(context).synthesis.to_params()

    def write_labels(self, groom: bpy.types.Object, outputs: Values) -> None:
        """The wisps of each level; the colours follow where they are shown."""
        wisps = lazy.bridge("wisps")
        wisps.write_labels(groom, outputs["labels"])
        if material.WISP_COLOR in groom.data.attributes:
            wisps.show_colors(groom, 1, material.WISP_COLOR)


class HAIRLOOM_OT_cluster_wisps(WispJob, bpy.types.Operator):
    """Group the strands of the active groom into wisps, level by level, and store each strand's wisp as an attribute"""

    bl_idname = "hairloom.cluster_wisps"
    bl_label = "Cluster Wisps"
    bl_options = {"UNDO"}

    def apply(self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values) -> str:
        self.write_labels(sources["groom"], outputs)
        counts = outputs["report"]["wisps"]
        return f"{sources['groom'].name}: " + ", ".join(f"{n:,} wisps in level {i}" for i, n in enumerate(counts, 1))


CLASSES = (HAIRLOOM_OT_cluster_wisps,)
