"""Texels in the views: pixels, visibility, source regions, weights, the first texture (Z-12, Z-14, Z-15)."""

from dataclasses import replace

import numpy as np
import pytest
from hair_shapes import hair_shape, paint, painted_views
from hairloom.errors import InputError
from hairloom.fourview.projection import (
    ProjectionParams,
    ViewsOnTexels,
    fill_holes,
    initial_texture,
    project_views,
    sample_view,
)
from hairloom.fourview.surface import SurfaceParams, make_surface
from hairloom.fourview.views import View
from hairloom.geometry.camera import perspective_camera, project, rays, towards
from hairloom.geometry.head import HeadSurface
from hairloom.types import Head, Mesh


@pytest.fixture(scope="module")
def scene():
    open_mesh, closed = hair_shape()
    surface = make_surface(open_mesh, SurfaceParams(256, 1, atlas_vertices=600))
    return surface.levels[0].texels, painted_views(open_mesh, closed), closed


@pytest.fixture(scope="module")
def seen(scene):
    return project_views(*scene)


def first_surface(closed):
    scalp = np.zeros(len(closed.triangles), np.bool_)
    return HeadSurface(Head(closed.vertices, closed.triangles, scalp, np.zeros((len(scalp), 3, 2), np.float32)))


def test_pixels_and_facing_are_the_cameras(scene, seen):
    texels, views, _ = scene
    for index, view in enumerate(views):
        np.testing.assert_allclose(seen.pixels[index], project(view.camera, texels.points)[:, :2], atol=1e-3)
        facing = (texels.normals * towards(view.camera, texels.points)).sum(axis=1)
        np.testing.assert_allclose(seen.facing[index], np.maximum(facing, 0), atol=1e-5)


def test_visible_are_those_that_rays_reach_in_the_mask(scene, seen):
    texels, views, closed = scene
    surface = first_surface(closed)
    for index, view in enumerate(views):
        away = towards(view.camera, texels.points)
        # from 4 mm off the surface on, the tolerance of the z-buffer, which is coarse at the shape's outline
        distance, _ = surface.first_hits(texels.points + 0.004 * away, away)
        column, row = np.floor(seen.pixels[index]).astype(int).T
        truth = np.isinf(distance) & view.mask[row, column] & (seen.facing[index] > 0)
        assert (truth == seen.visible[index]).mean() > 0.98
        clear = seen.facing[index] > 0.3
        assert (truth[clear] == seen.visible[index][clear]).mean() > 0.995
        assert 0.1 < truth.mean() < 0.7


def test_sources_are_seen_within_the_angle(scene, seen):
    angle = np.arccos(np.clip(seen.facing, 0, 1))
    assert np.array_equal(seen.seen, seen.visible & (seen.facing > np.float32(np.cos(np.pi / 4))))
    assert angle[seen.seen].max() < np.pi / 4 + 1e-3
    wide = project_views(*scene, ProjectionParams(source_angle=np.pi / 3))
    assert (wide.seen | seen.seen == wide.seen).all() and wide.seen.sum() > seen.seen.sum()


def test_a_wall_hides(scene):
    texels, views, closed = scene
    front = views[0]
    wall = np.float32([[-1, -0.5, -1], [1, -0.5, -1], [1, -0.5, 1], [-1, -0.5, 1]])
    count = len(closed.vertices)
    triangles = np.concatenate([closed.triangles, np.int32([[0, 1, 2], [0, 2, 3]]) + count])
    hidden = project_views(texels, [front], Mesh(np.concatenate([closed.vertices, wall]), triangles))
    assert not hidden.visible.any() and hidden.facing.max() > 0.9


def test_what_hides_is_more_than_the_tolerance_in_front(scene, seen):
    """The shape itself, moved towards the camera: what was seen well stays visible behind 2 mm, and not behind 8."""
    texels, views, closed = scene
    well = seen.visible[0] & (seen.facing[0] > 0.7)
    for distance, share in ((0.002, 1.0), (0.008, 0.0)):
        moved = Mesh(closed.vertices - np.float32([0, distance, 0]), closed.triangles)
        visible = project_views(texels, [views[0]], moved).visible[0, well]
        # bumps of 4 mm, drawn at the middles of pixels of 1.6 mm
        assert visible.mean() == pytest.approx(share, abs=0.03)


def test_outside_the_picture_nothing_is_visible(scene):
    texels, views, closed = scene
    camera = views[0].camera
    moved = camera.world_to_camera.copy()
    moved[0, 3] += 0.1
    seen = project_views(texels, [replace(views[0], camera=replace(camera, world_to_camera=moved))], closed)
    outside = seen.pixels[0, :, 0] >= 200
    assert outside.sum() > 100 and not seen.visible[0, outside].any()


def test_perspective(scene):
    texels, views, closed = scene
    camera = perspective_camera((0.05, -0.6, 0.1), (0, 0, 0), 400, (200, 200))
    view = View("other", views[0].image, np.ones((200, 200), np.bool_), camera)
    seen = project_views(texels, [view], closed)
    np.testing.assert_allclose(seen.pixels[0], project(camera, texels.points)[:, :2], atol=1e-3)
    facing = (texels.normals * towards(camera, texels.points)).sum(axis=1)
    np.testing.assert_allclose(seen.facing[0], np.maximum(facing, 0), atol=1e-5)
    origins, directions = rays(camera, seen.pixels[0])
    distance, _ = first_surface(closed).first_hits(origins, directions)
    reached = distance > np.linalg.norm(texels.points - origins, axis=1) - 0.004
    clear = seen.facing[0] > 0.3
    assert (reached == seen.visible[0])[clear].mean() > 0.995 and 0.1 < reached.mean() < 0.6


