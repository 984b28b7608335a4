"""PatchMatch between two flat images; `patch_match.py` explains the method.

Images are rows of bytes, red, green, blue interleaved, with at least 32 bytes of padding at the end: a row of a patch
(up to 10 pixels, 30 bytes) is read as one vector of 32 bytes, what is beyond the patch is masked away. The vector
arithmetic is written in LLVM's own vectors, which exist on every processor; the loop over bytes that numba compiles
takes 6 to 15 times as long, since LLVM does not see that its bytes can be widened in registers.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils
from numba.extending import intrinsic

from ..kernels import device, inlined_device, parallel_kernel
from ._patch_kernels import stream

LANES = 32


def _rows_distance(
    typing_context: Any, a: Any, i: Any, a_step: Any, b: Any, j: Any, b_step: Any, count: Any, mask: Any
) -> Any:
    """Sum of squared differences, int32, of `count` rows of bytes where mask[:32] is 255.

    The rows start at bytes i, i + a_step, ... of a and j, j + b_step, ... of b. Lanes are added up once at the end.
    """
    signature = numba.types.int32(a, i, a_step, b, j, b_step, count, mask)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        narrow, middle, wide = (ir.VectorType(ir.IntType(bits), LANES) for bits in (8, 16, 32))

        def load(place: int, offset: Any) -> Any:
            array = context.make_array(signature.args[place])(context, builder, arguments[place])
            start = builder.bitcast(builder.gep(array.data, [offset]), narrow.as_pointer())
            return builder.load(start, align=1)

        kept = load(7, ir.Constant(ir.IntType(64), 0))
        variable: Any = cgutils.alloca_once_value
        total = variable(builder, ir.Constant(wide, None))
        with cgutils.for_range(builder, arguments[6]) as loop:
            a_start = builder.add(arguments[1], builder.mul(loop.index, arguments[2]))
            b_start = builder.add(arguments[4], builder.mul(loop.index, arguments[5]))
            first = builder.zext(builder.and_(load(0, a_start), kept), middle)
            second = builder.zext(builder.and_(load(3, b_start), kept), middle)
            difference = builder.sext(builder.sub(first, second), wide)
            builder.store(builder.add(builder.load(total), builder.mul(difference, difference)), total)
        insert: Any = cgutils.get_or_insert_function
        kind = ir.FunctionType(ir.IntType(32), [wide])
        add = insert(builder.module, kind, f"llvm.vector.reduce.add.v{LANES}i32")
        return builder.call(add, [builder.load(total)])

    return signature, generate


rows_distance: Any = intrinsic(_rows_distance)


@inlined_device
def third_distance(a: Any, i: int, a_row: int, b: Any, j: int, b_row: int, third: int, size: int, mask: Any) -> Any:
    """Squared distance, int32, of every third row, from row `third` on, of the patches at bytes i and j."""
    count = (size + 2 - third) // 3
    return rows_distance(a, i + third * a_row, 3 * a_row, b, j + third * b_row, 3 * b_row, count, mask)


@inlined_device
def shifted(state: Any) -> Any:
    """The next state of a stream of 64 random bits (xorshift)."""
    state ^= state << np.uint64(13)
    state ^= state >> np.uint64(7)
    return state ^ (state << np.uint64(17))


@device
def _between(bits: Any, low: int, high: int) -> Any:
    """An integer in [low, high) of 32 random bits."""
    return low + np.int64((np.uint64(bits) * np.uint64(high - low)) >> np.uint64(32))


@parallel_kernel
def first_matches(a: Any, a_row: int, b: Any, b_row: int, b_size: Any, size: int, mask: Any, seed: int, start: Any,
                  matches: Any, distances: Any) -> None:  # fmt: skip
    """Matches (h, w, 2) int32, column and row: those of `start` (h, w, 2), where negative at random, and distances."""
    height, width = distances.shape
    for y in numba.prange(height):
        state = stream(seed, 0, y, 0)
        for x in range(width):
            column, line = np.int64(start[y, x, 0]), np.int64(start[y, x, 1])
            if column < 0:
                state = shifted(state)
                column = _between(state & np.uint64(0xFFFFFFFF), 0, b_size[1])
                line = _between(state >> np.uint64(32), 0, b_size[0])
            matches[y, x, 0], matches[y, x, 1] = column, line
            distances[y, x] = rows_distance(
                a, y * a_row + 3 * x, a_row, b, line * b_row + 3 * column, b_row, size, mask
            )


@parallel_kernel
def match_once(a: Any, a_row: int, b: Any, b_row: int, b_size: Any, size: int, mask: Any, bands: Any, border: Any,
               iteration: int, seed: int, allowed: Any, matches: Any, distances: Any) -> None:  # fmt: skip
    """One iteration: bands of rows side by side, each along its scan order, backwards in even iterations.

    bands : (K + 1,) int64, first rows. border : (K, w, 2) int32, matches of the row before each band in its direction
    of scan as they were before the iteration. b_size : rows and columns of places for patches of b; allowed (rows,
    columns) uint8, places that may be matched.
    """
    for band in numba.prange(len(bands) - 1):
        _match_band(a, a_row, b, b_row, b_size, size, mask, bands[band], bands[band + 1], border[band], iteration, seed,
                    allowed, matches, distances)  # fmt: skip


@device
def _match_band(
    a: Any, a_row: int, b: Any, b_row: int, b_size: Any, size: int, mask: Any, low: int, high: int, border: Any,
    iteration: int, seed: int, allowed: Any, matches: Any, distances: Any,
) -> None:  # fmt: skip
    """The rows [low, high) of one iteration: the four neighbours' matches, then candidates at random (eq. 4)."""
    width = distances.shape[1]
    forwards = iteration % 2 == 1
    places, parts = np.empty((64, 2), np.int64), np.empty(64, np.int32)
    for row in range(high - low):
        y = low + row if forwards else high - 1 - row
        state = stream(seed, 0, y, iteration)
        for column in range(width):
            x = column if forwards else width - 1 - column
            here = y * a_row + 3 * x
            best, bx, by = distances[y, x], np.int64(matches[y, x, 0]), np.int64(matches[y, x, 1])
            count = _neighbours(x, y, low, high, border, forwards, b_size, matches, places)
            best, bx, by = _best_place(a, here, a_row, b, b_row, size, mask, places, parts, count, allowed, best, bx,
                                       by)  # fmt: skip
            count, reach = 0, max(b_size[0], b_size[1])
            while reach >= 1 and best > 0:
                state = shifted(state)
                left, right = max(bx - reach, 0), min(bx + reach + 1, b_size[1])
                top, bottom = max(by - reach, 0), min(by + reach + 1, b_size[0])
                places[count, 0] = _between(state & np.uint64(0xFFFFFFFF), left, right)
                places[count, 1] = _between(state >> np.uint64(32), top, bottom)
                count += 1
                reach >>= 1
            best, bx, by = _best_place(a, here, a_row, b, b_row, size, mask, places, parts, count, allowed, best, bx,
                                       by)  # fmt: skip
            distances[y, x] = best
            matches[y, x, 0], matches[y, x, 1] = bx, by


