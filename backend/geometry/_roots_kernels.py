"""Numba kernels of `roots`: neighbours by a hashed grid, and repulsion on a triangle mesh (M-4).

Every point is moved from the positions before the step, so the result does not depend on the number of threads.
"""

from __future__ import annotations

from math import floor, sqrt
from typing import Any

import numpy as np
from numba import prange

from ..kernels import device, kernel, parallel_kernel

# Hops from triangle to triangle that one move may take; enough for a spacing of 100 triangles.
_MOST_HOPS = 64
# The longest move of a step, in reaches (the wanted distance of neighbours is about half a reach).
_LONGEST_MOVE = 0.25


@kernel
def chain_edges(starts: Any, ends: Any, first: Any, order: Any) -> None:
    """order (m,): edges (m,) sorted by their start vertices, put one behind the other as they join end to start.

    first (V + 1,): where each vertex's edges begin. A vertex with several edges hands them out in turn.
    """
    count = starts.shape[0]
    used = np.zeros(count, np.bool_)
    free = first[:-1].copy()
    filled = 0
    for begin in range(count):
        edge = begin
        while not used[edge]:
            used[edge] = True
            order[filled] = edge
            filled += 1
            vertex = ends[edge]
            while free[vertex] < first[vertex + 1] and used[free[vertex]]:
                free[vertex] += 1
            if free[vertex] < first[vertex + 1]:
                edge = free[vertex]


@device
def _bucket(x: int, y: int, z: int, mask: int) -> int:
    return (x * 73856093 ^ y * 19349663 ^ z * 83492791) & mask


@device
def _gap(value: float, low: float, size: float) -> float:
    """Distance of a number from the interval [low, low + size]."""
    return max(low - value, value - low - size, 0.0)


@kernel
def sort_into_cells(
    points: Any, normals: Any, cell_size: float, starts: Any, order: Any, cells: Any, places: Any
) -> None:
    """Sort points (n, 3) by hashed grid cell.

    starts (B + 1,): of each bucket, B = 2^k. order (n,): the points by bucket; cells (n, 3), places (n, 6): their
    cells, and positions and normals, in that order, so that a search reads memory in a row.
    """
    mask = starts.shape[0] - 2
    count = points.shape[0]
    buckets = np.empty(count, np.int64)
    starts[:] = 0
    for i in range(count):
        x, y, z = floor(points[i, 0] / cell_size), floor(points[i, 1] / cell_size), floor(points[i, 2] / cell_size)
        buckets[i] = _bucket(np.int64(x), np.int64(y), np.int64(z), mask)
        starts[buckets[i] + 1] += 1
    for b in range(mask + 1):
        starts[b + 1] += starts[b]
    free = starts[:-1].copy()
    for i in range(count):
        place = free[buckets[i]]
        free[buckets[i]] += 1
        order[place] = i
        for c in range(3):
            cells[place, c] = np.int32(floor(points[i, c] / cell_size))
            places[place, c] = points[i, c]
            places[place, 3 + c] = normals[i, c]


@parallel_kernel
def find_neighbours(
    reach: float, starts: Any, order: Any, cells: Any, places: Any, neighbours: Any, counts: Any
) -> None:
    """neighbours (n, K), counts (n,): the points within `reach` whose surface faces the same way; at most K of them.

    n may be below the number of points: those behind are fixed. The other arrays are `sort_into_cells`'s for cells of
    the size `reach`.
    """
    mask = starts.shape[0] - 2
    most = neighbours.shape[1]
    count = neighbours.shape[0]
    square_reach = reach * reach
    # in the order of the cells, so that what the last point needed is still in the cache
    for own in prange(order.shape[0]):
        i = order[own]
        if i >= count:
            continue
        px, py, pz = places[own, 0], places[own, 1], places[own, 2]
        nx, ny, nz = places[own, 3], places[own, 4], places[own, 5]
        cx, cy, cz = cells[own, 0], cells[own, 1], cells[own, 2]
        found = 0
        for x in range(cx - 1, cx + 2):
            gx = _gap(px, x * reach, reach)
            for y in range(cy - 1, cy + 2):
                gy = _gap(py, y * reach, reach)
                for z in range(cz - 1, cz + 2):
                    gz = _gap(pz, z * reach, reach)
                    # nothing of a cell that lies too far away as a whole
                    if gx * gx + gy * gy + gz * gz >= square_reach:
                        continue
                    b = _bucket(x, y, z, mask)
                    for place in range(starts[b], starts[b + 1]):
                        dx, dy, dz = places[place, 0] - px, places[place, 1] - py, places[place, 2] - pz
                        if dx * dx + dy * dy + dz * dz >= square_reach or place == own or found == most:
                            continue
                        # a point of another cell in the same bucket has its own turn
                        if cells[place, 0] != x or cells[place, 1] != y or cells[place, 2] != z:
                            continue
                        if nx * places[place, 3] + ny * places[place, 4] + nz * places[place, 5] > 0.0:
                            neighbours[i, found] = order[place]
                            found += 1
        counts[i] = found


