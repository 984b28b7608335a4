"""Numba functions of `coulomb`: the exact solution of one contact, and block Gauss-Seidel over many (B-26, M-26).

A contact's axes are its normal and two tangents, in this order; w.. is its symmetric 3x3 Delassus matrix W, b its
velocity without its own impulse r, so that u = W r + b. The law is Coulomb's with Signorini's condition:
0 <= u_n, 0 <= r_n, u_n r_n = 0, |r_t| <= mu r_n, and r_t = -mu r_n u_t / |u_t| where it slides.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np

from ..kernels import device, parallel_kernel
from ..types import Float64, Int64

_NEWTON_STEPS = 80  # of the local problem
# Of an island: sweeps before each try, steps in a try, contacts at most (its matrix is dense).
_SWEEPS, _NEWTON_TRIES, _NEWTON_CONTACTS = 5, 8, 40
# Of W's trace; keeps the local matrices regular where a straight strand cannot move along itself. It stands beside the
# old impulse (a proximal term), so that it slows the sweeps down there but does not change what they converge to.
_PROXIMAL = 1e-6


@device
def _sliding_impulse(
    w00: float, w01: float, w02: float, s11: float, s12: float, s22: float, b0: float, c1: float, c2: float, mu: float
) -> Any:
    """(r_n, r_1, r_2) of a contact that slides: u_n = 0 and u_t = -alpha r_t for the alpha > 0 where |r_t| = mu r_n.

    With u_n eliminated (S + alpha I) r_t = c, S = W_tt - W_tn W_nt / W_nn. mu r_n / |r_t| - 1 is below 0 at alpha = 0
    (else it would stick) and above 0 for a large alpha since b_n < 0, so there is a root, which Newton finds within
    that bracket. That function is linear in alpha if S is isotropic and r_t does not change r_n.
    """
    # along the axes of S
    half, mean = 0.5 * (s11 - s22), 0.5 * (s11 + s22)
    spread = math.hypot(half, s12)
    cosine, sine = 1.0, 0.0
    if spread > 0.0:
        angle = 0.5 * math.atan2(s12, half)
        cosine, sine = math.cos(angle), math.sin(angle)
    large, small = mean + spread, max(mean - spread, 0.0)
    d1, d2 = cosine * c1 + sine * c2, cosine * c2 - sine * c1
    v1, v2 = cosine * w01 + sine * w02, cosine * w02 - sine * w01
    # where |r_t| would be mu times the frictionless r_n, were S isotropic
    alpha = max(-math.hypot(d1, d2) * w00 / (mu * b0) - mean, 1e-9 * large)
    low, high = 0.0, math.inf
    normal = t1 = t2 = 0.0
    for _ in range(_NEWTON_STEPS):
        e1, e2 = large + alpha, small + alpha
        t1, t2 = d1 / e1, d2 / e2
        normal = -(b0 + v1 * t1 + v2 * t2) / w00
        size = math.hypot(t1, t2)
        value = mu * normal / size - 1.0
        if value > 0.0:
            high = alpha
        else:
            low = alpha
        if abs(value) <= 1e-14 or (high < math.inf and high - low <= 1e-15 * high):
            break
        change_of_normal = (v1 * t1 / e1 + v2 * t2 / e2) / w00
        change_of_size = -(t1 * t1 / e1 + t2 * t2 / e2) / size
        slope = mu * (change_of_normal * size - normal * change_of_size) / (size * size)
        alpha = alpha - value / slope if slope > 0.0 else -1.0
        if not low < alpha < high:
            alpha = 2.0 * low + large if high == math.inf else 0.5 * (low + high)
    return normal, cosine * t1 - sine * t2, sine * t1 + cosine * t2


@device
def local_impulse(
    w00: float, w01: float, w02: float, w11: float, w12: float, w22: float, b0: float, b1: float, b2: float, mu: float
) -> Any:
    """(r_n, r_1, r_2): the exact impulse of one contact; it takes off, sticks, or slides (Daviet 2011, sec. 4).

    W must be positive definite. It takes off whenever it can; where b_n < 0 an impulse always exists.
    """
    if b0 >= 0.0:
        return 0.0, 0.0, 0.0
    if mu <= 0.0:
        return -b0 / w00, 0.0, 0.0
    s11, s12, s22 = w11 - w01 * w01 / w00, w12 - w01 * w02 / w00, w22 - w02 * w02 / w00
    c1, c2 = w01 * b0 / w00 - b1, w02 * b0 / w00 - b2
    determinant = s11 * s22 - s12 * s12
    if determinant > 0.0:
        t1, t2 = (s22 * c1 - s12 * c2) / determinant, (s11 * c2 - s12 * c1) / determinant
        normal = -(b0 + w01 * t1 + w02 * t2) / w00
        if math.hypot(t1, t2) <= mu * normal:
            return normal, t1, t2
    elif c1 == 0.0 and c2 == 0.0:
        return -b0 / w00, 0.0, 0.0
    return _sliding_impulse(w00, w01, w02, s11, s12, s22, b0, c1, c2, mu)


@device
def natural_residual(r0: float, r1: float, r2: float, u0: float, u1: float, u2: float, mu: float, scale: float) -> Any:
    """How far (r, u) is from Coulomb's law, m/s: |r - P(r - u'/scale)| scale, P on the cone |r_t| <= mu r_n.

    u' = u + mu |u_t| n is de Saxce's change of variable, with which the law is complementarity of r and u' in the cone
    and its dual; scale, m/s per N s, makes a velocity of it.
    """
    n, x, y = r0 - (u0 + mu * math.hypot(u1, u2)) / scale, r1 - u1 / scale, r2 - u2 / scale
    size = math.hypot(x, y)
    if size > mu * n:
        if mu * size <= -n:
            n = x = y = 0.0
        else:
            n = (n + mu * size) / (1.0 + mu * mu)
            shorter = mu * n / size
            x, y = shorter * x, shorter * y
    return math.sqrt((r0 - n) ** 2 + (r1 - x) ** 2 + (r2 - y) ** 2) * scale


class System(NamedTuple):
    """c contacts with L legs, sorted by strand, and what they do to each other, in the contacts' axes.

    legs (c, 2) int64, -1 for none. strands (L,) int32. leg_offsets, block_offsets (S + 1,) int64. blocks: each
    strand's (3 k, 3 k) in rows. matrices (c, 3, 3): W of each contact alone; traces (c,) of these. velocities (c, 3)
    without impulses, bias included. friction (c,).
    """

    legs: Any
    strands: Any
    leg_offsets: Any
    blocks: Any
    block_offsets: Any
    matrices: Any
    traces: Any
    velocities: Any
    friction: Any


@parallel_kernel
def local_impulses(matrices: Float64, velocities: Float64, friction: Float64, impulses: Float64) -> None:
    """impulses (c, 3) of unrelated contacts with W (c, 3, 3), b (c, 3) and mu (c,)."""
    for c in numba.prange(len(matrices)):
        w, b = matrices[c], velocities[c]
        impulses[c, 0], impulses[c, 1], impulses[c, 2] = local_impulse(
            w[0, 0], w[0, 1], w[0, 2], w[1, 1], w[1, 2], w[2, 2], b[0], b[1], b[2], friction[c]
        )


@parallel_kernel
def turn_blocks(blocks: Float64, block_offsets: Int64, leg_offsets: Int64, axes: Float64) -> None:
    """Turn each strand's blocks (3k, 3k), in place, from world axes to axes (L, 3, 3) of the legs, which are rows."""
    for s in numba.prange(len(leg_offsets) - 1):
        first, count = leg_offsets[s], leg_offsets[s + 1] - leg_offsets[s]
        row = 3 * count
        for i in range(count):
            for j in range(count):
                at = block_offsets[s] + 3 * i * row + 3 * j
                f, g = axes[first + i], axes[first + j]
                d00, d01, d02 = blocks[at], blocks[at + 1], blocks[at + 2]
                d10, d11, d12 = blocks[at + row], blocks[at + row + 1], blocks[at + row + 2]
                d20, d21, d22 = blocks[at + 2 * row], blocks[at + 2 * row + 1], blocks[at + 2 * row + 2]
                for a in range(3):
                    x = f[a, 0] * d00 + f[a, 1] * d10 + f[a, 2] * d20
                    y = f[a, 0] * d01 + f[a, 1] * d11 + f[a, 2] * d21
                    z = f[a, 0] * d02 + f[a, 1] * d12 + f[a, 2] * d22
                    for b in range(3):
                        blocks[at + a * row + b] = x * g[b, 0] + y * g[b, 1] + z * g[b, 2]


