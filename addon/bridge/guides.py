"""Guides on Curves: which strands are guides, and whose guide each strand follows.

`hairloom_guide` BOOLEAN marks the guides; `hairloom_guide_of` INT is the guide's number of each strand, guides
included. Numbers, not strand indices, so that strands may be removed and reordered.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..backend.errors import require
from ..backend.geometry.strands import select_strands
from ..backend.types import StrandSet
from . import attributes, curves

GUIDE = "hairloom_guide"
GUIDE_OF = "hairloom_guide_of"


def write_guides(groom: bpy.types.Object, guides: np.ndarray, guide_of: np.ndarray) -> None:
    """Mark guides (G,) int32, strand indices, and each strand's guide number (S,) int32 in 0..G-1."""
    is_guide = np.zeros(len(guide_of), np.bool_)
    is_guide[guides] = True
    attributes.write_attribute(groom.data, GUIDE, "BOOLEAN", "CURVE", is_guide)
    curves.write_strand_ints(groom, GUIDE_OF, guide_of.astype(np.int32, copy=False))


def read_guides(groom: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """The guides (G,) int32, strand indices, and the guide number (S,) int32 in 0..G-1 of each strand.

    Raises
    ------
    InputError : the groom has no guides, or not one for each strand since strands were added, joined or removed.
    """
    found = groom.data.attributes
    require(GUIDE in found and GUIDE_OF in found, f"'{groom.name}' has no guides; run Make Guides first")
    is_guide = attributes.read_attribute(found[GUIDE]).astype(np.bool_)
    _, number = np.unique(attributes.read_attribute(found[GUIDE_OF]), return_inverse=True)
    number = number.reshape(-1).astype(np.int32)
    guides = np.flatnonzero(is_guide).astype(np.int32)
    in_order = guides[np.argsort(number[guides], kind="stable")]
    fits = len(guides) > 0 and np.array_equal(number[in_order], np.arange(number.max() + 1))
    require(fits, f"strands of '{groom.name}' were added, joined or removed since Make Guides; run Make Guides again")
    return in_order, number


def guide_strands(groom: bpy.types.Object, strands: StrandSet) -> StrandSet:
    """The guides among the groom's strands, without our attributes."""
    guides, _ = read_guides(groom)
    chosen = select_strands(strands, guides)
    kept = {name: v for name, v in chosen.strand_attributes.items() if name not in (GUIDE, GUIDE_OF)}
    return StrandSet(chosen.points, chosen.offsets, chosen.point_attributes, kept)


def select_guides(groom: bpy.types.Object) -> int:
    """Select the guides and nothing else, for Blender's tools and for the comb; how many there are."""
    guides, number = read_guides(groom)
    is_guide = np.zeros(len(number), np.bool_)
    is_guide[guides] = True
    groom.data.selection_domain = "CURVE"
    attributes.write_attribute(groom.data, ".selection", "BOOLEAN", "CURVE", is_guide)
    groom.data.update_tag()
    return len(guides)
