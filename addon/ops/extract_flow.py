"""The flow of the active groom as strands of its own."""

from __future__ import annotations

import bpy

from .. import flow_link, lazy, live_flow, scene
from ..jobs import reports_errors


class HAIRLOOM_OT_extract_flow(bpy.types.Operator):
    """Make strands that show how the wisps of the active groom flow, one for each wisp, to be edited with any tool.

    The groom remembers its details along them; Apply Flow brings it to wherever they are
    """

    bl_idname = "hairloom.extract_flow"
    bl_label = "Extract Flow"
    bl_options = {"REGISTER", "UNDO"}

    level: bpy.props.IntProperty(
        name="Level",
        description="Level of wisps whose flow is wanted; 0 takes the largest wisps",
        default=0,
        min=0,
        max=4,
    )
    n_points: bpy.props.IntProperty(
        name="Points", description="Points of each flow strand", default=32, min=4, soft_max=64, max=512
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, flow_link.why_no_extract(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        groom = scene.active_groom(context)
        level = self.level or lazy.bridge("wisps").clustered_levels(groom.data)
        flow = lazy.bridge("flow").extract(groom, level, self.n_points, context.collection)
        live_flow.live.forget()
        scene.select_only(context, flow)
        self.report({"INFO"}, f"{flow.name}: {len(flow.data.curves):,} strands; edit them, then Apply Flow")
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_extract_flow,)
