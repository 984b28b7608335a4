"""Hair materials: one for pictures, one that shows wisps in colour. Both render in Cycles and EEVEE."""

from __future__ import annotations

from collections.abc import Callable

import bpy

HAIR = "Hairloom Hair"
WISPS = "Hairloom Wisps"
WISP_COLOR = "hairloom_wisp_color"


def hair_material() -> bpy.types.Material:
    """The brown hair material, made on first use; the user may change it."""
    return _material(HAIR, _hair_nodes, (0.10, 0.05, 0.025, 1.0))


def wisp_material() -> bpy.types.Material:
    """Strands in the colour of the attribute `hairloom_wisp_color`, made on first use."""
    return _material(WISPS, _wisp_nodes, (0.8, 0.8, 0.8, 1.0))


def _material(
    name: str, add_nodes: Callable[[bpy.types.NodeTree], bpy.types.Node], viewport_color: tuple[float, ...]
) -> bpy.types.Material:
    material = bpy.data.materials.get(name)
    if material is not None:
        return material
    material = bpy.data.materials.new(name)
    material.diffuse_color = viewport_color
    if bpy.app.version < (5, 0):
        # from 5.0 on every material has nodes
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    shader = add_nodes(tree)
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output.location = (300, 0)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material


def _hair_nodes(tree: bpy.types.NodeTree) -> bpy.types.Node:
    shader = tree.nodes.new("ShaderNodeBsdfHairPrincipled")
    shader.model = "CHIANG"
    shader.parametrization = "MELANIN"
    for name, value in {
        "Melanin": 0.75, "Melanin Redness": 0.5, "Roughness": 0.3, "Radial Roughness": 0.4, "Random Color": 0.2,
        "Random Roughness": 0.1,
    }.items():  # fmt: skip
        shader.inputs[name].default_value = value
    return shader


def _wisp_nodes(tree: bpy.types.NodeTree) -> bpy.types.Node:
    color = tree.nodes.new("ShaderNodeAttribute")
    color.attribute_name = WISP_COLOR
    color.location = (-300, 0)
    shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
    shader.inputs["Roughness"].default_value = 0.6
    tree.links.new(color.outputs["Color"], shader.inputs["Base Color"])
    return shader
