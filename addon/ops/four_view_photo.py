"""Small operators on one photo of the wizard: choose it, remove it, put its camera back, swap it with another."""

from __future__ import annotations

import bpy

from .. import fourview, lazy, scene
from ..backend.errors import require
from ..jobs import reports_errors


class HAIRLOOM_OT_four_view_remove_image(bpy.types.Operator):
    """Remove the active photo with its mask, scribbles and camera"""

    bl_idname = "hairloom.four_view_remove_image"
    bl_label = "Remove Photo"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_no_object_mode(context) or fourview.why_no_photo(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        found, photo = fourview.project(context), fourview.active_photo(context)
        images = [image for image in (photo.image, photo.mask) if image is not None]
        if photo.plane is not None:
            bpy.data.objects.remove(photo.plane)
        found.photos.remove(found.active)
        found.active = max(min(found.active, len(found.photos) - 1), 0)
        for image in images:
            if image.users == 0:
                bpy.data.images.remove(image)
        return {"FINISHED"}


class HAIRLOOM_OT_four_view_choose(bpy.types.Operator):
    """Work on this photo, and look through its camera"""

    bl_idname = "hairloom.four_view_choose"
    bl_label = "Choose Photo"
    bl_options = {"REGISTER", "UNDO"}

    index: bpy.props.IntProperty(name="Photo", description="Number of the photo, from 0", min=0)
    look: bpy.props.BoolProperty(
        name="Look Through", description="Turn the 3D view to the photo's camera", default=True
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, fourview.why_no_photo(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        found = fourview.project(context)
        require(self.index < len(found.photos), f"there is no photo {self.index}; the last is {len(found.photos) - 1}")
        found.active = self.index
        plane = fourview.active_photo(context).plane
        if plane is not None and plane.name in context.view_layer.objects and context.mode == "OBJECT":
            scene.select_only(context, plane)
        if self.look and context.region_data is not None:
            fourview.look_through(context)
        return {"FINISHED"}


class HAIRLOOM_OT_four_view_look(bpy.types.Operator):
    """Turn the 3D view to the camera of the active photo"""

    bl_idname = "hairloom.four_view_look"
    bl_label = "Look Through"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        missing = fourview.why_no_photo(context)
        if not missing and context.region_data is None:
            missing = "Use this in a 3D view"
        return scene.allowed(cls, missing)

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        fourview.look_through(context)
        return {"FINISHED"}


class PhotoEdit:
    """Mixin: an operator that changes the active photo, and needs it whole."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_no_object_mode(context) or fourview.why_no_image(context))


class HAIRLOOM_OT_four_view_reset_camera(PhotoEdit, bpy.types.Operator):
    """Put the camera of the active photo back to where its view is usually taken from"""

    bl_idname = "hairloom.four_view_reset_camera"
    bl_label = "Reset Camera"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        photo = fourview.active_photo(context)
        photo.plane.matrix_world = lazy.bridge("camera").standard_matrix(photo.view, fourview.head_of(context))
        return {"FINISHED"}


class HAIRLOOM_OT_four_view_swap(bpy.types.Operator):
    """Swap the active photo with that of another view: pictures and masks change places, cameras stay"""

    bl_idname = "hairloom.four_view_swap"
    bl_label = "Swap with"
    bl_options = {"REGISTER", "UNDO"}

    index: bpy.props.IntProperty(name="Photo", description="Number of the other photo, from 0", min=0)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        missing = scene.why_no_object_mode(context) or fourview.why_no_image(context)
        if not missing and len(fourview.project(context).photos) < 2:
            missing = "There is one photo alone"
        return scene.allowed(cls, missing)

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        found = fourview.project(context)
        require(self.index < len(found.photos), f"there is no photo {self.index}; the last is {len(found.photos) - 1}")
        require(self.index != found.active, "a photo cannot be swapped with itself; choose another")
        fourview.swap(found.photos[found.active], found.photos[self.index])
        return {"FINISHED"}


class HAIRLOOM_OT_four_view_mirror(PhotoEdit, bpy.types.Operator):
    """Mirror the active photo with its mask and marks, left to right: for a picture taken in a mirror"""

    bl_idname = "hairloom.four_view_mirror"
    bl_label = "Mirror Photo"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        lazy.bridge("image").mirror(fourview.active_photo(context), fourview.active_name(context))
        return {"FINISHED"}


CLASSES = (
    HAIRLOOM_OT_four_view_remove_image, HAIRLOOM_OT_four_view_choose, HAIRLOOM_OT_four_view_look,
    HAIRLOOM_OT_four_view_reset_camera, HAIRLOOM_OT_four_view_swap, HAIRLOOM_OT_four_view_mirror,
)  # fmt: skip
