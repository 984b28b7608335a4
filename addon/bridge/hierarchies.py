"""The inputs of the detail transfer, and the wisp hierarchies that were found before, so that none is found twice.

A hierarchy is kept under a fingerprint of what it was made from: strands, head and settings of the clustering. A groom
that was edited has another fingerprint, so its wisps are found anew without anybody's asking.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import bpy

from ..backend.errors import require
from ..backend.geometry.scalp_space import ScalpSpace, fit_scalp_space
from ..backend.types import Head, StrandSet, WispHierarchy
from .fingerprint import fingerprint
from .inputs import strands_and_head

Values = dict[str, Any]
_MAX_POINTS = 30_000_000  # of all hierarchies that are kept; 12 bytes each
_CLUSTERING = ("n_samples", "hierarchy")  # the settings of the synthesis that the hierarchy depends on


@dataclass(frozen=True, slots=True)
class Analysis:
    """A hierarchy and the scalp space of the head it is on."""

    hierarchy: WispHierarchy
    space: ScalpSpace | None

    @property
    def n_points(self) -> int:
        return sum(level.n_strands * level.n_points for level in self.hierarchy.levels)


@dataclass(frozen=True, slots=True)
class Groom:
    """A groom as the scene has it.

    shape : fingerprint of strands and head. key : the one under which the hierarchy is or will be kept.
    was_edited : the shape is not that of the last time.
    """

    name: str
    session_uid: int
    strands: StrandSet
    head: Head
    shape: str
    key: str
    was_edited: bool


_kept: OrderedDict[str, Analysis] = OrderedDict()
_shapes: dict[int, str] = {}  # by the object's session number, the fingerprint of strands and head when last analysed


def read_groom(obj: bpy.types.Object, head_object: bpy.types.Object, analysis: Mapping[str, Any]) -> Groom:
    """A groom and its head, `analysis` being the settings of the clustering.

    Raises
    ------
    InputError : a groom without strands, a head without faces or scalp.
    """
    found = strands_and_head({"groom": obj, "head": head_object})
    strands, head = found["strands"], found["head"]
    require(strands.n_strands, f"'{obj.name}' has no strands; choose a groom that has")
    shape = fingerprint({
        "points": strands.points, "offsets": strands.offsets, "vertices": head.vertices, "triangles": head.triangles,
        "scalp": head.scalp,
    })  # fmt: skip
    was_edited = _shapes.get(obj.session_uid, shape) != shape
    key = fingerprint({"shape": shape, **{name: analysis[name] for name in _CLUSTERING}})
    return Groom(obj.name, obj.session_uid, strands, head, shape, key, was_edited)


def kept(groom: Groom) -> Analysis | None:
    """The groom's hierarchy if it was found before."""
    found = _kept.get(groom.key)
    if found is not None:
        _kept.move_to_end(groom.key)
    return found


def keep(groom: Groom, hierarchy: WispHierarchy, space: ScalpSpace | None) -> None:
    """Keep a hierarchy; the ones that were used longest ago go when they get too many."""
    _shapes[groom.session_uid] = groom.shape
    known = _kept.pop(groom.key, None)
    _kept[groom.key] = Analysis(hierarchy, space if space is not None or known is None else known.space)
    while len(_kept) > 2 and sum(analysis.n_points for analysis in _kept.values()) > _MAX_POINTS:
        _kept.popitem(last=False)


def space_of(groom: Groom) -> ScalpSpace:
    """The scalp space of the groom's head."""
    found = kept(groom)
    if found is None or found.space is None:
        return fit_scalp_space(groom.head)
    return found.space


@dataclass(frozen=True, slots=True)
class Transfer:
    """A transfer that is about to run: the grooms it reads, the job's inputs, the settings of the clustering.

    source : the groom with the details; None where they come from a saved detail.
    """

    source: Groom | None
    base: Groom
    inputs: Values
    analysis: Mapping[str, Any]

    @property
    def needs_clustering(self) -> bool:
        return "detail_hierarchy" not in self.inputs or "base_hierarchy" not in self.inputs

    def keep(self, outputs: Values) -> None:
        """Keep the hierarchies that the job found."""
        if self.source is not None:
            keep(self.source, outputs["detail_hierarchy"], None)
        keep(self.base, outputs["base_hierarchy"], outputs["base_space"])

    def remarks(self) -> str:
        """What the user should know of the grooms, in front of a report; '' for nothing."""
        grooms = {groom.name: groom for groom in (self.source, self.base) if groom is not None}
        edited = [f"'{name}'" for name, groom in grooms.items() if groom.was_edited]
        if not edited:
            return ""
        return f"{' and '.join(edited)} changed since: the wisps were found anew. "


def prepare_transfer(
    source: tuple[bpy.types.Object, bpy.types.Object] | WispHierarchy,
    base: tuple[bpy.types.Object, bpy.types.Object],
    analysis: Mapping[str, Any],
) -> Transfer:
    """The inputs of the job `transfer_details`, with hierarchies where they are known already.

    Parameters
    ----------
    source : a groom with its head, or the hierarchy of a saved detail.
    base : the groom that gets the details, with its head.

    Raises
    ------
    InputError : as `read_groom`.
    """
    inputs: Values = {}
    source_groom = None
    if isinstance(source, WispHierarchy):
        inputs["detail_hierarchy"] = source
    else:
        source_groom = read_groom(*source, analysis)
        found = kept(source_groom)
        if found is not None:
            inputs["detail_hierarchy"] = found.hierarchy
        else:
            inputs |= {"detail_strands": _bare(source_groom.strands), "detail_head": source_groom.head}
    base_groom = read_groom(*base, analysis)
    inputs["base_strands"] = base_groom.strands
    found = kept(base_groom)
    if found is not None and found.space is not None:
        inputs |= {"base_hierarchy": found.hierarchy, "base_space": found.space}
    else:
        inputs["base_head"] = base_groom.head
    return Transfer(source_groom, base_groom, inputs, analysis)


def _bare(strands: StrandSet) -> StrandSet:
    """Without attributes, which the job has no use for."""
    return StrandSet(strands.points, strands.offsets)


def clear() -> None:
    """Forget all hierarchies."""
    _kept.clear()
    _shapes.clear()
