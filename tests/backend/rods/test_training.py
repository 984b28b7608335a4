"""Trained weights: the best there are (SLSQP, exact cases), better than by distance on motion not seen, bad input."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest
from follower_hair import as_strands, hair_on_sphere, swayed
from hairloom.errors import Cancelled, InputError
from hairloom.rods._training_kernels import solve_weights
from hairloom.rods.helices import evaluate
from hairloom.rods.interpolation import FollowerParams, bind_followers, interpolate
from hairloom.rods.material import MaterialParams
from hairloom.rods.training import TrainingFrame, fit_weights, join_helices, simulated_motion, train_followers
from hairloom.types import StrandSet
from scipy.optimize import minimize

PARAMS = FollowerParams(n_neighbours=5, n_samples=17, n_knots=5)
N_GUIDES, N_STRANDS = 150, 120


@pytest.fixture(scope="module")
def guides():
    return hair_on_sphere(N_GUIDES, seed=1)


@pytest.fixture(scope="module")
def hair():
    return hair_on_sphere(N_STRANDS, seed=2)


@pytest.fixture(scope="module")
def followers(guides, hair):
    return bind_followers(as_strands(hair, PARAMS.n_samples), guides, PARAMS)


def motion(guides, hair, times):
    return [
        TrainingFrame(
            *evaluate(swayed(guides, seconds), PARAMS.n_samples), evaluate(swayed(hair, seconds), PARAMS.n_samples)[0]
        )
        for seconds in times
    ]


def error(followers, frames):
    """Root mean square distance of the followers to the hairs, metres, over the frames and all points."""
    squares = []
    for frame in frames:
        out = np.empty_like(followers.points)
        interpolate(followers, frame.points, frame.frames, out)
        squares.append(((out.reshape(frame.hairs.shape) - frame.hairs) ** 2).sum(axis=2).mean())
    return float(np.sqrt(np.mean(squares)))


def everyone(followers):
    return np.arange(followers.n_strands, dtype=np.int32)


@pytest.mark.parametrize("count", [1, 2, 4, 6, 8])
def test_the_least_on_the_simplex_as_slsqp_finds_it(count):
    rng = np.random.default_rng(count)
    vectors = rng.normal(size=(30, 1, count, 6)) + rng.normal(size=(30, 1, 1, 6))
    products = np.ascontiguousarray(vectors @ vectors.transpose(0, 1, 3, 2))
    prior = rng.dirichlet(np.ones(count), (30, 1)).astype(np.float32)
    found = np.empty_like(prior)
    solve_weights(products, prior, 0.01, found)
    for matrix, start, weights in zip(products[:, 0], prior[:, 0].astype(float), found[:, 0].astype(float)):
        hold = 0.01 * np.trace(matrix) / count

        def cost(w, matrix=matrix, start=start, hold=hold):
            return w @ matrix @ w + hold * ((w - start) ** 2).sum()

        slow = minimize(
            cost, start, bounds=[(0, 1)] * count, constraints={"type": "eq", "fun": lambda w: w.sum() - 1},
            method="SLSQP", options={"ftol": 1e-14, "maxiter": 500},
        ).x  # fmt: skip
        assert weights.min() >= 0 and abs(weights.sum() - 1) < 1e-6
        # SLSQP stops a little short; float32 of the weights
        assert cost(weights) <= cost(slow) * (1 + 1e-6)
        np.testing.assert_allclose(weights, slow, atol=1e-3)


def test_weights_that_made_the_motion_are_found(guides, followers):
    """Hair that is moved by known weights, some of them 0, gives them back where its guides move differently."""
    rng = np.random.default_rng(5)
    weights = rng.dirichlet(np.ones(5), (N_STRANDS, 1)).astype(np.float32)
    weights[:, :, 2] = 0.0
    weights = np.ascontiguousarray(
        np.broadcast_to(weights / weights.sum(axis=2, keepdims=True), followers.weights.shape)
    )
    truth = replace(followers, weights=weights)
    frames = []
    for seconds in np.linspace(0.1, 2.0, 12):
        now = evaluate(swayed(guides, seconds), PARAMS.n_samples)
        turns = np.einsum("gmij,gmkj->gmik", now[1], truth.guide_frames)
        rest = truth.points.reshape(N_STRANDS, -1, 3).astype(float)
        carried = (
            np.einsum("skmij,skmj->skmi", turns[truth.guides], rest[:, None] - truth.guide_points[truth.guides])
            + now[0][truth.guides]
        )
        frames.append(TrainingFrame(*now, np.einsum("sk,skmi->smi", weights[:, 0].astype(float), carried)))
    found = fit_weights(followers, everyone(followers), rest, frames, 1e-9).weights
    # not at the root, where all guides say the same
    np.testing.assert_allclose(found[:, 1:], weights[:, 1:], atol=2e-3)


def test_trained_weights_are_better_on_motion_not_seen(guides, hair, followers):
    rest = evaluate(hair, PARAMS.n_samples)[0]
    trained = fit_weights(followers, everyone(followers), rest, motion(guides, hair, np.linspace(0.1, 1.0, 10)), 0.02)
    unseen = motion(guides, hair, np.linspace(1.33, 3.0, 10))
    assert error(trained, unseen) < 0.7 * error(followers, unseen)
    assert trained.weights.min() >= 0
    np.testing.assert_allclose(trained.weights.sum(axis=2), 1.0, atol=1e-6)


def test_a_strong_ridge_keeps_the_weights_and_others_are_left_alone(guides, hair, followers):
    frames = motion(guides, hair, (0.3, 0.8))
    rest = evaluate(hair, PARAMS.n_samples)[0]
    held = fit_weights(followers, everyone(followers), rest, frames, 1e5)
    np.testing.assert_allclose(held.weights, followers.weights, atol=1e-4)
    few = np.array([3, 17], np.int32)
    some = fit_weights(followers, few, rest[few], [replace(frame, hairs=frame.hairs[few]) for frame in frames], 0.02)
    changed = (some.weights != followers.weights).any(axis=(1, 2))
    assert changed[few].all() and changed.sum() == 2


def test_same_bytes_for_any_number_of_threads(guides, hair, followers):
    frames, rest = motion(guides, hair, (0.3, 0.8)), evaluate(hair, PARAMS.n_samples)[0]
    before, results = numba.get_num_threads(), []
    try:
        for threads in (1, before):
            numba.set_num_threads(threads)
            results.append(fit_weights(followers, everyone(followers), rest, frames, 0.02).weights.tobytes())
    finally:
        numba.set_num_threads(before)
    assert results[0] == results[1]


# --- with the simulation ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def settings():
    return replace(PARAMS, training_strands=60, training_frames=8)


def test_training_by_simulation(guides, hair, followers, settings):
    """Closer to hairs that are simulated themselves, over a longer motion than that of the training."""
    strands = as_strands(hair, PARAMS.n_samples)
    trained = train_followers(followers, strands, guides, MaterialParams(), settings)
    changed = (trained.weights != followers.weights).any(axis=(1, 2))
    assert 50 < changed.sum() <= 60
    chosen = np.flatnonzero(changed)
    both = join_helices(guides, hair)
    longer = replace(settings, training_frames=14)
    errors = {"trained": [], "by distance": []}
    for points, frames in list(simulated_motion(both, np.ones(both.n_strands), MaterialParams(), longer))[8:]:
        for name, these in (("trained", trained), ("by distance", followers)):
            out = np.empty_like(these.points)
            interpolate(these, points[:N_GUIDES].copy(), frames[:N_GUIDES].copy(), out)
            moved = out.reshape(N_STRANDS, -1, 3)[chosen] - points[N_GUIDES:][chosen]
            errors[name].append(np.sqrt((moved**2).sum(axis=2).mean()))
    assert np.mean(errors["trained"]) < 0.8 * np.mean(errors["by distance"])
    again = train_followers(followers, strands, guides, MaterialParams(), settings)
    assert again.weights.tobytes() == trained.weights.tobytes()


def test_guides_are_not_trained_and_training_can_be_cancelled(guides, settings):
    strands = as_strands(guides, PARAMS.n_samples)
    followers = bind_followers(strands, guides, PARAMS, guides=np.arange(N_GUIDES, dtype=np.int32))
    assert train_followers(followers, strands, guides, MaterialParams(), settings) is followers

    def cancel(fraction, message):
        raise Cancelled

    loose = bind_followers(strands, guides, PARAMS)
    with pytest.raises(Cancelled):
        train_followers(loose, strands, guides, MaterialParams(), settings, progress=cancel)


def test_bad_input(guides, hair, followers):
    rest, frames = evaluate(hair, PARAMS.n_samples)[0], motion(guides, hair, (0.3,))
    for chosen in ([], [N_STRANDS], [-1], [2, 2]):
        with pytest.raises(InputError, match="chosen"):
            fit_weights(followers, np.array(chosen, np.int32), rest[: len(chosen)], frames, 0.02)
    with pytest.raises(InputError, match="no frames"):
        fit_weights(followers, everyone(followers), rest, [], 0.02)
    with pytest.raises(InputError, match="rest must have shape"):
        fit_weights(followers, everyone(followers), rest[:, :5], frames, 0.02)
    with pytest.raises(InputError, match="hairs has NaN"):
        fit_weights(followers, everyone(followers), rest, [replace(frames[0], hairs=rest * np.nan)], 0.02)
    one = StrandSet(rest[0].astype(np.float32), np.array([0, PARAMS.n_samples], np.int32))
    with pytest.raises(InputError, match="another groom"):
        train_followers(followers, one, guides, MaterialParams())
    with pytest.raises(InputError, match="other guides"):
        train_followers(followers, as_strands(hair), hair, MaterialParams())
