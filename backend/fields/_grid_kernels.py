"""Kernels of `fields.grid`: which blocks the segments pass through, and eq. 9 within each block.

A *run* is a stretch of consecutive segments of one strand that pass through one block. Runs are sorted by block and
every block is then averaged by one thread, in the order of its runs: the result does not depend on the thread count.
Coordinates are (S, N, 3) in the space of the grid; segment i of strand s has the number s * N + i.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from ..kernels import device, kernel, parallel_kernel
from ..types import Floats, Int32

SHIFT = 3
SIDE = 1 << SHIFT  # cells along the edge of a block
BLOCK_CELLS = SIDE**3
SLIVER = 1e-10  # shares of a segment below this are rounding errors
N_PARTITIONS = 64  # fixed, so that the work is dealt out alike for any number of threads


@device
def _jumps(coordinates: Floats, strand: int, i: int, jump: float) -> Any:
    """Whether segment i spans more of the scalp coordinates than a short segment can: it passes the singularity."""
    across_u = abs(coordinates[strand, i + 1, 0] - coordinates[strand, i, 0])
    across_v = abs(coordinates[strand, i + 1, 1] - coordinates[strand, i, 1])
    return across_u > jump or across_v > jump


@parallel_kernel
def count_runs(coordinates: Floats, per_block: float, jump: float, counts: Int32, lows: Int32, highs: Int32) -> None:
    """Per strand: its runs, and the lowest and highest block that it touches.

    per_block : 1 / (edge of a block). counts (S,), lows (S, 3), highs (S, 3) are filled.
    """
    n_strands, n_points, _ = coordinates.shape
    for strand in numba.prange(n_strands):
        runs = 0
        is_open = False
        for axis in range(3):
            block = math.floor(np.float64(coordinates[strand, 0, axis]) * per_block)
            lows[strand, axis] = block
            highs[strand, axis] = block
        for i in range(n_points - 1):
            skipped = _jumps(coordinates, strand, i, jump)
            if not skipped and not is_open:
                runs += 1
            is_open = not skipped
            for axis in range(3):
                start = math.floor(np.float64(coordinates[strand, i, axis]) * per_block)
                end = math.floor(np.float64(coordinates[strand, i + 1, axis]) * per_block)
                lows[strand, axis] = min(lows[strand, axis], end)
                highs[strand, axis] = max(highs[strand, axis], end)
                if not skipped:
                    runs += abs(end - start)
        counts[strand] = runs


@device
def _nearest(plane: Floats) -> int:
    """The axis whose next plane the walk meets first."""
    axis = 0
    if plane[1] < plane[axis]:
        axis = 1
    if plane[2] < plane[axis]:
        axis = 2
    return axis


@device
def _open_run(
    run: int, segment: int, block: Int32, low: Int32, shape: Int32, table: Int32, keys: Int32, spans: Int32
) -> None:
    key = ((block[0] - low[0]) * shape[1] + block[1] - low[1]) * shape[2] + block[2] - low[2]
    table[key] = 1  # several threads may write it, but all write the same
    keys[run] = key
    spans[run, 0] = segment
    spans[run, 1] = segment


@parallel_kernel
def emit_runs(
    coordinates: Floats, per_block: float, jump: float, first_run: Int32, low: Int32, shape: Int32,
    table: Int32, keys: Int32, spans: Int32,
) -> None:  # fmt: skip
    """Walk the strands through the blocks; the walk always goes on behind the nearest plane of blocks.

    first_run (S + 1,): where each strand's runs start. Filled: table (blocks,) 1 where a block is met;
    keys (R,) flat block number; spans (R, 2) first and last segment.
    """
    n_strands, n_points, _ = coordinates.shape
    for partition in numba.prange(N_PARTITIONS):
        block = np.empty(3, np.int64)
        last_block = np.empty(3, np.int64)
        side = np.empty(3, np.int64)
        plane = np.empty(3)
        stride = np.empty(3)
        for strand in range(partition * n_strands // N_PARTITIONS, (partition + 1) * n_strands // N_PARTITIONS):
            run = first_run[strand]
            is_open = False
            for i in range(n_points - 1):
                if _jumps(coordinates, strand, i, jump):
                    is_open = False
                    continue
                segment = strand * n_points + i
                steps = 0
                for axis in range(3):
                    start = np.float64(coordinates[strand, i, axis]) * per_block
                    end = np.float64(coordinates[strand, i + 1, axis]) * per_block
                    block[axis] = math.floor(start)
                    last_block[axis] = math.floor(end)
                    across = last_block[axis] - block[axis]
                    steps += abs(across)
                    plane[axis] = np.inf
                    if across != 0:
                        side[axis] = 1 if across > 0 else -1
                        stride[axis] = 1.0 / abs(end - start)
                        ahead = block[axis] + 1 - start if across > 0 else start - block[axis]
                        plane[axis] = ahead * stride[axis]
                if is_open:
                    spans[run - 1, 1] = segment
                else:
                    _open_run(run, segment, block, low, shape, table, keys, spans)
                    run += 1
                    is_open = True
                for _ in range(steps):
                    axis = _nearest(plane)
                    block[axis] += side[axis]
                    plane[axis] = np.inf if block[axis] == last_block[axis] else plane[axis] + stride[axis]
                    _open_run(run, segment, block, low, shape, table, keys, spans)
                    run += 1


@kernel
def sort_runs(keys: Int32, table: Int32, next_run: Int32, spans: Int32, sorted_spans: Int32) -> None:
    """Counting sort of the runs by block, keeping their order within a block.

    table (blocks,): the rank of each met block. next_run (B,): where its runs start; on return, where they end.
    """
    for run in range(len(keys)):
        rank = table[keys[run]]
        place = next_run[rank]
        next_run[rank] = place + 1
        sorted_spans[place, 0] = spans[run, 0]
        sorted_spans[place, 1] = spans[run, 1]


@device
def _add_segments(
    spans: Int32, first: int, last: int, points: Floats, coordinates: Floats, per_cell: float, corner: Floats,
    weighted: bool, mean: Floats, sums: Floats, lengths: Floats,
) -> None:  # fmt: skip
    """Add the segments of the runs [first, last) to the cells of a block: unit tangent times length in the cell.

    points, coordinates : (P, 3) flat views. corner (3,): the block's first cell. sums (512, 3), lengths (512,) grow.
    """
    corner_x, corner_y, corner_z = float(corner[0]), float(corner[1]), float(corner[2])
    for run in range(first, last):
        for segment in range(spans[run, 0], spans[run, 1] + 1):
            step_x = np.float64(points[segment + 1, 0]) - np.float64(points[segment, 0])
            step_y = np.float64(points[segment + 1, 1]) - np.float64(points[segment, 1])
            step_z = np.float64(points[segment + 1, 2]) - np.float64(points[segment, 2])
            length = math.sqrt(step_x * step_x + step_y * step_y + step_z * step_z)
            if length == 0.0:
                continue
            ax, dx, inverse_x = _line(coordinates[segment, 0], coordinates[segment + 1, 0], per_cell, corner_x)
            ay, dy, inverse_y = _line(coordinates[segment, 1], coordinates[segment + 1, 1], per_cell, corner_y)
            az, dz, inverse_z = _line(coordinates[segment, 2], coordinates[segment + 1, 2], per_cell, corner_z)
            at, end = _clip(ax, inverse_x, 0.0, 1.0)
            at, end = _clip(ay, inverse_y, at, end)
            at, end = _clip(az, inverse_z, at, end)
            i, side_x, next_x, stride_x = _enter(ax, dx, inverse_x, at)
            j, side_y, next_y, stride_y = _enter(ay, dy, inverse_y, at)
            k, side_z, next_z, stride_z = _enter(az, dz, inverse_z, at)
            half_inverse_length = 0.5 / length
            while at < end:
                plane = min(min(next_x, next_y), next_z)
                share = min(plane, end) - at
                # rounding can leave a sliver beyond the last plane, outside the block
                if share > SLIVER:
                    cell = ((i & (SIDE - 1)) * SIDE + (j & (SIDE - 1))) * SIDE + (k & (SIDE - 1))
                    if weighted:
                        along = step_x * mean[cell, 0] + step_y * mean[cell, 1] + step_z * mean[cell, 2]
                        share *= along * half_inverse_length + 0.5
                    sums[cell, 0] += share * step_x
                    sums[cell, 1] += share * step_y
                    sums[cell, 2] += share * step_z
                    lengths[cell] += share * length
                at = plane
                if next_x == plane:
                    i += side_x
                    next_x += stride_x
                elif next_y == plane:
                    j += side_y
                    next_y += stride_y
                else:
                    k += side_z
                    next_z += stride_z


@device
def _line(a: Any, b: Any, per_cell: float, corner: float) -> tuple[Any, Any, Any]:
    """Along one axis, in cells of the block: a segment's start, its extent (never 0) and 1 / extent."""
    start: Any = np.float64(a) * per_cell - corner
    extent: Any = np.float64(b) * per_cell - corner - start
    if abs(extent) < 1e-12:
        extent = 1e-12
    return start, extent, 1.0 / extent