@parallel_kernel
def nearest_distances(points: Any, neighbours: Any, counts: Any, none: float, distances: Any) -> None:
    """distances (n,) to the nearest movable neighbour, `none` without one."""
    n = distances.shape[0]
    for i in prange(n):
        best = none * none
        for k in range(counts[i]):
            j = neighbours[i, k]
            if j < n:
                dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
                best = min(best, dx * dx + dy * dy + dz * dz)
        distances[i] = sqrt(best)


@device
def _closest(px: float, py: float, pz: float, corners: Any, k: int) -> Any:
    """Squared distance of p from triangle k, and its closest point as weights s, t of the second and third corner."""
    ax, ay, az = corners[k, 0, 0], corners[k, 0, 1], corners[k, 0, 2]
    bx, by, bz = corners[k, 1, 0] - ax, corners[k, 1, 1] - ay, corners[k, 1, 2] - az
    cx, cy, cz = corners[k, 2, 0] - ax, corners[k, 2, 1] - ay, corners[k, 2, 2] - az
    px, py, pz = px - ax, py - ay, pz - az
    bb, bc, cc = bx * bx + by * by + bz * bz, bx * cx + by * cy + bz * cz, cx * cx + cy * cy + cz * cz
    pb, pc = px * bx + py * by + pz * bz, px * cx + py * cy + pz * cz
    determinant = bb * cc - bc * bc
    s, t = -1.0, -1.0
    if determinant > 0.0:
        s, t = (cc * pb - bc * pc) / determinant, (bb * pc - bc * pb) / determinant
    if s < 0.0 or t < 0.0 or s + t > 1.0:
        # outside, or a triangle of no area: the closest point of the three edges
        s, t = min(max(pb / bb, 0.0), 1.0) if bb > 0.0 else 0.0, 0.0
        best = bb * s * s - 2.0 * s * pb
        e = min(max(pc / cc, 0.0), 1.0) if cc > 0.0 else 0.0
        square = cc * e * e - 2.0 * e * pc
        if square < best:
            best, s, t = square, 0.0, e
        side = bb - 2.0 * bc + cc
        e = min(max((pc - pb + bb - bc) / side, 0.0), 1.0) if side > 0.0 else 0.0
        f = 1.0 - e
        square = bb * f * f + 2.0 * bc * e * f + cc * e * e - 2.0 * (f * pb + e * pc)
        if square < best:
            s, t = f, e
    dx, dy, dz = px - s * bx - t * cx, py - s * by - t * cy, pz - s * bz - t * cz
    return dx * dx + dy * dy + dz * dz, s, t


@device
def _slide(px: float, py: float, pz: float, triangle: int, corners: Any, ring_starts: Any, rings: Any) -> Any:
    """The triangle whose point is closest to p, and that point as weights s, t, going downhill from ring to ring.

    Only triangles of the region are in `corners` and `rings`, so its border stops the point.
    """
    best, s, t = _closest(px, py, pz, corners, triangle)
    for _ in range(_MOST_HOPS):
        if s > 0.0 and t > 0.0 and s + t < 1.0:
            # p lies over the inside of this triangle
            break
        start = triangle
        for place in range(ring_starts[start], ring_starts[start + 1]):
            square, other_s, other_t = _closest(px, py, pz, corners, rings[place])
            if square < best:
                best, s, t, triangle = square, other_s, other_t, rings[place]
        if triangle == start:
            break
    return triangle, s, t


@parallel_kernel
def relax(
    points: Any, normals: Any, triangles: Any, neighbours: Any, counts: Any,
    reach: float, step: float, border_weight: float, corners: Any, face_normals: Any, ring_starts: Any, rings: Any,
    new_points: Any, new_triangles: Any, barycentric: Any,
) -> None:  # fmt: skip
    """One step of repulsion along the surface, by forces that fall linearly to 0 at `reach`.

    points, normals (n + g, 3): n movable points and then g fixed ones on the border, which push with `border_weight`.
    triangles (n,), of the region's corners (F, 3, 3). `step` : move, in reaches, for a force of 1.
    """
    n = triangles.shape[0]
    for i in prange(n):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        fx, fy, fz = 0.0, 0.0, 0.0
        for k in range(counts[i]):
            j = neighbours[i, k]
            dx, dy, dz = px - points[j, 0], py - points[j, 1], pz - points[j, 2]
            square = dx * dx + dy * dy + dz * dz
            if square < reach * reach and square > 0.0:
                push = 1.0 / sqrt(square) - 1.0 / reach
                if j >= n:
                    push *= border_weight
                fx, fy, fz = fx + push * dx, fy + push * dy, fz + push * dz
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        along = fx * nx + fy * ny + fz * nz
        fx, fy, fz = fx - along * nx, fy - along * ny, fz - along * nz
        size = step * sqrt(fx * fx + fy * fy + fz * fz)
        scale = reach * step * min(1.0, _LONGEST_MOVE / size) if size > 0.0 else 0.0
        px, py, pz = px + scale * fx, py + scale * fy, pz + scale * fz
        m, s, t = _slide(px, py, pz, triangles[i], corners, ring_starts, rings)
        new_triangles[i] = m
        barycentric[i, 0], barycentric[i, 1], barycentric[i, 2] = 1.0 - s - t, s, t
        for c in range(3):
            new_points[i, c] = (1.0 - s - t) * corners[m, 0, c] + s * corners[m, 1, c] + t * corners[m, 2, c]
            normals[i, c] = face_normals[m, c]
