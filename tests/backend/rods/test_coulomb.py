"""Coulomb's law: one contact exactly, many by Gauss-Seidel, against the law itself, known cases and slow references."""

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.rods.coulomb import solve_contacts, solve_one_by_one, sort_legs
from scipy.optimize import nnls

GRAVITY, STEP = 9.81, 0.01


def random_matrices(count, condition, seed=0):
    """Symmetric positive definite (count, 3, 3) with eigenvalues from 1 / condition to 1, turned at random."""
    rng = np.random.default_rng(seed)
    turns = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    values = condition ** -rng.uniform(0, 1, (count, 3))
    return np.einsum("cij,cj,ckj->cik", turns, values, turns), rng


def check_law(impulses, velocities, friction, tolerance):
    """Coulomb and Signorini, word for word."""
    normal, tangential = impulses[:, 0], np.linalg.norm(impulses[:, 1:], axis=1)
    assert (normal >= 0).all() and (velocities[:, 0] >= -tolerance).all()
    assert np.abs(normal * velocities[:, 0]).max() <= tolerance * max(normal.max(), 1.0)
    limit = friction * normal
    assert (tangential <= limit * (1 + 1e-9) + 1e-12).all()
    slip = np.linalg.norm(velocities[:, 1:], axis=1)
    sliding = (slip > tolerance) & (normal > 0)
    assert np.allclose(tangential[sliding], limit[sliding], rtol=1e-6)
    # against the slip, along one line with it
    power = np.einsum("ci,ci->c", impulses[:, 1:], velocities[:, 1:])
    assert (power[sliding] <= -limit[sliding] * slip[sliding] * (1 - 1e-9) + tolerance * limit[sliding]).all()
    return sliding


@pytest.mark.parametrize(("condition", "tolerance"), [(1.0, 1e-12), (30.0, 1e-11), (1e5, 1e-6)])
def test_one_contact_obeys_the_law(condition, tolerance):
    # rounding of W r grows with the condition: r is up to condition times b
    matrices, rng = random_matrices(4000, condition, seed=1)
    free, friction = rng.normal(size=(4000, 3)), rng.choice([0.0, 0.1, 0.3, 1.0, 3.0], 4000)
    impulses = solve_one_by_one(matrices, free, friction)
    velocities = np.einsum("cij,cj->ci", matrices, impulses) + free
    sliding = check_law(impulses, velocities, friction, tolerance)
    apart = impulses[:, 0] == 0
    assert apart.sum() > 500 and sliding.sum() > 500 and (~apart & ~sliding).sum() > 100
    assert (apart == (free[:, 0] >= 0)).all()


def test_sliding_agrees_with_a_scan_of_all_slip_rates():
    """Slow reference: alpha with |r_t| = mu r_n found on a fine grid."""
    matrices, rng = random_matrices(40, 8.0, seed=2)
    free = rng.normal(size=(40, 3)) * [1.0, 4.0, 4.0]
    free[:, 0] = -np.abs(free[:, 0])
    friction = np.full(40, 0.3)
    impulses = solve_one_by_one(matrices, free, friction)
    n_sliding = 0
    for w, b, r in zip(matrices, free, impulses, strict=True):
        if np.linalg.norm(r[1:]) < 0.299999 * r[0]:
            continue
        n_sliding += 1
        alphas = np.geomspace(1e-6, 1e6, 20001)
        schur = w[1:, 1:] - np.outer(w[1:, 0], w[0, 1:]) / w[0, 0]
        c = w[1:, 0] * b[0] / w[0, 0] - b[1:]
        tangential = np.linalg.solve(schur + alphas[:, None, None] * np.eye(2), np.tile(c[:, None], (20001, 1, 1)))[
            ..., 0
        ]
        normal = -(b[0] + tangential @ w[0, 1:]) / w[0, 0]
        crossings = np.flatnonzero(np.diff(np.sign(np.linalg.norm(tangential, axis=1) - 0.3 * normal)))
        found = np.column_stack([normal, tangential])[crossings]
        # a step of the grid changes alpha by 0.14 %
        assert np.linalg.norm(found - r, axis=1).min() < 2e-3 * np.linalg.norm(r)
    assert n_sliding > 20


@pytest.mark.parametrize("degrees", [-0.5, -0.01, 0.01, 0.5])
def test_a_block_on_a_slope_slides_above_the_angle_of_friction(degrees):
    friction, mass = 0.3, 0.02
    angle = np.arctan(friction) + np.radians(degrees)
    free = STEP * GRAVITY * np.array([[-np.cos(angle), np.sin(angle), 0.0]])
    impulse = solve_one_by_one(np.eye(3)[None] / mass, free, np.array([friction]))
    speed = free[0, 1] + impulse[0, 1] / mass
    expected = max(STEP * GRAVITY * (np.sin(angle) - friction * np.cos(angle)), 0.0)
    assert speed == pytest.approx(expected, abs=1e-15)
    assert impulse[0, 0] == pytest.approx(mass * STEP * GRAVITY * np.cos(angle), rel=1e-13)


def test_a_contact_that_cannot_move_along_itself():
    """A straight inextensible strand: W is 0 along it, whatever the friction there."""
    w = np.diag([1.0, 1e-300, 1.0])[None]
    impulse = solve_one_by_one(w, np.array([[-1.0, 0.5, 0.2]]), np.array([0.3]))[0]
    assert np.linalg.norm(impulse[1:]) == pytest.approx(0.3 * impulse[0], rel=1e-9)
    assert impulse[0] == pytest.approx(1.0) and impulse[1] < 0 and impulse[2] < 0


