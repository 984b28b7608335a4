"""Kernel of `remeshing`: clusters of even size by swaps along their borders (M-33)."""

from __future__ import annotations

import numpy as np

from ..kernels import device, kernel
from ..types import Float64, Floats, Int32


@device
def _energy(rho: float, x: float, y: float, z: float) -> float:
    """-|sum rho g|^2 / sum rho: what a cluster adds to the energy, but for what no swap can change."""
    if rho <= 0.0:
        return 0.0
    return -(x * x + y * y + z * z) / rho


@device
def _move(sums: Float64, counts: Int32, labels: Int32, item: int, target: int, weight: float, point: Floats) -> None:
    source = labels[item]
    sums[source, 0] -= weight
    sums[target, 0] += weight
    for axis in range(3):
        sums[source, 1 + axis] -= weight * point[axis]
        sums[target, 1 + axis] += weight * point[axis]
    counts[source] -= 1
    counts[target] += 1
    labels[item] = target


@kernel
def relax_clusters(
    points: Floats,
    weights: Floats,
    edges: Int32,
    labels: Int32,
    sums: Float64,
    counts: Int32,
    changed: Int32,
    max_sweeps: int,
) -> int:
    """Sweep over the edges (E, 2) and move items between clusters while that lowers the energy; returns the sweeps.

    points : (n, 3) around the origin. weights : (n,). Changed in place: labels (n,), sums (k, 4: weight, weighted
    point) and counts (k,) of the clusters, and the sweep in which each last changed (k,), at first 0, or -1 for a
    cluster at rest. An edge between clusters that rest since the last sweep is passed over.
    """
    for sweep in range(1, max_sweeps + 1):
        n_moves = 0
        for edge in range(len(edges)):
            i, j = edges[edge, 0], edges[edge, 1]
            a, b = labels[i], labels[j]
            if a == b or (changed[a] < sweep - 1 and changed[b] < sweep - 1):
                continue
            wi, wj = np.float64(weights[i]), np.float64(weights[j])
            pi, pj = points[i], points[j]
            sa, sb = sums[a], sums[b]
            best = _energy(sa[0], sa[1], sa[2], sa[3]) + _energy(sb[0], sb[1], sb[2], sb[3])
            best -= 1e-12 * abs(best)
            choice = 0
            if counts[a] > 1:
                x, y, z = wi * pi[0], wi * pi[1], wi * pi[2]
                moved = _energy(sa[0] - wi, sa[1] - x, sa[2] - y, sa[3] - z) + _energy(
                    sb[0] + wi, sb[1] + x, sb[2] + y, sb[3] + z
                )
                if moved < best:
                    best, choice = moved, 1
            if counts[b] > 1:
                x, y, z = wj * pj[0], wj * pj[1], wj * pj[2]
                moved = _energy(sa[0] + wj, sa[1] + x, sa[2] + y, sa[3] + z) + _energy(
                    sb[0] - wj, sb[1] - x, sb[2] - y, sb[3] - z
                )
                if moved < best:
                    best, choice = moved, 2
            if choice == 0:
                continue
            if choice == 1:
                _move(sums, counts, labels, i, b, wi, pi)
            else:
                _move(sums, counts, labels, j, a, wj, pj)
            changed[a] = sweep
            changed[b] = sweep
            n_moves += 1
        if n_moves == 0:
            return sweep
    return max_sweeps


@kernel
def label_parts(edges: Int32, labels: Int32, parts: Int32) -> None:
    """The connected parts of the clusters: `parts` (n,) becomes the smallest item of the part that each item is in."""
    for item in range(len(parts)):
        parts[item] = item
    for edge in range(len(edges)):
        i, j = edges[edge, 0], edges[edge, 1]
        if labels[i] != labels[j]:
            continue
        while parts[i] != i:
            parts[i] = parts[parts[i]]
            i = parts[i]
        while parts[j] != j:
            parts[j] = parts[parts[j]]
            j = parts[j]
        if i < j:
            parts[j] = i
        elif j < i:
            parts[i] = j
    for item in range(len(parts)):
        root = item
        while parts[root] != root:
            root = parts[root]
        parts[item] = root


@kernel
def grow_labels(edges: Int32, labels: Int32) -> int:
    """Items without a cluster (-1) join that of a neighbour; returns how many joined."""
    joined = 0
    for edge in range(len(edges)):
        i, j = edges[edge, 0], edges[edge, 1]
        if labels[i] < 0 <= labels[j]:
            labels[i] = labels[j]
            joined += 1
        elif labels[j] < 0 <= labels[i]:
            labels[j] = labels[i]
            joined += 1
    return joined
