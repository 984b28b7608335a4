"""Numba kernels of `energies`: quadrature points of rods, and J^T F of forces there, in linear time (M-25)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import prange

from ..kernels import parallel_kernel, summing_device
from ._kinematics_kernels import (
    N_QUADRATURE,
    NODES,
    coefficients,
    element_gradient,
    element_offset,
    element_turn,
    turned_frame,
)
from ._matrix_kernels import (
    Matrix,
    cross,
    dot,
    matrix,
    plus,
    put,
    tangent,
    times,
    transposed_times,
    vector,
)


@summing_device
def _frame_at(frames: Any, s: int) -> Matrix:
    f = frames[s]
    return f[0, 0], f[0, 1], f[0, 2], f[1, 0], f[1, 1], f[1, 2], f[2, 0], f[2, 1], f[2, 2]


@parallel_kernel
def place_quadrature(offsets: Any, lengths: Any, curvatures: Any, roots: Any, frames: Any, points: Any) -> None:
    for s in prange(len(offsets) - 1):
        position, frame = vector(roots, s, 0), _frame_at(frames, s)
        for e in range(offsets[s], offsets[s + 1]):
            u, t = times(frame, vector(curvatures, e, 0)), tangent(frame)
            w, length = math.sqrt(dot(u, u)), lengths[e]
            for p in range(N_QUADRATURE):
                at = NODES[p] * length
                put(points[e], p, 0, plus(position, element_offset(coefficients(w, at), at, t, u)))
            c = coefficients(w, length)
            position = plus(position, element_offset(c, length, t, u))
            frame = turned_frame(c, length, u, frame)


@parallel_kernel
def pull_back(offsets: Any, lengths: Any, curvatures: Any, roots: Any, frames: Any, forces: Any, result: Any) -> None:
    for s in prange(len(offsets) - 1):
        begin, end = offsets[s], offsets[s + 1]
        starts = np.empty((end - begin, 9))
        frame = _frame_at(frames, s)
        for e in range(begin, end):
            put(starts, e - begin, 0, frame)
            u = times(frame, vector(curvatures, e, 0))
            frame = turned_frame(coefficients(math.sqrt(dot(u, u)), lengths[e]), lengths[e], u, frame)
        # force and torque on the element's end from all that hangs on it
        force, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for e in range(end - 1, begin - 1, -1):
            frame = matrix(starts, e - begin, 0)
            u, t = times(frame, vector(curvatures, e, 0)), tangent(frame)
            w, length = math.sqrt(dot(u, u)), lengths[e]
            c = coefficients(w, length)
            load = transposed_times(element_gradient(c, t, u), force)
            load = plus(load, transposed_times(element_turn(c, length, u), torque))
            torque = plus(torque, cross(element_offset(c, length, t, u), force))
            for p in range(N_QUADRATURE):
                at = NODES[p] * length
                c, here = coefficients(w, at), vector(forces[e], p, 0)
                load = plus(load, transposed_times(element_gradient(c, t, u), here))
                torque = plus(torque, cross(element_offset(c, at, t, u), here))
                force = plus(force, here)
            put(result, e, 0, transposed_times(frame, load))
