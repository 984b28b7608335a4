"""Diffusion of values over a voxel grid: Laplace and screened Laplace by multigrid (M-21, M-38).

Solved is, on every voxel that is inside and not fixed,

    sum over its inside neighbours j of (u_i - u_j) + w_i (u_i - v_i) = 0,

the minimum of sum |grad u|^2 + sum w |u - v|^2 with u = v on the fixed voxels: u does not change across the border of
the inside and of the box (Neumann). Conjugate gradients, preconditioned by one V-cycle; its cost is that of some 60
Jacobi sweeps whatever the share of voxels that are known.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from ..errors import require
from ..types import Bools, Float32, Float64, check_array
from . import _diffusion_kernels as kernels

UInt8 = NDArray[np.uint8]

COARSEST = 400  # cells that are solved for directly
SMALL = 100_000  # cells up to which a level is not worth waking a second thread
# a Chebyshev polynomial of degree 2 on [1/3, 2], the eigenvalues of D^-1 A that a coarser grid does not see
OMEGAS = (1.0 / (7.0 / 6.0 + 5.0 / 6.0 * 0.5**0.5), 1.0 / (7.0 / 6.0 - 5.0 / 6.0 * 0.5**0.5))
_NO_WEIGHTS: Float32 = np.empty((0, 0, 0), np.float32)
_NO_SUMS: Float64 = np.empty(0)


@dataclass(frozen=True, slots=True)
class Diffused:
    """What `DiffusionSolver.solve` found.

    values : (X, Y, Z, C) float32, same unit as the input; 0 outside, and where nothing known reaches.
    residuals : (C,) float64, |b - A u| / |b| of each component. iterations : of the slowest component.
    converged : all residuals are at the tolerance or below.
    """

    values: Float32
    residuals: Float64
    iterations: int
    converged: bool


@dataclass(slots=True)
class _Level:
    """One grid of the multigrid, with a border of a cell, and its working arrays."""

    diagonal: Float32
    inverse: Float32
    edges: tuple[Float32, Float32, Float32] | None  # None: all 1, the finest
    norm: Float32
    right: Float32
    values: Float32
    work: Float32


class DiffusionSolver:
    """The matrix of one voxel grid, set up once and solved for any values.

    Parameters
    ----------
    fixed : (X, Y, Z) bool, voxels whose value is given. inside : (X, Y, Z) bool, where to solve; None: everywhere.
    weights : (X, Y, Z) float32, >= 0, how strongly each voxel is pulled to its own given value; None: nowhere.

    Raises
    ------
    InputError : shapes that do not fit, negative weights, or nothing known inside.
    """

    def __init__(self, fixed: Bools, inside: Bools | None = None, weights: Float32 | None = None) -> None:
        check_array("fixed", fixed, np.bool_, (None, None, None))
        require(fixed.size > 0, f"a grid of {fixed.shape} voxels has none; take one or more along each axis")
        if inside is not None:
            check_array("inside", inside, np.bool_, fixed.shape)
        if weights is not None:
            check_array("weights", weights, np.float32, fixed.shape)
            require(weights.min() >= 0, f"a weight is {weights.min():g}; weights must be 0 or more")
        self._weights = _NO_WEIGHTS if weights is None else weights
        self._kinds = _kinds(fixed, inside, weights)
        self._levels, self._coarsest, self._coarsest_inverse = _build_levels(self._kinds, self._weights)

    @property
    def shape(self) -> tuple[int, int, int]:
        x, y, z = self._kinds.shape
        return x - 2, y - 2, z - 2

    def solve(self, values: Float32, *, tolerance: float = 1e-5, max_iterations: int = 60) -> Diffused:
        """Diffuse values (X, Y, Z, C) float32, read where a voxel is fixed or has a weight; other voxels may be 0.

        tolerance : of |b - A u| / |b|, by which conjugate gradients stop.

        Raises
        ------
        InputError : another shape, or a tolerance out of range.
        """
        check_array("values", values, np.float32, (*self.shape, None))
        require(1e-7 <= tolerance < 1, f"tolerance is {tolerance}; it must be in 1e-7..1")
        require(max_iterations >= 1, f"max_iterations is {max_iterations}; it must be 1 or more")
        given = np.ascontiguousarray(values)
        out = np.empty_like(given)
        n_components = values.shape[3]
        residuals, iterations = np.zeros(n_components), np.zeros(n_components, np.int64)
        solution, direction = np.zeros_like(self._levels[0].values), np.zeros_like(self._levels[0].values)
        for component in range(n_components):
            solution.fill(0.0)
            found = self._conjugate_gradients(given, component, solution, direction, tolerance, max_iterations)
            residuals[component], iterations[component] = found
            kernels.write_back(self._kinds, given, solution, component, out)
        most = int(iterations.max()) if n_components else 0
        return Diffused(out, residuals, most, bool((residuals <= tolerance).all()))

    def _conjugate_gradients(
        self, given: Float32, component: int, solution: Float32, direction: Float32, tolerance: float, most: int
    ) -> tuple[float, int]:
        finest = self._levels[0]
        sums = np.zeros(len(finest.values))
        kernels.set_right(self._kinds, self._weights, given, component, finest.right, sums)
        size = float(sums.sum())
        if size == 0.0:
            return 0.0, 0
        square, previous = size, 0.0
        for iteration in range(most):
            product = self._precondition(sums)
            kernels.turn(finest.values, product / previous if iteration else 0.0, direction)
            previous = product
            kernels.multiply(direction, finest.diagonal, finest.inverse, finest.work, sums)
            kernels.step(direction, finest.work, product / float(sums.sum()), solution, finest.right, sums)
            square = float(sums.sum())
            if square <= tolerance**2 * size:
                return (square / size) ** 0.5, iteration + 1
        return (square / size) ** 0.5, most

    def _precondition(self, sums: Float64) -> float:
        """One V-cycle from the finest level's `right` to its `values`; gives values . right."""
        first, second = OMEGAS
        finest = self._levels[0]
        if len(self._levels) == 1:
            self._solve_coarsest()
            return float(np.vdot(finest.values.astype(np.float64), finest.right))
        n_threads = kernels.thread_count()
        try:
            for level, coarser in pairwise(self._levels):
                kernels.use_threads(n_threads if level.values.size > SMALL else 1)
                kernels.scale(level.right, level.inverse, first, level.work)
                _relax(level, level.work, second, level.values)
                _residual(level, level.values, level.work)
                kernels.restrict(level.work, coarser.right)
            self._solve_coarsest()
            for level, coarser in list(pairwise(self._levels))[::-1]:
                kernels.use_threads(n_threads if level.values.size > SMALL else 1)
                kernels.prolong(coarser.values, level.norm, level.values)
                _relax(level, level.values, second, level.work)
                _relax(level, level.work, first, level.values, sums if level is finest else _NO_SUMS)
        finally:
            kernels.use_threads(n_threads)
        return float(sums.sum())

    def _solve_coarsest(self) -> None:
        level = self._levels[-1]
        right = level.right.ravel()[self._coarsest].astype(np.float64)
        level.values.ravel()[self._coarsest] = self._coarsest_inverse @ right


