"""Points of rods during a time step: where they are, how they move, and what impulses at them do (B-26).

A leg is a point of a rod: element, arc length from the element's start. See `_dynamics_kernels` for the elimination;
an impulse f at a leg is a wrench on the element's base and G^T f on its rates, and goes the same way as the loads.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import prange

from ..kernels import parallel_kernel, summing_device
from ._dynamics_kernels import (
    ANGULAR,
    COUPLING,
    DARBOUX,
    FRAME,
    GRADIENT,
    INVERSE,
    LINEAR,
    OFFSET,
    POSITION,
    RATE,
    TURN,
)
from ._kinematics_kernels import N_QUADRATURE, NODES, coefficients, element_gradient, element_offset
from ._matrix_kernels import (
    Matrix,
    Vector,
    add_matrix,
    cross,
    cross_matrix_product,
    dot,
    lower_product,
    lower_times,
    lower_transposed_times,
    matrix,
    minus,
    plus,
    put,
    scaled,
    symmetric,
    times,
    transposed_product,
    transposed_times,
    vector,
)


@summing_device
def _leg(poses: Any, e: int, arc: float) -> tuple[Vector, Matrix]:
    """Offset and gradient at an arc length of an element."""
    u = vector(poses, e, DARBOUX)
    t = _base_tangent(poses, e)
    c = coefficients(math.sqrt(dot(u, u)), arc)
    return element_offset(c, arc, t, u), element_gradient(c, t, u)


@summing_device
def _drift_at(drifts: Any, s: int, from_root: Vector) -> Any:
    """(r~ - r_n)/dt of a point of strand s."""
    return plus(vector(drifts, s, 9), times(matrix(drifts, s, 0), from_root))


@parallel_kernel
def place_legs(strands: Any, roots: Any, work: Any, dt: float, elements: Any, arcs: Any, now: Any, before: Any) -> None:
    for i in prange(len(elements)):
        e = elements[i]
        place = plus(vector(work.poses, e, POSITION), _leg(work.poses, e, arcs[i])[0])
        drift = _drift_at(work.drifts, strands[e], minus(place, vector(roots, strands[e], 0)))
        put(now, i, 0, place)
        put(before, i, 0, minus(place, scaled(dt, drift)))


@summing_device
def _moves(u: Vector, t: Vector, angular: Vector, x: Vector) -> tuple[Vector, Vector, Vector, Vector, Vector]:
    """Vectors whose sum times s, A, B, A_w/w, B_w/w is Omega x rho(s) + G(s) x: for many s, without the matrices."""
    first = cross(u, t)
    second = cross(u, first)
    ux, tx = dot(u, x), dot(t, x)
    by_a = minus(cross(angular, first), cross(t, x))
    by_b = plus(plus(cross(angular, second), scaled(dot(u, t), x)), minus(scaled(tx, u), scaled(2.0 * ux, t)))
    return cross(angular, t), by_a, by_b, scaled(ux, first), scaled(ux, second)


@summing_device
def _moved(moves: Any, w: float, s: float) -> Vector:
    """Omega x rho(s) + G(s) x from `_moves`."""
    c = coefficients(w, s)
    m0, m1, m2, m3, m4 = moves
    return (
        s * m0[0] + c[0] * m1[0] + c[1] * m2[0] + c[2] * m3[0] + c[3] * m4[0],
        s * m0[1] + c[0] * m1[1] + c[1] * m2[1] + c[2] * m3[1] + c[3] * m4[1],
        s * m0[2] + c[0] * m1[2] + c[1] * m2[2] + c[2] * m3[2] + c[3] * m4[2],
    )


@summing_device
def _base_tangent(poses: Any, e: int) -> Vector:
    return poses[e, FRAME], poses[e, FRAME + 3], poses[e, FRAME + 6]


@parallel_kernel
def leg_velocities(strands: Any, roots: Any, work: Any, elements: Any, arcs: Any, velocities: Any) -> None:
    for i in prange(len(elements)):
        e, arc = elements[i], arcs[i]
        u, t = vector(work.poses, e, DARBOUX), _base_tangent(work.poses, e)
        w = math.sqrt(dot(u, u))
        place = plus(vector(work.poses, e, POSITION), element_offset(coefficients(w, arc), arc, t, u))
        drift = _drift_at(work.drifts, strands[e], minus(place, vector(roots, strands[e], 0)))
        moves = _moves(u, t, vector(work.motion, e, ANGULAR), vector(work.motion, e, RATE))
        put(velocities, i, 0, plus(plus(drift, vector(work.motion, e, LINEAR)), _moved(moves, w, arc)))


@summing_device
def _climb(links: Any, e: int, force: Vector, torque: Vector) -> tuple[Vector, Vector, Vector]:
    """A wrench at the end of element e: its base wrench and its load on the rates, before x is eliminated."""
    load = plus(
        transposed_times(matrix(links, e, GRADIENT), force),
        transposed_times(matrix(links, e, TURN), torque),
    )
    return force, plus(torque, cross(vector(links, e, OFFSET), force)), load


@summing_device
def _without_rates(factors: Any, e: int, force: Vector, torque: Vector, load: Vector) -> tuple[Vector, Vector, Vector]:
    """The base wrench and L^-1 load, once x of element e is eliminated."""
    eliminated = lower_times(symmetric(factors, e, INVERSE), load)
    force = minus(force, transposed_times(matrix(factors, e, COUPLING), eliminated))
    torque = minus(torque, transposed_times(matrix(factors, e, COUPLING + 9), eliminated))
    return force, torque, eliminated


@parallel_kernel
def couple_legs(
    rods: Any, work: Any, leg_offsets: Any, elements: Any, arcs: Any, block_offsets: Any, blocks: Any
) -> None:
    """(3 k, 3 k) per strand: W = sum over elements of (L^-1 load_i)^T (L^-1 load_j), for unit impulses."""
    for s in prange(len(leg_offsets) - 1):
        first, count = leg_offsets[s], leg_offsets[s + 1] - leg_offsets[s]
        if count > 0:
            begin = rods.offsets[s]
            loads = np.empty((count, 3 * (rods.offsets[s + 1] - begin), 3))
            for i in range(count):
                _send_to_root(
                    work.poses, work.links, work.factors, begin, elements[first + i], arcs[first + i], loads[i]
                )
            block = blocks[block_offsets[s] : block_offsets[s + 1]].reshape((3 * count, 3 * count))
            for i in range(count):
                for j in range(i + 1):
                    reach = 3 * (min(elements[first + i], elements[first + j]) - begin + 1)
                    _put_both(block, 3 * i, 3 * j, _shared(loads[i], loads[j], reach))


@summing_device
def _shared(a: Any, b: Any, count: int) -> Matrix:
    """Sum over rows of a^T b."""
    total = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(count):
        x, y, z = a[k, 0], a[k, 1], a[k, 2]
        row = vector(b, k, 0)
        total = (
            total[0] + x * row[0],
            total[1] + x * row[1],
            total[2] + x * row[2],
            total[3] + y * row[0],
            total[4] + y * row[1],
            total[5] + y * row[2],
            total[6] + z * row[0],
            total[7] + z * row[1],
            total[8] + z * row[2],
        )
    return total


@summing_device
def _put_both(block: Any, row: int, column: int, m: Matrix) -> None:
    """m at (row, column) and its transpose on the other side."""
    for a in range(3):
        for b in range(3):
            block[row + a, column + b] = m[3 * a + b]
            block[column + b, row + a] = m[3 * a + b]


@summing_device
def _send_to_root(poses: Any, links: Any, factors: Any, begin: int, e: int, arc: float, loads: Any) -> None:
    """L^-1 load on the rates of all elements from e to the root, for unit impulses along the three axes at a leg.

    Forces, torques and loads (3 N, 3) are matrices with a column for each axis.
    """
    offset, gradient = _leg(poses, e, arc)
    forces = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    torques = cross_matrix_product(offset, forces)
    load = transposed_product(gradient, forces)
    for lower in range(e, begin - 1, -1):
        if lower < e:
            load = transposed_product(matrix(links, lower, GRADIENT), forces)
            load = add_matrix(load, 1.0, transposed_product(matrix(links, lower, TURN), torques))
            torques = add_matrix(torques, 1.0, cross_matrix_product(vector(links, lower, OFFSET), forces))
        load = lower_product(symmetric(factors, lower, INVERSE), load)
        put(loads, 3 * (lower - begin), 0, (load[0], load[1], load[2]))
        put(loads, 3 * (lower - begin) + 1, 0, (load[3], load[4], load[5]))
        put(loads, 3 * (lower - begin) + 2, 0, (load[6], load[7], load[8]))
        forces = add_matrix(forces, -1.0, transposed_product(matrix(factors, lower, COUPLING), load))
        torques = add_matrix(torques, -1.0, transposed_product(matrix(factors, lower, COUPLING + 9), load))


@parallel_kernel
def push_legs(rods: Any, work: Any, leg_offsets: Any, elements: Any, arcs: Any, impulses: Any) -> None:
    """Impulses (k, 3) at the legs: added to the rates, twists, velocities and the roots' impulses."""
    for s in prange(len(leg_offsets) - 1):
        pushed = False
        for i in range(leg_offsets[s], leg_offsets[s + 1]):
            pushed = pushed or impulses[i, 0] != 0.0 or impulses[i, 1] != 0.0 or impulses[i, 2] != 0.0
        if pushed:
            begin, end = rods.offsets[s], rods.offsets[s + 1]
            loads = np.zeros((end - begin, 9))
            for i in range(leg_offsets[s], leg_offsets[s + 1]):
                e = elements[i]
                offset, gradient = _leg(work.poses, e, arcs[i])
                force = vector(impulses, i, 0)
                put(loads, e - begin, 0, plus(vector(loads, e - begin, 0), force))
                put(loads, e - begin, 3, plus(vector(loads, e - begin, 3), cross(offset, force)))
                put(loads, e - begin, 6, plus(vector(loads, e - begin, 6), transposed_times(gradient, force)))
            _change_rates(rods, work, s, begin, end, loads)


