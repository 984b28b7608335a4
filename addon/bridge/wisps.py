"""Wisps on Curves: one integer attribute a level, colours to see them by, center strands."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from ..backend.errors import require
from . import attributes, curves

_GOLDEN_TURN = 0.618033988749895  # hues of successive wisps that differ most


def attribute_name(level: int) -> str:
    """`hairloom_wisp` for level 1, `hairloom_wisp_2` for the next coarser one, and so on."""
    return "hairloom_wisp" if level == 1 else f"hairloom_wisp_{level}"


def clustered_levels(data: bpy.types.Curves) -> int:
    """How many levels of wisps the curves carry."""
    level = 0
    while attribute_name(level + 1) in data.attributes:
        level += 1
    return level


def write_labels(groom: bpy.types.Object, labels: Sequence[np.ndarray]) -> None:
    """Write the wisp of each strand, (S,) int32 per level, finest first; levels that are no more are removed."""
    stale = clustered_levels(groom.data)
    for level, of_strand in enumerate(labels, 1):
        curves.write_strand_ints(groom, attribute_name(level), of_strand)
    for level in range(len(labels) + 1, stale + 1):
        groom.data.attributes.remove(groom.data.attributes[attribute_name(level)])


def read_labels(groom: bpy.types.Object, level: int) -> np.ndarray:
    """(S,) int32.

    Raises
    ------
    InputError : the groom has no wisps of that level.
    """
    name = attribute_name(level)
    require(
        name in groom.data.attributes,
        f"'{groom.name}' has {clustered_levels(groom.data)} levels of wisps, not {level}; run Cluster Wisps, or choose "
        "another level",
    )
    return attributes.read_attribute(groom.data.attributes[name])


def wisp_colors(labels: np.ndarray) -> np.ndarray:
    """(S, 4) float32 linear RGBA: one strong colour a wisp, neighbours in number far apart in hue."""
    index = labels.astype(np.float64)
    hue = (index * _GOLDEN_TURN) % 1.0
    value = 0.25 + 0.5 * ((index * 0.381966) % 1.0)
    offsets = np.array([0.0, 2.0 / 3.0, 1.0 / 3.0])
    ramps = np.clip(np.abs(((hue[:, None] + offsets) % 1.0) * 6.0 - 3.0) - 1.0, 0.0, 1.0)
    rgb = value[:, None] * (1.0 - 0.95 * (1.0 - ramps))
    return np.concatenate([rgb, np.ones((len(labels), 1))], axis=1).astype(np.float32)


def show_colors(groom: bpy.types.Object, level: int, name: str) -> int:
    """Write the colours of a level's wisps as attribute `name`; returns the number of wisps."""
    labels = read_labels(groom, level)
    curves.write_strand_colors(groom, name, wisp_colors(labels))
    return int(labels.max()) + 1
