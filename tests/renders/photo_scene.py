"""Cycles pictures of a groom through our cameras: hair on a skin-coloured head, and how much hair covers a pixel."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import bpy  # isort: skip
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "docs"))

from grooms import Groom
from hairloom.geometry.camera import DISTANCE, unproject
from hairloom.types import Camera, Float32
from mathutils import Matrix, Vector
from render import SCALP_SHADE, hair_material, quiet, shade_scalp

SKIN = (0.24, 0.145, 0.105, 1.0)  # linear RGBA, for light that is strong enough for dark hair
DARK_SCALP = (0.02, 0.014, 0.01, 1.0)  # gaps between strands look like hair in the shade, not like skin
# Two lights that go with the camera, as when a person turns in front of it: right, up and towards it from the middle
# of the head in metres, size in metres, power in watts. Few lights and no bounces: little noise from few samples.
LIGHTS = (((-0.5, 0.7, 1.6), 0.4, 65.0), ((0.7, 0.1, 1.6), 0.4, 32.0))
# absorption by melanin as in Chiang et al. 2016 (Cycles' Principled Hair), linear RGB
EUMELANIN, PHEOMELANIN = np.array([0.506, 0.841, 1.653]), np.array([0.343, 0.733, 1.924])
PATH = 1.8  # how strongly absorption colours the matt part
MASK_SAMPLES = 4
COLOUR = "groom_color"  # strand attribute of modelled hair, linear RGBA
# Colours taken from photos have the photos' light and shade in them: so much brighter, hair that is lit again is alike.
OWN_COLOUR = 2.5
SHINE = (0.4, 0.37, 0.33)


def make_scene(groom: Groom, samples: int, melanin: float, redness: float, principled: bool) -> Any:
    """An empty file with the groom, its head and lights, ready for `render_view` and `render_coverage`.

    principled : Cycles' Principled Hair with several bounces, for which 12 samples are not enough; else one that looks
        alike under frontal light, of a matt and a glossy part, without bounces.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.film_transparent = True
    scene.render.use_persistent_data = True
    scene.view_settings.view_transform = "Standard"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = samples
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.max_bounces = cycles.transmission_bounces = cycles.glossy_bounces = 4 if principled else 0
    cycles.diffuse_bounces = 0
    cycles.sample_clamp_direct, cycles.sample_clamp_indirect = 4.0, 2.0
    cycles.seed = 0
    scene.cycles_curves.shape = "RIBBONS"
    _add_head(scene, groom)
    material = hair_material("hair", melanin, redness) if principled else _direct_material(melanin, redness)
    if COLOUR in groom.strands.strand_attributes:
        _colour_by_attribute(material)
    _add_hair(scene, groom, material)
    _add_lights(scene)
    return scene


def render_view(scene: Any, camera: Camera) -> Float32:
    """(H, W, 4) float32 in [0, 1]: sRGB, not multiplied by its alpha."""
    scene.objects["head"].is_holdout = False
    return _render(scene, camera)


def render_coverage(scene: Any, camera: Camera) -> Float32:
    """(H, W) float32 in [0, 1]: the share of each pixel where the hair is in front."""
    kept = scene.cycles.samples
    layer = scene.view_layers[0]
    layer.material_override = bpy.data.materials.get("flat") or _flat_material()
    scene.objects["head"].is_holdout = True
    scene.cycles.samples = MASK_SAMPLES
    try:
        return np.ascontiguousarray(_render(scene, camera)[..., 3])
    finally:
        layer.material_override = None
        scene.cycles.samples = kept


def _flat_material() -> Any:
    """Light without shading: only what is in front counts, at little cost."""
    material = bpy.data.materials.new("flat")
    nodes = _nodes(material)
    nodes.clear()
    shader, output = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material


def _nodes(owner: Any) -> Any:
    if bpy.app.version < (5, 0, 0):
        owner.use_nodes = True
    return owner.node_tree.nodes


def _add_head(scene: Any, groom: Groom) -> None:
    mesh = bpy.data.meshes.new("head")
    mesh.from_pydata(groom.head.vertices.tolist(), [], groom.head.triangles.tolist())
    mesh.shade_smooth()
    shade_scalp(mesh, groom.head)
    material = bpy.data.materials.new("skin")
    nodes = _nodes(material)
    shader = nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = 0.6
    shader.inputs["Specular IOR Level"].default_value = 0.25
    scalp, ramp = nodes.new("ShaderNodeAttribute"), nodes.new("ShaderNodeValToRGB")
    scalp.attribute_name = SCALP_SHADE
    ramp.color_ramp.elements[0].color = SKIN
    ramp.color_ramp.elements[1].color = DARK_SCALP
    ramp.color_ramp.elements[1].position = 0.5
    material.node_tree.links.new(scalp.outputs["Fac"], ramp.inputs["Fac"])
    material.node_tree.links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("head", mesh))


def _add_hair(scene: Any, groom: Groom, material: Any) -> None:
    strands = groom.strands
    curves = bpy.data.hair_curves.new("hair")
    curves.add_curves(strands.point_counts.tolist())
    curves.position_data.foreach_set("vector", np.ascontiguousarray(strands.points).ravel())
    radius = curves.attributes.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", np.ascontiguousarray(strands.point_attributes["radius"]))
    if COLOUR in strands.strand_attributes:
        colours = np.ascontiguousarray(strands.strand_attributes[COLOUR], np.float32)
        curves.attributes.new(COLOUR, "FLOAT_COLOR", "CURVE").data.foreach_set("color", colours.ravel())
    curves.materials.append(material)
    curves.update_tag()
    scene.collection.objects.link(bpy.data.objects.new("hair", curves))


