"""The center strands of a level of wisps as a groom of their own."""

from __future__ import annotations

import bpy

from .. import lazy, material, scene
from ..backend.errors import require
from ..jobs import Values
from .cluster_wisps import WispJob


class HAIRLOOM_OT_extract_centers(WispJob, bpy.types.Operator):
    """Cluster the active groom and make a new groom of the center strands of one level, one strand for each wisp"""

    bl_idname = "hairloom.extract_centers"
    bl_label = "Extract Centers"
    bl_options = {"UNDO"}

    level: bpy.props.IntProperty(
        name="Level",
        description="Level whose center strands are wanted; 1 has the smallest wisps",
        default=1,
        min=1,
        max=4,
    )

    def sources(self, context: bpy.types.Context) -> dict[str, bpy.types.Object]:
        coarsest = scene.settings(context).synthesis.hierarchy.n_levels - 1
        require(
            self.level <= coarsest, f"there is no level {self.level} of wisps; choose 1 to {coarsest}, or more levels"
        )
        return super().sources(context)

    def apply(self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values) -> str:
        groom, centers = sources["groom"], outputs["centers"]
        self.write_labels(groom, outputs)
        curves = lazy.bridge("curves")
        obj = curves.new_object(f"{groom.name} Centers {self.level}", centers[self.level - 1], context.collection)
        curves.number_strands(obj, lazy.bridge("wisps").attribute_name(self.level))
        obj.data.materials.append(groom.data.materials[0] if groom.data.materials else material.hair_material())
        if sources["head"].data.uv_layers.active is not None:
            lazy.bridge("attachment").attach_to_head(obj, sources["head"])
        scene.select_only(context, obj)
        return f"{obj.name}: {centers[self.level - 1].n_strands:,} center strands"


CLASSES = (HAIRLOOM_OT_extract_centers,)
