"""Strand sets as a whole: lengths, uniform resampling (W-7), selection, joining, rigid and affine moves.

The two layouts: ragged `StrandSet` (points and offsets) and dense (S, N, 3) arrays, N points a strand, root first.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import require
from ..types import AttributeArrays, Float32, Float64, Floats, Int32, StrandSet
from ._strands_kernels import resample_values, subdivide_points

MAX_POINTS = 2**31 - 1  # offsets are int32


def from_dense(points: Floats, strand_attributes: AttributeArrays | None = None) -> StrandSet:
    """The strand set of dense points (S, N, 3), N >= 1; values are kept, cast to float32."""
    require(
        points.ndim == 3 and points.shape[1] >= 1 and points.shape[2] == 3,
        f"dense strands must have shape (S, N, 3) with N of 1 or more, not {points.shape}",
    )
    n_strands, n_points = points.shape[:2]
    require(n_strands * n_points <= MAX_POINTS, f"{n_strands} strands of {n_points} points are too many; use fewer")
    offsets = np.arange(n_strands + 1, dtype=np.int32) * np.int32(n_points)
    flat = np.ascontiguousarray(points, dtype=np.float32).reshape(-1, 3)
    return StrandSet(flat, offsets, {}, dict(strand_attributes or {}))


def resample(strands: StrandSet, n_points: int) -> Float32:
    """Every strand at `n_points` points of uniform arc length, root first (Wang et al. 2009, sec. 4.1; W-7).

    The end points are kept bit for bit; a strand of one point or zero length gives copies of its root.

    Parameters
    ----------
    strands : S strands, any space; n_points : 2 or more (the paper uses 64).

    Returns
    -------
    (S, n_points, 3) float32, the space of `strands`.

    Raises
    ------
    InputError : n_points below 2.
    """
    _check_sample_count(n_points)
    out = np.empty((strands.n_strands, n_points, 3), dtype=np.float32)
    resample_values(np.ascontiguousarray(strands.points), strands.offsets, np.ascontiguousarray(strands.points), out)
    return out


def subdivide(strands: StrandSet, factor: int) -> StrandSet:
    """Each segment in `factor` pieces along the Catmull-Rom curve through the points; the points are kept.

    Blender draws native Curves this way, so a groom of few points is smooth where its polylines have corners.
    Attributes are left out. A strand of one point stays as it is.

    Raises
    ------
    InputError : a factor below 1.
    """
    require(factor >= 1, f"factor is {factor}; it must be 1 or more")
    counts = (strands.point_counts.astype(np.int64) - 1) * factor + 1
    require(counts.sum() <= MAX_POINTS, f"{counts.sum()} points are too many; use a smaller factor")
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    out = np.empty((int(counts.sum()), 3), np.float32)
    subdivide_points(np.ascontiguousarray(strands.points), strands.offsets, offsets, factor, out)
    return StrandSet(out, offsets)


def resample_smooth(strands: StrandSet, n_points: int) -> Float32:
    """`resample` along Catmull-Rom curves where strands have fewer points than `n_points`, else along polylines."""
    _check_sample_count(n_points)
    mean_count = len(strands.points) / max(strands.n_strands, 1)
    # twice as many points as samples: the polyline's corners then turn less than the samples resolve
    factor = min(8, -(-2 * n_points // max(1, round(mean_count)))) if mean_count < n_points else 1
    return resample(strands if factor == 1 else subdivide(strands, factor), n_points)


def resample_set(strands: StrandSet, n_points: int) -> StrandSet:
    """`resample` with attributes: floating point ones are interpolated, others take the value of the nearest point.

    "Nearest" is in arc length along the strand. Strand attributes are kept.
    """
    dense = from_dense(resample(strands, n_points), strands.strand_attributes)
    points = np.ascontiguousarray(strands.points)
    attributes: dict[str, NDArray[Any]] = {}
    for name, array in strands.point_attributes.items():
        if array.dtype.kind == "f":
            columns = np.ascontiguousarray(array.reshape(len(array), -1))
            out = np.empty((strands.n_strands, n_points, columns.shape[1]), dtype=array.dtype)
            resample_values(points, strands.offsets, columns, out)
            attributes[name] = out.reshape(-1, *array.shape[1:])
        else:
            places = np.empty((strands.n_strands, n_points, 1))
            resample_values(points, strands.offsets, np.arange(len(points), dtype=np.float64)[:, None], places)
            attributes[name] = array[np.rint(places.reshape(-1)).astype(np.int64)]
    return StrandSet(dense.points, dense.offsets, attributes, dense.strand_attributes)


def arc_lengths(strands: StrandSet) -> Float64:
    """(P,) float64, how far along its strand each point lies, in the unit of the points; 0 at roots."""
    reached = np.cumsum(_segments_before(strands))
    return np.asarray(reached - np.repeat(reached[strands.offsets[:-1]], strands.point_counts), dtype=np.float64)


def strand_lengths(strands: StrandSet) -> Float64:
    """(S,) float64, the length of each strand in the unit of its points; 0 for a strand of one point."""
    return np.asarray(np.add.reduceat(_segments_before(strands), strands.offsets[:-1]), dtype=np.float64)


def polyline_lengths(points: Floats) -> Float64:
    """(S,) float64, the length of each strand of dense points (S, N, 3)."""
    require(points.ndim == 3 and points.shape[2] == 3, f"dense strands must have shape (S, N, 3), not {points.shape}")
    return np.asarray(_row_lengths(np.diff(points, axis=1)).sum(axis=1), dtype=np.float64)


def strand_of_point(strands: StrandSet) -> Int32:
    """(P,) int32, the strand that each point belongs to."""
    return np.repeat(np.arange(strands.n_strands, dtype=np.int32), strands.point_counts)


def select_strands(strands: StrandSet, chosen: ArrayLike) -> StrandSet:
    """The chosen strands with their attributes: a mask (S,) bool, or indices in the order wanted (repeats allowed).

    Raises
    ------
    InputError : a mask of another length, or an index outside [0, S).
    """
    indices = np.asarray(chosen)
    if indices.dtype == np.bool_:
        require(
            indices.shape == (strands.n_strands,),
            f"the mask has shape {indices.shape} but there are {strands.n_strands} strands",
        )
        indices = np.flatnonzero(indices)
    elif indices.size == 0:
        indices = np.zeros(0, dtype=np.int64)
    require(
        indices.ndim == 1 and indices.dtype.kind in "iu",
        f"strands are chosen by a list of whole numbers or a mask, not {indices.dtype} of shape {indices.shape}",
    )
    inside = (indices >= 0) & (indices < strands.n_strands)
    require(inside.all(), f"a chosen strand index is outside 0 to {strands.n_strands - 1}")
    counts = strands.point_counts[indices].astype(np.int64)
    ends = np.cumsum(counts)
    n_points = int(ends[-1]) if len(ends) else 0
    require(n_points <= MAX_POINTS, f"{n_points} points are too many for one set; choose fewer strands")
    offsets = np.concatenate([[0], ends]).astype(np.int32)
    gather = np.repeat(strands.offsets[indices] - (ends - counts), counts) + np.arange(n_points)
    return StrandSet(
        strands.points[gather],
        offsets,
        {name: array[gather] for name, array in strands.point_attributes.items()},
        {name: array[indices] for name, array in strands.strand_attributes.items()},
    )


def join_strands(parts: Sequence[StrandSet]) -> StrandSet:
    """One set with the strands of all parts in order; no parts give an empty set.

    An attribute is kept when every part has it, in one dtype and shape.
    """
    n_points = sum(len(part.points) for part in parts)
    require(n_points <= MAX_POINTS, f"{n_points} points are too many for one set; join fewer strands")
    points = [part.points for part in parts] or [np.zeros((0, 3), dtype=np.float32)]
    counts = [part.point_counts for part in parts] or [np.zeros(0, dtype=np.int32)]
    offsets = np.concatenate([[0], np.cumsum(np.concatenate(counts))]).astype(np.int32)
    return StrandSet(
        np.concatenate(points),
        offsets,
        _join_attributes([part.point_attributes for part in parts]),
        _join_attributes([part.strand_attributes for part in parts]),
    )


def transform_strands(strands: StrandSet, matrix: ArrayLike) -> StrandSet:
    """The strands moved by an affine 4 x 4 matrix (column vectors: p' = M p); `radius` grows with its mean scale.

    The mean scale is the cube root of |det|. Other attributes are kept as they are.

    Raises
    ------
    InputError : a matrix that is not 4 x 4, finite and affine, or takes a point out of the range of float32.
    """
    affine = np.asarray(matrix, dtype=np.float64)
    require(affine.shape == (4, 4), f"the transform must be a 4 x 4 matrix, not {affine.shape}")
    require(np.isfinite(affine).all(), "the transform has NaN or infinite values")
    require(np.array_equal(affine[3], [0.0, 0.0, 0.0, 1.0]), "the transform's last row must be 0 0 0 1")
    with np.errstate(over="ignore"):
        points = (strands.points @ affine[:3, :3].T + affine[:3, 3]).astype(np.float32)
    attributes = dict(strands.point_attributes)
    if "radius" in attributes:
        scale = abs(np.linalg.det(affine[:3, :3])) ** (1.0 / 3.0)
        attributes["radius"] = (attributes["radius"] * scale).astype(attributes["radius"].dtype)
    return StrandSet(points, strands.offsets, attributes, strands.strand_attributes)


def _check_sample_count(n_points: int) -> None:
    require(n_points >= 2, f"{n_points} points a strand are too few; resample to 2 or more")


def _segments_before(strands: StrandSet) -> Float64:
    """(P,) the length of the segment that ends in each point; 0 at roots."""
    segments = np.zeros(len(strands.points))
    segments[1:] = _row_lengths(np.diff(strands.points, axis=0))
    segments[strands.offsets[:-1]] = 0.0
    return segments


def _row_lengths(vectors: Floats) -> Float64:
    doubles = vectors.astype(np.float64)
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", doubles, doubles)), dtype=np.float64)


def _join_attributes(parts: Sequence[AttributeArrays]) -> dict[str, NDArray[Any]]:
    joined: dict[str, NDArray[Any]] = {}
    for name in parts[0] if parts else ():
        arrays = [part[name] for part in parts if name in part]
        alike = {(array.dtype, array.shape[1:]) for array in arrays}
        if len(arrays) == len(parts) and len(alike) == 1:
            joined[name] = np.concatenate(arrays)
    return joined
