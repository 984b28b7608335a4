"""Outlines of regions in pictures, and matching two of them point by point in order (M-32)."""

from __future__ import annotations

import cv2
import numpy as np

from ..types import Bools, Float64, Int64
from ._contour_kernels import cyclic_costs, cyclic_path

# Weights of the matching: points 10 % of the picture's diagonal apart cost as much as normals 90 degrees apart.
_DISTANCE = 0.1
_STANDSTILL = 0.05
_START_STEP = 8  # points between the starts that are tried
_START_REACH = 0.15  # of the outline's points, on both sides of the nearest


def outline(region: Bools) -> Float64:
    """(n, 2) float64, pixels: the outer outline of the largest part of a region, through its border pixels.

    Clockwise as the picture is seen. Empty (0, 2) for an empty region.
    """
    found, _ = cv2.findContours(region.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not found:
        return np.empty((0, 2))
    largest = max(found, key=cv2.contourArea).reshape(-1, 2) + 0.5
    after = np.roll(largest, -1, axis=0)
    area = (largest[:, 0] * after[:, 1] - largest[:, 1] * after[:, 0]).sum()
    return np.asarray(largest if area >= 0 else largest[::-1], np.float64)


def resample_closed(curve: Float64, count: int) -> Float64:
    """(count, 2) points at equal steps along a closed curve (n, 2), beginning with its first point."""
    closed = np.concatenate([curve, curve[:1]])
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    wanted = np.arange(count) * (reached[-1] / count)
    return np.stack([np.interp(wanted, reached, closed[:, axis]) for axis in range(2)], axis=1)


def outward_normals(curve: Float64, reach: int = 3) -> Float64:
    """(n, 2) unit normals of a closed curve (n, 2) that runs clockwise in the picture, over `reach` points each way."""
    along = np.roll(curve, -reach, axis=0) - np.roll(curve, reach, axis=0)
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12))


def match_outlines(source: Float64, target: Float64, diagonal: float) -> Float64:
    """Where each point of `source` belongs on `target`, keeping the order around both (M-32).

    Dynamic programming over pairs of points; a pair costs its distance squared and the angle between its normals.

    Parameters
    ----------
    source, target : (n, 2) and (m, 2) float64, pixels, closed, evenly spaced, both clockwise (`outline`).
    diagonal : pixels, the scale of distances.

    Returns
    -------
    (n, 2) float64, pixels: for each point the middle of those it is matched with.
    """
    cost = matching_cost(source, target, diagonal)
    count = len(target)
    nearest = int(np.argmin(((target - source[0]) ** 2).sum(axis=1)))
    reach = max(int(_START_REACH * count), _START_STEP)
    starts = (nearest + np.arange(-reach, reach + 1, _START_STEP)) % count
    best = _best_start(cost, starts.astype(np.int64))
    around = (best + np.arange(-_START_STEP + 1, _START_STEP, 2)) % count
    best = _best_start(cost, around.astype(np.int64))
    first, last = np.empty(len(source), np.int64), np.empty(len(source), np.int64)
    cyclic_path(cost, best, _STANDSTILL, first, last)
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(np.concatenate([target] * 3), axis=0)])
    return np.asarray((sums[last + 1] - sums[first]) / (last + 1 - first)[:, None])


def matching_cost(source: Float64, target: Float64, diagonal: float) -> Float64:
    """(n, m) float64: what pairing each point of one outline with each of the other costs."""
    apart = ((source[:, None] - target[None]) ** 2).sum(axis=-1) / (_DISTANCE * diagonal) ** 2
    return np.asarray(apart + (1.0 - outward_normals(source) @ outward_normals(target).T))


def _best_start(cost: Float64, starts: Int64) -> int:
    totals = np.empty(len(starts))
    cyclic_costs(cost, starts, _STANDSTILL, totals)
    return int(starts[np.argmin(totals)])
