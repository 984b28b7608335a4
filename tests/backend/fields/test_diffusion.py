"""Diffusion on voxels: against SciPy's direct solution, analytic fields, and the rules of what is known."""

import numba
import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.fields.diffusion import DiffusionSolver, diffuse
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.linalg import spsolve


def direct(values, fixed, inside, weights):
    """The same equations assembled and solved by SciPy; float64."""
    number = np.arange(fixed.size).reshape(fixed.shape)
    pairs = []
    for axis in range(3):
        ordered = np.moveaxis(number, axis, 0)
        pairs.append(np.stack([ordered[:-1].ravel(), ordered[1:].ravel()]))
    a, b = np.concatenate(pairs, axis=1)
    joined = inside.ravel()[a] & inside.ravel()[b]
    a, b = a[joined], b[joined]
    adjacency = coo_array((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, a])), shape=(fixed.size, fixed.size)).tocsr()
    matrix = csr_array(diags_array(adjacency.sum(axis=1) + weights.ravel()) - adjacency)
    given = values.reshape(fixed.size, -1).astype(np.float64)
    held, free = np.flatnonzero(fixed & inside), np.flatnonzero(inside & ~fixed)
    right = (weights.ravel()[:, None] * given)[free] - matrix[free][:, held] @ given[held]
    out = np.zeros_like(given)
    out[held] = given[held]
    out[free] = spsolve(matrix[free][:, free].tocsc(), right).reshape(len(free), -1)
    return out.reshape(values.shape)


def ball(shape, square=0.9):
    places = np.stack(np.meshgrid(*[np.linspace(-1, 1, n) for n in shape], indexing="ij"), axis=-1)
    return (places**2).sum(axis=-1) < square


@pytest.mark.parametrize("shape", [(21, 16, 19), (17, 9, 30), (12, 1, 7), (5, 5, 5)])
@pytest.mark.parametrize("kind", ["fixed", "masked", "weighted"])
def test_agrees_with_the_direct_solution(shape, kind):
    rng = np.random.default_rng(3)
    inside = np.ones(shape, np.bool_) if kind == "fixed" or min(shape) == 1 else ball(shape)
    fixed = rng.random(shape) < 0.05
    fixed.ravel()[np.flatnonzero(inside)[0]] = True
    weights = np.where(rng.random(shape) < 0.1, 3 * rng.random(shape), 0).astype(np.float32)
    weights = weights if kind == "weighted" else np.zeros_like(weights)
    values = rng.normal(size=(*shape, 2)).astype(np.float32)
    found = diffuse(values, fixed, inside, weights=weights, tolerance=1e-6)
    assert found.converged
    # float32 values of size 3, and a residual of 1e-6 of the right side
    assert np.allclose(found.values, direct(values, fixed, inside, weights), atol=3e-5)


def test_known_faces_give_a_straight_line_between():
    fixed = np.zeros((40, 12, 9), np.bool_)
    fixed[[0, -1]] = True
    values = np.zeros((40, 12, 9, 1), np.float32)
    values[-1] = 1.0
    found = diffuse(values, fixed, tolerance=1e-6)
    # the residual's 1e-6 grows by the smallest eigenvalue, about (pi / 39)^2
    assert np.allclose(found.values[..., 0], (np.arange(40) / 39)[:, None, None], atol=1e-4)


def test_screening_falls_off_like_the_exponential_of_the_lattice():
    # -u'' + w u = 0 on the lattice: u_k = q^k with q + 1/q = 2 + w
    fixed = np.zeros((60, 3, 3), np.bool_)
    fixed[0] = True
    values = np.zeros((60, 3, 3, 1), np.float32)
    values[0] = 1.0
    weight = 0.3
    found = diffuse(values, fixed, weights=np.where(fixed, 0, weight).astype(np.float32), tolerance=1e-6)
    q = 1 + weight / 2 - np.sqrt((1 + weight / 2) ** 2 - 1)
    assert np.allclose(found.values[:30, 1, 1, 0], q ** np.arange(30), atol=1e-5)


def test_few_known_voxels_need_no_more_iterations_than_many():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(64, 48, 40, 1)).astype(np.float32)
    for share in (0.2, 0.01, 0.0001):
        fixed = rng.random((64, 48, 40)) < share
        fixed[5, 5, 5] = True
        assert diffuse(values, fixed).iterations <= 10


def test_what_nothing_known_reaches_is_0_and_walls_separate():
    inside = np.ones((20, 10, 10), np.bool_)
    inside[10] = False
    fixed = np.zeros_like(inside)
    fixed[3, 3, 3] = True
    found = diffuse(np.full((20, 10, 10, 3), 2.0, np.float32), fixed, inside)
    assert np.allclose(found.values[:10], 2.0, atol=1e-4)
    assert not found.values[10:].any()


def test_same_bytes_for_any_number_of_threads():
    rng = np.random.default_rng(1)
    fixed = rng.random((70, 60, 50)) < 0.01
    values = rng.normal(size=(70, 60, 50, 3)).astype(np.float32)
    both = diffuse(values, fixed, ball(fixed.shape)).values.tobytes()
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        one = diffuse(values, fixed, ball(fixed.shape)).values.tobytes()
        assert numba.get_num_threads() == 1
    finally:
        numba.set_num_threads(before)
    assert one == both


def test_a_solver_is_used_again():
    rng = np.random.default_rng(2)
    fixed = rng.random((20, 20, 20)) < 0.05
    first, second = (rng.normal(size=(20, 20, 20, 1)).astype(np.float32) for _ in range(2))
    solver = DiffusionSolver(fixed)
    solver.solve(first)
    assert solver.solve(second).values.tobytes() == diffuse(second, fixed).values.tobytes()


def test_bad_input():
    fixed = np.zeros((4, 4, 4), np.bool_)
    with pytest.raises(InputError, match="no voxel inside has a known value"):
        DiffusionSolver(fixed)
    fixed[0, 0, 0] = True
    with pytest.raises(InputError, match="inside must have shape"):
        DiffusionSolver(fixed, np.ones((4, 4, 5), np.bool_))
    with pytest.raises(InputError, match="weights must be 0 or more"):
        DiffusionSolver(fixed, weights=np.full((4, 4, 4), -1, np.float32))
    with pytest.raises(InputError, match="values must have shape"):
        DiffusionSolver(fixed).solve(np.zeros((4, 4, 3, 1), np.float32))
    with pytest.raises(InputError, match="tolerance is 2"):
        DiffusionSolver(fixed).solve(np.zeros((4, 4, 4, 1), np.float32), tolerance=2)
