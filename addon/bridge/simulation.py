"""The inputs of the simulation, read out of the scene: the groom at rest, its guides, and what happens to it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np

from .. import air, playback
from ..backend.errors import require
from ..backend.rods.scene import Scene
from ..backend.types import StrandSet
from . import attributes, curves, force_fields, guides, inputs, wisps
from .motion import MeshTrack, ObjectTrack, common_motion, frames_kept

Values = dict[str, Any]


@dataclass(frozen=True, slots=True)
class SceneReading:
    """What was read.

    strands : world space at the first frame, metres. object_motion : (F, 4, 4) float64, the groom's own space to that.
    remarks : what acts otherwise than in Blender or not at all.
    """

    strands: StrandSet
    scene: Scene
    object_motion: np.ndarray
    remarks: tuple[str, ...]


def rest_strands(groom: bpy.types.Object, unit: float = 1.0) -> StrandSet:
    """The groom as the artist made it, not as a cache moves it, in world space at the current frame, metres."""
    strands = curves.read_strands(groom)
    at_rest = playback.rest_positions(groom)
    points = strands.points if at_rest is None else curves.transformed(at_rest, groom.matrix_world)
    if unit != 1.0:
        points = (points * unit).astype(np.float32)
    return StrandSet(points, strands.offsets, strands.point_attributes, strands.strand_attributes)


def own_positions(groom: bpy.types.Object) -> dict[str, np.ndarray]:
    """What the artist made, in the object's own space, wherever the object is now: positions and strand offsets."""
    at_rest = playback.rest_positions(groom)
    if at_rest is None:
        at_rest = attributes.read_values(groom.data.position_data, "vector", np.float32, 3)
    return {"points": at_rest, "offsets": attributes.read_values(groom.data.curve_offset_data, "value", np.int32)}


def guide_inputs(sources: dict[str, bpy.types.Object]) -> Values:
    """The inputs of the job `make_guides`: the strands, and their wisps or the head that tells wisps.

    Raises
    ------
    InputError : no wisps where they are to be taken, or no scalp.
    """
    unit, groom = air.metres_per_unit(bpy.context.scene), sources["groom"]
    strands = _shape_alone(rest_strands(groom, unit))
    if bpy.context.scene.hairloom.simulation.guides_from_wisps:
        return {"strands": strands, "labels": wisps.read_labels(groom, 1)}
    head = inputs.read_scalp(sources["head"])
    return {"strands": strands, "head": replace(head, vertices=(head.vertices * unit).astype(np.float32))}


def fit_inputs(groom: bpy.types.Object) -> Values:
    """The inputs of the job `fit_helices`: the guides.

    Raises
    ------
    InputError : the groom has no guides, or they do not fit its strands.
    """
    strands = rest_strands(groom, air.metres_per_unit(bpy.context.scene))
    return {"strands": _shape_alone(guides.guide_strands(groom, strands))}


def _shape_alone(strands: StrandSet) -> StrandSet:
    """Without attributes, which neither change the result nor need to travel."""
    return StrandSet(strands.points, strands.offsets)


def read_scene(
    context: bpy.types.Context,
    groom: bpy.types.Object,
    head: bpy.types.Object | None,
    colliders: list[bpy.types.Object],
    *,
    friction: float,
    air_speed: float,
    collide_head: bool = True,
) -> SceneReading:
    """Visit the frames of the scene's range and read what moves; the current frame is kept.

    The roots move with the head's surface where it bends or moves apart from the groom, else with the groom's object.
    `friction` is that of the colliders; `air_speed` m/s is what a field of strength 1 makes of the air.

    Raises
    ------
    InputError : one frame alone, a groom without strands, a collider without faces or of changing topology.
    """
    scene = context.scene
    first, last = scene.frame_start, scene.frame_end
    require(last > first, f"the scene has {last - first + 1} frame; set its end frame, the hair moves over its range")
    require(len(groom.data.curves), f"'{groom.name}' has no strands; choose a groom that has")
    unit = air.metres_per_unit(scene)
    object_track = ObjectTrack(groom, unit)
    head_track = MeshTrack(head, unit) if head is not None else None
    others = [MeshTrack(obj, unit) for obj in colliders if obj is not head]
    fields, remarks = force_fields.tracks(context, unit, air_speed)
    tracks = [object_track, *([head_track] if head_track else []), *others, *fields]
    with frames_kept(scene):
        for frame in range(first, last + 1):
            scene.frame_set(frame)
            for track in tracks:
                track.record(frame)
            if frame == first:
                strands = rest_strands(groom, unit)
    solid = [*([head_track] if head_track and collide_head else []), *others]
    motion, root_motion = _motion_of_roots(object_track, head_track, strands.roots)
    found = Scene(
        fps=scene.render.fps / scene.render.fps_base,
        motion=motion,
        frame_start=first,
        root_motion=root_motion,
        colliders=tuple(track.collision_mesh(friction) for track in solid),
        fields=tuple(track.force_field() for track in fields),
        gravity=np.array(air.gravity(scene)),
    )
    return SceneReading(strands, found, object_track.from_object(), (*remarks, *_moved_twice(groom)))


def _motion_of_roots(groom: ObjectTrack, head: MeshTrack | None, roots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(F, 4, 4) what all roots (S, 3) sit on, and (F, S, 3, 4) their own motion where that is not enough."""
    none = np.zeros((0, 0, 3, 4))
    if head is None:
        return groom.matrices(), none
    if not head.is_deforming:
        return head.matrices(), none
    root_motion = head.root_motion(roots)
    common = common_motion(root_motion, roots)
    return (common, none) if common is not None else (head.matrices(), root_motion)


def _moved_twice(groom: bpy.types.Object) -> list[str]:
    """Modifiers that carry hair along with the surface, which what is simulated does already."""
    return [
        f"the modifier '{modifier.name}' moves the hair along with the head a second time: switch it off"
        for modifier in groom.modifiers
        if modifier.type == "NODES" and modifier.show_viewport and modifier.node_group is not None
        if any(node.bl_idname == "GeometryNodeDeformCurvesOnSurface" for node in modifier.node_group.nodes)
    ]


def simulation_inputs(reading: SceneReading, groom: bpy.types.Object) -> Values:
    """The inputs of the job `simulate`.

    Raises
    ------
    InputError : the groom has no guides, or they do not fit its strands.
    """
    chosen, number = guides.read_guides(groom)
    return {
        "strands": _shape_alone(reading.strands),
        "guides": chosen,
        "wisps": number,
        "scene": reading.scene,
        "object_motion": reading.object_motion,
    }
