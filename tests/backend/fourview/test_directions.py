"""Directions over a surface: known stripes, strokes, and hair of the database as guess and as stand-in."""

from types import SimpleNamespace

import numpy as np
import pytest
from direction_scenes import RADII, degrees_between, ellipsoid_mesh, ellipsoid_texels, level_lines
from hairloom.errors import Cancelled, InputError
from hairloom.fourview.directions import (
    DirectionParams,
    SurfaceDirections,
    find_directions,
    reduced,
    strand_directions,
    surface_orientations,
)
from hairloom.fourview.regions import make_graph, make_regions
from hairloom.fourview.strokes import stroke_directions
from hairloom.fourview.texture import HairTexture
from hairloom.fourview.views import DirectionStroke
from hairloom.geometry.analytic_heads import sphere_head
from hairloom.geometry.camera import project, standard_camera
from hairloom.geometry.strands import from_dense
from hairloom.types import StrandSet

AXIS = np.array([1.0, 0.2, 0.0])
PARAMS = DirectionParams(region_size=0.015)
NO_HAIR = StrandSet(np.zeros((0, 3), np.float32), np.zeros(1, np.int32))


class Scene:
    """An ellipsoid with stripes around `AXIS`, on which hair grows downwards at the front and at the back."""

    def __init__(self):
        self.texels = ellipsoid_texels(72)
        height = self.texels.points @ AXIS
        grey = 0.5 + 0.3 * np.sin(2 * np.pi * height / (4 * self.texels.spacing))
        self.colour = np.repeat(grey[:, None], 3, axis=1).astype(np.float32)
        self.surface = SimpleNamespace(levels=(SimpleNamespace(texels=self.texels),), mesh=ellipsoid_mesh())
        self.head = sphere_head(0.07)
        down = level_lines(self.texels.normals, AXIS)
        self.down = down * np.where(down[:, 2] > 0, -1, 1)[:, None]
        # at the sides the stripes are far apart, at the top and bottom down is nowhere
        steep = np.linalg.norm(np.cross(self.texels.normals, AXIS), axis=1) > 0.6
        self.clear = steep & (np.abs(self.down[:, 2]) > 0.3)
        self.camera = standard_camera("front", (0, 0, 0), 2500, (800, 800))

    def texture(self, coverage=1.0, colour=None):
        seen = np.broadcast_to(np.float32(coverage), (self.texels.n_texels,)).copy()
        return HairTexture(self.texels.size, self.texels.texels, self.colour if colour is None else colour, seen)

    def find(self, strokes=(), strands=NO_HAIR, **options):
        shape = SimpleNamespace(closed=self.surface.mesh, strands=strands)
        texture = options.pop("texture", self.texture())
        return find_directions(texture, self.surface, shape, [], self.head, strokes, PARAMS, **options)

    def stroke(self, *places):
        """From the world places (n, 3) as seen from the front."""
        return DirectionStroke(self.camera, project(self.camera, np.array(places, np.float64))[:, :2].copy())


@pytest.fixture(scope="module")
def scene():
    return Scene()


def combed(scene, turn):
    """Strands that lie on the ellipsoid and run along `down` times `turn`."""
    start = scene.texels.points[::7].astype(np.float64)
    step = turn * scene.down[::7] * 0.004
    return from_dense((start[:, None] + np.linspace(-1, 1, 3)[:, None] * step[:, None]).astype(np.float32))


def test_orientation_follows_the_stripes_and_the_guess_is_down(scene):
    found = scene.find()
    assert isinstance(found, SurfaceDirections)
    error = degrees_between(found.directions, scene.down)[scene.clear]
    assert np.median(error) < 2 and np.percentile(error, 95) < 8  # bins of the bank are 5.6 degrees
    signed = degrees_between(found.directions, scene.down, signed=True)[scene.clear]
    assert (signed < 90).mean() > 0.99
    assert np.allclose(np.linalg.norm(found.directions, axis=1), 1, atol=1e-5)


def test_hair_of_the_database_is_a_better_guess_than_gravity(scene):
    found = scene.find(strands=combed(scene, -1))
    signed = degrees_between(found.directions, scene.down, signed=True)[scene.clear]
    assert (signed > 90).mean() > 0.99


def test_a_stroke_turns_its_side_and_binds_whatever_the_guess_says(scene):
    up = scene.stroke([0.02, 0, -0.06], [0.02, 0, 0.06])
    found = scene.find([up], strands=combed(scene, 1))
    near = (np.abs(scene.texels.points[:, 0] - 0.02) < 0.004) & (scene.texels.points[:, 1] < -0.05)
    near &= np.abs(scene.texels.points[:, 2]) < 0.05
    signed = degrees_between(found.directions, scene.down, signed=True)
    assert (signed[near] > 90).all()
    back = scene.clear & (scene.texels.points[:, 1] > 0.04)
    assert (signed[back] < 90).mean() > 0.98


def test_a_stroke_across_the_hair_changes_nothing(scene):
    across = scene.stroke([-0.04, 0, 0.0], [0.04, 0, 0.0])
    assert scene.find([across]).directions.tobytes() == scene.find().directions.tobytes()


