"""What is done to grown hair to make the hairstyles of the database: cut, tied, swept, shaved, blown about.

All in the collider's unit as in `growth`: origin in the middle of the scalp's sphere, its radius 1, z up, the face
towards -y, the person's left at +x. Strands are (S, N, 3) float64, whole arrays at a time. A step is a callable of a
`Hair` and a random generator that returns the changed `Hair`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from collider import Collider
from growth import arc_lengths, frames_along, resample_to, smoothstep, unit
from hairloom.types import Bools, Float64, Floats, Int32

DOWN = np.array([0.0, 0.0, -1.0])
SHORTEST = 0.04  # head radii: hair is not cut shorter


@dataclass(frozen=True, slots=True)
class Hair:
    """Strands (S, N, 3) on a head, and the wisp (S,) int32 of each."""

    strands: Float64
    wisps: Int32
    collider: Collider

    @property
    def roots(self) -> Float64:
        return self.strands[:, 0]

    @property
    def on_sphere(self) -> Float64:
        """(S, 3) unit: where the roots lie, seen from the middle."""
        return unit(self.roots)


Step = Callable[[Hair, np.random.Generator], Hair]
Region = Callable[[Float64], Floats]  # roots on the sphere (S, 3) -> weight (S,) in 0..1


# --- regions of the scalp ---


def everywhere(roots: Float64) -> Floats:
    return np.ones(len(roots))


def above(height: float, soft: float = 0.15) -> Region:
    """Roots above a height, -1 .. 1."""
    return lambda roots: smoothstep(height - soft, height + soft, roots[:, 2])


def below(height: float, soft: float = 0.15) -> Region:
    return lambda roots: smoothstep(height + soft, height - soft, roots[:, 2])


def side(sign: float, edge: float = 0.0, soft: float = 0.12) -> Region:
    """Roots on the left (+1) or right (-1), from `edge` outwards."""
    return lambda roots: smoothstep(edge - soft, edge + soft, sign * roots[:, 0])


def strip(half_width: float, soft: float = 0.03) -> Region:
    """Roots along the middle, as of a mohawk."""
    return lambda roots: smoothstep(half_width + soft, half_width - soft, np.abs(roots[:, 0]))


def brow(half_width: float, depth: float = 0.35, shift: float = 0.0) -> Region:
    """Roots over the forehead, from where bangs fall; depth is how far over the head it reaches."""

    def weight(roots: Float64) -> Floats:
        angle = np.arctan2(roots[:, 2], -roots[:, 1])
        across = smoothstep(half_width + 0.1, half_width - 0.1, np.abs(roots[:, 0] - shift))
        return across * smoothstep(0.75 + depth, 0.55 + depth, angle) * (roots[:, 1] < 0.1)

    return weight


def both(first: Region, second: Region) -> Region:
    return lambda roots: first(roots) * second(roots)


def outside(region: Region) -> Region:
    return lambda roots: 1.0 - region(roots)


# --- steps ---


def keep(region: Region, stubble: float = 0.0) -> Step:
    """Hair grows only in the region; elsewhere it is shaved, or stubble of that length."""

    def step(hair: Hair, rng: np.random.Generator) -> Hair:
        inside = region(hair.on_sphere) > rng.random(len(hair.roots))
        if stubble:
            full = arc_lengths(hair.strands)[:, -1]
            short = stubble * rng.uniform(0.7, 1.1, len(full))
            return _cut_to(hair, np.where(inside, full, np.minimum(short, full)))
        return Hair(hair.strands[inside], hair.wisps[inside], hair.collider)

    return step


def trim(factor: float, region: Region = everywhere, spread: float = 0.06, longest: float = 99.0) -> Step:
    """Hair of the region is cut to a share of its length, and to a greatest length."""

    def step(hair: Hair, rng: np.random.Generator) -> Hair:
        full = arc_lengths(hair.strands)[:, -1]
        weight = region(hair.on_sphere)
        wanted = np.minimum(full * (1.0 + (factor - 1.0) * weight), np.where(weight > 0.5, longest, 99.0))
        wanted = wanted * np.where(weight > 0.01, rng.normal(1.0, spread, len(full)), 1.0)
        return _cut_to(hair, np.clip(wanted, SHORTEST, full))

    return step


def cut(height: float, region: Region = everywhere, slope_x: float = 0.0, slope_y: float = 0.0, spread: float = 0.05,
        over: bool = False) -> Step:  # fmt: skip
    """Hair of the region is cut along a plane, z = height + slope_x x + slope_y y: below it, or what rises over it."""

    def step(hair: Hair, rng: np.random.Generator) -> Hair:
        points, arcs = hair.strands, arc_lengths(hair.strands)
        level = height + spread * rng.normal(size=len(points)) * (region(hair.on_sphere) > 0.5)
        plane = level[:, None] + slope_x * points[..., 0] + slope_y * points[..., 1]
        beyond = points[..., 2] > plane if over else points[..., 2] < plane
        beyond[:, 0] = False
        first = np.where(beyond.any(axis=1), beyond.argmax(axis=1), points.shape[1] - 1)
        reached = arcs[np.arange(len(arcs)), first]
        chosen = region(hair.on_sphere) > 0.5
        return _cut_to(hair, np.where(chosen, np.maximum(reached, 0.15), arcs[:, -1]))

    return step


def sweep(angle: float, region: Region, start: float = 0.0, reach: float = 0.8) -> Step:
    """Turn hair of the region about the head's vertical by `angle` degrees, fully `reach` along the strand."""

    def step(hair: Hair, rng: np.random.Generator) -> Hair:
        arcs = arc_lengths(hair.strands)
        turn = np.radians(angle) * region(hair.on_sphere)[:, None] * smoothstep(start, start + reach, arcs)
        x, y = hair.strands[..., 0], hair.strands[..., 1]
        turned = np.stack([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y], axis=-1)
        return _outside(replace(hair, strands=np.concatenate([turned, hair.strands[..., 2:]], axis=-1)))

    return step


