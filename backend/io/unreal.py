"""Grooms and groom caches for Unreal: Alembic files with the attributes of its "Alembic for Grooms" schema, 1.5.

    /groom                     version, tool and properties
    /groom/guides_N            guides of group N: groom_guide 1
    /groom/strands_N           strands of group N: closest guides and their weights

Each object says its groom_group_id and groom_group_name once and has groom_id, groom_root_uv and groom_color of its
strands; groom_closest_guides are groom_ids of guides. A groom cache is the same file with moving positions: Unreal
wants groom and cache to have the same strands in the same order.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from ..errors import require
from ..progress import NO_PROGRESS, Progress
from ..types import Bools, Float32, Int32, check_array
from .alembic import UNREAL, AlembicWriter, Axes, CurvesWriter, GeomParam

VERSION_MAJOR, VERSION_MINOR = 1, 5
N_CLOSEST = 3


@dataclass(frozen=True, slots=True)
class UnrealGroom:
    """What does not move of a groom of S strands and P points.

    counts : (S,) int32 points of each strand. widths : (P,) float32 diameters, metres.
    is_guide : (S,) bool; guides are exported as guides beside their strands. groups : (S,) int32, 0 or more.
    group_names : by number; 'group_N' where none is given. root_uv : (S, 2) float32 or None.
    color : (P, 3) float32 linear or None. own_guide : (S,) int32 the strand that is each strand's own guide, or None.
    properties : what made the groom, for people who look into the file.
    """

    counts: Int32
    widths: Float32
    is_guide: Bools
    groups: Int32
    group_names: Mapping[int, str] = field(default_factory=dict)
    root_uv: Float32 | None = None
    color: Float32 | None = None
    own_guide: Int32 | None = None
    properties: str = ""

    def __post_init__(self) -> None:
        check_array("counts", self.counts, np.int32, (None,))
        n_strands = len(self.counts)
        require(n_strands and (self.counts > 0).all(), "the groom has no strands, or one without points")
        n_points = int(self.counts.sum(dtype=np.int64))
        check_array("widths", self.widths, np.float32, (n_points,))
        check_array("is_guide", self.is_guide, np.bool_, (n_strands,))
        check_array("groups", self.groups, np.int32, (n_strands,))
        require((self.groups >= 0).all(), "group numbers must be 0 or more")
        if self.root_uv is not None:
            check_array("root_uv", self.root_uv, np.float32, (n_strands, 2))
        if self.color is not None:
            check_array("color", self.color, np.float32, (n_points, 3))
        if self.own_guide is not None:
            check_array("own_guide", self.own_guide, np.int32, (n_strands,))
            inside = (self.own_guide >= 0) & (self.own_guide < n_strands)
            require(inside.all() and self.is_guide[self.own_guide].all(), "own_guide names a strand that is no guide")

    @property
    def n_points(self) -> int:
        return int(self.counts.sum(dtype=np.int64))


def closest_guides(roots: Float32, guides: Int32, own_guide: Int32 | None = None) -> tuple[Int32, Float32]:
    """The three guides nearest to each root and their weights, by inverse squared distance of the roots.

    Parameters
    ----------
    roots : (S, 3) float32. guides : (G,) int32 strand indices. own_guide : (S,) int32 strand index of a guide that must
        be among the three, as that of the strand's wisp.

    Returns
    -------
    (S, 3) int32 places in `guides`, nearest first, filled up with the first where there are fewer guides;
    (S, 3) float32 weights that sum to 1, 0 for those filled up.
    """
    require(len(guides) > 0, "the groom has no guides; make guides first")
    n_near = min(N_CLOSEST, len(guides))
    distance, near = cKDTree(roots[guides]).query(roots, k=list(range(1, n_near + 1)))
    if own_guide is not None:
        place = np.zeros(len(roots), np.int64)
        place[guides] = np.arange(len(guides))
        own = place[own_guide]
        missing = ~(near == own[:, None]).any(axis=1)
        near[missing, -1] = own[missing]
        distance[missing, -1] = np.linalg.norm(roots[missing] - roots[own_guide[missing]], axis=1)
    # a guide's own strand lies at distance 0; a micrometre keeps its weight finite
    weights = 1.0 / np.maximum(distance, 1e-6) ** 2
    weights /= weights.sum(axis=1, keepdims=True)
    found = np.repeat(near[:, :1], N_CLOSEST, axis=1)
    found[:, :n_near] = near
    filled = np.zeros((len(roots), N_CLOSEST), np.float32)
    filled[:, :n_near] = weights
    return found.astype(np.int32), filled


class _Part:
    """One object of curves of the file, and which of the groom's points it has."""

    def __init__(self, writer: CurvesWriter, points: slice | Int32, widths: Float32) -> None:
        self._writer, self._points = writer, points
        self._widths: Float32 | None = widths

    def write(self, points: Float32) -> None:
        self._writer.write(np.ascontiguousarray(points[self._points]), self._widths)
        self._widths = None  # those of the sample before from now on


