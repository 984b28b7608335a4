"""Grooms made by a transfer of details: new ones, and new strands for those that are there."""

from __future__ import annotations

from typing import Any

import bpy

from ..backend.types import StrandSet
from . import attachment, curves
from .inputs import with_radius_of


def new_result(
    name: str, base: bpy.types.Object, head: bpy.types.Object, strands: StrandSet, collection: bpy.types.Collection
) -> bpy.types.Object:
    """A groom on the head of `base`; `strands` are in the order of the base's and have its attributes."""
    obj = curves.new_object(name, with_radius_of(base, strands), collection)
    _attach_like(obj, base, head, strands)
    return obj


def update_result(obj: bpy.types.Object, base: bpy.types.Object, head: bpy.types.Object, strands: StrandSet) -> None:
    """Give a groom made before other strands; its name, place and materials stay."""
    curves.replace_strands(obj, with_radius_of(base, strands))
    _attach_like(obj, base, head, strands)


def _attach_like(obj: bpy.types.Object, base: bpy.types.Object, head: bpy.types.Object, strands: StrandSet) -> None:
    uv: Any = strands.strand_attributes.get(curves.SURFACE_UV)
    if base.data.surface is head and base.data.surface_uv_map and uv is not None:
        curves.attach(obj, head, base.data.surface_uv_map, uv)
    elif head.data.uv_layers.active is not None:
        attachment.attach_to_head(obj, head)
