"""The starter grooms' hairstyles: roots on the scalp, nothing in the head, each of its own kind."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.geometry.head import HeadSurface, default_head
from hairloom.geometry.strands import strand_lengths
from hairloom.types import Head, StrandSet

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "blend_templates"))

from collider import Collider, fit_sphere  # noqa: E402
from growth import Wisps, clump, resample_to, wave  # noqa: E402
from styles import STYLES, grow_style, make_style  # noqa: E402

N_STRANDS = 1000


@pytest.fixture(scope="module")
def collider() -> Collider:
    return Collider(default_head())


@pytest.fixture(scope="module")
def grooms(collider: Collider) -> dict[str, StrandSet]:
    return {name: grow_style(style, collider, N_STRANDS) for name, style in STYLES.items()}


def dense(strands: StrandSet) -> np.ndarray:
    return strands.points.reshape(strands.n_strands, -1, 3).astype(np.float64)


def mean_curvature(strands: StrandSet) -> float:
    """1 / metre: turning over length, all strands."""
    steps = np.diff(dense(strands), axis=1)
    lengths = np.linalg.norm(steps, axis=2)
    tangents = steps / lengths[..., None]
    cosine = np.clip((tangents[:, 1:] * tangents[:, :-1]).sum(axis=2), -1, 1)
    return float(np.arccos(cosine).sum() / lengths.sum())


def test_six_styles_or_more() -> None:
    assert set(STYLES) >= {"straight", "wavy", "curly", "spiky", "puffy", "bob"}
    assert min(style.n_strands for style in STYLES.values()) >= 10_000


@pytest.mark.parametrize("name", STYLES)
def test_counts_and_attributes(name: str, grooms: dict[str, StrandSet]) -> None:
    groom = grooms[name]
    assert groom.n_strands == N_STRANDS
    assert (groom.point_counts == STYLES[name].n_points).all()
    assert (groom.point_attributes["radius"] > 0).all()
    labels, coarse = groom.strand_attributes["wisp"], groom.strand_attributes["coarse_wisp"]
    # wisps lie within coarse wisps
    assert len(np.unique(np.stack([labels, coarse]), axis=1).T) == len(np.unique(labels))
    assert 1 < len(np.unique(coarse)) < len(np.unique(labels)) < N_STRANDS


@pytest.mark.parametrize("name", STYLES)
def test_roots_lie_on_the_scalp(name: str, grooms: dict[str, StrandSet], collider: Collider) -> None:
    head = collider.surface.head
    scalp = HeadSurface(
        Head(head.vertices, head.triangles[head.scalp], head.scalp[head.scalp], head.corner_uv[head.scalp])
    )
    # float32 coordinates of 0.3 m are 3e-8 m apart; two conversions
    assert np.linalg.norm(scalp.closest_points(grooms[name].roots)[0] - grooms[name].roots, axis=1).max() < 1e-6


@pytest.mark.parametrize("name", STYLES)
def test_strands_stay_out_of_the_head(name: str, grooms: dict[str, StrandSet], collider: Collider) -> None:
    points = dense(grooms[name])[:, 1:].reshape(-1, 3)
    depth = -collider.surface.signed_distance(points)
    assert (depth > 1e-6).mean() < 0.002, f"{(depth > 1e-6).mean():.2%} inside"
    assert depth.max() < 0.001


@pytest.mark.parametrize("name", STYLES)
def test_segments_are_even(name: str, grooms: dict[str, StrandSet]) -> None:
    """Steps are even along the strand but for what the last push out of the head moved; none jumps through it."""
    steps = np.linalg.norm(np.diff(dense(grooms[name]), axis=1), axis=2)
    assert steps.min() > 1e-5
    assert (steps.max(axis=1) / np.median(steps, axis=1)).max() < 2.5


def test_styles_differ(grooms: dict[str, StrandSet]) -> None:
    length = {name: float(strand_lengths(groom).mean()) for name, groom in grooms.items()}
    curvature = {name: mean_curvature(groom) for name, groom in grooms.items()}
    assert min(length["straight"], length["wavy"]) > 1.5 * length["bob"] > 3 * length["short_crop"]
    assert curvature["puffy"] > 2 * curvature["curly"] > 4 * curvature["wavy"] > 6 * curvature["straight"]
    names = list(grooms)
    for i, a in enumerate(names):
        for b in names[:i]:
            ratios = [length[a] / length[b], curvature[a] / curvature[b]]
            assert max(abs(np.log(ratios))) > 0.1, f"{a} and {b} are alike"


def test_straight_hair_hangs_and_spikes_stand(grooms: dict[str, StrandSet]) -> None:
    def rise(name: str) -> float:
        strands = dense(grooms[name])
        top = strands[:, 0, 2] > np.quantile(strands[:, 0, 2], 0.7)
        return float((strands[top, -1, 2] - strands[top, 0, 2]).mean())

    assert rise("straight") < -0.1
    assert rise("spiky") > 0.02


def test_straight_hair_is_parted(grooms: dict[str, StrandSet]) -> None:
    strands = dense(grooms["straight"])
    top = (strands[:, 0, 2] > np.quantile(strands[:, 0, 2], 0.5)) & (np.abs(strands[:, 0, 0]) > 0.02)
    same_side = np.sign(strands[top, 0, 0]) == np.sign(strands[top, -1, 0])
    assert same_side.mean() > 0.97


def test_same_seed_same_bytes_and_another_seed_another_groom(collider: Collider) -> None:
    grown = [grow_style(STYLES["tangled"], collider, 200, seed=seed) for seed in (3, 3, 4)]
    assert grown[0].points.tobytes() == grown[1].points.tobytes()
    assert not np.array_equal(grown[0].points, grown[2].points)


def test_make_style_scales_and_moves_with_the_head(collider: Collider) -> None:
    head = collider.surface.head
    moved = Head(head.vertices * 2 + np.float32([1, 2, 3]), head.triangles, head.scalp, head.corner_uv)
    groom, other = (make_style("bob", h, 200) for h in (head, moved))
    back = (other.points - np.float32([1, 2, 3])) / 2
    # rounding is magnified where strands slide along the head, so a few stray
    assert np.quantile(np.linalg.norm(back - groom.points, axis=1), 0.9) < 0.003


def test_bad_input(collider: Collider) -> None:
    head = collider.surface.head
    with pytest.raises(InputError, match="no hairstyle 'mullet'"):
        make_style("mullet", head)
    with pytest.raises(InputError, match="no scalp"):
        make_style("bob", Head(head.vertices, head.triangles, np.zeros_like(head.scalp), head.corner_uv))
    with pytest.raises(InputError, match="1 points"):
        grow_style(STYLES["bob"], collider, 10, 1)


def test_push_out_moves_inside_points_just_out(collider: Collider) -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(500, 3))
    points *= rng.uniform(0.6, 1.3, (500, 1)) / np.linalg.norm(points, axis=1, keepdims=True)
    soft = np.full(500, 0.05)
    before = collider.surface.signed_distance(collider.to_world(points)) / collider.radius
    moved = collider.push_out(points, soft)
    after = collider.surface.signed_distance(collider.to_world(moved)) / collider.radius
    # smooth normals differ from the facets' in hollows (ears): a point may come back a little short
    assert (after < 0).mean() < 0.01
    assert np.array_equal(moved[before > 0.05], points[before > 0.05])
    assert (after[before < 0] < 0.05).all()


def test_fit_sphere_finds_a_sphere() -> None:
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    centre, radius = fit_sphere(np.array([0.1, -2.0, 3.0]) + 0.25 * directions[directions[:, 2] > 0])
    assert np.allclose(centre, [0.1, -2.0, 3.0], atol=1e-10) and abs(radius - 0.25) < 1e-10


def test_resample_cuts_at_the_length() -> None:
    angle = np.linspace(0, np.pi, 400)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    cut = resample_to(np.stack([circle, 2 * circle]), np.array([np.pi / 2, np.pi]), 11)
    expected = np.linspace(0, np.pi / 2, 11)
    # a polygon of 400 corners is shorter than its circle by 3e-6
    assert np.allclose(cut[0], np.stack([np.cos(expected), np.sin(expected), 0 * expected], axis=1), atol=2e-5)
    assert np.allclose(cut[1], 2 * cut[0], atol=4e-5)


def test_full_clump_meets_at_the_centres_tip() -> None:
    rng = np.random.default_rng(2)
    t = np.linspace(0, 1, 20)[:, None]
    strands = rng.normal(size=(6, 1, 3)) + t * np.array([0, 0, -3.0])
    wisps = Wisps(np.int32([0, 0, 0, 1, 1, 1]), np.int32([1, 4]))
    gathered = clump(strands, wisps, np.ones(6), 1.0, np.full(6, 3.0))
    assert np.allclose(gathered[:, 0], strands[:, 0])
    assert np.allclose(gathered[:3, -1], strands[1, -1]) and np.allclose(gathered[3:, -1], strands[4, -1])


def test_wave_is_a_coil_of_the_given_radius_and_pitch() -> None:
    arcs = np.linspace(0, 4, 401)[None]
    across, up = wave(arcs, np.array([0.3]), np.array([1.0]), np.zeros(1), 0.0, np.ones(1), 0.5)
    grown = arcs[0] >= 0.5
    assert np.allclose(np.hypot(across, up)[0, grown], 0.3)
    assert np.allclose(across[0, :-100][grown[:-100]], across[0, 100:][grown[:-100]])
    assert across[0, 0] == up[0, 0] == 0
