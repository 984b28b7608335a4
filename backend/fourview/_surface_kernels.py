"""Kernels of `surface`: middles of clusters, the scan order, patches along the tangent plane."""

from __future__ import annotations

import numpy as np
from numba import prange

from ..kernels import device, kernel, parallel_kernel
from ..types import Float32, Float64, Floats, Int32

WALK_STEPS = 64  # triangles from one element of a patch to the next
FOLD = 0.05  # cosine between a triangle and the patch from which on the surface counts as turned away


@kernel
def nearest_items(points: Float32, labels: Int32, centres: Float64, nearest: Int32, squares: Float64) -> None:
    """For each cluster the item nearest to its centre; `nearest` comes with -1, `squares` with inf."""
    for item in range(len(points)):
        label = labels[item]
        x, y, z = points[item, 0] - centres[label, 0], points[item, 1] - centres[label, 1], points[item, 2]
        z = z - centres[label, 2]
        square = x * x + y * y + z * z
        if square < squares[label]:
            squares[label] = square
            nearest[label] = item


@device
def _dot(a: Floats, b: Floats) -> float:
    return float(a[0]) * float(b[0]) + float(a[1]) * float(b[1]) + float(a[2]) * float(b[2])


@device
def _walk(
    start: int,
    x: float,
    y: float,
    origin: Floats,
    tangent: Floats,
    bitangent: Floats,
    vertices: Float32,
    triangles: Int32,
    across: Int32,
) -> tuple[int, float, float]:
    """The triangle over (x, y) of the plane through `origin`, from triangle `start` on, and two barycentrics of it.

    -1 where the way ends at the boundary, at a fold, or after WALK_STEPS.
    """
    ox, oy = _dot(origin, tangent), _dot(origin, bitangent)
    current, previous = start, -1
    for _ in range(WALK_STEPS):
        a, b, c = vertices[triangles[current, 0]], vertices[triangles[current, 1]], vertices[triangles[current, 2]]
        ax, ay = _dot(a, tangent) - ox - x, _dot(a, bitangent) - oy - y
        bx, by = _dot(b, tangent) - ox - x, _dot(b, bitangent) - oy - y
        cx, cy = _dot(c, tangent) - ox - x, _dot(c, bitangent) - oy - y
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        e1x, e1y, e1z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        e2x, e2y, e2z = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        nx, ny, nz = e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x
        if area <= FOLD * np.sqrt(nx * nx + ny * ny + nz * nz):
            return -1, 0.0, 0.0
        u, v = (bx * cy - by * cx) / area, (cx * ay - cy * ax) / area
        w = 1.0 - u - v
        if u >= -1e-6 and v >= -1e-6 and w >= -1e-6:
            return current, u, v
        # over the side that the point lies farthest beyond, but not back, and not out of the mesh while another will do
        best, value = -1, -1e-6
        for side in range(3):
            amount = u if side == 0 else (v if side == 1 else w)
            other = across[current, side]
            if amount < value and other >= 0 and other != previous:
                best, value = other, amount
        if best < 0:
            return -1, 0.0, 0.0
        previous, current = current, best
    return -1, 0.0, 0.0


@device
def _nearest_texel(grid: Int32, points: Float32, u: float, v: float, x: float, y: float, z: float, reach: float) -> int:
    """The texel at (u, v), cells, or the nearest in space around it within `reach`; -1 for none."""
    size = len(grid)
    row, column = min(max(int(v), 0), size - 1), min(max(int(u), 0), size - 1)
    best, least = -1, reach * reach
    for ring in range(3):
        for down in range(-ring, ring + 1):
            for across in range(-ring, ring + 1):
                if max(abs(down), abs(across)) != ring:
                    continue
                r, c = row + down, column + across
                if r < 0 or c < 0 or r >= size or c >= size or grid[r, c] < 0:
                    continue
                texel = grid[r, c]
                dx, dy, dz = points[texel, 0] - x, points[texel, 1] - y, points[texel, 2] - z
                square = dx * dx + dy * dy + dz * dz
                if square < least:
                    best, least = texel, square
        if best >= 0:
            return best
    return best


@parallel_kernel
def walk_patches(
    centres: Int32,
    tangents: Float32,
    bitangents: Float32,
    patch_size: int,
    spacing: float,
    grid: Int32,
    texel_points: Float32,
    texel_triangle: Int32,
    corners: Float64,
    vertices: Float32,
    triangles: Int32,
    across: Int32,
    patches: Int32,
) -> None:
    """Fill `patches` (V, m * m) with the texels below the elements of each vertex' patch (`surface.Level`; Z-10)."""
    middle = 0.5 * (patch_size - 1)
    for vertex in prange(len(centres)):
        origin = texel_points[centres[vertex]]
        tangent, bitangent = tangents[vertex], bitangents[vertex]
        home = texel_triangle[centres[vertex]]
        row_start = home
        for i in range(patch_size):
            current = row_start
            for j in range(patch_size):
                x, y = (j - middle) * spacing, (i - middle) * spacing
                found, u, v = _walk(current, x, y, origin, tangent, bitangent, vertices, triangles, across)
                if found < 0 and current != home:
                    found, u, v = _walk(home, x, y, origin, tangent, bitangent, vertices, triangles, across)
                place = i * patch_size + j
                patches[vertex, place] = -1
                if found < 0:
                    continue
                current = found
                if j == 0:
                    row_start = found
                w = 1.0 - u - v
                a, b, c = triangles[found, 0], triangles[found, 1], triangles[found, 2]
                px = u * vertices[a, 0] + v * vertices[b, 0] + w * vertices[c, 0]
                py = u * vertices[a, 1] + v * vertices[b, 1] + w * vertices[c, 1]
                pz = u * vertices[a, 2] + v * vertices[b, 2] + w * vertices[c, 2]
                tu = u * corners[found, 0, 0] + v * corners[found, 1, 0] + w * corners[found, 2, 0]
                tv = u * corners[found, 0, 1] + v * corners[found, 1, 1] + w * corners[found, 2, 1]
                patches[vertex, place] = _nearest_texel(grid, texel_points, tu, tv, px, py, pz, 2.0 * spacing)


@kernel
def ring_order(offsets: Int32, neighbours: Int32, starts: Int32, order: Int32) -> None:
    """Fill `order` with the vertices in rings around the first start, each counter-clockwise; then other components.

    The one-rings are counter-clockwise; taken from the vertex that a vertex was reached from on, they give the next
    ring counter-clockwise.
    """
    parent = np.full(len(order), -2, np.int32)
    head = tail = 0
    for start in starts:
        if parent[start] != -2:
            continue
        parent[start] = -1
        order[tail] = start
        tail += 1
        while head < tail:
            vertex = order[head]
            head += 1
            low, count = offsets[vertex], offsets[vertex + 1] - offsets[vertex]
            turn = 0
            for place in range(count):
                if neighbours[low + place] == parent[vertex]:
                    turn = place
            for place in range(count):
                other = neighbours[low + (turn + place) % count]
                if parent[other] == -2:
                    parent[other] = vertex
                    order[tail] = other
                    tail += 1
