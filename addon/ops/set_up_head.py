"""Make a head of the active mesh: scalp region and UV map."""

from __future__ import annotations

from typing import Any

import bpy

from .. import lazy, scene
from ..backend.errors import require
from ..jobs import reports_errors


class HAIRLOOM_OT_set_up_head(bpy.types.Operator):
    """Make the active mesh the head: give it a scalp region, found from the hair, and a UV map where it has none"""

    bl_idname = "hairloom.set_up_head"
    bl_label = "Set Up Head"
    bl_options = {"REGISTER", "UNDO"}

    scalp_from: bpy.props.EnumProperty(
        name="Scalp",
        description="Where the scalp region comes from",
        items=(
            ("AUTO", "Automatic", "Keep the scalp region that the mesh has; find one from the hair where it has none"),
            ("HAIR", "From the Hair", "Find the scalp from the hair's roots and overwrite the region that is there"),
        ),
        default="AUTO",
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_no_object_mode(context) or scene.why_no_mesh(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        obj, settings = scene.active_mesh(context), scene.settings(context)
        bridge = lazy.bridge("mesh")
        head = bridge.read_head(obj, settings.scalp_group, evaluated=False)
        done = []
        find = self.scalp_from == "HAIR" or not bridge.has_region(obj, settings.scalp_group)
        if find:
            head = lazy.backend("geometry.head").find_scalp(head, self._roots(context, obj))
        require(
            head.scalp.any(), f"no face of '{obj.name}' is in '{settings.scalp_group}'; paint it, or find it from hair"
        )
        corner_uv = None
        if obj.data.uv_layers.active is None:
            corner_uv = lazy.backend("geometry.head").unwrap(head.vertices, head.triangles)
        # everything is known: from here on the mesh changes
        if find:
            bridge.write_scalp(obj, head, settings.scalp_group)
            done.append(f"found a scalp of {int(head.scalp.sum()):,} triangles")
        if corner_uv is not None:
            bridge.write_uv(obj, corner_uv)
            done.append("made a UV map")
        settings.head = obj
        self.report({"INFO"}, f"'{obj.name}' is the head" + (": " + ", ".join(done) if done else ""))
        return {"FINISHED"}

    def _roots(self, context: bpy.types.Context, obj: bpy.types.Object) -> Any:
        grooms = [groom for groom in context.view_layer.objects if groom.type == "CURVES" and len(groom.data.curves)]
        selected = [groom for groom in grooms if groom.select_get()]
        attached = [groom for groom in grooms if groom.data.surface is obj]
        grooms = selected or attached or grooms
        require(
            grooms,
            f"'{obj.name}' has no vertex group '{scene.settings(context).scalp_group}' and there is no hair to find "
            "the scalp from; import a groom first, or make the vertex group",
        )
        return lazy.bridge("curves").read_roots(grooms)


CLASSES = (HAIRLOOM_OT_set_up_head,)
