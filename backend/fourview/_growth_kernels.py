"""Kernels of `growth`: lines of hair through a `HairSpace`, away from the scalp and back to it.

A line's work is its own, so results do not depend on the thread count. The arguments distances, directions, origin
and cell are HairSpace's; values is its 19 numbers at a place (see _space_kernels).
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ..kernels import device, parallel_kernel
from ..types import Float32, Float64, Floats, Int32
from ._space_kernels import DIRECTION, GRADIENTS, HEAD, N_VALUES, OUTER, SCALP, SHAPE, leave_head, sample_space

# why a line ended
TIP, CUT, LOST, ROOTED = 0, 1, 2, 3

_TURN = 0.35  # share of the line's own direction that is kept in a step of one cell
_STEEPEST = 1.2  # rise over run towards a line's layer
_EXIT = 0.8  # cosine to the border's normal above which hair leaves the shape there, and does not slide along it
_OVER_SCALP = 0.04  # metres from the scalp within which strands are led to their layers
_HELD = 0.02  # metres under the outer surface within which strands keep their depth when they hang free
_FREE = 0.004  # metres from the scalp from which a strand drawn anew may follow the field
_DRIFT = 0.008  # metres that a strand drawn anew along the field may come off its old course before it is led back
_OFF_HEAD = 1e-5  # metres more than its clearance that a point is moved off the head
_LIFT = 0.004  # metres after which a strand has turned from the scalp's normal into the field (1 / e)


@device
def _unit(vector: Float64) -> float:
    """Normalise vector (3,) in place; returns what its length was."""
    size = math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
    if size > 1e-12:
        for axis in range(3):
            vector[axis] /= size
    return size


@device
def _remove_along(vector: Float64, values: Float64, field: int, outward: bool) -> None:
    """Take from vector (3,) what of it runs up (outward) or down the gradient of a distance."""
    g = GRADIENTS + 3 * field
    square = values[g] * values[g] + values[g + 1] * values[g + 1] + values[g + 2] * values[g + 2]
    if square < 0.05:
        return
    along = vector[0] * values[g] + vector[1] * values[g + 1] + vector[2] * values[g + 2]
    if (along > 0.0) == outward:
        for axis in range(3):
            vector[axis] -= along * values[g + axis] / square


@device
def _to_layer(vector: Float64, values: Float64, wanted: float, reach: float) -> None:
    """Let vector (3,), unit, run along the layer `wanted` metres under the outer surface, or towards it."""
    g = GRADIENTS + 3 * OUTER
    size = math.sqrt(values[g] * values[g] + values[g + 1] * values[g + 1] + values[g + 2] * values[g + 2])
    if size < 0.4:
        return
    along = (vector[0] * values[g] + vector[1] * values[g + 1] + vector[2] * values[g + 2]) / size
    rise = min(max((wanted - values[OUTER]) / reach, -_STEEPEST), _STEEPEST)
    for axis in range(3):
        vector[axis] += (rise - along) * values[g + axis] / size
    _unit(vector)


@device
def _field_step(values: Float64, heading: Float64, keep: float, along: float, out: Float64) -> bool:
    """out (3,): the field's direction, smoothed by the line's heading; false where there is none.

    along : 1 or -1 takes the field's sense to be unknown, and that which goes with or against the heading; 0: known.
    """
    for axis in range(3):
        out[axis] = values[DIRECTION + axis]
    if _unit(out) < 0.05:
        return False
    if along * (out[0] * heading[0] + out[1] * heading[1] + out[2] * heading[2]) < 0.0:
        for axis in range(3):
            out[axis] = -out[axis]
    for axis in range(3):
        out[axis] += keep * heading[axis]
    return bool(_unit(out) > 1e-6)


@device
def _forward(
    start: Float64, normal: Float64, length: float, step: float, layer: float, upstream: float, clearance: float,
    rooted: bool, signed: bool, distances: Float32, directions: Float32, origin: Float64, cell: float, line: Float64,
) -> tuple[int, int]:  # fmt: skip
    """Fill line (K, 3) from start towards the tip; returns its points and why it ended.

    layer : 1 on the outer surface, 0 on the scalp: where among the hair the strand lies in the end. upstream : metres
    along the scalp from where the hair parts to the root. rooted : it starts on the scalp, along its normal. signed :
    the field's sense is trusted; otherwise it is what goes on from `normal`.
    """
    values, point, heading, vector = np.empty(N_VALUES), np.empty(3), np.empty(3), np.empty(3)
    for axis in range(3):
        point[axis], heading[axis], line[0, axis] = start[axis], normal[axis], start[axis]
    entered = not rooted
    count = 1
    sample_space(distances, directions, origin, cell, point[0], point[1], point[2], values)
    while count < len(line) and count * step <= length:
        arc = (count - 1) * step
        if values[SHAPE] <= 0.0:
            entered = True
        if not _field_step(values, heading, _TURN * min(1.0, cell / step), 0.0 if signed else 1.0, vector):
            return count, LOST
        if not entered:
            # between the scalp and the shape: straight to it
            for axis in range(3):
                vector[axis] += 0.5 * normal[axis] - 1.5 * values[GRADIENTS + 3 * SHAPE + axis]
            _unit(vector)
        elif layer >= 0.0:
            thick = values[OUTER] + max(values[SCALP], 0.0)
            wanted = values[OUTER]
            if values[SCALP] < _OVER_SCALP:
                # a scalp that grows hair everywhere: at x from the parting, what is rooted b from it lies 1 - b / x up
                over = min(layer, 1.0 - upstream / (upstream + arc + 1e-9))
                wanted = max((1.0 - over) * thick, 0.3 * cell)
            if values[SCALP] < _OVER_SCALP or values[OUTER] < _HELD:
                _to_layer(vector, values, wanted, 2.5 * cell)
        if rooted:
            lift = 1.2 * math.exp(-arc / _LIFT)
            for axis in range(3):
                vector[axis] += lift * normal[axis]
            _unit(vector)
        if entered and values[SHAPE] > -0.5 * cell:
            g = GRADIENTS + 3 * SHAPE
            along = vector[0] * values[g] + vector[1] * values[g + 1] + vector[2] * values[g + 2]
            if along < _EXIT or arc < 4.0 * step:
                _remove_along(vector, values, SHAPE, True)
                _unit(vector)
        if values[HEAD] < 2.0 * clearance:
            _remove_along(vector, values, HEAD, False)
            _unit(vector)
        for axis in range(3):
            heading[axis] = vector[axis]
            point[axis] += step * vector[axis]
        leave_head(point, clearance, _OFF_HEAD, distances, directions, origin, cell, values)
        if entered and values[SHAPE] > 0.35 * cell:
            return count, TIP
        line[count] = point
        count += 1
    return count, CUT


@device
def _head_back(values: Float64, signed: bool, heading: Float64) -> None:
    """heading (3,): against the field, or along its line to where the scalp is nearer."""
    g = GRADIENTS + 3 * SCALP
    away = 0.0
    for axis in range(3):
        away += values[DIRECTION + axis] * values[g + axis]
    sense = -1.0 if signed or away > 0.0 else 1.0
    for axis in range(3):
        heading[axis] = sense * values[DIRECTION + axis]
    _unit(heading)


@device
def _backward(
    start: Float64, length: float, step: float, over_scalp: float, clearance: float, signed: bool,
    distances: Float32, directions: Float32, origin: Float64, cell: float, line: Float64,
) -> tuple[int, int]:  # fmt: skip
    """Fill line (K, 3) from start back to the scalp; returns its points and why it ended.

    It follows the field back on its own layer until it has run `over_scalp` metres above the scalp, or the field turns
    against it (a parting, a crown) or the length is used up; then it goes down to the scalp.
    """
    values, point, heading, vector = np.empty(N_VALUES), np.empty(3), np.empty(3), np.empty(3)
    for axis in range(3):
        point[axis], line[0, axis] = start[axis], start[axis]
    sample_space(distances, directions, origin, cell, point[0], point[1], point[2], values)
    depth = values[OUTER]
    _head_back(values, signed, heading)
    descends, above, since = False, 0.0, 0.0
    count = 1
    while count < len(line):
        if values[SCALP] < 1.5 * step or (descends and values[SCALP] < 3.0 * clearance):
            return count, ROOTED
        g = GRADIENTS + 3 * SCALP
        found = _field_step(values, heading, 0.0, 0.0 if signed else -1.0, vector)
        turned = vector[0] * heading[0] + vector[1] * heading[1] + vector[2] * heading[2]
        if values[SCALP] < _OVER_SCALP:
            above += step
        if not found or turned > -0.25 or above > over_scalp or count * step > length:
            descends = True
        for axis in range(3):
            vector[axis] = -vector[axis] if not descends else heading[axis]
        if descends:
            since += step
            pull = min(0.25 + since / 0.03, 3.0)
            for axis in range(3):
                vector[axis] -= pull * values[g + axis]
        else:
            for axis in range(3):
                vector[axis] += _TURN * heading[axis]
        _unit(vector)
        if not descends:
            _to_layer(vector, values, depth, 2.5 * cell)
        if values[SHAPE] > -0.5 * cell and not (descends and values[SCALP] < 6.0 * cell):
            _remove_along(vector, values, SHAPE, True)
            _unit(vector)
        if values[HEAD] < 2.0 * clearance and values[SCALP] > 2.0 * step:
            _remove_along(vector, values, HEAD, False)
            _unit(vector)
        if descends and since > 0.25:
            return count, LOST
        for axis in range(3):
            heading[axis] = vector[axis]
            point[axis] += step * vector[axis]
        leave_head(point, clearance, _OFF_HEAD, distances, directions, origin, cell, values)
        line[count] = point
        count += 1
    return count, LOST


@parallel_kernel
def grow_forward(
    starts: Float64, normals: Float64, lengths: Float64, step: float, layers: Float64, upstream: Float64,
    clearance: float, rooted: bool, signed: bool, distances: Float32, directions: Float32, origin: Float64, cell: float,
    lines: Float64, counts: Int32, reasons: Int32,
) -> None:  # fmt: skip
    """lines (S, K, 3), counts (S,), reasons (S,): a line from each start (S, 3), see _forward."""
    for s in numba.prange(len(starts)):
        counts[s], reasons[s] = _forward(
            starts[s], normals[s], lengths[s], step, layers[s], upstream[s], clearance, rooted, signed, distances,
            directions, origin, cell, lines[s],
        )  # fmt: skip


@parallel_kernel
def grow_backward(
    starts: Float64, lengths: Float64, step: float, over_scalp: Float64, clearance: float, signed: bool,
    distances: Float32, directions: Float32, origin: Float64, cell: float, lines: Float64, counts: Int32,
    reasons: Int32,
) -> None:  # fmt: skip
    """lines (S, K, 3), counts (S,), reasons (S,): a line from each start (S, 3) to the scalp, see _backward."""
    for s in numba.prange(len(starts)):
        counts[s], reasons[s] = _backward(
            starts[s], lengths[s], step, over_scalp[s], clearance, signed, distances, directions, origin, cell, lines[s]
        )


@parallel_kernel
def respace_lines(lines: Float64, counts: Int32, out: Floats) -> None:
    """out (S, N, 3): N points at equal steps of arc length along the first counts (S,) points of lines (S, K, 3)."""
    for s in numba.prange(len(lines)):
        total = 0.0
        for i in range(counts[s] - 1):
            total += _gap(lines[s], i)
        i, passed = 0, 0.0
        gap = _gap(lines[s], 0) if counts[s] > 1 else 0.0
        for n in range(out.shape[1]):
            target = total * n / (out.shape[1] - 1)
            while i < counts[s] - 2 and passed + gap < target:
                passed += gap
                i += 1
                gap = _gap(lines[s], i)
            share = min(max((target - passed) / gap, 0.0), 1.0) if gap > 0.0 else 0.0
            after = min(i + 1, counts[s] - 1)
            for axis in range(3):
                out[s, n, axis] = lines[s, i, axis] + share * (lines[s, after, axis] - lines[s, i, axis])


@device
def _gap(line: Float64, i: int) -> float:
    x, y, z = line[i + 1, 0] - line[i, 0], line[i + 1, 1] - line[i, 1], line[i + 1, 2] - line[i, 2]
    return math.sqrt(x * x + y * y + z * z)


@parallel_kernel
def follow_field(
    points: Floats, weight: float, clearance: float, distances: Float32, directions: Float32, origin: Float64,
    cell: float,
) -> None:  # fmt: skip
    """Draw strands (S, N, 3) anew in place, each at its own depths under the surface but along the field.

    weight : share of the field in a strand's direction; its own is what remains, and all where the two disagree.
    """
    n_points = points.shape[1]
    for s in numba.prange(len(points)):
        values, point, vector = np.empty(N_VALUES), np.empty(3), np.empty(3)
        old = np.empty((n_points, 3))
        depth = np.empty(n_points)
        for i in range(n_points):
            for axis in range(3):
                old[i, axis] = points[s, i, axis]
            sample_space(distances, directions, origin, cell, old[i, 0], old[i, 1], old[i, 2], values)
            depth[i] = values[OUTER]
        for axis in range(3):
            point[axis] = old[0, axis]
        for i in range(n_points - 1):
            length = _gap(old, i)
            pieces = max(1, math.ceil(length / cell))
            for piece in range(pieces):
                sample_space(distances, directions, origin, cell, point[0], point[1], point[2], values)
                _blended_direction(old, i, length, weight, values, vector)
                _back_to_line(old, i, piece / pieces, point, vector)
                share = (piece + 1.0) / pieces
                wanted = depth[i] + share * (depth[i + 1] - depth[i])
                _to_layer(vector, values, wanted, 1.5 * cell)
                for axis in range(3):
                    point[axis] += length / pieces * vector[axis]
            leave_head(point, clearance, _OFF_HEAD, distances, directions, origin, cell, values)
            for axis in range(3):
                points[s, i + 1, axis] = point[axis]


@device
def _back_to_line(old: Float64, i: int, share: float, point: Float64, vector: Float64) -> None:
    """Turn vector (3,) back to the strand old (N, 3) where the point has come off it: it would lose a narrow tail."""
    square = 0.0
    for axis in range(3):
        square += (old[i, axis] + share * (old[i + 1, axis] - old[i, axis]) - point[axis]) ** 2
    off = math.sqrt(square)
    if off <= _DRIFT:
        return
    pull = min(off / _DRIFT - 1.0, 2.0) / off
    for axis in range(3):
        vector[axis] += pull * (old[i, axis] + share * (old[i + 1, axis] - old[i, axis]) - point[axis])
    _unit(vector)


@device
def _blended_direction(old: Float64, i: int, length: float, weight: float, values: Float64, vector: Float64) -> None:
    """vector (3,): the unit direction between segment i of old (N, 3) and the field's, at a place with these values."""
    size, agree = 0.0, 0.0
    for axis in range(3):
        size += values[DIRECTION + axis] ** 2
    scale = 1.0 / math.sqrt(size) if size > 1e-6 else 0.0
    for axis in range(3):
        vector[axis] = (old[i + 1, axis] - old[i, axis]) / max(length, 1e-9)
        agree += vector[axis] * values[DIRECTION + axis] * scale
    if agree < -0.3:
        # the sense may be wrong where the orientation is right
        scale, agree = -scale, -agree
    share = weight * min(max(2.0 * agree + 0.6, 0.0), 1.0)
    if values[SCALP] < _FREE:
        share *= max(values[SCALP], 0.0) / _FREE
    for axis in range(3):
        vector[axis] = (1.0 - share) * vector[axis] + share * scale * values[DIRECTION + axis]
    _unit(vector)
