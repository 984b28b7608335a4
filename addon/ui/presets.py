"""Presets of the synthesis settings: ours, by kind of hair, and the user's own."""

from __future__ import annotations

import os

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from ..props import RefineSettings

FOLDER = "hairloom/synthesis"
# the folder that holds `presets/hairloom/synthesis`
_BUNDLED = os.path.dirname(os.path.dirname(__file__))
_VALUES = (
    "n_samples", "n_features", "map_spacing", "use_refinement",
    "hierarchy.n_levels", "hierarchy.ratio",
    "hierarchy.wisps.n_wisps", "hierarchy.wisps.error_threshold", "hierarchy.wisps.adaptive",
    "hierarchy.wisps.max_iterations",
    "texture.window_sizes", "texture.n_scales", "texture.n_iterations", "texture.exponent", "texture.layout_weight",
    "transfer.n_features", "transfer.n_donors",
    *(f"refine.{name}" for name in RefineSettings.setting_names()),
)  # fmt: skip


class HAIRLOOM_OT_add_synthesis_preset(AddPresetBase, bpy.types.Operator):
    """Add or remove a preset of the synthesis settings"""

    bl_idname = "hairloom.add_synthesis_preset"
    bl_label = "Add Synthesis Preset"
    preset_menu = "HAIRLOOM_PT_synthesis_presets"
    preset_subdir = FOLDER
    preset_defines = ["synthesis = bpy.context.scene.hairloom.synthesis"]
    preset_values = [f"synthesis.{name}" for name in _VALUES]


class HAIRLOOM_PT_synthesis_presets(PresetPanel, bpy.types.Panel):
    """Settings for kinds of hair"""

    bl_label = "Synthesis Presets"
    preset_subdir = FOLDER
    preset_operator = "script.execute_preset"
    preset_add_operator = "hairloom.add_synthesis_preset"


_register, _unregister = bpy.utils.register_classes_factory(
    [HAIRLOOM_OT_add_synthesis_preset, HAIRLOOM_PT_synthesis_presets]
)


def register() -> None:
    _register()
    bpy.utils.register_preset_path(_BUNDLED)


def unregister() -> None:
    bpy.utils.unregister_preset_path(_BUNDLED)
    _unregister()
