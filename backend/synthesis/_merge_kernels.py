"""numba kernels that merge touching wisps, cheapest pair first. The layout of arrays is that of `_wisp_kernels`."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..kernels import device, kernel
from ..types import Float32, Float64, Int32
from ._wisp_kernels import drop_first, push, squared_distance


@device
def _holder(parent: Int32, wisp: int) -> int:
    """The wisp that holds `wisp` now; shortens the way for later calls."""
    while parent[wisp] != wisp:
        parent[wisp] = parent[parent[wisp]]
        wisp = parent[wisp]
    return wisp


@device
def _tidy_neighbours(wisp: int, parent: Int32, beside: Any, target: Int32, seen: Any, mark: int) -> int:
    """Leave each wisp that touches `wisp` once in its linked list; returns how many there are.

    seen[i] == mark says that wisp i has been met.
    """
    head, tail, after = beside
    degree = 0
    last = -1
    item = head[wisp]
    while item >= 0:
        other = _holder(parent, target[item])
        if other != wisp and seen[other] != mark:
            seen[other] = mark
            target[item] = other
            degree += 1
            if last >= 0:
                after[last] = item
            else:
                head[wisp] = item
            last = item
        item = after[item]
    if last >= 0:
        after[last] = -1
    else:
        head[wisp] = -1
    tail[wisp] = last
    return degree


@device
def _offer_pairs(
    wisp: int,
    all_pairs: bool,
    means: Float32,
    counts: Float64,
    changes: Any,
    beside: Any,
    target: Int32,
    queue: Any,
    size: int,
    n_entries: int,
) -> Any:
    """Queue the pairs of `wisp` (without all_pairs those with a higher number); returns the new size and n_entries.

    The cheapest pair leaves first: the cost is how much equation (3) rises when the two become one,
    |a| |b| / (|a| + |b|) L2(center a, center b) (Ward 1963).
    """
    head, _, after = beside
    heap, pairs, ages = queue
    cost = np.empty(1, np.float32)
    cost_bits = cost.view(np.uint32)
    item = head[wisp]
    while item >= 0:
        other = target[item]
        item = after[item]
        if not all_pairs and other < wisp:
            continue
        share = np.float32(counts[wisp] * counts[other] / (counts[wisp] + counts[other]))
        cost[0] = share * squared_distance(means[wisp], means[other])
        pairs[n_entries, 0] = wisp
        pairs[n_entries, 1] = other
        ages[n_entries] = changes[wisp] + changes[other]
        # the bits of floats that are not negative sort like the floats; of equal costs the first offered comes first
        size = push(heap, size, (np.uint64(cost_bits[0]) << np.uint64(32)) | np.uint64(n_entries))
        n_entries += 1
    return size, n_entries


@device
def _farthest_if_merged(
    points: Float32,
    rows: Int32,
    center: Float32,
    members: Int32,
    lists: Any,
    farthest: Int32,
    a: int,
    b: int,
    largest_error: float,
) -> int:
    """The strand of wisps a and b that is farthest from `center`, or -1 when one is beyond largest_error."""
    # what was farthest from its own center most likely still is: most pairs are refused here
    for wisp in (a, b):
        if squared_distance(points[rows[farthest[wisp]]], center) > largest_error:
            return -1
    head, _, after = lists
    far = -1
    most = np.float32(-1.0)
    for wisp in (a, b):
        item = head[wisp]
        while item >= 0:
            distance = squared_distance(points[rows[members[item]]], center)
            if distance > largest_error:
                return -1
            if distance > most:
                most = distance
                far = members[item]
            item = after[item]
    return far


@device
def _linked_lists(offsets: Int32) -> Any:
    """Compressed rows as linked lists: head and tail of each row and the item after each item, -1 for none, int32."""
    n_rows = offsets.shape[0] - 1
    head = np.empty(n_rows, np.int32)
    tail = np.empty(n_rows, np.int32)
    after = np.empty(offsets[n_rows], np.int32)
    for item in range(after.shape[0]):
        after[item] = item + 1
    for row in range(n_rows):
        if offsets[row + 1] == offsets[row]:
            head[row] = tail[row] = -1
        else:
            head[row], tail[row] = offsets[row], offsets[row + 1] - 1
            after[tail[row]] = -1
    return head, tail, after


@device
def _append_list(lists: Any, kept: int, gone: int) -> None:
    """Hang the list `gone` on the list `kept`; neither may be empty."""
    head, tail, after = lists
    after[tail[kept]] = head[gone]
    tail[kept] = tail[gone]


@device
def _with_room(queue: Any, needed: int) -> Any:
    """The queue with room for `needed` entries."""
    heap, pairs, ages = queue
    if needed <= heap.shape[0]:
        return queue
    count = heap.shape[0]
    larger_heap = np.empty(2 * needed, heap.dtype)
    larger_pairs = np.empty((2 * needed, 2), pairs.dtype)
    larger_ages = np.empty(2 * needed, ages.dtype)
    for entry in range(count):
        larger_heap[entry] = heap[entry]
        larger_pairs[entry, 0], larger_pairs[entry, 1] = pairs[entry, 0], pairs[entry, 1]
        larger_ages[entry] = ages[entry]
    return larger_heap, larger_pairs, larger_ages


@device
def _single_wisps(starts: Int32) -> Any:
    """Strands of each wisp, float64; itself as its parent, int32; -1 as what it has seen, int64.

    Loops, not array functions: with those this file takes numba 15 s to compile instead of 5.
    """
    n_wisps = starts.shape[0] - 1
    counts = np.empty(n_wisps, np.float64)
    parent = np.empty(n_wisps, np.int32)
    seen = np.empty(n_wisps, np.int64)
    for wisp in range(n_wisps):
        counts[wisp] = starts[wisp + 1] - starts[wisp]
        parent[wisp] = wisp
        seen[wisp] = -1
    return counts, parent, seen


@kernel
def merge_wisps(
    points: Float32,
    rows: Int32,
    centers: Float32,
    starts: Int32,
    members: Int32,
    farthest: Int32,
    offsets: Int32,
    neighbours: Int32,
    n_wanted: int,
    largest_error: float,
) -> Any:
    """Merge touching wisps, each time the pair that raises equation (3) least, until n_wanted are left.

    A pair may be merged if no strand is then farther (L2) than largest_error from the common mean; inf allows all.
    offsets and neighbours are the graph of wisps that touch. Returns the wisp that holds each wisp at the end,
    (k,) int32, one of the old numbers.
    """
    n_wisps = centers.shape[0]
    means = centers.copy()
    far = farthest.copy()
    counts, parent, seen = _single_wisps(starts)
    changes = np.zeros(n_wisps, np.int64)
    middle = np.empty(centers.shape[1], np.float32)
    target = neighbours.copy()
    # linked lists, so that those of two wisps are joined in one step
    beside = _linked_lists(offsets)
    strands = _linked_lists(starts)
    room = neighbours.shape[0] + 1
    queue = (np.empty(room, np.uint64), np.empty((room, 2), np.int32), np.empty(room, np.int64))
    size = n_entries = 0
    for wisp in range(n_wisps):
        size, n_entries = _offer_pairs(wisp, False, means, counts, changes, beside, target, queue, size, n_entries)
    left = n_wisps
    while left > n_wanted and size > 0:
        entry = np.int64(queue[0][0] & np.uint64(0xFFFFFFFF))
        size = drop_first(queue[0], size)
        kept = min(queue[1][entry, 0], queue[1][entry, 1])
        gone = max(queue[1][entry, 0], queue[1][entry, 1])
        # changes only grow: an equal sum says that neither wisp has changed since the pair was offered
        if changes[kept] + changes[gone] != queue[2][entry]:
            continue
        share = np.float32(counts[gone] / (counts[kept] + counts[gone]))
        for i in range(middle.shape[0]):
            middle[i] = means[kept, i] + share * (means[gone, i] - means[kept, i])
        if largest_error < np.inf:
            strand = _farthest_if_merged(points, rows, middle, members, strands, far, kept, gone, largest_error)
            if strand < 0:
                continue
            far[kept] = strand
        for i in range(middle.shape[0]):
            means[kept, i] = middle[i]
        counts[kept] += counts[gone]
        parent[gone] = kept
        changes[kept] += 1
        changes[gone] += 1
        _append_list(strands, kept, gone)
        _append_list(beside, kept, gone)
        left -= 1
        degree = _tidy_neighbours(kept, parent, beside, target, seen, left)
        queue = _with_room(queue, n_entries + degree)
        size, n_entries = _offer_pairs(kept, True, means, counts, changes, beside, target, queue, size, n_entries)
    for wisp in range(n_wisps):
        parent[wisp] = _holder(parent, wisp)
    return parent
