"""Helices as something to look at: a Curves object that follows them, with their break points marked."""

from __future__ import annotations

import bpy
import numpy as np

from .. import material
from ..backend.rods.helices import Helices, evaluate
from ..backend.types import StrandSet
from . import attributes, curves

BREAK = "hairloom_break"
POINTS_PER_ELEMENT = 8
_LINE, _MARK = (0.02, 0.12, 0.6, 1.0), (1.0, 0.2, 0.01, 1.0)
_RADIUS = 2e-4  # metres
_MARK_SIZE = 1.2e-3  # metres from a break point to the ends of its star


def overlay_strands(helices: Helices) -> StrandSet:
    """The helices as strands, POINTS_PER_ELEMENT points an element and the root, then a star of three short strands at
    each break point, where two elements meet: strands are what every version of Blender draws.

    Point attributes: `hairloom_break` bool, the points of helices that are break points; radius and colour.
    """
    elements = _single_elements(helices)
    steps, _ = evaluate(elements, POINTS_PER_ELEMENT + 1)
    counts = POINTS_PER_ELEMENT * helices.element_counts + 1
    ends = np.cumsum(counts)
    starts = ends - counts
    is_root = np.zeros(ends[-1], np.bool_)
    is_root[starts] = True
    points = np.empty((ends[-1], 3), np.float32)
    points[is_root] = helices.roots
    points[~is_root] = steps[:, 1:].reshape(-1, 3)
    along = np.arange(ends[-1]) - np.repeat(starts, counts)
    is_break = along % POINTS_PER_ELEMENT == 0
    is_break[starts] = is_break[ends - 1] = False
    stars = _stars(points[is_break])
    is_star = np.arange(len(points) + len(stars)) >= len(points)
    per_strand = np.concatenate([counts, np.full(len(stars) // 2, 2)])
    shown = {
        BREAK: np.concatenate([is_break, np.zeros(len(stars), np.bool_)]),
        "radius": np.full(len(is_star), _RADIUS, np.float32),
        material.WISP_COLOR: np.where(is_star[:, None], _MARK, _LINE).astype(np.float32),
    }
    offsets = np.concatenate([[0], np.cumsum(per_strand)]).astype(np.int32)
    return StrandSet(np.concatenate([points, stars]), offsets, shown)


def _stars(places: np.ndarray) -> np.ndarray:
    """(6 n, 3) float32: three strands of two points along the axes through each place (n, 3)."""
    ways = _MARK_SIZE * np.stack([-np.eye(3), np.eye(3)], axis=1)
    return (places[:, None, None] + ways).reshape(-1, 3).astype(np.float32)


def _single_elements(helices: Helices) -> Helices:
    """Each element as a strand of its own, (E) strands."""
    first, counts = helices.offsets[:-1], helices.element_counts
    roots, frames = np.empty((len(helices.lengths), 3)), np.empty((len(helices.lengths), 3, 3))
    roots[first], frames[first] = helices.roots, helices.frames
    # one over the elements of a strand, at most a few dozen: each starts where the one before ends
    for place in range(1, int(counts.max(initial=0))):
        before = (first + place - 1)[counts > place]
        one = _strands_of(helices, before, roots, frames)
        ends, turns = evaluate(one, 2)
        roots[before + 1], frames[before + 1] = ends[:, 1], turns[:, 1]
    return _strands_of(helices, np.arange(len(helices.lengths)), roots, frames)


def _strands_of(helices: Helices, elements: np.ndarray, roots: np.ndarray, frames: np.ndarray) -> Helices:
    return Helices(
        roots=np.ascontiguousarray(roots[elements]),
        frames=np.ascontiguousarray(frames[elements]),
        offsets=np.arange(len(elements) + 1, dtype=np.int32),
        lengths=helices.lengths[elements],
        curvatures=helices.curvatures[elements],
    )


def show_helices(groom: bpy.types.Object, helices: Helices, metres_per_unit: float) -> bpy.types.Object:
    """An object that shows helices (world space, metres) and moves with the groom; the one from before is replaced."""
    strands = overlay_strands(helices)
    radius = strands.point_attributes["radius"] / metres_per_unit
    strands = StrandSet(
        (strands.points / metres_per_unit).astype(np.float32),
        strands.offsets,
        {**strands.point_attributes, "radius": radius.astype(np.float32)},
    )
    obj = groom.hairloom_simulation.helices
    data = curves.new_curves(f"{groom.name} Helices", strands, groom.matrix_world.inverted())
    data.materials.append(material.wisp_material())
    # a duplicate of the groom still names the original's
    if obj is None or obj.parent is not groom or obj.name not in bpy.context.scene.objects:
        obj = bpy.data.objects.new(f"{groom.name} Helices", data)
        for collection in groom.users_collection:
            collection.objects.link(obj)
    else:
        old, obj.data = obj.data, data
        if old.users == 0:
            bpy.data.hair_curves.remove(old)
    obj.parent, obj.hide_render, obj.hide_select = groom, True, True
    groom.hairloom_simulation.helices = obj
    return obj


def break_points(obj: bpy.types.Object) -> np.ndarray:
    """(n, 3) float32, the object's space: the break points that an overlay shows."""
    shown = attributes.read_attribute(obj.data.attributes[BREAK])
    return attributes.read_values(obj.data.position_data, "vector", np.float32, 3)[shown]
