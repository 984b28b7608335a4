"""Strands as feature vectors, and maps of them over the scalp (Wang et al. 2009, sec. 5.1; W-16, W-17, W-20).

A strand in the frame of its root is a point of 3 N numbers; principal components keep the few that matter. The axes are
orthonormal, so distances between feature vectors are the distances L2 between strands (W-8) inside the kept subspace.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, map_coordinates
from scipy.spatial import Delaunay, QhullError, cKDTree

from ..errors import require
from ..types import Bools, FeatureMap, Float32, Float64, Floats

Ints = NDArray[np.intp]

_ROWS_AT_ONCE = 8192  # strands summed at once: bounds the float64 copy to 13 MB at 64 points


@dataclass(frozen=True, slots=True)
class FeatureBasis:
    """Principal axes of a set of strands (W-16, M-2).

    mean : (3N,) float32, head radii; the mean strand, root frame, point by point.
    axes : (C, 3N) float32, orthonormal rows, largest variance first.
    variances : (C,) float64, head radii squared, variance of the strands along each axis.
    retained : share of the total variance that the axes keep, in [0, 1]; 1 if the strands are all equal.
    """

    mean: Float32
    axes: Float32
    variances: Float64
    retained: float

    @property
    def n_features(self) -> int:
        return len(self.axes)

    @property
    def n_points(self) -> int:
        """Points of a strand."""
        return len(self.mean) // 3

    def encode(self, points: Floats) -> Float32:
        """Feature vectors (S, C) float32, head radii, of strands (S, N, 3) in their root frames.

        Raises InputError if the strands have another number of points than the basis.
        """
        require(
            points.ndim == 3 and points.shape[1:] == (self.n_points, 3),
            f"strands of shape {points.shape} do not fit a feature basis of {self.n_points} points a strand; "
            f"resample them to {self.n_points} points",
        )
        flat = points.reshape(len(points), -1).astype(np.float32, copy=False)
        return np.asarray((flat - self.mean) @ self.axes.T, dtype=np.float32)

    def decode(self, features: Floats) -> Float32:
        """Strands (S, N, 3) float32, head radii, root frames, of feature vectors (S, C); the roots are exactly 0.

        Raises InputError if the vectors have another number of features than the basis.
        """
        require(
            features.ndim == 2 and features.shape[1] == self.n_features,
            f"features of shape {features.shape} do not fit a basis of {self.n_features} features; encode them with it",
        )
        flat = features.astype(np.float32, copy=False) @ self.axes + self.mean
        points = np.asarray(flat, dtype=np.float32).reshape(len(features), -1, 3)
        # every strand of a root frame starts at 0, so mean and axes are 0 there but for rounding
        points[:, 0] = 0.0
        return points


def fit_features(points: Float32, n_features: int = 16) -> FeatureBasis:
    """Fit principal components to strands (Wang et al. 2009, sec. 5.1; W-16, M-2).

    Parameters
    ----------
    points : (S, N, 3) float32, head radii, root frames.
    n_features : axes to keep (n_f of Table 1). Fewer are kept where the strands span fewer: at most S - 1.

    Returns
    -------
    FeatureBasis : each axis has its largest entry positive, so that the same strands give the same basis.

    Raises
    ------
    InputError : no strands, points that are not finite, or n_features below 1.
    """
    require(n_features >= 1, f"n_features is {n_features}; it must be 1 or more")
    require(points.ndim == 3 and points.shape[2] == 3, f"strands must have shape (S, N, 3), not {points.shape}")
    require(len(points) > 0, "there are no strands to find features in; choose an example with strands")
    flat = points.reshape(len(points), -1)
    mean = flat.mean(axis=0, dtype=np.float64)
    require(np.isfinite(mean).all(), "the strands have NaN or infinite points; clean the hair up first")
    scatter = np.zeros((len(mean), len(mean)))
    for start in range(0, len(flat), _ROWS_AT_ONCE):
        rows = flat[start : start + _ROWS_AT_ONCE] - mean
        scatter += rows.T @ rows
    eigenvalues, eigenvectors = np.linalg.eigh(scatter / len(flat))
    variances = np.maximum(eigenvalues[::-1], 0.0)
    total = variances.sum()
    n_kept = max(1, min(n_features, len(flat) - 1, int((variances > 1e-12 * total).sum())))
    axes = eigenvectors[:, ::-1][:, :n_kept].T
    largest = np.take_along_axis(axes, np.abs(axes).argmax(axis=1)[:, None], axis=1)
    axes = axes * np.sign(largest)
    retained = float(variances[:n_kept].sum() / total) if total > 0 else 1.0
    return FeatureBasis(mean.astype(np.float32), axes.astype(np.float32), variances[:n_kept].copy(), retained)


def feature_map(uv: Floats, features: Floats, spacing: float = 0.02, *, margin: float = 2.0) -> FeatureMap:
    """Interpolate feature vectors at the strands' roots to a regular grid (Wang et al. 2009, sec. 5.1; W-17).

    Linear interpolation on the Delaunay triangles of the roots. A cell is valid if it lies in a triangle and no further
    than `margin` typical root spacings (median length of the Delaunay edges) from the nearest root, so concave regions
    and bald spots stay holes and the long triangles along the border do not count. The cells that hold a root are
    valid too, with the nearest root's features where no triangle covers them.

    Parameters
    ----------
    uv : (S, 2) roots, scalp coordinates, radians.
    features : (S, C) feature vectors.
    spacing : radians between cells (the paper's feature map grid spacing).
    margin : in root spacings.

    Returns
    -------
    FeatureMap : its origin is a multiple of the spacing; values are 0 where the mask is false.

    Raises
    ------
    InputError : no roots, shapes that do not fit, or a spacing so fine that the map would exceed 2000 cells a side.
    """
    require(len(uv) > 0, "there are no roots to make a feature map of; choose an example with strands")
    require(uv.shape == (len(features), 2), f"uv of shape {uv.shape} does not fit features of shape {features.shape}")
    require(spacing > 0, f"the map spacing is {spacing}; it must be above 0")
    require(margin > 0, f"the margin is {margin}; it must be above 0")
    require(np.isfinite(uv).all() and np.isfinite(features).all(), "roots or features are NaN or infinite")
    roots = uv.astype(np.float64)
    low = np.floor(roots.min(axis=0) / spacing).astype(int)
    high = np.ceil(roots.max(axis=0) / spacing).astype(int)
    n_columns, n_rows = (high - low + 1).tolist()
    require(
        max(n_columns, n_rows) <= 2000,
        f"a map spacing of {spacing} makes a map of {n_columns} x {n_rows} cells; use a larger spacing",
    )
    origin = low * spacing
    cells = _cell_positions(origin, spacing, n_rows, n_columns)
    values, mask = _interpolate(roots, features, cells, spacing, margin)
    shape = (n_rows, n_columns)
    return FeatureMap(values.reshape(*shape, -1), mask.reshape(shape), origin.astype(np.float64), float(spacing))


def _cell_positions(origin: Floats, spacing: float, n_rows: int, n_columns: int) -> Float64:
    """(H * W, 2) float64 scalp coordinates u, v of the cells, row by row."""
    u, v = np.meshgrid(origin[0] + spacing * np.arange(n_columns), origin[1] + spacing * np.arange(n_rows))
    return np.stack([u.ravel(), v.ravel()], axis=1)


def _interpolate(
    roots: Float64, features: Floats, cells: Float64, spacing: float, margin: float
) -> tuple[Float32, Bools]:
    """Values (M, C) float32 and validity (M,) at the cells; see `feature_map`."""
    distance, nearest = cKDTree(roots).query(cells)
    # half the diagonal of a cell: a cell that holds a root lies no further from it
    near = distance <= 0.71 * spacing
    values = np.where(near[:, None], features[nearest], 0.0).astype(np.float32)
    try:
        triangles = Delaunay(roots)
    except (QhullError, ValueError):
        # fewer than three roots, or all of them on one line: no triangle to interpolate in
        return values, near
    corners = triangles.simplices
    edges = roots[corners] - roots[np.roll(corners, 1, axis=1)]
    reach = max(margin * float(np.median(np.linalg.norm(edges, axis=2))), spacing)
    found = triangles.find_simplex(cells)
    inside = np.flatnonzero((found >= 0) & (distance <= reach))
    transforms = triangles.transform[found[inside]]
    # slivers of the border whose roots lie on one line have no barycentric coordinates
    solvable = np.isfinite(transforms).all(axis=(1, 2))
    inside, transforms = inside[solvable], transforms[solvable]
    first = np.einsum("mij,mj->mi", transforms[:, :2], cells[inside] - transforms[:, 2])
    weights = np.clip(np.column_stack([first, 1.0 - first.sum(axis=1)]), 0.0, 1.0)
    values[inside] = np.einsum("mi,mic->mc", weights, features[corners[found[inside]]])
    mask = near.copy()
    mask[inside] = True
    return values, mask


def cells_around_roots(uv: Floats, spacing: float) -> tuple[Float64, Bools]:
    """The grid that an output map needs: a cell at, and around, every root (W-17, W-20).

    Parameters
    ----------
    uv : (S, 2) roots, scalp coordinates, radians. spacing : radians between cells.

    Returns
    -------
    origin (2,) float64, u and v of the first cell, a multiple of the spacing; mask (H, W) bool.

    Raises
    ------
    InputError : no roots.
    """
    require(len(uv) > 0, "there are no roots to make hair for; choose a larger scalp region or more strands")
    low = np.floor(uv.min(axis=0).astype(np.float64) / spacing) - 1
    cells = np.rint(uv / spacing - low).astype(np.int64)
    n_columns, n_rows = cells.max(axis=0) + 2
    mask = np.zeros((n_rows, n_columns), np.bool_)
    mask[cells[:, 1], cells[:, 0]] = True
    return low * spacing, binary_dilation(mask, np.ones((3, 3), np.bool_))


def sample_map(source: FeatureMap, uv: Floats, *, smooth: bool = False) -> Float32:
    """Feature vectors at scalp positions: the spatially closest valid one (Wang et al. 2009, sec. 5.1; W-20).

    Parameters
    ----------
    source : the map, with a valid cell.
    uv : (S, 2) scalp coordinates, radians.
    smooth : interpolate between the four cells around a position instead, over the valid ones among them.

    Returns
    -------
    (S, C) float32.

    Raises
    ------
    InputError : a map without a valid cell.
    """
    require(source.mask.any(), "the feature map has no valid cell; the example has no roots on the scalp")
    rows, columns = np.nonzero(source.mask)
    at = (uv.astype(np.float64) - source.origin) / source.spacing
    _, nearest = cKDTree(np.column_stack([columns, rows])).query(at)
    picked = source.values[rows[nearest], columns[nearest]]
    return _blend_corners(source, at, picked) if smooth else picked


def _blend_corners(source: FeatureMap, at: Float64, otherwise: Float32) -> Float32:
    """Bilinear values (S, C) at cells `at` (S, 2) (column, row) over the valid corners; `otherwise` where none is."""
    places = at[:, ::-1].T
    weight = map_coordinates(source.mask.astype(np.float64), places, order=1, mode="constant")
    masked = np.where(source.mask[..., None], source.values, 0.0)
    sums = [map_coordinates(masked[..., c], places, order=1, mode="constant") for c in range(masked.shape[2])]
    blended = np.stack(sums, axis=1) / np.maximum(weight, 1e-9)[:, None]
    return np.where(weight[:, None] > 1e-6, blended, otherwise).astype(np.float32)
