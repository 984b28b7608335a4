"""The simulation of grooms as operators and panels see it: what it needs, where its caches lie, what it remembers.

Each simulation writes a cache folder of its own, numbered after the one that the groom plays, so that a simulation
that fails or is cancelled leaves what is played alone, and undo finds the one before.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from . import lazy, playback, scene
from .backend.errors import HairloomError

Values = dict[str, Any]
GUIDE = "hairloom_guide"
HEADER = "header.json"  # of a cache


def groom_and_head(context: bpy.types.Context) -> dict[str, bpy.types.Object]:
    """The active groom and, where it is known, its head, as a job's sources."""
    return {name: obj for name, obj in scene.groom_and_head(context).items() if obj is not None}


def colliders(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The meshes of the chosen collection that are in the scene, by name; without the head."""
    collection = scene.settings(context).simulation.colliders
    if collection is None:
        return []
    head = scene.head_for(context, scene.active_groom(context))
    found = [
        obj
        for obj in collection.all_objects
        if obj.type == "MESH" and obj is not head and obj.name in context.view_layer.objects
    ]
    return sorted(found, key=lambda obj: obj.name)


# --- why an operator cannot run ----------------------------------------------------------------------------------


def why_no_guides_job(context: bpy.types.Context) -> str:
    """Why guides cannot be made."""
    missing = why_no_job(context)
    if missing:
        return missing
    groom = scene.active_groom(context)
    if scene.settings(context).simulation.guides_from_wisps:
        has_wisps = "hairloom_wisp" in groom.data.attributes
        return "" if has_wisps else "The groom has no wisps: run Cluster Wisps, or switch From Wisps off"
    return scene.why_no_head(context)


def why_no_job(context: bpy.types.Context) -> str:
    """Why a job on the active groom alone cannot start."""
    return scene.why_busy(context) or scene.why_no_object_mode(context) or scene.why_no_groom(context)


def why_no_helices(context: bpy.types.Context) -> str:
    """Does the active groom show no helices?"""
    missing = scene.why_no_groom(context)
    if not missing and helices_of(scene.active_groom(context)) is None:
        missing = "No helices were fitted to this groom yet: press Fit Helices"
    return missing


def why_no_guides(context: bpy.types.Context) -> str:
    """Does the active groom have no guides?"""
    missing = scene.why_no_groom(context)
    if missing:
        return missing
    groom = scene.active_groom(context)
    if GUIDE not in groom.data.attributes:
        return "The groom has no guides yet: press Make Guides"
    memory = groom.hairloom_simulation
    if memory.n_strands and memory.n_strands != len(groom.data.curves):
        return "Strands were added or removed since Make Guides: press it again"
    return ""


def why_no_simulation(context: bpy.types.Context) -> str:
    """Why the simulation of the active groom cannot start."""
    missing = why_no_job(context) or why_no_guides(context)
    if missing:
        return missing
    groom = scene.active_groom(context)
    if context.scene.frame_end <= context.scene.frame_start:
        return "The scene has one frame: set its end frame"
    if groom.hairloom_flow.is_live:
        return f"'{groom.name}' follows its flow: switch Live off in the Flow panel"
    state, text = playback_state(context, groom)
    return text if state == playback.EDITED else ""


def why_no_resume(context: bpy.types.Context) -> str:
    """Is there no simulation of the active groom that was cancelled?"""
    missing = why_no_simulation(context)
    if not missing and unfinished(scene.active_groom(context)) is None:
        missing = "No simulation of this groom was cancelled or cut short: press Simulate"
    return missing


def playback_state(context: bpy.types.Context, groom: bpy.types.Object) -> tuple[str, str]:
    """`playback.status`, which looks at every point; not while the animation plays and each frame would wait for it."""
    if context.screen is not None and context.screen.is_animation_playing:
        return playback.PLAYING, ""
    return playback.status(groom)


# --- what a groom remembers --------------------------------------------------------------------------------------


def remember_guides(groom: bpy.types.Object, n_guides: int) -> None:
    """Note how many guides were made, and of how many strands, for the panel."""
    memory = groom.hairloom_simulation
    memory.n_guides, memory.n_strands = n_guides, len(groom.data.curves)


def remember_fit(groom: bpy.types.Object, report: Values) -> str:
    """Note what the fit of helices said; returns it for the user."""
    fewest, mean, most = report["elements_per_strand"]
    text = (
        f"{report['strands']:,} guides of {fewest} to {most} helices, {mean:.1f} on average; "
        f"{1000 * report['rms_m']:.2f} mm off, {1000 * report['maximum_m']:.2f} mm at most"
    )
    groom.hairloom_simulation.fit_report = text
    return f"{groom.name}: {text}"


def remember_report(groom: bpy.types.Object, report: Values, remarks: Sequence[str]) -> str:
    """Note what the simulation said, a remark a line, for the panel; returns them in one line for the user."""
    lines = [_summary(report), *_rest_remarks(report["equilibrium"] or {}), *remarks]
    groom.hairloom_simulation.report = "\n".join(lines)
    return f"{groom.name}: {'; '.join(lines)}"


def _summary(report: Values) -> str:
    return f"{report['frames']:,} frames of {report['guides']:,} guides with {report['elements']:,} helices"


def _rest_remarks(equilibrium: Values) -> list[str]:
    """What the artist must know of the rest shape."""
    found: list[str] = []
    if not equilibrium:
        return found
    if equilibrium["n_scaled"]:
        found.append(
            f"{equilibrium['n_scaled']:,} guides were stiffened to stand in their pose, "
            f"{equilibrium['median_scale']:.3g} times in the middle and {equilibrium['largest_scale']:.3g} at most"
        )
    unstable = equilibrium["n_guides"] - equilibrium["n_stable"]
    if unstable:
        found.append(f"{unstable:,} guides cannot stand in their pose and will fold: more stiffness or cohesion helps")
    return found


def helices_of(groom: bpy.types.Object) -> bpy.types.Object | None:
    """The object that shows the groom's helices, if it is in the scene."""
    found = groom.hairloom_simulation.helices
    return found if found is not None and found.name in bpy.context.scene.objects else None


# --- caches ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Unfinished:
    """A simulation that was cancelled or cut short: its folder, and how many frames it has of how many."""

    folder: Path
    n_frames: int
    n_planned: int


def caches_folder(groom: bpy.types.Object) -> Path:
    """Where the caches of a groom lie: in the chosen folder, or in Blender's temporary one in a file never saved."""
    chosen = bpy.context.scene.hairloom.simulation.cache_folder
    name = bpy.path.clean_name(groom.data.name)
    if chosen.startswith("//") and not bpy.data.filepath:
        return Path(bpy.app.tempdir, "hairloom", name)
    stem = Path(bpy.data.filepath).stem or "unsaved"
    return Path(os.path.abspath(bpy.path.abspath(chosen)), bpy.path.clean_name(stem), name)


def next_cache(groom: bpy.types.Object) -> Path:
    """The folder that the groom's next simulation writes: never the one that is played."""
    folder = caches_folder(groom)
    playing = playback.folder(groom)
    if playing is None or playing.parent != folder or not playing.name.isdigit():
        return folder / "1"
    return folder / str(int(playing.name) + 1)


def unfinished(groom: bpy.types.Object) -> Unfinished | None:
    """The simulation of the groom that can be resumed, if there is one."""
    folder = next_cache(groom)
    if not os.path.isfile(folder / HEADER):
        return None
    try:
        reader = lazy.backend("io.sim_cache").CacheReader(folder)
    except HairloomError:
        return None
    found = Unfinished(folder, reader.n_frames, reader.header.n_planned)
    reader.close()
    return found if 0 < found.n_frames < found.n_planned else None


def drop_old_caches(groom: bpy.types.Object, kept: set[Path]) -> None:
    """Delete the groom's caches that no object plays and undo does not lead back to."""
    playing = {folder for obj in bpy.data.objects if (folder := playback.folder(obj)) is not None}
    for folder in _numbered(caches_folder(groom)):
        if folder not in kept | playing:
            lazy.backend("io.sim_cache").delete_cache(folder)


def _numbered(folder: Path) -> Iterator[Path]:
    if folder.is_dir():
        yield from (path for path in sorted(folder.iterdir()) if path.name.isdigit())
