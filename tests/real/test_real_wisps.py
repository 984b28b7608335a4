"""Wisps of real grooms: connected, complete, under the threshold, the energy never above its start."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hairloom.geometry.head import find_scalp, read_head
from hairloom.geometry.scalp_space import ScalpSpace, fit_scalp_space, root_strands
from hairloom.geometry.strands import join_strands
from hairloom.io.strands import read_strands
from hairloom.synthesis.hierarchy import build_hierarchy
from hairloom.synthesis.wisps import WispParams, cluster_wisps
from hairloom.types import RootedStrands
from wisp_hair import check_wisps, largest_error

GROOMS = {
    "sintel": ("hair",),
    "ponytail": ("front_top", "side", "back"),  # the tail's roots are in the air
}
Groom = tuple[RootedStrands, ScalpSpace]


@pytest.fixture(scope="module", params=list(GROOMS))
def groom(request: pytest.FixtureRequest, data_dir: Path) -> Groom:
    folder = data_dir / request.param
    strands = join_strands([read_strands(folder / f"{part}.tfx") for part in GROOMS[request.param]])
    space = fit_scalp_space(find_scalp(read_head(folder / "head.obj"), strands.roots))
    return root_strands(strands, space, 64), space


def test_hierarchy(groom: Groom) -> None:
    strands, space = groom
    hierarchy, wisp_sets = build_hierarchy(strands, space)
    for level, wisps in zip(hierarchy.levels, wisp_sets):
        check_wisps(level, wisps)
    assert largest_error(strands, wisp_sets[0]) <= 0.2
    assert hierarchy.levels[2].n_strands == round(hierarchy.levels[1].n_strands / 4)
    assert len(np.unique(hierarchy.levels[2].uv, axis=0)) == hierarchy.levels[2].n_strands


def test_as_in_the_paper(groom: Groom) -> None:
    """Without our additions: the same guarantees with more wisps."""
    strands, _ = groom
    params = WispParams(seeds_per_wisp=1, seeds_per_split=1, merge=False, iterations_per_split=40)
    wisps = cluster_wisps(strands, params)
    check_wisps(strands, wisps)
    assert largest_error(strands, wisps) <= 0.2
    assert wisps.n_wisps > cluster_wisps(strands).n_wisps


@pytest.mark.parametrize("n_wisps", [1, 50, 400])
def test_fixed_number(groom: Groom, n_wisps: int) -> None:
    strands, _ = groom
    fixed = cluster_wisps(strands, WispParams(n_wisps=n_wisps, adaptive=False))
    check_wisps(strands, fixed)
    assert fixed.n_wisps == n_wisps
    if n_wisps > 1:
        random_seeds = cluster_wisps(strands, WispParams(n_wisps=n_wisps, adaptive=False, seeds_per_wisp=1))
        assert fixed.energies[-1] < random_seeds.energies[-1]
