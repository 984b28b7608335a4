"""Natural optimisation: all curvatures and lengths of a chain by non-linear least squares (Bao & Qi 2017, [45]; M-24).

The paper's other baseline beside the fixed number of elements, and the polish of `fitting`: started from floating
tangents, a few steps make the distance smaller at the same number of elements, and take out twist that serves nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ..errors import require
from ..geometry.strands import resample, strand_lengths
from ..types import Float64, Int32, StrandSet
from ._natural_kernels import STUB_LENGTH, improve_strands
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


def natural_fit(strands: StrandSet, n_elements: int, params: NaturalParams = NaturalParams()) -> NaturalResult:
    """Natural optimisation from nothing but the strands: the baseline of the comparison (B-E6, M-24).

    It starts from n_elements arcs of equal length without twist that have the strand's tangents at their ends.

    Raises
    ------
    InputError : n_elements below 1.
    """
    require(n_elements >= 1, f"n_elements is {n_elements}; it must be 1 or more")
    return improve_helices(strands, _arcs(strands, n_elements), params)


def _arcs(strands: StrandSet, n_elements: int) -> Helices:
    """Arcs between the tangents at equal shares of the polylines."""
    count = strands.n_strands
    points = resample(strands, 4 * n_elements + 1).astype(np.float64)
    places = np.arange(n_elements + 1) * 4
    tangents = points[:, np.minimum(places + 1, places[-1])] - points[:, np.maximum(places - 1, 0)]
    sizes = np.linalg.norm(tangents, axis=2, keepdims=True)
    tangents = np.where(sizes > 0.0, tangents / np.maximum(sizes, 1e-300), [0.0, 0.0, 1.0])
    lengths = np.maximum(strand_lengths(strands).astype(np.float64), STUB_LENGTH) / n_elements
    # any normal: the axis along which the first tangent is shortest, made orthogonal
    aside = np.eye(3)[np.argmin(np.abs(tangents[:, 0]), axis=1)]
    normals = np.cross(tangents[:, 0], aside)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    frames = np.stack([tangents[:, 0], normals, np.cross(tangents[:, 0], normals)], axis=2)
    roots, first_frames = strands.roots.astype(np.float64), frames
    curvatures = np.empty((count, n_elements, 3))
    for e in range(n_elements):  # over the elements of all strands at once
        axes = np.cross(tangents[:, e], tangents[:, e + 1])
        sines = np.linalg.norm(axes, axis=1, keepdims=True)
        cosines = (tangents[:, e] * tangents[:, e + 1]).sum(axis=1, keepdims=True)
        turns = axes * (np.arctan2(sines, cosines) / np.maximum(sines, 1e-12))
        curvatures[:, e] = np.einsum("sij,si->sj", frames, turns) / lengths[:, None]
        frames = Rotation.from_rotvec(turns).as_matrix() @ frames if count else frames
    offsets = (np.arange(count + 1) * n_elements).astype(np.int32)
    return Helices(roots, first_frames, offsets, np.repeat(lengths, n_elements), curvatures.reshape(-1, 3))