@device
def _leg_velocity(system: Any, leg: int, impulses: Float64) -> Any:
    """What the impulses (L, 3) of a strand's legs add to the velocity of one of them."""
    strand, blocks = system.strands[leg], system.blocks
    first, last = system.leg_offsets[strand], system.leg_offsets[strand + 1]
    row = 3 * (last - first)
    x = y = z = 0.0
    at = system.block_offsets[strand] + 3 * (leg - first) * row
    for j in range(first, last):
        r0, r1, r2 = impulses[j, 0], impulses[j, 1], impulses[j, 2]
        if r0 != 0.0:  # without a normal impulse there is no friction either
            x += blocks[at] * r0 + blocks[at + 1] * r1 + blocks[at + 2] * r2
            y += blocks[at + row] * r0 + blocks[at + row + 1] * r1 + blocks[at + row + 2] * r2
            z += blocks[at + 2 * row] * r0 + blocks[at + 2 * row + 1] * r1 + blocks[at + 2 * row + 2] * r2
        at += 3
    return x, y, z


@device
def _velocity(system: Any, c: int, impulses: Float64) -> Any:
    """(u_n, u_1, u_2) of contact c under the impulses (L, 3) of the legs."""
    a, b = system.legs[c, 0], system.legs[c, 1]
    u0, u1, u2 = _leg_velocity(system, a, impulses)
    if b >= 0:
        x, y, z = _leg_velocity(system, b, impulses)
        u0, u1, u2 = u0 + x, u1 + y, u2 + z
    return u0 + system.velocities[c, 0], u1 + system.velocities[c, 1], u2 + system.velocities[c, 2]


