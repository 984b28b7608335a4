"""The Bezier spline of the fit: a dense least-squares solve, arc length, equal cuts, C1."""

import numpy as np
import pytest
from hairloom.rods._spline_kernels import _SMOOTHING, _STEADINESS, cut, fit_spline, measure_arcs, merge_points


def hermite(knots, nodes, t):
    """Points (m, 3) of the spline at parameters t (m,), straight from the Bezier control points."""
    k = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
    step = (knots[k + 1] - knots[k])[:, None]
    u = (t[:, None] - knots[k][:, None]) / step
    controls = [nodes[2 * k], nodes[2 * k] + step / 3 * nodes[2 * k + 1]]
    controls += [nodes[2 * k + 2] - step / 3 * nodes[2 * k + 3], nodes[2 * k + 2]]
    weights = [(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3]
    return sum(weight * control for weight, control in zip(weights, controls))


class Fitted:
    def __init__(self, points, samples_per_segment=3):
        count = len(points)
        merged, chords = np.empty((count, 3)), np.empty(count)
        self.n_points = merge_points(points.astype(np.float32), 0, count, merged, chords)
        self.merged, self.chords = merged[: self.n_points], chords[: self.n_points]
        knots, nodes, band = np.empty(count + 1), np.empty((2 * count + 2, 3)), np.empty((2 * count + 2, 4))
        k = fit_spline(merged, chords, self.n_points, samples_per_segment, knots, nodes, band)
        self.arcs, self.speeds = np.empty(k + 1), np.empty((k, 3))
        self.knots, self.nodes, self.n_segments = knots[: k + 1], nodes[: 2 * k + 2], k
        self.length = measure_arcs(self.knots, self.nodes, k, self.arcs, self.speeds)

    def cut(self, n):
        breaks, tangents, parameters = np.empty((n + 1, 3)), np.empty((n + 1, 3)), np.empty(n + 1)
        cut(
            self.knots, self.nodes, self.n_segments, self.arcs, self.speeds, n, breaks, tangents, parameters
        )  # fmt: skip
        return breaks, tangents, parameters


def wave(count=64):
    u = np.linspace(0, 1, count)
    return np.stack([0.3 + 0.02 * np.sin(9 * u), 0.02 * np.cos(7 * u) - 0.1, 1.5 + 0.2 * u], 1)


def fit_naive(fitted):
    """The same minimum by a dense solve over the basis functions, with its penalties by differences and quadrature."""
    size, h = 2 * fitted.n_segments + 2, 1e-4
    basis = []
    for i in range(size):
        nodes = np.zeros((size, 3))
        nodes[i] = 1.0
        basis.append(lambda t, nodes=nodes: hermite(fitted.knots, nodes, t)[:, 0])
    rows = [np.stack([b(fitted.chords) for b in basis], 1)]
    for k in range(fitted.n_segments):
        start, step = fitted.knots[k], np.diff(fitted.knots)[k]
        places, weights = np.polynomial.legendre.leggauss(3)
        t = start + step * (0.5 + 0.45 * places)  # second derivatives are linear: any places within do
        bent = np.stack([(b(t + h * step) - 2 * b(t) + b(t - h * step)) / (h * step) ** 2 for b in basis], 1)
        line = np.linalg.lstsq(np.stack([np.ones(3), 0.45 * places], 1), bent, rcond=None)[0]
        ends = line[0] + 0.5 * places[:, None] * line[1]
        jerk = np.stack([np.diff(b(start + step * np.linspace(0.05, 0.95, 4)), n=3)[0] for b in basis])
        rows.append(np.sqrt(_STEADINESS) * (jerk / 0.3**3)[None])
        rows.append(np.sqrt(_SMOOTHING * step**4 * weights / 2)[:, None] * ends)
    matrix = np.concatenate(rows)
    wanted = np.concatenate([fitted.merged, np.zeros((len(matrix) - fitted.n_points, 3))])
    wanted -= matrix[:, :1] * fitted.merged[0]
    return np.concatenate([fitted.merged[:1], np.linalg.lstsq(matrix[:, 1:], wanted, rcond=None)[0]])


@pytest.mark.parametrize(("count", "samples"), [(64, 3), (16, 3), (10, 2), (4, 3)])
def test_spline_is_the_least_squares_one(count, samples):
    fitted = Fitted(wave(count), samples)
    assert np.array_equal(fitted.nodes[0], fitted.merged[0])
    naive = fit_naive(fitted)
    t = np.linspace(0, fitted.knots[-1], 300)
    # second differences by 1e-4 of a segment leave some 1e-8 of the bending weights
    assert np.abs(hermite(fitted.knots, fitted.nodes, t) - hermite(fitted.knots, naive, t)).max() < 2e-6


def test_a_smooth_strand_is_followed():
    fitted = Fitted(wave())
    near = hermite(fitted.knots, fitted.nodes, fitted.chords) - fitted.merged
    assert np.abs(near).max() < 1e-4


def test_pieces_have_equal_length_and_unit_tangents():
    fitted = Fitted(wave())
    t = np.linspace(0, fitted.knots[-1], 20001)
    dense = hermite(fitted.knots, fitted.nodes, t)
    arcs = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1))])
    assert abs(fitted.length / arcs[-1] - 1) < 1e-4  # Simpson's rule on 21 segments
    breaks, tangents, parameters = fitted.cut(14)
    assert np.abs(np.diff(np.interp(parameters, t, arcs)) / (arcs[-1] / 14) - 1).max() < 1e-3
    assert np.abs(np.linalg.norm(tangents, axis=1) - 1).max() < 1e-14
    assert np.abs(breaks - hermite(fitted.knots, fitted.nodes, parameters)).max() < 1e-14
    inner = parameters[1:-1]
    h = 1e-6
    slope = hermite(fitted.knots, fitted.nodes, inner + h) - hermite(fitted.knots, fitted.nodes, inner - h)
    slope /= np.linalg.norm(slope, axis=1, keepdims=True)
    assert np.abs(slope - tangents[1:-1]).max() < 1e-6


def test_coincident_points_count_once():
    points = wave(20)
    assert np.array_equal(Fitted(np.repeat(points, 4, axis=0)).nodes, Fitted(points).nodes)
    merged, chords = np.empty((5, 3)), np.empty(5)
    assert merge_points(np.ones((5, 3), np.float32), 0, 5, merged, chords) == 1
