"""Playback of simulation caches on Curves: the link of a groom to its cache, and the handlers that play it.

The link is a custom property of the Curves, so it is saved, duplicated and undone with them: a path relative to the
.blend file, as Blender writes them. The groom's own shape is kept in the point attribute `hairloom_rest_position`.
Handlers find Curves by their place in the file each time: undo replaces the data. numpy is imported when the first
cache is played.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy

from . import jobs, lazy
from .backend.errors import FileError, HairloomError, require

# on the Curves: the cache folder, '//...' where the file has a place; and that an edit of the hair waits for a choice
LINK, EDIT_MARK = "hairloom_cache", "hairloom_cache_edited"
MOTION_BLUR = "Hairloom Motion Blur"  # modifier and its node group
BAKED = "Hairloom Baked"  # the modifier by which Blender itself plays a baked file

NONE, PLAYING, STALE, EDITED, BROKEN = "NONE", "PLAYING", "STALE", "EDITED", "BROKEN"


# --- the link ----------------------------------------------------------------------------------------------------


def folder(obj: bpy.types.Object) -> Path | None:
    """The cache folder that `obj` plays, absolute; None where it plays none."""
    return _folder(obj.data) if obj.type == "CURVES" else None


def _folder(curves: bpy.types.Curves) -> Path | None:
    link = curves.get(LINK)
    if not isinstance(link, str) or not link:
        return None
    return Path(os.path.normpath(bpy.path.abspath(link, library=curves.library)))


def _link_text(path: Path, blend: str) -> str:
    """`path` relative to the .blend file at `blend`; absolute where there is none, or it is on another drive."""
    if not blend:
        return str(path)
    try:
        return "//" + os.path.relpath(path, os.path.dirname(blend)).replace(os.sep, "/")
    except ValueError:
        return str(path)


def _linked() -> Iterator[bpy.types.Curves]:
    return (curves for curves in bpy.data.hair_curves if curves.get(LINK))


def _users(curves: bpy.types.Curves) -> list[bpy.types.Object]:
    return [obj for obj in bpy.data.objects if obj.type == "CURVES" and obj.data == curves]


def attach(obj: bpy.types.Object, cache: str | os.PathLike[str]) -> None:
    """Let `obj` play the cache in a folder from now on, at once at the current frame.

    Its positions become its rest positions, unless it played a cache before: then the rest positions of that stay.

    Raises
    ------
    FileError : no cache there, damaged, or without a frame. InputError : of another groom, or the hair follows a flow.
    """
    curves, path = obj.data, Path(os.path.abspath(cache))
    bridge = lazy.bridge("playback")
    live = obj.hairloom_flow.is_live
    require(not live, f"'{obj.name}' follows its flow: switch Live off in the Flow panel, then simulate again")
    bridge.Player(path).check(curves)
    if curves.get(LINK) is None or bridge.rest(curves) is None:
        bridge.keep_rest(curves)
    curves[LINK] = _link_text(path, bpy.data.filepath)
    for user in _users(curves):
        _add_motion_blur(user)
        if BAKED in user.modifiers:
            user.modifiers.remove(user.modifiers[BAKED])
    play_again(obj)


def play_again(obj: bpy.types.Object) -> None:
    """Show the cache's frame, whatever was edited since."""
    obj.data.pop(EDIT_MARK, None)
    players.drop(obj.data)
    players.play(obj.data, frame_of(bpy.context.scene))


def detach(obj: bpy.types.Object, *, keep_shape: bool = False) -> None:
    """Play no cache any more; the hair goes back to its rest positions, or stays as it is. No file is deleted."""
    curves = obj.data
    if curves.get(LINK) is None:
        return
    bridge = lazy.bridge("playback")
    players.drop(curves)
    if not keep_shape:
        bridge.show_rest(curves)
    bridge.drop_rest(curves)
    del curves[LINK]
    curves.pop(EDIT_MARK, None)
    for user in _users(curves):
        _remove_motion_blur(user)
    curves.update_tag()


def rest_positions(obj: bpy.types.Object) -> Any:
    """(P, 3) float32, object space: the groom as the artist made it; None where no cache moves it."""
    if folder(obj) is None:
        return None
    return lazy.bridge("playback").rest(obj.data)


def fingerprint(obj: bpy.types.Object) -> str:
    """What a cache of this groom, simulated now, has as its fingerprint: of the groom, '-', of the settings."""
    return f"{lazy.bridge('playback').groom_fingerprint(obj.data)}-{_settings_fingerprint()}"


def _settings_fingerprint() -> str:
    settings = bpy.context.scene.hairloom.simulation.to_params()
    return lazy.bridge("playback").settings_fingerprint(settings)


def status(obj: bpy.types.Object) -> tuple[str, str]:
    """How playback goes: NONE, PLAYING, STALE (plays what was changed since), EDITED or BROKEN (both do not play), and
    a sentence for the panel."""
    curves = obj.data
    if folder(obj) is None:
        return NONE, ""
    problem = players.problem(curves)
    if problem is not None:
        return problem
    return players.freshness(obj)


