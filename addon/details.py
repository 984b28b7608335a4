"""What operators, panel and live update of the detail transfer share: who takes part, settings, reasons, memory."""

from __future__ import annotations

from typing import Any

import bpy

from . import detail_library, lazy, scene
from .backend.errors import require

Sources = dict[str, bpy.types.Object]
Values = dict[str, Any]
JOB = "transfer_details"


def is_in_scene(context: bpy.types.Context, obj: bpy.types.Object | None) -> bool:
    """A pointer keeps an object alive that the user deleted; such a one is in no scene."""
    return obj is not None and context.scene.objects.get(obj.name) == obj


# --- who takes part ----------------------------------------------------------------------------------------------


def chosen_source(context: bpy.types.Context) -> bpy.types.Object | None:
    """The groom chosen in Details From, unless it was deleted."""
    source = scene.settings(context).details.source
    return source if is_in_scene(context, source) else None


def head_of_source(context: bpy.types.Context) -> bpy.types.Object | None:
    """The head chosen for the groom in Details From, or else the mesh that it hangs on."""
    source, chosen = chosen_source(context), scene.settings(context).details.source_head
    if is_in_scene(context, chosen):
        return chosen
    return source.data.surface if source is not None and is_in_scene(context, source.data.surface) else None


def base_and_head(context: bpy.types.Context) -> Sources:
    """The active groom and the mesh it hangs on, or else the head chosen in the Head panel."""
    groom = scene.active_groom(context)
    # its own first: the two grooms of a transfer may well grow on different heads
    own = groom.data.surface if groom is not None else None
    return {"base": groom, "base_head": own if is_in_scene(context, own) else scene.head_for(context, groom)}


def chosen_detail(context: bpy.types.Context) -> str:
    """The name of the saved detail chosen in the panel; '' where there is none."""
    return context.window_manager.hairloom_details.saved_detail


def new_name(context: bpy.types.Context) -> str:
    """The name typed in the panel for a detail that is to be saved."""
    return context.window_manager.hairloom_details.new_name


# --- reasons -----------------------------------------------------------------------------------------------------


def why_no_base(context: bpy.types.Context) -> str:
    """Why the active groom cannot get details."""
    return scene.why_no_object_mode(context) or scene.why_no_head(context)


def why_no_source(context: bpy.types.Context) -> str:
    """Is no groom with details chosen, or its head not known?"""
    source = chosen_source(context)
    if source is None:
        return "Choose the groom with the details in Details From, or apply a saved detail"
    if detail_library.FILE_PROPERTY in source:
        return ""
    if not len(source.data.curves):
        return f"'{source.name}' has no strands; choose another groom in Details From"
    if head_of_source(context) is None:
        return f"'{source.name}' hangs on no head: attach it to one, or choose Its Head"
    return ""


def why_no_transfer(context: bpy.types.Context) -> str:
    """Why the transfer cannot start."""
    return scene.why_busy(context) or why_no_base(context) or why_no_source(context)


def why_no_update(context: bpy.types.Context, result: bpy.types.Object | None) -> str:
    """Why the details of a groom cannot be made again."""
    if result is None or not result.hairloom_transfer.is_set:
        return "Select a groom that was made by Transfer Details or Apply Detail"
    memory = result.hairloom_transfer
    if not is_in_scene(context, memory.base):
        return f"'{memory.base_name}', whose shape '{result.name}' has, was deleted"
    if not memory.saved_detail and not is_in_scene(context, memory.source):
        return f"'{memory.source_name}', whose details '{result.name}' has, was deleted"
    heads = [memory.base_head] if memory.saved_detail else [memory.base_head, memory.source_head]
    if not all(is_in_scene(context, head) for head in heads):
        return f"A head of the grooms that '{result.name}' was made of was deleted"
    return scene.why_no_object_mode(context)


# --- the job -----------------------------------------------------------------------------------------------------


def prepare(sources: Sources, saved_detail: str) -> Any:
    """The transfer (bridge.hierarchies.Transfer) of a groom's details, or of the saved detail of that name.

    Raises
    ------
    InputError : a groom without strands, a head without scalp, no such detail. FileError : a damaged detail.
    """
    settings = analysis_params(bpy.context)
    source: Any = None
    if saved_detail:
        path = detail_library.find_detail(saved_detail).path
        source = lazy.backend("synthesis.details").read_detail(path).hierarchy
        # the groom is clustered to fit
        settings["n_samples"] = source.levels[0].n_points
        settings["hierarchy"]["n_levels"] = source.n_levels
    else:
        source = (sources["source"], sources["source_head"])
    base = (sources["base"], sources["base_head"])
    return lazy.bridge("hierarchies").prepare_transfer(source, base, settings)


def analysis_params(context: bpy.types.Context) -> Values:
    """The settings by which grooms are clustered."""
    return scene.settings(context).synthesis.to_params()


def job_params(context: bpy.types.Context, transfer: Any, *, compare: bool = True) -> Values:
    """The settings of the job `transfer_details`."""
    detail = scene.settings(context).details.settings.to_params()
    return {"analysis": transfer.analysis, "detail": detail, "compare": compare}


# --- memory ------------------------------------------------------------------------------------------------------


def remember(obj: bpy.types.Object, sources: Sources, saved_detail: str) -> None:
    """Note in a groom where its shape and its details came from."""
    memory = obj.hairloom_transfer
    memory.base, memory.base_head, memory.base_name = sources["base"], sources["base_head"], sources["base"].name
    memory.saved_detail = saved_detail
    if not saved_detail:
        memory.source, memory.source_head = sources["source"], sources["source_head"]
        memory.source_name = sources["source"].name


def remembered(obj: bpy.types.Object) -> Sources:
    """The objects that a groom was made of.

    Raises
    ------
    InputError : one of them is gone.
    """
    missing = why_no_update(bpy.context, obj)
    require(not missing, missing)
    memory = obj.hairloom_transfer
    sources = {"base": memory.base, "base_head": memory.base_head}
    if not memory.saved_detail:
        sources |= {"source": memory.source, "source_head": memory.source_head}
    return sources
