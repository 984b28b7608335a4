"""Import a groom from a strand file."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper

from .. import exchange, lazy, material, scene
from ..jobs import reports_errors


class HAIRLOOM_OT_import_groom(exchange.FileUnits, bpy.types.Operator, ImportHelper):
    """Import hair strands from a file as a Curves object"""

    bl_idname = "hairloom.import_groom"
    bl_label = "Import Groom"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ""
    filter_glob: bpy.props.StringProperty(default=exchange.FILE_GLOB, options={"HIDDEN"})
    attach: bpy.props.BoolProperty(
        name="Attach to Head",
        description="Attach the strands to the head chosen in the Head panel, if there is one; nothing moves",
        default=True,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_no_object_mode(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        path = Path(self.filepath)
        if path.suffix.lower() in exchange.SCENE_SUFFIXES:
            grooms = exchange.import_scene_file(context, path)
            dropped = 0
        else:
            strands, report = lazy.backend("io.strands").read_strands_report(path, units=self.units(path))
            dropped = report.dropped.n_empty + report.dropped.n_non_finite
            grooms = [lazy.bridge("curves").new_object(path.stem, strands, context.collection)]
        head = scene.head_for(context, None) if self.attach else None
        has_uv = head is not None and head.data.uv_layers.active is not None
        for groom in grooms:
            if not groom.data.materials:
                groom.data.materials.append(material.hair_material())
            if has_uv:
                lazy.bridge("attachment").attach_to_head(groom, head)
        scene.select_only(context, grooms[0])
        count = sum(len(groom.data.curves) for groom in grooms)
        aside = f"; {dropped} unusable strands were left out" if dropped else ""
        loose = f"; not attached, since '{head.name}' has no UV map: run Set Up Head" if head and not has_uv else ""
        self.report({"WARNING" if loose else "INFO"}, f"Imported {count:,} strands from {path.name}{aside}{loose}")
        return {"FINISHED"}


class HAIRLOOM_FH_groom(bpy.types.FileHandler):
    """Lets a groom be dropped from the file browser into the 3D view"""

    bl_idname = "HAIRLOOM_FH_groom"
    bl_label = "Hair Groom"
    bl_import_operator = "hairloom.import_groom"
    bl_export_operator = "hairloom.export_groom"
    bl_file_extensions = ".hair;.tfx;.data"

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return context.area is not None and context.area.type == "VIEW_3D"


CLASSES = (HAIRLOOM_OT_import_groom, HAIRLOOM_FH_groom)
