"""numba kernels of wisp clustering (Wang et al. 2009, sec. 4).

Strands are rows of D = 3 N float32 coordinates in their root frames. The neighbourhood is a graph in compressed rows:
the neighbours of strand s are neighbours[offsets[s]:offsets[s + 1]]. Members of wisp i are
members[starts[i]:starts[i + 1]], in rising order.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from ..kernels import device, kernel, parallel_kernel, summing_device
from ..types import Bools, Float32, Float64, Int32

_ARITY = 4  # children of a heap node: four 8-byte keys share a cache line


@summing_device
def _l2(a: Float32, b: Float32) -> Any:
    """Squared distance of two rows (W-8)."""
    total = np.float32(0.0)
    for j in range(a.shape[0]):
        difference = a[j] - b[j]
        total += difference * difference
    return total


@device
def _push(heap: Any, size: int, key: Any) -> int:
    """Add a key to the min-heap heap[:size]; returns the new size."""
    hole = size
    while hole > 0:
        parent = (hole - 1) // _ARITY
        if heap[parent] <= key:
            break
        heap[hole] = heap[parent]
        hole = parent
    heap[hole] = key
    return size + 1


@device
def _drop_first(heap: Any, size: int) -> int:
    """Remove the least key, heap[0], from the min-heap heap[:size]; returns the new size."""
    size -= 1
    key = heap[size]
    hole = 0
    while True:
        child = _ARITY * hole + 1
        if child >= size:
            break
        least = child
        for other in range(child + 1, min(child + _ARITY, size)):
            if heap[other] < heap[least]:
                least = other
        if key <= heap[least]:
            break
        heap[hole] = heap[least]
        hole = least
    heap[hole] = key
    return size


@kernel
def grow_wisps(
    points: Float32,
    centers: Float32,
    seeds: Int32,
    offsets: Int32,
    neighbours: Int32,
    old_labels: Int32,
    old_distances: Float32,
    active: Bools,
) -> Any:
    """Partition by region growing from the seeds with one global priority queue (W-11).

    Only wisps with active[i] are grown anew, over the strands that they held; old_labels is -1 everywhere at the first
    partition. old_distances must be L2 to centers[old_labels], so that these are not computed again. Entries of equal
    distance leave the queue in the order in which they came. Each pair (strand, label) is evaluated once at most.

    Returns labels (S,) int32, distances (S,) float32 to centers[labels], and the number of evaluated distances.
    """
    n_strands = points.shape[0]
    labels = old_labels.copy()
    distances = old_distances.copy()
    for strand in range(n_strands):
        if labels[strand] >= 0 and active[labels[strand]]:
            labels[strand] = -1
    capacity = neighbours.shape[0]
    heap = np.empty(capacity, np.uint64)
    entry_strand = np.empty(capacity, np.int32)
    entry_label = np.empty(capacity, np.int32)
    entry_distance = np.empty(capacity, np.float32)
    entry_bits = entry_distance.view(np.uint32)
    entry_before = np.empty(capacity, np.int32)  # the earlier entry of the same strand, or -1
    last_entry = np.full(n_strands, -1, np.int32)
    n_entries = 0
    size = 0
    evaluations = 0
    for label in range(seeds.shape[0]):
        if active[label]:
            labels[seeds[label]] = label
    next_seed = 0
    while True:
        if next_seed < seeds.shape[0]:
            label = next_seed
            next_seed += 1
            if not active[label]:
                continue
            strand = seeds[label]
            if old_labels[strand] != label:
                distances[strand] = _l2(points[strand], centers[label])
                evaluations += 1
        else:
            if size == 0:
                break
            entry = np.int64(heap[0] & np.uint64(0xFFFFFFFF))
            size = _drop_first(heap, size)
            strand = entry_strand[entry]
            if labels[strand] >= 0:
                continue
            label = entry_label[entry]
            labels[strand] = label
            distances[strand] = entry_distance[entry]
        for k in range(offsets[strand], offsets[strand + 1]):
            other = neighbours[k]
            if labels[other] >= 0:
                continue
            entry = last_entry[other]
            while entry >= 0 and entry_label[entry] != label:
                entry = entry_before[entry]
            if entry >= 0:
                continue
            if old_labels[other] == label:
                distance = old_distances[other]
            else:
                distance = _l2(points[other], centers[label])
                evaluations += 1
            entry_strand[n_entries] = other
            entry_label[n_entries] = label
            entry_distance[n_entries] = distance
            entry_before[n_entries] = last_entry[other]
            last_entry[other] = n_entries
            # the bits of a positive float sort like the float; the entry's number makes the order of ties first in, first out
            key = (np.uint64(entry_bits[n_entries]) << np.uint64(32)) | np.uint64(n_entries)
            size = _push(heap, size, key)
            n_entries += 1
    return labels, distances, evaluations


@kernel
def list_members(labels: Int32, n_wisps: int) -> Any:
    """Members of every wisp: starts (k + 1,) int32 and members (S,) int32, in rising order within a wisp."""
    starts = np.zeros(n_wisps + 1, np.int32)
    for label in labels:
        starts[label + 1] += 1
    for i in range(n_wisps):
        starts[i + 1] += starts[i]
    fill = starts[:-1].copy()
    members = np.empty(labels.shape[0], np.int32)
    for strand in range(labels.shape[0]):
        label = labels[strand]
        members[fill[label]] = strand
        fill[label] += 1
    return starts, members


@parallel_kernel
def fit_wisps(
    points: Float32,
    starts: Int32,
    members: Int32,
    refit: Bools,
    centers: Float32,
    distances: Float32,
    seeds: Int32,
    farthest: Int32,
    energies: Float64,
) -> None:
    """For each wisp with refit[i], write into the last five arrays: mean, L2 of its strands to it, nearest, farthest, sum.

    The center is the mean strand (W-12), the seed the strand nearest to it (W-11), energies[i] the wisp's share of
    equation (3). Of equally near or far strands the first counts. Sums are float64, in the order of the members.
    """
    n_coordinates = points.shape[1]
    for i in numba.prange(refit.shape[0]):
        if not refit[i]:
            continue
        first = starts[i]
        last = starts[i + 1]
        sums = np.zeros(n_coordinates, np.float64)
        for m in range(first, last):
            row = points[members[m]]
            for j in range(n_coordinates):
                sums[j] += row[j]
        share = 1.0 / (last - first)
        for j in range(n_coordinates):
            centers[i, j] = sums[j] * share
        energy = 0.0
        nearest = members[first]
        far = members[first]
        least = np.float32(np.inf)
        most = np.float32(-1.0)
        for m in range(first, last):
            strand = members[m]
            distance = _l2(points[strand], centers[i])
            distances[strand] = distance
            energy += distance
            if distance < least:
                least = distance
                nearest = strand
            if distance > most:
                most = distance
                far = strand
        seeds[i] = nearest
        farthest[i] = far
        energies[i] = energy


@kernel
def wisps_beside(labels: Int32, marked: Bools, offsets: Int32, neighbours: Int32) -> Any:
    """The marked wisps and all wisps that touch one of them, (k,) bool."""
    result = marked.copy()
    for strand in range(labels.shape[0]):
        if marked[labels[strand]]:
            for k in range(offsets[strand], offsets[strand + 1]):
                result[labels[neighbours[k]]] = True
    return result


@parallel_kernel
def pick_split_seeds(
    points: Float32,
    starts: Int32,
    members: Int32,
    wisps: Int32,
    farthest: Int32,
    distances: Float32,
    spacing: float,
    picked: Int32,
) -> None:
    """Choose the seeds of new wisps in each of `wisps` by farthest points: picked (V, M) int32, -1 where there are fewer.

    The first is the wisp's farthest strand (W-14). More follow while a strand is farther than `spacing` (L2) from the
    center and from all seeds picked before.
    """
    most_picked = picked.shape[1]
    for v in numba.prange(wisps.shape[0]):
        wisp = wisps[v]
        first = starts[wisp]
        count = starts[wisp + 1] - first
        picked[v, :] = -1
        picked[v, 0] = farthest[wisp]
        gaps = np.empty(count, np.float32)
        for m in range(count):
            gaps[m] = distances[members[first + m]]
        for p in range(1, most_picked):
            seed = points[picked[v, p - 1]]
            far = 0
            for m in range(count):
                # a strand that is near enough already cannot become a seed
                if gaps[m] > spacing:
                    gaps[m] = min(gaps[m], _l2(points[members[first + m]], seed))
                if gaps[m] > gaps[far]:
                    far = m
            if gaps[far] <= spacing:
                break
            picked[v, p] = members[first + far]
