"""Strands as a file holds them, before units are applied and unusable strands are set aside."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import require
from ..types import AttributeArrays, Floats, StrandSet

MAX_POINTS = 2**31 - 1  # StrandSet.offsets are int32


@dataclass(frozen=True, slots=True)
class RawStrands:
    """S strands in the units and axes of their file.

    points : (P, 3) float, root first; NaN is possible. counts : (S,) int64, points of each strand, 0 is possible.
    point_attributes, strand_attributes : first axis P, respectively S. `radius` is in the file's unit of length.
    """

    points: Floats
    counts: NDArray[np.int64]
    point_attributes: AttributeArrays = field(default_factory=dict)
    strand_attributes: AttributeArrays = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Dropped:
    """Strands set aside because no strand set can hold them."""

    n_empty: int = 0  # no points
    n_non_finite: int = 0  # a NaN or infinite coordinate


def strands_from_raw(raw: RawStrands) -> tuple[StrandSet, Dropped]:
    """The usable strands, in order and with their attributes, and how many were set aside (W-1).

    A strand is set aside when it has no point, or a NaN or infinite coordinate (in float32). A floating point
    attribute value that is not finite becomes 0.

    Raises
    ------
    InputError : counts that are negative or do not sum to P, or more points than int32 can number.
    """
    points, counts = raw.points, raw.counts
    require(points.ndim == 2 and points.shape[1] == 3, f"points must have shape (P, 3), not {points.shape}")
    require((counts >= 0).all() and counts.sum() == len(points), "the strands' point counts must sum to the points")
    require(len(points) <= MAX_POINTS, f"{len(points)} points are too many; split the hair into parts")
    with np.errstate(over="ignore"):
        points = np.ascontiguousarray(points, dtype=np.float32)
    bad_points = np.flatnonzero(~np.isfinite(points).all(axis=1))
    strand_ends = np.cumsum(counts)
    usable = np.ones(len(counts), dtype=np.bool_)
    usable[np.searchsorted(strand_ends, bad_points, side="right")] = False
    empty = counts == 0
    dropped = Dropped(n_empty=int(empty.sum()), n_non_finite=int((~usable).sum()))
    usable &= ~empty
    kept_points = slice(None) if usable.all() else np.repeat(usable, counts)
    kept_strands = slice(None) if usable.all() else usable
    strands = StrandSet(
        points[kept_points],
        np.concatenate([[0], np.cumsum(counts[kept_strands])]).astype(np.int32),
        {name: _finite(array[kept_points]) for name, array in raw.point_attributes.items()},
        {name: _finite(array[kept_strands]) for name, array in raw.strand_attributes.items()},
    )
    return strands, dropped


def _finite(array: NDArray[Any]) -> NDArray[Any]:
    if array.dtype.kind != "f" or np.isfinite(array).all():
        return array
    return np.nan_to_num(array, nan=0.0, posinf=0.0, neginf=0.0)