def test_unseen_texels_follow_the_database(scene):
    # a plain texture says nothing; hair along the stripes does
    plain = scene.texture(0.0, np.full_like(scene.colour, 0.5))
    found = scene.find(strands=combed(scene, 1), texture=plain)
    error = degrees_between(found.directions, scene.down, signed=True)[scene.clear]
    assert np.median(error) < 5 and np.percentile(error, 95) < 20
    # where the photos see stripes, hair of the database that lies across is overruled
    other = level_lines(scene.texels.normals, scene.down)[::7]
    start = scene.texels.points[::7].astype(np.float64)
    across = from_dense((start[:, None] + np.linspace(-1, 1, 3)[:, None] * 0.004 * other[:, None]).astype(np.float32))
    found = scene.find(strands=across)
    assert np.median(degrees_between(found.directions, scene.down)[scene.clear]) < 3


def test_strokes_land_where_their_view_sees_the_surface(scene):
    stroke = scene.stroke([0.03, 0, 0.05], [0.03, 0, -0.05])
    drawn = stroke_directions([stroke], scene.surface.mesh, scene.texels, 0.004)
    marked = np.flatnonzero(drawn.any(axis=1))
    points = scene.texels.points[marked]
    assert len(marked) > 50
    assert (points[:, 1] < 0).all() and np.abs(points[:, 0] - 0.03).max() < 0.0045
    assert (drawn[marked, 2] < -0.5).all()
    assert np.allclose(np.einsum("tc,tc->t", drawn[marked], scene.texels.normals[marked]), 0, atol=1e-5)


def test_of_two_strokes_the_straighter_view_wins(scene):
    left = standard_camera("left", (0, 0, 0), 2500, (800, 800))
    x = 0.03
    y = -RADII[1] * np.sqrt(1 - (x / RADII[0]) ** 2)
    line = np.array([[x, y, 0.03], [x, y, -0.03]])
    front_down = DirectionStroke(scene.camera, project(scene.camera, line)[:, :2].copy())
    left_up = DirectionStroke(left, project(left, line[::-1])[:, :2].copy())
    for strokes in ([front_down, left_up], [left_up, front_down]):
        drawn = stroke_directions(strokes, scene.surface.mesh, scene.texels, 0.003)
        near = np.linalg.norm(scene.texels.points[:, :2] - [x, y], axis=1) < 0.002
        near &= np.abs(scene.texels.points[:, 2]) < 0.015
        assert near.sum() > 5 and (drawn[near, 2] < 0).all()


def test_regions_cover_the_surface_and_are_as_far_apart_as_asked(scene):
    texels = scene.texels
    graph = make_graph(texels.edges, texels.n_texels)
    regions = make_regions(graph, texels.edges, texels.points, texels.normals, 6)
    assert regions.region.min() == 0 and len(np.unique(regions.region)) == regions.count
    away = np.linalg.norm(texels.points - regions.points[regions.region], axis=1)
    assert away.max() < 12 * texels.spacing
    assert 15 < regions.sizes.mean() < 200
    assert (regions.edges[:, 0] < regions.edges[:, 1]).all()


def test_strand_directions_are_those_of_the_nearest_hair():
    points = np.zeros((50, 5, 3), np.float32)
    points[..., 2] = -np.linspace(0, 0.1, 5)
    points[..., 0] = np.linspace(0, 0.5, 50)[:, None]
    directions, agreement = strand_directions(
        from_dense(points), np.array([[0.2, 0.003, -0.05], [0.2, 1.0, 0.0]]), 0.02
    )
    assert np.allclose(directions, [[0, 0, -1], [0, 0, 0]])
    assert agreement == pytest.approx([1, 0])


def test_reduced_is_the_mean_of_the_finer_texels():
    fine, coarse = ellipsoid_texels(32, gutter=2), ellipsoid_texels(16, gutter=1)
    values = np.stack([fine.points[:, 0], fine.texels.astype(np.float32)], axis=1)
    means = reduced(values, fine, coarse)
    assert np.abs(means[:, 0] - coarse.points[:, 0]).max() < 2e-3  # a fine texel is 5 mm wide, the surface curved
    grid = np.zeros((fine.size, fine.size), np.float32)
    grid.ravel()[fine.texels] = values[:, 0]
    row, column = divmod(int(coarse.texels[5]), coarse.size)
    assert means[5, 0] == pytest.approx(grid[2 * row : 2 * row + 2, 2 * column : 2 * column + 2].mean(), abs=1e-6)


def test_cancel_and_bad_input(scene):
    def cancel(fraction, message):
        raise Cancelled("enough")

    with pytest.raises(Cancelled):
        scene.find(progress=cancel)
    with pytest.raises(InputError, match="stroke 1 lies nowhere on the hair"):
        scene.find([DirectionStroke(scene.camera, np.array([[1.0, 1.0], [5.0, 5.0]]))])
    with pytest.raises(InputError, match="stroke 1 has no length"):
        scene.find([DirectionStroke(scene.camera, np.full((2, 2), 400.0))])
    other = HairTexture(8, np.arange(3, dtype=np.int32), np.zeros((3, 3), np.float32), np.zeros(3, np.float32))
    with pytest.raises(InputError, match="made for another surface"):
        surface_orientations(other, scene.surface)
    with pytest.raises(InputError, match="region_size is 5"):
        DirectionParams(region_size=5)
