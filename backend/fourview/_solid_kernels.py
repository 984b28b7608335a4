"""Kernels of `solid`: which voxels of a grid lie inside a closed mesh."""

from __future__ import annotations

import math

from ..kernels import kernel
from ..types import Float64, Int32, Int64


@kernel
def add_crossings(vertices: Float64, triangles: Int64, winding: Int32) -> None:
    """Add to winding (X, Y, Z) the signed crossings of each column (x, y) with the mesh, at the voxel above each.

    vertices (V, 3) are in voxels: the middle of voxel (i, j, k) is (i, j, k). Summed up along z afterwards the entries
    are the winding numbers of the voxels' middles: 1 inside a closed mesh that is counter-clockwise from outside.
    A column on an edge or a corner counts for one of the triangles there alone, by the half-open rule of scan lines.
    """
    size_x, size_y, size_z = winding.shape
    for index in range(len(triangles)):
        i0, i1, i2 = triangles[index, 0], triangles[index, 1], triangles[index, 2]
        ax, ay, az = vertices[i0, 0], vertices[i0, 1], vertices[i0, 2]
        bx, by, bz = vertices[i1, 0], vertices[i1, 1], vertices[i1, 2]
        cx, cy, cz = vertices[i2, 0], vertices[i2, 1], vertices[i2, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        first_x = max(0, math.ceil(min(ax, bx, cx)))
        last_x = min(size_x - 1, math.floor(max(ax, bx, cx)))
        for x in range(first_x, last_x + 1):
            # where the plane of this x cuts the triangle's edges: each edge by the same rule from both its sides
            low, high = math.inf, -math.inf
            for px, py, qx, qy in ((ax, ay, bx, by), (bx, by, cx, cy), (cx, cy, ax, ay)):
                if (px <= x) != (qx <= x):
                    if px > qx:
                        px, py, qx, qy = qx, qy, px, py
                    cut = py + (qy - py) * ((x - px) / (qx - px))
                    low, high = min(low, cut), max(high, cut)
            if not low <= high:
                continue
            first_y, last_y = max(0, math.ceil(low)), min(size_y - 1, math.ceil(high) - 1)
            for y in range(first_y, last_y + 1):
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                z = u * az + v * bz + (1.0 - u - v) * cz
                above = max(0, math.ceil(z))
                if above < size_z:
                    # going up through a face that looks down is going in
                    winding[x, y, above] += 1 if area < 0.0 else -1
