"""Curves objects and StrandSets: strands in world space, metres, root first.

Strands are written as poly curves: a strand's points are the shape itself, and Blender need not subdivide them.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ..backend.types import StrandSet
from .attributes import KINDS, blender_form, read_attribute, read_values, write_attribute, write_values

if TYPE_CHECKING:
    from mathutils import Matrix

# what Curves keeps in attributes but StrandSet says otherwise, or what belongs to the surface it hangs on
_NOT_CARRIED = {"position", "curve_type"}
SURFACE_UV = "surface_uv_coordinate"


def transformed(points: np.ndarray, matrix: Matrix) -> np.ndarray:
    transform = np.array(matrix, np.float64)
    if np.array_equal(transform, np.eye(4)):
        return points
    return np.ascontiguousarray(points @ transform[:3, :3].T + transform[:3, 3], dtype=np.float32)


def read_strands(obj: bpy.types.Object) -> StrandSet:
    """The strands of a Curves object with all its attributes of known type; points in world space, metres.

    Raises
    ------
    InputError : NaN in the curves.
    """
    curves = obj.data
    points = (
        read_values(curves.position_data, "vector", np.float32, 3) if len(curves.points) else np.empty((0, 3), "f4")
    )
    offsets = np.zeros(1, np.int32)
    if len(curves.curves):
        offsets = read_values(curves.curve_offset_data, "value", np.int32)
    by_domain: dict[str, dict[str, np.ndarray]] = {"POINT": {}, "CURVE": {}}
    for attribute in curves.attributes:
        known = attribute.data_type in KINDS and attribute.name not in _NOT_CARRIED
        if known and not attribute.name.startswith("."):
            by_domain[attribute.domain][attribute.name] = read_attribute(attribute)
    return StrandSet(transformed(points, obj.matrix_world), offsets, by_domain["POINT"], by_domain["CURVE"])


def new_curves(name: str, strands: StrandSet, matrix: Matrix | None = None) -> bpy.types.Curves:
    """A Curves datablock with `strands`; `matrix` takes world space to the space of the object that will hold it."""
    curves = bpy.data.hair_curves.new(name)
    with ExitStack() as on_failure:
        on_failure.callback(bpy.data.hair_curves.remove, curves)
        if strands.n_strands:
            curves.add_curves(strands.point_counts.tolist())
            points = strands.points if matrix is None else transformed(strands.points, matrix)
            write_values(curves.position_data, "vector", points, np.float32, 3)
            curves.set_types(type="POLY")
            per_point, per_strand = dict(strands.point_attributes), dict(strands.strand_attributes)
            if "radius" in per_strand:
                # Blender knows a radius for each point only
                per_point.setdefault("radius", np.repeat(per_strand.pop("radius"), strands.point_counts))
            _write_all(curves, "POINT", per_point)
            _write_all(curves, "CURVE", per_strand)
        curves.update_tag()
        on_failure.pop_all()
    return curves


def _write_all(curves: bpy.types.Curves, domain: str, attributes: Mapping[str, np.ndarray]) -> None:
    for name, values in attributes.items():
        form = blender_form(values)
        if form is not None and name not in _NOT_CARRIED:
            write_attribute(curves, name, form[0], domain, form[1])


def new_object(name: str, strands: StrandSet, collection: bpy.types.Collection) -> bpy.types.Object:
    """A Curves object at the world's origin with `strands`, linked to `collection`."""
    obj = bpy.data.objects.new(name, new_curves(name, strands))
    collection.objects.link(obj)
    return obj


def new_sibling(
    name: str, strands: StrandSet, obj: bpy.types.Object, collection: bpy.types.Collection
) -> bpy.types.Object:
    """A Curves object with `strands`, placed, parented and hung on its surface exactly as `obj` is."""
    curves = new_curves(name, strands, obj.matrix_world.inverted())
    curves.surface, curves.surface_uv_map = obj.data.surface, obj.data.surface_uv_map
    new = bpy.data.objects.new(name, curves)
    new.parent, new.parent_type, new.parent_bone = obj.parent, obj.parent_type, obj.parent_bone
    new.matrix_parent_inverse, new.matrix_basis = obj.matrix_parent_inverse, obj.matrix_basis
    collection.objects.link(new)
    return new


def replace_strands(obj: bpy.types.Object, strands: StrandSet) -> None:
    """Give `obj` other strands; surface, materials, name and place stay."""
    old = obj.data
    new = new_curves(old.name, strands, obj.matrix_world.inverted())
    new.surface, new.surface_uv_map = old.surface, old.surface_uv_map
    for material in old.materials:
        new.materials.append(material)
    obj.data = new
    if old.users == 0:
        name = old.name
        bpy.data.hair_curves.remove(old)
        new.name = name


def write_strand_ints(obj: bpy.types.Object, name: str, values: np.ndarray) -> None:
    """One int32 a strand, as attribute `name`."""
    write_attribute(obj.data, name, "INT", "CURVE", values)
    obj.data.update_tag()


def write_strand_colors(obj: bpy.types.Object, name: str, colors: np.ndarray) -> None:
    """One linear RGBA float32 color a strand, (S, 4), as attribute `name`."""
    write_attribute(obj.data, name, "FLOAT_COLOR", "CURVE", colors)
    obj.data.update_tag()


def attach(obj: bpy.types.Object, head: bpy.types.Object, uv_map: str, uv: np.ndarray) -> None:
    """Hang the curves on the head: surface, UV map, root coordinates (S, 2) float32, and parent; nothing moves."""
    curves = obj.data
    curves.surface = head
    curves.surface_uv_map = uv_map
    if len(curves.curves):
        write_attribute(curves, SURFACE_UV, "FLOAT2", "CURVE", uv)
    if obj.parent is not head:
        world = obj.matrix_world.copy()
        obj.parent = head
        obj.matrix_parent_inverse = head.matrix_world.inverted()
        obj.matrix_basis = world
    curves.update_tag()


def read_roots(grooms: list[bpy.types.Object]) -> np.ndarray:
    """(S, 3) float32 roots of several Curves objects together, world space, metres."""
    return np.concatenate([read_strands(groom).roots for groom in grooms])


def number_strands(obj: bpy.types.Object, name: str) -> None:
    """Give each strand its own index as attribute `name`."""
    write_strand_ints(obj, name, np.arange(len(obj.data.curves), dtype=np.int32))
