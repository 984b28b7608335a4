"""Hair and guides for the tests of interpolation, and the slow way to move one by the other."""

from __future__ import annotations

import numpy as np
from hairloom.geometry.strands import arc_lengths, from_dense
from hairloom.rods.helices import Helices, evaluate
from hairloom.rods.interpolation import Followers
from hairloom.types import StrandSet
from scipy.spatial.transform import Rotation

CENTRE = np.array([0.02, -0.01, 1.6])
RADIUS = 0.09


def hair_on_sphere(n_strands: int, *, n_elements: int = 5, length: float = 0.25, seed: int = 0) -> Helices:
    """Strands that leave the upper half of a sphere along its normals and bend smoothly over it."""
    rng = np.random.default_rng(seed)
    height, turn = rng.uniform(0.1, 1.0, n_strands), rng.uniform(0.0, 2.0 * np.pi, n_strands)
    flat = np.sqrt(1.0 - height**2)
    outward = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=-1)
    side = np.cross([0.0, 0.0, 1.0], outward)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    frames = np.stack([outward, side, np.cross(outward, side)], axis=-1)
    count = n_strands * n_elements
    # they bend down, more so at the sides, and curl a little
    bend = np.repeat(2.0 + 3.0 * flat, n_elements)
    curvatures = np.stack([np.full(count, 1.0), bend, np.full(count, 0.5)], axis=-1)
    return Helices(
        CENTRE + RADIUS * outward,
        frames,
        np.arange(n_strands + 1, dtype=np.int32) * n_elements,
        np.full(count, length / n_elements),
        curvatures,
    )


def as_strands(helices: Helices, n_points: int = 33) -> StrandSet:
    return from_dense(evaluate(helices, n_points)[0])


def bent(helices: Helices, change: np.ndarray) -> Helices:
    """The strands with other curvatures; `change` (3,) or (E, 3), 1/m."""
    return Helices(helices.roots, helices.frames, helices.offsets, helices.lengths, helices.curvatures + change)


def swayed(helices: Helices, seconds: float) -> Helices:
    """A motion that varies over the head: curvatures that swing with the root's place and the element's."""
    elements = np.arange(len(helices.lengths)) - np.repeat(helices.offsets[:-1], helices.element_counts)
    roots = np.repeat(helices.roots - CENTRE, helices.element_counts, axis=0) / RADIUS
    phase = 9.0 * seconds + 1.5 * roots[:, 0] + 0.7 * elements
    swing = [np.sin(0.7 * phase), 2.0 * np.sin(phase) + roots[:, 1], 1.5 * np.cos(1.3 * phase + roots[:, 2])]
    return bent(helices, min(1.0, 2.0 * seconds) * np.stack(swing, axis=-1))


def rigid(rotation_vector: tuple[float, float, float], translation: tuple[float, float, float]) -> np.ndarray:
    """(3, 4) about the sphere's centre."""
    turn = Rotation.from_rotvec(rotation_vector).as_matrix()
    return np.concatenate([turn, (CENTRE + translation - turn @ CENTRE)[:, None]], axis=1)


def carried(points: np.ndarray, frames: np.ndarray, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (..., 3) and frames (..., 3, 3) after a rigid motion (3, 4)."""
    return points @ motion[:, :3].T + motion[:, 3], motion[:, :3] @ frames


def interpolate_naive(followers: Followers, points: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """B-27 as it is written: x = sum_g w_g (R_g R0_g^T (x0 - g0) + g), point by point, in float64; then the lengths."""
    strands = StrandSet(followers.points, followers.offsets)
    reached = arc_lengths(strands)
    out = np.zeros((len(followers.points), 3))
    steps, spans = followers.n_samples - 1, followers.n_knots - 1
    for strand in range(followers.n_strands):
        span = range(followers.offsets[strand], followers.offsets[strand + 1])
        length = max(reached[span[-1]], 1e-300)
        for i in span:
            place = reached[i] / length * steps
            sample = min(int(place), steps - 1)
            for m, share in ((sample, 1.0 - (place - sample)), (sample + 1, place - sample)):
                knot = min(int(m / steps * spans), spans - 1)
                part = m / steps * spans - knot
                weights = (1.0 - part) * followers.weights[strand, knot] + part * followers.weights[strand, knot + 1]
                for guide, weight in zip(followers.guides[strand], weights):
                    turn = frames[guide, m] @ followers.guide_frames[guide, m].T
                    offset = followers.points[i] - followers.guide_points[guide, m]
                    out[i] += share * weight * (turn @ offset + points[guide, m])
        keep_lengths_naive(followers.points[span.start : span.stop].astype(float), out[span.start : span.stop])
    return out


def keep_lengths_naive(rest: np.ndarray, points: np.ndarray) -> None:
    """From the root on, bring segments to within 0.5 % of their length at rest, and carry the hair beyond along."""
    for i in range(1, len(points)):
        length, along = np.linalg.norm(rest[i] - rest[i - 1]), points[i] - points[i - 1]
        now = np.linalg.norm(along)
        if now > 0:
            points[i:] += (np.clip(now, 0.995 * length, 1.005 * length) / now - 1.0) * along
