"""The instrument that compares textures, on a cylinder with stripes: does it measure what it says?"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from cylinder_surface import RADIUS, look, make_level, make_view, stripes
from hairloom.fourview.projection import ViewsOnTexels
from hairloom.types import StrandSet

sys.path.insert(0, str(Path(__file__).parent / "renders"))

from texture_quality import (
    KINDS,
    Truth,
    axes_on,
    degrees_between,
    gradient_energy,
    kinds,
    plain_texture,
    true_axes,
    visible_hair,
)


@pytest.fixture(scope="module")
def level():
    return make_level(256)


def helices(slope, n_strands=400, n_points=60):
    """Strands along the stripes of `cylinder_surface.stripes`: RADIUS * slope * theta + z does not change."""
    theta = np.linspace(0, 2 * np.pi, n_strands, endpoint=False)[:, None] + np.linspace(0, 1.2, n_points)
    z = 0.06 - RADIUS * abs(slope) * np.linspace(0, 1.2, n_points) + 0 * theta
    theta = theta if slope > 0 else -theta
    points = np.stack([RADIUS * np.cos(theta), RADIUS * np.sin(theta), z], axis=-1).reshape(-1, 3)
    return StrandSet(points.astype(np.float32), np.arange(n_strands + 1, dtype=np.int32) * n_points)


def painted(texels, slope):
    theta = np.arctan2(texels.points[:, 1], texels.points[:, 0])
    return stripes(theta, texels.points[:, 2].astype(np.float64), slope=slope).astype(np.float32)


@pytest.mark.parametrize("slope", [1.0, -1.0])
def test_stripes_along_the_strands_are_no_error(level, slope):
    texels = level.texels
    axes, known = true_axes(visible_hair(helices(slope), None), texels)
    assert known.mean() > 0.5  # the strands cover z in [-0.06, 0.06]; they reach no further
    right, wrong = (
        np.median(degrees_between(axes_on(texels, painted(texels, s))[0], axes)[known]) for s in (slope, -slope)
    )
    assert right < 3 and wrong > 80  # strands at 45 degrees; 32 filters are 5.6 degrees apart


def test_texels_far_from_hair_or_where_it_crosses_have_no_truth(level):
    texels = level.texels
    at = texels.points[:1]
    tangent = np.cross(texels.normals[0], [0, 0, 1.0])
    one = np.repeat(tangent[None], 8, axis=0)
    crossing = np.where(np.arange(8)[:, None] % 2 == 0, tangent, [0, 0, 1.0])
    for tangents, expected in ((one, True), (crossing, False)):
        truth = Truth(np.repeat(at, 8, axis=0), tangents.astype(np.float32))
        axes, known = true_axes(truth, texels)
        assert known[0] == expected
        far = np.linalg.norm(texels.points - at, axis=1) > 0.0061
        assert not known[far].any()
        if expected:
            assert abs(axes[0] @ tangent) == pytest.approx(1, abs=1e-5)


def test_kinds_part_the_texels():
    facing = np.float32([[0.9, 0.8, 0.6, 0.9, 0.9], [0.0, 0.7, 0.5, 0.2, 0.8]])
    visible = np.array([[True, True, True, True, False], [False, True, True, True, False]])
    found = kinds(ViewsOnTexels(np.zeros((2, 5, 2), np.float32), visible, visible, facing))
    # 0.2 of 1.1 is less than a fifth
    names = [next(kind for kind in KINDS if found[kind][texel]) for texel in range(5)]
    assert names == ["one view", "overlap", "grazing", "one view", "hole"]
    assert np.sum([found[kind] for kind in KINDS]) == 5


def test_plain_texture_is_the_weighted_mean_and_fills_holes(level):
    def flat(value):
        return lambda theta, z: np.broadcast_to(np.float64(value), (*np.shape(theta), 3))

    views = [make_view("front", flat(0.2)), make_view("left", flat(0.6))]
    seen = look(level, views)
    colours = plain_texture(level.texels, seen, views)
    weights = seen.facing * seen.visible
    both = (weights > 0.1).all(axis=0)
    expected = (0.2 * weights[0] + 0.6 * weights[1]) / np.maximum(weights.sum(axis=0), 1e-9)
    np.testing.assert_allclose(colours[both, 0], expected[both], atol=0.005)  # photos have steps of 1 / 255
    hole = ~seen.visible.any(axis=0)
    assert hole.any() and colours[hole].min() > 0.19 and colours[hole].max() < 0.61


def test_blur_lowers_the_gradient_energy(level):
    texels = level.texels
    sharp, other = painted(texels, 1.0), painted(texels, -1.0)
    energy = gradient_energy(texels, sharp).mean()
    assert gradient_energy(texels, 0.5 * (sharp + other)).mean() == pytest.approx(0.5 * energy, rel=0.1)
