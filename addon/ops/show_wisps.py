"""Show the wisps of the active groom in colour."""

from __future__ import annotations

import bpy

from .. import lazy, material, scene
from ..jobs import reports_errors

# where the material that the colours replace is kept meanwhile
_KEPT_MATERIAL = "hairloom_material"


class HAIRLOOM_OT_show_wisps(bpy.types.Operator):
    """Show each wisp of the active groom in a colour of its own, or go back to its hair material"""

    bl_idname = "hairloom.show_wisps"
    bl_label = "Show Wisps"
    bl_options = {"REGISTER", "UNDO"}

    level: bpy.props.IntProperty(
        name="Level", description="Level of wisps to show; 0 shows the hair material again", default=1, min=0, max=4
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        missing = scene.why_no_groom(context)
        if not missing and "hairloom_wisp" not in scene.active_groom(context).data.attributes:
            missing = "The groom has no wisps yet; run Cluster Wisps first"
        return scene.allowed(cls, missing)

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        groom = scene.active_groom(context)
        if self.level == 0:
            show_hair(groom)
            return {"FINISHED"}
        count = lazy.bridge("wisps").show_colors(groom, self.level, material.WISP_COLOR)
        show_color(groom)
        scene.show_colors(context)
        self.report({"INFO"}, f"{count:,} wisps in colour")
        return {"FINISHED"}


def is_shown(curves: bpy.types.Curves) -> bool:
    """Are the wisps of these curves shown in colour?"""
    return bool(curves.materials) and curves.materials[0] is not None and curves.materials[0].name == material.WISPS


def show_color(groom: bpy.types.Object) -> None:
    curves = groom.data
    if is_shown(curves):
        return
    if not curves.materials:
        curves.materials.append(None)
    curves[_KEPT_MATERIAL] = curves.materials[0]
    curves.materials[0] = material.wisp_material()


def show_hair(groom: bpy.types.Object) -> None:
    curves = groom.data
    if is_shown(curves):
        curves.materials[0] = curves.get(_KEPT_MATERIAL) or material.hair_material()
    if _KEPT_MATERIAL in curves:
        del curves[_KEPT_MATERIAL]
    color = curves.attributes.get(material.WISP_COLOR)
    if color is not None:
        curves.attributes.remove(color)


CLASSES = (HAIRLOOM_OT_show_wisps,)
