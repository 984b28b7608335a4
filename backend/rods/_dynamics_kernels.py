"""One implicit time step of all rods in linear time: articulated-body elimination, tip to root (B-25, M-25).

The step (see `dynamics`) is a least-squares problem in the elements' rates x = R q' (world axes). A velocity due to
the rates is, in an element with the base twist z = (V, Omega), V + Omega x rho + G x at the offset rho, G being
`element_gradient`; the next element's base twist follows at the element's end with G there and Omega + W x. So all that
hangs on an element is a quadratic form 1/2 z^T P z - p^T z in its base twist, and its x (3 numbers) can be eliminated:

    D x = y - C^T z,  D = L L^T:  P := P - E^T E, p := p - E^T yh with E = L^-1 C^T, yh = L^-1 y;  x = L^-T (yh - E z).

Symmetric matrices are tuples of 6 (00, 01, 02, 11, 12, 22), inverse factors L^-1 too (00, 10, 11, 20, 21, 22). All sums
have a fixed order, and rods do not depend on each other: the same bytes for any number of threads.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba import prange

from ..kernels import parallel_kernel, summing_device
from ._kinematics_kernels import (
    N_QUADRATURE,
    NODES,
    WEIGHTS,
    coefficients,
    element_gradient,
    element_offset,
    element_turn,
    turned_frame,
)
from ._matrix_kernels import (
    Matrix,
    Symmetric,
    Vector,
    add_gram,
    add_inertia,
    add_matrix,
    add_symmetric,
    cross,
    cross_matrix_product,
    dot,
    full,
    inverse_factor,
    lower_times,
    lower_times_transposed,
    lower_transposed_times,
    matrix,
    minus,
    plus,
    product,
    put,
    scaled,
    symmetric,
    tangent,
    times,
    transposed_product,
    transposed_times,
    vector,
)

BLOCK = 8
"""Rods that one work item steps one after the other, on the same scratch."""

# columns of the work arrays
POSITION, FRAME, DARBOUX, N_POSE = 0, 3, 12, 15
OFFSET, GRADIENT, TURN, N_LINK = 0, 3, 12, 21
COUPLING, INVERSE, N_FACTOR = 0, 18, 24
LINEAR, ANGULAR, RATE, N_MOTION = 0, 3, 6, 9
N_DRIFT = 12
# columns of scratch: per quadrature point gradient (9), offset (3), drift (3); sums of the element; eliminated load
_POINT = 15
_MASS = _POINT * N_QUADRATURE
_FIRST, _SECOND, _CV, _CW, _D, _PV, _PW, _Y, _YH = (_MASS + k for k in (1, 4, 10, 19, 28, 34, 37, 40, 43))
N_SCRATCH = _YH + 3


class Properties(NamedTuple):
    """The arrays of `Rods` that the kernels need."""

    offsets: Any
    lengths: Any
    rest: Any
    stiffness: Any
    mass: Any
    drag: Any


class Work(NamedTuple):
    """What `begin` leaves for points, contacts and `end`; all float64, world axes.

    poses (E, 15): the elements' base position, frame (rows), Darboux vector. links (E, 21): an element's end: offset,
    gradient, turn. factors (E, 24): E (3, 6), then L^-1. motion (E, 9): base twist due to the rates (V, Omega), x.
    rates (E, 3): q'. velocities (E, Q, 3). drifts (S, 12): (I - T)/dt in rows and the root's velocity, for
    (r~ - r_n)/dt = matrix (r~ - root) + velocity. impulses (S, 3): N s, of the root on its rod.
    scratch (B, N, N_SCRATCH): of the blocks of rods.
    """

    poses: Any
    links: Any
    factors: Any
    motion: Any
    rates: Any
    velocities: Any
    drifts: Any
    impulses: Any
    scratch: Any


class Step(NamedTuple):
    """A time step's input. Roots and frames are those of the step's begin and, `next`, of its end.

    gravity (3,), wind (E, 3) m/s."""

    dt: float
    damping: float
    gravity: Any
    roots: Any
    frames: Any
    next_roots: Any
    next_frames: Any
    curvatures: Any
    velocities: Any
    wind: Any


@parallel_kernel
def begin_step(rods: Any, step: Any, work: Any) -> None:
    """Fill `work`: kinematics at the new root poses, factorisation, rates without contact."""
    strands = len(rods.offsets) - 1
    for block in prange((strands + BLOCK - 1) // BLOCK):
        scratch = work.scratch[block]
        for s in range(block * BLOCK, min(strands, (block + 1) * BLOCK)):
            _drift(s, step, work.drifts)
            _place(s, rods, step, work, scratch)
            _eliminate(s, rods, work, scratch)
            _substitute(s, rods, work, scratch)


@summing_device
def _drift(s: int, step: Any, drifts: Any) -> None:
    """(r~ - r_n)/dt as a linear function of r~: a strand rides on its root from the old pose to the new."""
    rate = 1.0 / step.dt
    for i in range(3):
        for j in range(3):
            turn = 0.0
            for k in range(3):
                turn += step.frames[s, i, k] * step.next_frames[s, j, k]
            drifts[s, 3 * i + j] = ((1.0 if i == j else 0.0) - turn) * rate
        drifts[s, 9 + i] = (step.next_roots[s, i] - step.roots[s, i]) * rate


@summing_device
def _place(s: int, rods: Any, step: Any, work: Any, scratch: Any) -> None:
    """Root to tip: poses, ends of the elements, and their own terms of the quadratic form."""
    begin, end = rods.offsets[s], rods.offsets[s + 1]
    f = step.next_frames[s]
    frame = (f[0, 0], f[0, 1], f[0, 2], f[1, 0], f[1, 1], f[1, 2], f[2, 0], f[2, 1], f[2, 2])
    position = (0.0, 0.0, 0.0)
    root = vector(step.next_roots, s, 0)
    for e in range(begin, end):
        u = times(frame, vector(step.curvatures, e, 0))
        put(work.poses, e, POSITION, plus(position, root))
        put(work.poses, e, FRAME, frame)
        put(work.poses, e, DARBOUX, u)
        _add_points(s, e, position, frame, u, rods, step, work.drifts, scratch, e - begin)
        _add_elasticity(e, frame, rods, step, scratch, e - begin)
        length = rods.lengths[e]
        c = coefficients(math.sqrt(dot(u, u)), length)
        offset = element_offset(c, length, tangent(frame), u)
        put(work.links, e, OFFSET, offset)
        put(work.links, e, GRADIENT, element_gradient(c, tangent(frame), u))
        put(work.links, e, TURN, element_turn(c, length, u))
        position = plus(position, offset)
        frame = turned_frame(c, length, u, frame)


@summing_device
def _add_points(
    s: int, e: int, position: Vector, frame: Matrix, u: Vector, rods: Any, step: Any, drifts: Any, scratch: Any, k: int
) -> None:
    """Mass and drag of the element's quadrature points: sum of m |V + Omega x rho + G x - b|^2 / 2 into row k.

    m is the mass and dt times the drag, b the velocity that the point would have if nothing held it, less the drift.
    """
    dt, length = step.dt, rods.lengths[e]
    inertia, drag = rods.mass[e], dt * rods.drag[e]
    total, root_velocity, turn = inertia + drag, vector(drifts, s, 9), matrix(drifts, s, 0)
    pulled = plus(
        scaled(inertia * dt / total, (step.gravity[0], step.gravity[1], step.gravity[2])),
        scaled(drag / total, vector(step.wind, e, 0)),
    )
    w, t = math.sqrt(dot(u, u)), tangent(frame)
    zero = (0.0, 0.0, 0.0)
    zeros = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    first, second, d = zero, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    cv, cw, pv, pw, y = zeros, zeros, zero, zero, zero
    for p in range(N_QUADRATURE):
        at, m = NODES[p] * length, total * WEIGHTS[p] * length
        c = coefficients(w, at)
        offset, gradient = element_offset(c, at, t, u), element_gradient(c, t, u)
        drift = plus(root_velocity, times(turn, plus(position, offset)))
        old = (step.velocities[e, p, 0], step.velocities[e, p, 1], step.velocities[e, p, 2])
        momentum = scaled(m, minus(plus(scaled(inertia / total, old), pulled), drift))
        put(scratch, k, _POINT * p, gradient)
        put(scratch, k, _POINT * p + 9, offset)
        put(scratch, k, _POINT * p + 12, drift)
        first, second = plus(first, scaled(m, offset)), add_inertia(second, m, offset)
        cv, cw = add_matrix(cv, m, gradient), add_matrix(cw, m, cross_matrix_product(offset, gradient))
        d = add_gram(d, m, gradient, gradient)
        pv, pw = plus(pv, momentum), plus(pw, cross(offset, momentum))
        y = plus(y, transposed_times(gradient, momentum))
    scratch[k, _MASS] = total * length
    put(scratch, k, _FIRST, first)
    put(scratch, k, _SECOND, second)
    put(scratch, k, _CV, cv)
    put(scratch, k, _CW, cw)
    put(scratch, k, _D, d)
    put(scratch, k, _PV, pv)
    put(scratch, k, _PW, pw)
    put(scratch, k, _Y, y)


@summing_device
def _add_elasticity(e: int, frame: Matrix, rods: Any, step: Any, scratch: Any, k: int) -> None:
    """l (dt mu K / 2 |q'|^2 + K / 2 |dt q' + q - q0|^2) into row k, for x = R q'."""
    dt, length = step.dt, rods.lengths[e]
    hold = length * dt * (step.damping + dt)
    stiffness = vector(rods.stiffness, e, 0)
    d, f = symmetric(scratch, k, _D), frame
    k0, k1, k2 = hold * stiffness[0], hold * stiffness[1], hold * stiffness[2]
    stiff = (k0 * f[0], k1 * f[1], k2 * f[2], k0 * f[3], k1 * f[4], k2 * f[5], k0 * f[6], k1 * f[7], k2 * f[8])
    put(
        scratch,
        k,
        _D,
        (
            d[0] + stiff[0] * f[0] + stiff[1] * f[1] + stiff[2] * f[2],
            d[1] + stiff[0] * f[3] + stiff[1] * f[4] + stiff[2] * f[5],
            d[2] + stiff[0] * f[6] + stiff[1] * f[7] + stiff[2] * f[8],
            d[3] + stiff[3] * f[3] + stiff[4] * f[4] + stiff[5] * f[5],
            d[4] + stiff[3] * f[6] + stiff[4] * f[7] + stiff[5] * f[8],
            d[5] + stiff[6] * f[6] + stiff[7] * f[7] + stiff[8] * f[8],
        ),
    )
    bent = minus(vector(rods.rest, e, 0), vector(step.curvatures, e, 0))
    push = scaled(dt * length, (stiffness[0] * bent[0], stiffness[1] * bent[1], stiffness[2] * bent[2]))
    put(scratch, k, _Y, plus(vector(scratch, k, _Y), times(frame, push)))


