"""Frames of a simulation cache on Curves: the bulk reads and writes of playback."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..backend.errors import FileError, require
from ..backend.io.sim_cache import CacheReader
from .attributes import read_values, write_attribute, write_values
from .fingerprint import fingerprint

REST = "hairloom_rest_position"  # FLOAT_VECTOR on points: the groom as it was simulated, object space


class Player:
    """Plays one cache on one Curves; keeps no reference to Blender's data.

    Raises
    ------
    FileError : no cache in the folder, or a damaged one.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.reader = CacheReader(folder)
        # made when a frame is shown: until then nobody has compared what the header says with the groom
        self._shown = np.empty((0, 3), np.float32)
        self._scratch = np.empty(0, np.float32)
        self._knows_what_is_shown = False

    def check(self, curves: bpy.types.Curves) -> None:
        """Can this cache be played on these Curves?

        Raises
        ------
        FileError : the file is gone, or has no frame yet. InputError : another number of points.
        """
        self.reader.refresh()
        n_cached, n_points = self.reader.n_points, len(curves.points)
        require(
            n_cached == n_points,
            f"The cache is of {n_cached:,} points, '{curves.name}' has {n_points:,}: strands were added or removed. "
            "Simulate again, or free the cache",
        )
        if not self.reader.n_frames:
            raise FileError(f"the cache {self.folder} has no whole frame yet; simulate again")

    def show(self, curves: bpy.types.Curves, frame: float) -> None:
        """Write the positions of `frame`, a number of the scene's, between frames too; `check` comes first."""
        self._read(frame)
        write_values(curves.position_data, "vector", self._shown, np.float32, 3)
        curves.update_tag()
        self._knows_what_is_shown = True

    def learn(self, curves: bpy.types.Curves, frame: float) -> None:
        """After loading and undo: are the positions those of `frame`? Then later edits can be told."""
        self._read(frame)
        self._knows_what_is_shown = True
        self._knows_what_is_shown = not self.is_edited(curves)

    def _read(self, frame: float) -> None:
        self._knows_what_is_shown = False
        if not self._shown.size:
            self._shown = np.empty((self.reader.n_points, 3), np.float32)
        self.reader.frame(frame, self._shown)

    def is_edited(self, curves: bpy.types.Curves) -> bool:
        """Are the positions others than this player wrote last? Not, as long as it does not know."""
        if not self._knows_what_is_shown or len(curves.points) != len(self._shown):
            return False
        if not self._scratch.size:
            self._scratch = np.empty(self._shown.size, np.float32)
        curves.position_data.foreach_get("vector", self._scratch)
        return not np.array_equal(self._scratch, self._shown.reshape(-1))

    def close(self) -> None:
        self.reader.close()


def positions(curves: bpy.types.Curves) -> np.ndarray:
    """(P, 3) float32, object space, as the curves are now."""
    if not len(curves.points):
        return np.empty((0, 3), np.float32)
    return read_values(curves.position_data, "vector", np.float32, 3)


def rest(curves: bpy.types.Curves) -> np.ndarray | None:
    """(P, 3) float32, object space: the kept rest positions; None where there are none."""
    attribute = curves.attributes.get(REST)
    if attribute is None or (attribute.data_type, attribute.domain) != ("FLOAT_VECTOR", "POINT"):
        return None
    return read_values(attribute.data, "vector", np.float32, 3)


def keep_rest(curves: bpy.types.Curves) -> None:
    """Keep the positions as they are now as rest positions."""
    write_attribute(curves, REST, "FLOAT_VECTOR", "POINT", positions(curves))


def drop_rest(curves: bpy.types.Curves) -> None:
    attribute = curves.attributes.get(REST)
    if attribute is not None:
        curves.attributes.remove(attribute)


def show_rest(curves: bpy.types.Curves) -> None:
    """Put the curves back to their rest positions, where they have some."""
    kept = rest(curves)
    if kept is not None:
        write_values(curves.position_data, "vector", kept, np.float32, 3)
        curves.update_tag()


def groom_fingerprint(curves: bpy.types.Curves) -> str:
    """Of what is simulated: the strands' points at rest, and which strands are guides of which."""
    kept = rest(curves)
    digest = hashlib.blake2b(digest_size=12)
    digest.update(np.ascontiguousarray(positions(curves) if kept is None else kept))
    if len(curves.curves):
        digest.update(read_values(curves.curve_offset_data, "value", np.int32))
    for name, dtype in (("hairloom_guide", np.bool_), ("hairloom_guide_of", np.int32)):
        attribute = curves.attributes.get(name)
        if attribute is not None and attribute.domain == "CURVE" and len(attribute.data):
            digest.update(read_values(attribute.data, "value", dtype))
    return digest.hexdigest()


def settings_fingerprint(params: dict[str, Any]) -> str:
    """Of the settings of the simulation."""
    return fingerprint(params)[:12]
