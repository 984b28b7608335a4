"""The detail-preserving comb (Wang et al. 2009, sec. 6; W-U5): strokes deform wisps, and the hair comes along.

The hair under the brush is held through the center strands of its wisps: hair that the brush has come over follows it
across its own direction and lets it slip along (see `strokes.CombParams`). Each step deforms the centers that are held,
and those beside them, from where they are now (`deformation.deform`), so that what was combed stays combed; rotations
add up over the stroke, and every strand keeps its displacement from its center, turned along (`_brush_kernels.carry`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import require
from ..geometry.collider import Collider
from ..geometry.root_graph import RootGraph
from ..progress import NO_PROGRESS, Progress
from ..types import Bools, Float32, Float64, Int32, StrandSet
from ._brush_kernels import carry, front_depths, near_centers, set_lengths, touch, turn_on
from .binding import Binding, bind_strands, neighbour_graph, outward_normals, wisp_spheres, wisp_widths
from .brush import Projection, mirrored, near_brush, pressed, profile_weights, steps_between
from .deformation import DeformParams, collider_arrays, deform
from .grips import Contacts, Grips, pull, turn_step
from .strokes import CombParams, Stroke, View

MAX_SAMPLES = 32  # points of a center strand; finer shape is detail, which is carried along
_REPEATS, _REPEAT_ITERATIONS = 2, 2  # of pulling at the contacts in each step
_REACH = 1.5  # how much wider than at rest a wisp may become
_STEP_SHARE = 0.5  # of the radius that the brush moves at once
_LENGTH_LIMITS = (0.02, 2.0)  # of a strand's length that one stroke can trim or grow it to


class CombSession:
    """Strokes on one groom. `points` (P, 3) float32, metres, world space, is updated in place.

    Raises
    ------
    InputError : labels for another number of strands, or no strands.
    """

    def __init__(self, strands: StrandSet, labels: Sequence[Int32], collider: Collider | None = None) -> None:
        require(strands.n_strands > 0, "the groom has no strands to comb; choose one that has")
        for wisps in labels:
            require(
                wisps.shape == (strands.n_strands,),
                f"there are wisps for {len(wisps)} strands but the groom has {strands.n_strands}; run Cluster Wisps",
            )
        self.points: Float32 = np.array(strands.points)
        self._offsets = strands.offsets
        self._labels = tuple(labels)
        self._collider = collider
        self._graphs: dict[int, RootGraph] = {}
        self._stroke: _Running | None = None

    def begin(self, params: CombParams, view: View, frame: Float64, selection: Float32 | None = None) -> None:
        """Start a stroke; `frame` (4, 4) and `selection` (S,) as in `Stroke`.

        Raises
        ------
        InputError : no such level of wisps, or a selection for another number of strands.
        """
        level = len(self._labels) if params.level < 0 else params.level
        require(
            level <= len(self._labels),
            f"the comb's level is {level} but the groom has {len(self._labels)} levels of wisps; choose a lower one or "
            "run Cluster Wisps",
        )
        n_strands = len(self._offsets) - 1
        require(
            selection is None or selection.shape == (n_strands,),
            f"the selection has {0 if selection is None else len(selection)} values but the groom {n_strands} strands",
        )
        strands = StrandSet(self.points, self._offsets)
        n_samples = int(np.clip(strands.point_counts.max(), 8, MAX_SAMPLES))
        binding = bind_strands(strands, self._labels[level - 1] if level else None, n_samples)
        if level not in self._graphs and params.drag > 0:
            # roots never move, so the neighbourhood serves all strokes
            self._graphs[level] = neighbour_graph(binding.centers[:, 0])
        # a stroke to be filled in: checked now, so that bad input changes nothing
        stroke = Stroke(params, view, np.asarray(frame, np.float64), np.zeros((1, 3)), selection)
        self._stroke = _Running(self, stroke, binding, self._graphs.get(level))

    def move(self, x: float, y: float, pressure: float = 1.0) -> bool:
        """Take the brush to a place in pixels; returns whether hair moved.

        Raises
        ------
        InputError : no stroke was begun, or a place or pressure that is no number.
        """
        running = self._running()
        require(bool(np.isfinite([x, y, pressure]).all()), f"the brush went to {x}, {y} at pressure {pressure}")
        return running.move(float(x), float(y), float(min(max(pressure, 0.0), 1.0)))

    def cancel(self) -> None:
        """Put the hair back to where `begin` found it."""
        self.points[:] = self._running().rest
        self._stroke = None

    def end(self) -> Stroke:
        """End the stroke and return it; its replay gives the same points."""
        running = self._running()
        require(running.samples, "the stroke has no samples; move the brush before it ends")
        self._stroke = None
        begun = running.stroke
        return Stroke(begun.params, begun.view, begun.frame, np.array(running.samples), begun.selection)

    def play(self, stroke: Stroke) -> None:
        """Make a whole stroke."""
        self.begin(stroke.params, stroke.view, stroke.frame, stroke.selection)
        for x, y, pressure in stroke.samples.tolist():
            self.move(x, y, pressure)
        self.end()

    def _running(self) -> _Running:
        require(self._stroke is not None, "no stroke of the comb was begun")
        assert self._stroke is not None
        return self._stroke


@dataclass(slots=True)
class _Active:
    """The centers that the stroke has moved or may move: rest, points (A, N, 3), turns (A, N - 1, 4)."""

    rest: Float64
    points: Float64
    turns: Float64


class _Running:
    """A stroke in progress."""

    def __init__(self, session: CombSession, stroke: Stroke, binding: Binding, graph: RootGraph | None) -> None:
        self.stroke = stroke
        self.samples: list[tuple[float, float, float]] = []
        self.points = session.points
        self.rest: Float32 = session.points.copy()
        self._offsets, self._binding, self._graph = session._offsets, binding, graph
        self._collider, self._solid = session._collider, collider_arrays(session._collider)
        self._views = mirrored(stroke.view, stroke.frame, stroke.params.mirror)
        n_strands, n_samples = len(self._offsets) - 1, binding.centers.shape[1]
        selection = stroke.selection
        self._amounts = np.ones(n_strands, np.float32) if selection is None else np.ascontiguousarray(selection)
        everything = np.arange(binding.n_centers, dtype=np.int32)
        self._spheres = wisp_spheres(self.points, self._offsets, binding, everything)
        self._centers = binding.centers.copy()
        self._widths, widest = wisp_widths(self.points, self._offsets, binding)
        # hair slides along its wisp when lengths are restored, and may stand off a little farther then
        self._reach = _REACH * widest
        self._grips = np.zeros((len(self._views), binding.n_centers))
        self._contacts = Contacts(len(self._views), binding.n_centers)
        self._allowed = None if not stroke.params.only_first else np.zeros(binding.n_centers, np.bool_)
        self._profile = profile_weights(stroke.params.profile, n_samples)
        self._normals: Float64 | None = None
        self._ratios = np.ones(n_strands)
        self._slots = np.full(binding.n_centers, -1, np.int32)
        shape = (0, n_samples, 3)
        nothing = np.zeros(shape)
        self._active = _Active(nothing, nothing, np.zeros((0, n_samples - 1, 4)))

    def move(self, x: float, y: float, pressure: float) -> bool:
        start = np.array(self.samples[-1][:2]) if self.samples else None
        self.samples.append((x, y, pressure))
        radius, strength = pressed(self.stroke, pressure)
        end = np.array([x, y])
        if start is None:
            # the first touch takes hold
            self._touch(end, radius)
            return False
        changed = False
        for place in steps_between(start, end, _STEP_SHARE * radius):
            changed |= self._step(start, place - start, radius, strength)
            start = place
        return changed

    def _step(self, place: Float64, pixels: Float64, radius: float, strength: float) -> bool:
        if strength == 0.0 or not pixels.any():
            return False
        grips = self._touch(place, radius)
        if len(grips.numbers) == 0:
            return False
        if self.stroke.params.mode == "length":
            return self._change_lengths(grips, pixels, strength)
        live = self._activate(grips.numbers)
        if self.stroke.params.mode in ("comb", "lift"):
            return self._pull(grips, live, place, pixels, strength)
        return self._turn(grips, pixels, radius, strength)

    def _touch(self, place: Float64, radius: float) -> Grips:
        """What the brush holds at `place`, through each view; the grip of a wisp never loosens while it is touched."""
        found: list[tuple[Int32, Float64]] = []
        for view, held in zip(self._views, self._grips):
            near = near_brush(view, self._spheres, place, radius)
            if self._allowed is not None and self._allowed.any():
                near &= self._allowed
            chosen, touched = self._touch_in(view, self._near(view, near, place, radius), held, place, radius)
            most = touched.max(axis=1, initial=0.0)
            before = held[chosen]
            held[:] = 0.0
            held[chosen] = np.maximum(before, most)
            found.append((chosen, touched / most[:, None] * held[chosen, None] * self._profile))
        if self._allowed is not None and not self._allowed.any():
            self._allowed = self._grips.max(axis=0) > 0
        return Grips.merged(found)

    def _near(self, view: Projection, near: Bools, place: Float64, radius: float) -> Int32:
        """Of the centers `near` (K,), those whose hair may lie under the brush, by the centers' own course."""
        chosen = np.flatnonzero(near).astype(np.int32)
        is_near = np.empty(len(chosen), np.bool_)
        near_centers(
            self._centers, chosen, self._reach, view.matrix, view.half, view.length_scale, place, radius, is_near
        )
        return chosen[is_near]

    def _touch_in(
        self, view: Projection, near: Int32, held: Float64, place: Float64, radius: float
    ) -> tuple[Int32, Float64]:
        """The centers (n,) that one view's brush touches, and how firmly it holds each of their samples (n, N).

        What is held already stays so whatever comes in front of it.
        """
        binding = self._binding
        hair = (self.points, self._offsets, binding.members, binding.starts)
        depths = np.empty(len(near))
        front_depths(*hair, near, view.matrix, view.half, view.forward, place, radius, depths)
        front = float(depths.min(initial=np.inf))
        deepest = np.full(len(near), np.inf)
        if not self.stroke.params.through and np.isfinite(front):
            deepest[held[near] == 0] = front + view.length(front, radius)
        kept = np.isfinite(depths) & (depths <= deepest)
        chosen, deepest = near[kept], deepest[kept]
        touched = np.zeros((len(chosen), len(self._profile)))
        touch(
            *hair, binding.places, chosen, self._amounts, view.matrix, view.half, view.forward,
            np.array([place[0], place[1], radius]), deepest, min(self.stroke.params.hardness, 0.999), touched,
        )  # fmt: skip
        kept = touched.any(axis=1)
        return chosen[kept], touched[kept]

    def _activate(self, numbers: Int32) -> Int32:
        """Take centers, and the two rings around them that may be dragged along, into the active ones; returns them."""
        wanted = numbers
        if self._graph is not None:
            for _ in range(2):
                wanted = np.unique(np.concatenate([wanted, _beside(self._graph, wanted)]))
            if self._allowed is not None:
                wanted = wanted[self._allowed[wanted]]
        new = wanted[self._slots[wanted] < 0]
        if len(new) == 0:
            return wanted
        active, centers = self._active, self._binding.centers[new].astype(np.float64)
        turns = np.zeros((*centers.shape[:1], centers.shape[1] - 1, 4))
        turns[:, :, 0] = 1.0
        self._slots[new] = len(active.rest) + np.arange(len(new), dtype=np.int32)
        self._active = _Active(
            np.concatenate([active.rest, centers]),
            np.concatenate([active.points, centers]),
            np.concatenate([active.turns, turns]),
        )
        return wanted

    def _pull(self, grips: Grips, live: Int32, place: Float64, pixels: Float64, strength: float) -> bool:
        """Comb and lift: handles pull, and the centers are deformed; the live centers (L,) take part."""
        params = self.stroke.params
        before = self._active.points[self._slots[live]]
        self._deform(grips, live, place, pixels, strength, DeformParams(drag=params.drag))
        if params.mode == "comb":
            # where lengths took the contacts back, combing goes after them; the neighbours have been dragged by then
            settings = DeformParams(drag=params.drag, iterations=_REPEAT_ITERATIONS)
            for _ in range(_REPEATS):
                self._deform(grips, grips.numbers, place + pixels, np.zeros(2), strength, settings)
        moved = np.abs(self._active.points[self._slots[live]] - before).max(axis=(1, 2)) > 1e-9
        return self._carry(live[moved])

    def _deform(
        self, grips: Grips, live: Int32, place: Float64, drag: Float64, strength: float, settings: DeformParams
    ) -> None:
        """Pull at the held centers from `place` by a drag (2,), pixels; the live centers (L,) take part."""
        params, active, rows = self.stroke.params, self._active, self._slots[live]
        if params.mode == "lift" and self._normals is None:
            self._normals = outward_normals(self._binding.centers[:, 0])
        normals = self._normals[live] if self._normals is not None else None
        points = active.points[rows]
        weights, targets = pull(
            grips, self._contacts, live, points, self._views, place, drag, params, strength, normals
        )
        result = deform(
            points, weights, targets, self._graph, settings,
            rest=active.rest[rows], active=live, collider=self._collider,
        )  # fmt: skip
        active.points[rows] = result.points
        turn_on(active.turns, result.turns, rows)

    def _turn(self, grips: Grips, pixels: Float64, radius: float, strength: float) -> bool:
        """Twist and smooth: the edges are turned, and the centers follow from their roots."""
        rows = self._slots[grips.numbers]
        neighbours = None
        if self._graph is not None and self.stroke.params.mode == "smooth":
            neighbours = self._graph
        points, steps = turn_step(
            grips, self._active.points, rows, self._slots, pixels / radius, self.stroke.params, strength, neighbours
        )
        self._active.points[rows] = points
        turn_on(self._active.turns, steps, rows)
        return self._carry(grips.numbers)

    def _carry(self, numbers: Int32) -> bool:
        if len(numbers) == 0:
            return False
        strands, owners = _members_of(self._binding, numbers)
        active = self._active
        rows = self._slots[numbers]
        carry(
            strands, owners, self._offsets, self._binding.places, self.rest, self.points, self._amounts,
            active.rest[rows], active.points[rows], active.turns[rows], self._widths[numbers],
            *self._solid, DeformParams().margin,
        )  # fmt: skip
        self._spheres[numbers] = wisp_spheres(self.points, self._offsets, self._binding, numbers)
        self._centers[numbers] = active.points[rows]
        return True

    def _change_lengths(self, grips: Grips, pixels: Float64, strength: float) -> bool:
        """Grow or trim the touched wisps' strands by as much as the brush moves."""
        strands, owners = _members_of(self._binding, grips.numbers)
        firsts = self._offsets[strands]
        view = self._views[0]
        way = np.linalg.norm(view.moves(self.rest[firsts].astype(np.float64), pixels), axis=1)
        lengths = self._binding.lengths[strands]
        amount = way * strength * grips.strongest()[owners] * self._amounts[strands]
        change = amount / np.maximum(lengths, 1e-9) * (-1.0 if self.stroke.params.invert else 1.0)
        self._ratios[strands] = np.clip(self._ratios[strands] + change, *_LENGTH_LIMITS)
        set_lengths(
            strands, self._offsets, self.rest, self.points, self._ratios, *self._solid, DeformParams().margin
        )  # fmt: skip
        spheres = wisp_spheres(self.points, self._offsets, self._binding, grips.numbers)
        self._spheres[grips.numbers] = spheres
        # hair may grow far beyond its center
        self._reach[grips.numbers] = 2.0 * spheres[:, 3]
        return True


