"""Refinement of real grooms: strands agree more, roots stay, the head stays free of hair."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hairloom.geometry.head import find_scalp, read_head
from hairloom.geometry.scalp_space import ScalpSpace, fit_scalp_space, root_strands
from hairloom.geometry.strands import join_strands, polyline_lengths
from hairloom.io.strands import read_strands
from hairloom.synthesis.refinement import PAPER, RefineParams, refine
from hairloom.types import RootedStrands

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


@pytest.mark.parametrize("params", [RefineParams(), RefineParams(spacing=0.005), PAPER], ids=["own", "fine", "paper"])
def test_spread_falls_and_roots_stay(groom: Groom, params: RefineParams) -> None:
    strands, space = groom
    refined, report = refine(strands, space, params, example=strands)
    assert report.spread_after < report.spread_before
    assert refined.roots.tobytes() == strands.roots.tobytes()
    assert (refined.points[:, 0] == 0).all()
    assert np.isfinite(refined.points).all()


def test_hair_keeps_out_of_the_head_and_keeps_its_length(groom: Groom) -> None:
    strands, space = groom
    refined, _ = refine(strands, space)
    before, after = strands.in_head_space(), refined.in_head_space()
    own_height, height = space.to_scalp(before)[..., 2], space.to_scalp(after)[..., 2]
    assert (height >= np.minimum(own_height, RefineParams().clearance) - 1e-5).all()
    ratio = polyline_lengths(after) / np.maximum(polyline_lengths(before), 1e-6)
    assert abs(np.median(ratio) - 1) < 1e-4
