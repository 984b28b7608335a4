import numpy as np
import pytest
from hairloom.fourview.hull import (
    allowed_distance,
    grow,
    hull_box,
    inside_distance,
    make_cones,
    seen_hair,
    settle_rims,
    uncoverable,
    voxel_points,
)
from hairloom.fourview.solid import signed_distance, surface, voxels_around
from hairloom.fourview.views import View
from hairloom.types import Mesh
from radial_hair import HEAD, RADIUS, camera, dome, view, views

VOXELS = voxels_around(np.full(3, -0.19), np.full(3, 0.19), 56, 3.0)


def disc_view(name, radius, perspective=False, centre=(0.0, 0.0)):
    """A view whose mask is a disc of `radius` metres at the depth of the head's centre."""
    where = camera(name, perspective=perspective)
    y, x = np.mgrid[: where.size[1], : where.size[0]] + 0.5
    metres = 0.5 / where.size[0]
    mask = np.hypot(x - 120.0 - centre[0] / metres, y - 120.0 - centre[1] / metres) < radius / metres
    return View(name, np.zeros((*mask.shape, 3), np.uint8), mask, where)


def test_inside_distance_of_a_half_plane_passes_0_between_the_pixels():
    mask = np.zeros((20, 30), np.bool_)
    mask[:, 12:] = True
    assert np.allclose(inside_distance(mask)[5], np.arange(30) - 11.5)


@pytest.mark.parametrize("perspective", [False, True])
def test_allowed_distance_of_a_disc(perspective):
    cones = make_cones([disc_view("front", 0.15, perspective)], HEAD)
    points = np.array([[0.0, -0.12, 0.03], [0.1, -0.12, 0.03], [0.2, -0.12, 0.03]])
    widening = (1.5 - 0.12) / 1.5 if perspective else 1.0  # the cone's radius at that depth
    truth = 0.15 * widening - points[:, 0]
    assert np.allclose(allowed_distance(points, cones), truth, atol=0.003)  # 1.5 pixels: the mask's grain


def test_behind_the_head_hair_is_allowed_before_it_not():
    mask = np.zeros((240, 240), np.bool_)
    mask[0, 0] = True
    where = camera("front")
    cones = make_cones([View("front", np.zeros((240, 240, 3), np.uint8), mask, where)], HEAD)
    y = np.array([-0.2, -0.11, -0.05, 0.0, 0.3])
    points = np.stack([np.zeros(5), y, np.zeros(5)], axis=1)
    distance = allowed_distance(points, cones)
    assert (distance[:2] < 0).all() and np.allclose(distance[2:], y[2:] + RADIUS, atol=1e-3)
    assert np.allclose(allowed_distance(points, cones, 0.01)[2:], y[2:] + RADIUS - 0.01, atol=1e-3)


def test_beyond_the_picture_its_border_counts():
    mask = np.zeros((240, 240), np.bool_)
    mask[:, 120:] = True  # hair to the picture's right border and on
    cones = make_cones([View("front", np.zeros((240, 240, 3), np.uint8), mask, camera("front"))], HEAD)
    beyond = allowed_distance(np.array([[0.4, -0.2, 0.03], [-0.4, -0.2, 0.03]]), cones)
    assert beyond[0] > 0 and beyond[1] == pytest.approx(-0.4, abs=0.005)


def test_more_views_allow_less():
    both = make_cones([disc_view("front", 0.15), disc_view("left", 0.12)], HEAD)
    points = voxel_points(VOXELS)
    all_of = allowed_distance(points, both)
    each = np.minimum(allowed_distance(points, both[:1]), allowed_distance(points, both[1:]))
    assert (all_of == each).all()


def test_the_box_of_the_hull():
    cones = make_cones([disc_view("front", 0.15), disc_view("left", 0.12)], HEAD)
    low, high = hull_box(cones, np.full(3, -0.3), np.full(3, 0.3))
    step = 0.6 / 39
    # x from the front alone, y from the left alone, z from both; the head's own hidden side is within
    assert np.allclose(high, [0.15, 0.12, 0.15], atol=2.5 * step)
    assert np.allclose(low, [-0.15, -0.12, -0.09], atol=2.5 * step)


