"""Export the active groom to a strand file."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper

from .. import exchange, lazy, scene
from ..jobs import reports_errors


class HAIRLOOM_OT_export_groom(exchange.FileUnits, bpy.types.Operator, ExportHelper):
    """Export the strands of the active groom; the ending of the file name chooses the format"""

    bl_idname = "hairloom.export_groom"
    bl_label = "Export Groom"

    filename_ext = ".npz"
    check_extension = None  # whatever the user types: the ending is the format
    filter_glob: bpy.props.StringProperty(default=exchange.FILE_GLOB, options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_no_object_mode(context) or scene.why_no_groom(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        path = Path(self.filepath)
        groom = scene.active_groom(context)
        if path.suffix.lower() in exchange.SCENE_SUFFIXES:
            exchange.export_scene_file(context, groom, path)
        else:
            strands = lazy.bridge("curves").read_strands(groom)
            lazy.backend("io.strands").write_strands(path, strands, units=self.units(path))
        self.report({"INFO"}, f"Exported {len(groom.data.curves):,} strands to {path.name}")
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_export_groom,)