# --- many contacts ------------------------------------------------------------------------------------------------


def random_problem(n_strands, per_strand, n_pairs, seed=0, coordinates=24):
    """Contacts of strands with `coordinates` coordinates each: sorted legs, axes, blocks, and the whole W and b."""
    rng = np.random.default_rng(seed)
    first = np.concatenate([np.repeat(np.arange(n_strands), per_strand), rng.integers(0, n_strands, n_pairs)])
    second = np.full(len(first), -1)
    second[len(first) - n_pairs :] = (first[len(first) - n_pairs :] + 1) % n_strands
    legs = sort_legs(first.astype(np.int32), second.astype(np.int32), n_strands)
    axes = np.linalg.qr(rng.normal(size=(len(first), 3, 3)))[0]
    jacobians = rng.normal(size=(len(legs.strands), 3, coordinates))
    blocks, block_offsets = [], [0]
    for s in range(n_strands):
        own = jacobians[legs.offsets[s] : legs.offsets[s + 1]].reshape(-1, coordinates)
        blocks.append((own @ own.T).ravel())
        block_offsets.append(block_offsets[-1] + own.shape[0] ** 2)
    rows = np.zeros((len(first), 3, n_strands * coordinates))
    for c in range(len(first)):
        for side, sign in ((0, 1.0), (1, -1.0)):
            leg = legs.of_contact[c, side]
            if leg >= 0:
                s = legs.strands[leg]
                rows[c, :, s * coordinates : (s + 1) * coordinates] += sign * axes[c] @ jacobians[leg]
    rows = rows.reshape(-1, n_strands * coordinates)
    free = rng.normal(size=(len(first), 3))
    return legs, axes, np.concatenate(blocks), np.array(block_offsets), rows @ rows.T, free


def solve(problem, friction, start=None, **settings):
    legs, axes, blocks, block_offsets, whole, free = problem
    start = np.zeros_like(free) if start is None else start
    impulses, report = solve_contacts(
        legs,
        axes,
        blocks.copy(),
        block_offsets,
        free,
        friction,
        start,
        **{"tolerance": 1e-9, "iterations": 2000} | settings,
    )
    return impulses, (whole @ impulses.ravel()).reshape(-1, 3) + free, report


@pytest.mark.parametrize("n_pairs", [0, 9])
def test_many_contacts_obey_the_law(n_pairs):
    problem = random_problem(12, 3, n_pairs, seed=3)
    friction = np.random.default_rng(4).uniform(0.0, 1.0, len(problem[-1]))
    impulses, velocities, report = solve(problem, friction)
    assert report.converged and report.n_islands == (12 if n_pairs == 0 else report.n_islands) and report.sweeps > 1
    sliding = check_law(impulses, velocities, friction, 1e-8)
    assert sliding.any() and (impulses[:, 0] > 0).sum() > sliding.sum()


def test_without_friction_it_is_the_linear_complementarity_problem():
    """Slow reference: r_n >= 0 that minimises 1/2 r W r + b r, by non-negative least squares on a Cholesky factor."""
    problem = random_problem(3, 4, 5, seed=5, coordinates=40)
    impulses, _, _ = solve(problem, np.zeros(17), tolerance=1e-11)
    whole, free = problem[4][::3, ::3], problem[5][:, 0]
    factor = np.linalg.cholesky(whole)
    expected, _ = nnls(factor.T, -np.linalg.solve(factor, free))
    assert (expected > 0).sum() > 4
    assert np.allclose(impulses[:, 0], expected, atol=1e-10) and (impulses[:, 1:] == 0).all()


def test_solution_as_start_stays_bit_by_bit():
    problem = random_problem(6, 3, 4, seed=6)
    friction = np.full(22, 0.4)
    impulses, _, _ = solve(problem, friction, tolerance=1e-12)
    again, _, report = solve(problem, friction, start=impulses, tolerance=1e-10)
    assert report.sweeps == 0 and again.tobytes() == impulses.tobytes()


def test_independent_strands_do_not_see_each_other():
    problem = random_problem(4, 3, 0, seed=7)
    friction = np.full(12, 0.4)
    impulses, _, _ = solve(problem, friction)
    legs, axes, blocks, block_offsets, whole, free = problem
    louder = free.copy()
    louder[:3] *= 7.0
    others, _, _ = solve((legs, axes, blocks, block_offsets, whole, louder), friction)
    assert others[3:].tobytes() == impulses[3:].tobytes() and not np.allclose(others[:3], impulses[:3])


def test_thread_count_changes_no_bit():
    import numba

    problem = random_problem(12, 3, 9, seed=8)
    friction = np.full(45, 0.4)
    many, _, _ = solve(problem, friction)
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        one, _, _ = solve(problem, friction)
    finally:
        numba.set_num_threads(threads)
    assert one.tobytes() == many.tobytes()


def test_no_contacts_and_bad_shapes():
    legs = sort_legs(np.zeros(0, np.int32), np.zeros(0, np.int32), 5)
    none = np.zeros((0, 3))
    impulses, report = solve_contacts(
        legs, np.zeros((0, 3, 3)), np.zeros(0), np.zeros(6, np.int64), none, np.zeros(0), none
    )
    assert impulses.shape == (0, 3) and report.converged
    with pytest.raises(InputError, match="matrices"):
        solve_one_by_one(np.eye(3)[None], np.zeros((2, 3)), np.zeros(1))