@inlined_device
def _neighbours(
    x: int, y: int, low: int, high: int, border: Any, forwards: bool, b_size: Any, matches: Any, places: Any
) -> int:
    """Writes what the four neighbours' matches are, moved by one, where it is another place in b; gives how many.

    The two neighbours that were not visited yet still have what the last iteration gave them.
    """
    count = 0
    bx, by = np.int64(matches[y, x, 0]), np.int64(matches[y, x, 1])
    for side in range(4):
        dx, dy = (1 if side == 0 else -1 if side == 1 else 0), (1 if side == 2 else -1 if side == 3 else 0)
        nx, ny = x - dx, y - dy
        if nx < 0 or nx >= matches.shape[1]:
            continue
        if low <= ny < high:
            cx, cy = np.int64(matches[ny, nx, 0]) + dx, np.int64(matches[ny, nx, 1]) + dy
        elif (ny < low) == forwards and border[nx, 0] >= 0:
            cx, cy = np.int64(border[nx, 0]) + dx, np.int64(border[nx, 1]) + dy
        else:
            continue
        places[count, 0], places[count, 1] = cx, cy
        count += 0 <= cx < b_size[1] and 0 <= cy < b_size[0] and (cx != bx or cy != by)
    return count


@inlined_device
def _best_place(
    a: Any, here: int, a_row: int, b: Any, b_row: int, size: int, mask: Any, places: Any, parts: Any, count: int,
    allowed: Any, best: Any, bx: int, by: int,
) -> Any:  # fmt: skip
    """The better of a match and the first `count` places (column, row).

    A third of the rows of all places is compared first, without a branch: the processor then fetches them side by
    side, and few need the others. `allowed` is looked up last, since it costs as much as an image's row.
    """
    for k in range(count):
        there = places[k, 1] * b_row + 3 * places[k, 0]
        parts[k] = third_distance(a, here, a_row, b, there, b_row, 0, size, mask)
    for k in range(count):
        if parts[k] < best:
            there = places[k, 1] * b_row + 3 * places[k, 0]
            rest = third_distance(a, here, a_row, b, there, b_row, 1, size, mask)
            rest += third_distance(a, here, a_row, b, there, b_row, 2, size, mask)
            error = np.int32(parts[k] + rest)
            if error < best and allowed[places[k, 1], places[k, 0]] != 0:
                best, bx, by = error, places[k, 0], places[k, 1]
    return best, bx, by


@parallel_kernel
def vote_flat(image: Any, matches: Any, weights: Any, size: int, out: Any) -> None:
    """out (H, W, 3) uint8 = mean over the patches that contain a pixel of what their matches in `image` show there.

    matches : (H - size + 1, W - size + 1, 2) int32. weights : of that shape, float32; a patch of 0 does not vote.
    """
    height, width = weights.shape
    row = 3 * image.shape[1]
    colors = image.reshape(-1)
    for y in numba.prange(len(out)):
        sums, totals = np.zeros(3 * out.shape[1], np.float32), np.zeros(out.shape[1], np.float32)
        for i in range(max(0, y - size + 1), min(height, y + 1)):
            for j in range(width):
                weight = weights[i, j]
                if weight > 0:
                    start = (matches[i, j, 1] + y - i) * row + 3 * matches[i, j, 0]
                    shown, to, over = (
                        colors[start : start + 3 * size],
                        sums[3 * j : 3 * (j + size)],
                        totals[j : j + size],
                    )
                    for k in range(3 * size):
                        to[k] += weight * np.float32(shown[k])
                    for k in range(size):
                        over[k] += weight
        for x in range(out.shape[1]):
            if totals[x] > 0:
                for c in range(3):
                    out[y, x, c] = np.uint8(sums[3 * x + c] / totals[x] + np.float32(0.5))