def drape(target: tuple[float, float], region: Region = everywhere, strength: float = 0.8, low: float = -0.7) -> Step:
    """Take hair that hangs below `low` towards a place (x, y): over one shoulder, or behind both."""

    def step(hair: Hair, rng: np.random.Generator) -> Hair:
        z = hair.strands[..., 2]
        weight = strength * region(hair.on_sphere)[:, None] * smoothstep(low, low - 1.4, z)
        moved = hair.strands.copy()
        for axis in (0, 1):
            moved[..., axis] += weight * (target[axis] - moved[..., axis])
        return _outside(replace(hair, strands=moved))

    return step


def blow(direction: tuple[float, float, float], power: float = 1.6, reach: float = 3.0) -> Step:
    """Wind: strands are carried along, their tips most."""

    def step(hair: Hair, rng: np.random.Generator) -> Hair:
        arcs = arc_lengths(hair.strands)
        gusts = rng.uniform(0.7, 1.3, int(hair.wisps.max()) + 1)[hair.wisps]
        share = (arcs / reach) ** power * gusts[:, None]
        return _outside(replace(hair, strands=hair.strands + share[..., None] * np.array(direction)))

    return step


def puff(amount: float, region: Region = everywhere, low: float = -9.0) -> Step:
    """More volume: hair is moved away from the middle of the head, and from its vertical further down."""

    def step(hair: Hair, rng: np.random.Generator) -> Hair:
        arcs = arc_lengths(hair.strands)
        grown = amount * region(hair.on_sphere)[:, None] * smoothstep(0.0, 0.8, arcs)
        grown = grown * smoothstep(low - 0.5, low, hair.strands[..., 2])
        away = hair.strands * [1.0, 1.0, 0.0] + np.maximum(hair.strands, 0.0) * [0.0, 0.0, 1.0]
        return _outside(replace(hair, strands=hair.strands + grown[..., None] * unit(away)))

    return step


def flip(amount: float, length: float = 0.7) -> Step:
    """Ends turned out (amount above 0) or in, over the last `length`."""

    def step(hair: Hair, rng: np.random.Generator) -> Hair:
        arcs = arc_lengths(hair.strands)
        left = arcs[:, -1:] - arcs
        bend = smoothstep(length, 0.0, left) ** 1.5 * smoothstep(0.8, 1.6, arcs[:, -1:])
        out = unit(hair.strands * [1.0, 1.0, 0.0])
        moved = hair.strands + (amount * bend)[..., None] * (out + np.array([0.0, 0.0, 0.6]))
        return _outside(replace(hair, strands=moved))

    return step


@dataclass(frozen=True, slots=True)
class Tie:
    """Hair gathered at a place and what it does from there.

    anchor : direction of the place from the middle of the head. out : how far over the skin it is gathered, head radii.
    length : of the tail. width : its greatest radius. tight : its radius at the tie. bend : length over which it turns
        down. rise : how far it stands up first. taper : radius at the end as a share. wave, pitch : of the tail.
    kind : "tail", "braid", "bun" (then `width` is the ball's) or "ball" (a puff of afro hair).
    """

    anchor: tuple[float, float, float]
    out: float = 0.12
    length: float = 2.5
    width: float = 0.24
    tight: float = 0.09
    bend: float = 0.4
    rise: float = 0.2
    taper: float = 0.5
    wave: float = 0.0
    pitch: float = 0.7
    kind: str = "tail"


