from __future__ import annotations

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.geometry.camera import (
    STANDARD_DIRECTIONS,
    camera_position,
    in_picture,
    orthographic_camera,
    perspective_camera,
    project,
    rays,
    resized,
    standard_camera,
    towards,
    unproject,
    view_direction,
)
from hairloom.types import Camera

CENTRE = np.array([0.1, -0.2, 1.5])


def cameras() -> list[Camera]:
    return [
        orthographic_camera((0.3, 0.9, -0.2), CENTRE, 1200.0, (640, 480)),
        perspective_camera(CENTRE + np.array([0.5, -1.4, 0.3]), CENTRE, 900.0, (640, 480)),
    ]


# where the picture shows the person's left (+x), back (+y) and top (+z): right, left, up, down, or along the view
SHOWN = {
    "front": {"x": (1, 0), "z": (0, -1)},
    "back": {"x": (-1, 0), "z": (0, -1)},
    "left": {"y": (1, 0), "z": (0, -1)},
    "right": {"y": (-1, 0), "z": (0, -1)},
    "top": {"x": (1, 0), "y": (0, -1)},
}


@pytest.mark.parametrize("name", STANDARD_DIRECTIONS)
def test_standard_views_show_the_world_the_right_way_round(name):
    camera = standard_camera(name, CENTRE, 1000.0, (800, 600))
    np.testing.assert_allclose(project(camera, CENTRE)[:2], [400, 300], atol=1e-9)
    for axis, shift in SHOWN[name].items():
        moved = CENTRE + 0.05 * np.eye(3)["xyz".index(axis)]
        np.testing.assert_allclose(project(camera, moved)[:2] - [400, 300], 50.0 * np.array(shift), atol=1e-9)
    # what is nearer to the camera is less deep
    nearer = CENTRE - 0.1 * np.array(STANDARD_DIRECTIONS[name])
    assert project(camera, nearer)[2] == pytest.approx(project(camera, CENTRE)[2] - 0.1)


@pytest.mark.parametrize("camera", cameras(), ids=["orthographic", "perspective"])
def test_points_lie_on_the_rays_through_their_pixels(camera):
    points = CENTRE + np.random.default_rng(0).uniform(-0.1, 0.1, (50, 3))
    seen = project(camera, points)
    origins, directions = rays(camera, seen[:, :2])
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-12)
    along = np.einsum("nc,nc->n", points - origins, directions)
    assert (along > 0).all()
    np.testing.assert_allclose(origins + along[:, None] * directions, points, atol=1e-9)
    np.testing.assert_allclose(unproject(camera, seen[:, :2], seen[:, 2]), points, atol=1e-9)
    np.testing.assert_allclose(towards(camera, points), -directions, atol=1e-9)
    assert in_picture(camera, seen).all()


def test_perspective_follows_the_pinhole():
    camera = perspective_camera((0, -2, 0), (0, 0, 0), 1000.0, (100, 100))
    np.testing.assert_allclose(project(camera, np.array([0.1, 0.0, 0.02])), [100, 40, 2], atol=1e-9)
    np.testing.assert_allclose(camera_position(camera), [0, -2, 0], atol=1e-12)
    np.testing.assert_allclose(view_direction(camera), [0, 1, 0], atol=1e-12)
    behind = project(camera, np.array([[0.1, -3.0, 0.0]]))
    assert np.isnan(behind[:, :2]).all() and not in_picture(camera, behind).any()


@pytest.mark.parametrize("camera", cameras(), ids=["orthographic", "perspective"])
def test_a_resized_camera_sees_the_same(camera):
    points = CENTRE + np.random.default_rng(1).uniform(-0.2, 0.2, (20, 3))
    half = resized(camera, 0.5)
    assert half.size == (320, 240)
    np.testing.assert_allclose(project(half, points)[:, :2], project(camera, points)[:, :2] / 2.0, atol=1e-9)
    odd = resized(camera, 0.3333)
    assert odd.size == (213, 160)
    corner = np.array([[640.0, 480.0]])  # corners stay corners, also where the size is rounded
    there = unproject(camera, corner, np.array([2.0]))
    np.testing.assert_allclose(project(odd, there)[0, :2], [213, 160], atol=1e-9)


def test_cameras_that_cannot_be_are_refused():
    with pytest.raises(InputError, match="up"):
        orthographic_camera((0, 0, -1), CENTRE, 1000.0)
    with pytest.raises(InputError, match="look along"):
        orthographic_camera((0, 0, 0), CENTRE, 1000.0)
    with pytest.raises(InputError, match="scale"):
        orthographic_camera((0, 1, 0), CENTRE, -5.0)
    with pytest.raises(InputError, match="'side' is no standard view"):
        standard_camera("side", CENTRE, 1000.0)
    with pytest.raises(InputError, match="resized"):
        resized(cameras()[0], 0.0)
    with pytest.raises(InputError, match="shape"):
        rays(cameras()[0], np.zeros((3, 3)))