@summing_device
def _eliminate(s: int, rods: Any, work: Any, scratch: Any) -> None:
    """Tip to root: eliminate the elements' rates; what the root's base twist would meet is the root's impulse."""
    begin, end = rods.offsets[s], rods.offsets[s + 1]
    zeros = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    # P of all that hangs on the element's end: blocks VV, V Omega, Omega Omega, about that end; and p
    vv, vw, ww = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), zeros, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    pv, pw = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for e in range(end - 1, begin - 1, -1):
        k = e - begin
        offset, gradient, turn = (
            vector(work.links, e, OFFSET),
            matrix(work.links, e, GRADIENT),
            matrix(work.links, e, TURN),
        )
        # what the end's twist (G x, W x) meets
        y = plus(transposed_times(gradient, pv), transposed_times(turn, pw))
        cv = add_matrix(product(full(vv), gradient), 1.0, product(vw, turn))
        cw = add_matrix(transposed_product(vw, gradient), 1.0, product(full(ww), turn))
        d = add_gram(add_gram(symmetric(scratch, k, _D), 1.0, gradient, cv), 1.0, turn, cw)
        # moved to the element's base: V there gives V - [offset]x Omega at the end
        cw = add_matrix(cw, 1.0, cross_matrix_product(offset, cv))
        moved = _times_cross(full(vv), offset)
        half = cross_matrix_product(offset, vw)
        shifted = add_matrix(vw, -1.0, moved)
        ww = _moved_inertia(ww, half, cross_matrix_product(offset, shifted))
        pw = plus(pw, cross(offset, pv))
        # the element's own mass
        m, h = scratch[k, _MASS], vector(scratch, k, _FIRST)
        vv = add_symmetric(vv, (m, 0.0, 0.0, m, 0.0, m))
        vw = add_matrix(shifted, -1.0, (0.0, -h[2], h[1], h[2], 0.0, -h[0], -h[1], h[0], 0.0))
        ww = add_symmetric(ww, symmetric(scratch, k, _SECOND))
        cv, cw = add_matrix(cv, 1.0, matrix(scratch, k, _CV)), add_matrix(cw, 1.0, matrix(scratch, k, _CW))
        pv, pw = plus(pv, vector(scratch, k, _PV)), plus(pw, vector(scratch, k, _PW))
        # x out
        inverse = inverse_factor(d)
        yh = lower_times(inverse, plus(y, vector(scratch, k, _Y)))
        ev, ew = lower_times_transposed(inverse, cv), lower_times_transposed(inverse, cw)
        put(work.factors, e, COUPLING, ev)
        put(work.factors, e, COUPLING + 9, ew)
        put(work.factors, e, INVERSE, inverse)
        put(scratch, k, _YH, yh)
        vv, ww = add_gram(vv, -1.0, ev, ev), add_gram(ww, -1.0, ew, ew)
        vw = add_matrix(vw, -1.0, transposed_product(ev, ew))
        pv, pw = minus(pv, transposed_times(ev, yh)), minus(pw, transposed_times(ew, yh))
    put(work.impulses, s, 0, scaled(-1.0, pv))


