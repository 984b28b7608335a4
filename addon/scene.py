"""What operators and panels find in the scene: the active groom, its head, and why something is missing."""

from __future__ import annotations

import bpy


def settings(context: bpy.types.Context) -> bpy.types.PropertyGroup:
    """Hairloom's settings of the scene."""
    return context.scene.hairloom


def active_groom(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active object where it is a hair Curves object."""
    obj = context.view_layer.objects.active if context.view_layer else None
    return obj if obj is not None and obj.type == "CURVES" else None


def active_mesh(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active object where it is a mesh."""
    obj = context.view_layer.objects.active if context.view_layer else None
    return obj if obj is not None and obj.type == "MESH" else None


def head_for(context: bpy.types.Context, groom: bpy.types.Object | None) -> bpy.types.Object | None:
    """The head chosen in the panel, or else the mesh that the groom hangs on."""
    chosen = settings(context).head
    if chosen is None and groom is not None:
        chosen = groom.data.surface
    # a head that was deleted from the scene may live on in the setting
    return chosen if chosen is not None and chosen.name in context.view_layer.objects else None


def groom_and_head(context: bpy.types.Context) -> dict[str, bpy.types.Object]:
    """The active groom and its head, as a job's sources."""
    groom = active_groom(context)
    return {"groom": groom, "head": head_for(context, groom)}


def select_only(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Make `obj` the active and only selected object."""
    for other in context.selected_objects:
        other.select_set(False)
    obj.select_set(True)
    context.view_layer.objects.active = obj


def show_colors(context: bpy.types.Context) -> None:
    """Colours of strands are seen with materials only: let the 3D view that an operator was called in show them."""
    space = context.space_data
    if space is not None and space.type == "VIEW_3D" and space.shading.type in {"SOLID", "WIREFRAME"}:
        space.shading.type = "MATERIAL"


# Why an operator cannot run: a sentence with the remedy, or '' when it can. Polls and panels show the same words.


def why_no_object_mode(context: bpy.types.Context) -> str:
    return "" if context.mode == "OBJECT" else "Switch to Object Mode first"


def why_no_groom(context: bpy.types.Context) -> str:
    """Is no groom with strands active?"""
    groom = active_groom(context)
    if groom is None:
        return "Select a groom (hair Curves): import one, or add a starter groom"
    return "" if len(groom.data.curves) else f"'{groom.name}' has no strands; choose a groom that has"


def why_no_head(context: bpy.types.Context) -> str:
    """Is no groom active, or its head not known?"""
    missing = why_no_groom(context)
    if not missing and head_for(context, active_groom(context)) is None:
        return "Choose a head in the Head panel: add one, or set up a mesh of yours"
    return missing


def why_no_mesh(context: bpy.types.Context) -> str:
    return "" if active_mesh(context) is not None else "Select the mesh that is to be the head"


def why_busy(context: bpy.types.Context) -> str:
    """Does a job run?"""
    job = context.window_manager.hairloom_job
    return f"{job.label} is still running; wait for it or cancel it first" if job.is_running else ""


def why_no_job(context: bpy.types.Context) -> str:
    """Why a job on the active groom and its head cannot start."""
    return why_busy(context) or why_no_object_mode(context) or why_no_head(context)


def allowed(cls: type, reason: str) -> bool:
    """The answer of a poll: True without a reason, else False with the reason as its message."""
    if reason:
        cls.poll_message_set(reason)
    return not reason
