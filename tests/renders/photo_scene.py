"""Cycles pictures of a groom through our cameras: hair on a skin-coloured head, and how much hair covers a pixel."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy  # isort: skip
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "docs"))

from grooms import Groom
from hairloom.types import Camera, Float32
from mathutils import Matrix
from render import SCALP_SHADE, hair_material, shade_scalp

SKIN = (0.58, 0.38, 0.29, 1.0)  # linear RGBA
DARK_SCALP = (0.02, 0.014, 0.01, 1.0)  # gaps between strands look like hair in the shade, not like skin
# name, place in metres from the middle of the scalp, size in metres, power in watts
LIGHTS = (
    ("front left", (0.8, -1.3, 0.5), 0.8, 24.0),
    ("front right", (-1.2, -0.8, 0.2), 0.8, 18.0),
    ("back right", (-0.8, 1.3, 0.5), 0.8, 24.0),
    ("back left", (1.2, 0.8, 0.2), 0.8, 18.0),
    ("above", (0.0, 0.0, 1.5), 0.8, 10.0),
)
MASK_SAMPLES = 4
BOUNCES = 2


def make_scene(groom: Groom, samples: int, melanin: float, redness: float) -> Any:
    """An empty file with the groom, its head and lights, ready for `render_view` and `render_coverage`."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.film_transparent = True
    scene.view_settings.view_transform = "Standard"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = samples
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.max_bounces = cycles.transmission_bounces = BOUNCES
    cycles.glossy_bounces = cycles.diffuse_bounces = 1
    cycles.seed = 0
    scene.cycles_curves.shape = "RIBBONS"
    scene.world = bpy.data.worlds.new("world")
    _nodes(scene.world)["Background"].inputs["Color"].default_value = (0.30, 0.31, 0.33, 1.0)
    _add_head(scene, groom)
    _add_hair(scene, groom, melanin, redness)
    _add_lights(scene, groom)
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


def _add_hair(scene: Any, groom: Groom, melanin: float, redness: float) -> None:
    strands = groom.strands
    curves = bpy.data.hair_curves.new("hair")
    curves.add_curves(strands.point_counts.tolist())
    curves.position_data.foreach_set("vector", np.ascontiguousarray(strands.points).ravel())
    radius = curves.attributes.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", np.ascontiguousarray(strands.point_attributes["radius"]))
    curves.materials.append(hair_material("hair", melanin, redness))
    curves.update_tag()
    scene.collection.objects.link(bpy.data.objects.new("hair", curves))


def _add_lights(scene: Any, groom: Groom) -> None:
    """Lights that stand still while the camera goes around, so that the views agree where they overlap."""
    scalp = groom.head.vertices[np.unique(groom.head.triangles[groom.head.scalp])]
    middle = (scalp.min(axis=0) + scalp.max(axis=0)) / 2.0
    for name, offset, size, power in LIGHTS:
        light = bpy.data.lights.new(name, "AREA")
        light.size, light.energy = size, power
        item = bpy.data.objects.new(name, light)
        turn = Matrix.Identity(3) if offset[:2] == (0.0, 0.0) else _facing(offset)
        item.matrix_world = Matrix.LocRotScale((middle + offset).tolist(), turn.to_quaternion(), None)
        scene.collection.objects.link(item)


def _facing(offset: tuple[float, float, float]) -> Any:
    """The turn of a light at `offset` that shines at the middle: its -z points there."""
    back = np.asarray(offset) / np.linalg.norm(offset)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    return Matrix(np.stack([right, np.cross(back, right), back], axis=1).tolist())


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
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGBA", "16"
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = os.path.join(folder, "picture.png")
        with _quiet():
            bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        width, height = image.size
        pixels = np.empty(width * height * 4, np.float32)
        image.pixels.foreach_get(pixels)
        bpy.data.images.remove(image)
    return np.ascontiguousarray(pixels.reshape(height, width, 4)[::-1])


@contextmanager
def _quiet() -> Iterator[None]:
    """Keeps Blender's render log, written past sys.stdout, off the terminal."""
    sys.stdout.flush()
    kept = os.dup(1)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