@summing_device
def _times_cross(m: Matrix, v: Vector) -> Matrix:
    """m [v]x."""
    return (
        m[1] * v[2] - m[2] * v[1],
        m[2] * v[0] - m[0] * v[2],
        m[0] * v[1] - m[1] * v[0],
        m[4] * v[2] - m[5] * v[1],
        m[5] * v[0] - m[3] * v[2],
        m[3] * v[1] - m[4] * v[0],
        m[7] * v[2] - m[8] * v[1],
        m[8] * v[0] - m[6] * v[2],
        m[6] * v[1] - m[7] * v[0],
    )


@summing_device
def _moved_inertia(ww: Symmetric, half: Matrix, shifted: Matrix) -> Symmetric:
    """ww + half^T + shifted, which is symmetric."""
    return (
        ww[0] + half[0] + shifted[0],
        ww[1] + half[3] + shifted[1],
        ww[2] + half[6] + shifted[2],
        ww[3] + half[4] + shifted[4],
        ww[4] + half[7] + shifted[5],
        ww[5] + half[8] + shifted[8],
    )


@summing_device
def _substitute(s: int, rods: Any, work: Any, scratch: Any) -> None:
    """Root to tip: the rates, and the velocities of the quadrature points."""
    begin, end = rods.offsets[s], rods.offsets[s + 1]
    linear, angular = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for e in range(begin, end):
        k = e - begin
        met = plus(
            times(matrix(work.factors, e, COUPLING), linear), times(matrix(work.factors, e, COUPLING + 9), angular)
        )
        x = lower_transposed_times(symmetric(work.factors, e, INVERSE), minus(vector(scratch, k, _YH), met))
        put(work.motion, e, LINEAR, linear)
        put(work.motion, e, ANGULAR, angular)
        put(work.motion, e, RATE, x)
        put(work.rates, e, 0, transposed_times(matrix(work.poses, e, FRAME), x))
        for p in range(N_QUADRATURE):
            moved = times(matrix(scratch, k, _POINT * p), x)
            turned = cross(angular, vector(scratch, k, _POINT * p + 9))
            drift = vector(scratch, k, _POINT * p + 12)
            for i in range(3):
                work.velocities[e, p, i] = drift[i] + linear[i] + turned[i] + moved[i]
        moved = times(matrix(work.links, e, GRADIENT), x)
        turned = cross(angular, vector(work.links, e, OFFSET))
        linear = plus(linear, plus(moved, turned))
        angular = plus(angular, times(matrix(work.links, e, TURN), x))
