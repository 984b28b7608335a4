"""What the brush holds, and what its drag does to the centers held: handles to pull at, or edges to turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from ..geometry.root_graph import RootGraph
from ..types import Float64, Int32
from .brush import Projection
from .strokes import CombParams

Int64 = NDArray[np.int64]

HANDLE_WEIGHT = 100.0  # a firm hold, against 1 of an edge
_TANGENT_SAMPLES = 5  # samples to either side that the direction of a center is taken from
_ROOT_SHARE = 0.15  # of a strand, next to its root, that the brush has less hold of
_SMOOTH_SIGMA = 3.0  # samples over which Smooth evens out the flow


@dataclass(frozen=True, slots=True)
class Grips:
    """Centers under the brush.

    numbers : (n,) int32, rising. holds : (V, n, N) float64 in 0..1, how firmly each view's brush holds each sample.
    """

    numbers: Int32
    holds: Float64

    @staticmethod
    def merged(found: list[tuple[Int32, Float64]]) -> Grips:
        """One from each view's centers (n_v,) and holds (n_v, N)."""
        numbers = np.unique(np.concatenate([chosen for chosen, _ in found]))
        holds = np.zeros((len(found), len(numbers), found[0][1].shape[1]))
        for view, (chosen, hold) in enumerate(found):
            holds[view, np.searchsorted(numbers, chosen)] = hold
        return Grips(numbers, holds)

    def strongest(self) -> Float64:
        """(n,) the firmest hold on each center."""
        return np.asarray(self.holds.max(axis=(0, 2)))


class Contacts:
    """Where each view's brush holds each center: pixels from the brush's middle, kept while the hair slips along.

    A goal that is kept, instead of moves that are added up, is why hair does not drift out of the brush.
    """

    def __init__(self, n_views: int, n_centers: int) -> None:
        self.offsets = np.full((n_views, n_centers, 2), np.nan)

    def goals(
        self, view: int, numbers: Int32, pixels: Float64, place: Float64, move: Float64, share: Float64
    ) -> Float64:
        """(n, 2) pixels where the contacts of centers `numbers` (n,) shall be once the brush has made a move (2,).

        pixels : (n, N, 2) of the centers' samples. place : (2,) of the brush before the move. share : (n,) of the move
        that each contact makes. New contacts are where a center is nearest to the middle of the brush.
        """
        known = self.offsets[view]
        fresh = np.isnan(known[numbers, 0])
        released = np.ones(len(known), np.bool_)
        released[numbers] = False
        known[released] = np.nan
        if fresh.any():
            known[numbers[fresh]] = nearest_on(pixels[fresh], np.broadcast_to(place, (int(fresh.sum()), 2)))[0] - place
        known[numbers] += (share - 1.0)[:, None] * move
        return np.asarray(place + move + known[numbers])


def nearest_on(pixels: Float64, goals: Float64) -> tuple[Float64, Float64]:
    """The points (n, 2) of polylines (n, N, 2) nearest to goals (n, 2), and where they are, in samples (n,)."""
    starts, edges = pixels[:, :-1], np.diff(pixels, axis=1)
    squares = np.maximum((edges**2).sum(axis=2), 1e-12)
    t = np.clip(((goals[:, None] - starts) * edges).sum(axis=2) / squares, 0.0, 1.0)
    points = starts + t[:, :, None] * edges
    best = ((points - goals[:, None]) ** 2).sum(axis=2).argmin(axis=1)
    rows = np.arange(len(goals))
    return points[rows, best], best + t[rows, best]


