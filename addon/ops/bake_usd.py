"""Bake the simulation of the active groom to a USD file."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper

from .. import bake, lazy, scene
from ..jobs import reports_errors


class HAIRLOOM_OT_bake_usd(bpy.types.Operator, ExportHelper):
    """Write all simulated frames of the active groom to a USD file, for other programs"""

    bl_idname = "hairloom.bake_usd"
    bl_label = "Bake to USD"

    filename_ext = ".usdc"
    check_extension = None  # .usd and .usda are as good
    filter_glob: bpy.props.StringProperty(default="*.usd;*.usda;*.usdc", options={"HIDDEN"})
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
        if path.suffix.lower() not in (".usd", ".usda", ".usdc"):
            path = path.with_name(path.name + self.filename_ext)
        with bake.progress_shown(context) as report:
            lazy.bridge("bake").bake_usd(context, groom, path, self.space, report)
        self.report({"INFO"}, f"Baked {groom.name} to {path.name}")
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_bake_usd,)
