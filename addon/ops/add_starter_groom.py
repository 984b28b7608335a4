"""Add one of the grooms that ship with the add-on."""

from __future__ import annotations

import bpy

from .. import assets, lazy, material, scene
from ..backend.errors import require
from ..jobs import reports_errors

# Blender keeps no reference to the texts of a dynamic enum, so they must live on here
_ITEMS: list[tuple[str, str, str]] = []


def _groom_items(self: object, context: bpy.types.Context | None) -> list[tuple[str, str, str]]:
    if not _ITEMS:
        _ITEMS.extend((name, name, f"Add the groom {name}") for name, _ in assets.starter_grooms())
    return _ITEMS


class HAIRLOOM_OT_add_starter_groom(bpy.types.Operator):
    """Add a groom that ships with Hairloom, with the plain head it grows on unless a head is chosen already"""

    bl_idname = "hairloom.add_starter_groom"
    bl_label = "Add Starter Groom"
    bl_options = {"REGISTER", "UNDO"}
    bl_property = "groom"

    groom: bpy.props.EnumProperty(name="Groom", description="Which groom to add", items=_groom_items)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, scene.why_no_object_mode(context))

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        require(self.groom, "no starter grooms came with this copy of Hairloom; install the zip of a release")
        groom = assets.append_groom(context, self.groom)
        settings = scene.settings(context)
        brought, chosen = groom.data.surface, scene.head_for(context, None)
        if chosen is None:
            settings.head = brought
        elif brought is not None and brought is not chosen:
            groom.parent = None
            bpy.data.meshes.remove(brought.data)  # and the object with it
            lazy.bridge("attachment").attach_to_head(groom, chosen)
        if not groom.data.materials:
            groom.data.materials.append(material.hair_material())
        scene.select_only(context, groom)
        self.report({"INFO"}, f"{groom.name}: {len(groom.data.curves):,} strands")
        return {"FINISHED"}


CLASSES = (HAIRLOOM_OT_add_starter_groom,)
