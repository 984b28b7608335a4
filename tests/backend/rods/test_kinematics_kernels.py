"""One element's kinematics: against integrated frames, finite differences, and across the end of the series."""

from __future__ import annotations

from fractions import Fraction
from math import factorial

import numpy as np
import pytest
from hairloom.rods._kinematics_kernels import (
    N_QUADRATURE,
    NODES,
    WEIGHTS,
    coefficients,
    element_gradient,
    element_offset,
    element_turn,
    turned_frame,
)
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

CURVATURES = [(0.0, 0.0, 0.0), (1e-9, 2e-9, 0.0), (3.0, 0.5, -2.0), (0.0, 70.0, 20.0), (400.0, 100.0, 30.0)]
LENGTH = 0.03
FRAME = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()


def offset(u: np.ndarray, t: np.ndarray, s: float) -> np.ndarray:
    return np.array(element_offset(coefficients(float(np.linalg.norm(u)), s), s, tuple(t), tuple(u)))


def integrated(u: np.ndarray, s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Offset, frame and turn by solving n_i' = u x n_i, r' = n0, W' = exp(s [u]x)."""

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        frame, turn = y[3:12].reshape(3, 3), y[12:21].reshape(3, 3)
        slopes = [np.cross(u, frame, axisb=0, axisc=0), np.cross(u, turn, axisb=0, axisc=0), turn]
        return np.concatenate([frame[:, 0], *(matrix.ravel() for matrix in slopes)])

    start = np.concatenate([np.zeros(3), FRAME.ravel(), np.eye(3).ravel(), np.zeros(9)])
    end = solve_ivp(slope, (0.0, s), start, rtol=1e-12, atol=1e-15, method="DOP853").y[:, -1]
    return end[:3], end[3:12].reshape(3, 3), end[21:].reshape(3, 3)


@pytest.mark.parametrize("q", CURVATURES)
def test_offset_frame_and_turn_are_the_integrals(q: tuple[float, ...]) -> None:
    u = FRAME @ np.array(q)
    c = coefficients(float(np.linalg.norm(u)), LENGTH)
    place, frame, turn = integrated(u, LENGTH)
    # tolerance: the integrator's own, relative to the length
    assert np.allclose(offset(u, FRAME[:, 0], LENGTH), place, atol=1e-10 * LENGTH, rtol=0)
    assert np.allclose(np.reshape(turned_frame(c, LENGTH, tuple(u), tuple(FRAME.ravel())), (3, 3)), frame, atol=1e-10)
    assert np.allclose(np.reshape(element_turn(c, LENGTH, tuple(u)), (3, 3)), turn, atol=1e-10 * LENGTH, rtol=0)


@pytest.mark.parametrize("q", CURVATURES)
def test_gradient_against_finite_differences(q: tuple[float, ...]) -> None:
    u, t = FRAME @ np.array(q), FRAME[:, 0]
    c = coefficients(float(np.linalg.norm(u)), LENGTH)
    gradient = np.reshape(element_gradient(c, tuple(t), tuple(u)), (3, 3))
    step = 1e-3 / LENGTH
    # five points a derivative: the error is 1e-12 of the scale l^2
    weights = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}
    for axis in range(3):
        towards = np.eye(3)[axis] * step
        difference = sum(weight * offset(u + k * towards, t, LENGTH) for k, weight in weights.items()) / step
        assert np.allclose(gradient[:, axis], difference, atol=1e-9 * LENGTH**2, rtol=0)


def exact(angle: float) -> list[float]:
    """The four coefficients at s = 1 by their full series in rational numbers."""
    x = Fraction(angle) ** 2
    sums = [Fraction(0)] * 4
    for k in range(40):
        sign = (-1) ** k
        sums[0] += sign * x**k / factorial(2 * k + 2)
        sums[1] += sign * x**k / factorial(2 * k + 3)
        sums[2] += -sign * x**k * 2 * (k + 1) / factorial(2 * k + 4)
        sums[3] += -sign * x**k * 2 * (k + 1) / factorial(2 * k + 5)
    return [float(value) for value in sums]


@pytest.mark.parametrize("angle", [0.0, 1e-8, 1e-3, 0.5, 1.999999, 2.0, 2.000001, 3.0, 6.0])
def test_coefficients_lose_no_digits_on_either_side_of_the_series_end(angle: float) -> None:
    # 20 units in the last place: the closed form cancels a digit at 2
    assert np.allclose(coefficients(angle, 1.0), exact(angle), rtol=5e-15, atol=0)


def test_coefficients_at_the_start_are_zero() -> None:
    assert coefficients(5.0, 0.0) == (0.0, 0.0, 0.0, 0.0)


def test_quadrature_is_exact_for_degree_five() -> None:
    assert len(NODES) == len(WEIGHTS) == N_QUADRATURE
    for degree in range(6):
        assert np.isclose((WEIGHTS * NODES**degree).sum(), 1 / (degree + 1), rtol=1e-14)
