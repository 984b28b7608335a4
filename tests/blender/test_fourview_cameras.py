"""Planes of photos and cameras: there and back, pixels and rays, perspective, handles, placement, bad planes."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import bpy
import fourview_scenes as small
import numpy as np
import pytest
import scenes
from mathutils import Euler, Matrix, Vector


def cameras():
    return scenes.module("bridge.camera")


def backend():
    return scenes.module("backend.geometry.camera")


def photo_at(tmp_path, matrix: Matrix, **settings) -> object:
    """One photo whose plane is moved."""
    small.start(tmp_path, ("front",))
    photo = small.project().photos[0]
    photo.plane.matrix_world = matrix
    for name, value in settings.items():
        setattr(photo, name, value)
    return photo


TURNED = Matrix.LocRotScale(Vector((0.02, -0.01, 0.05)), Euler((1.3, 0.2, -0.7)), Vector((0.6, 0.6, 0.6)))


@pytest.mark.parametrize("view", ["front", "back", "left", "right", "top"])
def test_new_photos_stand_where_their_view_is_taken_from(tmp_path, view):
    small.start(tmp_path, (view,))
    camera = cameras().camera_of(small.project().photos[0])
    assert camera.orthographic
    assert camera.size == small.SIZE
    assert np.allclose(backend().view_direction(camera), backend().STANDARD_DIRECTIONS[view], atol=1e-6)
    # the head is upright in the picture: what is up in the world is up there too
    up = (0, 1, 0) if view == "top" else (0, 0, 1)
    middle, above = backend().project(camera, np.array([[0, 0, 0], up]) * 0.05)
    assert above[1] < middle[1] - 5
    # and the whole ball lies on it
    ball = backend().project(camera, np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (0, 0.1)]))
    assert backend().in_picture(camera, ball).all()
    # the person's left is at the right of the front view
    if view == "front":
        assert backend().project(camera, np.array([0.1, 0, 0]))[0] > 0.6 * small.SIZE[0]


def test_a_pixel_of_the_camera_is_the_pixel_on_the_plane(tmp_path):
    """Corners of the image empty as Blender draws it: longest side 1, centred, y up."""
    photo = photo_at(tmp_path, TURNED)
    camera = cameras().camera_of(photo)
    width, height = small.SIZE
    for x, y in ((0, 0), (width, 0), (0, height), (width, height), (10.5, 80.5)):
        local = Vector(((x - width / 2) / height, (height / 2 - y) / height, 0.0))
        world = np.array(TURNED @ local)
        assert np.allclose(backend().project(camera, world)[:2], (x, y), atol=1e-3)
        assert np.allclose(cameras().pixels_in_world(photo, np.array([[x, y]])), world, atol=1e-6)


def test_display_size_and_offset_of_the_empty_count(tmp_path):
    photo = photo_at(tmp_path, TURNED)
    before = cameras().camera_of(photo)
    photo.plane.empty_display_size = 2.0
    photo.plane.matrix_world = TURNED @ Matrix.Scale(0.5, 4)
    photo.plane.empty_image_offset = (0.0, -0.5)  # half a picture to the right...
    width = small.SIZE[0] / max(small.SIZE) * 0.6
    photo.plane.matrix_world = Matrix.Translation(-0.5 * width * TURNED.col[0].to_3d().normalized()) @ (
        TURNED @ Matrix.Scale(0.5, 4)
    )  # ... and back
    after = cameras().camera_of(photo)
    assert np.allclose(after.intrinsics, before.intrinsics, rtol=1e-5)
    assert np.allclose(after.world_to_camera, before.world_to_camera, atol=1e-6)


def test_cameras_become_planes_and_come_back(tmp_path):
    photo = photo_at(tmp_path, Matrix())
    made = backend().orthographic_camera((0.3, 0.9, -0.2), (0.01, 0.02, 0.1), 412.0, small.SIZE)
    photo.plane.matrix_world = cameras().matrix_of_camera(made)
    found = cameras().camera_of(photo)
    points = np.random.default_rng(0).normal(size=(20, 3)) * 0.1
    assert np.allclose(backend().project(found, points), backend().project(made, points), atol=1e-3)


def test_a_camera_with_perspective_sees_the_plane_as_it_is(tmp_path):
    photo = photo_at(tmp_path, TURNED, is_perspective=True, distance=1.2)
    camera = cameras().camera_of(photo)
    assert not camera.orthographic
    corner = cameras().pixels_in_world(photo, np.array([[0.0, 0.0], [90.0, 20.0]]))
    assert np.allclose(backend().project(camera, corner), [[0, 0, 1.2], [90, 20, 1.2]], atol=1e-3)
    # what is nearer is larger
    near = np.array(TURNED.translation) + 0.2 * np.array(TURNED.col[2].to_3d().normalized())
    side = 0.05 * np.array(TURNED.col[0].to_3d().normalized())
    wide = backend().project(camera, np.stack([near, near + side]))[:, 0]
    flat = cameras().camera_of(SimpleNamespace(plane=photo.plane, image=photo.image, is_perspective=False, distance=1))
    narrow = backend().project(flat, np.stack([near, near + side]))[:, 0]
    assert np.ptp(wide) == pytest.approx(np.ptp(narrow) * 1.2 / 1.0, rel=1e-3)


def test_rays_meet_the_pixels_they_come_from(tmp_path):
    photo = photo_at(tmp_path, TURNED)
    direction = np.array([0.3, 0.8, -0.5])
    for pixel in ((3.0, 4.0), (70.0, 95.0), (-20.0, 300.0)):
        place = cameras().pixels_in_world(photo, np.array([pixel]))[0]
        assert cameras().pixel_of_ray(photo, place - 2.0 * direction, direction) == pytest.approx(pixel, abs=1e-2)
    along = np.array(TURNED.col[0].to_3d())
    assert cameras().pixel_of_ray(photo, np.zeros(3), along) is None


@pytest.mark.parametrize(
    ("scale", "message"),
    [((-0.5, 0.5, 0.5), "mirrored"), ((0.5, 0.5, -0.5), "mirrored"), ((0.5, 0.0, 0.5), "flat")],
)
def test_planes_that_are_no_cameras_are_named(tmp_path, scale, message):
    photo = photo_at(tmp_path, Matrix.LocRotScale(None, None, Vector(scale)))
    with pytest.raises(scenes.module("backend.errors").InputError, match=f"Front Photo.*{message}"):
        cameras().camera_of(photo)


def view_3d(rotation, window: Matrix, size=(640, 480), *, is_perspective: bool) -> tuple[object, object]:
    """A 3D view's region as Blender tells it; in the background it does not keep its matrices up."""
    view = (Matrix.Translation((0.1, -1.0, 0.2)) @ rotation.to_matrix().to_4x4()).inverted()
    region = SimpleNamespace(width=size[0], height=size[1])
    return region, SimpleNamespace(
        view_matrix=view, window_matrix=window, perspective_matrix=window @ view, is_perspective=is_perspective,
        view_rotation=rotation.to_quaternion(),
    )  # fmt: skip


