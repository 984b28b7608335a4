"""Flows on Curves: extracting one from a groom, keeping the hair's details as attributes, and moving the hair along."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ..backend.editing import flow as backend
from ..backend.errors import require
from ..backend.types import StrandSet
from ..flow_link import FLOW, HEADING, LENGTH, NORMAL, OFFSET, PLACE, REACH, STEP, TANGENT, WIDTH
from . import attachment, attributes, curves, wisps

# name: type and domain, as Blender calls them
_OF_GROOM = {
    FLOW: ("INT", "CURVE"),
    PLACE: ("FLOAT", "POINT"),
    OFFSET: ("FLOAT_VECTOR", "POINT"),
    STEP: ("FLOAT", "POINT"),
    REACH: ("FLOAT", "CURVE"),
    HEADING: ("FLOAT_VECTOR", "CURVE"),
}
_OF_FLOW = {
    FLOW: ("INT", "CURVE"),
    NORMAL: ("FLOAT_VECTOR", "CURVE"),
    TANGENT: ("FLOAT_VECTOR", "CURVE"),
    WIDTH: ("FLOAT", "CURVE"),
    LENGTH: ("FLOAT", "CURVE"),
}


@dataclass(frozen=True, slots=True)
class Applied:
    """What Apply Flow did: strands laid anew, and strands that stayed for want of their flow strand."""

    n_moved: int
    n_missing: int


def extract(groom: bpy.types.Object, level: int, n_points: int, collection: bpy.types.Collection) -> bpy.types.Object:
    """A new object with the flow of a level of wisps, and the groom bound to it; the hair does not move.

    Raises
    ------
    InputError : no wisps of that level, or strands that cannot be used; nothing was changed.
    """
    strands = curves.read_strands(groom)
    flow, binding = backend.extract_flow(strands, wisps.read_labels(groom, level), n_points)
    # the object's axes are the world's now, so its vectors are those of the world
    values = {FLOW: flow.ids, NORMAL: flow.normals, TANGENT: flow.tangents, WIDTH: flow.widths, LENGTH: flow.lengths}
    plain = StrandSet(flow.strands.points, flow.strands.offsets, {}, values)
    obj = curves.new_object(f"{groom.name} Flow", plain, collection)
    _hang_like(obj, groom)
    _hide_in_renders(obj)
    arrays = {FLOW: binding.ids, PLACE: binding.places, OFFSET: binding.offsets, STEP: binding.steps}
    _write(groom.data, {**arrays, **_in_object_axes(groom, backend.strand_marks(strands))})
    groom.hairloom_flow.source = obj
    return obj


def apply(groom: bpy.types.Object, flow: bpy.types.Object, *, discard_edits: bool, follow_length: bool) -> Applied:
    """Lay the groom along its flow; `flow` is an evaluated object, so that its modifiers count.

    Raises
    ------
    InputError : the groom has no binding or was edited since, or `flow` is not its flow; nothing was changed.
    """
    state = _open(groom, discard_edits=discard_edits)
    n_moved = state.session.update(_read_flow(flow), follow_length=follow_length)
    _write_points(groom, state)
    return Applied(n_moved, state.session.n_missing)


class Follower:
    """A groom that follows its flow live: what was read of both stays, and only what changed is laid anew."""

    def __init__(self) -> None:
        self._state: _Opened | None = None
        self._seen: tuple[Any, ...] = ()

    def follow(self, groom: bpy.types.Object, flow: bpy.types.Object, *, follow_length: bool) -> bool:
        """`apply` where something changed since the last call; False when nothing did.

        Raises
        ------
        InputError : as `apply` without `discard_edits`.
        """
        current = _read_flow(flow)
        relation = np.linalg.inv(_matrix(groom)) @ _matrix(flow)
        seen = (_positions(flow), relation, follow_length)
        is_valid = self._state is not None and self._state.is_current(groom)
        if is_valid and self._seen and _same(self._seen, seen):
            return False
        if not is_valid or not np.array_equal(self._state.matrix, _matrix(groom)):
            self._state = _open(groom, discard_edits=False)
        n_moved = self._state.session.update(current, follow_length=follow_length)
        self._seen = seen
        if n_moved:
            _write_points(groom, self._state)
        return n_moved > 0


@dataclass(slots=True)
class _Opened:
    """A groom whose binding was read; `written` is its object-space positions, (P, 3) float32.

    Where the object's space is the world's, `written` is the session's own array: it is written after every update.
    """

    session: backend.FlowSession
    matrix: np.ndarray
    written: np.ndarray

    def is_current(self, groom: bpy.types.Object) -> bool:
        """Are the groom's positions still those that were read or written last?"""
        return len(groom.data.points) == len(self.written) and np.array_equal(_positions(groom), self.written)


