"""What the brush holds, and what its drag does to the centers held: handles to pull at, or edges to turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ..geometry.root_graph import RootGraph
from ..types import Float64, Int32
from .brush import Projection
from .strokes import CombParams

HANDLE_WEIGHT = 100.0  # a firm hold, against 1 of an edge
_TANGENT_SAMPLES = 3  # samples to either side that the direction of a center is taken from
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


def pull(
    grips: Grips,
    live: Int32,
    points: Float64,
    views: tuple[Projection, ...],
    pixels: Float64,
    params: CombParams,
    strength: float,
    normals: Float64 | None,
) -> tuple[Float64, Float64]:
    """Handles of the live centers (L,) for a drag of `pixels` (2,): weights (L, N) and targets (L, N, 3), metres.

    Comb: held samples go with the brush across their strand and let it slip along; lift: along `normals` (L, 3).
    """
    rows = np.searchsorted(live, grips.numbers)
    held = points[rows]
    total = np.zeros(held.shape)
    weight = np.zeros(held.shape[:2])
    along = _directions(held, _TANGENT_SAMPLES)
    for view, hold in zip(views, grips.holds):
        move = view.moves(held.reshape(-1, 3), pixels).reshape(held.shape)
        if params.mode == "lift":
            assert normals is not None
            way = np.linalg.norm(move, axis=2, keepdims=True) * (-1.0 if params.invert else 1.0)
            move = way * normals[rows][:, None, :]
        else:
            move = move - params.slip * (move * along).sum(axis=2, keepdims=True) * along
        total += hold[:, :, None] * move
        weight += hold
    # where the brush and its mirror image hold the same hair, they share it
    total /= np.maximum(weight, 1.0)[:, :, None]
    weights, targets = np.zeros(points.shape[:2]), points.copy()
    shape = np.minimum(weight, 1.0) / np.maximum(grips.holds.max(axis=(0, 2)), 1e-9)[:, None]
    weights[rows] = HANDLE_WEIGHT * np.minimum(shape, 1.0) ** 2
    weights[:, :2] = 0.0
    targets[rows] += strength * total
    return weights, targets


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
        turns = np.concatenate([np.cos(angles / 2)[:, :, None], np.sin(angles / 2)[:, :, None] * axes], axis=2)
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
    return np.asarray(np.concatenate([np.cos(angles / 2)[:, :, None], np.sin(angles / 2)[:, :, None] * axes], axis=2))


def _rotate(turns: Float64, vectors: Float64) -> Float64:
    """Vectors (..., 3) turned by quaternions (..., 4)."""
    axis = turns[..., 1:]
    twice = 2.0 * np.cross(axis, vectors)
    return np.asarray(vectors + turns[..., :1] * twice + np.cross(axis, twice))
