"""The inputs of jobs, read out of the scene."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ..backend.errors import require
from ..backend.types import Head, StrandSet
from . import attributes, curves, mesh

DEFAULT_RADIUS = 4e-5  # metres; a human hair is 0.05 to 0.1 mm thick


def strands_and_head(sources: dict[str, bpy.types.Object]) -> dict[str, Any]:
    """`strands` of the groom and `head` with its scalp, world space, metres.

    Raises
    ------
    InputError : the head has no scalp region.
    """
    return {"head": read_scalp(sources["head"]), "strands": curves.read_strands(sources["groom"])}


def read_scalp(head_object: bpy.types.Object) -> Head:
    """The head with its scalp, world space.

    Raises
    ------
    InputError : the head has no scalp region.
    """
    group = bpy.context.scene.hairloom.scalp_group
    head = mesh.read_head(head_object, group)
    require(
        head.scalp.any(),
        f"'{head_object.name}' has no scalp: no face is in '{group}'; run Set Up Head, or paint that vertex group",
    )
    return head


def synthesis_inputs(sources: dict[str, bpy.types.Object]) -> dict[str, Any]:
    """`strands_and_head`, and the `region` where the new hair grows; None is the scalp.

    Raises
    ------
    InputError : the head has no scalp or UV map, or no such region.
    """
    inputs = strands_and_head(sources)
    mesh.active_uv_map(sources["head"])
    name = bpy.context.scene.hairloom.region_group
    inputs["region"] = mesh.read_region(sources["head"], name) if name else None
    return inputs


def with_radius_of(example: bpy.types.Object, strands: StrandSet) -> StrandSet:
    """`strands` with the example's usual radius, tapering to the tip, where they have none of their own."""
    if "radius" in strands.point_attributes:
        return strands
    usual = DEFAULT_RADIUS
    known = example.data.attributes.get("radius")
    if known is not None and len(known.data):
        usual = float(np.median(attributes.read_attribute(known))) or DEFAULT_RADIUS
    counts = strands.point_counts
    along = np.arange(len(strands.points)) - np.repeat(strands.offsets[:-1], counts)
    taper = 1.0 - 0.6 * along / np.maximum(np.repeat(counts, counts) - 1, 1)
    radius = {"radius": (usual * taper).astype(np.float32)}
    return StrandSet(strands.points, strands.offsets, {**strands.point_attributes, **radius}, strands.strand_attributes)