def pull(
    grips: Grips,
    contacts: Contacts,
    live: Int32,
    points: Float64,
    views: tuple[Projection, ...],
    place: Float64,
    drag: Float64,
    params: CombParams,
    strength: float,
    normals: Float64 | None,
) -> tuple[Float64, Float64]:
    """Handles of the live centers (L,) for a drag (2,), pixels, from `place`: weights (L, N), targets (L, N, 3).

    Comb: the contact goes with the brush across its strand, which slips along; lift: along `normals` (L, 3).
    """
    rows = np.searchsorted(live, grips.numbers)
    held = points[rows]
    total = np.zeros(held.shape)
    weight = np.zeros(held.shape[:2])
    for number, (view, hold) in enumerate(zip(views, grips.holds)):
        touched = np.flatnonzero(hold.any(axis=1))
        shape = hold[touched] / hold[touched].max(axis=1, initial=1e-9)[:, None]
        firmness = strength * hold[touched].max(axis=1, initial=0.0)
        sample = _middles(shape)
        # hair that is held at its root cannot follow: it would be folded over there
        firmness *= np.minimum(sample / (_ROOT_SHARE * (shape.shape[1] - 1)), 1.0)
        if params.mode == "lift":
            assert normals is not None
            way = np.linalg.norm(view.moves(held[touched].reshape(-1, 3), drag), axis=1).reshape(shape.shape)
            way *= firmness[:, None] * (-1.0 if params.invert else 1.0)
            move = way[:, :, None] * normals[rows[touched]][:, None, :]
        else:
            move, sample = _comb_moves(
                contacts, number, grips.numbers[touched], held[touched], view, place, drag, params.slip, firmness
            )
        # one sample alone: a strand that were held along the whole brush could not turn in it and would fold at its rim
        shape *= np.arange(shape.shape[1]) == sample[:, None]
        total[touched] += shape[:, :, None] * move
        weight[touched] += shape
    # where the brush and its mirror image hold the same hair, they share it
    total /= np.maximum(weight, 1e-9)[:, :, None]
    weights, targets = np.zeros(points.shape[:2]), points.copy()
    weights[rows] = HANDLE_WEIGHT * np.minimum(weight, 1.0) ** 2
    weights[:, :2] = 0.0
    targets[rows] += total
    return weights, targets


def _middles(shape: Float64) -> Int64:
    """(n,) the middle of the samples that are held most firmly, of holds (n, N)."""
    firmest = shape >= shape.max(axis=1, initial=0.0)[:, None]
    index = np.arange(shape.shape[1])
    return np.asarray(np.rint((firmest * index).sum(axis=1) / np.maximum(firmest.sum(axis=1), 1)), np.int64)


def _comb_moves(
    contacts: Contacts,
    number: int,
    numbers: Int32,
    held: Float64,
    view: Projection,
    place: Float64,
    drag: Float64,
    slip: float,
    share: Float64,
) -> tuple[Float64, Int64]:
    """World moves (n, 1, 3) that bring the contacts of centers (n, N, 3) to where the brush wants them; their samples.

    The samples (n,) are those nearest to the contacts.
    """
    count, n_samples = held.shape[:2]
    pixels = view.pixels(held.reshape(-1, 3))[0].reshape(count, n_samples, 2)
    goals = contacts.goals(number, numbers, pixels, place, drag, share)
    nearest, where = nearest_on(pixels, goals)
    across = goals - nearest
    sample = np.rint(where).astype(np.int64)
    rows = np.arange(count)
    along = pixels[rows, np.minimum(sample + _TANGENT_SAMPLES, n_samples - 1)]
    along = _unit(along - pixels[rows, np.maximum(sample - _TANGENT_SAMPLES, 0)])
    # beyond the tip the nearest point is not beside the goal; what pulls along the strand only slips
    across -= (across * along).sum(axis=1, keepdims=True) * along
    kept = (1.0 - slip) * share[:, None] * (along @ drag)[:, None] * along
    contact = held[rows, sample]
    return view.moves(contact, across + kept)[:, None], sample


