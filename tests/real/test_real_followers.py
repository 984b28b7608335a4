"""Hair of real grooms after its guides: at rest, swaying over the head, in length, and trained."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hairloom.geometry.collider import comb_collider
from hairloom.geometry.head import find_scalp, read_head
from hairloom.geometry.strands import join_strands, select_strands, strand_lengths
from hairloom.io.strands import read_strands
from hairloom.io.units import Units
from hairloom.registry import run_job
from hairloom.rods.fitting import fit_helices
from hairloom.rods.helices import Helices, evaluate
from hairloom.rods.interpolation import (
    FollowerParams,
    Followers,
    bind_followers,
    interpolate,
    keep_out,
    rest_depths,
)
from hairloom.rods.material import MaterialParams
from hairloom.rods.training import join_helices, simulated_motion, train_followers
from hairloom.types import Float32, Float64, Head, StrandSet

UNITS = {"sintel": Units.parse("m,y-up"), "ponytail": Units(0.0035, "Y", "-Z")}
GROOMS = {"sintel": ("hair",), "ponytail": ("front_top", "side", "back")}  # the tail's roots are in the air
N_STRANDS, N_GUIDES = 2500, 250


@dataclass(frozen=True)
class Groom:
    strands: StrandSet
    head: Head
    helices: Helices
    followers: Followers
    wisp_sizes: Float64


@pytest.fixture(scope="module", params=list(GROOMS))
def groom(request: pytest.FixtureRequest, data_dir: Path) -> Groom:
    folder, units = data_dir / request.param, UNITS[request.param]
    whole = join_strands([read_strands(folder / f"{part}.tfx", units=units) for part in GROOMS[request.param]])
    strands = select_strands(whole, np.arange(0, whole.n_strands, max(1, whole.n_strands // N_STRANDS)))
    head = find_scalp(read_head(folder / "head.obj", units), strands.roots)
    made = run_job("make_guides", {"strands": strands, "head": head}, {"n_guides": N_GUIDES})
    helices = fit_helices(select_strands(strands, made["guides"])).helices
    followers = bind_followers(strands, helices, guides=made["guides"], wisps=made["wisps"])
    return Groom(strands, head, helices, followers, np.bincount(made["wisps"]).astype(np.float64))


@dataclass(frozen=True)
class Solid:
    collider: object
    matrix: Float64


def after(groom: Groom, points: Float64, frames: Float64) -> Float32:
    out = np.empty_like(groom.strands.points)
    interpolate(groom.followers, points, frames, out)
    return out


def test_at_rest_nothing_moves(groom: Groom) -> None:
    out = after(groom, *evaluate(groom.helices, groom.followers.n_samples))
    assert np.array_equal(out, groom.strands.points)


def test_swaying_hair_keeps_its_length_and_stays_out_of_the_head(groom: Groom) -> None:
    """The guides after a second of the training's motion, in which nothing keeps them out of the head."""
    params = FollowerParams(training_frames=10)
    motion = simulated_motion(groom.helices, groom.wisp_sizes, MaterialParams(), params)
    *_, (points, frames) = motion
    out = after(groom, points, frames)
    moved = np.linalg.norm(out - groom.strands.points, axis=1)
    assert moved.max() > 0.02
    change = strand_lengths(StrandSet(out, groom.strands.offsets)) / strand_lengths(groom.strands) - 1.0
    assert np.abs(change).max() < 0.0051  # the kernel's STRETCH
    # the head has turned: it is the one that the roots are on now
    turn = frames[0, 0] @ groom.followers.guide_frames[0, 0].T
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, points[0, 0] - turn @ groom.followers.guide_points[0, 0]
    collider = comb_collider([groom.head], groom.strands.roots)
    depths = rest_depths(groom.followers, [Solid(collider, np.eye(4))])
    inside = deeper(collider, out, matrix, depths)
    keep_out(groom.followers, out, [Solid(collider, matrix)], depths)
    assert inside.max() > 2e-3
    assert deeper(collider, out, matrix, depths).max() < 1e-3
    roots = groom.strands.roots @ turn.T + matrix[:3, 3]
    np.testing.assert_allclose(out[groom.strands.offsets[:-1]], roots, rtol=0, atol=1e-6)


def deeper(collider, points: Float32, matrix: Float64, depths: Float32) -> Float64:
    """How much deeper than at rest, metres."""
    back = np.linalg.inv(matrix)
    return -collider.distance_at(points @ back[:3, :3].T + back[:3, 3]) - depths


def test_trained_hair_is_nearer_to_hair_that_is_simulated_itself(groom: Groom) -> None:
    params = replace(FollowerParams(), training_strands=300, training_frames=10)
    trained = train_followers(groom.followers, groom.strands, groom.helices, MaterialParams(), params)
    chosen = np.flatnonzero((trained.weights != groom.followers.weights).any(axis=(1, 2))).astype(np.int32)
    hairs = fit_helices(select_strands(groom.strands, chosen)).helices
    sizes = np.concatenate([groom.wisp_sizes, groom.wisp_sizes[groom.followers.guides[chosen, 0]]])
    longer = replace(params, training_frames=20)
    both = join_helices(groom.helices, hairs)
    unseen = list(simulated_motion(both, sizes, MaterialParams(), longer))[10:]
    rest, n_guides = evaluate(hairs, trained.n_samples)[0], groom.helices.n_strands
    errors = {}
    for name, followers in (("trained", trained), ("by distance", groom.followers)):
        bound = bind_followers(select_strands(groom.strands, chosen), groom.helices)
        bound = replace(
            bound,
            points=rest.astype(np.float32).reshape(-1, 3),
            offsets=np.arange(len(chosen) + 1, dtype=np.int32) * trained.n_samples,
            places=np.tile(np.arange(trained.n_samples, dtype=np.float32), len(chosen)),
            root_shares=np.zeros(rest.size // 3, np.float32),
            guides=np.ascontiguousarray(followers.guides[chosen]),
            weights=np.ascontiguousarray(followers.weights[chosen]),
        )
        squares = []
        for points, frames in unseen:
            out = np.empty_like(bound.points)
            interpolate(bound, points[:n_guides].copy(), frames[:n_guides].copy(), out)
            squares.append(((out.reshape(rest.shape) - points[n_guides:]) ** 2).sum(axis=2).mean())
        errors[name] = float(np.sqrt(np.mean(squares)))
    assert errors["trained"] < 0.85 * errors["by distance"]
