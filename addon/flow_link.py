"""How a groom and its flow know each other: names of attributes, who follows whom, and why something cannot be done."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from . import scene

# on both: which flow strand, INT on each strand
FLOW = "hairloom_flow"
# on the groom, for each point: metres along the flow strand, displacement from it, length of the segment before
PLACE, OFFSET, STEP = "hairloom_flow_place", "hairloom_flow_offset", "hairloom_flow_step"
# on the groom, for each strand: by what edits are found
REACH, HEADING = "hairloom_flow_check", "hairloom_flow_heading"
# on the flow, for each strand: frame at the root, width of its wisp, length when the hair was bound to it. The frame is
# in the object's axes and turns with it; Blender's Join and Apply Rotation turn positions only, so a flow whose object
# was turned is applied first and joined then
NORMAL, TANGENT = "hairloom_flow_normal", "hairloom_flow_tangent"
WIDTH, LENGTH = "hairloom_flow_width", "hairloom_flow_length"


def is_flow(obj: bpy.types.Object | None) -> bool:
    """Are these strands the flow of a groom?"""
    return obj is not None and obj.type == "CURVES" and NORMAL in obj.data.attributes


def is_bound(obj: bpy.types.Object | None) -> bool:
    """Does this groom know its flow strands?"""
    return obj is not None and obj.type == "CURVES" and PLACE in obj.data.attributes


def flow_of(groom: bpy.types.Object) -> bpy.types.Object | None:
    """The flow chosen for a groom; None when there is none or it was deleted from the file's scenes."""
    flow = groom.hairloom_flow.source
    return flow if flow is not None and flow.users_scene else None


def followers(flow: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """The grooms that follow a flow."""
    for obj in bpy.data.objects:
        if obj.type == "CURVES" and obj.hairloom_flow.source == flow and is_bound(obj):
            yield obj


def grooms_to_move(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The active groom where it has a flow; where the active object is a flow itself, the grooms that follow it."""
    active = scene.active_groom(context)
    if active is None:
        return []
    return [active] if is_bound(active) else list(followers(active))


def why_no_extract(context: bpy.types.Context) -> str:
    """Why the active groom's flow cannot be extracted; '' when it can."""
    missing = scene.why_no_object_mode(context) or scene.why_no_groom(context)
    if not missing and "hairloom_wisp" not in scene.active_groom(context).data.attributes:
        missing = "The groom has no wisps yet; run Cluster Wisps first"
    return missing


def why_no_apply(context: bpy.types.Context) -> str:
    """Why no flow can be applied; '' when it can."""
    missing = scene.why_no_groom(context)
    if missing:
        return missing
    active, grooms = scene.active_groom(context), grooms_to_move(context)
    if not grooms:
        if is_flow(active):
            return f"No groom follows '{active.name}'; select a groom and choose this flow in its Flow panel"
        return "The groom has no flow yet; run Extract Flow first"
    if flow_of(grooms[0]) is None:
        return "The groom's flow is gone; choose another in the Flow panel, or run Extract Flow again"
    return ""
