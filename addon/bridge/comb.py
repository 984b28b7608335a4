"""The comb on a groom: its session in world space, its positions in the object's, and what it collides with."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np

from .. import comb_cache
from ..backend.editing.comb import CombSession
from ..backend.editing.object_space import return_to_object
from ..backend.editing.strokes import CombParams, Stroke, View, comb_params, stroke_from_json, stroke_to_json
from ..backend.errors import InputError, require
from ..backend.geometry.collider import Collider, comb_collider
from ..backend.types import Head, StrandSet
from . import attributes, curves, mesh, wisps
from .fingerprint import fingerprint
from .view import view_of

_SELECTION = ".selection"  # Blender's own
_ALL = 1.0
# a wisp whose roots lie farther apart than this share of the whole scalp's width is none
_WIDEST_WISP = 0.5


@dataclass(slots=True)
class _KeptSession:
    """The session of the last stroke, for the next one on the same strands."""

    uid: int
    offsets: np.ndarray
    labels: list[np.ndarray]
    collider: Collider | None
    session: CombSession
    warning: str


class LiveStroke:
    """A stroke that is being made on a groom: each move is written into the Curves at once.

    No reference to Blender's data is kept from move to move, since undo and reloading replace it.
    """

    def __init__(
        self,
        groom: bpy.types.Object,
        obstacles: Sequence[bpy.types.Object],
        params: CombParams,
        view: View,
        frame: np.ndarray,
        selection: np.ndarray | None,
    ) -> None:
        """Raises InputError before anything changes, as for a selection among another number of strands."""
        data = groom.data
        self._name, self._uid = data.name, data.session_uid
        self._before = attributes.read_values(data.position_data, "vector", np.float32, 3)
        points = curves.transformed(self._before, groom.matrix_world)
        # in an object at the world's origin world space is the object's, to the bit
        self._is_at_origin = points is self._before
        offsets = attributes.read_values(data.curve_offset_data, "value", np.int32)
        n_strands = len(offsets) - 1
        require(
            selection is None or len(selection) == n_strands,
            f"the stroke selects among {0 if selection is None else len(selection)} strands and '{groom.name}' has "
            f"{n_strands}; use the groom that it was recorded on",
        )
        kept = _session_on(groom, StrandSet(points, offsets), _collider(obstacles, points[offsets[:-1]]))
        self._session, self.warning = kept.session, kept.warning
        self._points_before = points if self._is_at_origin else self._session.points.copy()
        self._world_to_object = np.linalg.inv(np.array(groom.matrix_world, np.float64))
        self._session.begin(params, view, frame, selection)
        self.has_changed = False

    def move(self, x: float, y: float, pressure: float = 1.0) -> bool:
        """Take the brush to a place, pixels from the view's lower left corner; did hair move?

        Raises
        ------
        InputError : the groom is no more, or has other strands by now.
        """
        if not self._session.move(x, y, pressure):
            return False
        self.has_changed = True
        if self._is_at_origin:
            self._write(self._session.points)
        else:
            self._write(
                return_to_object(self._session.points, self._points_before, self._before, self._world_to_object)
            )
        return True

    def cancel(self) -> None:
        """Put every point back where it was, to the bit."""
        self._session.cancel()
        if self.has_changed:
            self._write(self._before)

    def end(self) -> str:
        """The stroke that was made, as JSON."""
        return stroke_to_json(self._session.end())

    def _write(self, positions: np.ndarray) -> None:
        data = bpy.data.hair_curves.get(self._name)
        if data is None or data.session_uid != self._uid or len(data.points) != len(positions):
            raise InputError(f"'{self._name}' was changed by something else during the stroke; comb it again")
        attributes.write_values(data.position_data, "vector", positions, np.float32, 3)
        data.update_tag()


def start_stroke(
    groom: bpy.types.Object,
    settings: bpy.types.PropertyGroup,
    changes: dict[str, object],
    view: tuple[bpy.types.Region, bpy.types.RegionView3D],
    obstacles: Sequence[bpy.types.Object],
) -> LiveStroke:
    """A stroke by the user, seen in a region of a 3D view; `changes` to the settings are for this stroke alone.

    Raises
    ------
    InputError : no strand is selected.
    """
    data = groom.data
    params = comb_params(settings.to_params())
    mirror = (data.use_mirror_x, data.use_mirror_y, data.use_mirror_z)
    params = replace(params, mirror=mirror, **changes)
    frame = np.array(groom.matrix_world, np.float64)
    return LiveStroke(groom, obstacles, params, view_of(*view), frame, read_selection(groom))


def play_stroke(groom: bpy.types.Object, text: str, obstacles: Sequence[bpy.types.Object]) -> LiveStroke:
    """Make a recorded stroke again, from its JSON, as the user made it; it is over when this returns.

    Raises
    ------
    InputError : no stroke, or one for another groom.
    """
    return _play(groom, stroke_from_json(text), obstacles)


def play_strokes(
    groom: bpy.types.Object, strokes: Iterable[Stroke], obstacles: Sequence[bpy.types.Object]
) -> list[str]:
    """Make strokes one after the other, all or none; returns those that moved hair, as JSON."""
    data = groom.data
    before = attributes.read_values(data.position_data, "vector", np.float32, 3)
    try:
        return [stroke_to_json(stroke) for stroke in strokes if _play(groom, stroke, obstacles).has_changed]
    except InputError:
        attributes.write_values(data.position_data, "vector", before, np.float32, 3)
        data.update_tag()
        raise


def _play(groom: bpy.types.Object, stroke: Stroke, obstacles: Sequence[bpy.types.Object]) -> LiveStroke:
    live = LiveStroke(groom, obstacles, stroke.params, stroke.view, stroke.frame, stroke.selection)
    # the samples of one stroke, each of which depends on the one before
    for x, y, pressure in stroke.samples.tolist():
        live.move(x, y, pressure)
    live.end()
    return live


def read_selection(groom: bpy.types.Object) -> np.ndarray | None:
    """(S,) float32 in 0..1: how much of each strand is selected; None where all of it is.

    Raises
    ------
    InputError : no strand is selected.
    """
    data = groom.data
    attribute = data.attributes.get(_SELECTION)
    if attribute is None or attribute.data_type not in {"FLOAT", "BOOLEAN"}:
        return None
    selected = np.clip(attributes.read_attribute(attribute).astype(np.float64), 0.0, 1.0)
    if attribute.domain == "POINT":
        offsets = attributes.read_values(data.curve_offset_data, "value", np.int32)
        selected = np.add.reduceat(selected, offsets[:-1]) / np.diff(offsets)
    require(selected.any(), f"no strand of '{groom.name}' is selected; select some in Sculpt Mode, or all of them")
    return None if (selected == _ALL).all() else selected.astype(np.float32)


def _session_on(groom: bpy.types.Object, strands: StrandSet, collider: Collider | None) -> _KeptSession:
    """A session whose points are the groom's; what does not depend on its shape is kept from the stroke before.

    A session starts each stroke from its points alone, so that a stroke gives the same bytes on a kept one.
    """
    data = groom.data
    labels = [wisps.read_labels(groom, level) for level in range(1, wisps.clustered_levels(data) + 1)]
    kept = comb_cache.kept.get("session")
    if (
        isinstance(kept, _KeptSession)
        and kept.uid == data.session_uid
        and kept.collider is collider
        and np.array_equal(kept.offsets, strands.offsets)
        and np.array_equal(kept.session.points[strands.offsets[:-1]], strands.roots)
        and len(kept.labels) == len(labels)
        and all(np.array_equal(one, other) for one, other in zip(kept.labels, labels))
    ):
        kept.session.points[:] = strands.points
        return kept
    session = CombSession(strands, labels, collider)
    warning = _why_wisps_are_stale(groom.name, strands.roots, labels)
    kept = _KeptSession(data.session_uid, strands.offsets, labels, collider, session, warning)
    comb_cache.kept["session"] = kept
    return kept


def _why_wisps_are_stale(name: str, roots: np.ndarray, labels: Sequence[np.ndarray]) -> str:
    """Joined grooms may have wisps of the same number on both, and strands that were added are all in wisp 0."""
    if not labels or len(roots) < 2:
        return ""
    order = np.argsort(labels[0], kind="stable")
    starts = np.flatnonzero(np.diff(labels[0][order], prepend=-1))
    low, high = (reduce.reduceat(roots[order], starts, axis=0) for reduce in (np.minimum, np.maximum))
    widths = np.linalg.norm(high - low, axis=1)
    wide = int((widths > _WIDEST_WISP * np.linalg.norm(np.ptp(roots, axis=0))).sum())
    if not wide or len(starts) < 4:
        return ""
    return (
        f"{wide:,} wisps of '{name}' reach over half of the head; run Cluster Wisps again after joining or adding hair"
    )


def _collider(obstacles: Sequence[bpy.types.Object], roots: np.ndarray) -> Collider | None:
    """The collider of some meshes as they are now, kept until one of them or the roots (S, 3) change."""
    if not obstacles:
        return None
    heads: list[Head] = [mesh.read_head(obj, "") for obj in obstacles]
    mark = fingerprint({str(i): head for i, head in enumerate(heads)} | {"roots": roots})
    kept_mark, kept = comb_cache.kept.get("collider", ("", None))
    if kept is None or kept_mark != mark:
        kept = comb_collider(heads, roots)
        comb_cache.kept["collider"] = (mark, kept)
    return kept