@device
def _put(system: Any, c: int, r0: float, r1: float, r2: float, impulses: Float64) -> None:
    for side in range(2):
        leg = system.legs[c, side]
        if leg >= 0:
            impulses[leg, 0], impulses[leg, 1], impulses[leg, 2] = r0, r1, r2


@device
def _residual(system: Any, c: int, u0: float, u1: float, u2: float, impulses: Float64) -> Any:
    a, scale = system.legs[c, 0], system.traces[c] / 3.0
    return natural_residual(impulses[a, 0], impulses[a, 1], impulses[a, 2], u0, u1, u2, system.friction[c], scale)


@device
def _sweep(system: Any, members: Int64, tolerance: float, impulses: Float64) -> float:
    """One pass of Gauss-Seidel over an island; returns the worst residual met, before the contact's own update."""
    worst = 0.0
    for c in members:
        if not system.traces[c] > 0.0:  # at a root nothing moves
            continue
        u0, u1, u2 = _velocity(system, c, impulses)
        wrong = _residual(system, c, u0, u1, u2, impulses)
        worst = max(worst, wrong)
        if wrong <= 0.1 * tolerance:
            continue
        w, a, more = system.matrices[c], system.legs[c, 0], _PROXIMAL * system.traces[c]
        r0, r1, r2 = impulses[a, 0], impulses[a, 1], impulses[a, 2]
        w00, w11, w22 = w[0, 0] + more, w[1, 1] + more, w[2, 2] + more
        b0 = u0 - w00 * r0 - w[0, 1] * r1 - w[0, 2] * r2
        b1 = u1 - w[0, 1] * r0 - w11 * r1 - w[1, 2] * r2
        b2 = u2 - w[0, 2] * r0 - w[1, 2] * r1 - w22 * r2
        r0, r1, r2 = local_impulse(w00, w[0, 1], w[0, 2], w11, w[1, 2], w22, b0, b1, b2, system.friction[c])
        _put(system, c, r0, r1, r2, impulses)
    return worst


