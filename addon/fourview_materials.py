"""Materials of the four-view wizard: the hair in the colours of the photos, and the shape with its texture."""

from __future__ import annotations

import bpy

HAIR = "Hairloom Photo Hair"
TEXTURE = "Hairloom Photo Texture"
COLOR = "groom_color"  # the strands' attribute, linear RGBA; Cycles shows one that is named "color" black
IMAGE_NODE = "Hair Texture"


def hair_material() -> bpy.types.Material:
    """Strands in the colours of their attribute `groom_color`, for Cycles and EEVEE; made on first use."""
    material = bpy.data.materials.get(HAIR)
    if material is not None:
        return material
    material = _new(HAIR)
    tree = material.node_tree
    color = tree.nodes.new("ShaderNodeAttribute")
    color.attribute_name = COLOR
    color.location = (-300, 0)
    hair = tree.nodes.new("ShaderNodeBsdfHairPrincipled")
    hair.model, hair.parametrization = "CHIANG", "COLOR"
    hair.inputs["Roughness"].default_value, hair.inputs["Radial Roughness"].default_value = 0.3, 0.4
    tree.links.new(color.outputs["Color"], hair.inputs["Color"])
    _output(tree, hair, "CYCLES", 0)
    surface = tree.nodes.new("ShaderNodeBsdfPrincipled")
    surface.inputs["Roughness"].default_value = 0.6
    tree.links.new(color.outputs["Color"], surface.inputs["Base Color"])
    _output(tree, surface, "EEVEE", -500)
    return material


def texture_material(image: bpy.types.Image) -> bpy.types.Material:
    """A surface that shows the texture of the hair."""
    material = bpy.data.materials.get(TEXTURE)
    if material is None or IMAGE_NODE not in material.node_tree.nodes:
        material = _new(TEXTURE)
        tree = material.node_tree
        picture = tree.nodes.new("ShaderNodeTexImage")
        picture.name, picture.location = IMAGE_NODE, (-300, 0)
        surface = tree.nodes.new("ShaderNodeBsdfPrincipled")
        surface.inputs["Roughness"].default_value = 1.0
        surface.inputs["Specular IOR Level"].default_value = 0.0
        tree.links.new(picture.outputs["Color"], surface.inputs["Base Color"])
        _output(tree, surface, "ALL", 0)
    material.node_tree.nodes[IMAGE_NODE].image = image
    # what Solid shading shows with its color set to Texture
    material.node_tree.nodes.active = material.node_tree.nodes[IMAGE_NODE]
    return material


def _new(name: str) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    material.diffuse_color = (0.2, 0.13, 0.09, 1.0)
    if bpy.app.version < (5, 0):
        # from 5.0 on every material has nodes
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material


def _output(tree: bpy.types.NodeTree, shader: bpy.types.Node, target: str, height: float) -> None:
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output.target = target
    shader.location, output.location = (0, height), (300, height)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