def test_behind_a_perspective_camera_nothing_is_seen(scene):
    texels, views, closed = scene
    camera = perspective_camera((0, -0.6, 0), (0, -1, 0), 400, (200, 200))
    view = View("away", views[0].image, np.ones((200, 200), np.bool_), camera)
    seen = project_views(texels, [view], closed)
    assert not seen.visible.any() and (seen.facing == 0).all() and np.isfinite(seen.pixels).all()


def test_alpha(seen):
    total = seen.alpha.sum(axis=0)
    faced = seen.facing.sum(axis=0) > 0
    np.testing.assert_allclose(total[faced], 1, atol=1e-6)
    assert (total[~faced] == 0).all()
    pair = ViewsOnTexels(
        np.zeros((2, 1, 2), np.float32), np.ones((2, 1), bool), np.ones((2, 1), bool), np.float32([[0.6], [0.2]])
    )
    np.testing.assert_allclose(pair.alpha, [[0.75], [0.25]])


def test_first_texture_is_the_paint_where_it_is_seen(scene, seen):
    texels, views, _ = scene
    colours = initial_texture(texels, seen, views)
    assert colours.dtype == np.float32 and colours.min() >= 0 and colours.max() <= 1
    found = seen.seen.any(axis=0)
    error = np.abs(colours - paint(texels.points)).max(axis=1)
    # colours change by up to 0.24 a centimetre; a pixel is 1.6 mm, bilinear, and the shape is remeshed
    assert np.median(error[found]) < 0.01 and np.percentile(error[found], 99) < 0.04
    # nothing of the magenta around, which is 0.5 off: holes are continued from their borders
    assert np.percentile(error, 99) < 0.25


def test_the_view_that_faces_most_wins(scene, seen):
    texels, views, _ = scene
    plain = [replace(view, image=np.full_like(view.image, 40 * (index + 1))) for index, view in enumerate(views)]
    colours = initial_texture(texels, seen, plain)
    found = seen.visible.any(axis=0)
    winner = np.where(seen.visible, seen.facing, -1).argmax(axis=0)
    np.testing.assert_allclose(colours[found, 0], (40 * (winner[found] + 1)) / 255, atol=1e-6)
    assert len(np.unique(winner)) == 4


def test_masked_sampling_takes_no_background(scene):
    view = scene[1][0]
    image = np.where(view.mask[..., None], np.uint8(100), np.uint8(255)).repeat(3, axis=2)
    rows, columns = np.nonzero(view.mask)
    pixels = np.stack([columns, rows], axis=1).astype(np.float32) + np.float32(0.05)
    colours = sample_view(replace(view, image=image), pixels, np.ones(len(pixels), np.bool_))
    np.testing.assert_allclose(colours, 100 / 255, atol=1e-6)
    assert (sample_view(view, pixels, np.zeros(len(pixels), np.bool_)) == 0).all()


def test_bilinear_sampling(scene):
    view = scene[1][0]
    ramp = np.zeros_like(view.image)
    ramp[..., 0], ramp[..., 1] = np.arange(200), np.arange(200)[:, None]
    everywhere = replace(view, image=ramp, mask=np.ones_like(view.mask))
    pixels = np.random.default_rng(0).uniform(0.5, 199.5, (500, 2)).astype(np.float32)
    colours = sample_view(everywhere, pixels, np.ones(500, np.bool_))
    np.testing.assert_allclose(255 * colours[:, :2], pixels - 0.5, atol=1e-3)


def test_holes_by_inverse_distance_of_their_borders(scene):
    texels = scene[0]
    colours = paint(texels.points).astype(np.float32)
    known = np.linalg.norm(texels.points - texels.points[::-1][0], axis=1) > 0.03
    filled = fill_holes(texels, np.where(known[:, None], colours, 0).astype(np.float32), known)
    np.testing.assert_array_equal(filled[known], colours[known])
    border = np.zeros(texels.n_texels, np.bool_)
    for one, other in texels.edges:
        if known[one] != known[other]:
            border[one if known[one] else other] = True
    for hole in np.flatnonzero(~known)[::50]:
        weight = 1 / ((texels.points[border] - texels.points[hole]).astype(float) ** 2).sum(axis=1)
        np.testing.assert_allclose(filled[hole], weight @ colours[border] / weight.sum(), atol=1e-5)


def test_nothing_seen_is_an_error_that_names_the_views(scene, seen):
    texels, views, closed = scene
    blind = replace(seen, visible=np.zeros_like(seen.visible))
    with pytest.raises(InputError, match="front, back, left, right"):
        initial_texture(texels, blind, views)
    with pytest.raises(InputError, match="no views"):
        project_views(texels, [], closed)
    for bad in ({"source_angle": 0.0}, {"source_angle": 2.0}, {"tolerance": 0.0}):
        with pytest.raises(InputError):
            ProjectionParams(**bad)