@device
def _couple(system: Any, c: int, d: int, block: Float64) -> None:
    """block (3, 3): what a unit impulse at contact d does to the velocity of contact c."""
    block[:] = 0.0
    for p in range(2):
        for q in range(2):
            a, b = system.legs[c, p], system.legs[d, q]
            if a >= 0 and b >= 0 and system.strands[a] == system.strands[b]:
                s = system.strands[a]
                first, row = system.leg_offsets[s], 3 * (system.leg_offsets[s + 1] - system.leg_offsets[s])
                at = system.block_offsets[s] + 3 * (a - first) * row + 3 * (b - first)
                for i in range(3):
                    for j in range(3):
                        block[i, j] += system.blocks[at + i * row + j]


@device
def _solve_dense(matrix: Float64, right: Float64) -> bool:
    """Gauss elimination with pivots, in place; right (n,) becomes the solution. False where the matrix is singular."""
    n = len(right)
    for i in range(n):
        pivot = i
        for k in range(i + 1, n):
            if abs(matrix[k, i]) > abs(matrix[pivot, i]):
                pivot = k
        if not abs(matrix[pivot, i]) > 0.0:
            return False
        if pivot != i:
            for j in range(i, n):
                matrix[i, j], matrix[pivot, j] = matrix[pivot, j], matrix[i, j]
            right[i], right[pivot] = right[pivot], right[i]
        for k in range(i + 1, n):
            factor = matrix[k, i] / matrix[i, i]
            if factor != 0.0:
                for j in range(i + 1, n):
                    matrix[k, j] -= factor * matrix[i, j]
                right[k] -= factor * right[i]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            right[i] -= matrix[i, j] * right[j]
        right[i] /= matrix[i, i]
    return True


@device
def _newton_rows(system: Any, active: Int64, k: int, impulses: Float64, matrix: Float64, right: Float64) -> None:
    """The three rows of contact active[k] in a Newton step on Alart and Curnier's function.

    u_n = 0, and u_t = 0 where it sticks; else r_t = mu r_n z/|z| with z = r_t - rho u_t, linearised.
    """
    c, i = active[k], 3 * k
    a, mu, rho = system.legs[c, 0], system.friction[c], 3.0 / system.traces[c]
    u0, u1, u2 = _velocity(system, c, impulses)
    block = np.empty((3, 3))
    for m in range(len(active)):
        _couple(system, c, active[m], block)
        matrix[i : i + 3, 3 * m : 3 * m + 3] = block
    for j in range(3):
        matrix[i + j, i + j] += _PROXIMAL * system.traces[c]
    right[i], right[i + 1], right[i + 2] = -u0, -u1, -u2
    r0, r1, r2 = impulses[a, 0], impulses[a, 1], impulses[a, 2]
    limit = mu * max(r0 - rho * u0, 0.0)
    z1, z2 = r1 - rho * u1, r2 - rho * u2
    size = math.hypot(z1, z2)
    if size <= limit:
        return
    z1, z2, share = z1 / size, z2 / size, limit / size
    p11, p12, p22 = share * (1.0 - z1 * z1), -share * z1 * z2, share * (1.0 - z2 * z2)
    for j in range(3 * len(active)):
        v1, v2 = rho * matrix[i + 1, j], rho * matrix[i + 2, j]
        matrix[i + 1, j], matrix[i + 2, j] = p11 * v1 + p12 * v2, p12 * v1 + p22 * v2
    matrix[i + 1, i] -= mu * z1
    matrix[i + 2, i] -= mu * z2
    matrix[i + 1, i + 1] += 1.0 - p11
    matrix[i + 1, i + 2] -= p12
    matrix[i + 2, i + 1] -= p12
    matrix[i + 2, i + 2] += 1.0 - p22
    right[i + 1], right[i + 2] = mu * r0 * z1 - r1, mu * r0 * z2 - r2


