"""Export the active groom for Unreal: a groom with all its attributes, or a groom cache of its simulation."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper

from .. import bake, lazy, scene
from ..backend.errors import InputError
from ..jobs import reports_errors


class HAIRLOOM_OT_export_unreal(bpy.types.Operator, ExportHelper):
    """Export the active groom for Unreal, with guides, their weights, groups, root UVs, widths and colors"""

    bl_idname = "hairloom.export_unreal"
    bl_label = "Export for Unreal"

    filename_ext = ".abc"
    filter_glob: bpy.props.StringProperty(default="*.abc", options={"HIDDEN"})
    content: bpy.props.EnumProperty(
        name="Content", description="What the file holds",
        items=(
            ("GROOM", "Groom", "The groom at rest, to be imported as a groom asset"),
            ("CACHE", "Groom Cache", "The simulated frames of guides and strands, for the same groom asset"),
            ("GUIDES", "Guide Cache", "The simulated frames of the guides alone: small, Unreal moves the strands"),
        ),
    )  # fmt: skip
    axes: bpy.props.EnumProperty(
        name="Axes", description="Axes and unit of the file",
        items=(
            ("UNREAL", "Unreal", "Centimetres, Z up, left-handed: to be imported without any conversion"),
            ("Y_UP", "Y Up", "Metres, Y up, as other Alembic files: turn by 90 degrees and scale by 100 at the import"),
        ),
    )  # fmt: skip
    with_motion: bpy.props.BoolProperty(
        name="Motion of the Object", default=False,
        description="Keep the motion of the groom's object in a cache; in Unreal the character mostly brings it along",
    )  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, bake.why_no_export(context))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.filepath = self.filepath or bake.default_path(context, self.filename_ext)
        return super().invoke(context, event)

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        path, groom, is_cache = Path(self.filepath), scene.active_groom(context), self.content != "GROOM"
        missing = bake.why_no_bake(context) if is_cache else ""
        if missing:
            raise InputError(missing)
        with bake.progress_shown(context) as report:
            n_guides = lazy.bridge("bake").export_unreal(
                context,
                groom,
                path,
                is_cache=is_cache,
                guides_only=self.content == "GUIDES",
                with_motion=self.with_motion,
                is_y_up=self.axes == "Y_UP",
                report=report,
            )
        found = f"{n_guides:,} guides" if n_guides else "no guides: Unreal will make some"
        self.report({"INFO"}, f"Exported {len(groom.data.curves):,} strands to {path.name}, {found}")
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_export_unreal,)
