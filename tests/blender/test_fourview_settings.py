"""The wizard's settings against the Params of the backend."""

from __future__ import annotations

from dataclasses import asdict

import bpy
import pytest
import scenes
from test_props import walk


def settings():
    return bpy.context.scene.hairloom.four_view


def params_class():
    return scenes.module("backend.fourview.pipeline").FourViewParams


def part_of(whole: object, part: object) -> bool:
    """Does every setting of `part` have the same value in `whole`?"""
    if isinstance(part, dict):
        return isinstance(whole, dict) and all(name in whole and part_of(whole[name], v) for name, v in part.items())
    return whole == (tuple(part) if isinstance(part, list) else part)


def test_defaults_are_those_of_the_backend():
    assert part_of(asdict(params_class()()), settings().to_params())


def test_every_setting_has_a_tooltip_and_both_ends_of_its_range_are_accepted():
    build = scenes.module("backend.registry").build_params
    for group, setting, path in walk(settings()):
        rna = group.bl_rna.properties[setting]
        assert len(rna.description) > 15, path
        if rna.type not in {"INT", "FLOAT"}:
            continue
        usual = getattr(group, setting)
        for end in (rna.hard_min, rna.hard_max, rna.soft_min, rna.soft_max):
            setattr(group, setting, end)
            build(params_class(), settings().to_params())
        setattr(group, setting, usual)


@pytest.mark.parametrize("stage", ["shape", "texture", "directions", "strands"])
def test_each_stage_has_settings_of_its_own(stage):
    of_stage = scenes.module("fourview_params").OF_STAGE
    assert set(settings().of_stage(stage)) - {"grooms_folder"} == set(of_stage[stage])
    every = [name for names in of_stage.values() for name in names]
    assert sorted(every) == sorted(settings().to_params())
