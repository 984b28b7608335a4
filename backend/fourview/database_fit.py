"""How a hairstyle of the database comes onto any head (Z-3, M-30).

Stored hairstyles live in *fitted space*: the origin in the middle of the scalp's sphere (W-4's), its radius the unit,
axes as in the world (z up, the face towards -y), because hair hangs along gravity however a scalp is tilted. Along each
ray from the middle the scalp is moved to radius 1, so that hair lies on every head as it lay on its own; the move fades
away with the distance from the skin.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors import require
from ..geometry.head import HeadSurface, submesh
from ..geometry.scalp_space import ScalpSpace, fit_scalp_space
from ..types import Bools, Float32, Float64, Floats, Head

_FADE = 1.0  # head radii over the skin where the move along the ray has fallen to 1/e
_AIRBORNE = 0.25  # head radii; a strand that begins higher over the skin (the tail of a pony tail) is no root on it
_FARTHEST_ROOT = 0.5  # head radii that a root may have to go to the scalp; a strand farther off has no place there
_FADE_ROOT = 0.5  # head radii of arc length over which a strand forgets that its root was moved
_CLEARANCE = 3e-4  # metres between hair and skin
_SOLVER_STEPS = 12


@dataclass(frozen=True, slots=True)
class HeadFrame:
    """Fitted space of a head, or of hair whose head is not known.

    centre : (3,) float64, metres, and radius, metres, of the scalp's sphere.
    space : for the height of the scalp along each ray; None takes the sphere itself.
    turn : (3, 3) float64, rows the axes of fitted space in world space; the identity where the face is towards -y.
    """

    centre: Float64
    radius: float
    space: ScalpSpace | None = None
    turn: Float64 = field(default_factory=lambda: np.eye(3))

    def scalp_radius(self, directions: Floats) -> Float64:
        """(n,) float64, head radii: how far the scalp lies from the middle along unit `directions` (n, 3)."""
        if self.space is None:
            return np.ones(len(directions))
        world = np.asarray(directions, np.float64) @ self.turn
        height = self.space.to_scalp(self.space.world_to_head_directions(world))[:, 2]
        return np.asarray(1.0 - height.astype(np.float64))

    def to_fitted(self, points: Floats) -> Float32:
        """World points (..., 3), metres -> fitted space (..., 3) float32, head radii; undone by `to_world`."""
        flat = (np.asarray(points, np.float64).reshape(-1, 3) - self.centre) @ self.turn.T / self.radius
        distance = np.linalg.norm(flat, axis=1)
        directions = flat / np.maximum(distance, 1e-9)[:, None]
        move = self.scalp_radius(directions) - 1.0
        fitted = distance - move
        for _ in range(_SOLVER_STEPS):  # fixed-point steps; the fade's slope times the move is well below 1
            fitted = distance - move * _fade(fitted - 1.0)
        return np.asarray(directions * fitted[:, None], np.float32).reshape(np.shape(points))

    def to_world(self, points: Floats) -> Float32:
        """Fitted points (..., 3), head radii -> world (..., 3) float32, metres, on this head."""
        flat = np.asarray(points, np.float64).reshape(-1, 3)
        distance = np.linalg.norm(flat, axis=1)
        directions = flat / np.maximum(distance, 1e-9)[:, None]
        moved = distance + (self.scalp_radius(directions) - 1.0) * _fade(distance - 1.0)
        world = (directions * moved[:, None] * self.radius) @ self.turn + self.centre
        return np.asarray(world, np.float32).reshape(np.shape(points))


def frame_of_head(head: Head, space: ScalpSpace | None = None) -> HeadFrame:
    """Fitted space of a head with a scalp; `space`, its scalp space, is fitted when not given.

    Raises
    ------
    InputError : the head has no scalp.
    """
    space = fit_scalp_space(head) if space is None else space
    return HeadFrame(space.centre, space.radius, space)


def frame_of_roots(roots: Floats) -> HeadFrame:
    """Fitted space of hair whose head is not known, from its roots (n, 3), metres.

    The sphere that fits the roots best; the face lies where there are no roots, turned to the nearest of four sides.

    Raises
    ------
    InputError : fewer than 20 roots, or roots that lie on no sphere (a flat patch).
    """
    places = np.asarray(roots, np.float64)
    require(len(places) >= 20, f"{len(places)} roots do not tell where the head is; give the head's mesh too")
    middle = places.mean(axis=0)
    spread = float(np.sqrt(((places - middle) ** 2).sum(axis=1).mean()))
    require(spread > 0, "all roots are in one place; give the head's mesh too")
    local = (places - middle) / spread
    trust = np.ones(len(local))
    for _ in range(10):
        weights = np.sqrt(trust)[:, None]
        system = np.column_stack([2.0 * local, np.ones(len(local))]) * weights
        solution = np.linalg.lstsq(system, (local**2).sum(axis=1) * weights[:, 0], rcond=1e-9)[0]
        size = float(np.sqrt(max(solution[3] + solution[:3] @ solution[:3], 1e-12)))
        residual = np.linalg.norm(local - solution[:3], axis=1) - size
        trust = 1.0 / (1.0 + (residual / (0.15 * size)) ** 2)
    require(
        size < 1.9 and np.median(np.abs(residual)) < 0.12 * size,
        "the roots lie on no round head; give the head's mesh too",
    )
    centre, radius = middle + spread * solution[:3], spread * size
    return HeadFrame(centre, radius, None, _turn_of_face(places - centre))


def _turn_of_face(from_centre: Float64) -> Float64:
    """(3, 3) rows of the axes that bring the bald side, where the face is, to -y; the identity where all is hairy."""
    around = from_centre[:, :2].mean(axis=0) / np.linalg.norm(from_centre, axis=1).mean()
    quarter = round(float(np.arctan2(around[0], around[1])) / (0.5 * np.pi)) if np.linalg.norm(around) > 0.05 else 0
    angle = 0.5 * np.pi * quarter
    cosine, sine = round(np.cos(angle)), round(np.sin(angle))
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]) + 0.0


def fit_to_head(points: Float32, head: Head, frame: HeadFrame) -> tuple[Float32, Bools]:
    """Strands of fitted space on a head: roots on its scalp, no point and no chord inside.

    Parameters
    ----------
    points : (S, N, 3) float32, fitted space. frame : `frame_of_head(head)`.

    Returns
    -------
    strands : (K, N, 3) float32, world space, metres. kept : (S,) bool; a strand whose root finds no scalp is left out.

    Raises
    ------
    InputError : no strand finds a place.
    """
    world = frame.to_world(points).astype(np.float64)
    scalp = HeadSurface(submesh(head, head.scalp))
    closest = scalp.closest_points(world[:, 0])[0].astype(np.float64)
    shift = closest - world[:, 0]
    distance = np.linalg.norm(shift, axis=1) / frame.radius
    airborne = np.linalg.norm(points[:, 0], axis=1) > 1.0 + _AIRBORNE
    kept = airborne | (distance <= _FARTHEST_ROOT)
    require(kept.any(), "no strand of the hairstyle has a place on this head's scalp; mark a larger scalp")
    shift[airborne] = 0.0
    world, shift, airborne = world[kept], shift[kept], airborne[kept]
    steps = np.linalg.norm(np.diff(world, axis=1), axis=2)
    arcs = np.concatenate([np.zeros((len(world), 1)), np.cumsum(steps, axis=1)], axis=1)
    world += shift[:, None, :] * np.exp(-((arcs / (_FADE_ROOT * frame.radius)) ** 2))[..., None]
    world = _leave_head(world, HeadSurface(head), frame.radius)
    roots = closest[kept]
    world[:, 0] = np.where(airborne[:, None], world[:, 0], roots)
    return world.astype(np.float32), kept


def _leave_head(world: Float64, surface: HeadSurface, radius: float) -> Float64:
    """Strands (S, N, 3), metres, with all points but the roots out of the head, and their chords too.

    A chord of a step dips by step^2 / 8 R below the arc of a head of radius R, so points keep that far off; where the
    head is rounder, both ends of a chord that still dips move by what is missing.
    """
    moved = world.copy()
    for _ in range(2):
        points = moved[:, 1:].reshape(-1, 3)
        steps = np.linalg.norm(np.diff(moved, axis=1), axis=2)
        longest = np.maximum(steps, np.concatenate([steps[:, 1:], steps[:, -1:]], axis=1)).ravel()
        clearance = _CLEARANCE + np.minimum(longest**2 / (8.0 * 0.8 * radius), 0.05 * radius)
        moved[:, 1:] = (points + _way_out(points, clearance, surface)).reshape(moved[:, 1:].shape)
        middles = 0.5 * (moved[:, 2:] + moved[:, 1:-1]).reshape(-1, 3)
        missing = _way_out(middles, np.full(len(middles), _CLEARANCE), surface).reshape(len(moved), -1, 3)
        moved[:, 1:-1] += missing
        moved[:, 2:] += missing
    points = moved[:, 1:].reshape(-1, 3)
    moved[:, 1:] = (points + _way_out(points, np.full(len(points), _CLEARANCE), surface)).reshape(moved[:, 1:].shape)
    return moved


def _way_out(points: Float64, clearance: Float64, surface: HeadSurface) -> Float64:
    """(n, 3), metres: moves that bring points (n, 3) as far out of the head as their clearance (n,)."""
    moves = np.zeros_like(points)
    low, high = surface.head.vertices.min(axis=0) - 0.01, surface.head.vertices.max(axis=0) + 0.01
    near = np.flatnonzero(((points > low) & (points < high)).all(axis=1))
    near = near[surface.signed_distance(points[near]) < clearance[near]]
    if len(near):
        closest, triangle, barycentric = surface.closest_points(points[near])
        normals = surface.normals_at(triangle, barycentric)
        moves[near] = closest + normals * clearance[near, None] - points[near]
    return moves


def _fade(height: Float64) -> Float64:
    return np.asarray(np.exp(-((np.maximum(height, 0.0) / _FADE) ** 2)))
