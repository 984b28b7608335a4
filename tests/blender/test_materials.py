"""The hair material and the wisps' colours."""

from __future__ import annotations

import bpy
import pytest
import scenes


@pytest.mark.parametrize(
    ("make", "shader"), [("hair_material", "BSDF_HAIR_PRINCIPLED"), ("wisp_material", "BSDF_PRINCIPLED")]
)
def test_a_material_ends_in_its_shader_and_is_made_once(make, shader):
    material = scenes.module("material")
    made = getattr(material, make)()
    output = next(node for node in made.node_tree.nodes if node.type == "OUTPUT_MATERIAL")
    assert output.inputs["Surface"].links[0].from_node.type == shader
    assert getattr(material, make)() == made
    assert len(bpy.data.materials) == 1


def test_changes_of_the_user_stay():
    material = scenes.module("material")
    node = next(n for n in material.hair_material().node_tree.nodes if n.type == "BSDF_HAIR_PRINCIPLED")
    node.inputs["Melanin"].default_value = 0.1
    assert material.hair_material().node_tree.nodes[node.name].inputs["Melanin"].default_value == pytest.approx(0.1)
