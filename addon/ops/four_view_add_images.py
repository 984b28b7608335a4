"""Add photos of the hair to the four-view wizard."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper

from .. import fourview, lazy, scene
from ..backend.errors import require
from ..jobs import reports_errors


class HAIRLOOM_OT_four_view_add_images(bpy.types.Operator, ImportHelper):
    """Add photos of the hair, one to eight in all. Names with front, back, left, right or top tell their view"""

    bl_idname = "hairloom.four_view_add_images"
    bl_label = "Add Photos"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ""
    filter_glob: bpy.props.StringProperty(default="*.png;*.jpg;*.jpeg;*.bmp", options={"HIDDEN"})
    files: bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, fourview.why_no_more_photos(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        paths = [Path(self.directory, file.name) for file in self.files if file.name] or [Path(self.filepath)]
        found = fourview.project(context)
        room = fourview.MAX_PHOTOS - len(found.photos)
        require(len(paths) <= room, f"{len(paths)} photos are too many: {room} more can be added")
        images = lazy.bridge("image")
        # every file is read before the scene is changed
        pictures = [images.read_photo(path) for path in paths]
        for path, pixels in zip(paths, pictures):
            self._add(context, path, images.new_image(path.stem, pixels), images.stamp(pixels))
        found.active = len(found.photos) - len(paths)
        fourview.show_photos(context)
        self.report({"INFO"}, f"{len(paths)} photos added")
        return {"FINISHED"}

    def _add(self, context: bpy.types.Context, path: Path, image: bpy.types.Image, stamp: str) -> None:
        found = fourview.project(context)
        view = fourview.guess_view(path.name, {photo.view for photo in found.photos})
        cameras = lazy.bridge("camera")
        matrix = cameras.standard_matrix(view, fourview.head_of(context))
        photo = found.photos.add()
        photo.view, photo.image, photo.image_stamp = view, image, stamp
        photo.plane = cameras.new_plane(f"{view.capitalize()} Photo", image, matrix, fourview.collection(context))


CLASSES = (HAIRLOOM_OT_four_view_add_images,)
