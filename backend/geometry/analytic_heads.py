"""Heads with known geometry, for tests and first steps."""

from __future__ import annotations

import numpy as np

from ..errors import require
from ..types import Head


def sphere_head(
    radius: float = 0.1,
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    n_rings: int = 64,
    scalp_angle_deg: float = 90.0,
) -> Head:
    """A spherical head, for tests and first steps: scalp within `scalp_angle_deg` of the top (+z).

    Rings of latitude, `2 n_rings` vertices each, so that ring boundaries and the scalp's border coincide when
    `scalp_angle_deg` is a multiple of 180 / n_rings. Texture coordinates are longitude and latitude. Metres.
    """
    require(radius > 0, f"the radius is {radius}; it must be above 0")
    require(n_rings >= 4, f"n_rings is {n_rings}; it must be 4 or more")
    n_columns = 2 * n_rings
    polar = np.repeat(np.linspace(0.0, np.pi, n_rings + 1)[1:-1], n_columns)
    azimuth = np.tile(np.arange(n_columns) * (2 * np.pi / n_columns), n_rings - 1)
    ring_points = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)
    vertices = np.vstack([ring_points, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    column = np.arange(n_columns)
    after = (column + 1) % n_columns
    north, south = len(ring_points), len(ring_points) + 1
    ring = (np.arange(n_rings - 2) * n_columns)[:, None]
    upper, upper_next, lower, lower_next = (
        ring + column,
        ring + after,
        ring + column + n_columns,
        ring + after + n_columns,
    )
    last = (n_rings - 2) * n_columns
    triangles = np.vstack(
        [
            np.stack([np.full(n_columns, north), column, after], axis=1),
            np.stack([upper, lower, lower_next], axis=-1).reshape(-1, 3),
            np.stack([upper, lower_next, upper_next], axis=-1).reshape(-1, 3),
            np.stack([np.full(n_columns, south), last + after, last + column], axis=1),
        ]
    ).astype(np.int32)
    corners = vertices[triangles]
    lowest = corners[..., 2].min(axis=1)
    scalp = lowest >= np.cos(np.radians(scalp_angle_deg)) - 1e-9
    longitude = np.arctan2(corners[..., 1], corners[..., 0]) / (2 * np.pi) + 0.5
    # the faces across the seam: corners on the low side move by one turn
    longitude += (longitude.max(axis=1, keepdims=True) - longitude) > 0.5
    latitude = 1.0 - np.arccos(np.clip(corners[..., 2], -1, 1)) / np.pi
    corner_uv = np.stack([longitude, latitude], axis=-1).astype(np.float32)
    placed = (vertices * radius + np.asarray(centre)).astype(np.float32)
    return Head(placed, triangles, scalp, corner_uv)
