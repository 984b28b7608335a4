"""Followers: at rest, under rigid motion, against the formula, at their roots, out of the head, and bad input."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numba
import numpy as np
import pytest
from follower_hair import (
    CENTRE,
    RADIUS,
    as_strands,
    bent,
    carried,
    hair_on_sphere,
    interpolate_naive,
    rigid,
    swayed,
)
from hairloom.errors import InputError
from hairloom.geometry.analytic_heads import sphere_head
from hairloom.geometry.collider import build_collider
from hairloom.geometry.strands import from_dense, join_strands, strand_lengths
from hairloom.io.bundle import read_bundle, write_bundle
from hairloom.rods.helices import evaluate
from hairloom.rods.interpolation import FollowerParams, bind_followers, interpolate, keep_out, rest_depths
from hairloom.types import StrandSet
from scipy.spatial.transform import Rotation

# float32 steps at the head's height of 1.6 m are 1.2e-7 m; the motion is rounded too
FLOAT32 = 4e-7
N_GUIDES, N_STRANDS = 40, 300


@pytest.fixture(scope="module")
def guides():
    return hair_on_sphere(N_GUIDES, seed=1)


@pytest.fixture(scope="module")
def hair():
    return as_strands(hair_on_sphere(N_STRANDS, seed=2))


@pytest.fixture(scope="module")
def followers(guides, hair):
    return bind_followers(hair, guides)


@pytest.fixture(scope="module")
def head():
    # the sphere's polyhedron lies a little under it, so that the hair starts outside
    return SimpleNamespace(
        collider=build_collider([sphere_head(RADIUS - 1e-4, tuple(CENTRE))], cell=0.003), matrix=np.eye(4)
    )


def moved(followers, points, frames, **more):
    out = np.empty_like(followers.points)
    interpolate(followers, points, frames, out, **more)
    return out


def test_guides_at_rest_leave_the_hair_at_rest_bit_for_bit(followers, guides):
    out = moved(followers, *evaluate(guides, followers.n_samples))
    assert np.array_equal(out, followers.points)


def test_a_rigid_motion_of_all_guides_is_that_of_the_hair(followers, guides):
    motion = rigid((0.3, -0.8, 0.5), (0.1, -0.2, 0.05))
    out = moved(followers, *carried(*evaluate(guides, followers.n_samples), motion))
    truth = followers.points.astype(np.float64) @ motion[:, :3].T + motion[:, 3]
    np.testing.assert_allclose(out, truth, rtol=0, atol=FLOAT32)


def test_as_the_formula_says(followers, guides):
    now = evaluate(swayed(guides, 0.7), followers.n_samples)
    truth = interpolate_naive(followers, *now)
    assert np.abs(truth - followers.points).max() > 0.02
    # steps of float32, which the corrections of up to 32 segments add up
    np.testing.assert_allclose(moved(followers, *now), truth, rtol=0, atol=FLOAT32)


def test_hair_that_is_a_guide_follows_it(guides):
    """At the samples exactly, with as many points as samples; neighbours and wisps do not count."""
    params = FollowerParams(n_samples=33)
    strands = join_strands([as_strands(hair_on_sphere(50, seed=3)), as_strands(guides)])
    which = np.arange(50, 50 + N_GUIDES, dtype=np.int32)
    wisps = np.zeros(strands.n_strands, np.int32)
    followers = bind_followers(strands, guides, params, guides=which, wisps=wisps)
    points, frames = evaluate(swayed(guides, 0.7), 33)
    out = moved(followers, points, frames).reshape(-1, 33, 3)
    # the strand's points are at equal steps of its polyline, the samples at those of the curve: 1e-5 of a step apart
    np.testing.assert_allclose(out[50:], points, rtol=0, atol=2e-6)


def test_between_samples_a_guide_is_followed_to_the_second_order(guides):
    """The blend of two rigid motions is off by h^2 / 8 of the change of curvature: a quarter for half the step."""
    strands = as_strands(guides, 257)
    errors = []
    for n_samples in (9, 17, 33):
        followers = bind_followers(
            strands, guides, FollowerParams(n_samples=n_samples), guides=np.arange(N_GUIDES, dtype=np.int32)
        )
        out = moved(followers, *evaluate(bent(guides, np.array([0.0, 5.0, 0.0])), n_samples))
        truth = evaluate(bent(guides, np.array([0.0, 5.0, 0.0])), 257)[0].reshape(-1, 3)
        errors.append(np.linalg.norm(out - truth, axis=1).max())
    assert errors[2] < 1.1 * (0.25 / 32) ** 2 / 8 * 5.0
    assert 3.5 < errors[0] / errors[1] < 4.5 and 3.5 < errors[1] / errors[2] < 4.5


def test_weights_are_shares_and_fall_with_the_distance(followers, guides, hair):
    assert followers.weights.min() >= 0
    np.testing.assert_allclose(followers.weights.sum(axis=2), 1.0, atol=1e-6)
    # of each knot w d^2 is the same for all guides, d from the hair's place to the guide's at the same share of length
    tips = hair.points.reshape(N_STRANDS, -1, 3)[:, -1]
    guide_tips = evaluate(guides, 2)[0][:, 1]
    squares = ((tips[:, None] - guide_tips[followers.guides]) ** 2).sum(axis=2)
    products = followers.weights[:, -1] * squares
    np.testing.assert_allclose(products / products[:, :1], 1.0, rtol=1e-3)


def test_the_wisps_own_guide_comes_first_and_clumping_gives_it_more(guides, hair):
    wisps = np.random.default_rng(0).integers(0, N_GUIDES, N_STRANDS).astype(np.int32)
    loose, tight, glued = (
        bind_followers(hair, guides, FollowerParams(clumping=clumping), wisps=wisps) for clumping in (0.0, 0.6, 1.0)
    )
    assert np.array_equal(loose.guides[:, 0], wisps)
    for row in loose.guides:
        assert len(set(row)) == len(row)
    np.testing.assert_allclose(tight.weights[..., 0], 0.6 + 0.4 * loose.weights[..., 0], atol=1e-6)
    assert (glued.weights[..., 0] == 1).all()


def test_the_nearest_guides_are_taken(followers, guides, hair):
    distances = np.linalg.norm(hair.roots[:, None] - guides.roots[None], axis=2)
    assert np.array_equal(followers.guides, np.argsort(distances, axis=1)[:, :4])


def test_roots_are_where_a_deforming_head_carries_them(followers, guides):
    rng = np.random.default_rng(4)
    roots = np.stack([rigid(rng.normal(0, 0.1, 3), rng.normal(0, 0.005, 3)) for _ in range(N_STRANDS)])
    now = evaluate(swayed(guides, 0.7), followers.n_samples)
    out, without = moved(followers, *now, roots=roots), moved(followers, *now)
    first = followers.offsets[:-1]
    truth = np.einsum("sij,sj->si", roots[:, :, :3], followers.points[first].astype(float)) + roots[:, :, 3]
    assert np.abs(without[first] - truth).max() > 1e-3
    np.testing.assert_allclose(out[first], truth, rtol=0, atol=FLOAT32)
    # beyond the reach (30 mm of 250) nothing changes, and within it the pull falls off
    pulled = np.linalg.norm(out - without, axis=1).reshape(N_STRANDS, -1)
    assert (pulled[:, 5:] == 0).all() and (pulled[:, 3] < 0.5 * pulled[:, 0]).all()


def test_roots_on_a_rigid_head_are_exact(followers, guides):
    """The guides' roots are carried by the head, the rest of them sways: a follower's root is on the head anyway."""
    motion = rigid((0.1, 0.7, -0.4), (1.0, 2.0, -0.5))
    now = carried(*evaluate(swayed(guides, 0.4), followers.n_samples), motion)
    first = followers.offsets[:-1]
    truth = followers.points[first].astype(float) @ motion[:, :3].T + motion[:, 3]
    for roots in (None, motion[None], np.broadcast_to(motion, (N_STRANDS, 3, 4))):
        # float32 steps at 3 m are 2.4e-7
        np.testing.assert_allclose(moved(followers, *now, roots=roots)[first], truth, rtol=0, atol=2 * FLOAT32)


def test_lengths_change_little(followers, guides, hair):
    out = moved(followers, *evaluate(swayed(guides, 0.7), followers.n_samples))
    change = strand_lengths(StrandSet(out, hair.offsets)) / strand_lengths(hair) - 1.0
    # STRETCH of the kernel; without it the blends of guides that sway 1 rad apart are up to 18 % short
    assert np.abs(change).max() < 0.0051


def test_one_guide_and_one_point_strands(guides):
    one = hair_on_sphere(1, seed=5)
    strands = StrandSet(
        np.concatenate([as_strands(guides, 2).points[:4], one.roots.astype(np.float32)]),
        np.array([0, 2, 4, 5], np.int32),
    )
    followers = bind_followers(strands, one, FollowerParams(n_neighbours=8))
    assert followers.n_neighbours == 1
    motion = rigid((0.0, 0.2, 0.1), (0.1, 0.0, 0.0))
    out = moved(followers, *carried(*evaluate(one, followers.n_samples), motion))
    np.testing.assert_allclose(out, strands.points @ motion[:, :3].T + motion[:, 3], rtol=0, atol=FLOAT32)


def test_ragged_strands_and_zero_length(guides):
    rng = np.random.default_rng(6)
    counts = np.array([3, 1, 40, 2, 7])
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    points = (CENTRE + rng.normal(0, 0.1, (offsets[-1], 3))).astype(np.float32)
    points[offsets[3] : offsets[4]] = points[offsets[3]]  # a strand of two points in one place
    followers = bind_followers(StrandSet(points, offsets), guides)
    now = evaluate(swayed(guides, 0.3), followers.n_samples)
    np.testing.assert_allclose(moved(followers, *now), interpolate_naive(followers, *now), rtol=0, atol=FLOAT32)


def test_same_bytes_for_any_number_of_threads(followers, guides, head):
    now = evaluate(swayed(guides, 0.7), followers.n_samples)
    before, results = numba.get_num_threads(), []
    try:
        for threads in (1, before):
            numba.set_num_threads(threads)
            out = moved(followers, *now, roots=rigid((0.0, 0.0, 0.01), (0.0, 0.0, 0.0))[None])
            keep_out(followers, out, [head])
            results.append(out.tobytes())
    finally:
        numba.set_num_threads(before)
    assert results[0] == results[1]


def test_a_bundle_holds_followers(followers, tmp_path):
    write_bundle(tmp_path / "followers.npz", {"followers": followers})
    back = read_bundle(tmp_path / "followers.npz")["followers"]
    for name in type(followers).__dataclass_fields__:
        assert np.array_equal(getattr(back, name), getattr(followers, name))


# --- out of the head ----------------------------------------------------------------------------------------------


def depth_in_sphere(points):
    return RADIUS - np.linalg.norm(points - CENTRE, axis=1)


def test_no_hair_in_the_head_when_it_turns(followers, guides, head):
    """The head has turned by 50 degrees and the guides' tips have stayed behind, bent to it: hair between goes in."""
    turn = Rotation.from_rotvec([0.0, 0.0, np.radians(50)]).as_matrix()
    points, frames = carried(
        *evaluate(bent(guides, np.array([0.0, 20.0, 4.0])), followers.n_samples),
        np.concatenate([turn, (CENTRE - turn @ CENTRE)[:, None]], axis=1),
    )
    out = moved(followers, points, frames)
    assert (depth_in_sphere(out) > 1e-3).mean() > 0.02
    solid = SimpleNamespace(collider=head.collider, matrix=np.eye(4))
    solid.matrix[:3, :3], solid.matrix[:3, 3] = turn, CENTRE - turn @ CENTRE
    kept = out.copy()
    keep_out(followers, kept, [solid], rest_depths(followers, [head]))
    # the tolerance of the push, and the grid's error for a sphere (test_collider)
    assert depth_in_sphere(kept).max() < 2e-4
    first = followers.offsets[:-1]
    assert np.array_equal(kept[first], out[first])
    # what is far from the head along its strand has not moved
    still = (kept == out).all(axis=1)
    assert still.mean() > 0.2


