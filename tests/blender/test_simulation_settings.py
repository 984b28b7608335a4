"""The settings of the simulation against the Params of the backend, their presets, and what is saved of them."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import bpy
import pytest
import scenes
from test_props import as_json, walk

# Params that the operators fill in
_NOT_SETTINGS = ("cache", "fingerprint", "resume")


def settings():
    return bpy.context.scene.hairloom.simulation


def simulate_params(**changes):
    params = scenes.module("backend.registry").build_params(
        scenes.module("backend.jobs.simulate").SimulateParams, settings().to_params()
    )
    return params


def test_defaults_are_those_of_the_backend():
    expected = as_json(scenes.module("backend.jobs.simulate").SimulateParams())
    assert settings().to_params() == {name: v for name, v in expected.items() if name not in _NOT_SETTINGS}
    assert settings().guides.to_params() == as_json(scenes.module("backend.rods.guides").GuideParams())


def test_shown_units_become_si():
    settings().material.young = 2.5
    settings().material.radius_major = 33.0
    settings().fit.l_max = 42.0
    settings().simulation.contact.radius = 1.5
    params = simulate_params()
    assert (params.material.young, params.material.radius_major) == (2.5e9, 3.3e-5)
    assert (params.fit.l_max, params.simulation.contact.radius) == (0.42, 1.5e-3)


def test_the_unit_scale_of_the_scene_does_not_change_physics():
    before = settings().to_params()
    bpy.context.scene.unit_settings.scale_length = 0.01
    assert settings().to_params() == before


@pytest.mark.parametrize("name", ["simulation", "guides"])
def test_every_setting_has_a_tooltip_and_both_ends_of_its_range_are_accepted(name):
    registry = scenes.module("backend.registry")
    if name == "guides":
        top, cls = settings().guides, scenes.module("backend.rods.guides").GuideParams
    else:
        top, cls = settings(), scenes.module("backend.jobs.simulate").SimulateParams
    for group, setting, path in walk(top):
        rna = group.bl_rna.properties[setting]
        assert len(rna.description) > 20, path
        assert rna.name, path
        if rna.type not in {"INT", "FLOAT"}:
            continue
        usual = getattr(group, setting)
        for end in (rna.hard_min, rna.hard_max, rna.soft_min, rna.soft_max):
            setattr(group, setting, end)
            registry.build_params(cls, top.to_params())
        setattr(group, setting, usual)


@pytest.mark.parametrize(("low", "high"), [("n_min", "n_max"), ("l_min", "l_max")])
def test_the_ends_of_a_range_push_each_other(low, high):
    fit = settings().fit
    setattr(fit, low, 900)
    assert getattr(fit, high) == 900
    setattr(fit, high, 7)
    assert getattr(fit, low) == 7


@pytest.mark.parametrize("name", ["Fine", "Thick", "Wavy", "Wet"])
def test_bundled_presets_are_the_backends(name):
    folders = bpy.utils.preset_paths("hairloom/physics")
    path = next(path for folder in folders if (path := Path(folder, f"{name}.py")).is_file())
    lines = path.read_text(encoding="utf-8").splitlines()
    operator = scenes.module("ui.physics_presets").HAIRLOOM_OT_add_physics_preset
    assert [line.split(" = ")[0] for line in lines[3:]] == operator.preset_values
    settings().material.young = 77.0
    bpy.ops.script.execute_preset(filepath=str(path), menu_idname="HAIRLOOM_PT_physics_presets")
    assert settings().material.to_params() == asdict(scenes.module("backend.rods.material").PRESETS[name.lower()])


def test_settings_are_saved(tmp_path):
    settings().material.young = 2.0
    settings().colliders = bpy.data.collections.new("Hats")
    bpy.context.scene.collection.children.link(settings().colliders)
    scenes.reload(tmp_path)
    assert settings().material.young == 2.0
    assert settings().colliders.name == "Hats"