def write_unreal(
    path: str | os.PathLike[str],
    groom: UnrealGroom,
    rest: Float32,
    frames: Iterable[Float32] | None = None,
    *,
    fps: float = 24.0,
    frame_start: int = 1,
    axes: Axes = UNREAL,
    guides_only: bool = False,
    tool: str = "Hairloom",
    progress: Progress = NO_PROGRESS,
    n_frames: int = 0,
) -> None:
    """Write a groom, or with `frames` a groom cache.

    Parameters
    ----------
    rest : (P, 3) float32, metres, z up: the groom; its roots tell which guides are closest.
    frames : (P, 3) float32 each, written as they come; a buffer may be used again for the next.
    fps, frame_start : of the frames. guides_only : leave the strands out, as in a cache of guides.
    n_frames : how many frames will come, for the progress.

    Raises
    ------
    InputError : shapes that do not fit, no guides where only those are wanted. FileError : it cannot be written.
    """
    check_array("rest", rest, np.float32, (groom.n_points, 3))
    guides = np.flatnonzero(groom.is_guide).astype(np.int32)
    require(len(guides) or not guides_only, "the groom has no guides to export; make guides first")
    properties = {
        "groom_version_major": np.int16(VERSION_MAJOR), "groom_version_minor": np.int16(VERSION_MINOR),
        "groom_tool": tool, "groom_properties": groom.properties,
    }  # fmt: skip
    is_animated = frames is not None
    with AlembicWriter(path, fps=fps, frame_start=frame_start, axes=axes, tool=tool) as file:
        top = file.add_transform("groom", properties)
        parts = []
        for name, strands, points, params in _objects(groom, rest, guides, axes, guides_only=guides_only):
            counts = groom.counts[strands]
            writer = file.add_curves(name, counts, below=top, params=params, is_animated=is_animated)
            parts.append(_Part(writer, points, groom.widths[points]))
        for number, frame in enumerate([rest] if frames is None else frames):
            progress(number / max(n_frames, number + 1), f"Writing frame {frame_start + number}")
            check_array("a frame", frame, np.float32, (groom.n_points, 3))
            for part in parts:
                part.write(frame)


def _points_of(counts: Int32, strands: Int32) -> slice | Int32:
    """The points of some strands; a slice where they are all."""
    if len(strands) == len(counts):
        return slice(None)
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    lengths = counts[strands]
    within = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    return np.asarray(np.repeat(starts[strands], lengths) + within, np.int32)


def _objects(
    groom: UnrealGroom, rest: Float32, guides: Int32, axes: Axes, *, guides_only: bool
) -> Iterator[tuple[str, Int32, slice | Int32, list[GeomParam]]]:
    """Name, strands, points and attributes of each object: for each group its guides, then its strands."""
    roots = rest[np.cumsum(groom.counts) - groom.counts]
    closest = weights = None
    if len(guides) and not guides_only:
        closest, weights = closest_guides(roots, guides, groom.own_guide)
    for group in np.unique(groom.groups):
        members = groom.groups == group
        own = np.flatnonzero(members[guides]).astype(np.int32)
        if len(own):
            points = _points_of(groom.counts, guides[own])
            yield f"guides_{group}", guides[own], points, _params(groom, guides[own], points, own, axes, 1)
        if not guides_only:
            strands = np.flatnonzero(members).astype(np.int32)
            points = _points_of(groom.counts, strands)
            params = _params(groom, strands, points, (len(guides) + strands).astype(np.int32), axes, 0)
            if closest is not None and weights is not None:
                params.append(GeomParam("groom_closest_guides", "uni", closest[strands], "vector"))
                params.append(GeomParam("groom_guide_weights", "uni", weights[strands], "vector"))
            yield f"strands_{group}", strands, points, params


def _params(
    groom: UnrealGroom, strands: Int32, points: slice | Int32, numbers: Int32, axes: Axes, is_guide: int
) -> list[GeomParam]:
    """The attributes that guides and strands of one group share; `numbers` are their groom_ids."""
    group = int(groom.groups[strands[0]])
    params = [
        GeomParam("groom_guide", "con", np.array([is_guide], np.int16)),
        GeomParam("groom_group_id", "con", np.array([group], np.int32)),
        GeomParam("groom_group_name", "con", [groom.group_names.get(group, f"group_{group}")]),
        GeomParam("groom_id", "uni", numbers),
    ]
    if groom.root_uv is not None:
        params.append(GeomParam("groom_root_uv", "uni", groom.root_uv[strands], "vector"))
    if groom.color is not None:
        params.append(GeomParam("groom_color", "vtx", groom.color[points], "vector"))
    if axes is UNREAL:
        # Unreal scales `width` when it is told to scale an import, but not this; so only where nothing is scaled
        params.append(GeomParam("groom_width", "vtx", groom.widths[points] * np.float32(axes.scale)))
    return params
