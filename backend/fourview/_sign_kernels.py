"""Kernels of `signs`: signs along a spanning tree, and improving them by turning nodes and branches over."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..kernels import kernel


@kernel
def signs_of_tree(order: Any, parents: Any, parent_couplings: Any, signs: Any) -> None:
    """Each node gets the sign that satisfies the edge to its parent; order (N,) has parents before children."""
    for place in range(len(order)):
        node = order[place]
        if parents[node] >= 0:
            signs[node] = signs[parents[node]] if parent_couplings[node] >= 0 else -signs[parents[node]]


@kernel
def turn_nodes(offsets: Any, neighbours: Any, couplings: Any, root: int, signs: Any, most: int) -> int:
    """Iterated conditional modes: every node but the root takes the better sign, until none changes."""
    changes = 0
    for _ in range(most):
        before = changes
        for node in range(len(offsets) - 1):
            if node == root:
                continue
            pull = 0.0
            for k in range(offsets[node], offsets[node + 1]):
                pull += couplings[k] * signs[neighbours[k]]
            if pull * signs[node] < -1e-12:
                signs[node] = -signs[node]
                changes += 1
        if changes == before:
            break
    return changes


@kernel
def turn_branches(
    offsets: Any, neighbours: Any, couplings: Any, order: Any, parents: Any, depths: Any, signs: Any, most: int
) -> int:
    """Turn over the branch of the tree that lowers the energy most, until none does or `most` were turned.

    Turning a branch changes the edges that leave it only: the sum over its nodes' edges less twice its inner ones,
    which are counted where the paths of their two ends to the root meet.
    """
    count = len(order)
    leaving = np.zeros(count)
    for turned in range(most):
        leaving[:] = 0.0
        for node in range(count):
            for k in range(offsets[node], offsets[node + 1]):
                other = neighbours[k]
                term = couplings[k] * signs[node] * signs[other]
                leaving[node] += term
                if node < other:
                    a, b = node, other
                    while a != b:
                        if depths[a] >= depths[b]:
                            a = parents[a]
                        else:
                            b = parents[b]
                    leaving[a] -= 2.0 * term
        for place in range(count - 1, 0, -1):
            node = order[place]
            if parents[node] >= 0:
                leaving[parents[node]] += leaving[node]
        best = -1
        for node in range(count):
            if parents[node] >= 0 and leaving[node] < -1e-9 and (best < 0 or leaving[node] < leaving[best]):
                best = node
        if best < 0:
            return turned
        inside = np.zeros(count, np.bool_)
        inside[best] = True
        for place in range(count):
            node = order[place]
            if parents[node] >= 0 and inside[parents[node]]:
                inside[node] = True
            if inside[node]:
                signs[node] = -signs[node]
    return most
