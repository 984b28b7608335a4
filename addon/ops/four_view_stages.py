"""The heavy steps of the wizard: shape, texture, directions, strands; each is a job on the result of the one before."""

from __future__ import annotations

import bpy

from .. import fourview, lazy, scene
from ..jobs import JobOperator, Values


class StageJob(JobOperator):
    """What the steps share; `stage` is one of `fourview.STAGES`."""

    stage = ""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, fourview.why_no_stage(context, cls.stage))

    def sources(self, context: bpy.types.Context) -> dict[str, bpy.types.Object]:
        planes = {name: photo.plane for name, photo in fourview.named_photos(context).items()}
        return {**planes, "head": fourview.head_of(context)}

    def read(self, sources: dict[str, bpy.types.Object]) -> Values:
        return lazy.bridge("fourview").stage_inputs(bpy.context, self.stage)

    def params(self, context: bpy.types.Context) -> Values:
        return scene.settings(context).four_view.to_params()

    def watched(self, sources: dict[str, bpy.types.Object], inputs: Values | None = None) -> Values:
        return fourview.inputs_of(bpy.context, self.stage)

    def apply(self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values) -> str:
        return lazy.bridge("fourview").apply_stage(context, self.stage, outputs)


class HAIRLOOM_OT_four_view_shape(StageJob, bpy.types.Operator):
    """Find the shape of the hair as a whole: the most similar hairstyle of the database, bent to the masks"""

    bl_idname = "hairloom.four_view_shape"
    bl_label = "Find Shape"
    bl_options = {"UNDO"}
    job, stage = "four_view_shape", "shape"


class HAIRLOOM_OT_four_view_texture(StageJob, bpy.types.Operator):
    """Put the photos together to one picture of the hair all around; what no photo shows is made to fit"""

    bl_idname = "hairloom.four_view_texture"
    bl_label = "Make Texture"
    bl_options = {"UNDO"}
    job, stage = "four_view_texture", "texture"


class HAIRLOOM_OT_four_view_directions(StageJob, bpy.types.Operator):
    """Find which way the hair grows from its texture and the strokes"""

    bl_idname = "hairloom.four_view_directions"
    bl_label = "Find Directions"
    bl_options = {"UNDO"}
    job, stage = "four_view_directions", "directions"


class HAIRLOOM_OT_four_view_strands(StageJob, bpy.types.Operator):
    """Grow the strands on the head, with the colors of the photos"""

    bl_idname = "hairloom.four_view_strands"
    bl_label = "Grow Strands"
    bl_options = {"UNDO"}
    job, stage = "four_view_strands", "strands"


CLASSES = (
    HAIRLOOM_OT_four_view_shape, HAIRLOOM_OT_four_view_texture, HAIRLOOM_OT_four_view_directions,
    HAIRLOOM_OT_four_view_strands,
)  # fmt: skip