@pytest.mark.parametrize("is_perspective", [False, True])
def test_the_camera_of_a_3d_view_is_what_blender_draws(is_perspective):
    window = Matrix(((2.1, 0, 0.1, 0), (0, 2.8, -0.05, 0), (0, 0, -1.0, -0.2), (0, 0, -1, 0)))
    if not is_perspective:
        window = Matrix(((2.1, 0, 0, 0.2), (0, 2.8, 0, -0.1), (0, 0, -0.02, -1), (0, 0, 0, 1)))
    region, view = view_3d(Euler((1.4, 0.1, 0.3)), window, is_perspective=is_perspective)
    camera = cameras().viewport_camera(region, view)
    for point in ((0.0, 0.4, 0.3), (0.2, 0.5, -0.1)):
        shown = view.perspective_matrix @ Vector((*point, 1.0))
        pixel = ((shown.x / shown.w + 1) * 320, 480 - (shown.y / shown.w + 1) * 240)
        assert np.allclose(backend().project(camera, np.array(point))[:2], pixel, atol=1e-2)


def test_looking_through_is_noticed(tmp_path):
    photo = photo_at(tmp_path, TURNED)
    rotation, place, longest = cameras().looking_through(photo)
    assert longest == pytest.approx(0.6)
    assert np.allclose(place, TURNED.translation, atol=1e-6)
    assert cameras().is_looked_through(photo, SimpleNamespace(is_perspective=False, view_rotation=rotation))
    assert not cameras().is_looked_through(photo, SimpleNamespace(is_perspective=True, view_rotation=rotation))
    other = rotation @ Euler((0.02, 0, 0)).to_quaternion()
    assert not cameras().is_looked_through(photo, SimpleNamespace(is_perspective=False, view_rotation=other))


# --- handles -----------------------------------------------------------------------------------------------------

PIVOT = Vector((0.01, 0.03, 0.02))


def moves():
    return scenes.module("gizmos.plane_moves")


def pixel_of(tmp_path, matrix: Matrix, point: Vector) -> np.ndarray:
    photo = small.project().photos[0] if small.project().photos else photo_at(tmp_path, matrix)
    photo.plane.matrix_world = matrix
    return backend().project(cameras().camera_of(photo), np.array(point))[:2]


@pytest.mark.parametrize(
    "move",
    [
        lambda m, v: m.turned(TURNED, PIVOT, v), lambda m, v: m.tilted(TURNED, PIVOT, 0, v),
        lambda m, v: m.tilted(TURNED, PIVOT, 1, v), lambda m, v: m.scaled(TURNED, PIVOT, 1 + v),
    ],
)  # fmt: skip
def test_turns_and_scale_leave_the_middle_of_the_head_where_it_is_in_the_picture(tmp_path, move):
    before = pixel_of(tmp_path, TURNED, PIVOT)
    after = pixel_of(tmp_path, move(moves(), 0.3), PIVOT)
    assert np.allclose(after, before, atol=2e-3)
    assert move(moves(), 0.3) != TURNED


