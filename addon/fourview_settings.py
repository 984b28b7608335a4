"""What the four-view wizard keeps in the file: the photos with their masks and cameras, the state of its steps, and
where its results are. `fourview.py` has what is done with it.

A photo's plane is an image empty; its matrix is the photo's camera, so moving the plane moves the camera.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

VIEWS = (
    ("front", "Front", "The face is seen"),
    ("back", "Back", "The back of the head is seen"),
    ("left", "Left", "The person's left side is seen; the face points to the left of the picture"),
    ("right", "Right", "The person's right side is seen; the face points to the right of the picture"),
    ("top", "Top", "The head is seen from above, the face at the bottom of the picture"),
    ("other", "Other", "Any other side; place its camera by hand"),
)
STEPS = (
    ("IMAGES", "Images", "Choose one to eight photos of the hair", "IMAGE_DATA", 0),
    ("SEGMENT", "Segment", "Mark in each photo where there is hair", "MOD_MASK", 1),
    ("CAMERAS", "Cameras", "Lay the photos over the head", "CAMERA_DATA", 2),
    ("SHAPE", "Shape", "Find the shape of the hair as a whole", "MESH_ICOSPHERE", 3),
    ("TEXTURE", "Texture", "Make one picture of the hair all around", "TEXTURE", 4),
    ("DIRECTIONS", "Directions", "Find which way the hair grows", "CURVE_PATH", 5),
    ("STRANDS", "Strands", "Grow the strands", "STRANDS", 6),
)


def _show_again(self: Any, context: bpy.types.Context) -> None:
    # late, since `fourview` imports this module
    from . import fourview

    fourview.show_photos(context)


class FourViewPhoto(bpy.types.PropertyGroup):
    """One photo of the hair"""

    view: EnumProperty(name="View", description="From where the photo was taken", items=VIEWS)
    image: PointerProperty(name="Photo", description="The photo, packed into the file", type=bpy.types.Image)
    mask: PointerProperty(
        name="Mask", description="Where there is hair: white; packed into the file", type=bpy.types.Image
    )
    plane: PointerProperty(
        name="Plane", description="The photo in the scene; its place is the camera of the photo", type=bpy.types.Object
    )
    # of the pixels, so that nobody need read them to know whether they are the same
    image_stamp: StringProperty(name="Photo's Pixels", description="Tells one photo from another")
    mask_stamp: StringProperty(name="Mask's Pixels", description="Tells one mask from another")
    mask_by_hand: BoolProperty(
        name="Mask by Hand", description="The mask was painted, pulled or loaded, so that no step makes it by itself"
    )
    scribbles: StringProperty(name="Scribbles", description="What was marked on the photo, JSON in pixels")
    landmarks: StringProperty(name="Landmarks", description="Places on the face that were clicked, JSON in pixels")
    is_perspective: BoolProperty(
        name="Perspective", description="The photo was taken from near by, so that what is nearer looks larger",
    )  # fmt: skip
    distance: FloatProperty(
        name="Distance", default=1.5, min=0.2, soft_max=5.0, max=1000.0, unit="LENGTH",
        description="How far the camera was from the head, for a photo with perspective",
    )  # fmt: skip


class FourViewStage(bpy.types.PropertyGroup):
    """What is known of the last result of a step"""

    key: StringProperty(name="Key", description="Names the result's file; empty before the first result")
    inputs: StringProperty(name="Made From", description="What the result was made from, JSON")
    report: StringProperty(name="Report", description="What the step said, a remark a line")


class FourViewProject(bpy.types.PropertyGroup):
    """The photos of a hairstyle, and how far the work on them has come"""

    step: EnumProperty(name="Step", description="Step of the work", items=STEPS, update=_show_again)
    photos: CollectionProperty(type=FourViewPhoto)
    active: IntProperty(name="Active Photo", description="The photo that is worked on", min=0, update=_show_again)
    shown: EnumProperty(
        name="Show", description="Which photos are shown in the scene", default="ACTIVE", update=_show_again,
        items=(
            ("NONE", "None", "No photo"),
            ("ACTIVE", "Active", "The active photo"),
            ("ALL", "All", "All photos around the head"),
        ),
    )  # fmt: skip
    opacity: FloatProperty(
        name="Opacity", default=1.0, min=0.0, max=1.0, subtype="FACTOR", update=_show_again,
        description="How opaque the photos are shown",
    )  # fmt: skip
    show_mask: BoolProperty(name="Mask's Outline", description="Show the border of the hair in the photo", default=True)
    show_silhouette: BoolProperty(
        name="Result's Outline", default=True,
        description="Show the border of the hair that was made, or of its shape, as the photo's camera sees it",
    )  # fmt: skip
    brush_size: IntProperty(
        name="Brush", default=12, min=1, soft_max=100, max=1000, subtype="PIXEL",
        description="Width of the brush for scribbles and masks, in pixels of the photo",
    )  # fmt: skip
    brush_paints: EnumProperty(
        name="Brush Paints", description="What the brush changes",
        items=(
            ("SCRIBBLES", "Scribbles", "Mark some of the hair and of the rest; Segment finds the border"),
            ("MASK", "Mask", "Paint the mask itself, to mend its border"),
        ),
    )  # fmt: skip
    border_size: IntProperty(
        name="Reach", default=60, min=2, soft_max=400, max=4000, subtype="PIXEL",
        description="How wide the circle is in which a drag moves the mask's border, in pixels of the photo",
    )  # fmt: skip
    strokes: StringProperty(name="Strokes", description="Strokes along the hair from root to tip, JSON in pixels")
    remarks: StringProperty(name="Remarks", description="What was noticed while the cameras were placed")
    shape: PointerProperty(type=FourViewStage)
    texture: PointerProperty(type=FourViewStage)
    directions: PointerProperty(type=FourViewStage)
    strands: PointerProperty(type=FourViewStage)
    closed_object: PointerProperty(type=bpy.types.Object, name="Closed Shape", description="The hair as a solid")
    open_object: PointerProperty(type=bpy.types.Object, name="Shape", description="The outside of the hair")
    lines_object: PointerProperty(type=bpy.types.Object, name="Lines", description="Which way the hair grows")
    hair_object: PointerProperty(type=bpy.types.Object, name="Hair", description="The strands")


_CLASSES = (FourViewPhoto, FourViewStage, FourViewProject)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.hairloom_four_view = PointerProperty(type=FourViewProject)


def unregister() -> None:
    del bpy.types.Scene.hairloom_four_view
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
