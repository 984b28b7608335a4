"""Bake the simulation of the active groom to an Alembic file."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper

from .. import bake, lazy, scene
from ..jobs import reports_errors


class HAIRLOOM_OT_bake_alembic(bpy.types.Operator, ExportHelper):
    """Write all simulated frames of the active groom to an Alembic file, for other programs"""

    bl_idname = "hairloom.bake_alembic"
    bl_label = "Bake to Alembic"

    filename_ext = ".abc"
    filter_glob: bpy.props.StringProperty(default="*.abc", options={"HIDDEN"})
    space: bpy.props.EnumProperty(name="Space", items=bake.SPACES, description="What the positions are relative to")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, bake.why_no_bake(context))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.filepath = self.filepath or bake.default_path(context, self.filename_ext)
        return super().invoke(context, event)

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        path, groom = Path(self.filepath), scene.active_groom(context)
        with bake.progress_shown(context) as report:
            lazy.bridge("bake").bake_alembic(context, groom, path, self.space, report)
        self.report({"INFO"}, f"Baked {groom.name} to {path.name}")
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_bake_alembic,)