def test_growing_fills_a_gap_at_the_depth_of_the_hair_around():
    whole = dome(0.15)
    sample = views(whole)
    field = signed_distance(whole, VOXELS)
    points = voxel_points(VOXELS).reshape(*VOXELS.shape, 3)
    hole = np.linalg.norm(points - [0.0, -0.12, 0.1], axis=-1) < 0.03
    broken = np.where(hole, -0.01, field).astype(np.float32)
    cones = make_cones(sample, HEAD)
    allowed = allowed_distance(points.reshape(-1, 3), cones).reshape(VOXELS.shape)
    grown = grow(broken, allowed, VOXELS, cones, HEAD)
    assert (grown >= broken).all() and (grown <= np.maximum(broken, allowed)).all()
    depths = []
    for mesh in (surface(field, VOXELS), surface(grown, VOXELS)):
        seen, depth = seen_hair(cones[0].camera, mesh, cones[0].head_depth)
        depths.append(np.where(seen, depth, np.nan))
    gap = seen_hair(cones[0].camera, surface(broken, VOXELS), cones[0].head_depth)[0] < np.isfinite(depths[0])
    missing = gap & ~np.isfinite(depths[1])
    assert gap.sum() == 0 or missing.sum() <= 0.05 * gap.sum()
    assert np.nanmax(np.abs(depths[1] - depths[0])[gap], initial=0.0) < 0.05


def test_hair_grows_where_the_mask_has_hair_before_the_face():
    cap = dome(0.14)
    lower = disc_view("front", 0.17)
    cones = make_cones([lower], HEAD)
    field = signed_distance(cap, VOXELS)
    allowed = allowed_distance(voxel_points(VOXELS), cones).reshape(VOXELS.shape)
    before, after = surface(field, VOXELS), surface(grow(field, allowed, VOXELS, cones, HEAD), VOXELS)
    shares = [(seen_hair(lower.camera, mesh, cones[0].head_depth)[0] & lower.mask).sum() for mesh in (before, after)]
    assert shares[0] < 0.8 * lower.mask.sum() and shares[1] > 0.97 * lower.mask.sum()


def test_rims_settle_on_the_border_from_both_sides():
    # 6 voxels, up to where the surface moves, must be less than the way from the borders to the place between the views
    fine = voxels_around(np.full(3, -0.18), np.full(3, 0.18), 110, 3.0)
    sample = views(dome(0.15))
    cones = make_cones(sample, HEAD)
    for radius in (0.144, 0.156):
        field = signed_distance(dome(radius), fine)
        settled = surface(settle_rims(field, fine, cones, HEAD), fine)
        top = settled.vertices[:, 2].max()
        assert top == pytest.approx(0.15, abs=0.6 * fine.cell) and abs(top - 0.15) < 0.5 * abs(radius - 0.15)
        # between the views and lower down no outline passes: the surface stays
        between = np.array([0.6, 0.6, 0.28**0.5])
        across = settled.vertices[(settled.vertices @ between > 0.998 * np.linalg.norm(settled.vertices, axis=1))]
        # the median: single vertices near the dome's foot are within reach of its lower border
        assert abs(np.median(np.linalg.norm(across, axis=1)) - radius) < 0.2 * fine.cell


def test_a_mask_that_the_others_contradict_cannot_be_covered():
    cones = make_cones([disc_view("front", 0.12), disc_view("back", 0.17), disc_view("left", 0.12)], HEAD)
    share = uncoverable(1, cones, VOXELS, [0, 1, 2], 0.0)
    assert share == pytest.approx(1.0 - (0.12 / 0.17) ** 2, abs=0.06)  # coarse pictures
    assert uncoverable(0, cones, VOXELS, [0, 1, 2], 0.005) < 0.02
    assert uncoverable(1, cones, VOXELS, [1], 0.0) < 0.02
    assert uncoverable(1, cones, VOXELS, [0, 1, 2], 0.06) < 0.02


def test_a_view_of_nothing_grows_nothing():
    sample = view("front", dome(0.15))
    cones = make_cones([sample], HEAD)
    field = np.full(VOXELS.shape, -0.01, np.float32)
    assert (grow(field, field, VOXELS, cones, HEAD) == field).all()
    assert (settle_rims(field, VOXELS, cones, HEAD) == field).all()
    assert isinstance(surface(field, VOXELS), Mesh)