def _direct_material(melanin: float, redness: float) -> Any:
    """Strands of varied brightness with a highlight across them, seen under direct light alone."""
    amount = -np.log(max(1.0 - melanin, 1e-3))
    absorption = amount * ((1.0 - redness) * EUMELANIN + redness * PHEOMELANIN)
    colour = np.exp(-PATH * np.sqrt(absorption))
    material = bpy.data.materials.new("hair")
    nodes, links = _nodes(material), material.node_tree.links
    nodes.clear()
    strand, ramp = nodes.new("ShaderNodeHairInfo"), nodes.new("ShaderNodeValToRGB")
    for element, brightness in zip(ramp.color_ramp.elements, (0.5, 1.5)):
        element.color = (*np.clip(colour * brightness, 0.0, 1.0), 1.0)
    matt, glossy = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeBsdfHair")
    glossy.component = "Reflection"
    glossy.inputs["Color"].default_value = (*np.sqrt(colour), 1.0)
    glossy.inputs["Offset"].default_value = -0.05
    glossy.inputs["RoughnessU"].default_value, glossy.inputs["RoughnessV"].default_value = 0.25, 0.7
    mix, output = nodes.new("ShaderNodeMixShader"), nodes.new("ShaderNodeOutputMaterial")
    mix.inputs["Fac"].default_value = 0.35
    links.new(strand.outputs["Random"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], matt.inputs["Color"])
    links.new(matt.outputs[0], mix.inputs[1])
    links.new(glossy.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], output.inputs["Surface"])
    return material


def _colour_by_attribute(material: Any) -> None:
    """Let `_direct_material` take the strands' own colours, varied as there."""
    nodes, links = _nodes(material), material.node_tree.links
    ramp = next(node for node in nodes if node.bl_idname == "ShaderNodeValToRGB")
    for element, brightness in zip(ramp.color_ramp.elements, (0.5, 1.5)):
        element.color = (brightness * OWN_COLOUR,) * 3 + (1.0,)
    own, product = nodes.new("ShaderNodeAttribute"), nodes.new("ShaderNodeVectorMath")
    own.attribute_name = COLOUR
    product.operation = "MULTIPLY"
    links.new(own.outputs["Color"], product.inputs[0])
    links.new(ramp.outputs["Color"], product.inputs[1])
    for node in nodes:
        if node.bl_idname == "ShaderNodeBsdfDiffuse":
            links.new(product.outputs["Vector"], node.inputs["Color"])
        if node.bl_idname == "ShaderNodeBsdfHair":
            node.inputs["Color"].default_value = (*SHINE, 1.0)


def _add_lights(scene: Any) -> None:
    for number, (_, size, power) in enumerate(LIGHTS):
        light = bpy.data.lights.new(f"light {number}", "AREA")
        light.size, light.energy = size, power
        scene.collection.objects.link(bpy.data.objects.new(light.name, light))


def _place_lights(scene: Any, camera: Camera) -> None:
    """Put the lights beside the camera, all shining at the middle of its picture."""
    right, down, forward = camera.world_to_camera[:3, :3]
    middle = np.array([[camera.size[0] / 2.0, camera.size[1] / 2.0]])
    subject = unproject(camera, middle, np.array([DISTANCE]))[0]
    for number, ((aside, above, near), _, _) in enumerate(LIGHTS):
        offset = aside * right - above * down - near * forward
        scene.objects[f"light {number}"].matrix_world = Matrix.LocRotScale(
            Vector(subject + offset), Vector(offset).to_track_quat("Z", "Y"), None
        )


def _use_camera(scene: Any, camera: Camera) -> None:
    width, height = camera.size
    data = bpy.data.cameras.new("camera")
    data.clip_start, data.clip_end = 1e-3, 100.0
    data.sensor_fit = "HORIZONTAL"
    scale = float(camera.intrinsics[0, 0])
    if camera.orthographic:
        data.type, data.ortho_scale = "ORTHO", width / scale
    else:
        data.lens_unit, data.sensor_width, data.lens = "MILLIMETERS", 36.0, 36.0 * scale / width
    data.shift_x = 0.5 - float(camera.intrinsics[0, 2]) / width
    data.shift_y = (float(camera.intrinsics[1, 2]) - height / 2.0) / width
    item = bpy.data.objects.new("camera", data)
    item.matrix_world = Matrix((np.linalg.inv(camera.world_to_camera) @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist())
    scene.collection.objects.link(item)
    scene.camera = item
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100


def _render(scene: Any, camera: Camera) -> Float32:
    _use_camera(scene, camera)
    _place_lights(scene, camera)
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGBA", "16"
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = os.path.join(folder, "picture.png")
        with quiet():
            bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        width, height = image.size
        pixels = np.empty(width * height * 4, np.float32)
        image.pixels.foreach_get(pixels)
        bpy.data.images.remove(image)
    return np.ascontiguousarray(pixels.reshape(height, width, 4)[::-1])
