"""Gravity and the force fields that blow at hair, as the scene has them; no numpy, so that panels can say which act."""

from __future__ import annotations

from dataclasses import dataclass

import bpy

# Blender's kinds of field that the simulation knows, and what it calls them
KINDS = {"WIND": "wind", "FORCE": "force", "VORTEX": "vortex", "TURBULENCE": "turbulence"}


@dataclass(frozen=True, slots=True)
class Field:
    """A force field of the scene; `remark` says why it does not act, or what of it is left out, or ''."""

    name: str
    kind: str  # as the backend calls it, '' where it does not act
    remark: str


def metres_per_unit(scene: bpy.types.Scene) -> float:
    """What one unit of the scene is in metres."""
    units = scene.unit_settings
    return float(units.scale_length) if units.system != "NONE" else 1.0


def gravity(scene: bpy.types.Scene) -> tuple[float, float, float]:
    """m/s^2, as the scene's properties show it."""
    if not scene.use_gravity:
        return (0.0, 0.0, 0.0)
    x, y, z = (float(f"{value:.7g}") * metres_per_unit(scene) for value in scene.gravity)
    return (x, y, z)


def fields(context: bpy.types.Context) -> list[Field]:
    """The force fields of the scene by name, with those that do not act."""
    objects = sorted(context.view_layer.objects, key=lambda obj: obj.name)
    return [_field(obj) for obj in objects if obj.field is not None and obj.field.type != "NONE"]


def _field(obj: bpy.types.Object) -> Field:
    settings = obj.field
    label = settings.bl_rna.properties["type"].enum_items[settings.type].name
    if obj.hide_viewport:
        return Field(obj.name, "", f"'{obj.name}' is disabled in the viewport and does not act")
    if settings.type not in KINDS:
        known = ", ".join(kind.title() for kind in KINDS.values())
        return Field(obj.name, "", f"'{obj.name}' is a field of kind {label}, which does not act on hair; use {known}")
    if settings.shape != "POINT" and settings.type != "WIND":
        return Field(obj.name, KINDS[settings.type], f"'{obj.name}' acts from its origin, whatever its shape")
    if settings.falloff_type != "SPHERE" and (settings.falloff_power or settings.use_max_distance):
        return Field(obj.name, KINDS[settings.type], f"'{obj.name}' falls off as a sphere, not by its own shape")
    return Field(obj.name, KINDS[settings.type], "")
