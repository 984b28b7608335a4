"""Presets of the synthesis settings: ours, by kind of hair, and the user's own."""

from __future__ import annotations

import os

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from ..props import SynthesisSettings

FOLDER = "hairloom/synthesis"
# the folder that holds `presets/hairloom/synthesis`
_BUNDLED = os.path.dirname(os.path.dirname(__file__))
# what a kind of hair says nothing about
_NOT_KEPT = {"n_strands", "seed"}


class HAIRLOOM_OT_add_synthesis_preset(AddPresetBase, bpy.types.Operator):
    """Add or remove a preset of the synthesis settings"""

    bl_idname = "hairloom.add_synthesis_preset"
    bl_label = "Add Synthesis Preset"
    preset_menu = "HAIRLOOM_PT_synthesis_presets"
    preset_subdir = FOLDER
    preset_defines = ["synthesis = bpy.context.scene.hairloom.synthesis"]
    preset_values: list[str] = []  # filled in when the settings are registered


class HAIRLOOM_PT_synthesis_presets(PresetPanel, bpy.types.Panel):
    """Settings for kinds of hair"""

    bl_label = "Synthesis Presets"
    preset_subdir = FOLDER
    preset_operator = "script.execute_preset"
    preset_add_operator = "hairloom.add_synthesis_preset"


_register, _unregister = bpy.utils.register_classes_factory(
    [HAIRLOOM_OT_add_synthesis_preset, HAIRLOOM_PT_synthesis_presets]
)


def setting_paths(group: bpy.types.Struct, prefix: str = "") -> list[str]:
    """The settings of a registered group and of the groups in it, as 'hierarchy.wisps.n_wisps'."""
    paths = []
    for rna in group.properties:
        if rna.type == "POINTER" and rna.identifier != "rna_type":
            paths += setting_paths(rna.fixed_type, f"{prefix}{rna.identifier}.")
        elif rna.identifier not in {"rna_type", "name", *_NOT_KEPT}:
            paths.append(f"{prefix}{rna.identifier}")
    return paths


def register() -> None:
    paths = setting_paths(SynthesisSettings.bl_rna)
    HAIRLOOM_OT_add_synthesis_preset.preset_values = [f"synthesis.{path}" for path in paths]
    _register()
    bpy.utils.register_preset_path(_BUNDLED)


def unregister() -> None:
    bpy.utils.unregister_preset_path(_BUNDLED)
    _unregister()
