"""Depth of curls that the photos cannot show (Zhang et al. 2017, sec. 4.6; Z-23, M-40).

The directions of a hair texture lie in the surface, so strands wave in it but never up and down. A wave in a plane is
taken for the projection of a helix around an axis in that plane (Cherin et al. 2014): where the wave is r cos theta
across its middle line, the helix is r sin theta off the plane, and its projection, which the photo shows, stays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import require
from ..fields.grid import DirectionGrid
from ..fields.nearest import vectors_at
from ..types import Float64, Int64, StrandSet
from ._detail_kernels import wind_strands


@dataclass(frozen=True, slots=True)
class HelixDetailParams:
    """Settings of add_detail."""

    angle: float = 25.0  # degrees between normals and their average in a segment, the paper's
    window: float = 0.06  # metres: waves longer than this are the hairstyle's shape, not its detail
    smallest_radius: float = 0.0005  # metres: smaller waves are left flat
    strength: float = 1.0  # of the depth; 1 is the round helix
    handedness: int = 1  # 1 or -1: the way all helices turn; 0: each strand its own, at random
    seed: int = 0

    def __post_init__(self) -> None:
        require(0.0 < self.angle <= 180.0, f"angle is {self.angle} degrees; it must be above 0 and at most 180")
        require(0.001 <= self.window <= 1.0, f"window is {self.window} m; it must be in 0.001..1")
        require(self.smallest_radius > 0, f"smallest_radius is {self.smallest_radius} m; it must be above 0")
        require(0.0 <= self.strength <= 2.0, f"strength is {self.strength}; it must be in 0..2")
        require(self.handedness in (-1, 0, 1), f"handedness is {self.handedness}; it must be -1, 0 or 1")


def add_detail(
    strands: StrandSet, normal_volume: DirectionGrid, params: HelixDetailParams = HelixDetailParams()
) -> StrandSet:
    """Give the waves of strands the depth of helices (Z-23).

    Each strand is cut where its normals, looked up in the volume, leave their average by 25 degrees. In the plane
    across a segment's average normal the strand waves around its middle line; from each extremum to the next it is half
    a turn of a helix, whose radius is fitted by least squares (M-40). The turning angle runs on through all half turns,
    and radii change steadily from one to the next, so that a strand keeps its handedness and has no corners.

    Parameters
    ----------
    strands : world space, metres; guides before they are copied, or all strands.
    normal_volume : the normals of the hair's surface, carried into its volume as directions are (Z-20); dense, world
        space, metres.

    Returns
    -------
    StrandSet : the same strands, roots and attributes.

    Raises
    ------
    InputError : a volume without normals.
    """
    normals = normals_at(normal_volume, strands)
    count = strands.n_strands
    hands = np.full(count, float(params.handedness))
    if params.handedness == 0:
        hands = np.random.default_rng(params.seed).choice([-1.0, 1.0], count)
    points = np.empty_like(strands.points)
    segments, turns = np.empty(len(points), np.int32), np.empty(count, np.int64)
    wind_strands(
        np.ascontiguousarray(strands.points), strands.offsets, normals, np.cos(np.radians(params.angle)), params.window,
        params.smallest_radius, hands, params.strength, points, segments, turns,
    )  # fmt: skip
    return StrandSet(points, strands.offsets, strands.point_attributes, strands.strand_attributes)


def half_turns(
    strands: StrandSet, normal_volume: DirectionGrid, params: HelixDetailParams = HelixDetailParams()
) -> Int64:
    """(S,) how many half turns of a helix add_detail finds in each strand; for reports and choosing `n_points`."""
    turns = np.empty(strands.n_strands, np.int64)
    wind_strands(
        np.ascontiguousarray(strands.points), strands.offsets, normals_at(normal_volume, strands),
        np.cos(np.radians(params.angle)), params.window, params.smallest_radius, np.ones(strands.n_strands), 0.0,
        np.empty_like(strands.points), np.empty(len(strands.points), np.int32), turns,
    )  # fmt: skip
    return turns


def normals_at(normal_volume: DirectionGrid, strands: StrandSet) -> Float64:
    """(P, 3) unit normals at the points of the strands; beyond the cells that have one, that of the nearest cell."""
    require(normal_volume.space is None, "the volume of normals must be in world space")
    require(normal_volume.n_cells > 0, "the volume of normals is empty; make the hair's directions first")
    normals, size = vectors_at(normal_volume, strands.points)
    return np.asarray(np.where(size > 1e-6, normals / np.maximum(size, 1e-6), np.array([0.0, 0.0, 1.0])))