def turn_step(
    grips: Grips,
    points: Float64,
    rows: Int32,
    slots: Int32,
    drag: Float64,
    params: CombParams,
    strength: float,
    neighbours: RootGraph | None,
) -> tuple[Float64, Float64]:
    """Turn the edges of the held centers by a drag (2,) in radii: new points (n, N, 3) and turns (n, N - 1, 4).

    Twist: about the strand's smoothed direction, as far as the brush reaches and beyond it to the tip; a drag of two
    radii to the right is a full turn. Smooth: towards the direction of the edges before and behind and of the
    neighbours.
    """
    held = points[rows]
    edges = np.diff(held, axis=1)
    hold = np.minimum(grips.holds.sum(axis=0), 1.0)[:, 1:]
    if params.mode == "twist":
        angle = np.pi * float(drag[0]) * strength * (-1.0 if params.invert else 1.0)
        # mirrored hair winds the other way
        signs = np.where(grips.holds.max(axis=2) > 0, _parities(len(grips.holds))[:, None], 0.0)
        side = np.sign(signs.sum(axis=0) + 0.5)
        angles = angle * side[:, None] * np.maximum.accumulate(hold, axis=1)
        axes = _directions(held, 2 * _TANGENT_SAMPLES)[:, :-1]
        turns = _quaternions(axes, angles)
    else:
        share = np.minimum(float(np.linalg.norm(drag)) * strength, 1.0) * 0.5 * hold
        turns = _towards(edges, _smoothed(edges, grips.numbers, points, slots, neighbours), share)
    turns[:, 0] = (1.0, 0.0, 0.0, 0.0)
    turned = _rotate(turns, edges)
    moved = held.copy()
    moved[:, 1:] = held[:, :1] + np.cumsum(turned, axis=1)
    return moved, turns


def _parities(n_views: int) -> Float64:
    """(V,) +1 or -1: does an even number of mirrors lead to each view? (The order is that of `brush.mirrored`.)"""
    return np.array([1.0 - 2.0 * (number.bit_count() % 2) for number in range(n_views)])


def _smoothed(edges: Float64, numbers: Int32, points: Float64, slots: Int32, neighbours: RootGraph | None) -> Float64:
    """(n, N - 1, 3) the directions that the edges are smoothed to."""
    wanted = np.asarray(gaussian_filter1d(edges, _SMOOTH_SIGMA, axis=1, mode="nearest"))
    if neighbours is None:
        return wanted
    units = _unit(wanted)
    for row, number in enumerate(numbers.tolist()):  # one over the wisps under the brush
        beside = slots[neighbours.neighbours[neighbours.offsets[number] : neighbours.offsets[number + 1]]]
        around = np.diff(points[beside[beside >= 0]], axis=1)
        if len(around):
            wanted[row] = units[row] + _unit(_unit(around).sum(axis=0))
    return wanted


def _directions(points: Float64, reach: int) -> Float64:
    """(n, N, 3) unit directions of strands, from the samples `reach` before to those `reach` behind."""
    last = points.shape[1] - 1
    index = np.arange(last + 1)
    return _unit(points[:, np.minimum(index + reach, last)] - points[:, np.maximum(index - reach, 0)])


def _unit(vectors: Float64) -> Float64:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30))


def _towards(edges: Float64, wanted: Float64, share: Float64) -> Float64:
    """Quaternions (n, M, 4) that turn edges (n, M, 3) by a share (n, M) of the smallest turn to `wanted`."""
    before, after = _unit(edges), _unit(wanted)
    axes = _unit(np.cross(before, after))
    angles = share * np.arccos(np.clip((before * after).sum(axis=2), -1.0, 1.0))
    return _quaternions(axes, angles)


def _quaternions(axes: Float64, angles: Float64) -> Float64:
    """(n, M, 4) turns by angles (n, M), radians, about unit axes (n, M, 3)."""
    return np.asarray(np.concatenate([np.cos(angles / 2)[:, :, None], np.sin(angles / 2)[:, :, None] * axes], axis=2))


def _rotate(turns: Float64, vectors: Float64) -> Float64:
    """Vectors (..., 3) turned by quaternions (..., 4)."""
    axis = turns[..., 1:]
    twice = 2.0 * np.cross(axis, vectors)
    return np.asarray(vectors + turns[..., :1] * twice + np.cross(axis, twice))
