"""Matching of two sets of feature vectors such that all of the one set are used about equally often."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from ..errors import require
from ..types import Float64, Int32

LEAF = 64  # sets of so many are matched exactly; the time grows with the third power

Ints = NDArray[np.intp]


def match_evenly(takers: Float64, lenders: Float64) -> Int32:
    """For each of K takers (K, C) one of the lenders (M, C) that is near, each used K / M times, rounded up or so.

    Both sets are halved along the direction in which they spread most, and again, until they are small enough for the
    best assignment: its cost grows with the cube of the size (30 s for 4,000). Equal sets are matched one to one.

    Returns
    -------
    (K,) int32, rows of `lenders`. Raises InputError if there is none.
    """
    require(len(lenders) > 0, "there is no wisp to take details from")
    matches = np.zeros(len(takers), np.int32)
    waiting: list[tuple[Ints, Ints]] = [(np.arange(len(takers)), np.arange(len(lenders)))]
    while waiting:
        some, others = waiting.pop()
        if len(some) == 0:
            continue
        if max(len(some), len(others)) <= LEAF or min(len(some), len(others)) == 1:
            matches[some] = others[_assign(takers[some], lenders[others])]
            continue
        axis = _widest_direction(np.concatenate([takers[some], lenders[others]]))
        some = some[np.argsort(takers[some] @ axis, kind="stable")]
        others = others[np.argsort(lenders[others] @ axis, kind="stable")]
        waiting += [(some[: len(some) // 2], others[: len(others) // 2])]
        waiting += [(some[len(some) // 2 :], others[len(others) // 2 :])]
    return matches


def _assign(takers: Float64, lenders: Float64) -> Ints:
    """(K,) the assignment of least squared distance in which no lender serves more than K / M, rounded up."""
    costs = cdist(takers, lenders, "sqeuclidean")
    if len(takers) == 1 or len(lenders) == 1:
        return np.asarray(costs.argmin(axis=1))
    repeats = -(-len(takers) // len(lenders))
    columns = linear_sum_assignment(np.tile(costs, (1, repeats)))[1]
    return np.asarray(columns % len(lenders))


def _widest_direction(points: Float64) -> Float64:
    """(C,) float64: the principal axis of points (n, C)."""
    return np.asarray(np.linalg.eigh(np.cov(points.T).reshape(points.shape[1], -1))[1][:, -1])
