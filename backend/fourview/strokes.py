"""Strokes that a user drew on views, laid onto the surface (Z-19)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from ..errors import require
from ..geometry.camera import rays, towards
from ..geometry.head import HeadSurface
from ..types import Float32, Float64, Head, Mesh
from .regions import unit
from .texels import TexelMap
from .views import DirectionStroke

_NEAREST = 16  # samples of strokes that a texel looks at
_GRAZING = 0.1  # cosine to the view below which a stroke's place on the surface is not known well enough
_JUMP = 8.0  # times the usual distance between samples: a stroke that goes on behind an edge is cut there


def stroke_directions(strokes: Sequence[DirectionStroke], mesh: Mesh, texels: TexelMap, reach: float) -> Float32:
    """(T, 3) float32: direction of the stroke over each texel, unit and tangential, 0 where there is none.

    A stroke marks the texels within `reach`, metres, of where it first meets the surface. Where several do, the one
    whose view looks most straight at the surface wins.

    Raises
    ------
    InputError : a stroke that nowhere lies on the hair.
    """
    directions = np.zeros((texels.n_texels, 3), np.float32)
    if not strokes:
        return directions
    count = len(mesh.triangles)
    surface = HeadSurface(
        Head(mesh.vertices, mesh.triangles, np.zeros(count, np.bool_), np.zeros((count, 3, 2), np.float32))
    )
    parts = [_on_surface(stroke, surface, number) for number, stroke in enumerate(strokes, start=1)]
    points, headings, facing = (np.concatenate(column) for column in zip(*parts))
    low, high = points.min(axis=0) - reach, points.max(axis=0) + reach
    near = np.flatnonzero(((texels.points >= low) & (texels.points <= high)).all(axis=1))
    n_near = min(_NEAREST, len(points))
    distance, sample = cKDTree(points).query(texels.points[near], k=n_near, distance_upper_bound=reach)
    distance, sample = distance.reshape(len(near), n_near), sample.reshape(len(near), n_near)
    known = np.isfinite(distance)
    score = np.where(known, facing[np.where(known, sample, 0)] - 0.01 * distance / reach, -1.0)
    best = score.argmax(axis=1)
    rows = np.flatnonzero(known.any(axis=1))
    chosen = headings[sample[rows, best[rows]]]
    normals = texels.normals[near[rows]].astype(np.float64)
    tangential = chosen - np.einsum("nc,nc->n", chosen, normals)[:, None] * normals
    directions[near[rows]] = unit(tangential)
    return directions


def _on_surface(stroke: DirectionStroke, surface: HeadSurface, number: int) -> tuple[Float64, Float64, Float64]:
    """Points (n, 3), directions (n, 3) and the cosine to the view (n,) of a stroke's samples, a pixel apart."""
    steps = np.linalg.norm(np.diff(stroke.points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    require(along[-1] > 0, f"stroke {number} has no length; draw it again")
    places = np.linspace(0.0, along[-1], int(np.ceil(along[-1])) + 1)
    pixels = np.stack([np.interp(places, along, stroke.points[:, axis]) for axis in range(2)], axis=1)
    origins, headings = rays(stroke.camera, pixels)
    distance, triangle = surface.first_hits(origins, headings)
    hit = triangle >= 0
    require(hit.any(), f"stroke {number} lies nowhere on the hair; draw it over the hair of its view")
    points = origins + headings * np.where(hit, distance, 0.0)[:, None]
    facing = np.abs(
        np.einsum("nc,nc->n", surface.face_normals[np.maximum(triangle, 0)], towards(stroke.camera, points))
    )
    moves = np.diff(points, axis=0)
    lengths = np.linalg.norm(moves, axis=1)
    joined = hit[:-1] & hit[1:]
    joined &= lengths < _JUMP * max(float(np.median(lengths[joined])), 1e-9) if joined.any() else joined
    tangents = np.zeros_like(points)
    tangents[:-1][joined] += moves[joined]
    tangents[1:][joined] += moves[joined]
    kept = hit & (np.linalg.norm(tangents, axis=1) > 0) & (facing > _GRAZING)
    require(kept.any(), f"stroke {number} lies nowhere on the hair; draw it over the hair of its view")
    return points[kept], unit(tangents[kept]), facing[kept]
