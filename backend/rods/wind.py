"""Moving air from force fields: gusts, falloff and turbulence (Bao & Qi 2017, sec. VI; B-28)."""

from __future__ import annotations

import numpy as np

from ..types import Float64
from .scene import ForceField, Scene

_GUST_HERTZ = (0.35, 0.9, 2.1)  # incommensurate, so that gusts do not repeat
_GUST_SHARES = (0.5, 0.3, 0.2)
_TURBULENCE_WAVES = 12


def wind_at(scene: Scene, frame: float, points: Float64) -> Float64:
    """(n, 3) float64, m/s: how fast the air moves at world points (n, 3), at a frame counted from the scene's first.

    The fields add up. Between two frames everything is linear. O(n) a field.
    """
    air = np.zeros_like(points)
    for field in scene.fields:
        strength = _between(field.strength, frame)
        if strength != 0.0:
            air += strength * _direction(field, frame, scene.fps, points)
    return air


def _direction(field: ForceField, frame: float, fps: float, points: Float64) -> Float64:
    """(n, 3) the air's velocity at points (n, 3), for a strength of 1 m/s."""
    matrix = _between(field.matrices, frame)
    origin, axis = matrix[:3, 3], matrix[:3, 2] / max(float(np.linalg.norm(matrix[:3, 2])), 1e-12)
    offset = points - origin
    seconds = frame / fps
    noise = _between(field.noise, frame)
    if field.kind == "turbulence":
        unit = _turbulence(field, points, seconds)
        reach = np.linalg.norm(offset, axis=1)
    elif field.kind == "wind":
        unit = np.broadcast_to(axis, points.shape)
        # a wind is a plane that blows: it weakens with the height above its plane
        reach = np.abs(offset @ axis)
    else:
        reach = np.linalg.norm(offset, axis=1)
        way = offset if field.kind == "force" else np.cross(axis, offset)
        unit = way / np.maximum(np.linalg.norm(way, axis=1), 1e-12)[:, None]
    gust = 1.0 + noise * _gust(field.seed, seconds)
    return np.asarray(gust * _falloff(field, reach)[:, None] * unit)


def _falloff(field: ForceField, reach: Float64) -> Float64:
    """(n,) the share of the strength at distances (n,), m: 1 up to distance_min, then a power, 0 from distance_max."""
    beyond = np.maximum(reach - field.distance_min, 0.0)
    share = (1.0 + beyond) ** -field.falloff_power
    if field.distance_max > 0.0:
        share = np.where(reach > field.distance_max, 0.0, share)
    return np.asarray(share)


def _gust(seed: int, seconds: float) -> float:
    """From -1 to 1, smooth in time, the same for the same seed."""
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(_GUST_HERTZ))
    waves = np.sin(2.0 * np.pi * np.array(_GUST_HERTZ) * seconds + phases)
    return float(np.dot(_GUST_SHARES, waves))


def _turbulence(field: ForceField, points: Float64, seconds: float) -> Float64:
    """(n, 3) a field without divergence, root mean square 1: plane waves across their own direction."""
    generator = np.random.default_rng(field.seed)
    waves = generator.normal(size=(_TURBULENCE_WAVES, 3))
    waves /= np.linalg.norm(waves, axis=1)[:, None]
    across = np.cross(waves, generator.normal(size=waves.shape))
    across /= np.linalg.norm(across, axis=1)[:, None]
    numbers = 2.0 * np.pi / field.size * generator.uniform(0.5, 1.5, _TURBULENCE_WAVES)
    hertz = generator.uniform(0.3, 1.5, _TURBULENCE_WAVES)
    phases = generator.uniform(0.0, 2.0 * np.pi, _TURBULENCE_WAVES)
    angles = (points @ waves.T) * numbers + 2.0 * np.pi * hertz * seconds + phases
    return np.asarray(np.cos(angles) @ across * np.sqrt(2.0 / _TURBULENCE_WAVES))


def _between(values: Float64, frame: float) -> Float64:
    """The value (...) of frames (F, ...) at a frame that may lie between two; the ends hold beyond them."""
    place = min(max(frame, 0.0), len(values) - 1.0)
    first = min(int(place), max(len(values) - 2, 0))
    share = place - first
    last = min(first + 1, len(values) - 1)
    return np.asarray((1.0 - share) * values[first] + share * values[last])