def comb(
    strands: StrandSet,
    labels: Sequence[Int32],
    strokes: Sequence[Stroke],
    collider: Collider | None = None,
    *,
    progress: Progress = NO_PROGRESS,
) -> StrandSet:
    """Play strokes on a groom; the same bytes as the strokes made by hand.

    Parameters
    ----------
    strands : world space, metres. labels : per level, finest first, (S,) int32, the wisp of each strand.

    Raises
    ------
    InputError : as CombSession. Cancelled : from `progress`, between strokes.
    """
    session = CombSession(strands, labels, collider)
    for number, stroke in enumerate(strokes):
        progress(number / len(strokes), f"Stroke {number + 1} of {len(strokes)}")
        session.play(stroke)
    return StrandSet(session.points, strands.offsets, strands.point_attributes, strands.strand_attributes)


def _beside(graph: RootGraph, numbers: Int32) -> Int32:
    """The neighbours of some nodes, repeated."""
    counts = np.diff(graph.offsets)[numbers]
    starts = np.repeat(graph.offsets[numbers] - np.concatenate([[0], np.cumsum(counts)[:-1]]), counts)
    return np.asarray(graph.neighbours[starts + np.arange(counts.sum())], dtype=np.int32)


def _members_of(binding: Binding, numbers: Int32) -> tuple[Int32, Int32]:
    """The strands of some centers, and for each its place among `numbers`."""
    counts = np.diff(binding.starts)[numbers]
    starts = np.repeat(binding.starts[numbers] - np.concatenate([[0], np.cumsum(counts)[:-1]]), counts)
    strands = binding.members[starts + np.arange(counts.sum())]
    return strands, np.repeat(np.arange(len(numbers), dtype=np.int32), counts)