def test_moves_go_along_the_picture(tmp_path):
    start = pixel_of(tmp_path, TURNED, PIVOT)
    per_metre = max(small.SIZE) / 0.6
    right = pixel_of(tmp_path, moves().moved(TURNED, 0, 0.05), PIVOT)
    up = pixel_of(tmp_path, moves().moved(TURNED, 1, 0.05), PIVOT)
    # the photo goes to the right, so the head is further left on it
    assert np.allclose(right - start, (-0.05 * per_metre, 0), atol=2e-3)
    assert np.allclose(up - start, (0, 0.05 * per_metre), atol=2e-3)


def test_a_turn_is_counter_clockwise_and_scale_is_a_factor(tmp_path):
    turned = moves().turned(TURNED, PIVOT, math.radians(20))
    assert turned.col[0].to_3d().angle(TURNED.col[0].to_3d()) == pytest.approx(math.radians(20), abs=1e-5)
    assert turned.col[0].to_3d().dot(TURNED.col[1].to_3d()) > 0
    assert moves().scaled(TURNED, PIVOT, 2.0).to_scale().x == pytest.approx(1.2)
    assert moves().scaled(TURNED, PIVOT, -3.0).to_scale().x > 0  # pulled through zero it is small, not mirrored


# --- placement ---------------------------------------------------------------------------------------------------


def fake_job(monkeypatch, outputs):
    """Let the jobs of the backend answer at once; what they were asked is returned."""
    asked = {}

    def run(name, inputs, params, progress=None):
        asked[name] = (inputs, params)
        return outputs(inputs) if callable(outputs) else outputs

    monkeypatch.setattr(scenes.module("backend.registry"), "run_job", run)
    return asked


def test_placement_moves_the_planes_of_usual_views(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    small.project().photos[3].view = "other"
    kept = small.project().photos[3].plane.matrix_world.copy()
    made = {v: backend().standard_camera(v, (0, 0, 0.03), 500.0, small.SIZE) for v in ("front", "back", "left")}
    asked = fake_job(monkeypatch, {"cameras": made, "remarks": ["left and back seem to be swapped"]})
    small.project().photos[0].landmarks = json.dumps({"nose": [44.0, 60.0]})
    bpy.ops.hairloom.four_view_place()
    inputs, _ = asked["four_view_place"]
    assert sorted(inputs["masks"]) == ["back", "front", "left"]
    assert inputs["landmarks"] == {"front": {"nose": [44.0, 60.0]}}
    assert inputs["head"].scalp.any()
    for photo in list(small.project().photos)[:3]:
        found = cameras().camera_of(photo)
        assert np.allclose(found.world_to_camera, made[photo.view].world_to_camera, atol=1e-6)
        assert np.allclose(found.intrinsics, made[photo.view].intrinsics, rtol=1e-5)
    assert small.project().photos[3].plane.matrix_world == kept
    assert "swapped" in small.project().remarks


def test_placement_needs_masks_and_a_head(tmp_path):
    small.start(tmp_path)
    with pytest.raises(RuntimeError, match="'front' has no mask yet"):
        bpy.ops.hairloom.four_view_place()
    small.give_masks()
    bpy.context.scene.hairloom.head = None
    with pytest.raises(RuntimeError, match="Choose a head"):
        bpy.ops.hairloom.four_view_place()


def test_the_camera_goes_back_to_its_usual_place(tmp_path):
    small.start(tmp_path, ("left",))
    plane = small.project().photos[0].plane
    before = plane.matrix_world.copy()
    plane.matrix_world = TURNED
    bpy.ops.hairloom.four_view_reset_camera()
    assert np.allclose(np.array(plane.matrix_world), np.array(before), atol=1e-6)


def test_landmarks_are_asked_for_one_after_another():
    fourview = scenes.module("fourview")
    clicks = fourview.LandmarkClicks((100, 80))
    assert "left eye" in clicks.asked
    assert not clicks.click((120.0, 5.0))
    assert not clicks.click(None)
    assert clicks.click((60.0, 30.0))
    clicks.skip()
    assert "nose" in clicks.asked
    clicks.click((50.0, 40.0))
    clicks.back()
    clicks.click((51.0, 41.0))
    assert not clicks.is_done
    clicks.click((50.0, 60.0))
    assert clicks.is_done
    assert json.loads(clicks.text()) == {"eye_left": [60, 30], "nose": [51, 41], "chin": [50, 60]}


def test_landmarks_are_those_of_the_backend():
    placement = scenes.module("backend.fourview.placement")
    assert tuple(name for name, _ in scenes.module("fourview").LANDMARKS) == placement.LANDMARKS
