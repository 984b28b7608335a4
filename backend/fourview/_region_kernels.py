"""Kernels over graphs of texels: regions, and averages of neighbours."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from ..kernels import kernel, parallel_kernel


@kernel
def choose_seeds(offsets: Any, neighbours: Any, steps: int, queue: Any, seen: Any, is_seed: Any) -> int:
    """Every node that no earlier seed reaches in `steps` becomes a seed; gives how many there are.

    queue (N,) int64 and seen (N,) int32, filled with -1, are working space. is_seed (N,) bool is written.
    """
    count = len(offsets) - 1
    covered = np.zeros(count, np.bool_)
    n_seeds = 0
    for node in range(count):
        if covered[node]:
            continue
        is_seed[node] = True
        seen[node] = n_seeds
        queue[0] = node
        start, end = 0, 1
        for _ in range(steps):
            ring_end = end
            for place in range(start, ring_end):
                here = queue[place]
                covered[here] = True
                for k in range(offsets[here], offsets[here + 1]):
                    other = neighbours[k]
                    if seen[other] != n_seeds:
                        seen[other] = n_seeds
                        queue[end] = other
                        end += 1
            start = ring_end
        for place in range(start, end):
            covered[queue[place]] = True
        n_seeds += 1
    return n_seeds


@kernel
def grow_regions(offsets: Any, neighbours: Any, queue: Any, regions: Any) -> None:
    """Each node of regions (N,), -1 but for the seeds, gets the region of the seed fewest steps away."""
    end = 0
    for node in range(len(regions)):
        if regions[node] >= 0:
            queue[end] = node
            end += 1
    place = 0
    while place < end:
        here = queue[place]
        place += 1
        for k in range(offsets[here], offsets[here + 1]):
            other = neighbours[k]
            if regions[other] < 0:
                regions[other] = regions[here]
                queue[end] = other
                end += 1


@parallel_kernel
def average_neighbours(
    offsets: Any, neighbours: Any, own: Any, weights: Any, pull: float, values: Any, out: Any
) -> None:
    """out = (weight own + pull * sum of the neighbours' values) / (weight + pull * neighbours), for each node.

    A Jacobi step of the screened Laplace equation. own, values, out : (N, C) float32; weights : (N,) float32.
    """
    count, width = own.shape
    for node in numba.prange(count):
        first, last = offsets[node], offsets[node + 1]
        total = weights[node] + np.float32(pull) * (last - first)
        for c in range(width):
            mean = weights[node] * own[node, c]
            for k in range(first, last):
                mean += np.float32(pull) * values[neighbours[k], c]
            out[node, c] = mean / total if total > 0 else values[node, c]


@parallel_kernel
def main_axes(tensors: Any, normals: Any, axes: Any, coherence: Any) -> None:
    """Main axis of tensors (N, 6) (xx, xy, xz, yy, yz, zz) in the plane of each normal, by closed form in the plane.

    coherence : (N,) (difference over sum of the two eigenvalues there), 0 for no tensor, whose axis is any tangent.
    """
    for n in numba.prange(len(tensors)):
        nx, ny, nz = normals[n, 0], normals[n, 1], normals[n, 2]
        # any two axes of the plane: the coordinate axis farthest from the normal, made perpendicular
        ax, ay, az = abs(nx), abs(ny), abs(nz)
        ux, uy, uz = 0.0, 0.0, 0.0
        if ax <= ay and ax <= az:
            ux = 1.0
        elif ay <= az:
            uy = 1.0
        else:
            uz = 1.0
        d = ux * nx + uy * ny + uz * nz
        ux, uy, uz = ux - d * nx, uy - d * ny, uz - d * nz
        length = np.sqrt(ux * ux + uy * uy + uz * uz)
        ux, uy, uz = ux / length, uy / length, uz / length
        vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
        xx, xy, xz = tensors[n, 0], tensors[n, 1], tensors[n, 2]
        yy, yz, zz = tensors[n, 3], tensors[n, 4], tensors[n, 5]
        px, py, pz = xx * ux + xy * uy + xz * uz, xy * ux + yy * uy + yz * uz, xz * ux + yz * uy + zz * uz
        qx, qy, qz = xx * vx + xy * vy + xz * vz, xy * vx + yy * vy + yz * vz, xz * vx + yz * vy + zz * vz
        uu, uv, vv = ux * px + uy * py + uz * pz, vx * px + vy * py + vz * pz, vx * qx + vy * qy + vz * qz
        half = 0.5 * np.arctan2(2.0 * uv, uu - vv)
        cosine, sine = np.cos(half), np.sin(half)
        axes[n, 0] = cosine * ux + sine * vx
        axes[n, 1] = cosine * uy + sine * vy
        axes[n, 2] = cosine * uz + sine * vz
        total = uu + vv
        coherence[n] = np.sqrt((uu - vv) ** 2 + 4.0 * uv * uv) / total if total > 1e-20 else 0.0