def test_the_push_is_smooth_along_the_strand(followers, head):
    """A straight strand through the head's side comes out in an arc, without corners where it went in."""
    across = np.linspace([-0.2, 0.0, 0.0], [0.2, 0.0, 0.0], 129) + CENTRE + [0.0, RADIUS - 0.008, 0.0]
    strands = from_dense(across[None])
    bound = bind_followers(strands, hair_on_sphere(1))
    kept = strands.points.copy()
    keep_out(bound, kept, [head])
    assert depth_in_sphere(strands.points).max() > 7e-3 and depth_in_sphere(kept).max() < 2e-4
    steps = np.diff(kept.astype(float), axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    turns = np.degrees(np.arccos(np.clip((steps[1:] * steps[:-1]).sum(axis=1), -1, 1)))
    # pushed alone, the points at the rim would turn by their chord's angle to the sphere, 24 degrees
    assert turns.max() < 8.0
    assert strand_lengths(StrandSet(kept, strands.offsets))[0] < 1.02 * 0.4


def test_hair_that_is_in_the_head_at_rest_may_stay(followers, head):
    deep = StrandSet((CENTRE + (followers.points - CENTRE) * 0.9).astype(np.float32), followers.offsets)
    bound = bind_followers(deep, hair_on_sphere(N_GUIDES, seed=1))
    depths = rest_depths(bound, [head])
    assert depths.max() > 5e-3
    kept = deep.points.copy()
    keep_out(bound, kept, [head], depths)
    assert np.array_equal(kept, deep.points)
    keep_out(bound, kept, [head])
    inner = np.ones(len(kept), bool)
    inner[deep.offsets[:-1]] = False  # roots stay
    assert depth_in_sphere(kept)[inner].max() < 2e-4


# --- bad input ----------------------------------------------------------------------------------------------------


def test_bad_input(followers, guides, hair):
    none = replace(
        guides, roots=np.zeros((0, 3)), frames=np.zeros((0, 3, 3)), offsets=np.zeros(1, np.int32),
        lengths=np.zeros(0), curvatures=np.zeros((0, 3)),
    )  # fmt: skip
    empty = StrandSet(np.zeros((0, 3), np.float32), np.zeros(1, np.int32))
    with pytest.raises(InputError, match="no guides"):
        bind_followers(hair, none)
    with pytest.raises(InputError, match="no strands"):
        bind_followers(empty, guides)
    with pytest.raises(InputError, match="outside 0 to 39, the guides"):
        bind_followers(hair, guides, wisps=np.full(N_STRANDS, N_GUIDES, np.int32))
    with pytest.raises(InputError, match="outside 0 to 299, the strands"):
        bind_followers(hair, guides, guides=np.full(N_GUIDES, N_STRANDS, np.int32))
    with pytest.raises(InputError, match="wisps must have shape"):
        bind_followers(hair, guides, wisps=np.zeros(3, np.int32))
    now = evaluate(guides, followers.n_samples)
    for out in (np.empty((3, 3), np.float32), np.empty(followers.points.shape), followers.points.T.copy().T):
        with pytest.raises(InputError, match="out must be float32"):
            interpolate(followers, *now, out)
    with pytest.raises(InputError, match="points must be float32"):
        keep_out(followers, np.empty((3, 3), np.float32), [])
    with pytest.raises(InputError, match="depths must be float32"):
        keep_out(followers, followers.points.copy(), [], np.zeros(3, np.float32))
    with pytest.raises(InputError, match="points must have shape"):
        interpolate(followers, now[0][:3], now[1], np.empty_like(followers.points))
    with pytest.raises(InputError, match="roots must have shape"):
        moved(followers, *now, roots=np.zeros((2, 3, 4)))
    with pytest.raises(InputError, match="points has NaN"):
        moved(followers, now[0] * np.nan, now[1])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: {"guides": f.guides + np.int32(f.n_guides)}, "a guide outside"),
        (lambda f: {"weights": -f.weights}, "a weight is below 0"),
        (lambda f: {"weights": f.weights * np.float32(0.5)}, "must be 1 together"),
        (lambda f: {"places": f.places + np.float32(1.0)}, "place along a strand"),
        (lambda f: {"guide_points": f.guide_points[:0], "guide_frames": f.guide_frames[:0]}, "no guides"),
    ],
)
def test_followers_are_checked(followers, change, message):
    with pytest.raises(InputError, match=message):
        replace(followers, **change(followers))


@pytest.mark.parametrize(
    "setting",
    [{"n_neighbours": 0}, {"n_samples": 1}, {"n_knots": 1}, {"power": 0.0}, {"clumping": 1.5}, {"root_reach": 0.0},
     {"training_strands": 0}, {"training_frames": 1}, {"ridge": 0.0}, {"ridge": float("nan")}],
)  # fmt: skip
def test_settings_out_of_range(setting):
    with pytest.raises(InputError, match=next(iter(setting))):
        FollowerParams(**setting)