@device
def _clip(start: float, inverse: float, low: float, high: float) -> tuple[float, float]:
    """The part of [low, high] where start + t / inverse lies in the block; low >= high if there is none."""
    near = -start * inverse
    far = (SIDE - start) * inverse
    return max(low, min(near, far)), min(high, max(near, far))


@device
def _enter(start: float, extent: float, inverse: float, t: float) -> tuple[int, int, float, float]:
    """Along one axis: the cell at t, which way the cells go, t of the next plane and t between planes."""
    cell = min(max(math.floor(start + t * extent), 0), SIDE - 1)
    if extent > 0.0:
        return cell, 1, (cell + 1 - start) * inverse, inverse
    return cell, -1, (cell - start) * inverse, -inverse


@device
def _clear(sums: Floats, lengths: Floats) -> None:
    for cell in range(BLOCK_CELLS):
        sums[cell, 0], sums[cell, 1], sums[cell, 2], lengths[cell] = 0.0, 0.0, 0.0, 0.0


@device
def _normalise(sums: Floats, lengths: Floats, mean: Floats, coherence: Floats, is_first: bool) -> None:
    """mean (512, 3): the direction of each cell's sum. Add up the coherence (see average_blocks) of the block."""
    coherence[2] = 0.0
    for cell in range(BLOCK_CELLS):
        x, y, z = sums[cell, 0], sums[cell, 1], sums[cell, 2]
        size = math.sqrt(x * x + y * y + z * z) if lengths[cell] > 0.0 else 0.0
        if is_first:
            coherence[0] += size
            coherence[1] += lengths[cell]
        # tangents that cancel out leave rounding errors, which are no direction
        if size > 1e-9 * lengths[cell]:
            scale = 1.0 / size
            mean[cell, 0], mean[cell, 1], mean[cell, 2] = x * scale, y * scale, z * scale
            coherence[2] += 1.0
        else:
            mean[cell, 0], mean[cell, 1], mean[cell, 2] = 0.0, 0.0, 0.0


