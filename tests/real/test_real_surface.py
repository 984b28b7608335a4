"""The texture's surface on the rough shapes of real grooms: whole, even, covered by patches (Z-8 ... Z-10)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hairloom.fourview.clipping import clip_shape
from hairloom.fourview.remeshing import vertex_areas
from hairloom.fourview.shape import remove_detail
from hairloom.fourview.surface import HairSurface, SurfaceParams, make_surface
from hairloom.geometry.head import find_scalp, read_head
from hairloom.geometry.strands import join_strands
from hairloom.io.strands import read_strands
from hairloom.io.units import Units
from hairloom.types import Mesh

# the ponytail's head is 70 units high
GROOMS = {
    "sintel": (("hair",), Units(1.0, "Y")),
    "ponytail": (("front_top", "side", "back", "tail"), Units(0.24 / 70.0, "Y", "-Z")),
}


@pytest.fixture(scope="module", params=list(GROOMS))
def scene(request: pytest.FixtureRequest, data_dir: Path) -> tuple[Mesh, HairSurface]:
    folder = data_dir / request.param
    names, units = GROOMS[request.param]
    parts = [read_strands(folder / f"{name}.tfx", units=units) for name in names]
    head = find_scalp(read_head(folder / "head.obj", units), parts[0].roots)
    shape = clip_shape(remove_detail(join_strands(parts), head), [], head)
    return shape, make_surface(shape, SurfaceParams(texture_size=1024, n_scales=2))


def test_the_shape_is_kept(scene: tuple[Mesh, HairSurface]) -> None:
    shape, surface = scene
    # ragged edges and bumps finer than a vertex of the atlas' mesh are smoothed
    assert vertex_areas(surface.mesh.vertices, surface.mesh.triangles).sum() == pytest.approx(
        vertex_areas(shape.vertices, shape.triangles).sum(), rel=0.06
    )


def test_texels_and_patches(scene: tuple[Mesh, HairSurface]) -> None:
    for level in scene[1].levels:
        texels = level.texels
        degree = np.bincount(texels.edges.ravel(), minlength=texels.n_texels)
        assert degree.max() <= 4 and (degree == 4).mean() > 0.95
        assert texels.n_texels > 0.45 * texels.size**2  # at 2048: 0.53 and more, gutters are narrower
        valid = level.patch_texels >= 0
        covered = np.bincount(level.patch_texels[valid], minlength=texels.n_texels) > 0
        # what no patch has keeps its colour: texels where charts are stretched, or in sharp folds
        assert covered.mean() > 0.97 and valid.mean() > 0.85
        assert np.array_equal(np.sort(level.order), np.arange(level.n_vertices))
        assert (np.diff(level.neighbour_offsets) > 0).mean() > 0.999
