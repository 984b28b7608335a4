"""Free the simulation cache of the active groom, or play it again after an edit of the hair."""

from __future__ import annotations

import bpy

from .. import lazy, playback, scene
from ..jobs import reports_errors


def _why_no_cache(context: bpy.types.Context) -> str:
    missing = scene.why_busy(context) or scene.why_no_object_mode(context) or scene.why_no_groom(context)
    if not missing and playback.folder(scene.active_groom(context)) is None:
        missing = "The groom plays no simulation cache"
    return missing


class HAIRLOOM_OT_free_cache(bpy.types.Operator):
    """Delete the simulated frames of the active groom; the hair goes back to its shape before the simulation"""

    bl_idname = "hairloom.free_cache"
    bl_label = "Free Cache"
    bl_options = {"UNDO"}

    keep_shape: bpy.props.BoolProperty(
        name="Keep Shape", options={"SKIP_SAVE"},
        description="Keep the hair as it is now, edits included, as the groom's shape from now on",
    )  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, _why_no_cache(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        groom = scene.active_groom(context)
        folder = playback.folder(groom)
        playback.detach(groom, keep_shape=self.keep_shape)
        if any(playback.folder(obj) == folder for obj in bpy.data.objects):
            self.report({"INFO"}, "The cache is kept: another groom plays it")
        else:
            lazy.backend("io.sim_cache").delete_cache(folder)
            self.report({"INFO"}, f"Freed the cache {folder}")
        return {"FINISHED"}


class HAIRLOOM_OT_play_again(bpy.types.Operator):
    """Play the simulation again; edits of the hair that were made after it are dropped"""

    bl_idname = "hairloom.play_again"
    bl_label = "Play Again"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, _why_no_cache(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        playback.play_again(scene.active_groom(context))
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_free_cache, HAIRLOOM_OT_play_again)
