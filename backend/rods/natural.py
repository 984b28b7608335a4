"""Natural optimisation: all curvatures and lengths of a chain by non-linear least squares (Bao & Qi 2017, [45]; M-24).

The paper's other baseline beside the fixed number of elements, and the polish of `fitting`: started from floating
tangents, a few steps make the distance smaller at the same number of elements, and take out twist that serves nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import require
from ..types import Float64, Int32, StrandSet
from ._natural_kernels import improve_strands
from .helices import Helices


@dataclass(frozen=True, slots=True)
class NaturalParams:
    """Settings of improve_helices.

    iterations : most Levenberg-Marquardt steps a strand. tolerance : a strand ends when a step gains less than this
    share. twist_weight, bend_weight : m / rad; an element's twist (bend) of one radian costs like so many metres of
    distance at its points. stretch_weight : m; the same for an element that doubles its length.
    """

    iterations: int = 100
    tolerance: float = 1e-4
    twist_weight: float = 1e-5
    bend_weight: float = 1e-6
    stretch_weight: float = 1e-3

    def __post_init__(self) -> None:
        require(0 <= self.iterations <= 100_000, f"iterations is {self.iterations}; it must be from 0 to 100000")
        for name in ("tolerance", "twist_weight", "bend_weight", "stretch_weight"):
            value = getattr(self, name)
            require(0.0 <= value < 1.0, f"{name} is {value:g}; it must be 0 or more and below 1")


@dataclass(frozen=True, slots=True)
class NaturalResult:
    """Helices; rms, maximum (S,) float64 m, distance of the points to the helices' points at the same share of their
    element; steps (S,) int32 taken."""

    helices: Helices
    rms: Float64
    maximum: Float64
    steps: Int32


def improve_helices(strands: StrandSet, helices: Helices, params: NaturalParams = NaturalParams()) -> NaturalResult:
    """Least squares on root frames, curvatures and lengths, started from `helices`; the roots stay.

    A strand's points belong to its elements by equal shares of its polyline.

    Raises
    ------
    InputError : helices of another number of strands.
    """
    require(
        helices.n_strands == strands.n_strands,
        f"there are {helices.n_strands} strands of helices for {strands.n_strands} strands; fit these strands",
    )
    frames, lengths, curvatures = helices.frames.copy(), helices.lengths.copy(), helices.curvatures.copy()
    errors, steps = np.zeros((strands.n_strands, 2)), np.empty(strands.n_strands, np.int32)
    weights = (params.twist_weight**2, params.bend_weight**2, params.stretch_weight**2)
    improve_strands(
        np.ascontiguousarray(strands.points), strands.offsets, helices.offsets, params.iterations, weights,
        params.tolerance, frames, lengths, curvatures, errors, steps,
    )  # fmt: skip
    improved = Helices(helices.roots, frames, helices.offsets, lengths, curvatures)
    return NaturalResult(improved, errors[:, 0].copy(), errors[:, 1].copy(), steps)
