"""Make the strokes of a file again on the active groom."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper

from .. import lazy, recording, scene
from ..jobs import reports_errors
from .comb import obstacles, why_no_comb


class HAIRLOOM_OT_play_strokes(bpy.types.Operator, ImportHelper):
    """Comb the active groom by the strokes of a file, which were recorded on this groom"""

    bl_idname = "hairloom.play_strokes"
    bl_label = "Play Strokes"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ".json"
    filter_glob: bpy.props.StringProperty(default="*.json", options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, why_no_comb(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        groom, path = scene.active_groom(context), Path(self.filepath)
        data = groom.data
        file = lazy.backend("editing.strokes").read_strokes(path)
        file.check(len(data.curves), len(data.points), path.name)
        made = lazy.bridge("comb").play_strokes(groom, file.strokes, obstacles(context))
        if not made:
            self.report({"WARNING"}, f"No stroke of {path.name} touches the hair; is it in the place where it was?")
            return {"CANCELLED"}
        if scene.settings(context).comb.record:
            for stroke in made:
                recording.add(data, stroke)
        self.report({"INFO"}, f"Made {len(made):,} of {len(file.strokes):,} strokes of {path.name}")
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_play_strokes,)
