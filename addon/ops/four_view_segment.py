"""Find where there is hair in the photos: from scribbles, without any, or from a file."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper

from .. import fourview, lazy, scene
from ..jobs import JobOperator, Values, reports_errors


class HAIRLOOM_OT_four_view_segment(JobOperator, bpy.types.Operator):
    """Find the hair in the active photo from its scribbles; without any, guess where it is"""

    bl_idname = "hairloom.four_view_segment"
    bl_label = "Segment"
    bl_options = {"UNDO"}
    job = "four_view_segment"

    anew: bpy.props.BoolProperty(
        name="Anew", description="From the photo and its scribbles alone, whatever the mask is", options={"SKIP_SAVE"}
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, fourview.why_no_segment(context))

    def sources(self, context: bpy.types.Context) -> dict[str, bpy.types.Object]:
        return {fourview.active_name(context): fourview.active_photo(context).plane}

    def read(self, sources: dict[str, bpy.types.Object]) -> Values:
        photo = fourview.photo_of_plane(bpy.context, next(iter(sources.values())))
        return lazy.bridge("image").segment_inputs(photo, guess=self.anew or not photo.scribbles)

    def watched(self, sources: dict[str, bpy.types.Object], inputs: Values | None = None) -> Values:
        photo = fourview.photo_of_plane(bpy.context, next(iter(sources.values())))
        return {"photo": [photo.image_stamp, photo.mask_stamp, photo.scribbles] if photo is not None else []}

    def apply(self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values) -> str:
        name, plane = next(iter(sources.items()))
        lazy.bridge("image").set_mask(fourview.photo_of_plane(context, plane), name, outputs["mask"])
        return f"{name.capitalize()}: {outputs['mask'].mean():.0%} of the photo are hair"


class HAIRLOOM_OT_four_view_guess_masks(bpy.types.Operator):
    """Guess where the hair is in all photos that have no mask yet; scribbles correct it"""

    bl_idname = "hairloom.four_view_guess_masks"
    bl_label = "Guess Masks"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        missing = fourview.why_no_segment(context)
        if not missing and all(photo.mask is not None for photo in fourview.project(context).photos):
            missing = "All photos have a mask"
        return scene.allowed(cls, missing)

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        images, count = lazy.bridge("image"), 0
        for name, photo in fourview.named_photos(context).items():
            if photo.mask is None:
                found = lazy.backend("registry").run_job(
                    "four_view_segment", images.segment_inputs(photo, guess=True), {}
                )
                images.set_mask(photo, name, found["mask"])
                count += 1
        self.report({"INFO"}, f"{count} masks guessed: look at each, and correct it with scribbles")
        return {"FINISHED"}


class HAIRLOOM_OT_four_view_load_mask(bpy.types.Operator, ImportHelper):
    """Take the mask of the active photo from a file: white, or opaque, is hair"""

    bl_idname = "hairloom.four_view_load_mask"
    bl_label = "Load Mask"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ""
    filter_glob: bpy.props.StringProperty(default="*.png;*.jpg;*.jpeg;*.bmp", options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_no_object_mode(context) or fourview.why_no_image(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        photo, name = fourview.active_photo(context), fourview.active_name(context)
        images = lazy.bridge("image")
        images.set_mask(photo, name, images.load_mask(Path(self.filepath), tuple(photo.image.size)), by_hand=True)
        return {"FINISHED"}


class HAIRLOOM_OT_four_view_clear_scribbles(bpy.types.Operator):
    """Remove all scribbles of the active photo; its mask stays"""

    bl_idname = "hairloom.four_view_clear_scribbles"
    bl_label = "Clear Scribbles"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        missing = fourview.why_no_photo(context)
        if not missing and not fourview.active_photo(context).scribbles:
            missing = "The photo has no scribbles"
        return scene.allowed(cls, missing)

    def execute(self, context: bpy.types.Context) -> set[str]:
        fourview.active_photo(context).scribbles = ""
        return {"FINISHED"}


CLASSES = (
    HAIRLOOM_OT_four_view_segment, HAIRLOOM_OT_four_view_guess_masks, HAIRLOOM_OT_four_view_load_mask,
    HAIRLOOM_OT_four_view_clear_scribbles,
)  # fmt: skip
