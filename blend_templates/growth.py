"""How a starter groom grows: strands follow comb, gravity and head, gather into wisps, curl, and are cut.

All in the collider's unit: origin at the middle of the scalp's sphere, its radius 1, z up, the face towards -y. Arrays
of strands are (S, M, 3) float64. Every step works on all strands at once; only `grow` loops, over the points along
them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from collider import Collider
from hairloom.errors import require
from hairloom.geometry.frames import transport_frames
from hairloom.types import Float64, Floats, Int32
from scipy.spatial import cKDTree

DOWN = np.array([0.0, 0.0, -1.0])
FRONT = np.array([0.0, -1.0, 0.0])


@dataclass(frozen=True, slots=True)
class Style:
    """A hairstyle in numbers. Lengths are in head radii (about 9.5 cm), angles in degrees.

    n_points : of a strand, as many as its curls need. n_strands : as many as cover the head; short hair needs more.
    length : longest a strand grows. length_spread : its relative standard deviation.
    cut_height : height over the head's centre at which hanging hair is cut straight; None: cut by length alone.
    side_length, nape_length : factors on the length at the temples and at the nape.
    part : x of the parting; hair is combed away from it.
    part_front, part_back : where it begins and ends, degrees over the head (0 the face, 90 the top, 180 the back).
    whorl : turn of the comb around the parting's back end.
    comb, gravity, lift : pulls along the comb, down and away from the head.
    sweep_back : turns the comb of the front half backwards.
    comb_fade : arc length over which the comb loses its hold. bend : arc length a strand needs to turn.
    side_lift : factor on the lift at the sides. root_lift : how steeply strands leave the skin, 0 flat.
    thickness : of the layer of hair; strands from the top lie over those from below.
    wander : by how much wisps differ from the comb.
    fringe_height : the hair over the brow is cut at this height; None: no fringe.
    bend_under : pull of the ends towards the neck.
    coarse_wisps, wisps : how many, of a groom of 10,000 strands.
    coarse_clump, clump : 0 none .. 1 all strands of a wisp meet at its tip. clump_power : above 1 gathers late.
    curl, curl_pitch : radius and length of a turn. curl_flat : 0 a coil, 1 a flat wave.
    curl_start : arc length where curls are fully formed. curl_spread : turn between strands of a wisp, radians.
    coarse_wave, coarse_pitch : flat waves of the coarse wisps, as `curl`.
    frizz : sideways wander of single strands at the tip. flyaways : share of strands that leave the wisps.
    strand_radius : at the root, metres; thicker than real hair, because 10,000 strands stand for 100,000.
    melanin, redness : of the hair material.
    """

    n_points: int
    length: float
    n_strands: int = 10_000
    cut_height: float | None = None
    length_spread: float = 0.1
    side_length: float = 1.0
    nape_length: float = 1.0
    part: float = 0.0
    part_front: float = -30.0
    part_back: float = 115.0
    whorl: float = 0.0
    comb: float = 1.0
    comb_fade: float = 3.0
    gravity: float = 1.0
    lift: float = 0.0
    side_lift: float = 1.0
    sweep_back: float = 0.0
    bend: float = 0.35
    root_lift: float = 0.5
    thickness: float = 0.14
    wander: float = 8.0
    fringe_height: float | None = None
    bend_under: float = 0.0
    coarse_wisps: int = 220
    wisps: int = 1400
    coarse_clump: float = 0.35
    clump: float = 0.7
    clump_power: float = 1.0
    curl: float = 0.0
    curl_pitch: float = 0.4
    curl_flat: float = 0.0
    curl_start: float = 0.8
    curl_spread: float = 0.35
    coarse_wave: float = 0.0
    coarse_pitch: float = 1.0
    frizz: float = 0.01
    flyaways: float = 0.03
    strand_radius: float = 1.3e-4  # metres, at the root
    melanin: float = 0.6
    redness: float = 0.5

    def __post_init__(self) -> None:
        require(self.n_points >= 2, f"n_points is {self.n_points}; a strand needs 2 or more")
        require(self.length > 0, f"the length is {self.length}; it must be above 0")
        require(0 <= self.flyaways <= 1, f"the share of flyaways is {self.flyaways}; it must lie in 0 .. 1")
        require(self.curl_pitch > 0 and self.coarse_pitch > 0, "the length of a turn must be above 0")


@dataclass(frozen=True, slots=True)
class Wisps:
    """Wisps of S strands. labels : (S,) int32. centres : (W,) int32, the strand in the middle of each wisp."""

    labels: Int32
    centres: Int32

    def spread(self, values: Floats) -> Floats:
        """Values per wisp (W, ...) handed to the strands (S, ...)."""
        return np.asarray(values)[self.labels]


def smoothstep(low: float, high: float, x: Floats) -> Floats:
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def unit(vectors: Floats) -> Floats:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)


def gather_wisps(roots: Float64, side: Float64, count: int, rng: np.random.Generator) -> Wisps:
    """Cells of about equal size around evenly drawn strands; `side` (S,) +-1 keeps the two sides of a parting apart."""
    places = np.column_stack([roots, 0.5 * side])
    count = min(count, len(places))
    # farthest of a few candidates at a time would be serial; Lloyd on a random draw spaces the middles as well
    middles = places[rng.choice(len(places), count, replace=False)]
    for _ in range(4):
        labels = cKDTree(middles).query(places)[1]
        sizes = np.bincount(labels, minlength=count)
        sums = np.stack([np.bincount(labels, places[:, axis], count) for axis in range(4)], axis=1)
        middles = np.where(sizes[:, None] > 0, sums / np.maximum(sizes, 1)[:, None], middles)
    distance, labels = cKDTree(middles).query(places)
    used, labels = np.unique(labels, return_inverse=True)
    # the first strand of each wisp when sorted by distance to the middle
    order = np.lexsort((distance, labels))
    centres = order[np.searchsorted(labels[order], np.arange(len(used)))]
    return Wisps(labels.astype(np.int32), centres.astype(np.int32))


def nearest_on_part(style: Style, on_sphere: Float64) -> Float64:
    """(n, 3): the nearest places of the parting to directions (n, 3) from the middle of the head."""
    angle = np.degrees(np.arctan2(on_sphere[:, 2], -on_sphere[:, 1]))
    # behind the nape the angle runs on from 180 instead of starting again at -180
    angle = np.where(angle < -90.0, angle + 360.0, angle)
    nearest = np.radians(np.clip(angle, style.part_front, style.part_back))
    reach = np.sqrt(1.0 - style.part**2)
    return np.stack([np.full_like(nearest, style.part), -reach * np.cos(nearest), reach * np.sin(nearest)], axis=1)


def comb_directions(style: Style, points: Float64) -> Float64:
    """(n, 3) unit: away from the parting, along the sphere about the head; turned by the whorl."""
    on_sphere = unit(points)
    away = on_sphere - nearest_on_part(style, on_sphere)
    away -= (away * on_sphere).sum(axis=1, keepdims=True) * on_sphere
    before = smoothstep(0.5, -0.2, on_sphere[:, 1])[:, None]
    away += style.sweep_back * before * (-FRONT - (on_sphere @ -FRONT)[:, None] * on_sphere)
    away = unit(away)
    end, reach = np.radians(style.part_back), np.sqrt(1.0 - style.part**2)
    crown = np.array([style.part, -reach * np.cos(end), reach * np.sin(end)])
    turn = np.radians(style.whorl) * np.exp(-((np.linalg.norm(on_sphere - crown, axis=1) / 0.7) ** 2))
    return turn_about(away, on_sphere, turn)


def turn_about(vectors: Float64, axes: Float64, angle: Floats) -> Float64:
    """Turn tangent vectors (n, 3) about the unit axes (n, 3), at right angles to them, by angle (n,) radians."""
    return np.cos(angle)[:, None] * vectors + np.sin(angle)[:, None] * np.cross(axes, vectors)


def face_pull(points: Float64) -> Float64:
    """(n, 3): pushes strands that hang before the face to its sides."""
    before = smoothstep(0.25, 0.85, -points[:, 1]) * smoothstep(0.75, 0.25, points[:, 2])
    before *= smoothstep(1.0, 0.55, np.abs(points[:, 0])) * smoothstep(-1.9, -1.3, points[:, 2])
    side = np.where(points[:, 0] >= 0, 1.0, -1.0)
    return before[:, None] * np.stack([side, np.full_like(side, 0.6), np.zeros_like(side)], axis=1)


def shoulder_pull(points: Float64, roots: Float64) -> Float64:
    """(n, 3): takes hair below the chin before or behind the shoulders, on which it would else pile up."""
    aim = np.where(roots[:, 1] < 0.05, -0.3, 0.8)
    low = smoothstep(-0.6, -1.7, points[:, 2])
    pull = np.zeros_like(points)
    pull[:, 1] = low * np.clip(aim - points[:, 1], -0.8, 0.8)
    return pull


def fringe_weight(style: Style, roots: Float64) -> Floats:
    """(S,) 1 for strands of the fringe, 0 for the others, between at its border."""
    if style.fringe_height is None:
        return np.zeros(len(roots))
    on_sphere = unit(roots)
    angle = np.degrees(np.arctan2(on_sphere[:, 2], -on_sphere[:, 1]))
    # a triangle, its corner on top of the head, with soft sides: the hair fans out there and leaves no gap
    half_width = 0.8 * (80.0 - angle) / 45.0
    weight = smoothstep(0.06, -0.1, np.abs(on_sphere[:, 0]) - half_width) * (angle < 80.0)
    # sideburns start below it
    return np.asarray(weight * (roots[:, 2] > style.fringe_height + 0.25))


@dataclass(frozen=True, slots=True)
class Course:
    """What differs from strand to strand while growing, each (S,).

    angle : from the comb, radians. lift : factor. height : over the head where it lies, head radii. fringe : weight.
    """

    angle: Floats
    lift: Floats
    height: Floats
    fringe: Floats


def grow(style: Style, collider: Collider, roots: Float64, normals: Float64, course: Course, n_steps: int) -> Float64:
    """(S, n_steps + 1, 3): strands of the style's length, in steps of equal length, before wisps and curls."""
    step = style.length / n_steps
    stiffness = 1.0 - np.exp(-step / style.bend)
    combed = _comb(style, roots, course)
    direction = unit(combed + (style.root_lift * course.lift)[:, None] * normals)
    rising = smoothstep(0.1, 0.8, unit(roots)[:, 2])
    strands = np.empty((len(roots), n_steps + 1, 3))
    strands[:, 0] = position = roots
    for index in range(1, n_steps + 1):
        arc = index * step
        _, outward = collider.distance(position)
        hold = style.comb * np.exp(-((arc / style.comb_fade) ** 2))
        target = hold * _comb(style, position, course) + style.gravity * DOWN
        lift = style.lift * course.lift * (style.side_lift + (1.0 - style.side_lift) * rising)
        target += lift[:, None] * unit(position)
        target += style.gravity * shoulder_pull(position, roots)
        target += 1.6 * (1.0 - course.fringe)[:, None] * face_pull(position) * style.gravity
        if style.bend_under and style.cut_height is not None:
            end = smoothstep(style.cut_height + 0.65, style.cut_height, position[:, 2]) * (1.0 - course.fringe)
            target -= style.bend_under * end[:, None] * unit(position * [1.0, 1.0, 0.0])
        direction = unit(direction + stiffness * (unit(target) - direction))
        position = position + step * direction
        distance, outward = collider.distance(position)
        clearance = course.height * smoothstep(0.0, 0.9, np.full(len(roots), arc)) + 0.004
        position = position + np.maximum(clearance - distance, 0.0)[:, None] * outward
        inward = np.minimum((direction * outward).sum(axis=1), 0.0) * (distance < clearance)
        direction = unit(direction - inward[:, None] * outward)
        strands[:, index] = position
    return strands