@summing_device
def _change_rates(rods: Any, work: Any, s: int, begin: int, end: int, loads: Any) -> None:
    """Tip to root with the loads (N, 9) on the elements (force, torque, load on the rates), and back to the tip."""
    force, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for e in range(end - 1, begin - 1, -1):
        k = e - begin
        force, torque, load = _climb(work.links, e, force, torque)
        force, torque = plus(force, vector(loads, k, 0)), plus(torque, vector(loads, k, 3))
        force, torque, load = _without_rates(work.factors, e, force, torque, plus(load, vector(loads, k, 6)))
        put(loads, k, 6, load)
    put(work.impulses, s, 0, minus(vector(work.impulses, s, 0), force))
    linear, angular = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for e in range(begin, end):
        met = plus(
            times(matrix(work.factors, e, COUPLING), linear), times(matrix(work.factors, e, COUPLING + 9), angular)
        )
        load = minus(vector(loads, e - begin, 6), met)
        x = lower_transposed_times(symmetric(work.factors, e, INVERSE), load)
        _add_motion(rods, work, e, linear, angular, x)
        turned = cross(angular, vector(work.links, e, OFFSET))
        linear = plus(linear, plus(times(matrix(work.links, e, GRADIENT), x), turned))
        angular = plus(angular, times(matrix(work.links, e, TURN), x))


@summing_device
def _add_motion(rods: Any, work: Any, e: int, linear: Vector, angular: Vector, x: Vector) -> None:
    put(work.motion, e, LINEAR, plus(vector(work.motion, e, LINEAR), linear))
    put(work.motion, e, ANGULAR, plus(vector(work.motion, e, ANGULAR), angular))
    put(work.motion, e, RATE, plus(vector(work.motion, e, RATE), x))
    change = transposed_times(matrix(work.poses, e, FRAME), x)
    put(work.rates, e, 0, plus(vector(work.rates, e, 0), change))
    u = vector(work.poses, e, DARBOUX)
    w, moves = math.sqrt(dot(u, u)), _moves(u, _base_tangent(work.poses, e), angular, x)
    for p in range(N_QUADRATURE):
        moved = _moved(moves, w, NODES[p] * rods.lengths[e])
        for i in range(3):
            work.velocities[e, p, i] += linear[i] + moved[i]
