"""Grooms made by a transfer of details: new ones, and new strands for those that are there."""

from __future__ import annotations

from typing import Any

import bpy

from ..backend.jobs.cluster_wisps import labels_of_strands
from ..backend.types import StrandSet
from . import attachment, curves, wisps
from .inputs import with_radius_of

Values = dict[str, Any]
_OWN = "hairloom_"  # our attributes tell of the base's strands: its wisps' colours, its flow


def new_result(
    name: str, base: bpy.types.Object, head: bpy.types.Object, outputs: Values, collection: bpy.types.Collection
) -> bpy.types.Object:
    """A groom on the head of `base` from the outputs of the job `transfer_details`, with the base's attributes."""
    obj = curves.new_object(name, _carried(base, outputs["strands"]), collection)
    _finish(obj, base, head, outputs)
    return obj


def update_result(obj: bpy.types.Object, base: bpy.types.Object, head: bpy.types.Object, outputs: Values) -> None:
    """Give a groom made before other strands; its name, place and materials stay."""
    curves.replace_strands(obj, _carried(base, outputs["strands"]))
    _finish(obj, base, head, outputs)


def _carried(base: bpy.types.Object, strands: StrandSet) -> StrandSet:
    per_point, per_strand = (
        {name: values for name, values in attributes.items() if not name.startswith(_OWN)}
        for attributes in (strands.point_attributes, strands.strand_attributes)
    )
    return with_radius_of(base, StrandSet(strands.points, strands.offsets, per_point, per_strand))


def _finish(obj: bpy.types.Object, base: bpy.types.Object, head: bpy.types.Object, outputs: Values) -> None:
    """Attach the groom as the base is, and give it the base's wisps, so that it can be combed at once."""
    wisps.write_labels(obj, labels_of_strands(outputs["base_hierarchy"]))
    uv = outputs["strands"].strand_attributes.get(curves.SURFACE_UV)
    if base.data.surface is head and base.data.surface_uv_map and uv is not None:
        curves.attach(obj, head, base.data.surface_uv_map, uv)
    elif head.data.uv_layers.active is not None:
        attachment.attach_to_head(obj, head)
