"""Texture optimisation of feature maps (Wang et al. 2009, sec. 5.1; Kwatra et al. 2005; W-18, M-3).

The output minimises E = sum_p |x_p - z_p|^r over the patches p of a grid, x_p being the output's patch and z_p the
nearest patch of the example; |.| weights the cells of a patch by a Gaussian. In turns the z_p are chosen (M-step) and
averaged with the weights |x_p - z_p|^(r-2) (E-step); E never rises. Coarse to fine, with smaller and smaller patches.

Left alone, the method fills the output with the calmest part of the example, where patches differ least. At the
coarsest scale a price on patches that are used much already prevents that (the uniformity of Kaspar et al. 2015, "Self
Tuning Texture Optimization"), which leads to lower energies in the end.

Only patches that are wholly valid are chosen. Of the output, patches count that touch its mask; cells outside the mask
take part only as far as these patches reach over the border, so they constrain nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d, distance_transform_edt

from ..errors import require
from ..progress import NO_PROGRESS, Progress
from ..types import Bools, FeatureMap, Float32, Float64, Int32
from ._texture_kernels import blend_patches
from .patch_search import PatchPlaces, PatchSearch

_FEWEST_CELLS = 8  # a coarser scale is used only if the example's shorter side has this many cells there
_FEWEST_SHARE = 0.15  # a window is shrunk until its places number this share of the example's cells
_SMALL_WINDOW = 4  # windows are not shrunk further than this before patches with invalid cells are let in
_MOSTLY = 0.75  # the valid share of such a patch


@dataclass(frozen=True, slots=True)
class TextureParams:
    """Settings of synthesize_texture; the defaults are those of Kwatra et al. 2005 (M-3)."""

    window_sizes: tuple[int, ...] = (
        32,
        16,
        8,
    )  # cells, used one after the other at every scale, clipped to the example
    n_scales: int = 3  # each half as fine as the one before; fewer for small maps
    n_iterations: int = 10  # M- and E-steps for each window size of each scale, fewer when nothing changes
    exponent: float = 0.8  # r, robustness of the energy: 2 is least squares
    layout_weight: float = 0.0  # pull to sources from the same scalp position; 0: none, as in the paper
    coverage_weight: float = 0.5  # how much parts of the example used often are avoided at the coarsest scale; 0: not
    seed: int = 0

    def __post_init__(self) -> None:
        sizes = self.window_sizes
        require(len(sizes) > 0, "window_sizes is empty; give a window size")
        require(min(sizes) >= 2, f"window_sizes has {min(sizes)}; windows must have 2 cells or more")
        descending = all(a > b for a, b in pairwise(sizes))
        require(descending, f"window_sizes are {sizes}; put them in descending order")
        require(1 <= self.n_scales <= 8, f"n_scales is {self.n_scales}; it must be in 1..8")
        require(self.n_iterations >= 1, f"n_iterations is {self.n_iterations}; it must be 1 or more")
        require(0 < self.exponent <= 2, f"exponent is {self.exponent}; it must be above 0 and at most 2")
        require(self.layout_weight >= 0, f"layout_weight is {self.layout_weight}; it must be 0 or more")
        require(self.coverage_weight >= 0, f"coverage_weight is {self.coverage_weight}; it must be 0 or more")


@dataclass(frozen=True, slots=True)
class TextureResult:
    """A synthesised map and how it came about.

    map : the output.
    energies : (K,) float64, the energy E after the M-step of each of the K iterations.
    stages : (K, 2) int32, the scale (0 is the finest) and window size in cells of each iteration.
    source : (H, W, 2) int32, row and column of the example's cell that has the largest part in each output cell; -1
        outside the mask.
    """

    map: FeatureMap
    energies: Float64
    stages: Int32
    source: Int32


@dataclass(frozen=True, slots=True)
class _Scale:
    """The example at one scale: values (H, W, C) filled everywhere, mask (H, W), and windows with their places."""

    values: Float32
    mask: Bools
    windows: tuple[tuple[int, Int32], ...]  # window size, (M, 2) first cells of the patches to choose from


def synthesize_texture(
    example: FeatureMap,
    out_mask: Bools,
    params: TextureParams = TextureParams(),
    *,
    origin: Float64 | None = None,
    progress: Progress = NO_PROGRESS,
) -> TextureResult:
    """Synthesise a feature map that looks like an example (Wang et al. 2009, sec. 5.1; Kwatra et al. 2005; W-18, M-3).

    Parameters
    ----------
    example : the example's feature map; cells outside its mask are never used.
    out_mask : (H, W) bool, the cells to synthesise, same spacing as the example.
    origin : (2,) float64 scalp coordinates u, v of the output's first cell, radians; the example's if None.
    progress : called once an iteration; may raise Cancelled.

    Returns
    -------
    TextureResult : values are 0 outside out_mask. The same input gives the same bytes on one machine.

    Raises
    ------
    InputError : an example without valid cells, or an out_mask without cells.
    """
    require(example.mask.any(), "the example's feature map has no valid cell; its strands have no roots on the scalp")
    require(out_mask.ndim == 2 and out_mask.dtype == np.bool_, "the output mask must be a two-dimensional bool array")
    require(out_mask.any(), "the output mask is empty; choose a larger scalp region")
    mean = example.values[example.mask].mean(axis=0, dtype=np.float64).astype(np.float32)
    filled = _nearest_valid(example.mask)
    values = np.ascontiguousarray(example.values[filled[0], filled[1]] - mean)
    scales = _build_scales(values, example.mask, out_mask, params)
    masks = _output_masks(out_mask, scales)
    start = example.origin if origin is None else np.asarray(origin, dtype=np.float64)
    rows, columns = np.nonzero(example.mask)
    extent = max(np.ptp(rows), np.ptp(columns)) + 1
    shift = (start - example.origin)[::-1] / example.spacing
    state = _State(scales, masks, _Layout(params.layout_weight, shift, float(extent)), params)
    image, sources = state.run(progress)
    height, width = out_mask.shape
    source = filled[:, sources[:height, :width, 0], sources[:height, :width, 1]].transpose(1, 2, 0).astype(np.int32)
    source[~out_mask] = -1
    out_values = np.where(out_mask[..., None], image[:height, :width] + mean, np.float32(0.0))
    result = FeatureMap(out_values.astype(np.float32), out_mask.copy(), start, example.spacing)
    return TextureResult(result, np.array(state.energies), np.array(state.stages, dtype=np.int32), source)


def _nearest_valid(mask: Bools) -> NDArray[np.int32]:
    """(2, H, W) row and column of the nearest valid cell of each cell."""
    found = distance_transform_edt(~mask, return_distances=False, return_indices=True)
    return np.asarray(found, dtype=np.int32)


def _fill(values: Float32, mask: Bools) -> Float32:
    """The values with those of the nearest valid cell where the mask is false."""
    rows, columns = _nearest_valid(mask)
    return np.ascontiguousarray(values[rows, columns])


def _halve(values: Float32, mask: Bools) -> tuple[Float32, Bools]:
    """The map at half the resolution: means of the valid cells of each 2 x 2; valid where two or more of them are."""
    padding = [(0, values.shape[0] % 2), (0, values.shape[1] % 2)]
    weight = np.pad(mask, padding).astype(np.float32)
    padded = np.pad(values, [*padding, (0, 0)]) * weight[..., None]
    blocks = padded.reshape(padded.shape[0] // 2, 2, padded.shape[1] // 2, 2, -1).sum(axis=(1, 3))
    counts = weight.reshape(weight.shape[0] // 2, 2, weight.shape[1] // 2, 2).sum(axis=(1, 3))
    coarse = counts >= 2
    means = np.asarray(blocks / np.maximum(counts, 1.0)[..., None], dtype=np.float32)
    return _fill(means, coarse) if coarse.any() else means, coarse


def _double(image: Float32) -> Float32:
    """The image at twice the resolution, interpolated linearly between cell centers."""
    for axis in (0, 1):
        ends = np.pad(image, [(int(a == axis), int(a == axis)) for a in range(3)], mode="edge")
        before, here, after = (np.take(ends, range(i, i + image.shape[axis]), axis=axis) for i in range(3))
        pairs = np.stack([0.25 * before + 0.75 * here, 0.75 * here + 0.25 * after], axis=axis + 1)
        image = pairs.reshape([n * (1 + (a == axis)) for a, n in enumerate(image.shape)])
    return np.ascontiguousarray(image, dtype=np.float32)


def _double_sources(sources: Int32) -> Int32:
    """The sources (H, W, 2) of the cells at twice the resolution."""
    doubled = 2 * np.repeat(np.repeat(sources, 2, axis=0), 2, axis=1)
    return doubled + np.indices(doubled.shape[:2], dtype=np.int32).transpose(1, 2, 0) % 2


def _area_sums(mask: Bools) -> NDArray[np.intp]:
    """(H + 1, W + 1) numbers of true cells above and left of each corner of the cells."""
    return np.pad(np.cumsum(np.cumsum(mask, axis=0), axis=1), ((1, 0), (1, 0)))


def fit_window(mask: Bools, wanted: int) -> tuple[int, Int32]:
    """The largest window up to `wanted` that fits in the mask in enough places, and these places (M, 2).

    Where holes let no window of some size fit, patches with a few invalid cells are taken (those have the value of the
    nearest valid cell), and only then smaller windows; one of a single cell always fits.
    """
    sums = _area_sums(mask)
    least = min(wanted, _SMALL_WINDOW)
    attempts = [(size, 1.0) for size in range(wanted, least - 1, -1)]
    attempts += [(size, _MOSTLY) for size in range(wanted, least - 1, -1)]
    attempts += [(size, 1.0) for size in range(least - 1, 0, -1)]
    for size, share in attempts:
        if size > min(mask.shape):
            continue
        counts = sums[size:, size:] - sums[:-size, size:] - sums[size:, :-size] + sums[:-size, :-size]
        places = np.argwhere(counts >= share * size**2).astype(np.int32)
        if len(places) >= _FEWEST_SHARE * mask.sum():
            break
    return size, places


def _build_scales(values: Float32, mask: Bools, out_mask: Bools, params: TextureParams) -> list[_Scale]:
    """The example from fine to coarse, with the windows that fit it."""
    sides = [np.ptp(np.nonzero(m)[axis]) + 1 for m in (mask, out_mask) for axis in (0, 1)]
    n_scales = 1
    while n_scales < params.n_scales and min(sides) >> n_scales >= _FEWEST_CELLS:
        n_scales += 1
    scales: list[_Scale] = []
    for _ in range(n_scales):
        fits = dict(fit_window(mask, wanted) for wanted in params.window_sizes)
        scales.append(_Scale(values, mask, tuple(fits.items())))
        values, mask = _halve(values, mask)
        if not mask.any():
            break
    return scales


def _output_masks(out_mask: Bools, scales: list[_Scale]) -> list[Bools]:
    """The output's mask at every scale, each a grid that the largest window fits in and half the one before."""
    step = 1 << (len(scales) - 1)
    largest = max(window << level for level, scale in enumerate(scales) for window, _ in scale.windows)
    shape = [-(-max(side, largest) // step) * step for side in out_mask.shape]
    mask = np.zeros(shape, dtype=np.bool_)
    mask[: out_mask.shape[0], : out_mask.shape[1]] = out_mask
    masks = [mask]
    for _ in scales[1:]:
        mask = mask.reshape(mask.shape[0] // 2, 2, mask.shape[1] // 2, 2).any(axis=(1, 3))
        masks.append(mask)
    return masks


@dataclass(frozen=True, slots=True)
class _Layout:
    """Where cells lie on the scalp, for the pull of `layout_weight`: in units of the example's longer side."""

    weight: float
    shift: Float64  # (2,) rows and columns from the example's first cell to the output's
    extent: float  # longer side of the example, cells

    def places(self, corners: Int32, window: int, level: int, shifted: bool) -> PatchPlaces:
        """Patches of the example, or (`shifted`) of the output, with the positions of their centers."""
        centers = (corners + 0.5 * window) * float(1 << level)
        return PatchPlaces(corners, (centers + self.shift if shifted else centers) / self.extent)


@dataclass(frozen=True, slots=True)
class PatchGrid:
    """The patches of the output at one scale and window size: first cells `rows` x `columns`, those on the mask."""

    rows: Int32
    columns: Int32
    patch_at: Int32  # (A, B), patch of each place of the grid, -1 for none
    corners: Int32  # (P, 2)


def place_patches(mask: Bools, window: int) -> PatchGrid:
    """Patches every quarter of a window (X+ of Kwatra et al. 2005), with the last ones flush with the border."""
    stride = max(1, window // 4)
    rows, columns = (
        np.unique(np.append(np.arange(0, side - window, stride), side - window)).astype(np.int32) for side in mask.shape
    )
    sums = _area_sums(mask)
    low, high = np.ix_(rows, columns), np.ix_(rows + window, columns + window)
    counts = sums[high] - sums[low[0], high[1]] - sums[high[0], low[1]] + sums[low]
    patch_at = np.full(counts.shape, -1, dtype=np.int32)
    patch_at[counts > 0] = np.arange((counts > 0).sum())
    corners = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=2)[counts > 0]
    return PatchGrid(rows, columns, patch_at, np.ascontiguousarray(corners))


def falloff_weights(window: int) -> Float32:
    """Gaussian weights (window,) of the cells of a patch along one direction, largest 1; deviation a third of it."""
    centered = np.arange(window) - 0.5 * (window - 1)
    weights: Float32 = np.exp(-0.5 * (centered / (window / 3)) ** 2).astype(np.float32)
    return weights


class _State:
    """The output while it is optimised."""

    def __init__(self, scales: list[_Scale], masks: list[Bools], layout: _Layout, params: TextureParams) -> None:
        self.scales, self.masks, self.layout, self.params = scales, masks, layout, params
        self.energies: list[float] = []
        self.stages: list[tuple[int, int]] = []
        self.image: Float32 = np.zeros((*masks[-1].shape, scales[0].values.shape[2]), dtype=np.float32)
        self.sources: Int32 = np.zeros((*masks[-1].shape, 2), dtype=np.int32)

    def run(self, progress: Progress) -> tuple[Float32, Int32]:
        """The output's values and sources on the finest grid."""
        n_steps = self.params.n_iterations * sum(len(scale.windows) for scale in self.scales)
        start = 0
        for level in range(len(self.scales) - 1, -1, -1):
            if level + 1 < len(self.scales):
                self.image, self.sources = _double(self.image), _double_sources(self.sources)
            for window, places in self.scales[level].windows:
                self._run_stage(level, window, places, start / n_steps, 1 / n_steps, progress)
                start += self.params.n_iterations
        progress(1.0, "Synthesizing the feature map")
        return self.image, self.sources

    def _run_stage(
        self, level: int, window: int, corners: Int32, start: float, step: float, progress: Progress
    ) -> None:
        """M- and E-steps at one scale with one window size, until the patches stop changing."""
        scale, params = self.scales[level], self.params
        candidates = self.layout.places(corners, window, level, shifted=False)
        search = PatchSearch(scale.values, scale.mask, candidates, falloff_weights(window), self.layout.weight)
        grid = place_patches(self.masks[level], window)
        places = self.layout.places(grid.corners, window, level, shifted=True)
        if not self.stages:
            first = np.random.default_rng(params.seed).integers(len(corners), size=len(grid.corners))
            self._blend(search, grid, first.astype(np.int32), np.ones(len(first)))
        # the present sources say where to look first
        half = window // 2
        rows, columns = (grid.corners + half).T
        matches = search.first_matches(self.sources[rows, columns] - half)
        # far below any distance that matters; keeps weights finite where a patch is an exact copy
        tiny = max(1e-6 * search.variance, 1e-30)
        last = level == 0 and window == scale.windows[-1][0]
        priced = params.coverage_weight > 0 and level == len(self.scales) - 1 and not last
        for iteration in range(params.n_iterations):
            progress(start + iteration * step, "Synthesizing the feature map")
            before = matches.chosen
            prices = None
            if priced:
                prices = params.coverage_weight * search.variance * self._usage(level, corners, window)
            matches = search.improve(self.image, places, matches, prices)
            costs = matches.costs + tiny
            self.energies.append(float((costs ** (0.5 * params.exponent)).sum()))
            self.stages.append((level, window))
            self._blend(search, grid, matches.chosen, costs ** (0.5 * params.exponent - 1.0))
            if iteration > 0 and np.array_equal(before, matches.chosen):
                break

    def _usage(self, level: int, corners: Int32, window: int) -> Float64:
        """How often the output uses the cells of each candidate (M,); 1 if all the example were used alike."""
        mask, out_mask = self.scales[level].mask, self.masks[level]
        rows, columns = self.sources[out_mask].T
        counts = np.bincount(rows * mask.shape[1] + columns, minlength=mask.size).reshape(mask.shape)
        weights = falloff_weights(window).astype(np.float64) / falloff_weights(window).sum(dtype=np.float64)
        filtered = correlate1d(correlate1d(counts * (mask.sum() / len(rows)), weights, axis=0), weights, axis=1)
        centers = corners + window // 2
        return np.asarray(filtered[centers[:, 0], centers[:, 1]], dtype=np.float64)

    def _blend(self, search: PatchSearch, grid: PatchGrid, chosen: Int32, weights: Float64) -> None:
        """E-step; cells that no patch covers take the value of the nearest covered one, to start finer scales from."""
        corners = search.candidates[chosen]
        image, sources = blend_patches(
            self.image, search.example, grid.rows, grid.columns, grid.patch_at, corners, weights, search.falloff
        )
        covered = sources[..., 0] >= 0
        if not covered.all():
            nearest = _nearest_valid(covered)
            image, sources = image[nearest[0], nearest[1]], sources[nearest[0], nearest[1]]
        self.image, self.sources = np.ascontiguousarray(image), sources