def _comb(style: Style, points: Float64, course: Course) -> Float64:
    on_sphere = unit(points)
    forward = unit(FRONT - (on_sphere @ FRONT)[:, None] * on_sphere + 0.35 * on_sphere * [1.0, 0.0, 0.0])
    combed = comb_directions(style, points)
    combed = unit(combed + course.fringe[:, None] * (forward - combed))
    return turn_about(combed, on_sphere, course.angle)


def arc_lengths(strands: Float64) -> Float64:
    """(S, M): distance along the strand from its root."""
    steps = np.linalg.norm(np.diff(strands, axis=1), axis=2)
    return np.concatenate([np.zeros((len(strands), 1)), np.cumsum(steps, axis=1)], axis=1)


def resample_to(strands: Float64, lengths: Floats, n_points: int) -> Float64:
    """(S, n_points, 3): the first lengths (S,) of the strands in steps of equal length."""
    arcs = arc_lengths(strands)
    wanted = np.minimum(lengths, arcs[:, -1])[:, None] * np.linspace(0.0, 1.0, n_points)
    count, n_old = arcs.shape
    # one search for all strands: each strand's arcs moved to a range of its own
    shift = (np.arange(count) * (arcs.max() + 1.0))[:, None]
    after = np.searchsorted((arcs + shift).ravel(), (wanted + shift).ravel()).reshape(wanted.shape)
    after = np.clip(after - np.arange(count)[:, None] * n_old, 1, n_old - 1)
    rows = np.arange(count)[:, None]
    before_arc, after_arc = arcs[rows, after - 1], arcs[rows, after]
    t = np.clip((wanted - before_arc) / np.maximum(after_arc - before_arc, 1e-12), 0.0, 1.0)[..., None]
    return strands[rows, after - 1] * (1.0 - t) + strands[rows, after] * t