def _open(groom: bpy.types.Object, *, discard_edits: bool) -> _Opened:
    strands = curves.read_strands(groom)
    found = _read(groom, _OF_GROOM, "has no flow yet; run Extract Flow first")
    binding = backend.FlowBinding(found[FLOW], found[PLACE], found[OFFSET], found[STEP])
    binding.require_fit(strands)
    if not discard_edits:
        marks = _in_object_axes(groom, backend.strand_marks(strands))
        before, after = backend.Marks(found[REACH], found[HEADING]), backend.Marks(marks[REACH], marks[HEADING])
        edited = backend.edited_strands(before, after, strands.point_counts)
        n_edited = int(np.count_nonzero(edited & (binding.ids != backend.UNBOUND)))
        require(
            not n_edited,
            f"{n_edited:,} strands of '{groom.name}' were edited since its flow was extracted or applied; run Extract "
            "Flow again to keep the edits, or Apply Flow with Discard Edits",
        )
    return _Opened(backend.FlowSession(strands, binding), _matrix(groom), _positions(groom))


def _write_points(groom: bpy.types.Object, state: _Opened) -> None:
    """Write the session's points, and the marks of the strands as they are now."""
    points = state.session.points
    to_local = np.linalg.inv(state.matrix)
    local = points
    if not np.array_equal(to_local, np.eye(4)):
        local = np.ascontiguousarray(points @ to_local[:3, :3].T + to_local[:3, 3], dtype=np.float32)
    attributes.write_values(groom.data.position_data, "vector", local, np.float32, 3)
    state.written = local
    _write(groom.data, _in_object_axes(groom, state.session.marks()))


def _in_object_axes(groom: bpy.types.Object, marks: backend.Marks) -> dict[str, np.ndarray]:
    """Marks of world-space strands as attributes; turning the object with its hair is no edit."""
    return {REACH: marks.reaches, HEADING: np.ascontiguousarray(marks.headings @ _rotation(groom), dtype=np.float32)}


def _read_flow(flow: bpy.types.Object) -> backend.Flow:
    """The flow as it is; its vectors turn with the object."""
    require(
        flow.type == "CURVES" and len(flow.data.curves),
        f"'{flow.name}' has no strands; its modifiers must end in hair curves",
    )
    found = _read(flow, _OF_FLOW, "is no flow, or a modifier of it drops the attributes; choose the groom's own flow")
    turn = _rotation(flow).T
    normals, tangents = (np.ascontiguousarray(found[name] @ turn, dtype=np.float32) for name in (NORMAL, TANGENT))
    return backend.Flow(curves.read_strands(flow), found[FLOW], normals, tangents, found[WIDTH], found[LENGTH])


def _read(obj: bpy.types.Object, kinds: Mapping[str, tuple[str, str]], problem: str) -> dict[str, np.ndarray]:
    found = {}
    for name, kind in kinds.items():
        attribute = obj.data.attributes.get(name)
        is_there = attribute is not None and (attribute.data_type, attribute.domain) == kind
        require(is_there, f"'{obj.name}' {problem} ('{name}' is missing)")
        found[name] = attributes.read_attribute(attribute)
    return found


def _write(data: bpy.types.Curves, values: Mapping[str, np.ndarray]) -> None:
    for name, array in values.items():
        attributes.write_attribute(data, name, *_OF_GROOM[name], array)
    data.update_tag()


def _positions(obj: bpy.types.Object) -> np.ndarray:
    """(P, 3) float32, the object's own space."""
    return attributes.read_values(obj.data.position_data, "vector", np.float32, 3)


def _matrix(obj: bpy.types.Object) -> np.ndarray:
    return np.array(obj.matrix_world, np.float64)


def _rotation(obj: bpy.types.Object) -> np.ndarray:
    """(3, 3): the object's rotation in the world, without its scale."""
    left, _, right = np.linalg.svd(_matrix(obj)[:3, :3])
    return left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right


def _same(before: tuple[Any, ...], after: tuple[Any, ...]) -> bool:
    """Is the flow where it was, seen from the groom? Matrices of a common parent differ by rounding."""
    return (
        before[2] == after[2]
        and before[0].shape == after[0].shape
        and np.array_equal(before[0], after[0])
        and np.allclose(before[1], after[1], rtol=0.0, atol=2e-6)
    )


def _hang_like(obj: bpy.types.Object, groom: bpy.types.Object) -> None:
    """Hang the flow where the groom hangs, in place."""
    surface = groom.data.surface
    if surface is not None and surface.data.uv_layers.active is not None:
        attachment.attach_to_head(obj, surface)
    elif groom.parent is not None:
        obj.parent, obj.parent_type, obj.parent_bone = groom.parent, groom.parent_type, groom.parent_bone
        bpy.context.view_layer.update()
        obj.matrix_world = np.eye(4).tolist()


def _hide_in_renders(obj: bpy.types.Object) -> None:
    """Out of pictures by its visibility to rays; hidden in renders, its modifiers would not be run there."""
    for name in ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
        setattr(obj, f"visible_{name}", False)
