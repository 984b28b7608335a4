"""The comb's brush in a view: what lies under it, how deep it reaches, and which way in the world a drag points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Bools, Float64
from .strokes import Stroke, View


@dataclass(frozen=True, slots=True)
class Projection:
    """A view as the brush needs it.

    matrix : (4, 4) float64, world to clip space. half : (2,) half the view's size, pixels.
    forward : (3,) unit, away from the eye. drag : (3, 2) float64: a world move in the plane of the view, for a point of
    clip w 1, of one pixel to the right, and of one pixel up.
    """

    matrix: Float64
    half: Float64
    forward: Float64
    drag: Float64

    def pixels(self, points: Float64) -> tuple[Float64, Float64]:
        """Pixels (n, 2) and clip w (n,) of world points (n, 3)."""
        clip = points @ self.matrix[:, :3].T + self.matrix[:, 3]
        w = clip[:, 3]
        return (clip[:, :2] / np.maximum(w, 1e-9)[:, None] + 1.0) * self.half, w

    def moves(self, points: Float64, pixels: Float64) -> Float64:
        """World moves (n, 3) in the plane of the view that move points (n, 3) by `pixels`, (2,) or (n, 2), in it."""
        w = points @ self.matrix[3, :3] + self.matrix[3, 3]
        return np.asarray(np.maximum(w, 0.0)[:, None] * (pixels @ self.drag.T))

    @property
    def length_scale(self) -> float:
        """Pixels that a metre across the view is long at clip w 1, at most, wherever it is seen."""
        # a point off the middle of a perspective view also moves with its depth
        across = float(np.linalg.norm(self.matrix[:2, :3] * self.half[:, None], axis=1).max())
        return across + float(np.linalg.norm(self.matrix[3, :3])) * float(self.half.max())

    def length(self, depth: float, pixels: float) -> float:
        """Metres that `pixels` are long at a depth along `forward`."""
        w = self.matrix[3, :3] @ (self.forward * depth) + self.matrix[3, 3]
        return float(max(w, 0.0) * np.linalg.norm(self.drag[:, 0]) * pixels)


def project(view: View) -> Projection:
    """The projection of a view, in perspective or not."""
    matrix = np.ascontiguousarray(view.matrix, np.float64)
    half = np.array([view.width, view.height]) / 2.0
    # in perspective, clip w is the depth before the eye; else it is 1 and clip z tells the depth
    forward = matrix[3, :3] if np.linalg.norm(matrix[3, :3]) > 1e-9 else matrix[2, :3]
    forward = forward / np.linalg.norm(forward)
    rows = np.stack([matrix[0, :3] * half[0], matrix[1, :3] * half[1], forward])
    return Projection(matrix, half, forward, np.linalg.inv(rows)[:, :2])


def mirrored(stroke_view: View, frame: Float64, mirror: tuple[bool, bool, bool]) -> tuple[Projection, ...]:
    """The projection and its mirror images across the chosen planes of `frame` (4, 4), in all combinations."""
    to_local = np.linalg.inv(frame)
    images: list[Float64] = [np.eye(4)]
    for axis in range(3):
        if mirror[axis]:
            flip = np.eye(4)
            flip[axis, axis] = -1.0
            images += [image @ (frame @ flip @ to_local) for image in images]
    views = [View(stroke_view.matrix @ image, stroke_view.width, stroke_view.height) for image in images]
    return tuple(project(view) for view in views)


def near_brush(projection: Projection, spheres: Float64, place: Float64, radius: float) -> Bools:
    """(K,) bool: may a sphere (K, 4; middle and radius, metres) reach into the circle at `place` (2,), pixels?"""
    pixels, w = projection.pixels(spheres[:, :3])
    sizes, matrix, half = spheres[:, 3], projection.matrix, projection.half
    # the quotient u / w changes by at most (|grad u| + |u / w| |grad w|) / w over a way of 1
    slope = float(np.linalg.norm(matrix[3, :3]))
    rates = np.linalg.norm(matrix[:2, :3], axis=1) + slope * np.abs(pixels / half - 1.0)
    nearest = np.maximum(w - slope * sizes, 1e-6)
    reach = radius + sizes / nearest * np.hypot(half[0] * rates[:, 0], half[1] * rates[:, 1])
    away = np.hypot(pixels[:, 0] - place[0], pixels[:, 1] - place[1])
    return np.asarray((away <= reach) & (w + slope * sizes > 0))


def profile_weights(profile: tuple[float, float, float], n_points: int) -> Float64:
    """(n_points,) strength from root to tip, linear between root, middle and tip."""
    return np.asarray(np.interp(np.linspace(0.0, 2.0, n_points), [0.0, 1.0, 2.0], profile))


def steps_between(start: Float64, end: Float64, largest: float) -> list[Float64]:
    """Places (2,) on the way from start to end, at most `largest` pixels apart, the last being `end`."""
    count = max(1, int(np.ceil(np.linalg.norm(end - start) / max(largest, 1e-6))))
    return [start + (end - start) * (i + 1) / count for i in range(count)]


def pressed(stroke: Stroke, pressure: float) -> tuple[float, float]:
    """Radius in pixels and strength at a pen pressure in 0..1."""
    params = stroke.params
    radius = params.radius * (max(pressure, 0.05) if params.pressure_radius else 1.0)
    return radius, params.strength * (pressure if params.pressure_strength else 1.0)
