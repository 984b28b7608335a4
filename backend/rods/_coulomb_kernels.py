"""Numba functions of `coulomb`: the exact solution of one contact, and block Gauss-Seidel over many (B-26, M-26).

A contact's axes are its normal and two tangents, in this order; w.. is its symmetric 3x3 Delassus matrix W, b its
velocity without its own impulse r, so that u = W r + b. The law is Coulomb's with Signorini's condition:
0 <= u_n, 0 <= r_n, u_n r_n = 0, |r_t| <= mu r_n, and r_t = -mu r_n u_t / |u_t| where it slides.
"""

from __future__ import annotations

import math
from typing import Any

import numba

from ..kernels import device, parallel_kernel
from ..types import Float64, Int32, Int64

_NEWTON_STEPS = 80
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
def _leg_velocity(
    leg: int, strand: int, leg_offsets: Int64, blocks: Float64, block_offsets: Int64, impulses: Float64
) -> Any:
    """What the impulses (L, 3) of a strand's legs add to the velocity of one of them."""
    first, last = leg_offsets[strand], leg_offsets[strand + 1]
    row = 3 * (last - first)
    x = y = z = 0.0
    at = block_offsets[strand] + 3 * (leg - first) * row
    for j in range(first, last):
        r0, r1, r2 = impulses[j, 0], impulses[j, 1], impulses[j, 2]
        x += blocks[at] * r0 + blocks[at + 1] * r1 + blocks[at + 2] * r2
        y += blocks[at + row] * r0 + blocks[at + row + 1] * r1 + blocks[at + row + 2] * r2
        z += blocks[at + 2 * row] * r0 + blocks[at + 2 * row + 1] * r1 + blocks[at + 2 * row + 2] * r2
        at += 3
    return x, y, z


@parallel_kernel
def own_matrices(
    legs: Int64, strands: Int32, leg_offsets: Int64, blocks: Float64, block_offsets: Int64, matrices: Float64
) -> None:
    """matrices (c, 3, 3): W of each contact alone, from its one or two legs (c, 2), -1 for none."""
    for c in numba.prange(len(legs)):
        for p in range(2):
            for q in range(2):
                a, b = legs[c, p], legs[c, q]
                if a >= 0 and b >= 0 and strands[a] == strands[b]:
                    s = strands[a]
                    row = 3 * (leg_offsets[s + 1] - leg_offsets[s])
                    at = block_offsets[s] + 3 * (a - leg_offsets[s]) * row + 3 * (b - leg_offsets[s])
                    for i in range(3):
                        for j in range(3):
                            matrices[c, i, j] += blocks[at + i * row + j]


@parallel_kernel
def sweep_islands(
    island_offsets: Int64,
    order: Int64,
    legs: Int64,
    strands: Int32,
    leg_offsets: Int64,
    blocks: Float64,
    block_offsets: Int64,
    matrices: Float64,
    velocities: Float64,
    friction: Float64,
    tolerance: float,
    iterations: int,
    impulses: Float64,
    residuals: Float64,
    sweeps: Int64,
) -> None:
    """Block Gauss-Seidel on each island: contacts order[island_offsets[i]:island_offsets[i + 1]], strands not shared.

    velocities (c, 3) without contacts, bias included; impulses (L, 3) of the legs in contact axes, the start in and the
    result out. residuals (I,), m/s, and sweeps (I,) of the islands. A contact that is right to a tenth of the tolerance
    keeps its impulse bit by bit, so that what rests goes on resting.
    """
    for i in numba.prange(len(island_offsets) - 1):
        for sweep in range(iterations + 1):
            worst = 0.0
            for k in range(island_offsets[i], island_offsets[i + 1]):
                c = order[k]
                a, b = legs[c, 0], legs[c, 1]
                w = matrices[c]
                trace = w[0, 0] + w[1, 1] + w[2, 2]
                if not trace > 0.0:  # at a root nothing moves
                    continue
                u0, u1, u2 = _leg_velocity(a, strands[a], leg_offsets, blocks, block_offsets, impulses)
                if b >= 0:
                    x, y, z = _leg_velocity(b, strands[b], leg_offsets, blocks, block_offsets, impulses)
                    u0, u1, u2 = u0 + x, u1 + y, u2 + z
                u0, u1, u2 = u0 + velocities[c, 0], u1 + velocities[c, 1], u2 + velocities[c, 2]
                r0, r1, r2 = impulses[a, 0], impulses[a, 1], impulses[a, 2]
                wrong = natural_residual(r0, r1, r2, u0, u1, u2, friction[c], trace / 3.0)
                worst = max(worst, wrong)
                if wrong <= 0.1 * tolerance or sweep == iterations:
                    continue
                more = _PROXIMAL * trace
                w00, w11, w22 = w[0, 0] + more, w[1, 1] + more, w[2, 2] + more
                b0 = u0 - w00 * r0 - w[0, 1] * r1 - w[0, 2] * r2
                b1 = u1 - w[0, 1] * r0 - w11 * r1 - w[1, 2] * r2
                b2 = u2 - w[0, 2] * r0 - w[1, 2] * r1 - w22 * r2
                r0, r1, r2 = local_impulse(w00, w[0, 1], w[0, 2], w11, w[1, 2], w22, b0, b1, b2, friction[c])
                impulses[a, 0], impulses[a, 1], impulses[a, 2] = r0, r1, r2
                if b >= 0:
                    impulses[b, 0], impulses[b, 1], impulses[b, 2] = r0, r1, r2
            residuals[i], sweeps[i] = worst, sweep
            if worst <= tolerance:
                break
