"""Numba kernels of `equilibrium`: contact forces of least bending, and directions that stuck contacts hold (M-26)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import prange

from ..kernels import device, parallel_kernel
from ..types import Float64, Int64

# Steps within one contact before the next one has its turn.
_LOCAL_STEPS = 8
# Part of a direction that must be new for it to count as held.
_NEW_DIRECTION = 1e-6


@device
def _project(normal: float, t1: float, t2: float, friction: float) -> Any:
    """The nearest point of the cone |t| <= friction normal."""
    size = math.hypot(t1, t2)
    if size <= friction * normal:
        return normal, t1, t2
    if friction * size <= -normal:
        return 0.0, 0.0, 0.0
    normal = (normal + friction * size) / (1.0 + friction * friction)
    shorter = friction * normal / size
    return normal, shorter * t1, shorter * t2


@device
def _local_change(w: Float64, u: Float64, force: Float64, friction: float, change: Float64) -> float:
    """change (3,) of one contact's force (3,) that lowers 1/2 d^T W d + u^T d; returns how much step was left, squared.

    Projected gradients in the metric diag(a, b, b) >= W, in which the projection onto the cone has a closed form.
    """
    tangential = 0.5 * (w[1, 1] + w[2, 2]) + math.hypot(0.5 * (w[1, 1] - w[2, 2]), w[1, 2])
    floor = 1e-9 * (w[0, 0] + tangential)
    along, across = 2.0 * (w[0, 0] + floor), 2.0 * (tangential + floor)
    root_n, root_t = math.sqrt(along), math.sqrt(across)
    moved = 0.0
    change[:] = 0.0
    for step in range(_LOCAL_STEPS):
        g0 = u[0] + w[0, 0] * change[0] + w[0, 1] * change[1] + w[0, 2] * change[2]
        g1 = u[1] + w[1, 0] * change[0] + w[1, 1] * change[1] + w[1, 2] * change[2]
        g2 = u[2] + w[2, 0] * change[0] + w[2, 1] * change[1] + w[2, 2] * change[2]
        r0, r1, r2 = force[0] + change[0], force[1] + change[1], force[2] + change[2]
        n, t1, t2 = _project(
            root_n * (r0 - g0 / along),
            root_t * (r1 - g1 / across),
            root_t * (r2 - g2 / across),
            friction * root_t / root_n,
        )
        n, t1, t2 = n / root_n, t1 / root_t, t2 / root_t
        if step == 0:
            moved = along * (n - r0) ** 2 + across * ((t1 - r1) ** 2 + (t2 - r2) ** 2)
        change[0], change[1], change[2] = n - force[0], t1 - force[1], t2 - force[2]
    return moved


@parallel_kernel
def least_bending(
    island_offsets: Int64,
    order: Int64,
    row_offsets: Int64,
    row_elements: Int64,
    rows: Float64,
    friction: Float64,
    force_cost: Float64,
    compliance: Float64,
    tolerance: float,
    iterations: int,
    bending: Float64,
    forces: Float64,
    sweeps: Int64,
) -> None:
    """min over forces r in Coulomb's cones of 1/2 z^T A z + 1/2 sum_c cost_c |r_c|^2, z = A^-1 (f + H^T r) (M-26).

    By block Gauss-Seidel. Islands of contacts order[island_offsets[i]:island_offsets[i + 1]] share no rod. Contact c
    has the rows (r, 3, 3) of H from row_offsets[c] on, in its own axes (normal, two tangents), of row_elements.
    compliance (E, 3): A^-1. bending (E, 3): z, in and out; forces (c, 3), N in contact axes, in and out. Ends when a
    sweep's steps, squared in the local metric, are below tolerance of those of the first; sweeps (I,) says how many it
    took.
    """
    for i in prange(len(island_offsets) - 1):
        change, u, w = np.empty(3), np.empty(3), np.empty((3, 3))
        first_moved = 0.0
        for sweep in range(iterations):
            moved = 0.0
            for k in range(island_offsets[i], island_offsets[i + 1]):
                c = order[k]
                w[:] = 0.0
                for a in range(3):
                    w[a, a] = force_cost[c]
                    u[a] = force_cost[c] * forces[c, a]
                for row in range(row_offsets[c], row_offsets[c + 1]):
                    e = row_elements[row]
                    for a in range(3):
                        for j in range(3):
                            u[a] += rows[row, a, j] * bending[e, j]
                            for b in range(3):
                                w[a, b] += rows[row, a, j] * compliance[e, j] * rows[row, b, j]
                if w[0, 0] + w[1, 1] + w[2, 2] <= 0.0:
                    continue
                moved += _local_change(w, u, forces[c], friction[c], change)
                for a in range(3):
                    forces[c, a] += change[a]
                for row in range(row_offsets[c], row_offsets[c + 1]):
                    e = row_elements[row]
                    for j in range(3):
                        value = 0.0
                        for a in range(3):
                            value += rows[row, a, j] * change[a]
                        bending[e, j] += compliance[e, j] * value
            sweeps[i] = sweep + 1
            if sweep == 0:
                first_moved = moved
            if moved <= tolerance * first_moved:
                break


@parallel_kernel
def held_directions(
    offsets: Int64,
    leg_offsets: Int64,
    row_offsets: Int64,
    row_elements: Int64,
    rows: Float64,
    is_held: Any,
    compliance: Float64,
    basis_offsets: Int64,
    basis: Float64,
) -> None:
    """Orthonormal directions, in the coordinates A^1/2 q, that a rod's held contact axes allow no motion along.

    Rod s has the legs leg_offsets[s]:leg_offsets[s + 1], each with its rows of H, of which is_held (L, 3) says which
    axes count. basis: for each rod, from basis_offsets[s] on, a matrix (3N, 3N) with the directions as rows, rest 0.
    """
    for s in prange(len(offsets) - 1):
        size = 3 * (offsets[s + 1] - offsets[s])
        found = 0
        vector = np.empty(size)
        at = basis_offsets[s]
        for leg in range(leg_offsets[s], leg_offsets[s + 1]):
            for axis in range(3):
                if not is_held[leg, axis] or found == size:
                    continue
                vector[:] = 0.0
                for row in range(row_offsets[leg], row_offsets[leg + 1]):
                    e = row_elements[row]
                    for j in range(3):
                        vector[3 * (e - offsets[s]) + j] = rows[row, axis, j] * math.sqrt(compliance[e, j])
                before = math.sqrt((vector * vector).sum())
                # twice is enough for directions that are orthogonal to rounding
                for _ in range(2):
                    for k in range(found):
                        other = basis[at + k * size : at + (k + 1) * size]
                        vector -= (vector * other).sum() * other
                after = math.sqrt((vector * vector).sum())
                if after > _NEW_DIRECTION * before:
                    basis[at + found * size : at + (found + 1) * size] = vector / after
                    found += 1
