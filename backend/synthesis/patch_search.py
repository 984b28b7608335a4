"""Exact nearest neighbourhoods in an example map, the M-step of texture optimisation (Kwatra et al. 2005; M-3).

Patches are compared by the weighted squared distance of all their cells. Most of that distance lies in a few principal
components of the patches, which are found from separable one-dimensional bases and so cost little more than filtering
the map. The distance in those components, plus the difference of the lengths of what they leave out, is a lower bound
of the true distance: one matrix product gives it for all pairs, and only candidates with a small bound are compared
cell by cell. That keeps the search exact, at a small part of the cost of trying every candidate.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..types import Bools, Float32, Float64, Int32
from ._texture_kernels import choose_sources, gather_patches, patch_costs

_N_AXIS = 8  # one-dimensional components kept a direction
_N_PRODUCTS = 192  # products of channel and directions that the principal components are found in
_N_COMPONENTS = 40
_MAX_CHECKS = 64  # candidates compared cell by cell a patch; more are needed only where components say little (noise)
_BOUNDS_AT_ONCE = 2_000_000  # 8 MB of bounds, so that they stay in the cache


def _axis_basis(image: Float32, usable: Bools, scale: Float32) -> Float32:
    """Principal components (w, K) of the scaled runs of w cells along the second axis of `image` (H, W, C)."""
    window = len(scale)
    whole = sliding_window_view(usable, window, axis=1).all(axis=2)
    runs = sliding_window_view(image, window, axis=1)[whole].reshape(-1, window) * scale
    moments = (runs.T @ runs).astype(np.float64)
    _, vectors = np.linalg.eigh(moments)
    return np.ascontiguousarray(vectors[:, ::-1][:, :_N_AXIS], dtype=np.float32)


def _filter_matrix(filters: Float32, length: int) -> Float32:
    """(length - w + 1, K, length): a line of cells times this gives the K filters (w, K) at every place."""
    window, n_filters = filters.shape
    n_places = length - window + 1
    matrix = np.zeros((n_places, n_filters, length), dtype=np.float32)
    places = np.arange(n_places)
    for offset in range(window):
        matrix[places, :, places + offset] = filters[offset]
    return matrix


class PatchSearch:
    """Finds the patches of one example that are nearest to given patches of other maps.

    Parameters
    ----------
    example : (H, W, C) float32, values in every cell, near zero mean.
    usable : (H, W) bool, the cells that candidates are made of (the rest may be looked at by the fallback's candidates).
    candidates : (M, 2) int32, first cells (row, column) of the patches to choose from.
    weight_rows, weight_columns : (h,), (w,) float32, falloff of the weights of a patch's cells.
    """

    def __init__(
        self, example: Float32, usable: Bools, candidates: Int32, weight_rows: Float32, weight_columns: Float32
    ) -> None:
        self.example = example
        self.candidates = candidates
        self.weight_rows = weight_rows
        self.weight_columns = weight_columns
        self._layout = np.zeros((len(candidates), 2))
        coordinates, self._basis = self._components(usable)
        norms = self._candidate_norms()
        rest = np.sqrt(np.maximum(norms - np.einsum("md,md->m", coordinates, coordinates), 0.0))
        self._mean = coordinates.mean(axis=0)
        self._vectors = np.column_stack([coordinates - self._mean, rest])
        # the mean squared distance of a candidate from about their mean
        self.variance = float(np.einsum("md,md->", self._vectors, self._vectors) / len(candidates))

    def _components(self, usable: Bools) -> tuple[Float32, Float32]:
        """Coordinates (M, d) of the candidates in, and the (h * w * C, d) orthonormal basis of, the components."""
        example = self.example
        height, width, n_channels = example.shape
        scale_rows, scale_columns = np.sqrt(self.weight_rows), np.sqrt(self.weight_columns)
        across = _axis_basis(example, usable, scale_columns)
        down = _axis_basis(example.transpose(1, 0, 2), usable.T, scale_rows)
        n_across, n_down = across.shape[1], down.shape[1]

        matrix = _filter_matrix(scale_columns[:, None] * across, width)
        lines = np.tensordot(example, matrix, axes=(1, 2)).reshape(height, n_channels, -1, n_across)
        power = np.einsum("icjk,icjk->ck", lines, lines).ravel()
        kept = np.sort(np.argsort(-power, kind="stable")[: max(1, _N_PRODUCTS // 2)])
        lines = lines.transpose(0, 2, 1, 3).reshape(height, -1, n_channels * n_across)[:, :, kept]
        matrix = _filter_matrix(scale_rows[:, None] * down, height)
        products = np.tensordot(matrix, lines, axes=(2, 0))  # (H', K, W', kept)
        rows, columns = self.candidates.T
        products = products[rows, :, columns, :].reshape(len(rows), -1)

        best = np.sort(np.argsort(-products.var(axis=0), kind="stable")[:_N_PRODUCTS])
        products = products[:, best]
        _, vectors = np.linalg.eigh(np.cov(products.T, bias=True).reshape(len(best), len(best)).astype(np.float64))
        vectors = vectors[:, ::-1][:, :_N_COMPONENTS].astype(np.float32)
        # the same linear map, written out for whole patches
        spread = np.zeros((n_down, n_channels * n_across, vectors.shape[1]), dtype=np.float32)
        k, line = np.divmod(best, len(kept))
        spread[k, kept[line]] = vectors
        spread = spread.reshape(n_down, n_channels, n_across, -1)
        half = np.tensordot(down, spread, axes=(1, 0))  # (h, C, K, d)
        basis = np.tensordot(half, across, axes=(2, 1)).transpose(0, 3, 1, 2)  # (h, w, C, d)
        return products @ vectors, np.ascontiguousarray(basis.reshape(-1, vectors.shape[1]))

    def _candidate_norms(self) -> Float64:
        """Weighted squared lengths (M,) of the candidates."""
        squares = np.einsum("ijc,ijc->ij", self.example, self.example, dtype=np.float64)
        height, width = squares.shape
        down = _filter_matrix(self.weight_rows[:, None], height)[:, 0].astype(np.float64)
        across = _filter_matrix(self.weight_columns[:, None], width)[:, 0].astype(np.float64)
        norms = down @ squares @ across.T
        return np.asarray(norms[self.candidates[:, 0], self.candidates[:, 1]], dtype=np.float64)

    def set_layout(self, layout: Float64) -> None:
        """Positions (M, 2) of the candidates; their squared distance to the patches' positions adds to the cost."""
        self._layout = layout

    def costs(self, image: Float32, corners: Int32, layout: Float64, chosen: Int32) -> Float64:
        """Costs (P,) of the chosen candidates (P,) for the patches of `image` at `corners` (P, 2); inf for -1."""
        arguments = (self.example, self.candidates, self._layout, self.weight_rows, self.weight_columns)
        return np.asarray(patch_costs(image, corners, layout, *arguments, chosen))

    def nearest(self, image: Float32, corners: Int32, layout: Float64, chosen: Int32) -> tuple[Int32, Float64]:
        """The candidate (P,) int32 of least cost for each patch of `image` at `corners`, and its cost (P,) float64.

        `chosen` (P,) int32 are the present candidates (-1: none), kept unless another costs less. Candidates of equal
        cost: the first.
        """
        costs = self.costs(image, corners, layout, chosen)
        chosen = chosen.copy()
        patches = gather_patches(image, corners, self.weight_rows, self.weight_columns)
        norms = np.einsum("pd,pd->p", patches, patches, dtype=np.float64)
        coordinates = patches @ self._basis
        rest = np.sqrt(np.maximum(norms - np.einsum("pd,pd->p", coordinates, coordinates), 0.0))
        queries = np.column_stack([coordinates - self._mean, rest, layout])
        targets = np.column_stack([self._vectors, self._layout])
        target_squares = np.einsum("md,md->m", targets, targets)
        query_squares = np.einsum("pd,pd->p", queries, queries)
        # what rounding of the float32 product may add to a bound
        slack = 4e-6 * (norms + query_squares + target_squares.max(initial=0.0))
        left = np.column_stack([-2.0 * queries, query_squares - slack, np.ones(len(queries))]).astype(np.float32)
        right = np.column_stack([targets, np.ones(len(targets)), target_squares]).astype(np.float32).T
        step = max(1, _BOUNDS_AT_ONCE // len(targets))
        for start in range(0, len(corners), step):
            part = slice(start, start + step)
            choose_sources(
                image,
                corners[part],
                layout[part],
                self.example,
                self.candidates,
                self._layout,
                self.weight_rows,
                self.weight_columns,
                left[part] @ right,
                chosen[part],
                costs[part],
                _MAX_CHECKS,
            )
        return chosen, costs
