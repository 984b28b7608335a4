"""The wizard's steps forward and back, and its project as a file for the command line."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper

from .. import fourview, lazy, scene
from ..jobs import reports_errors


class HAIRLOOM_OT_four_view_step(bpy.types.Operator):
    """Go to the next step of the wizard, or back; nothing that was made is lost"""

    bl_idname = "hairloom.four_view_step"
    bl_label = "Step"
    bl_options = {"REGISTER", "UNDO"}

    by: bpy.props.IntProperty(name="By", description="Steps forward; below 0 back", default=1)

    def execute(self, context: bpy.types.Context) -> set[str]:
        found = fourview.project(context)
        found.step = fourview.step_name(fourview.step_number(found.step) + self.by)
        return {"FINISHED"}


class HAIRLOOM_OT_four_view_write_project(bpy.types.Operator, ExportHelper):
    """Write photos, masks, cameras, strokes and settings as a project for `hairloom four-view PROJECT.toml OUT`"""

    bl_idname = "hairloom.four_view_write_project"
    bl_label = "Write Project"

    filename_ext = ".toml"
    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, fourview.why_no_cameras(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        written = lazy.bridge("fourview").write_project(context, Path(self.filepath))
        self.report({"INFO"}, f"{Path(self.filepath).name} and {len(written)} files beside it written")
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_four_view_step, HAIRLOOM_OT_four_view_write_project)
