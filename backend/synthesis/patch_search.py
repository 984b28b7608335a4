"""Exact nearest neighbourhoods in an example map, the M-step of texture optimisation (Kwatra et al. 2005; M-3).

Patches are compared by the weighted squared distance of all their cells. Most of that distance lies in a few principal
components of the patches, which are found from separable one-dimensional bases and so cost little more than filtering
the map. The distance in those components, plus the difference of the lengths of what they leave out, is a lower bound
of the true distance: one matrix product gives it for all pairs, and only candidates with a small bound are compared
cell by cell. That keeps the search exact, at a small part of the cost of trying every candidate.

From one search to the next most patches hardly move, and the triangle inequality says which of them cannot have come
nearer to another candidate; those are not searched again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..types import Bools, Float32, Float64, Int32
from ._texture_kernels import choose_sources, gather_patches, measure_patches

_N_AXIS = 8  # one-dimensional components kept a direction
_N_PRODUCTS = 192  # products of channel and directions that the principal components are found in
_EXPLAINED = 0.99  # share of the variance of the products that the components hold
_MAX_CHECKS = 64  # candidates compared cell by cell a patch; only for white noise are they not enough, by some per cent
_BOUNDS_AT_ONCE = 2_000_000  # 8 MB of bounds, so that they stay in the cache


@dataclass(frozen=True, slots=True)
class Matches:
    """The candidates chosen for P patches of an image.

    chosen : (P,) int32, candidate of each patch, -1 for none.
    costs : (P,) float64, weighted squared distance to it, with the pull to the same place; inf for none.
    patches : (P, D) float32, the patches when they were last searched.
    runner_up : (P,) float64, no other candidate was nearer than this then (square root of the cost).
    """

    chosen: Int32
    costs: Float64
    patches: Float32
    runner_up: Float64


@dataclass(frozen=True, slots=True)
class PatchPlaces:
    """Where patches are: corners (P, 2) int32, first row and column; positions (P, 2) float64 for the layout's pull."""

    corners: Int32
    positions: Float64