@device
def _store(mean: Floats, directions: Floats) -> None:
    """Copy mean (512, 3) into directions (9, 9, 9, 3)."""
    for i in range(SIDE):
        for j in range(SIDE):
            for k in range(SIDE):
                cell = (i * SIDE + j) * SIDE + k
                for axis in range(3):
                    directions[i, j, k, axis] = mean[cell, axis]


@parallel_kernel
def average_blocks(
    points: Floats, coordinates: Floats, per_cell: float, corners: Int32, starts: Int32, ends: Int32, spans: Int32,
    shares: Int32, iterations: int, directions: Floats, coherence: Floats,
) -> None:  # fmt: skip
    """Eq. 9 in every block, all passes while the block is in the cache.

    points, coordinates : (P, 3) flat views. corners (B, 3): first cell of each block; starts, ends (B,): its runs in
    spans (R, 2); shares (65,): the first block of each partition. Filled: directions (B, 9, 9, 9, 3) up to the last
    layers, unless it is empty; coherence (B, 3): sum over the cells of |sum of tangents times length| and of the
    length in the first pass, and the cells that have a direction.
    """
    for partition in numba.prange(N_PARTITIONS):
        mean = np.empty((BLOCK_CELLS, 3))
        sums = np.empty((BLOCK_CELLS, 3))
        lengths = np.empty(BLOCK_CELLS)
        for block in range(shares[partition], shares[partition + 1]):
            for iteration in range(iterations):
                _clear(sums, lengths)
                _add_segments(
                    spans, starts[block], ends[block], points, coordinates, per_cell, corners[block], iteration > 0,
                    mean, sums, lengths,
                )  # fmt: skip
                _normalise(sums, lengths, mean, coherence[block], iteration == 0)
            if len(directions) > 0:
                _store(mean, directions[block])


@device
def _fill_margin(corner: Int32, table: Int32, directions: Floats, own: Floats) -> None:
    for i in range(SIDE + 1):
        for j in range(SIDE + 1):
            for k in range(SIDE if i < SIDE and j < SIDE else 0, SIDE + 1):
                a, b, c = corner[0] + i // SIDE, corner[1] + j // SIDE, corner[2] + k // SIDE
                other = -1
                if a < table.shape[0] and b < table.shape[1] and c < table.shape[2]:
                    other = table[a, b, c]
                for axis in range(3):
                    own[i, j, k, axis] = directions[other, i % SIDE, j % SIDE, k % SIDE, axis] if other >= 0 else 0.0


@parallel_kernel
def fill_margins(corners: Int32, table: Int32, directions: Floats) -> None:
    """Copy into the last layer of each block, directions (B, 9, 9, 9, 3), the first cells of the blocks behind it.

    corners (B, 3): each block's place in table (BX, BY, BZ). With the copies a lookup needs one block only.
    """
    for block in numba.prange(len(corners)):
        _fill_margin(corners[block], table, directions, directions[block])
