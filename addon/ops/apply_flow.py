"""Bring grooms to their flow as it is now."""

from __future__ import annotations

import bpy

from .. import flow_link, lazy, live_flow, scene
from ..backend.errors import require
from ..jobs import reports_errors


class HAIRLOOM_OT_apply_flow(bpy.types.Operator):
    """Bring the active groom, or all grooms that follow the active flow, to the flow as it is now, details included"""

    bl_idname = "hairloom.apply_flow"
    bl_label = "Apply Flow"
    bl_options = {"REGISTER", "UNDO"}

    discard_edits: bpy.props.BoolProperty(
        name="Discard Edits",
        description="Apply even where strands of the groom were edited since, which undoes those edits",
        default=False,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, flow_link.why_no_apply(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        depsgraph, bridge = context.evaluated_depsgraph_get(), lazy.bridge("flow")
        for groom in flow_link.grooms_to_move(context):
            flow = flow_link.flow_of(groom)
            require(flow is not None, f"'{groom.name}' has no flow; choose one in the Flow panel")
            applied = bridge.apply(
                groom,
                flow.evaluated_get(depsgraph),
                discard_edits=self.discard_edits,
                follow_length=groom.hairloom_flow.follow_length,
            )
            live_flow.live.problems.pop(groom.session_uid, None)
            stayed = f"; {applied.n_missing:,} stayed, their flow strands are gone" if applied.n_missing else ""
            kind = "WARNING" if applied.n_missing else "INFO"
            self.report({kind}, f"{groom.name}: {applied.n_moved:,} strands follow '{flow.name}'{stayed}")
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_apply_flow,)
