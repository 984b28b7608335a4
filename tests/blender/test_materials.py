"""The hair material and the wisps' colours."""

from __future__ import annotations

import bpy
import numpy as np
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


def test_cycles_shows_hair_in_the_colour_that_it_carries(tmp_path):
    # Cycles reads some names of its own into a curve's attributes: one that is called "color" is black
    materials = scenes.module("fourview_materials")
    hair = scenes.groom()
    colour = hair.data.attributes.new(materials.COLOR, "FLOAT_COLOR", "CURVE")
    colour.data.foreach_set("color", np.tile(np.float32([0.7, 0.05, 0.05, 1.0]), len(hair.data.curves)))
    radius = hair.data.attributes.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", np.full(len(hair.data.points), 0.003, np.float32))
    hair.data.materials.append(materials.hair_material())
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", 8
    scene.render.resolution_x = scene.render.resolution_y = 32
    scene.view_settings.view_transform = "Raw"
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", 0.25, (0.0, 0.0, 1.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.film_transparent = True
    scene.render.filepath = str(tmp_path / "hair.png")
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy = 4.0
    scene.collection.objects.link(sun)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    pixels = np.empty((32 * 32, 4), np.float32)
    image.pixels.foreach_get(pixels.ravel())
    red, green, _ = pixels[pixels[:, 3] > 0.5, :3].mean(axis=0)
    assert red > 0.02 and red > 2 * green  # linear light; white highlights are in it
