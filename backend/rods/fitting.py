"""Adaptive floating tangents: strands to G1 chains of helices (Bao & Qi 2017, sec. V; B-17 to B-21, M-23).

Per strand: a cubic C1 Bezier spline by least squares, a number of elements from its length and turning, break points
at equal arc length, moved as little as lets each pair with its tangents lie on a helix, and that helix. The chain is
then built from the root with the helices' Darboux vectors in the material frame, so it is G1 whatever rounding does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import require
from ..progress import NO_PROGRESS, Progress, subrange
from ..types import Bools, Float64, Int32, StrandSet, check_array
from ._fitting_kernels import fit_strands
from .helices import Helices
from .natural import NaturalParams, improve_helices

MOST_ELEMENTS = 1000
_BATCH = 20_000  # strands between two calls of progress
_POLISH_TWIST = 1e-4  # m / rad: what twist costs, so that only the shape's own is left


@dataclass(frozen=True, slots=True)
class FitParams:
    """Settings of fit_helices.

    n_min, n_max : elements of a strand, 1..1000 (B-18). l_min, l_max : m; shorter strands get n_min elements, longer
    ones n_max. n_elements : 0 adaptive, else this number for every strand (the floating tangents of before).
    tolerance : m; adaptive strands whose RMS distance is above it get more elements, n_max at most; 0 is the paper.
    samples_per_segment : points of a strand for each Bezier segment, 1 or more.
    polish : Levenberg-Marquardt steps after the fit, at the same number of elements (`natural`); 0 is the paper.
    5 halve the distance or better, and take out twist that the shape does not need and that would stiffen the strand.
    """

    n_min: int = 3
    n_max: int = 25
    l_min: float = 0.05
    l_max: float = 0.80
    n_elements: int = 0
    tolerance: float = 0.0005
    samples_per_segment: int = 3
    polish: int = 0

    def __post_init__(self) -> None:
        require(self.n_min >= 1, f"n_min is {self.n_min}; it must be 1 or more")
        require(
            self.n_min <= self.n_max <= MOST_ELEMENTS,
            f"n_max is {self.n_max}; it must be from n_min ({self.n_min}) to {MOST_ELEMENTS}",
        )
        require(0.0 <= self.l_min < float("inf"), f"l_min is {self.l_min:g}; it must be 0 or more")
        require(self.l_min <= self.l_max < float("inf"), f"l_max is {self.l_max:g}; it must be l_min or more")
        require(
            0 <= self.n_elements <= MOST_ELEMENTS,
            f"n_elements is {self.n_elements}; it must be from 0 (adaptive) to {MOST_ELEMENTS}",
        )
        require(0.0 <= self.tolerance < float("inf"), f"tolerance is {self.tolerance:g}; it must be 0 (off) or more")
        require(
            1 <= self.samples_per_segment <= 1000,
            f"samples_per_segment is {self.samples_per_segment}; it must be from 1 to 1000",
        )
        require(0 <= self.polish <= 1000, f"polish is {self.polish}; it must be from 0 (off) to 1000")


@dataclass(frozen=True, slots=True)
class HelixFit:
    """Helices and how near they are to the strands they were fitted to.

    rms, maximum : (S,) float64, m; distance of each input point to the helix point at the same share of its element,
    so at least the distance to the curve.
    degenerate : (S,) bool, strands shorter than 0.1 mm; each became one straight element of that length, pointing to
    its tip, or up where that is the root.
    """

    helices: Helices
    rms: Float64
    maximum: Float64
    degenerate: Bools

    def __post_init__(self) -> None:
        count = self.helices.n_strands
        check_array("rms", self.rms, np.float64, (count,))
        check_array("maximum", self.maximum, np.float64, (count,))
        check_array("degenerate", self.degenerate, np.bool_, (count,))

    def report(self, strands: StrandSet) -> dict[str, Any]:
        """What a user wants to know: counts, distances in metres over all points of `strands`, compression.

        compression: bytes of the strands' float32 points over those of the helices as 4 float32 an element and 6
        (root, first tangent and normal in three angles) a strand.
        """
        counts = self.helices.element_counts
        points = strands.point_counts.astype(np.float64)
        if not len(counts):
            return {"strands": 0}
        squares = (self.rms**2 * points).sum() / points.sum()
        return {
            "strands": len(counts),
            "elements": int(counts.sum()),
            "elements_per_strand": [int(counts.min()), round(float(counts.mean()), 2), int(counts.max())],
            "rms_m": float(np.sqrt(squares)),
            "maximum_m": float(self.maximum.max()),
            "worst_strand": int(self.maximum.argmax()),
            "compression": round(3.0 * len(strands.points) / (4.0 * counts.sum() + 6.0 * len(counts)), 2),
            "without_length": int(self.degenerate.sum()),
        }


def fit_helices(
    strands: StrandSet, params: FitParams = FitParams(), *, progress: Progress = NO_PROGRESS
) -> HelixFit:  # fmt: skip
    """Fit a G1 chain of helices to every strand; the roots stay exactly where they are.

    Nothing is dropped: straight, plane and folded strands are fitted, coincident points count once, a strand of two
    points is straight, and one without length becomes a stub (HelixFit.degenerate).

    Parameters
    ----------
    strands : S strands, metres, any space.
    progress : called every 20,000 strands; may raise Cancelled.

    Returns
    -------
    HelixFit in the space of `strands`; results do not depend on the number of threads.
    """
    count = strands.n_strands
    n_elements, errors, frames = np.empty(count, np.int32), np.empty((count, 2)), np.empty((count, 3, 3))
    lengths, curvatures = _fit_batches(strands, params, n_elements, frames, errors, subrange(progress, 0.0, 0.5))
    degenerate = n_elements == 0
    offsets = np.concatenate([[0], np.cumsum(np.maximum(n_elements, 1))]).astype(np.int32)
    helices = Helices(strands.roots.astype(np.float64), frames, offsets, lengths, curvatures)
    if params.polish > 0:
        progress(0.5, "Polishing helices")
        polished = improve_helices(strands, helices, NaturalParams(params.polish, twist_weight=_POLISH_TWIST))
        helices = polished.helices
        fitted = ~degenerate
        errors[fitted, 0], errors[fitted, 1] = polished.rms[fitted], polished.maximum[fitted]
    progress(1.0, "Fitting helices")
    return HelixFit(helices, errors[:, 0].copy(), errors[:, 1].copy(), degenerate)


def _fit_batches(
    strands: StrandSet, params: FitParams, n_elements: Int32, frames: Float64, errors: Float64, progress: Progress
) -> tuple[Float64, Float64]:
    """Floating tangents; n_elements (S,), frames (S, 3, 3), errors (S, 2) are written, lengths, curvatures returned."""
    count, width = strands.n_strands, params.n_elements or params.n_max
    lengths, curvatures = np.empty((min(count, _BATCH), width)), np.empty((min(count, _BATCH), width, 3))
    points = np.ascontiguousarray(strands.points)
    settings = (params.n_min, params.n_max, params.n_elements, float(params.l_min), float(params.l_max))
    used_lengths, used_curvatures = [np.empty(0)], [np.empty((0, 3))]
    for first in range(0, count, _BATCH):
        progress(first / count, "Fitting helices")
        end = min(first + _BATCH, count)
        fit_strands(
            points, strands.offsets, first, end, params.samples_per_segment, settings, float(params.tolerance),
            n_elements[first:end], frames[first:end], lengths, curvatures, errors[first:end],
        )  # fmt: skip
        used = np.arange(width) < np.maximum(n_elements[first:end], 1)[:, None]
        used_lengths.append(lengths[: end - first][used])
        used_curvatures.append(curvatures[: end - first][used])
    return np.concatenate(used_lengths), np.concatenate(used_curvatures)