def tie(made: Tie, region: Region = everywhere, n_points: int = 40) -> Step:
    """Hair of the region runs over the head to the tie and on from there; the rest stays."""

    def step(hair: Hair, rng: np.random.Generator) -> Hair:
        chosen = np.flatnonzero(region(hair.on_sphere) > rng.random(len(hair.roots)) * 0.2 + 0.4)
        strands = resample_to(hair.strands, arc_lengths(hair.strands)[:, -1], n_points)
        if len(chosen):
            strands[chosen] = _tied(hair, chosen, made, n_points, rng)
        return replace(hair, strands=strands)

    return step


def _tied(hair: Hair, chosen: np.ndarray, made: Tie, n_points: int, rng: np.random.Generator) -> Float64:
    roots = hair.roots[chosen]
    anchor = unit(np.array(made.anchor))
    knot = _knot(hair.collider, anchor, made.out)
    disc = _disc(len(chosen), rng)
    over = _over_head(hair.collider, roots, knot, disc * made.tight, anchor, rng)
    wisps = hair.wisps[chosen]
    if made.kind == "bun":
        after = _bun(knot, anchor, made, disc, rng)
    elif made.kind == "ball":
        after = _ball(knot, anchor, made, len(chosen), rng)
    else:
        after = _tail(hair.collider, knot, anchor, made, disc, wisps, rng)
    joined = np.concatenate([over, after[:, 1:]], axis=1)
    arcs = arc_lengths(joined)
    full = resample_to(joined, arcs[:, -1], n_points)
    return _pushed(hair.collider, full, 0.03)


def _knot(collider: Collider, anchor: Float64, out: float) -> Float64:
    """(3,) the place over the skin along the anchor's ray."""
    reach = np.linspace(0.3, 2.5, 200)[:, None] * anchor
    distance, _ = collider.distance(reach)
    return reach[np.flatnonzero(distance < out)[-1]]


def _disc(count: int, rng: np.random.Generator) -> Float64:
    """(count, 2) places in the unit disc, even."""
    radius, angle = np.sqrt(rng.random(count)), 2.0 * np.pi * rng.random(count)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def _over_head(
    collider: Collider, roots: Float64, knot: Float64, offset: Float64, anchor: Float64, rng: np.random.Generator
) -> Float64:
    """(S, 16, 3): from the roots around the head to the knot, in a layer over the skin."""
    steps = np.linspace(0.0, 1.0, 16)
    start, end = unit(roots), unit(knot)
    angle = np.arccos(np.clip(start @ end, -1.0, 1.0))[:, None]
    sine = np.maximum(np.sin(angle), 1e-3)
    weights = np.sin((1.0 - steps) * angle) / sine, np.sin(steps * angle) / sine
    path = unit(weights[0][..., None] * start[:, None] + weights[1][..., None] * end)
    radius = (1.0 - steps) * np.linalg.norm(roots, axis=1)[:, None] + steps * np.linalg.norm(knot)
    path = path * radius[..., None]
    # hair from farther off lies over that from near the knot
    layer = 0.03 + 0.05 * angle * rng.uniform(0.4, 1.0, angle.shape)
    flat = path.reshape(-1, 3)
    wanted = (layer * np.sin(np.pi * np.minimum(steps * 1.2, 1.0) * 0.8)).ravel()
    for _ in range(3):
        distance, outward = collider.distance(flat)
        flat = flat + np.maximum(wanted - distance, 0.0)[:, None] * outward
        # hair under tension hugs the head where it is hollow
        flat = flat - 0.7 * np.maximum(distance - wanted - 0.1, 0.0)[:, None] * outward
    path = flat.reshape(path.shape)
    first, second = _across(anchor)
    end_places = knot + offset[:, :1] * first + offset[:, 1:] * second
    weight = smoothstep(0.35, 1.0, steps)[None, :, None]
    path = path * (1.0 - weight) + weight * (path + (end_places - path[:, -1])[:, None])
    path[:, 0] = roots
    return path


def _across(axis: Float64) -> tuple[Float64, Float64]:
    """Two unit vectors across `axis` (3,)."""
    first = unit(np.cross(axis, [0.31, 0.2, 0.93] if abs(axis[2]) < 0.9 else [0.0, 1.0, 0.1]))
    return first, np.cross(axis, first)


