"""Direction fields of hair: a sparse grid of averaged tangents (Wang et al. 2009, sec. 5.3, eq. 9).

The cells lie in scalp space, as in the paper, or in head space (the paper's own proposal for long draped hair, W-L1).
Either way they hold head-space vectors (W-A6). Only blocks of 8 x 8 x 8 cells that hair passes through are stored.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import require
from ..geometry._scalp_space_kernels import remap_polar
from ..geometry.scalp_space import ScalpSpace
from ..types import Float32, Float64, Floats, Int32
from ._grid_kernels import N_PARTITIONS, SHIFT, SIDE, average_blocks, count_runs, emit_runs, fill_margins, sort_runs
from ._lookup_kernels import map_to_cells

Int64 = NDArray[np.int64]

MAX_BLOCKS = 49_152  # 430 MB of directions
MAX_TABLE = 1 << 24  # 64 MB of block numbers
SPREAD_BLOCKS = 512  # at least so many of the blocks are looked at by tangent_spread
DENSE_SHIFT = 20  # a dense grid is one block that no grid outgrows
MAX_STEP_UV = 0.5  # radians that a segment may span in u or v; beyond, it passes the south pole, where u and v jump


@dataclass(frozen=True, slots=True)
class DirectionGrid:
    """Unit directions, or 0 where no hair passes, on the cells of a regular grid.

    space : the scalp space of the cells; None for cells in head space.
    spacing : edge of a cell: radians for u and v and head radii for w in scalp space, head radii in head space.
    origin : (3,) float64, lower corner of cell (0, 0, 0).
    shape : cells along each axis.
    blocks : (BX, BY, BZ) int32, the rank of each block in `directions`, -1 where no hair passes.
    directions : (B, X, Y, Z, 3) float32, head space; the cells of each block, in a sparse grid with one more layer
        along each axis that repeats the first cells of the next blocks.
    shift : log2 of the cells along the edge of a block; a dense grid is a single block.
    n_cells : cells that have a direction.
    """

    space: ScalpSpace | None
    spacing: float
    origin: Float64
    shape: tuple[int, int, int]
    blocks: Int32
    directions: Float32
    shift: int
    n_cells: int

    @property
    def strides(self) -> tuple[int, int, int]:
        """Cells in `directions` from one block, x and y to the next."""
        _, x, y, z, _ = self.directions.shape
        return x * y * z, y * z, z

    def dense(self) -> Float32:
        """(X, Y, Z, 3) float32, all cells; for tests and small grids."""
        if self.shift == DENSE_SHIFT:
            return np.asarray(self.directions[0])
        side = 1 << self.shift
        stored = np.concatenate(
            [self.directions[:, :side, :side, :side], np.zeros((1, side, side, side, 3), np.float32)]
        )
        tiles = stored[self.blocks]
        return np.ascontiguousarray(tiles.transpose(0, 3, 1, 4, 2, 5, 6)).reshape(*self.shape, 3)


@dataclass(frozen=True, slots=True)
class _Runs:
    """The stretches of strands within each block, sorted by block."""

    spacing: float
    low: Int64  # (3,) the lowest block
    table: Int32  # (BX, BY, BZ) rank of each block, -1 where there is none
    ends: Int64  # (B,) end of each block's runs
    spans: Int32  # (R, 2) first and last segment
    places: Int64  # (B, 3) of each block in the table


def dense_grid(directions: Float32, origin: Floats, spacing: float) -> DirectionGrid:
    """A grid from directions (X, Y, Z, 3) on cubic cells in whatever space the caller traces in.

    origin : (3,), lower corner of cell (0, 0, 0); spacing : edge of a cell, same unit.

    Raises
    ------
    InputError : another shape, or a spacing that is not above 0.
    """
    fits = directions.ndim == 4 and directions.shape[3] == 3 and directions.size > 0
    require(fits, f"directions must have shape (X, Y, Z, 3), not {directions.shape}")
    _check_spacing(spacing)
    x, y, z, _ = directions.shape
    return DirectionGrid(
        None, spacing, np.asarray(origin, np.float64), (x, y, z), np.zeros((1, 1, 1), np.int32),
        np.ascontiguousarray(directions, np.float32)[None], DENSE_SHIFT,
        int(np.count_nonzero(directions.any(axis=3))),
    )  # fmt: skip


def build_direction_grid(
    points: Float32, space: ScalpSpace | None, spacing: float, *, iterations: int = 2, max_blocks: int = MAX_BLOCKS
) -> DirectionGrid:
    """Average the tangents of strands in cells, with outliers weighted down (W-25, W-27, M-8, eq. 9).

    Each segment adds its unit tangent times its length within the cell to every cell that it passes through (W-A5:
    clipped exactly; within a segment scalp space is interpolated between the ends). The first pass is a plain
    average; each further one weighs a segment by 0.5 (T . v + 1), v being the cell's direction so far.

    Parameters
    ----------
    points : (S, N, 3) float32, head space, root first.
    space : put the cells in this scalp space; None for cells in head space (W-L1).
    spacing : edge of a cell; doubled until the grid has at most `max_blocks` blocks (the result's `spacing` tells).
    iterations : passes, 2 in the paper.

    Raises
    ------
    InputError : a shape, spacing or number of passes out of range.
    """
    require(1 <= iterations <= 16, f"iterations is {iterations}; it must be in 1..16")
    require(max_blocks >= 1, f"max_blocks is {max_blocks}; it must be 1 or more")
    coordinates = _coordinates(points, space, spacing)
    runs = _sorted_runs(coordinates, spacing, MAX_STEP_UV if space is not None else math.inf, max_blocks)
    directions = np.empty((len(runs.ends), *[SIDE + 1] * 3, 3), np.float32)
    coherence = _average(points, coordinates, runs, iterations, directions)
    fill_margins(runs.places, runs.table, directions)
    bx, by, bz = runs.table.shape
    return DirectionGrid(
        space, runs.spacing, runs.low * (SIDE * runs.spacing), (bx * SIDE, by * SIDE, bz * SIDE), runs.table,
        directions, SHIFT, int(coherence[:, 2].sum()),
    )  # fmt: skip


def tangent_spread(points: Float32, cell: float) -> float:
    """How far the tangents of hair that shares a cell spread, radians.

    With R the length of the mean of the unit tangents in a cell, weighted by length, their root mean square angle to
    the mean is sqrt(2 (1 - R)) for small angles; R is averaged over all hair (of large grooms, over the hair in some
    `SPREAD_BLOCKS` blocks of 8 x 8 x 8 cells, evenly spaced). 0: all parallel; sqrt 2: no order.

    points : (S, N, 3) float32, head space; cell : edge of the head-space cells, head radii.
    """
    coordinates = _coordinates(points, None, cell)
    runs = _sorted_runs(coordinates, cell, math.inf, MAX_TABLE)
    no_directions = np.empty((0, *[SIDE + 1] * 3, 3), np.float32)
    coherence = _average(points, coordinates, runs, 1, no_directions, len(runs.ends) // SPREAD_BLOCKS + 1)
    together, total = coherence[:, 0].sum(), coherence[:, 1].sum()
    return math.sqrt(max(0.0, 2.0 * (1.0 - together / total))) if total > 0 else 0.0


def _check_spacing(spacing: float) -> None:
    require(1e-6 <= spacing < math.inf, f"the grid spacing is {spacing}; it must be 1e-6 or more")


def _coordinates(points: Float32, space: ScalpSpace | None, spacing: float) -> Float32:
    """Check the input and give the points in the space of the grid."""
    _check_spacing(spacing)
    fits = points.ndim == 3 and points.shape[2] == 3 and points.shape[0] >= 1 and points.shape[1] >= 2
    require(fits, f"points must have shape (S, N, 3) with S >= 1 and N >= 2, not {points.shape}")
    size = points.shape[0] * points.shape[1]
    require(size < 2**31, f"{size} points are more than the {2**31 - 1} that one grid takes; use fewer strands")
    plain = np.ascontiguousarray(points, dtype=np.float32)
    if space is None:
        return plain
    coordinates = np.empty_like(plain)
    map_to_cells(plain, elevation_table(space), space.height, coordinates)
    return coordinates


def elevation_table(space: ScalpSpace, size: int = 4097) -> Float64:
    """(T,) the table by which kernels find (u, v): see _lookup_kernels.scalp_coordinates."""
    theta = np.arccos(np.linspace(-1.0, 1.0, size))
    half = 0.5 * np.array([remap_polar(angle, space.polar_scale) for angle in theta])
    rise = np.sin(theta) / np.tan(np.maximum(half, 1e-12))
    rise[-1] = 2.0 / space.polar_scale  # the limit at the top
    return np.asarray(np.maximum(rise, 0.0))


def _sorted_runs(coordinates: Float32, spacing: float, jump: float, max_blocks: int) -> _Runs:
    """Find the blocks that hair passes through; coarser ones while there are too many."""
    n_strands = len(coordinates)
    counts = np.empty(n_strands, np.int32)
    lows, highs = np.empty((2, n_strands, 3), np.int64)
    while True:
        per_block = 1.0 / (SIDE * spacing)
        count_runs(coordinates, per_block, jump, counts, lows, highs)
        low = lows.min(axis=0)
        shape = highs.max(axis=0) - low + 1
        first_run = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
        if shape.prod(dtype=np.float64) <= MAX_TABLE and first_run[-1] < 2**31:
            table = np.zeros(shape.prod(), np.int32)
            keys = np.empty(first_run[-1], np.int32)
            spans = np.empty((first_run[-1], 2), np.int32)
            emit_runs(coordinates, per_block, jump, first_run, low, shape, table, keys, spans)
            met = np.flatnonzero(table)
            if len(met) <= max_blocks:
                break
        spacing *= 2.0
    table.fill(-1)
    table[met] = np.arange(len(met), dtype=np.int32)
    ends = np.zeros(len(met), np.int64)
    ends[1:] = np.cumsum(np.bincount(table[keys], minlength=len(met)))[:-1]
    sorted_spans = np.empty_like(spans)
    sort_runs(keys, table, ends, spans, sorted_spans)
    places = np.stack(np.unravel_index(met, tuple(shape)), axis=1)
    return _Runs(spacing, low, table.reshape(shape), ends, sorted_spans, places)


def _average(
    points: Float32, coordinates: Float32, runs: _Runs, iterations: int, directions: Float32, every: int = 1
) -> Float64:
    """Fill `directions` (none if it is empty) and give the coherence of each block, or of every so many blocks."""
    starts = np.concatenate([[0], runs.ends[:-1]])[::every]
    coherence = np.zeros((len(starts), 3))
    flat = np.ascontiguousarray(points, dtype=np.float32).reshape(-1, 3)
    ends = runs.ends[::every]
    # blocks with about as many runs to each partition, neighbours together: they share strands
    n_runs = np.concatenate([[0], np.cumsum(ends - starts)])
    shares = np.searchsorted(n_runs, n_runs[-1] * np.arange(N_PARTITIONS + 1) // N_PARTITIONS)
    shares[-1] = len(starts)
    average_blocks(
        flat, coordinates.reshape(-1, 3), 1.0 / runs.spacing, (runs.places[::every] + runs.low) * SIDE, starts, ends,
        runs.spans, shares, iterations, directions, coherence,
    )  # fmt: skip
    return coherence
