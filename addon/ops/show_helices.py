"""Show or hide the helices that were fitted to the guides of the active groom."""

from __future__ import annotations

import bpy

from .. import scene, simulation


class HAIRLOOM_OT_show_helices(bpy.types.Operator):
    """Show the helices that were fitted to the guides of the active groom, with their break points, or hide them"""

    bl_idname = "hairloom.show_helices"
    bl_label = "Show Helices"
    bl_options = {"REGISTER", "UNDO"}

    show: bpy.props.BoolProperty(name="Show", default=True, description="Show the helices; otherwise hide them")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, simulation.why_no_helices(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        simulation.helices_of(scene.active_groom(context)).hide_viewport = not self.show
        if self.show:
            scene.show_colors(context)
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_show_helices,)