def diffuse(
    values: Float32,
    fixed: Bools,
    inside: Bools | None = None,
    *,
    weights: Float32 | None = None,
    tolerance: float = 1e-5,
) -> Diffused:
    """Spread values (X, Y, Z, C) float32 from the fixed voxels, and the weighted ones, over the inside (M-21).

    `DiffusionSolver` tells what the arguments are and what it refuses.
    """
    return DiffusionSolver(fixed, inside, weights).solve(values, tolerance=tolerance)


def _kinds(fixed: Bools, inside: Bools | None, weights: Float32 | None) -> UInt8:
    """(X + 2, ...) uint8: OUTSIDE, FREE or FIXED; what nothing known reaches counts as OUTSIDE."""
    kinds = np.zeros([n + 2 for n in fixed.shape], np.uint8)
    inner = kinds[1:-1, 1:-1, 1:-1]
    inner[...] = kernels.FREE if inside is None else np.where(inside, np.uint8(kernels.FREE), np.uint8(0))
    inner[fixed & (inner > 0)] = kernels.FIXED
    known = inner == kernels.FIXED
    if weights is not None:
        known |= (weights > 0) & (inner > 0)
    require(known.any(), "no voxel inside has a known value; fix one or give one a weight")
    if inside is not None:
        parts, count = label(inner > 0)
        reached = np.zeros(count + 1, np.bool_)
        reached[parts[known]] = True
        inner[~reached[parts]] = kernels.OUTSIDE
    return kinds


