"""Synthesis end to end on a small groom: what holds for every result, invariance, regions, bad input."""

from dataclasses import replace

import numpy as np
import pytest
from hairloom.errors import Cancelled, InputError
from hairloom.geometry.head import HeadSurface, sphere_head
from hairloom.geometry.roots import scatter_roots
from hairloom.geometry.scalp_space import fit_scalp_space, unroot_strands
from hairloom.synthesis.hierarchy import HierarchyParams
from hairloom.synthesis.pipeline import (
    SynthesisParams,
    analyze,
    level_counts,
    place_roots,
    region_area,
    synthesize,
    synthesize_coarsest,
    synthesize_from,
)
from hairloom.synthesis.wisps import WispParams
from hairloom.types import Head, StrandSet

PARAMS = SynthesisParams(n_samples=24, hierarchy=HierarchyParams(wisps=WispParams(n_wisps=40, error_threshold=0.1)))


def groom(head, n_strands=700, seed=0):
    """Wisps of wavy strands that lean over to one side."""
    rng = np.random.default_rng(seed)
    space = fit_scalp_space(head)
    placed = place_roots(space, scatter_roots(head, head.scalp, n_strands, seed), 24)
    t = np.linspace(0, 1, 24, dtype=np.float32)[None, :, None]
    wisp = np.floor(placed.uv * 6).astype(int)
    phase = (np.sin(12.9 * wisp[:, :1] + 78.2 * wisp[:, 1:]) * 40)[:, :, None]
    points = t * np.array([0.2, 0.5, 0.1]) + t**2 * np.array([0.4, 0.0, 0.2])
    points = points * (1 + 0.15 * np.sin(phase)) + 0.06 * t * np.sin(9 * t + phase) * np.array([0.3, 0.1, 1.0])
    points = points + 0.01 * t * rng.normal(size=(n_strands, 1, 3))
    return unroot_strands(placed.with_points(points.astype(np.float32)), space)


def straight(strands):
    """Another style: the same roots, stiff hair."""
    t = np.linspace(0, 1, strands.n_points, dtype=np.float32)[:, None]
    return strands.with_points(np.broadcast_to(t * np.float32([0, 1, 0]), strands.points.shape).copy())


@pytest.fixture(scope="module")
def head():
    return sphere_head(0.1, scalp_angle_deg=67.5, n_rings=32)


@pytest.fixture(scope="module")
def example(head):
    return analyze(groom(head), head, PARAMS)


@pytest.fixture(scope="module")
def result(head, example):
    return synthesize_from(example, head, PARAMS)


def test_the_result_has_the_density_of_the_example(example, result):
    # Turk's relaxation places exactly the count asked for, at every level
    assert [level.n_strands for level in result.levels] == [level.n_strands for level in example.hierarchy.levels]
    assert result.strands.n_strands == 700


def test_roots_lie_on_the_scalp_where_the_result_says(head, result):
    surface = HeadSurface(head)
    there = surface.points_at(result.roots.triangles, result.roots.barycentric)
    assert head.scalp[result.roots.triangles].all()
    np.testing.assert_allclose(there, result.roots.points, atol=1e-6)
    # strands go through head space and back in float32: 1e-6 of a 0.1 m head
    np.testing.assert_allclose(result.strands.roots, result.roots.points, atol=1e-6)


def test_the_result_is_neither_a_copy_nor_another_style(head, example, result):
    from hairloom.synthesis.statistics import compare_styles

    style = compare_styles(example.hierarchy.levels[0], result.levels[0], wisps=PARAMS.hierarchy.wisps)
    other = compare_styles(example.hierarchy.levels[0], straight(result.levels[0]), wisps=PARAMS.hierarchy.wisps)
    assert style.copied_share < 0.9
    # ten coarsest strands are few for a distribution; real grooms are tested in tests/real
    assert style.mean_distance < 0.7 * other.mean_distance


