"""Strands as piecewise helices: what the fit makes and the dynamics moves (Bao & Qi 2017, sec. V; B-21)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import require
from ..types import Float64, Int32, check_array


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
