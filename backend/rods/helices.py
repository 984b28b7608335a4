"""Strands as piecewise helices: what the fit makes and the dynamics moves (Bao & Qi 2017, sec. V; B-21)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import require
from ..types import Float64, Int32, StrandSet, check_array
from ._helix_kernels import evaluate_helices

_POINTS_PER_ELEMENT = 8  # of to_strands, where nothing else is said
_MAX_POINTS = 2**31 - 1  # offsets are int32


@dataclass(frozen=True, slots=True)
class Helices:
    """S strands of E helical elements in all, each strand's elements stored root first.

    Within an element the Darboux vector is constant in the material frame (n0 tangent, n1, n2): Omega = sum_j q_j n_j,
    n_i' = Omega x n_i. A strand's positions follow from its root, the frame there, and its elements.

    roots : (S, 3) float64, metres.
    frames : (S, 3, 3) float64, right-handed orthonormal, columns n0, n1, n2 at the root.
    offsets : (S + 1,) int32; strand s owns the elements offsets[s]:offsets[s + 1], at least one.
    lengths : (E,) float64, metres, above 0.
    curvatures : (E, 3) float64, 1/m: twist q0 and the curvatures q1, q2 about n1 and n2.
    """

    roots: Float64
    frames: Float64
    offsets: Int32
    lengths: Float64
    curvatures: Float64

    def __post_init__(self) -> None:
        count = len(self.roots)
        check_array("roots", self.roots, np.float64, (None, 3))
        check_array("frames", self.frames, np.float64, (count, 3, 3))
        check_array("offsets", self.offsets, np.int32, (count + 1,))
        check_array("lengths", self.lengths, np.float64, (None,))
        check_array("curvatures", self.curvatures, np.float64, (len(self.lengths), 3))
        require(self.offsets[0] == 0 and self.offsets[-1] == len(self.lengths), "offsets must span the elements")
        require(bool((np.diff(self.offsets) > 0).all()), "every strand must have an element")
        require(bool((self.lengths > 0).all()), "every element must be longer than 0")

    @property
    def n_strands(self) -> int:
        return len(self.roots)

    @property
    def element_counts(self) -> Int32:
        """(S,) int32."""
        return np.diff(self.offsets)

    @property
    def strand_lengths(self) -> Float64:
        """(S,) float64, metres."""
        return np.asarray(np.add.reduceat(self.lengths, self.offsets[:-1])) if self.n_strands else np.zeros(0)


def evaluate(helices: Helices, n_points: int) -> tuple[Float64, Float64]:
    """Every strand at equal steps of its arc length, root and tip included (Bao & Qi 2017, eq. 8; B-21).

    Parameters
    ----------
    n_points : 2 or more.

    Returns
    -------
    points (S, n_points, 3) float64, metres, the space of `helices`;
    frames (S, n_points, 3, 3) float64, columns n0 (tangent), n1, n2 of the material frame there.

    Raises
    ------
    InputError : n_points below 2.
    """
    require(n_points >= 2, f"n_points is {n_points}; a strand needs 2 or more")
    points, frames = _evaluate_flat(helices, np.full(helices.n_strands, n_points, np.int64))
    return points.reshape(-1, n_points, 3), frames.reshape(-1, n_points, 3, 3)


def to_strands(helices: Helices, counts: Int32 | None = None) -> StrandSet:
    """The helices as polylines at equal steps of arc length (StrandSet points are float32).

    counts : (S,) int32, points of each strand, 1 or more; None: 8 an element and the root.

    Raises
    ------
    InputError : counts that do not fit.
    """
    if counts is None:
        counts = np.asarray(_POINTS_PER_ELEMENT * helices.element_counts + 1, np.int32)
    check_array("counts", counts, np.int32, (helices.n_strands,))
    require(bool((counts >= 1).all()), "counts has a number below 1; every strand needs a point")
    total = int(counts.sum(dtype=np.int64))
    require(total <= _MAX_POINTS, f"{total} points are too many; use smaller counts")
    points, _ = _evaluate_flat(helices, counts.astype(np.int64))
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return StrandSet(points.astype(np.float32), offsets)


def _evaluate_flat(helices: Helices, counts: NDArray[np.int64]) -> tuple[Float64, Float64]:
    """Points (P, 3) and frames (P, 3, 3) of counts (S,) points a strand."""
    point_offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    points, frames = np.empty((point_offsets[-1], 3)), np.empty((point_offsets[-1], 3, 3))
    evaluate_helices(
        np.ascontiguousarray(helices.roots),
        np.ascontiguousarray(helices.frames),
        helices.offsets,
        helices.lengths,
        np.ascontiguousarray(helices.curvatures),
        point_offsets,
        points,
        frames,
    )
    return points, frames
