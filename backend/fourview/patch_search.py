"""Patch search on a surface: a match in each photo for every patch that it does not show well (Z-16, Z-17, M-35).

PatchMatch (Barnes et al. 2009, 2010) over vertices instead of pixels, after Zhang et al. 2017, sec. 4.3.1: vertices are
visited ring by ring from the top; matches of visited neighbours are carried over through the surface; then candidates
around the match are tried at random.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..types import Bools, Float32, Int32, Int64
from ._patch_kernels import search
from .patch_sources import Sources, UInt32
from .surface import Level

# Runs of the scan order in which the vertices of a view are worked on side by side. A vertex takes what neighbours of
# other runs had before the iteration, so results do not depend on the number of threads.
_RUNS = 16
_KEPT, _NONE = -1, -2  # in `Matches.owner`


@dataclass(frozen=True, slots=True)
class Matches:
    """The matches of V vertices in n views; the arrays are worked on in place.

    position : (n, V, 2) float32, pixel of the source at this scale. transform : (n, V, 2) float32, in-plane rotation
    (radians) and scale. error : (n, V) float32, mean squared difference of a cell, channels added, 8-bit colours.
    owner : (n, V) int32, task that searches the vertex; -1: it keeps its match, its patch lies in S; -2: not needed.
    tasks : (K, 3) int64, view, first and end in targets. targets : (N,) int32, vertices in scan order.
    """

    position: Float32
    transform: Float32
    error: Float32
    owner: Int32
    tasks: Int64
    targets: Int32

    @property
    def n_searched(self) -> int:
        return len(self.targets)


def _runs(level: Level, targets: Bools, kept: Bools) -> tuple[Int32, Int64, Int32]:
    """Owner (n, V), tasks and targets of `Matches`; targets and kept are (n, V) bool."""
    owner = np.where(kept, _KEPT, _NONE).astype(np.int32)
    tasks: list[tuple[int, int, int]] = []
    ordered, first = [], 0
    for view, wanted in enumerate(targets):
        vertices = level.order[wanted[level.order]]
        for run in np.array_split(vertices, min(_RUNS, max(1, len(vertices) // 64))):
            if len(run):
                owner[view, run] = len(tasks)
                tasks.append((view, first, first + len(run)))
                first += len(run)
        ordered.append(vertices)
    found = np.array(tasks, np.int64).reshape(-1, 3)
    return owner, found, np.concatenate(ordered).astype(np.int32)


def start_matches(
    level: Level, sources: Sources, vertex_pixels: Float32, seen: Bools, needed: Bools, seed: int
) -> Matches:
    """Matches before the first scale: the vertex's own pixel where the view sees it well, else one at random.

    vertex_pixels : (n, V, 2) float32, the vertices in the photos. seen, needed : (n, T) bool, the texels that show S,
    and those that are to be synthesised; a patch with any of these is a target.
    """
    n_views, count = len(seen), level.n_vertices
    cells = level.patch_texels
    outside = np.where(cells < 0, True, False)
    position = np.zeros((n_views, count, 2), np.float32)
    transform = np.zeros((n_views, count, 2), np.float32)
    transform[..., 1] = 1
    targets, kept = np.zeros((n_views, count), np.bool_), np.zeros((n_views, count), np.bool_)
    rng = np.random.default_rng(seed)
    middle = cells[:, (level.patch_size // 2) * (level.patch_size + 1)]
    for view in range(n_views):
        first, height, width = sources.frames[view]
        usable = np.flatnonzero(sources.usable[first : first + height * width])
        targets[view] = (needed[view][cells] & ~outside).any(axis=1) & (len(usable) > 0)
        kept[view] = (seen[view][cells] | outside).all(axis=1) & ~outside.all(axis=1) & ~targets[view]
        position[view] = sources.pixels(view, vertex_pixels[view])
        lowest, highest = sources.pad, np.array([width, height]) - sources.pad - 0.01
        position[view] = np.clip(position[view], lowest, highest)
        lost = targets[view] & ~(seen[view][middle] & (middle >= 0))
        if len(usable):
            chosen = usable[rng.integers(0, len(usable), int(lost.sum()))]
            position[view, lost] = np.stack([chosen % width, chosen // width], axis=1) + np.float32(0.5)
    owner, tasks, ordered = _runs(level, targets, kept)
    error = np.zeros((n_views, count), np.float32)
    error[targets] = np.inf
    return Matches(position, transform, error, owner, tasks, ordered)


def carry_to_finer(coarse: Level, before: Matches, old: Sources, fine: Level, start: Matches, new: Sources) -> None:
    """Take the matches of the next coarser scale into `start`: each vertex has that of the nearest, moved along."""
    nearest = cKDTree(coarse.vertices).query(fine.vertices)[1]
    offset = (fine.vertices - coarse.vertices[nearest]) / np.float32(fine.texels.spacing)
    right = (offset * coarse.tangents[nearest]).sum(axis=1)
    down = (offset * coarse.bitangents[nearest]).sum(axis=1)
    for view in range(len(start.owner)):
        usable = (start.owner[view] >= 0) & (before.owner[view, nearest] != _NONE)
        chosen = nearest[usable]
        first, height, width = new.frames[view]
        in_photo = (before.position[view, chosen] - old.pad) / old.scales[view]
        position = new.pixels(view, in_photo)
        transform = before.transform[view, chosen]
        turn = turns(new.jacobians_at(view, position), transform)
        position[:, 0] += turn[:, 0] * right[usable] + turn[:, 1] * down[usable]
        position[:, 1] += turn[:, 2] * right[usable] + turn[:, 3] * down[usable]
        inside = (position >= new.pad).all(axis=1) & (position < np.array([width, height]) - new.pad).all(axis=1)
        pixel = position[inside].astype(np.int64)
        inside[inside] = new.usable[first + pixel[:, 1] * width + pixel[:, 0]]
        vertices = np.flatnonzero(usable)[inside]
        start.position[view, vertices] = position[inside]
        start.transform[view, vertices] = transform[inside]


def turns(jacobian: Float32, transform: Float32) -> Float32:
    """(k, 4) float32: J f as (xx, xy, yx, yy), of (k, 4) and rotation and scale (k, 2)."""
    across = transform[:, 1] * np.cos(transform[:, 0])
    along = transform[:, 1] * np.sin(transform[:, 0])
    columns = [
        jacobian[:, 0] * across + jacobian[:, 1] * along,
        jacobian[:, 1] * across - jacobian[:, 0] * along,
        jacobian[:, 2] * across + jacobian[:, 3] * along,
        jacobian[:, 3] * across - jacobian[:, 2] * along,
    ]
    return np.asarray(np.stack(columns, axis=1), np.float32)


class PatchSearch:
    """Searches of one scale: what stays the same between iterations."""

    def __init__(self, level: Level, sources: Sources, limits: Float32, seed: int) -> None:
        """limits : (3,) float32, the largest rotation (radians), the smallest and the largest in-plane scale."""
        spacing = np.float32(level.texels.spacing)
        self._surface = (
            level.vertices / spacing,
            level.tangents,
            level.bitangents,
            level.neighbour_offsets,
            level.neighbours,
            level.patch_texels,
        )
        self._sources = (sources.images, sources.jacobians, sources.usable, sources.frames)
        self._rank = np.empty(level.n_vertices, np.int32)
        self._rank[level.order] = np.arange(level.n_vertices, dtype=np.int32)
        self._limits = limits
        self._seed = seed

    def improve(self, matches: Matches, texture: UInt32, iteration: int) -> None:
        """One iteration of propagation and random search for `texture` (T,) uint32; iterations count from 1."""
        if not matches.n_searched:
            return
        now = (matches.position, matches.transform, matches.error)
        before = tuple(array.copy() for array in now)
        search(
            self._sources, self._surface, matches.tasks, matches.targets, matches.owner, self._rank, texture, before,
            now, self._limits, iteration, self._seed,
        )  # fmt: skip
