"""Natural optimisation: its normal matrix against finite differences, its minimum against SciPy's, known chains."""

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.geometry.strands import from_dense
from hairloom.rods._natural_kernels import (
    _add_penalties,
    _penalty,
    _take_step,
    build_chain,
    linearise,
    place_samples,
    set_columns,
    squared_error,
)
from hairloom.rods.fitting import FitParams, fit_helices
from hairloom.rods.helices import Helices, to_strands
from hairloom.rods.natural import NaturalParams, improve_helices, natural_fit
from hairloom.types import StrandSet
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

FREE = NaturalParams(iterations=400, tolerance=0.0, twist_weight=0.0, bend_weight=0.0, stretch_weight=1e-6)


class Chain:
    """One strand and its samples, for the kernels."""

    def __init__(self, n=3, count=20, seed=0):
        random = np.random.default_rng(seed)
        self.n = n
        self.frame = Rotation.random(random_state=seed).as_matrix()
        self.lengths = random.uniform(0.02, 0.05, n)
        self.scales = self.lengths * 1.1
        self.curvatures = random.normal(0, 20, (n, 3))
        points = np.cumsum(random.normal(0, 0.01, (count, 3)), 0).astype(np.float32)
        self.samples, self.shares = np.empty((count, 3)), np.empty(count)
        place_samples(points, 0, count, n, self.samples, self.shares)
        self.weights = (2e-3, 3e-3, 5e-3)

    def residuals(self, step):
        """All residuals, penalties included, after a step."""
        frame, lengths, curvatures = np.empty((3, 3)), np.empty(self.n), np.empty((self.n, 3))
        _take_step(self.frame, self.lengths, self.curvatures, self.scales, self.n, step, frame, lengths, curvatures)
        found = self.evaluate(frame, lengths, curvatures)[2]
        twist, bend, stretch = np.sqrt(self.weights)
        angles = curvatures * self.scales[:, None] * [twist, bend, bend]
        return np.concatenate([found[:, :3].ravel(), angles.ravel(), stretch * (lengths / self.scales - 1)])

    def evaluate(self, frame, lengths, curvatures):
        starts, frames = np.empty((self.n + 1, 3)), np.empty((self.n + 1, 3, 3))
        build_chain(frame, lengths, curvatures, self.n, starts, frames)
        found = np.empty((len(self.samples), 6))
        squared_error(self.samples, self.shares, len(self.samples), starts, frames, lengths, curvatures, self.n, found)
        return starts, frames, found

    def normal_equations(self):
        starts, frames, found = self.evaluate(self.frame, self.lengths, self.curvatures)
        size = 3 + 4 * self.n
        columns, matrix, slope = np.empty((size, 6)), np.zeros((size, size)), np.empty(size)
        set_columns(starts, frames, self.lengths, self.curvatures, self.scales, self.n, columns)
        work = (np.empty((6, 6)), np.empty(6), np.empty((4, 6)), np.empty((4, 3)))
        linearise(
            self.shares, len(self.samples), found, frames, self.lengths, self.curvatures, self.scales, self.n,
            columns, matrix, slope, work,
        )  # fmt: skip
        _add_penalties(self.curvatures, self.lengths, self.scales, self.n, self.weights, matrix, slope)
        return np.triu(matrix) + np.triu(matrix, 1).T, slope


@pytest.mark.parametrize("n", [1, 2, 5])
def test_normal_matrix_and_gradient_agree_with_finite_differences(n):
    chain = Chain(n)
    size, h = 3 + 4 * n, 1e-6
    jacobian = np.stack(
        [(chain.residuals(h * np.eye(size)[i]) - chain.residuals(-h * np.eye(size)[i])) / (2 * h) for i in range(size)],
        1,
    )
    matrix, slope = chain.normal_equations()
    scale = np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
    # central differences of step 1e-6 on values of about 0.1: some 1e-10
    assert np.abs((matrix - jacobian.T @ jacobian) / scale).max() < 1e-7
    wanted = jacobian.T @ chain.residuals(np.zeros(size))
    assert np.abs(slope - wanted).max() < 1e-7 * np.abs(wanted).max()


def test_penalty_is_that_of_the_residuals():
    chain = Chain(3)
    residuals = chain.residuals(np.zeros(15))[3 * len(chain.samples) :]
    penalty = _penalty(chain.curvatures, chain.lengths, chain.scales, 3, chain.weights)
    assert abs((residuals**2).sum() / penalty - 1) < 1e-12


