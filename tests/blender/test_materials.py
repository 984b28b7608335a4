"""The hair material and the wisps' colours."""

from __future__ import annotations

import bpy
import pytest
import scenes


@pytest.mark.parametrize(
    ("make", "engine", "shader"),
    [
        ("hair_material", "CYCLES", "BSDF_HAIR_PRINCIPLED"),
        ("hair_material", "EEVEE", "BSDF_PRINCIPLED"),
        ("wisp_material", "CYCLES", "BSDF_PRINCIPLED"),
        ("wisp_material", "EEVEE", "BSDF_PRINCIPLED"),
    ],
)
def test_each_engine_finds_its_shader(make, engine, shader):
    made = getattr(scenes.module("material"), make)()
    output = made.node_tree.get_output_node(engine)
    assert output.inputs["Surface"].links[0].from_node.type == shader


def test_a_material_is_made_once():
    material = scenes.module("material")
    assert material.hair_material() == material.hair_material()
    assert material.wisp_material() == material.wisp_material()
    assert len(bpy.data.materials) == 2


def test_changes_of_the_user_stay():
    material = scenes.module("material")
    node = next(n for n in material.hair_material().node_tree.nodes if n.type == "BSDF_HAIR_PRINCIPLED")
    node.inputs["Melanin"].default_value = 0.1
    assert material.hair_material().node_tree.nodes[node.name].inputs["Melanin"].default_value == pytest.approx(0.1)
