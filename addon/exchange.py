"""Files in and out of Blender: unit options, and Alembic and USD by Blender's own importers and exporters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from . import lazy, scene
from .backend.errors import FileError, require

FILE_GLOB = "*.hair;*.data;*.tfx;*.ply;*.obj;*.npz;*.abc;*.usd;*.usda;*.usdc;*.usdz"
SCENE_SUFFIXES = {".abc": "Alembic", ".usd": "USD", ".usda": "USD", ".usdc": "USD", ".usdz": "USD"}

_UNITS = (
    ("AUTO", "As the Format", "The unit that files of this format usually have", 0),
    ("m", "Metres", "One unit of the file is a metre", 1),
    ("dm", "Decimetres", "One unit of the file is 10 cm", 2),
    ("cm", "Centimetres", "One unit of the file is a centimetre", 3),
    ("mm", "Millimetres", "One unit of the file is a millimetre", 4),
    ("in", "Inches", "One unit of the file is 2.54 cm", 5),
    ("CUSTOM", "Custom", "Give the length of one unit of the file", 6),
)
_METRES = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "in": 0.0254}
_AXES = tuple(
    (axis, axis, f"The file's {axis} axis", i + 1) for i, axis in enumerate(("X", "Y", "Z", "-X", "-Y", "-Z"))
)


class FileUnits:
    """Mixin: unit and axes of a strand file as operator settings."""

    unit: bpy.props.EnumProperty(
        name="Unit", description="Length of one unit of the file. Alembic and USD know their own", items=_UNITS,
        default="AUTO",
    )  # fmt: skip
    custom_unit: bpy.props.FloatProperty(
        name="Metres per Unit", description="Length of one unit of the file, in metres", default=1.0, min=1e-6,
        soft_min=0.001, soft_max=1.0, precision=4,
    )  # fmt: skip
    up_axis: bpy.props.EnumProperty(
        name="Up", description="The file's axis that points up",
        items=(("AUTO", "As the Format", "The axis that files of this format usually have", 0), *_AXES), default="AUTO",
    )  # fmt: skip
    forward_axis: bpy.props.EnumProperty(
        name="Face Looks Along", description="The file's axis that the face looks along",
        items=(("AUTO", "Usual", "Z where Y points up, -Y where Z points up", 0), *_AXES), default="AUTO",
    )  # fmt: skip

    def units(self, path: Path) -> Any:
        """The chosen `Units` for `path`.

        Raises
        ------
        FileError : unknown format. InputError : up and forward are the same axis.
        """
        module = lazy.backend("io.strands")
        usual = module.default_units(path)
        scale = {**_METRES, "AUTO": usual.scale_to_metres, "CUSTOM": self.custom_unit}[self.unit]
        up = usual.up if self.up_axis == "AUTO" else self.up_axis
        forward = self.forward_axis
        if forward == "AUTO":
            forward = usual.forward if self.up_axis == "AUTO" else ""
        return module.Units(scale, up, forward)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column()
        column.prop(self, "unit")
        if self.unit == "CUSTOM":
            column.prop(self, "custom_unit")
        column.prop(self, "up_axis")
        column.prop(self, "forward_axis")
        if hasattr(self, "attach"):
            layout.prop(self, "attach")


def is_built_with(name: str) -> bool:
    """Does this Blender have 'Alembic' or 'USD'? Not all builds of Linux distributions do."""
    return bool(getattr(bpy.app.build_options, name.lower()))


def require_support(path: Path) -> str:
    """'Alembic' or 'USD'.

    Raises
    ------
    InputError : this Blender was built without it.
    """
    name = SCENE_SUFFIXES[path.suffix.lower()]
    remedy = "use .npz, .hair, .tfx or .ply, or Blender from blender.org"
    require(is_built_with(name), f"this Blender was built without {name}; {remedy}")
    return name


def import_scene_file(context: bpy.types.Context, path: Path) -> list[bpy.types.Object]:
    """The Curves objects of an .abc or .usd file; whatever else it holds is removed again.

    Raises
    ------
    InputError : Blender without support. FileError : unreadable, or no curves in it.
    """
    name = require_support(path)
    if not path.is_file():
        raise FileError(f"cannot read {path}: no such file")
    before = set(bpy.data.objects)
    try:
        if name == "Alembic":
            bpy.ops.wm.alembic_import(filepath=str(path), as_background_job=False, always_add_cache_reader=False)
        else:
            bpy.ops.wm.usd_import(filepath=str(path))
    except RuntimeError as error:
        raise FileError(f"cannot read {path}: {str(error).strip().splitlines()[-1]}") from error
    added = [obj for obj in bpy.data.objects if obj not in before]
    grooms = [obj for obj in added if obj.type == "CURVES" and len(obj.data.curves)]
    if not grooms:
        bpy.data.batch_remove(added)
        raise FileError(f"{path} holds no hair curves; export the hair as curves")
    for groom in grooms:
        world = groom.matrix_world.copy()
        groom.parent = None
        groom.matrix_world = world
    bpy.data.batch_remove([obj for obj in added if obj not in grooms])
    return grooms


def export_scene_file(context: bpy.types.Context, groom: bpy.types.Object, path: Path) -> None:
    """Write one groom to .abc or .usd; the file appears whole or not at all.

    Raises
    ------
    InputError : Blender without support. FileError : it cannot be written.
    """
    name = require_support(path)
    selected = list(context.selected_objects)
    partial = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        scene.select_only(context, groom)
        if name == "Alembic":
            frame = context.scene.frame_current
            bpy.ops.wm.alembic_export(
                filepath=str(partial), selected=True, start=frame, end=frame, as_background_job=False
            )
        else:
            bpy.ops.wm.usd_export(filepath=str(partial), selected_objects_only=True, export_animation=False)
        partial.replace(path)
    except (RuntimeError, OSError) as error:
        raise FileError(f"cannot write {path}: {str(error).strip().splitlines()[-1]}; choose another place") from error
    finally:
        partial.unlink(missing_ok=True)
        for obj in selected:
            obj.select_set(True)