def test_a_disturbed_chain_finds_back():
    random = np.random.default_rng(2)
    truth = Helices(
        np.zeros((1, 3)), np.eye(3)[None], np.array([0, 3], np.int32), np.full(3, 0.05), random.normal(0, 15, (3, 3))
    )
    strands = to_strands(truth, np.array([301], np.int32))
    disturbed = Helices(
        truth.roots, Rotation.from_rotvec([0.1, 0.1, -0.1]).as_matrix()[None], truth.offsets,
        truth.lengths, truth.curvatures + random.normal(0, 3, (3, 3)),
    )  # fmt: skip
    result = improve_helices(strands, disturbed, FREE)
    # shares are those of a polyline of 300 pieces, points are float32
    assert result.maximum[0] < 1e-5
    turned = np.linalg.norm(result.helices.curvatures[:, 1:], axis=1)
    assert np.abs(turned - np.linalg.norm(truth.curvatures[:, 1:], axis=1)).max() < 0.05
    assert np.abs(result.helices.curvatures[:, 0] - truth.curvatures[:, 0]).max() < 0.05


def test_the_minimum_is_scipys():
    u = np.linspace(0, 1, 40)
    points = np.stack([0.05 * np.sin(4 * u), 0.03 * np.cos(3 * u), 0.1 * u], 1)[None]
    strands = from_dense(points)
    start = fit_helices(strands, FitParams(n_elements=2)).helices
    params = NaturalParams(iterations=300, tolerance=0.0, twist_weight=1e-4, bend_weight=1e-5, stretch_weight=1e-3)
    chain = Chain(2)
    chain.frame, chain.lengths, chain.curvatures = start.frames[0], start.lengths, start.curvatures
    chain.scales = start.lengths
    chain.samples, chain.shares = np.empty((40, 3)), np.empty(40)
    place_samples(strands.points, 0, 40, 2, chain.samples, chain.shares)
    weights = (params.twist_weight, params.bend_weight, params.stretch_weight)
    chain.weights = tuple(np.array(weights) ** 2 * 20)
    wanted = 2 * least_squares(chain.residuals, np.zeros(11), xtol=1e-14, ftol=1e-14, gtol=1e-14).cost
    helices = improve_helices(strands, start, params).helices
    found = chain.evaluate(helices.frames[0], helices.lengths, helices.curvatures)[2]
    cost = (found[:, :3] ** 2).sum()
    cost += _penalty(helices.curvatures, helices.lengths, chain.scales, 2, chain.weights)
    assert cost < wanted * (1 + 1e-6)


def test_distances_only_fall_and_input_stays():
    random = np.random.default_rng(3)
    points = np.cumsum(np.cumsum(random.normal(0, 5e-4, (30, 40, 3)), 1), 1)
    strands = from_dense(points)
    start = fit_helices(strands, FitParams(n_elements=6)).helices
    before = start.curvatures.copy()
    errors = [improve_helices(strands, start, NaturalParams(iterations=i, twist_weight=0)).rms for i in (0, 3, 30)]
    assert (errors[1] <= errors[0] * (1 + 1e-6)).all()
    assert np.mean(errors[2]) < 0.8 * np.mean(errors[0])
    assert np.array_equal(start.curvatures, before)


def test_twist_weight_takes_out_twist():
    strands = from_dense(np.linspace(0, 0.2, 30)[None, :, None] * [[[0.0, 0.6, 0.8]]])
    straight = fit_helices(strands, FitParams(n_elements=3)).helices
    curvatures = straight.curvatures + np.array([40.0, 0.0, 0.0])
    twisted = Helices(straight.roots, straight.frames, straight.offsets, straight.lengths, curvatures)
    params = NaturalParams(twist_weight=1e-4, tolerance=1e-9)
    assert np.abs(improve_helices(strands, twisted, params).helices.curvatures[:, 0]).max() < 1e-3


def test_strands_without_length_and_bad_input():
    strands = StrandSet(np.zeros((3, 3), np.float32), np.array([0, 2, 3], np.int32))
    start = fit_helices(strands).helices
    result = improve_helices(strands, start)
    assert np.array_equal(result.helices.lengths, start.lengths)
    assert result.steps.tolist() == [0, 0]
    with pytest.raises(InputError, match="2 strands of helices for 1 strands"):
        improve_helices(from_dense(np.zeros((1, 2, 3))), start)
    for name, value in (("iterations", -1), ("tolerance", -1.0), ("twist_weight", float("nan"))):
        with pytest.raises(InputError, match=name):
            NaturalParams(**{name: value})


def test_natural_optimisation_from_scratch_follows_waves():
    u = np.linspace(0, 1, 50)
    points = np.stack([0.01 * np.sin(9 * u), 0.01 * np.cos(9 * u), 0.15 * u], 1)[None] * [[[1.0]], [[1.3]]]
    strands = from_dense(points)
    result = natural_fit(strands, 6)
    assert (result.rms < 5e-4).all()
    assert (result.steps > 0).all()
    assert np.array_equal(result.helices.roots.astype(np.float32), strands.roots)
    zero = StrandSet(np.zeros((3, 3), np.float32), np.array([0, 2, 3], np.int32))
    assert natural_fit(zero, 3).helices.element_counts.tolist() == [3, 3]
    with pytest.raises(InputError, match="n_elements is 0"):
        natural_fit(strands, 0)
