"""The hierarchy of wisps: numbers of wisps, center strands and their roots, cancel, bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hairloom.errors import Cancelled, InputError
from hairloom.geometry.analytic_heads import sphere_head
from hairloom.geometry.scalp_space import ScalpSpace, fit_scalp_space
from hairloom.synthesis.hierarchy import HierarchyParams, build_hierarchy, center_strands
from hairloom.synthesis.wisps import WispParams, WispSet
from hairloom.types import RootedStrands
from wisp_hair import check_wisps, largest_error, noisy_hair

WISPS = WispParams(n_wisps=10, error_threshold=2.0)  # 2.0 for 64 points is 0.19 for the 6 of noisy_hair


@pytest.fixture(scope="module")
def space() -> ScalpSpace:
    return fit_scalp_space(sphere_head())


@pytest.fixture(scope="module")
def strands(space: ScalpSpace) -> RootedStrands:
    return on_scalp(noisy_hair(900), space)


def on_scalp(hair: RootedStrands, space: ScalpSpace) -> RootedStrands:
    roots = space.from_scalp(np.concatenate([hair.uv, np.zeros((hair.n_strands, 1), np.float32)], axis=1))
    return RootedStrands(roots, space.frames_at(hair.uv), hair.uv, hair.points)


@pytest.mark.parametrize("n_levels", [2, 3, 4])
def test_levels(space: ScalpSpace, strands: RootedStrands, n_levels: int) -> None:
    hierarchy, wisp_sets = build_hierarchy(strands, space, HierarchyParams(n_levels=n_levels, wisps=WISPS))
    assert hierarchy.n_levels == n_levels and len(wisp_sets) == n_levels - 1
    assert hierarchy.levels[0] is strands
    assert largest_error(strands, wisp_sets[0]) <= 2.0 * 6 / 64
    for level, wisps in enumerate(wisp_sets):
        check_wisps(hierarchy.levels[level], wisps)
        np.testing.assert_array_equal(hierarchy.labels[level], wisps.labels)
        np.testing.assert_array_equal(hierarchy.levels[level + 1].points, wisps.centers)
        if level > 0:
            assert wisps.n_wisps == round(wisp_sets[level - 1].n_wisps / 4)


def test_ratio(space: ScalpSpace, strands: RootedStrands) -> None:
    params = HierarchyParams(ratio=2.5, wisps=replace(WISPS, n_wisps=100, adaptive=False))
    hierarchy, _ = build_hierarchy(strands, space, params)
    assert [level.n_strands for level in hierarchy.levels] == [900, 100, 40]


def test_one_strand_is_left_at_least(space: ScalpSpace, strands: RootedStrands) -> None:
    params = HierarchyParams(n_levels=4, wisps=replace(WISPS, n_wisps=2, adaptive=False))
    hierarchy, _ = build_hierarchy(strands, space, params)
    assert [level.n_strands for level in hierarchy.levels] == [900, 2, 1, 1]


def test_roots_of_centers(space: ScalpSpace, strands: RootedStrands) -> None:
    """The scalp is the unit sphere: a root is the direction of the mean (u, v), and so is its frame's normal."""
    hierarchy, (wisps, _) = build_hierarchy(strands, space, HierarchyParams(wisps=WISPS))
    centers = hierarchy.levels[1]
    mean = np.array([strands.uv[wisps.labels == i].astype(float).mean(axis=0) for i in range(wisps.n_wisps)])
    np.testing.assert_allclose(centers.uv, mean, atol=1e-6)  # one float32 rounding of values about 2
    np.testing.assert_allclose(np.linalg.norm(centers.roots, axis=1), 1.0, atol=0.01)  # the head's mesh is coarse
    directions = centers.roots / np.linalg.norm(centers.roots, axis=1, keepdims=True)
    assert ((centers.frames[:, :, 1] * directions).sum(axis=1) > 0.995).all()
    np.testing.assert_allclose(space.to_scalp(centers.roots)[:, :2], mean, atol=1e-4)
    assert len(np.unique(centers.uv, axis=0)) == wisps.n_wisps


def test_wisp_of_one_strand_is_that_strand(space: ScalpSpace, strands: RootedStrands) -> None:
    hierarchy, (wisps,) = build_hierarchy(
        strands, space, HierarchyParams(n_levels=2, wisps=replace(WISPS, error_threshold=1e-9))
    )
    assert wisps.n_wisps == strands.n_strands
    centers = hierarchy.levels[1]
    np.testing.assert_array_equal(centers.points[wisps.labels], strands.points)
    np.testing.assert_allclose(centers.roots[wisps.labels], strands.roots, atol=1e-6)  # the same point computed again
    np.testing.assert_allclose(centers.frames[wisps.labels], strands.frames, atol=1e-6)


def test_means_that_coincide_get_other_roots(space: ScalpSpace) -> None:
    """Four corners of a square and its middle, in three wisps: two opposite corners each, and the middle."""
    corners = np.array([[1.4, 1.4], [1.6, 1.6], [1.4, 1.6], [1.6, 1.4], [1.5, 1.5]], np.float32)
    hair = noisy_hair(5)
    hair = on_scalp(RootedStrands(hair.roots, hair.frames, corners, hair.points), space)
    labels = np.array([0, 0, 1, 1, 2], np.int32)
    wisps = WispSet(labels, hair.points[:3], np.array([1, 2, 4], np.int32), np.zeros(5, np.float32), (0.0,), ())
    uv = center_strands(hair, wisps, space).uv
    np.testing.assert_array_equal(uv, corners[[1, 2, 4]])


def test_same_bytes_again(space: ScalpSpace, strands: RootedStrands) -> None:
    first, second = (build_hierarchy(strands, space, HierarchyParams(wisps=WISPS))[0] for _ in range(2))
    for a, b in zip(first.levels, second.levels):
        assert a.points.tobytes() == b.points.tobytes() and a.roots.tobytes() == b.roots.tobytes()


def test_progress_and_cancel(space: ScalpSpace, strands: RootedStrands) -> None:
    seen: list[float] = []
    params = HierarchyParams(n_levels=4, wisps=WISPS)
    build_hierarchy(strands, space, params, progress=lambda fraction, message: seen.append(fraction))
    assert seen == sorted(seen) and seen[-1] == 1.0 and max(seen) == 1.0

    def cancel(fraction: float, message: str) -> None:
        if fraction > 0.85:
            raise Cancelled("cancelled")

    with pytest.raises(Cancelled):
        build_hierarchy(strands, space, params, progress=cancel)


@pytest.mark.parametrize("setting", [{"n_levels": 1}, {"n_levels": 5}, {"ratio": 1.0}, {"ratio": float("nan")}])
def test_settings_out_of_range(setting: dict[str, float]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(setting))} is"):
        HierarchyParams(**setting)
