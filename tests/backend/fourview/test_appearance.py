"""Colours of strands: what a photo shows, never the background's, and sensible ones where no photo looks."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.fourview.appearance import ColourParams, point_colours, strand_colours
from hairloom.fourview.views import View
from hairloom.geometry.camera import standard_camera
from hairloom.geometry.head import sphere_head
from hairloom.geometry.strand_raster import raster_strands
from hairloom.geometry.strands import from_dense

BACKGROUND = (255, 0, 255)
HEAD = sphere_head(0.09, n_rings=24)


def hanging(n_strands=4000, n_points=24, layers=(0.095, 0.11), seed=0):
    """Strands straight down around the head, on cylinders."""
    random = np.random.default_rng(seed)
    angle = random.uniform(0.0, 2 * np.pi, n_strands)
    radius = random.uniform(*layers, n_strands)
    height = np.linspace(0.1, -0.1, n_points)
    points = np.empty((n_strands, n_points, 3), np.float32)
    points[..., 0], points[..., 1] = (radius * np.cos(angle))[:, None], (radius * np.sin(angle))[:, None]
    points[..., 2] = height
    return from_dense(points)


def true_colours(points):
    """Smooth over the height and around, about 5 cm from light to dark."""
    return 0.5 + 0.25 * np.stack([np.sin(30 * points[:, 2]), np.sin(20 * points[:, 0]), np.cos(20 * points[:, 1])], 1)


def photographed(strands, names=("front", "back", "left", "right"), size=160):
    views = []
    for name in names:
        camera = standard_camera(name, (0, 0, 0), 3.5 * size, (size, size))
        raster = raster_strands(camera, strands, HEAD, 2.0)
        image = np.full((size, size, 3), BACKGROUND, np.uint8)
        image[raster.mask] = np.rint(255 * true_colours(strands.points[raster.segment[raster.mask]]))
        views.append(View(name, image, raster.mask, camera))
    return views


def test_visible_hair_has_the_photos_colours():
    strands = hanging()
    views = photographed(strands)
    colours = point_colours(strands, views, HEAD)
    assert colours.shape == (len(strands.points), 3) and colours.dtype == np.float32
    error = np.abs(colours - true_colours(strands.points)).max(axis=1)
    shown = np.unique(np.concatenate([
        (raster := raster_strands(view.camera, strands, HEAD)).segment[raster.mask] for view in views
    ]))  # fmt: skip
    # colours change by 0.06 over the 9 mm between points, two of which are averaged, and strands are drawn 4 mm wide
    assert np.median(error[shown]) < 0.05
    assert np.percentile(error[shown], 95) < 0.15


def test_one_colour_a_strand_is_the_mean_of_what_is_seen():
    strands = hanging()
    views = photographed(strands)
    colours = strand_colours(strands, views, HEAD)
    assert colours.shape == (strands.n_strands, 3)
    true = true_colours(strands.points).reshape(strands.n_strands, -1, 3).mean(axis=1)
    assert np.median(np.abs(colours - true)) < 0.05


def test_hidden_strands_take_the_colours_around_them():
    outer, inner = hanging(4000, layers=(0.105, 0.11)), hanging(300, layers=(0.09, 0.092), seed=1)
    joined = from_dense(np.concatenate([outer.points.reshape(4000, 24, 3), inner.points.reshape(300, 24, 3)]))
    views = photographed(joined)
    colours = point_colours(joined, views, HEAD, ColourParams(depth=0.001))
    hidden = slice(4000 * 24, None)
    error = np.abs(colours[hidden] - true_colours(joined.points[hidden])).max(axis=1)
    # 2 cm from what is seen
    assert np.median(error) < 0.1


def test_the_side_that_no_photo_shows_is_filled_smoothly():
    strands = hanging()
    front = photographed(strands, ("front",))
    colours = point_colours(strands, front, HEAD)
    assert np.isfinite(colours).all()
    # within what the photo has, and no background: magenta is red and blue without green
    low, high = front[0].image[front[0].mask].min(axis=0) / 255, front[0].image[front[0].mask].max(axis=0) / 255
    assert (colours >= low - 0.01).all() and (colours <= high + 0.01).all()


def test_no_background_at_the_masks_border():
    strands = hanging()
    views = photographed(strands)
    # masks a pixel too large, as blurred photos have them
    wide = []
    for view in views:
        mask = view.mask.copy()
        mask[:, 1:] |= view.mask[:, :-1]
        mask[:, :-1] |= view.mask[:, 1:]
        wide.append(View(view.name, view.image, mask, view.camera))
    colours = point_colours(strands, wide, HEAD)
    assert colours[:, 1].min() > 0.2  # hair's green is 0.25 and more


def test_nothing_in_sight_gives_the_photos_mean():
    strands = hanging(10)
    view = photographed(hanging(), ("front",))[0]
    away = standard_camera("front", (5.0, 0.0, 0.0), 560.0, (160, 160))
    colours = strand_colours(strands, [View("front", view.image, view.mask, away)], HEAD)
    np.testing.assert_allclose(colours, np.tile(view.image[view.mask].mean(axis=0) / 255, (10, 1)), atol=1e-5)


def test_no_photo():
    with pytest.raises(InputError, match="no photo"):
        strand_colours(hanging(10), [], HEAD)
    with pytest.raises(InputError, match="along is 0"):
        ColourParams(along=0.0)


def test_same_bytes_for_any_number_of_threads():
    strands = hanging(500)
    views = photographed(strands, ("front", "left"))
    first = point_colours(strands, views, HEAD)
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        second = point_colours(strands, views, HEAD)
    finally:
        numba.set_num_threads(before)
    assert first.tobytes() == second.tobytes()