@device
def _newton(system: Any, members: Int64, tolerance: float, impulses: Float64) -> float:
    """Newton steps on the contacts of an island that press; impulses end at the best met, whose residual is returned.

    Gauss-Seidel needs hundreds of sweeps where neighbours on one strand press: a push at one is nearly one at the
    next. It finds out soon though which contacts press, stick and slide, and then few of these steps are exact.
    """
    kept, best = np.empty((len(members), 3)), math.inf
    pressing = np.empty(len(members), np.int64)
    for _ in range(_NEWTON_TRIES):
        worst, count = 0.0, 0
        for c in members:
            if system.traces[c] > 0.0:
                u0, u1, u2 = _velocity(system, c, impulses)
                worst = max(worst, _residual(system, c, u0, u1, u2, impulses))
                if impulses[system.legs[c, 0], 0] * system.traces[c] > 3.0 * u0:
                    pressing[count] = c
                    count += 1
        if worst < best:
            best = worst
            for k in range(len(members)):
                kept[k] = impulses[system.legs[members[k], 0]]
        if worst <= 0.1 * tolerance or count == 0 or count > _NEWTON_CONTACTS:
            break
        active = pressing[:count]
        k = 0
        for c in members:
            if k < count and c == active[k]:
                k += 1
            else:
                _put(system, c, 0.0, 0.0, 0.0, impulses)
        matrix, right = np.empty((3 * count, 3 * count)), np.empty(3 * count)
        for k in range(count):
            _newton_rows(system, active, k, impulses, matrix, right)
        if not _solve_dense(matrix, right):
            break
        for k in range(count):
            c = active[k]
            a = system.legs[c, 0]
            r0, r1, r2 = (
                impulses[a, 0] + right[3 * k],
                impulses[a, 1] + right[3 * k + 1],
                impulses[a, 2] + right[3 * k + 2],
            )
            r0 = max(r0, 0.0)
            size, limit = math.hypot(r1, r2), system.friction[c] * r0
            if size > limit:
                r1, r2 = r1 * limit / size, r2 * limit / size
            _put(system, c, r0, r1, r2, impulses)
    for k in range(len(members)):
        _put(system, members[k], kept[k, 0], kept[k, 1], kept[k, 2], impulses)
    return best


@parallel_kernel
def solve_islands(
    system: Any,
    island_offsets: Int64,
    order: Int64,
    tolerance: float,
    iterations: int,
    impulses: Float64,
    residuals: Float64,
    sweeps: Int64,
) -> None:
    """Contacts of each island order[island_offsets[i]:island_offsets[i + 1]]: sweeps of Gauss-Seidel, and Newton.

    impulses (L, 3) of the legs in contact axes, the start in and the result out. residuals (I,), m/s, and sweeps (I,).
    A contact that is right to a tenth of the tolerance keeps its impulse bit by bit: what rests goes on resting.
    """
    for i in numba.prange(len(island_offsets) - 1):
        members = order[island_offsets[i] : island_offsets[i + 1]]
        worst, done = math.inf, 0
        while done < iterations:
            worst = _sweep(system, members, tolerance, impulses)
            if worst <= tolerance:
                break
            done += 1
            if done % _SWEEPS == 0 or done == iterations:
                worst = _newton(system, members, tolerance, impulses)
                if worst <= tolerance:
                    break
        residuals[i], sweeps[i] = worst, done
        # where strands in a bundle do not agree in time, they rather come into each other than into a solid
        on_solid = members[system.legs[members, 1] < 0]
        if worst > tolerance and len(on_solid) < len(members):
            for _ in range(_SWEEPS):
                if _sweep(system, on_solid, tolerance, impulses) <= tolerance:
                    break


@parallel_kernel
def own_matrices(system: Any) -> None:
    """Fill the system's matrices."""
    for c in numba.prange(len(system.legs)):
        _couple(system, c, c, system.matrices[c])
