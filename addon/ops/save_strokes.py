"""Save the recorded strokes of the active groom to a file, or forget them."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper

from .. import lazy, recording, scene
from ..jobs import reports_errors


def _why_no_strokes(context: bpy.types.Context) -> str:
    missing = scene.why_no_groom(context)
    if not missing and not recording.strokes(scene.active_groom(context).data):
        missing = "No strokes are recorded: turn Record on, then comb"
    return missing


class HAIRLOOM_OT_save_strokes(bpy.types.Operator, ExportHelper):
    """Save the recorded strokes of the active groom to a file, to be played here or by the command line"""

    bl_idname = "hairloom.save_strokes"
    bl_label = "Save Strokes"

    filename_ext = ".json"
    filter_glob: bpy.props.StringProperty(default="*.json", options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, _why_no_strokes(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        backend, path = lazy.backend("editing.strokes"), Path(self.filepath)
        data = scene.active_groom(context).data
        strokes = tuple(backend.stroke_from_json(line) for line in recording.strokes(data))
        backend.write_strokes(path, backend.StrokeFile(*recording.size(data), strokes))
        self.report({"INFO"}, f"Saved {len(strokes):,} strokes to {path.name}")
        return {"FINISHED"}


class HAIRLOOM_OT_clear_strokes(bpy.types.Operator):
    """Forget the recorded strokes of the active groom; the hair stays as it is"""

    bl_idname = "hairloom.clear_strokes"
    bl_label = "Clear Strokes"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, _why_no_strokes(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        recording.clear(scene.active_groom(context).data)
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_save_strokes, HAIRLOOM_OT_clear_strokes)
