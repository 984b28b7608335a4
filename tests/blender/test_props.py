"""The PropertyGroups against the backend's Params classes."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import bpy
import pytest
import scenes


def settings():
    return bpy.context.scene.hairloom


def as_json(params: object) -> dict:
    return json.loads(json.dumps(asdict(params)))


def shared_seed_removed(params: dict) -> dict:
    """The pipeline gives its own seed to every stage, so the stages' seeds are no settings of their own."""
    for stage in ("texture", "refine"):
        params.get(stage, {}).pop("seed", None)
    return params


def test_synthesis_defaults_are_those_of_the_backend():
    params = scenes.module("backend.synthesis.pipeline").SynthesisParams()
    assert settings().synthesis.to_params() == shared_seed_removed(as_json(params))


def test_clean_up_defaults_are_those_of_the_backend():
    assert settings().clean_up.to_params() == as_json(scenes.module("backend.geometry.cleanup").CleanUpParams())


def test_comb_defaults_are_those_of_the_backend():
    """All but `mirror`, which Blender keeps with the Curves."""
    params = as_json(scenes.module("backend.editing.strokes").CombParams())
    assert params.pop("mirror") == [False, False, False]
    assert settings().comb.to_params() == params


def test_both_ends_of_every_range_of_the_comb_are_accepted():
    build, comb = scenes.module("backend.editing.strokes").comb_params, settings().comb
    for rna in comb.bl_rna.properties:
        if rna.identifier in {"rna_type", "name"}:
            continue
        assert len(rna.description) > 20, rna.identifier
        if rna.type not in {"INT", "FLOAT"}:
            continue
        usual = getattr(comb, rna.identifier)
        usual = tuple(usual) if rna.is_array else usual
        for end in (rna.hard_min, rna.hard_max, rna.soft_min, rna.soft_max):
            setattr(comb, rna.identifier, [end] * 3 if rna.is_array else end)
            build(comb.to_params())
        setattr(comb, rna.identifier, usual)
    for mode in comb.bl_rna.properties["mode"].enum_items:
        comb.mode = mode.identifier
        build(comb.to_params())
    assert [mode.identifier for mode in comb.bl_rna.properties["mode"].enum_items] == list(
        scenes.module("backend.editing.strokes").MODES
    )


def test_detail_defaults_are_those_of_the_backend():
    params = scenes.module("backend.synthesis.detail_transfer").DetailParams()
    assert settings().details.settings.to_params() == as_json(params)


def test_settings_become_params():
    synthesis = settings().synthesis
    synthesis.n_strands = 1234
    synthesis.hierarchy.wisps.error_threshold = 0.1
    synthesis.texture.window_sizes = (16, 8, 0)
    cls = scenes.module("backend.synthesis.pipeline").SynthesisParams
    params = scenes.module("backend.registry").build_params(cls, synthesis.to_params())
    assert (params.n_strands, params.texture.window_sizes) == (1234, (16, 8))
    # the number that was typed, not the float32 next to it
    assert params.hierarchy.wisps.error_threshold == 0.1


def walk(group, prefix=""):
    for name in group.setting_names():
        value = getattr(group, name)
        if hasattr(value, "setting_names"):
            yield from walk(value, f"{prefix}{name}.")
        else:
            yield group, name, f"{prefix}{name}"


@pytest.mark.parametrize("name", ["synthesis", "clean_up", "details.settings"])
def test_every_setting_has_a_tooltip_and_both_ends_of_its_range_are_accepted(name):
    registry = scenes.module("backend.registry")
    cls = {
        "synthesis": ("backend.synthesis.pipeline", "SynthesisParams"),
        "clean_up": ("backend.geometry.cleanup", "CleanUpParams"),
        "details.settings": ("backend.synthesis.detail_transfer", "DetailParams"),
    }[name]
    params = getattr(scenes.module(cls[0]), cls[1])
    top = settings().path_resolve(name)
    for group, setting, path in walk(top):
        rna = group.bl_rna.properties[setting]
        assert len(rna.description) > 20, path
        assert rna.name, path
        if rna.type not in {"INT", "FLOAT"} or rna.is_array:
            continue
        usual = getattr(group, setting)
        for end in (rna.hard_min, rna.hard_max, rna.soft_min, rna.soft_max):
            setattr(group, setting, end)
            registry.build_params(params, top.to_params())
        setattr(group, setting, usual)


def test_settings_are_saved(tmp_path):
    settings().synthesis.hierarchy.wisps.n_wisps = 77
    settings().head = scenes.sphere_head()
    scenes.reload(tmp_path)
    assert settings().synthesis.hierarchy.wisps.n_wisps == 77
    assert settings().head.name == "Ball"


@pytest.mark.parametrize("name", ["Straight", "Wavy", "Curly", "Spiky", "Puffy"])
def test_bundled_presets_are_found_and_make_valid_settings(name):
    folders = bpy.utils.preset_paths("hairloom/synthesis")
    path = next(path for folder in folders if (path := Path(folder, f"{name}.py")).is_file())
    text = path.read_text(encoding="utf-8")
    operator = scenes.module("ui.presets").HAIRLOOM_OT_add_synthesis_preset
    # a preset that leaves a setting out would leave there what the one before set
    assert [line.split(" = ")[0] for line in text.splitlines()[3:]] == operator.preset_values
    bpy.ops.script.execute_preset(filepath=str(path), menu_idname="HAIRLOOM_PT_synthesis_presets")
    cls = scenes.module("backend.synthesis.pipeline").SynthesisParams
    scenes.module("backend.registry").build_params(cls, settings().synthesis.to_params())
    assert settings().synthesis.hierarchy.n_levels == (2 if name == "Spiky" else 3)
    assert scenes.module("ui.presets").HAIRLOOM_PT_synthesis_presets.bl_label == name


def test_a_preset_of_the_users_brings_every_setting_back(tmp_path):
    synthesis = settings().synthesis
    synthesis.hierarchy.wisps.n_wisps = 77
    synthesis.texture.window_sizes = (24, 12, 0)
    synthesis.use_refinement = False
    kept = synthesis.to_params()
    bpy.ops.hairloom.add_synthesis_preset(name="Mine of a test")
    try:
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        assert settings().synthesis.to_params() != kept
        path = bpy.utils.preset_find("Mine of a test", "hairloom/synthesis", display_name=True)
        bpy.ops.script.execute_preset(filepath=path, menu_idname="HAIRLOOM_PT_synthesis_presets")
        assert settings().synthesis.to_params() == kept
    finally:
        bpy.ops.hairloom.add_synthesis_preset(name="Mine of a test", remove_name=True)
