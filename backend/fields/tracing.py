"""Strands as streamlines of a direction field (Wang et al. 2009, sec. 5.3; W-26)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..errors import require
from ..geometry.scalp_space import ScalpSpace
from ..types import Float32, Floats, Int32
from ._following_kernels import follow_strands
from ._tracing_kernels import trace_lines, trace_spaced
from .grid import DirectionGrid, elevation_table

MAX_STEPS = 1_000_000
_NO_TABLE = np.zeros(2)
_NO_HEIGHT = np.ones((2, 2), np.float32)


def trace(
    grid: DirectionGrid, roots: Float32, lengths: Floats, step: float = 0.02, *, n_points: int = 64
) -> tuple[Float32, Float32]:
    """Streamlines from the roots, as strands of `n_points` at equal steps of arc length.

    Euler's method on the trilinearly interpolated and normalised field. A strand ends at its length, or where the
    interpolated direction is 0 (none of the 8 cells around has one).

    Parameters
    ----------
    roots : (S, 3) float32, head space (the space of `origin` for a dense grid).
    lengths : (S,) where each strand ends, same unit. step : of Euler's method, same unit; the last one is shorter.

    Returns
    -------
    points (S, n_points, 3) float32, points[:, 0] are the roots; (S,) float32, the length that was reached.

    Raises
    ------
    InputError : shapes that do not fit, a negative length, a step that is not above 0.
    """
    longest = _check(roots, lengths, step)
    require(n_points >= 2, f"n_points is {n_points}; it must be 2 or more")
    points = np.empty((len(roots), n_points, 3), np.float32)
    reached = np.empty(len(roots), np.float32)
    starts = np.ascontiguousarray(roots, np.float32)
    trace_spaced(
        starts, np.asarray(lengths, np.float64), step, near_order(starts), *_arguments(grid, grid.space), longest,
        points, reached,
    )  # fmt: skip
    return points, reached


def trace_steps(grid: DirectionGrid, roots: Float32, lengths: Floats, step: float = 0.02) -> tuple[Float32, Int32]:
    """`trace`, but the Euler points themselves.

    Returns
    -------
    points (S, K, 3) float32, K for the longest strand, shorter ones repeat their last point; (S,) int32, how many
    points each strand has.
    """
    longest = _check(roots, lengths, step)
    points = np.empty((len(roots), longest, 3), np.float32)
    counts = np.empty(len(roots), np.int32)
    starts = np.ascontiguousarray(roots, np.float32)
    trace_lines(
        starts, np.asarray(lengths, np.float64), step, near_order(starts), *_arguments(grid, grid.space), points, counts
    )
    return points, counts


def follow(
    grid: DirectionGrid,
    strands: Float32,
    weights: Floats,
    step: float = 0.02,
    *,
    angle_limit: float = math.pi,
    space: ScalpSpace | None = None,
    clearance: float = 0.0,
    fill_gaps: bool = True,
) -> tuple[Float32, Int32]:
    """Redraw strands along the field, each from its root and with the lengths of its own segments.

    Euler's method, with steps that divide the strand's segments into equal parts, as close to `step` as that goes.
    The direction of a step is that of (1 - w) T + w v, T being the strand's own tangent at the same arc length and v
    the field's direction. w is the strand's weight, times the trust in the field: 1 while v is within `angle_limit`
    of T, from there falling with the cosine to 0 at twice the limit. Weight 1 and limit pi give the field's
    streamline, weight 0 the strand.

    Parameters
    ----------
    strands : (S, N, 3) float32, head space. weights : (S,) in [0, 1].
    angle_limit : radians.
    space : keep the strands out of this head: a point lower than `clearance` (head radii) over its scalp moves away
        from the centre, up to that height or to that of its own strand if that is lower. None: do not.
    fill_gaps : where the field is 0, go on in the strand's own shape; otherwise the strand ends there, and its N
        points are spaced over what there is.

    Returns
    -------
    points (S, N, 3) float32; (S,) int32, the points drawn before a strand ended, N for those that did not.
    """
    fits = strands.ndim == 3 and strands.shape[2] == 3 and strands.shape[1] >= 2
    require(fits, f"strands must have shape (S, N, 3) with N >= 2, not {strands.shape}")
    require(len(weights) == len(strands), f"{len(weights)} weights do not fit {len(strands)} strands")
    _check_step(step)
    own = np.ascontiguousarray(strands, np.float32)
    points = np.empty_like(own)
    counts = np.empty(len(own), np.int32)
    full, none = math.cos(angle_limit), math.cos(min(2.0 * angle_limit, math.pi))
    if angle_limit >= math.pi:
        full, none = -2.0, -3.0
    elif full - none < 1e-9:
        full = none + 1e-9
    above = -1.0 if space is None else float(space.height.max()) + clearance
    follow_strands(
        own, np.asarray(weights, np.float64), step, full, none, clearance if space is not None else -math.inf, above,
        fill_gaps, near_order(own[:, 0]), *_arguments(grid, space), points, counts,
    )  # fmt: skip
    return points, counts


def near_order(points: Floats) -> Int32:
    """(S,) int32: an order of points (S, 3) in which those after each other are close by."""
    if len(points) == 0:
        return np.empty(0, np.int32)
    low = points.min(axis=0)
    scale = 31.0 / np.maximum(points.max(axis=0) - low, 1e-30)
    key = np.zeros(len(points), np.uint16)
    for axis in range(3):
        key = (key << np.uint16(5)) | ((points[:, axis] - low[axis]) * scale[axis]).astype(np.uint16)
    return np.argsort(key, kind="stable").astype(np.int32)


def _arguments(grid: DirectionGrid, space: ScalpSpace | None) -> tuple[Any, ...]:
    """The grid as the kernels take it; `space` is the head to keep out of where the grid itself has none."""
    space = grid.space if grid.space is not None else space
    elevation, height = (elevation_table(space), space.height) if space is not None else (_NO_TABLE, _NO_HEIGHT)
    return (
        grid.space is not None, elevation, height, grid.origin, 1.0 / grid.spacing, grid.shape, grid.blocks,
        grid.directions.reshape(-1), grid.shift, grid.strides,
    )  # fmt: skip


def _check_step(step: float) -> None:
    require(math.isfinite(step) and step > 0, f"the step is {step}; it must be above 0")


def _check(roots: Float32, lengths: Floats, step: float) -> int:
    """Check the input and give the most points that a strand may need."""
    require(roots.ndim == 2 and roots.shape[1] == 3, f"roots must have shape (S, 3), not {roots.shape}")
    require(np.shape(lengths) == (len(roots),), f"lengths must have shape ({len(roots)},), not {np.shape(lengths)}")
    _check_step(step)
    if len(roots) == 0:
        return 1
    shortest, longest = float(np.min(lengths)), float(np.max(lengths))
    require(shortest >= 0 and math.isfinite(longest), "lengths must be finite and not negative")
    n_steps = longest / step
    require(n_steps <= MAX_STEPS, f"{n_steps:.0f} steps for the longest strand are too many; use a longer step")
    return math.ceil(n_steps - 1e-6) + 1