class PatchSearch:
    """Finds the patches of one example that are nearest to given patches of other maps.

    Parameters
    ----------
    example : (H, W, C) float32, values in every cell, near zero mean.
    usable : (H, W) bool, the cells whose patches the components are made for.
    candidates : places of the M patches to choose from.
    falloff : (w,) float32, weights of a patch's cells along either direction.
    layout_weight : what a squared distance 1 between positions adds to the cost, in variances of the candidates.
    """

    def __init__(
        self, example: Float32, usable: Bools, candidates: PatchPlaces, falloff: Float32, layout_weight: float = 0.0
    ) -> None:
        self.example = example
        # the kernels are compiled once only if the layout in memory is always the same
        self.candidates = np.ascontiguousarray(candidates.corners)
        self.falloff = falloff
        coordinates, self._basis = self._components(usable)
        rest = np.sqrt(np.maximum(self._candidate_norms() - np.einsum("md,md->m", coordinates, coordinates), 0.0))
        self._mean = coordinates.mean(axis=0)
        vectors = np.column_stack([coordinates - self._mean, rest])
        # the mean squared distance of a candidate from about their mean
        self.variance = float(np.einsum("md,md->", vectors, vectors) / len(rest))
        self._position_scale = float(np.sqrt(layout_weight * self.variance))
        self._vectors = np.column_stack([vectors, self._position_scale * candidates.positions])
        self._no_prices = np.zeros(len(rest))

    def _components(self, usable: Bools) -> tuple[Float32, Float32]:
        """Coordinates (M, d) of the candidates in, and the (w * w * C, d) orthonormal basis of, the components."""
        height, width, n_channels = self.example.shape
        scale = np.sqrt(self.falloff)
        across = _axis_basis(self.example, usable, scale)
        down = _axis_basis(self.example.transpose(1, 0, 2), usable.T, scale)
        n_across, n_down = across.shape[1], down.shape[1]

        matrix = _filter_matrix(scale[:, None] * across, width)
        lines = np.tensordot(self.example, matrix, axes=(1, 2)).reshape(height, n_channels, -1, n_across)
        power = np.einsum("icjk,icjk->ck", lines, lines).ravel()
        kept = _largest(power, _N_PRODUCTS // 2)
        lines = lines.transpose(0, 2, 1, 3).reshape(height, -1, n_channels * n_across)[:, :, kept]
        matrix = _filter_matrix(scale[:, None] * down, height)
        products = np.tensordot(matrix, lines, axes=(2, 0))  # rows, filters down, columns, kept
        rows, columns = self.candidates.T
        products = products[rows, :, columns, :].reshape(len(rows), -1)

        best = _largest(products.var(axis=0), _N_PRODUCTS)
        products = products[:, best]
        centered = products - products.mean(axis=0)
        variances, vectors = np.linalg.eigh((centered.T @ centered).astype(np.float64))
        shares = np.cumsum(variances[::-1]) / max(variances.sum(), 1e-300)
        n_components = 1 + int(np.searchsorted(shares[:-1], _EXPLAINED))
        vectors = vectors[:, ::-1][:, :n_components].astype(np.float32)
        # the same linear map, written out for whole patches
        spread = np.zeros((n_down, n_channels * n_across, vectors.shape[1]), dtype=np.float32)
        filter_down, line = np.divmod(best, len(kept))
        spread[filter_down, kept[line]] = vectors
        half = np.tensordot(down, spread.reshape(n_down, n_channels, n_across, -1), axes=(1, 0))
        basis = np.tensordot(half, across, axes=(2, 1)).transpose(0, 3, 1, 2)  # row, column, channel, component
        return products @ vectors, np.ascontiguousarray(basis.reshape(-1, vectors.shape[1]))

    def _candidate_norms(self) -> Float64:
        """Weighted squared lengths (M,) of the candidates."""
        squares = np.einsum("ijc,ijc->ij", self.example, self.example, dtype=np.float64)
        down, across = (_filter_matrix(self.falloff[:, None], side)[:, 0].astype(np.float64) for side in squares.shape)
        norms = down @ squares @ across.T
        return np.asarray(norms[self.candidates[:, 0], self.candidates[:, 1]], dtype=np.float64)

    def first_matches(self, corners: Int32) -> Matches:
        """Matches with the candidates at `corners` (P, 2) of the example, none where no candidate starts there."""
        numbers = np.full(self.example.shape[:2], -1, dtype=np.int32)
        numbers[self.candidates[:, 0], self.candidates[:, 1]] = np.arange(len(self.candidates))
        inside = ((corners >= 0) & (corners < numbers.shape)).all(axis=1)
        rows, columns = np.where(inside[:, None], corners, 0).T
        chosen = np.where(inside, numbers[rows, columns], np.int32(-1))
        patches = np.zeros((len(corners), len(self._basis)), dtype=np.float32)
        return Matches(chosen, np.full(len(corners), np.inf), patches, np.zeros(len(corners)))

    def improve(self, image: Float32, places: PatchPlaces, matches: Matches, prices: Float64 | None = None) -> Matches:
        """Find the candidate of least cost for each patch of `image` at `places`; M-step of Kwatra et al. 2005.

        A present candidate stays unless another costs less; of others that cost the same, the first is taken. `prices`
        (M,) float64, 0 or more, add to the costs of the candidates, but not to the costs that are returned.
        """
        if prices is None:
            prices, runner_up = self._no_prices, matches.runner_up
        else:
            runner_up = np.zeros_like(matches.runner_up)  # it was found for other prices
        # a price is a squared distance too: along one more direction, in which all the image's patches lie at 0
        layout = np.column_stack([self._position_scale * places.positions, np.zeros(len(places.corners))])
        targets = np.column_stack([self._vectors, np.sqrt(prices)])
        arguments = (self.example, self.candidates, np.ascontiguousarray(targets[:, -3:]), self.falloff)
        costs, moved = measure_patches(image, places.corners, layout, *arguments, matches.chosen, matches.patches)
        # the factor covers rounding: costs and distances are sums of float32
        stale = np.flatnonzero((np.sqrt(costs) + moved) * (1.0 + 1e-4) >= runner_up)
        patches = gather_patches(image, places.corners[stale], self.falloff)
        found = Matches(matches.chosen.copy(), costs, matches.patches.copy(), runner_up.copy())
        found.patches[stale] = patches
        left, right = self._factors(patches, layout[stale], targets)
        step = max(1, _BOUNDS_AT_ONCE // len(targets))
        for start in range(0, len(stale), step):
            part = stale[start : start + step]
            bounds = left[start : start + step] @ right
            own = (places.corners[part], layout[part], *arguments, bounds, found.chosen[part], costs[part])
            found.chosen[part], found.costs[part], squares = choose_sources(image, *own, _MAX_CHECKS)
            found.runner_up[part] = 0.0 if prices.any() else np.sqrt(np.maximum(squares, 0.0))
        found.costs[:] -= prices[found.chosen]
        return found

    def _factors(self, patches: Float32, layout: Float64, targets: Float64) -> tuple[Float32, Float32]:
        """Two matrices whose product (P, M) is a lower bound of the costs of all candidates for all patches."""
        norms = np.einsum("pd,pd->p", patches, patches, dtype=np.float64)
        coordinates = patches @ self._basis
        rest = np.sqrt(np.maximum(norms - np.einsum("pd,pd->p", coordinates, coordinates), 0.0))
        queries = np.column_stack([coordinates - self._mean, rest, layout])
        query_squares = np.einsum("pd,pd->p", queries, queries)
        target_squares = np.einsum("md,md->m", targets, targets)
        # what rounding of the float32 product may add to a bound
        slack = 4e-6 * (norms + query_squares + target_squares.max())
        left = np.column_stack([-2.0 * queries, np.ones(len(queries)), query_squares - slack])
        right = np.column_stack([targets, target_squares, np.ones(len(targets))])
        return left.astype(np.float32), np.ascontiguousarray(right.astype(np.float32).T)


def _largest(values: Float32, n_largest: int) -> Int32:
    """Indices of the `n_largest` largest values, ascending; of equal values the first."""
    return np.sort(np.argsort(-values, kind="stable")[:n_largest]).astype(np.int32)


def _axis_basis(image: Float32, usable: Bools, scale: Float32) -> Float32:
    """Principal components (w, K) of the scaled runs of w cells along the second axis of `image` (H, W, C)."""
    window = len(scale)
    whole = sliding_window_view(usable, window, axis=1).all(axis=2)
    runs = sliding_window_view(image, window, axis=1)[whole].reshape(-1, window) * scale
    _, vectors = np.linalg.eigh((runs.T @ runs).astype(np.float64))
    return np.ascontiguousarray(vectors[:, ::-1][:, :_N_AXIS], dtype=np.float32)


def _filter_matrix(filters: Float32, length: int) -> Float32:
    """(length - w + 1, K, length): this times a line of cells gives the K filters (w, K) at every place."""
    window, n_filters = filters.shape
    places = np.arange(length - window + 1)
    matrix = np.zeros((len(places), n_filters, length), dtype=np.float32)
    for offset in range(window):
        matrix[places, :, places + offset] = filters[offset]
    return matrix