def _build_levels(kinds: UInt8, weights: Float32) -> tuple[list[_Level], NDArray[np.int64], Float64]:
    """The grids from fine to coarse, and the inverse of the coarsest one's matrix over its cells that are solved."""
    diagonal, inverse, terms = _zeros(kinds.shape), _zeros(kinds.shape), _zeros(kinds.shape)
    kernels.set_finest(kinds, weights, diagonal, inverse, terms)
    known = (kinds > 0).astype(np.float32)
    edges: tuple[Float32, Float32, Float32] | None = None
    levels = []
    while True:
        work = [_zeros(diagonal.shape) for _ in range(3)]
        level = _Level(diagonal, inverse, edges, _zeros(diagonal.shape), *work)
        levels.append(level)
        if np.count_nonzero(diagonal) <= COARSEST:
            break
        shape = tuple((n - 2 + 1) // 2 + 2 for n in diagonal.shape)
        c_known, c_terms = _zeros(shape), _zeros(shape)
        c_edges = (_zeros(shape), _zeros(shape), _zeros(shape))
        own = edges if edges is not None else (_NO_WEIGHTS, _NO_WEIGHTS, _NO_WEIGHTS)
        kernels.coarsen(diagonal, known, terms, *own, edges is None, c_known, c_terms, *c_edges)
        kernels.set_norm(c_known, inverse, level.norm)
        diagonal, inverse = _zeros(shape), _zeros(shape)
        kernels.set_coarse(c_terms, *c_edges, diagonal, inverse)
        known, terms, edges = c_known, c_terms, c_edges
    return levels, *_invert(levels[-1])


def _zeros(shape: tuple[int, ...]) -> Float32:
    return np.zeros(shape, np.float32)


def _invert(level: _Level) -> tuple[NDArray[np.int64], Float64]:
    """The cells of a small level that are solved for, as flat indices, and the inverse of their matrix."""
    flat = level.diagonal.ravel()
    cells = np.flatnonzero(flat)
    row = np.full(flat.size, -1, np.int64)
    row[cells] = np.arange(len(cells))
    matrix = np.diag(flat[cells].astype(np.float64))
    _, n_y, n_z = level.diagonal.shape
    for axis, stride in enumerate((n_y * n_z, n_z, 1)):
        other = row[cells + stride]
        joined = other >= 0
        weight = np.ones(len(cells)) if level.edges is None else level.edges[axis].ravel()[cells]
        matrix[row[cells[joined]], other[joined]] -= weight[joined]
        matrix[other[joined], row[cells[joined]]] -= weight[joined]
    return cells, np.linalg.inv(matrix)


def _relax(level: _Level, values: Float32, omega: float, out: Float32, sums: Float64 = _NO_SUMS) -> None:
    if level.edges is None:
        kernels.relax_unit(values, level.right, level.inverse, omega, out, sums)
    else:
        kernels.relax_weighted(values, level.right, level.inverse, *level.edges, omega, out)


def _residual(level: _Level, values: Float32, out: Float32) -> None:
    if level.edges is None:
        kernels.residual_unit(values, level.right, level.diagonal, level.inverse, level.norm, out)
    else:
        kernels.residual_weighted(values, level.right, level.diagonal, *level.edges, level.norm, out)