def test_same_seed_same_bytes_and_another_seed_another_style(head, example, result):
    again = synthesize_from(example, head, PARAMS)
    other = synthesize_from(example, head, replace(PARAMS, seed=1))
    assert again.strands.points.tobytes() == result.strands.points.tobytes()
    assert other.strands.points.tobytes() != result.strands.points.tobytes()


def test_a_head_of_twice_the_size_gives_hair_of_twice_the_size(head, result):
    # doubling is exact in floating point, so only a constant in metres could make a difference
    doubled = replace(head, vertices=2 * head.vertices)
    hair = groom(head)
    there = synthesize(StrandSet(2 * hair.points, hair.offsets), doubled, PARAMS)
    np.testing.assert_allclose(there.strands.points, 2 * result.strands.points, atol=2e-6)


def test_a_region_and_a_count_are_kept(head, example):
    region = head.scalp & (head.vertices[head.triangles].mean(axis=1)[:, 0] > 0)
    result = synthesize_from(example, head, replace(PARAMS, n_strands=333), region=region)
    assert result.strands.n_strands == 333
    assert region[result.roots.triangles].all()
    assert result.levels[1].n_strands == pytest.approx(example.hierarchy.levels[1].n_strands / 2, abs=2)


def test_levels_of_two_work_and_counts_follow_the_area(head, example):
    two = replace(PARAMS, hierarchy=replace(PARAMS.hierarchy, n_levels=2))
    assert len(synthesize(groom(head), head, two).levels) == 2
    assert level_counts(example.hierarchy, 0.5, 0)[0] == 350
    assert level_counts(example.hierarchy, 0.5, 9)[0] == 9
    # a cap of the sphere, 2 pi r^2 (1 - cos 67.5 deg), less what the facets cut off
    cap = 2 * np.pi * 0.01 * (1 - np.cos(np.radians(67.5)))
    assert region_area(head, head.scalp) == pytest.approx(cap, rel=0.01)


def test_a_stage_can_cancel(head):
    def cancel(fraction, message):
        if fraction > 0.3:
            raise Cancelled("cancelled")

    with pytest.raises(Cancelled):
        synthesize(groom(head), head, PARAMS, progress=cancel)


def test_bad_input_is_refused(head, example):
    none = StrandSet(np.zeros((0, 3), np.float32), np.zeros(1, np.int32))
    with pytest.raises(InputError, match="no strands"):
        synthesize(none, head, PARAMS)
    with pytest.raises(InputError, match="no area"):
        synthesize_from(example, head, PARAMS, region=np.zeros(len(head.triangles), np.bool_))
    with pytest.raises(InputError, match="region has 3 triangles"):
        synthesize_from(example, head, PARAMS, region=np.ones(3, np.bool_))
    bald = Head(head.vertices, head.triangles, np.zeros_like(head.scalp), head.corner_uv)
    with pytest.raises(InputError, match="scalp"):
        synthesize(groom(head), bald, PARAMS)
    with pytest.raises(InputError, match="n_strands is -1"):
        SynthesisParams(n_strands=-1)
    few = groom(head, 30)
    with pytest.raises(InputError, match="30"):
        synthesize(few, head, PARAMS)


def test_sharp_coarsest_strands_are_those_of_the_example(head, example):
    coarsest = example.hierarchy.levels[-1]
    roots = place_roots(example.space, scatter_roots(head, head.scalp, 50, 9), PARAMS.n_samples)
    sharp, _, _ = synthesize_coarsest(coarsest, roots, PARAMS)
    soft, _, _ = synthesize_coarsest(coarsest, roots, replace(PARAMS, sharpness=0.0))
    half, _, _ = synthesize_coarsest(coarsest, roots, replace(PARAMS, sharpness=0.5))
    distances = np.abs(sharp.points[:, None] - coarsest.points[None]).max(axis=(2, 3)).min(axis=1)
    assert distances.max() == 0
    np.testing.assert_allclose(half.points, (sharp.points + soft.points) / 2, atol=1e-6)
    assert (soft.points[:, 0] == 0).all()
