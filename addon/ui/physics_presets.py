"""Presets of the physical properties: ours, by kind of hair, and the user's own."""

from __future__ import annotations

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from ..simulation_settings import MaterialSettings
from .presets import setting_paths

FOLDER = "hairloom/physics"


class HAIRLOOM_OT_add_physics_preset(AddPresetBase, bpy.types.Operator):
    """Add or remove a preset of the physical properties of hair"""

    bl_idname = "hairloom.add_physics_preset"
    bl_label = "Add Physics Preset"
    preset_menu = "HAIRLOOM_PT_physics_presets"
    preset_subdir = FOLDER
    preset_defines = ["material = bpy.context.scene.hairloom.simulation.material"]
    preset_values: list[str] = []  # filled in when the settings are registered


class HAIRLOOM_PT_physics_presets(PresetPanel, bpy.types.Panel):
    """Physical properties of kinds of hair"""

    bl_label = "Physics Presets"
    preset_subdir = FOLDER
    preset_operator = "script.execute_preset"
    preset_add_operator = "hairloom.add_physics_preset"


_register, unregister = bpy.utils.register_classes_factory(
    [HAIRLOOM_OT_add_physics_preset, HAIRLOOM_PT_physics_presets]
)


def register() -> None:
    """After `presets`, which tells Blender where the presets lie that come with the add-on."""
    paths = setting_paths(MaterialSettings.bl_rna)
    HAIRLOOM_OT_add_physics_preset.preset_values = [f"material.{path}" for path in paths]
    _register()