# --- motion blur -------------------------------------------------------------------------------------------------


def _add_motion_blur(obj: bpy.types.Object) -> None:
    """Cycles samples hair within a frame only on objects that a modifier may deform; this one hands it through."""
    if MOTION_BLUR in obj.modifiers:
        return
    tree = bpy.data.node_groups.get(MOTION_BLUR)
    if tree is None or tree.bl_idname != "GeometryNodeTree" or tree.library is not None:
        tree = bpy.data.node_groups.new(MOTION_BLUR, "GeometryNodeTree")
        tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
        tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        tree.links.new(tree.nodes.new("NodeGroupInput").outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
    modifier = obj.modifiers.new(MOTION_BLUR, "NODES")
    modifier.node_group = tree
    modifier.show_viewport = False
    modifier.show_expanded = False


def _remove_motion_blur(obj: bpy.types.Object) -> None:
    modifier = obj.modifiers.get(MOTION_BLUR)
    if modifier is None:
        return
    tree = modifier.node_group
    obj.modifiers.remove(modifier)
    if tree is not None and tree.users == 0 and tree.name == MOTION_BLUR:
        bpy.data.node_groups.remove(tree)


# --- playing -----------------------------------------------------------------------------------------------------


def frame_of(scene: bpy.types.Scene) -> float:
    """The scene's frame, between frames too while Cycles samples motion blur."""
    return scene.frame_current + scene.frame_subframe


_EDITED = (
    EDITED,
    "The hair was edited after the simulation and does not play. Keep the edit by freeing the cache, or drop it",
)


class Players:
    """The players of this session, by the session's numbers of the Curves."""

    def __init__(self) -> None:
        self._players: dict[int, Any] = {}
        self._problems: dict[int, tuple[str, str]] = {}
        self._may_be_edited: set[int] = set()
        self._groom_fingerprints: dict[int, str] = {}

    def play_scene(self, scene: bpy.types.Scene) -> None:
        """Show the scene's frame on all its grooms that have a cache."""
        linked = {curves.session_uid for curves in _linked()}
        if not linked:
            return
        shown = {obj.data for obj in scene.objects if obj.type == "CURVES" and obj.data.session_uid in linked}
        for curves in shown:
            self.play(curves, frame_of(scene))

    def play(self, curves: bpy.types.Curves, frame: float) -> None:
        """Show one frame. An edit is not overwritten; without its file the hair is at rest. The panel says why."""
        uid = curves.session_uid
        before = self._problems.pop(uid, None)
        try:
            player = self._ready_player(curves)
            if self._is_edited(curves, player):
                self._problems[uid] = _EDITED
                if curves.library is None:
                    curves[EDIT_MARK] = True
            else:
                player.show(curves, frame)
                self._may_be_edited.discard(uid)
        except HairloomError as error:
            self._fail(curves, error, before)
        if self._problems.get(uid) != before and not bpy.app.is_job_running("RENDER"):
            jobs.redraw(bpy.context, "VIEW_3D")

    def _fail(self, curves: bpy.types.Curves, error: HairloomError, before: tuple[str, str] | None) -> None:
        """Keep the problem for the panel and, the first time, put the hair to rest where a file is missing."""
        self._problems[curves.session_uid] = problem = (BROKEN, str(error))
        if isinstance(error, FileError) and before != problem:
            lazy.bridge("playback").show_rest(curves)

    def _ready_player(self, curves: bpy.types.Curves) -> Any:
        """The player of these Curves, its folder opened again where that holds another simulation by now."""
        uid, path = curves.session_uid, _folder(curves)
        known = self._players.get(uid)
        if known is not None and known.folder == path:
            try:
                known.check(curves)
                return known
            except FileError:
                pass  # said below, if it is still so
        self.drop(curves)
        player = lazy.bridge("playback").Player(path)
        player.check(curves)
        self._players[uid] = player
        return player

    def _is_edited(self, curves: bpy.types.Curves, player: Any) -> bool:
        if curves.get(EDIT_MARK):
            return True
        # scripts in the background change positions without an update of the depsgraph
        maybe = bpy.app.background or curves.session_uid in self._may_be_edited
        return maybe and player.is_edited(curves)

    def problem(self, curves: bpy.types.Curves) -> tuple[str, str] | None:
        """Why the groom does not play; None when it does."""
        try:
            player = self._ready_player(curves)
        except HairloomError as error:
            return BROKEN, str(error)
        return _EDITED if self._is_edited(curves, player) else None

    def freshness(self, obj: bpy.types.Object) -> tuple[str, str]:
        """PLAYING or STALE and a sentence, of a groom that plays."""
        curves, reader = obj.data, self._ready_player(obj.data).reader
        uid = curves.session_uid
        if uid not in self._groom_fingerprints:
            self._groom_fingerprints[uid] = lazy.bridge("playback").groom_fingerprint(curves)
        of_groom, of_settings, *_ = (*reader.fingerprint.split("-"), "", "")  # a third part is of the scene
        if of_groom and of_groom != self._groom_fingerprints[uid]:
            return STALE, "The groom was changed after this simulation: simulate again"
        if of_settings and of_settings != _settings_fingerprint():
            return STALE, "Settings were changed after this simulation: simulate again"
        scene = bpy.context.scene
        fps = scene.render.fps / scene.render.fps_base
        if abs(reader.fps - fps) > 1e-3 * fps:
            return STALE, f"Simulated for {reader.fps:g} frames a second, the scene has {fps:g}: simulate again"
        planned = reader.header.n_planned
        if reader.n_frames < planned:
            return STALE, f"{reader.n_frames} of {planned} frames are simulated: resume, or simulate again"
        return PLAYING, f"Plays frames {reader.frame_start} to {reader.frame_end}"

    def drop(self, curves: bpy.types.Curves) -> None:
        """Close the files of one groom and forget what was known of it."""
        uid = curves.session_uid
        player = self._players.pop(uid, None)
        if player is not None:
            player.close()
        self._may_be_edited.discard(uid)
        self._groom_fingerprints.pop(uid, None)
        self._problems.pop(uid, None)

    def on_update(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Note which Curves may have been edited."""
        if self._players:
            for update in depsgraph.updates:
                if isinstance(update.id, bpy.types.Curves) and update.is_updated_geometry:
                    uid = update.id.original.session_uid
                    self._may_be_edited.add(uid)
                    self._groom_fingerprints.pop(uid, None)

    def on_other_past(self) -> None:
        """Another file, undo or redo: positions and links may be others."""
        self._problems.clear()
        self._may_be_edited.clear()
        self._groom_fingerprints.clear()
        for curves in _linked():
            try:
                self._ready_player(curves).learn(curves, frame_of(bpy.context.scene))
            except HairloomError as error:
                self._fail(curves, error, None)

    def close_all(self) -> None:
        for player in self._players.values():
            player.close()
        self._players.clear()
        self._problems.clear()
        self._may_be_edited.clear()
        self._groom_fingerprints.clear()


players = Players()


def close(path: Path) -> None:
    """Let go of the files of one cache folder, so that it can be moved or deleted."""
    for curves in _linked():
        if _folder(curves) == path:
            players.drop(curves)


# --- a file that gets a place, or another one ----------------------------------------------------------------------


def _is_temporary(path: Path) -> bool:
    return Path(bpy.app.tempdir).resolve() in path.resolve().parents


def _move_beside(path: Path, curves: bpy.types.Curves, blend: str) -> Path:
    """Move a cache out of Blender's temporary folder, which does not outlive it, to beside the .blend file."""
    base = Path(os.path.dirname(blend), "hairloom_cache", Path(blend).stem, bpy.path.clean_name(curves.name))
    number = 1
    while (target := base / str(number)).exists():
        number += 1
    close(path)
    try:
        base.mkdir(parents=True, exist_ok=True)
        shutil.move(path, target)
    except OSError as error:
        sys.stderr.write(f"Hairloom: cannot move the cache {path} to {target}: {error}; it is lost with Blender\n")
        return path
    return target


def _relink(blend: str, *, move: bool) -> None:
    """Write links relative to a .blend file."""
    moved: dict[Path, Path] = {}
    for curves in _linked():
        path = _folder(curves)
        if curves.library is not None or path is None:
            continue
        if move and path not in moved and _is_temporary(path) and path.is_dir():
            moved[path] = _move_beside(path, curves, blend)
        text = _link_text(moved.get(path, path), blend)
        if curves[LINK] != text:
            curves[LINK] = text


@bpy.app.handlers.persistent
def _on_frame(scene: bpy.types.Scene, *_: object) -> None:
    players.play_scene(scene)


@bpy.app.handlers.persistent
def _on_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    players.on_update(depsgraph)


@bpy.app.handlers.persistent
def _on_other_past(*_: object) -> None:
    players.on_other_past()


@bpy.app.handlers.persistent
def _on_load(*_: object) -> None:
    players.close_all()
    players.on_other_past()


@bpy.app.handlers.persistent
def _before_save(filepath: str, *_: object) -> None:
    if filepath:
        _relink(filepath, move=True)


@bpy.app.handlers.persistent
def _after_save(*_: object) -> None:
    # after Save Copy the file of this session is still the one before
    _relink(bpy.data.filepath, move=False)


_HANDLERS = {
    "frame_change_pre": _on_frame,
    "depsgraph_update_post": _on_update,
    "undo_post": _on_other_past,
    "redo_post": _on_other_past,
    "load_post": _on_load,
    "save_pre": _before_save,
    "save_post": _after_save,
    "save_post_fail": _after_save,
}


def register() -> None:
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    players.close_all()
