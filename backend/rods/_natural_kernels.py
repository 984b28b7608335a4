"""Numba kernels of `natural`: Levenberg-Marquardt steps on all curvatures and lengths of a chain of helices (M-24).

Of a strand of N elements the unknowns are a turn of the root's frame (3), and for each element its curvatures times
its given length (3, radians) and its length over that (1). A change of an unknown moves what comes after the element
like a rigid body: x -> x + a + theta x x, one column (theta, a) of 6 numbers. So the normal matrix needs only sums
over the points after each element, and takes N^2 small products whatever the number of points.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numba import prange

from ..kernels import device, parallel_kernel, summing_device
from ._kinematics_kernels import coefficients, element_gradient, element_offset, element_turn, turned_frame

_CHUNK = 16  # strands that share work arrays; fixed, so that results do not depend on the thread count
_MOST_DAMPING = 1e8
STUB_LENGTH = 1e-4  # metres; shorter strands are not fitted but stand for their roots


@device
def _row(m: Any, v: Any, row: int) -> float:
    return float(m[3 * row] * v[0] + m[3 * row + 1] * v[1] + m[3 * row + 2] * v[2])


@device
def _times(m: Any, v: Any) -> tuple[float, float, float]:
    return _row(m, v, 0), _row(m, v, 1), _row(m, v, 2)


@device
def _flat(frame: Any) -> Any:
    return (
        frame[0, 0], frame[0, 1], frame[0, 2], frame[1, 0], frame[1, 1], frame[1, 2],
        frame[2, 0], frame[2, 1], frame[2, 2],
    )  # fmt: skip


@device
def build_chain(frame: Any, lengths: Any, curvatures: Any, n: int, starts: Any, frames: Any) -> None:
    """Positions (n + 1, 3) from the root and frames (n + 1, 3, 3) at the ends of the elements."""
    for c in range(3):
        starts[0, c] = 0.0
        for j in range(3):
            frames[0, c, j] = frame[c, j]
    for e in range(n):
        f = _flat(frames[e])
        u = _times(f, curvatures[e])
        coefficient = coefficients(sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]), lengths[e])
        moved = element_offset(coefficient, lengths[e], (f[0], f[3], f[6]), u)
        turned = turned_frame(coefficient, lengths[e], u, f)
        for c in range(3):
            starts[e + 1, c] = starts[e, c] + moved[c]
            for j in range(3):
                frames[e + 1, c, j] = turned[3 * c + j]


@device
def squared_error(
    samples: Any, shares: Any, n_samples: int, starts: Any, frames: Any, lengths: Any, curvatures: Any, n: int,
    residuals: Any,
) -> float:  # fmt: skip
    """Sum of the squared distances; residuals (m, 6): chain minus sample, and the chain's point.

    shares (m,) in [0, n]: a sample's element and its place in it as a share.
    """
    total, f, u, w, last = 0.0, _flat(frames[0]), (0.0, 0.0, 0.0), 0.0, -1
    for p in range(n_samples):
        e = min(int(shares[p]), n - 1)
        if e != last:
            f = _flat(frames[e])
            u = _times(f, curvatures[e])
            w, last = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]), e
        s = (shares[p] - e) * lengths[e]
        moved = element_offset(coefficients(w, s), s, (f[0], f[3], f[6]), u)
        for c in range(3):
            point = starts[e, c] + moved[c]
            residuals[p, c], residuals[p, c + 3] = point - samples[p, c], point
            total += residuals[p, c] ** 2
    return total


@device
def _set_column(columns: Any, column: int, theta: Any, move: Any, pivot: Any) -> None:
    """The motion of what comes after pivot: turn theta about it and move, as (theta, a = move - theta x pivot)."""
    for c in range(3):
        i, j = (c + 1) % 3, (c + 2) % 3
        columns[column, c] = theta[c]
        columns[column, c + 3] = move[c] - (theta[i] * pivot[j] - theta[j] * pivot[i])


@device
def set_columns(
    starts: Any, frames: Any, lengths: Any, curvatures: Any, scales: Any, n: int, columns: Any
) -> None:  # fmt: skip
    """columns (3 + 4 n, 6) of what comes after the root, and after each element."""
    zero = (0.0, 0.0, 0.0)
    for c in range(3):
        axis = (1.0 if c == 0 else 0.0, 1.0 if c == 1 else 0.0, 1.0 if c == 2 else 0.0)
        _set_column(columns, c, axis, zero, zero)
    for e in range(n):
        f = _flat(frames[e])
        u = _times(f, curvatures[e])
        coefficient = coefficients(sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]), lengths[e])
        gradient = element_gradient(coefficient, (f[0], f[3], f[6]), u)
        turn = element_turn(coefficient, lengths[e], u)
        scale = scales[e]
        for j in range(3):
            axis = (f[j] / scale, f[j + 3] / scale, f[j + 6] / scale)
            _set_column(columns, 3 + 4 * e + j, _times(turn, axis), _times(gradient, axis), starts[e + 1])
        tip = (frames[e + 1, 0, 0] * scale, frames[e + 1, 1, 0] * scale, frames[e + 1, 2, 0] * scale)
        _set_column(columns, 6 + 4 * e, (u[0] * scale, u[1] * scale, u[2] * scale), tip, starts[e + 1])


@device
def _add_sample(gram: Any, pull: Any, x: float, y: float, z: float, rx: float, ry: float, rz: float) -> None:
    """Add S^T S and S^T r of a point (x, y, z) with the residual r; S (theta, a) = a + theta x point."""
    gram[0, 0] += y * y + z * z
    gram[1, 1] += x * x + z * z
    gram[2, 2] += x * x + y * y
    gram[0, 1] -= x * y
    gram[0, 2] -= x * z
    gram[1, 2] -= y * z
    gram[0, 4] -= z
    gram[0, 5] += y
    gram[1, 3] += z
    gram[1, 5] -= x
    gram[2, 3] -= y
    gram[2, 4] += x
    for c in range(3):
        gram[c + 3, c + 3] += 1.0
    pull[0] += y * rz - z * ry
    pull[1] += z * rx - x * rz
    pull[2] += x * ry - y * rx
    pull[3] += rx
    pull[4] += ry
    pull[5] += rz


@device
def _local_jacobian(s: float, share: float, f: Any, u: Any, w: float, scale: float, jacobian: Any) -> None:
    """(4, 3): how a point inside an element moves with its own unknowns."""
    coefficient = coefficients(w, s)
    gradient = element_gradient(coefficient, (f[0], f[3], f[6]), u)
    turned = turned_frame(coefficient, s, u, f)
    for j in range(3):
        axis = (f[j] / scale, f[j + 3] / scale, f[j + 6] / scale)
        moved = _times(gradient, axis)
        for c in range(3):
            jacobian[j, c] = moved[c]
    for c in range(3):
        jacobian[3, c] = turned[3 * c] * share * scale


@device
def linearise(
    shares: Any, n_samples: int, residuals: Any, frames: Any, lengths: Any, curvatures: Any, scales: Any, n: int,
    columns: Any, matrix: Any, slope: Any, work: Any,
) -> None:  # fmt: skip
    """Normal matrix (upper triangle, (3 + 4 n)^2) and gradient of half the squared distances."""
    gram, pull, local, jacobian = work
    gram[:, :] = 0.0
    pull[:] = 0.0
    p = n_samples - 1
    for e in range(n - 1, -1, -1):
        first = 3 + 4 * e
        # local (4, 6): what the element's own unknowns do to the points from here on, seen as forces on a rigid body
        for j in range(4):
            for c in range(6):
                value = 0.0
                for d in range(6):
                    value += columns[first + j, d] * (gram[d, c] if d <= c else gram[c, d])
                local[j, c] = value
        for i in range(4):
            slope[first + i] = 0.0
            for c in range(6):
                slope[first + i] += columns[first + i, c] * pull[c]
            for j in range(i, 4):
                value = 0.0
                for c in range(6):
                    value += columns[first + i, c] * local[j, c]
                matrix[first + i, first + j] = value
        f = _flat(frames[e])
        u = _times(f, curvatures[e])
        w = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
        while p >= 0 and (e == 0 or shares[p] >= e):
            share = shares[p] - e
            _local_jacobian(share * lengths[e], share, f, u, w, scales[e], jacobian)
            rx, ry, rz = residuals[p, 0], residuals[p, 1], residuals[p, 2]
            x, y, z = residuals[p, 3], residuals[p, 4], residuals[p, 5]
            for i in range(4):
                jx, jy, jz = jacobian[i, 0], jacobian[i, 1], jacobian[i, 2]
                slope[first + i] += jx * rx + jy * ry + jz * rz
                for j in range(i, 4):
                    matrix[first + i, first + j] += jx * jacobian[j, 0] + jy * jacobian[j, 1] + jz * jacobian[j, 2]
                local[i, 0] += y * jz - z * jy
                local[i, 1] += z * jx - x * jz
                local[i, 2] += x * jy - y * jx
                local[i, 3] += jx
                local[i, 4] += jy
                local[i, 5] += jz
            _add_sample(gram, pull, x, y, z, rx, ry, rz)
            p -= 1
        for before in range(first):
            for j in range(4):
                value = 0.0
                for c in range(6):
                    value += columns[before, c] * local[j, c]
                matrix[before, first + j] = value
    for i in range(3):
        slope[i] = pull[i]
        for j in range(i, 3):
            matrix[i, j] = gram[i, j]


@summing_device
def _solve(matrix: Any, damping: float, slope: Any, size: int, factor: Any, step: Any) -> bool:
    """step = -(matrix + damping diag)^-1 slope by Cholesky, matrix in its upper triangle; False if not definite."""
    for i in range(size):
        for j in range(i + 1):
            value = matrix[j, i]
            if i == j:
                value += damping * matrix[i, i] + 1e-18
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            if i == j:
                if not value > 0.0:
                    return False
                factor[i, i] = 1.0 / sqrt(value)
            else:
                factor[i, j] = value * factor[j, j]
    for i in range(size):
        value = -slope[i]
        for k in range(i):
            value -= factor[i, k] * step[k]
        step[i] = value * factor[i, i]
    for i in range(size - 1, -1, -1):
        step[i] *= factor[i, i]
        for k in range(i):
            step[k] -= factor[i, k] * step[i]
    return True


@device
def _add_penalties(
    curvatures: Any, lengths: Any, scales: Any, n: int, weights: Any, matrix: Any, slope: Any
) -> None:  # fmt: skip
    """Derivatives of `_penalty`."""
    twist, bend, stretch = weights
    for e in range(n):
        first = 3 + 4 * e
        for j in range(3):
            weight = twist if j == 0 else bend
            matrix[first + j, first + j] += weight
            slope[first + j] += weight * curvatures[e, j] * scales[e]
        matrix[first + 3, first + 3] += stretch
        slope[first + 3] += stretch * (lengths[e] / scales[e] - 1.0)


@device
def _penalty(curvatures: Any, lengths: Any, scales: Any, n: int, weights: Any) -> float:
    twist, bend, stretch = weights
    total = 0.0
    for e in range(n):
        square = scales[e] * scales[e]
        total += twist * curvatures[e, 0] ** 2 * square
        total += bend * (curvatures[e, 1] ** 2 + curvatures[e, 2] ** 2) * square
        total += stretch * (lengths[e] / scales[e] - 1.0) ** 2
    return total


@device
def _take_step(
    frame: Any, lengths: Any, curvatures: Any, scales: Any, n: int, step: Any,
    new_frame: Any, new_lengths: Any, new_curvatures: Any,
) -> None:  # fmt: skip
    u = (step[0], step[1], step[2])
    angle = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    turned = turned_frame(coefficients(angle, 1.0), 1.0, u, _flat(frame))
    for c in range(3):
        for j in range(3):
            new_frame[c, j] = turned[3 * c + j]
    for e in range(n):
        for j in range(3):
            new_curvatures[e, j] = curvatures[e, j] + step[3 + 4 * e + j] / scales[e]
        # a length at most halves in a step, so it stays above 0
        new_lengths[e] = max(lengths[e] + step[6 + 4 * e] * scales[e], 0.5 * lengths[e])


@device
def _improve(
    strand: Any, frame: Any, lengths: Any, curvatures: Any, n: int, iterations: int, settings: Any, work: Any
) -> tuple[float, int]:  # fmt: skip
    """Steps on one strand, in place; returns the sum of squared distances and the steps taken."""
    samples, shares, n_samples = strand
    weights, tolerance = settings
    starts, frames, residuals, scales, columns, matrix, slope, factor, step, sums, trial = work
    new_frame, new_lengths, new_curvatures = trial
    for e in range(n):
        scales[e] = lengths[e]
    build_chain(frame, lengths, curvatures, n, starts, frames)
    error = squared_error(samples, shares, n_samples, starts, frames, lengths, curvatures, n, residuals)
    cost, damping, size = error + _penalty(curvatures, lengths, scales, n, weights), 1e-3, 3 + 4 * n
    taken = 0
    while taken < iterations and damping < _MOST_DAMPING:
        set_columns(starts, frames, lengths, curvatures, scales, n, columns)
        linearise(
            shares, n_samples, residuals, frames, lengths, curvatures, scales, n, columns, matrix, slope, sums
        )  # fmt: skip
        _add_penalties(curvatures, lengths, scales, n, weights, matrix, slope)
        better = False
        while not better and taken < iterations and damping < _MOST_DAMPING:
            taken += 1
            if _solve(matrix, damping, slope, size, factor, step):
                _take_step(frame, lengths, curvatures, scales, n, step, new_frame, new_lengths, new_curvatures)
                build_chain(new_frame, new_lengths, new_curvatures, n, starts, frames)
                new_error = squared_error(
                    samples, shares, n_samples, starts, frames, new_lengths, new_curvatures, n, residuals
                )  # fmt: skip
                new_cost = new_error + _penalty(new_curvatures, new_lengths, scales, n, weights)
                better = new_cost < cost
            damping = max(0.1 * damping, 1e-9) if better else 10.0 * damping
        if not better:
            break
        gain, cost, error = cost - new_cost, new_cost, new_error
        frame[:, :] = new_frame
        lengths[:n], curvatures[:n] = new_lengths[:n], new_curvatures[:n]
        if gain <= tolerance * cost:
            break
    return error, taken


@parallel_kernel
def improve_strands(
    points: Any, point_offsets: Any, offsets: Any, iterations: int, weights: Any, tolerance: float,
    frames: Any, lengths: Any, curvatures: Any, errors: Any, steps: Any,
) -> None:  # fmt: skip
    """Levenberg-Marquardt on every strand, in place: frames (S, 3, 3), lengths (E,), curvatures (E, 3).

    points (P, 3) float32, point_offsets (S + 1,), offsets (S + 1,) of the elements. weights: of twist and of bending
    (m^2 / rad^2, per point of the strand that an element has) and of stretching (m^2). A strand ends when a step
    gains less than `tolerance` of its cost. Written: errors (S, 2) RMS and maximum distance, m; steps (S,) taken.
    Strands too short for a shape keep theirs, and their errors.
    """
    n_strands = offsets.shape[0] - 1
    for chunk in prange((n_strands + _CHUNK - 1) // _CHUNK):
        low, high = chunk * _CHUNK, min((chunk + 1) * _CHUNK, n_strands)
        most, n_most = 1, 1
        for s in range(low, high):
            most = max(most, point_offsets[s + 1] - point_offsets[s])
            n_most = max(n_most, offsets[s + 1] - offsets[s])
        size = 3 + 4 * n_most
        samples, shares, residuals = np.empty((most, 3)), np.empty(most), np.empty((most, 6))
        work = (
            np.empty((n_most + 1, 3)), np.empty((n_most + 1, 3, 3)), residuals, np.empty(n_most), np.empty((size, 6)),
            np.empty((size, size)), np.empty(size), np.empty((size, size)), np.empty(size),
            (np.empty((6, 6)), np.empty(6), np.empty((4, 6)), np.empty((4, 3))),
            (np.empty((3, 3)), np.empty(n_most), np.empty((n_most, 3))),
        )  # fmt: skip
        for s in range(low, high):
            first, count = point_offsets[s], point_offsets[s + 1] - point_offsets[s]
            e, n = offsets[s], offsets[s + 1] - offsets[s]
            steps[s] = 0
            if place_samples(points, first, count, n, samples, shares) < STUB_LENGTH:
                continue  # errors stay as they are
            per_point = count / n
            scaled = (weights[0] * per_point, weights[1] * per_point, weights[2] * per_point)
            error, steps[s] = _improve(
                (samples, shares, count), frames[s], lengths[e : e + n], curvatures[e : e + n], n, iterations,
                (scaled, tolerance), work,
            )  # fmt: skip
            build_chain(frames[s], lengths[e : e + n], curvatures[e : e + n], n, work[0], work[1])
            squared_error(
                samples, shares, count, work[0], work[1], lengths[e : e + n], curvatures[e : e + n], n, residuals
            )  # fmt: skip
            errors[s, 0] = sqrt(error / count)
            largest = 0.0
            for p in range(count):
                largest = max(largest, residuals[p, 0] ** 2 + residuals[p, 1] ** 2 + residuals[p, 2] ** 2)
            errors[s, 1] = sqrt(largest)


@device
def place_samples(points: Any, first: int, count: int, n: int, samples: Any, shares: Any) -> float:
    """A strand's points from its root into samples (m, 3), shares (m,) of the polyline's length times n; the length."""
    shares[0] = 0.0
    for p in range(count):
        square = 0.0
        for c in range(3):
            samples[p, c] = float(points[first + p, c]) - float(points[first, c])
            if p > 0:
                square += (samples[p, c] - samples[p - 1, c]) ** 2
        if p > 0:
            shares[p] = shares[p - 1] + sqrt(square)
    total = shares[count - 1]
    for p in range(count):
        shares[p] = min(shares[p] / total * n, float(n)) if total > 0.0 else 0.0
    return float(total)
