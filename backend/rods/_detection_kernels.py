"""Numba functions of `detection`: signed distances of moving solids, and pairs of near segments of strands (B-26)."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from ..geometry._collider_kernels import sample_distance, sample_gradient
from ..kernels import device, parallel_kernel
from ..types import Float32, Float64, Int32, Int64

_END = 1.0 - 1e-9  # of a segment


@parallel_kernel
def probe_solid(
    distance: Float32,
    origin: Float64,
    cell: float,
    inverse: Float64,
    points: Float64,
    moves: Float64,
    limits: Float64,
    gaps: Float64,
    normals: Float64,
    reached: NDArray[np.bool_],
) -> None:
    """reached (n,): points (n, 3) that are nearer to a solid than limits (n,), or that moves (n, 3) bring there.

    gaps (n,): distances now, a lower bound of what is out of reach. normals (n, 3), world, 1 long.
    distance, origin, cell: the solid's grid in its own space; inverse (4, 4): world to there, rigid. Outside the grid
    the distance is that from what is nearest to the point's nearest place in the grid, or more than the limit.
    """
    for i in numba.prange(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        ax = inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2] * z + inverse[0, 3]
        ay = inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2] * z + inverse[1, 3]
        az = inverse[2, 0] * x + inverse[2, 1] * y + inverse[2, 2] * z + inverse[2, 3]
        # a little within, so that rounding does not leave the grid
        last = (distance.shape[0] - 1.0 - 1e-9) * cell, (distance.shape[1] - 1.0 - 1e-9) * cell
        bx = min(max(ax, origin[0] + 1e-9 * cell), origin[0] + last[0])
        by = min(max(ay, origin[1] + 1e-9 * cell), origin[1] + last[1])
        bz = min(max(az, origin[2] + 1e-9 * cell), origin[2] + (distance.shape[2] - 1.0 - 1e-9) * cell)
        ox, oy, oz = ax - bx, ay - by, az - bz
        outside = math.sqrt(ox * ox + oy * oy + oz * oz)
        gaps[i] = outside if outside > 0.0 else sample_distance(distance, origin, cell, ax, ay, az)
        reached[i] = False
        mx, my, mz = moves[i, 0], moves[i, 1], moves[i, 2]
        if not gaps[i] - math.sqrt(mx * mx + my * my + mz * mz) < limits[i]:
            continue
        gx, gy, gz = sample_gradient(distance, origin, cell, bx, by, bz)
        size = math.sqrt(gx * gx + gy * gy + gz * gz)
        if size < 1e-3:  # in the middle of a solid no way is out
            gaps[i] = math.inf
            continue
        gx, gy, gz = gx / size, gy / size, gz / size
        if outside > 0.0:
            near = sample_distance(distance, origin, cell, bx, by, bz)
            gx, gy, gz = ox + near * gx, oy + near * gy, oz + near * gz
            size = max(math.sqrt(gx * gx + gy * gy + gz * gz), 1e-12)
            gaps[i] = size
            gx, gy, gz = gx / size, gy / size, gz / size
        for j in range(3):
            normals[i, j] = inverse[0, j] * gx + inverse[1, j] * gy + inverse[2, j] * gz
        # what leaves may be held back by other contacts
        closing = min(normals[i, 0] * mx + normals[i, 1] * my + normals[i, 2] * mz, 0.0)
        reached[i] = gaps[i] + closing < limits[i]


@device
def segment_places(points: Float64, a: int, b: int) -> Any:
    """(s, t, squared distance): where segments a - 1, a and b - 1, b are nearest, 0 to 1 from their first ends."""
    ux, uy, uz = points[a, 0] - points[a - 1, 0], points[a, 1] - points[a - 1, 1], points[a, 2] - points[a - 1, 2]
    vx, vy, vz = points[b, 0] - points[b - 1, 0], points[b, 1] - points[b - 1, 1], points[b, 2] - points[b - 1, 2]
    wx = points[a - 1, 0] - points[b - 1, 0]
    wy = points[a - 1, 1] - points[b - 1, 1]
    wz = points[a - 1, 2] - points[b - 1, 2]
    uu, vv, uv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, ux * vx + uy * vy + uz * vz
    uw, vw = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    determinant = uu * vv - uv * uv
    s = 0.5
    if determinant > 1e-12 * uu * vv:
        s = min(max((uv * vw - vv * uw) / determinant, 0.0), 1.0)
    t = (uv * s + vw) / vv
    if t < 0.0 or t > 1.0:
        t = min(max(t, 0.0), 1.0)
        s = min(max((uv * t - uw) / uu, 0.0), 1.0)
    x, y, z = wx + s * ux - t * vx, wy + s * uy - t * vy, wz + s * uz - t * vz
    return s, t, x * x + y * y + z * z


@device
def middles_apart(points: Float64, a: int, b: int) -> Any:
    """Squared distance of the middles of segments a and b."""
    total = 0.0
    for j in range(3):
        apart = 0.5 * (points[a - 1, j] + points[a, j] - points[b - 1, j] - points[b, j])
        total += apart * apart
    return total


@device
def approach(points: Float64, moves: Float64, a: int, b: int, s: float, t: float, gap: float) -> Any:
    """The gap between places s and t of segments a and b after the points' moves, along the line between them now."""
    closing = 0.0
    for j in range(3):
        apart = (1.0 - s) * points[a - 1, j] + s * points[a, j] - (1.0 - t) * points[b - 1, j] - t * points[b, j]
        move = (1.0 - s) * moves[a - 1, j] + s * moves[a, j] - (1.0 - t) * moves[b - 1, j] - t * moves[b, j]
        closing += apart * move
    # what leaves may be held back by other contacts
    return gap + min(closing, 0.0) / max(gap, 1e-9)


