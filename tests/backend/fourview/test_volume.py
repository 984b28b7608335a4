"""Direction and normal volumes: analytic fields in an ellipsoid, the border, the roots."""

from types import SimpleNamespace

import numpy as np
import pytest
from direction_scenes import RADII, ellipsoid_mesh, ellipsoid_texels
from hairloom.errors import InputError
from hairloom.fields.tracing import trace_steps
from hairloom.fourview.directions import DirectionParams, SurfaceDirections
from hairloom.fourview.volume import direction_volume, normal_volume
from hairloom.geometry.analytic_heads import sphere_head
from hairloom.types import Mesh, StrandSet

NO_HAIR = StrandSet(np.zeros((0, 3), np.float32), np.zeros(1, np.int32))
PARAMS = DirectionParams(cells=48)


def shape(radii=RADII):
    return SimpleNamespace(closed=ellipsoid_mesh(radii), strands=NO_HAIR)


def bald(radius=0.004):
    """A head too small to matter, without a scalp."""
    return sphere_head(radius, scalp_angle_deg=0.0)


def surface_field(field, radii=RADII):
    texels = ellipsoid_texels(48, radii=radii)
    vectors = field(texels.points.astype(np.float64))
    vectors = (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)
    return SurfaceDirections(texels.points, vectors, np.ones(len(vectors), np.float32), texels.normals)


def sampled(grid, points):
    cell = np.floor((points - grid.origin) / grid.spacing).astype(int)
    within = ((cell >= 0) & (cell < grid.shape)).all(axis=1)
    cell = np.where(within[:, None], cell, 0)
    return np.where(within[:, None], grid.dense()[cell[:, 0], cell[:, 1], cell[:, 2]], 0)


def inner_points(rng, share=0.9, least=0.0, count=2000):
    unit = rng.normal(size=(count, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return unit * np.array(RADII) * rng.uniform(least, share, (count, 1))


def test_a_field_that_is_the_same_everywhere_stays_so():
    heading = np.array([0.6, 0.0, -0.8])
    grid = direction_volume(surface_field(lambda p: np.tile(heading, (len(p), 1))), shape(), bald(), PARAMS)
    assert np.allclose(sampled(grid, inner_points(np.random.default_rng(0))), heading, atol=1e-3)


def test_a_swirl_on_the_surface_swirls_inside():
    grid = direction_volume(
        surface_field(lambda p: np.stack([-p[:, 1], p[:, 0], np.zeros(len(p))], axis=1), (0.1, 0.1, 0.13)),
        shape((0.1, 0.1, 0.13)), bald(), PARAMS,
    )  # fmt: skip
    points = inner_points(np.random.default_rng(1), least=0.4)
    points = points[np.linalg.norm(points[:, :2], axis=1) > 0.03]
    around = np.stack([-points[:, 1], points[:, 0], np.zeros(len(points))], axis=1)
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    cosine = np.einsum("nc,nc->n", sampled(grid, points), around)
    # a point lies up to 0.7 cells of 5.4 mm from its cell's middle as seen along z: 7 degrees at 0.03 m
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 8
    assert np.allclose(np.abs(sampled(grid, points)[:, 2]), 0, atol=0.02)


def test_volume_ends_two_cells_beyond_the_surface():
    grid = direction_volume(surface_field(lambda p: p), shape(), bald(), PARAMS)
    unit = inner_points(np.random.default_rng(2)) / np.array(RADII)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    surface = unit * RADII
    outwards = surface / np.array(RADII) ** 2
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    length = np.linalg.norm(sampled(grid, surface + 0.5 * grid.spacing * outwards), axis=1)
    assert np.allclose(length, 1, atol=1e-5)
    assert not sampled(grid, surface + 4.5 * grid.spacing * outwards).any()
    lines, counts = trace_steps(grid, (0.5 * surface[:50]).astype(np.float32), np.full(50, 0.5), 0.002)
    ends = lines[np.arange(50), counts - 1]
    assert (np.linalg.norm(ends / np.array(RADII), axis=1) > 1).all()


def test_hair_leaves_the_scalp_along_its_normal_and_none_grows_in_the_head():
    head = sphere_head(0.07)
    down = surface_field(lambda p: np.tile([0.0, 0.0, -1.0], (len(p), 1)))
    grid = direction_volume(down, shape(), head, DirectionParams(cells=64, root_weight=10.0))
    top = np.array([[0.0, 0.0, 0.0715], [0.02, 0.0, 0.069]])
    assert (sampled(grid, top)[:, 2] > 0.7).all()
    assert not sampled(grid, np.array([[0.0, 0.0, 0.0], [0.0, 0.03, 0.03]])).any()
    # weak roots hardly count under a strong surface
    weak = direction_volume(down, shape(), head, DirectionParams(cells=64, root_weight=1e-3))
    assert sampled(weak, top)[0, 2] < sampled(grid, top)[0, 2]


def test_normals_point_outwards():
    field = surface_field(lambda p: np.tile([0.0, 0.0, -1.0], (len(p), 1)))
    grid = normal_volume(field, shape(), sphere_head(0.05), PARAMS)
    points = inner_points(np.random.default_rng(3), share=0.95, least=0.75)
    outwards = points / np.array(RADII) ** 2
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    cosine = np.einsum("nc,nc->n", sampled(grid, points), outwards)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 15


def test_bad_input():
    field = surface_field(lambda p: p)
    nothing = SimpleNamespace(closed=Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)), strands=NO_HAIR)
    with pytest.raises(InputError, match="the hair shape is empty"):
        direction_volume(field, nothing, bald(), PARAMS)
    far = SurfaceDirections(field.points + np.float32(9), field.directions, field.confidence, field.normals)
    with pytest.raises(InputError, match="no direction lies in the hair shape"):
        direction_volume(far, shape(), bald(), PARAMS)
