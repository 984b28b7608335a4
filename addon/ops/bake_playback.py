"""Bake the simulation of the active groom so that the .blend file plays it in any Blender, without the add-on."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper

from .. import bake, exchange, lazy, playback, scene
from ..jobs import reports_errors


class HAIRLOOM_OT_bake_playback(bpy.types.Operator, ExportHelper):
    """Let Blender itself play the simulation of the active groom, from an Alembic file and without this add-on"""

    bl_idname = "hairloom.bake_playback"
    bl_label = "Bake Playback"
    bl_options = {"UNDO"}

    filename_ext = ".abc"
    filter_glob: bpy.props.StringProperty(default="*.abc", options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, bake.why_no_bake(context))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.filepath = self.filepath or bake.default_path(context, self.filename_ext)
        return super().invoke(context, event)

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        path, groom = Path(self.filepath).absolute(), scene.active_groom(context)
        exchange.require_support(path)
        bridge, folder = lazy.bridge("bake"), playback.folder(groom)
        with bake.progress_shown(context) as report:
            prim = bridge.bake_alembic(context, groom, path, "OBJECT", report)
        bridge.play_file(groom, path, prim, playback.BAKED)
        playback.detach(groom)
        self.report({"INFO"}, f"Blender plays {path.name} by itself now; the cache {folder} is not used any more")
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_bake_playback,)
