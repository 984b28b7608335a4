"""Hair materials: one for pictures, one that shows wisps in colour. Both render in Cycles and EEVEE."""

from __future__ import annotations

from collections.abc import Callable

import bpy

HAIR = "Hairloom Hair"
WISPS = "Hairloom Wisps"
WISP_COLOR = "hairloom_wisp_color"
_BROWN = (0.10, 0.05, 0.025, 1.0)


def hair_material() -> bpy.types.Material:
    """The brown hair material, made on first use; the user may change it."""
    return _material(HAIR, _hair_nodes, _BROWN)


def wisp_material() -> bpy.types.Material:
    """Strands in the colour of the attribute `hairloom_wisp_color`, made on first use."""
    return _material(WISPS, _wisp_nodes, (0.8, 0.8, 0.8, 1.0))


def material_of(groom: bpy.types.Object) -> bpy.types.Material:
    """The first material of a groom; the hair material where it has none or shows wisps."""
    used = groom.data.materials[0] if groom.data.materials else None
    return used if used is not None and used.name != WISPS else hair_material()


def _material(
    name: str, add_nodes: Callable[[bpy.types.NodeTree], None], viewport_color: tuple[float, ...]
) -> bpy.types.Material:
    material = bpy.data.materials.get(name)
    if material is not None:
        return material
    material = bpy.data.materials.new(name)
    material.diffuse_color = viewport_color
    if bpy.app.version < (5, 0):
        # from 5.0 on every material has nodes
        material.use_nodes = True
    material.node_tree.nodes.clear()
    add_nodes(material.node_tree)
    return material


def _output(tree: bpy.types.NodeTree, shader: bpy.types.Node, target: str, height: float) -> None:
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output.target = target
    shader.location, output.location = (0, height), (300, height)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])


def _hair_nodes(tree: bpy.types.NodeTree) -> None:
    hair = tree.nodes.new("ShaderNodeBsdfHairPrincipled")
    hair.model = "CHIANG"
    hair.parametrization = "MELANIN"
    for name, value in {
        "Melanin": 0.75, "Melanin Redness": 0.5, "Roughness": 0.3, "Radial Roughness": 0.4, "Random Color": 0.2,
        "Random Roughness": 0.1,
    }.items():  # fmt: skip
        hair.inputs[name].default_value = value
    _output(tree, hair, "CYCLES", 0)
    # EEVEE has no melanin: a surface of about the same brown
    surface = tree.nodes.new("ShaderNodeBsdfPrincipled")
    surface.inputs["Base Color"].default_value = _BROWN
    surface.inputs["Roughness"].default_value = 0.5
    surface.inputs["Specular IOR Level"].default_value = 0.3
    _output(tree, surface, "EEVEE", -500)


def _wisp_nodes(tree: bpy.types.NodeTree) -> None:
    color = tree.nodes.new("ShaderNodeAttribute")
    color.attribute_name = WISP_COLOR
    color.location = (-300, 0)
    surface = tree.nodes.new("ShaderNodeBsdfPrincipled")
    surface.inputs["Roughness"].default_value = 0.6
    tree.links.new(color.outputs["Color"], surface.inputs["Base Color"])
    _output(tree, surface, "ALL", 0)