@parallel_kernel
def near_segments(
    points: Float64,
    strands: Int32,
    is_tip: NDArray[np.bool_],
    segments: Int64,
    cells: Int64,
    table: Int64,
    order: Int64,
    moves: Float64,
    longest: float,
    reach: float,
    limit: float,
    begins: Int64,
    counts: Int64,
    pairs: Int64,
    places: Float64,
) -> None:
    """Pairs a < b of segments of different strands nearer than `reach` that moves (n, 3) bring nearer than `limit`.

    segments (m,): the points that end them. cells (m, 3): of their middles in a grid; order (m,): segments sorted by
    their cell's slot in a hash table, table (slots + 1,): where each slot begins. longest: two such segments' middles
    are no farther apart. Called twice: with begins of no length it counts a segment's pairs, counts (m,); then they go
    to pairs (p, 2), end points, and places (p, 2), 0 to 1, from begins (m,) on. What is nearest at the far end of a
    segment is left to the next one.
    """
    slots = len(table) - 1
    for i in numba.prange(len(segments)):
        a, found = segments[i], 0
        for neighbour in range(27):
            x = cells[i, 0] + neighbour // 9 - 1
            y = cells[i, 1] + neighbour // 3 % 3 - 1
            z = cells[i, 2] + neighbour % 3 - 1
            slot = cell_slot(x, y, z, slots)
            for k in range(table[slot], table[slot + 1]):
                j = order[k]
                b = segments[j]
                if j <= i or strands[a] == strands[b]:
                    continue
                if cells[j, 0] != x or cells[j, 1] != y or cells[j, 2] != z:
                    continue
                if middles_apart(points, a, b) > longest * longest:
                    continue
                s, t, square = segment_places(points, a, b)
                if square >= reach * reach or (s > _END and not is_tip[a]) or (t > _END and not is_tip[b]):
                    continue
                if approach(points, moves, a, b, s, t, math.sqrt(square)) >= limit:
                    continue
                if len(begins) > 0:
                    p = begins[i] + found
                    pairs[p, 0], pairs[p, 1], places[p, 0], places[p, 1] = a, b, s, t
                found += 1
        counts[i] = found


@device
def cell_slot(x: int, y: int, z: int, slots: int) -> int:
    """Slot of a cell in a hash table, 0 to slots - 1."""
    return ((x * 73856093) ^ (y * 19349663) ^ (z * 83492791)) % slots


@parallel_kernel
def hash_cells(cells: Int64, slots: int, keys: Int64) -> None:
    """keys (m,): slots of cells (m, 3)."""
    for i in numba.prange(len(cells)):
        keys[i] = cell_slot(cells[i, 0], cells[i, 1], cells[i, 2], slots)