def clump(strands: Float64, wisps: Wisps, strength: Floats, power: float, lengths: Floats) -> Float64:
    """Draw strands (S, M, 3), of common step, towards the centre of their wisp: by `strength` (S,) at their tips."""
    centres = strands[wisps.centres][wisps.labels]
    t = np.clip(arc_lengths(strands) / lengths[:, None], 0.0, 1.0)
    weight = strength[:, None] * smoothstep(0.0, 1.0, t) ** power
    return strands + weight[..., None] * (centres - strands)


def wave(
    arcs: Floats, radius: Floats, pitch: Floats, phase: Floats, flat: float, hand: Floats, start: float
) -> tuple[Floats, Floats]:
    """Offsets (S, N) along the frame's binormal and normal of a curl of radius (S,), turn length (S,), phase (S,)."""
    grown = radius[:, None] * smoothstep(0.0, start, arcs)
    angle = 2.0 * np.pi * arcs / pitch[:, None] + phase[:, None]
    return grown * np.sin(angle), (1.0 - flat) * grown * hand[:, None] * np.cos(angle)


def wander_along(arcs: Floats, wavelength: float, rng: np.random.Generator, n_waves: int = 3) -> Floats:
    """(S, N, 3) smooth noise along strands, standard deviation about 1, each strand its own."""
    count = len(arcs)
    noise = np.zeros((*arcs.shape, 3))
    for octave in range(n_waves):
        frequency = 2.0 * np.pi * 1.9**octave / wavelength * rng.uniform(0.7, 1.4, (count, 1, 3))
        phase = rng.uniform(0.0, 2.0 * np.pi, (count, 1, 3))
        noise += np.sin(arcs[..., None] * frequency + phase) * (0.6**octave)
    return noise


def frames_along(strands: Float64, normals: Float64) -> Float64:
    """(S, N, 3, 3) columns normal, binormal, tangent; the start normal is made from the skin's."""
    return transport_frames(strands, normals).astype(np.float64)