def _tail(
    collider: Collider, knot: Float64, anchor: Float64, made: Tie, disc: Float64, wisps: Int32, rng: np.random.Generator
) -> Float64:
    """(S, 33, 3) from the knot: one course for all, each strand at its place in the cross-section."""
    n_steps = 32
    step = made.length / n_steps
    course = np.empty((n_steps + 1, 3))
    course[0] = knot
    heading = unit(anchor + made.rise * -DOWN)
    for index in range(1, n_steps + 1):  # a single course, so its points one after the other
        fallen = 1.0 - np.exp(-((index * step / made.bend) ** 1.5))
        place = course[index - 1] + step * unit(heading * (1.0 - fallen) + DOWN * fallen)
        distance, outward = collider.distance(place[None])
        course[index] = place + max(0.8 * made.width - distance[0], 0.0) * min(1.0, index / 5.0) * outward[0]
    arcs = step * np.arange(n_steps + 1)
    frames = frames_along(course[None], _across(unit(course[1] - course[0]))[0][None])[0]
    share = arcs / made.length
    radius = made.tight + (made.width - made.tight) * smoothstep(0.0, 0.3, share)
    radius = radius * (1.0 - (1.0 - made.taper) * smoothstep(0.45, 1.0, share))
    places = disc[:, None, :] * radius[None, :, None]
    if made.kind == "braid":
        places = 0.45 * places + _braided(arcs, radius, rng.integers(0, 3, len(disc)), made.pitch)
    if made.wave:
        phase = rng.uniform(0.0, 2.0 * np.pi, int(wisps.max()) + 1)[wisps] + rng.normal(0.0, 0.3, len(disc))
        turn = 2.0 * np.pi * arcs / made.pitch + phase[:, None]
        grown = made.wave * smoothstep(0.05, 0.35, share)
        places = places + grown[None, :, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    strands = course[None] + places[..., :1] * frames[None, :, :, 0] + places[..., 1:] * frames[None, :, :, 1]
    lengths = arc_lengths(strands)[:, -1] * rng.uniform(0.78, 1.0, len(strands))
    return resample_to(strands, lengths, n_steps + 1)


def _braided(arcs: Floats, radius: Floats, part: np.ndarray, pitch: float) -> Float64:
    """(S, M, 2) offsets of the three parts of a plait."""
    turn = 2.0 * np.pi * (arcs[None] / pitch + part[:, None] / 3.0)
    return np.stack([0.75 * radius * np.sin(turn), 0.4 * radius * np.sin(2.0 * turn)], axis=-1)


def _bun(knot: Float64, anchor: Float64, made: Tie, disc: Float64, rng: np.random.Generator) -> Float64:
    """(S, 33, 3) wound to a flattened ball over the knot."""
    share = np.linspace(0.0, 1.0, 33)
    first, second = _across(anchor)
    ball = made.width * rng.uniform(0.75, 1.0, len(disc))[:, None] * (0.35 + 0.65 * smoothstep(0.0, 0.25, share))
    turn = np.arctan2(disc[:, 1], disc[:, 0])[:, None] + 2.0 * np.pi * 1.4 * share
    rise = np.radians(-65.0) + (rng.uniform(-0.9, 1.25, len(disc))[:, None] + 1.13) * smoothstep(0.0, 0.7, share)
    around = np.cos(turn)[..., None] * first + np.sin(turn)[..., None] * second
    middle = knot + 0.65 * made.width * anchor
    return middle + ball[..., None] * (np.cos(rise)[..., None] * around + 0.8 * np.sin(rise)[..., None] * anchor)


def _ball(knot: Float64, anchor: Float64, made: Tie, count: int, rng: np.random.Generator) -> Float64:
    """(S, 33, 3) a puff of small coils in all directions from the knot."""
    share = np.linspace(0.0, 1.0, 33)[:, None]
    directions = unit(rng.normal(size=(count, 3)))
    directions = np.where((directions @ anchor < -0.5)[:, None], -directions, directions)
    reach = made.width * rng.uniform(0.55, 1.0, count) ** 0.5
    first, second = _across(anchor)
    turn = 2.0 * np.pi * (6.0 * share[None, :, 0] + rng.random(count)[:, None])
    coil = 0.05 * (np.cos(turn)[..., None] * first + np.sin(turn)[..., None] * second) * smoothstep(0, 0.3, share)
    middle = knot + 0.6 * made.width * anchor * smoothstep(0.0, 0.6, share)
    return middle + (reach[:, None, None] * share[None]) * directions[:, None] + coil


def _cut_to(hair: Hair, lengths: Floats) -> Hair:
    return replace(hair, strands=resample_to(hair.strands, lengths, hair.strands.shape[1]))


def _outside(hair: Hair) -> Hair:
    strands = _pushed(hair.collider, hair.strands, 0.03)
    return replace(hair, strands=strands)


def _pushed(collider: Collider, strands: Float64, soft: float) -> Float64:
    """Strands out of the head, their roots where they were."""
    near = np.minimum(soft, 0.5 * arc_lengths(strands)).ravel()
    moved = collider.push_out(strands.reshape(-1, 3), near).reshape(strands.shape)
    moved[:, 0] = strands[:, 0]
    return moved


def all_outside(strands: Float64, collider: Collider, tolerance: float = 0.01) -> Bools:
    """(S,) bool: strands no point of which lies deeper in the head than `tolerance`."""
    distance, _ = collider.distance(strands.reshape(-1, 3))
    return (distance.reshape(strands.shape[:2]) > -tolerance).all(axis=1)
