"""numba kernels of wisp clustering (Wang et al. 2009, sec. 4).

Strand s is points[rows[s]], D = 3 N float32 coordinates in its root frame: strands are numbered along the scalp,
without a copy of them in that order. The neighbourhood is a graph in compressed rows: the neighbours of strand s are
neighbours[offsets[s]:offsets[s + 1]]. Members of wisp i are members[starts[i]:starts[i + 1]], in rising order.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from ..kernels import device, kernel, parallel_kernel, summing_device
from ..types import Bools, Float32, Float64, Int32

_ARITY = 4  # children of a heap node: four 8-byte keys share a cache line


@summing_device
def squared_distance(a: Float32, b: Float32) -> Any:
    """Squared distance of two rows (W-8)."""
    total = np.float32(0.0)
    for j in range(a.shape[0]):
        difference = a[j] - b[j]
        total += difference * difference
    return total


@device
def push(heap: Any, size: int, key: Any) -> int:
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
def drop_first(heap: Any, size: int) -> int:
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


@device
def _offer_neighbours(
    strand: int,
    label: int,
    points: Float32,
    rows: Int32,
    centers: Float32,
    graph: Any,
    labels: Int32,
    old: Any,
    queue: Any,
    size: int,
    n_entries: int,
) -> Any:
    """Queue the unlabelled neighbours of `strand` for `label`; returns size, n_entries and the distances evaluated."""
    offsets, neighbours = graph
    old_labels, old_distances = old
    heap, entry_strand, entry_label, entry_distance, entry_bits, entry_before, last_entry = queue
    evaluated = 0
    for k in range(offsets[strand], offsets[strand + 1]):
        other = neighbours[k]
        if labels[other] >= 0:
            continue
        entry = last_entry[other]
        while entry >= 0 and entry_label[entry] != label:
            entry = entry_before[entry]
        if entry >= 0:
            continue  # offered to this wisp already
        if old_labels[other] == label:
            entry_distance[n_entries] = old_distances[other]
        else:
            entry_distance[n_entries] = squared_distance(points[rows[other]], centers[label])
            evaluated += 1
        entry_strand[n_entries] = other
        entry_label[n_entries] = label
        entry_before[n_entries] = last_entry[other]
        last_entry[other] = n_entries
        # the bits of floats that are not negative sort like the floats; of equal ones the first that came leaves first
        size = push(heap, size, (np.uint64(entry_bits[n_entries]) << np.uint64(32)) | np.uint64(n_entries))
        n_entries += 1
    return size, n_entries, evaluated


@kernel
def grow_wisps(
    points: Float32,
    rows: Int32,
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
    labels = old_labels.copy()
    distances = old_distances.copy()
    for strand in range(labels.shape[0]):
        if labels[strand] >= 0 and active[labels[strand]]:
            labels[strand] = -1
    capacity = neighbours.shape[0]  # a strand is offered by each of its neighbours once at most
    heap = np.empty(capacity, np.uint64)
    entry_strand = np.empty(capacity, np.int32)
    entry_label = np.empty(capacity, np.int32)
    entry_distance = np.empty(capacity, np.float32)
    entry_before = np.empty(capacity, np.int32)  # the earlier entry of the same strand, or -1
    last_entry = np.full(labels.shape[0], -1, np.int32)
    entry_bits = entry_distance.view(np.uint32)
    queue = (heap, entry_strand, entry_label, entry_distance, entry_bits, entry_before, last_entry)
    graph = (offsets, neighbours)
    old = (old_labels, old_distances)
    size = 0
    n_entries = 0
    evaluated = 0
    for label in range(seeds.shape[0]):
        if active[label]:
            labels[seeds[label]] = label
    next_seed = 0
    while next_seed < seeds.shape[0] or size > 0:
        if next_seed < seeds.shape[0]:
            label = next_seed
            strand = seeds[label]
            next_seed += 1
            if not active[label]:
                continue
            if old_labels[strand] != label:
                distances[strand] = squared_distance(points[rows[strand]], centers[label])
                evaluated += 1
        else:
            entry = np.int64(heap[0] & np.uint64(0xFFFFFFFF))
            size = drop_first(heap, size)
            label = entry_label[entry]
            strand = entry_strand[entry]
            if labels[strand] >= 0:
                continue
            labels[strand] = label
            distances[strand] = entry_distance[entry]
        size, n_entries, new = _offer_neighbours(
            strand, label, points, rows, centers, graph, labels, old, queue, size, n_entries
        )
        evaluated += new
    return labels, distances, evaluated


@parallel_kernel
def fit_wisps(
    points: Float32,
    rows: Int32,
    starts: Int32,
    members: Int32,
    refit: Bools,
    centers: Float32,
    distances: Float32,
    seeds: Int32,
    farthest: Int32,
    energies: Float64,
) -> None:
    """Fit each wisp with refit[i] to its strands: write its entries of the last five arrays.

    The center is the mean strand (W-12), `distances` L2 of the strands to it, the seed the strand nearest to it (W-11),
    energies[i] the wisp's share of equation (3). Of equally near strands the first counts, of equally far ones the
    last, so that of two strands or more none is both. Sums are float64, in the order of the members.
    """
    n_coordinates = points.shape[1]
    for i in numba.prange(refit.shape[0]):
        if not refit[i]:
            continue
        first = starts[i]
        last = starts[i + 1]
        sums = np.zeros(n_coordinates, np.float64)
        for m in range(first, last):
            row = points[rows[members[m]]]
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
            distance = squared_distance(points[rows[strand]], centers[i])
            distances[strand] = distance
            energy += distance
            if distance < least:
                least = distance
                nearest = strand
            if distance >= most:
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
    rows: Int32,
    starts: Int32,
    members: Int32,
    wisps: Int32,
    seeds: Int32,
    farthest: Int32,
    distances: Float32,
    spacing: float,
    picked: Int32,
) -> None:
    """Choose the seeds of new wisps in each of `wisps` by farthest points: picked (V, M) int32, -1 for none.

    The first is the wisp's farthest strand (W-14). More follow while a strand other than the wisp's own seed is farther
    than `spacing` (L2) from the center and from all seeds picked before.
    """
    for v in numba.prange(wisps.shape[0]):
        first = starts[wisps[v]]
        count = starts[wisps[v] + 1] - first
        picked[v, :] = -1
        picked[v, 0] = farthest[wisps[v]]
        gaps = np.empty(count, np.float32)
        for m in range(count):
            gaps[m] = 0.0 if members[first + m] == seeds[wisps[v]] else distances[members[first + m]]
        for p in range(1, picked.shape[1]):
            seed = points[rows[picked[v, p - 1]]]
            far = 0
            for m in range(count):
                # a strand that is near enough already cannot become a seed
                if gaps[m] > spacing:
                    gaps[m] = min(gaps[m], squared_distance(points[rows[members[first + m]]], seed))
                if gaps[m] > gaps[far]:
                    far = m
            if gaps[far] <= spacing:
                break
            picked[v, p] = members[first + far]
