"""A project's files to views: masks from files, scribbles or guesses, cameras given or placed, bad input named."""

from dataclasses import replace

import numpy as np
import pytest
from hairloom.errors import FileError, InputError
from hairloom.fourview.inputs import read_inputs
from hairloom.fourview.project import Project, ProjectStroke, ProjectView, Scribble
from hairloom.geometry.camera import orthographic_camera
from hairloom.geometry.head import default_head
from hairloom.io.images import write_image

SIZE = (120, 160)
CAMERA = orthographic_camera((0.0, 1.0, 0.0), (0.0, 0.0, 0.2), 400.0, SIZE)


@pytest.fixture
def folder(tmp_path):
    """A dark cap of hair on a light wall, above a skin-coloured face."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    rng = np.random.default_rng(0)
    picture = np.full((SIZE[1], SIZE[0], 3), 210.0)
    hair = ((x - 60) / 34) ** 2 + ((y - 70) / 46) ** 2 < 1
    face = ((x - 60) / 24) ** 2 + ((y - 88) / 34) ** 2 < 1
    picture[hair], picture[face] = (60, 40, 25), (220, 165, 135)
    picture += rng.normal(0, 4, picture.shape)
    write_image(tmp_path / "front.png", np.clip(picture, 0, 255).astype(np.uint8))
    write_image(tmp_path / "mask.png", hair & ~face)
    return tmp_path


def project(folder, strokes=(), **view):
    return Project(folder, (ProjectView("front", "front.png", **view),), strokes)


def test_a_mask_and_a_camera_from_the_project(folder):
    found = read_inputs(project(folder, mask="mask.png", camera=CAMERA))
    (view,) = found.views
    assert view.mask.sum() > 1000 and view.image.shape == (160, 120, 3)
    assert view.camera == CAMERA and not found.remarks
    assert found.head.scalp.any()


def test_scribbles_cut_the_mask_out(folder):
    scribbles = (
        Scribble("hair", np.array([[35.0, 60.0], [60.0, 35.0], [85.0, 60.0]]), 4.0),
        Scribble("background", np.array([[60.0, 75.0], [60.0, 110.0]]), 6.0),
        Scribble("background", np.array([[5.0, 150.0], [5.0, 5.0], [115.0, 5.0], [115.0, 150.0]]), 6.0),
    )
    by_hand = read_inputs(project(folder, mask="mask.png", camera=CAMERA)).views[0].mask
    cut = read_inputs(project(folder, camera=CAMERA, scribbles=scribbles)).views[0].mask
    assert (cut & by_hand).sum() / (cut | by_hand).sum() > 0.9


def test_a_missing_camera_is_placed_and_said(folder):
    found = read_inputs(project(folder, mask="mask.png"))
    assert found.views[0].camera.size == SIZE
    assert any("front" in remark and "check" in remark for remark in found.remarks)


def test_strokes_get_the_cameras_of_their_views(folder):
    top = orthographic_camera((0.0, 0.0, -1.0), (0.0, 0.0, 0.2), 400.0, SIZE, up=(0, 1, 0))
    strokes = (
        ProjectStroke("front", np.array([[60.0, 30.0], [40.0, 50.0]])),
        ProjectStroke("top", np.array([[60.0, 30.0], [40.0, 50.0]]), top),
    )
    found = read_inputs(project(folder, strokes, mask="mask.png", camera=CAMERA))
    assert [stroke.camera for stroke in found.strokes] == [CAMERA, top]


@pytest.mark.parametrize(
    ("points", "view", "words"),
    [([[2.0, 150.0], [10.0, 155.0]], "front", "off the hair"), ([[60.0, 30.0], [40.0, 50.0]], "top", "no photo")],
)
def test_bad_strokes(folder, points, view, words):
    with pytest.raises(InputError, match=words):
        read_inputs(project(folder, (ProjectStroke(view, np.array(points)),), mask="mask.png", camera=CAMERA))


@pytest.mark.parametrize(
    ("mask", "words"),
    [
        (np.ones((10, 10), bool), "10 x 10"),
        (np.zeros((160, 120), bool), "almost no hair"),
        (np.ones((160, 120), bool), "whole picture"),
    ],
)
def test_bad_masks_name_the_view(folder, mask, words):
    write_image(folder / "mask.png", mask)
    with pytest.raises(InputError, match=words) as caught:
        read_inputs(project(folder, mask="mask.png", camera=CAMERA))
    assert "'front'" in str(caught.value)


def test_missing_and_unreadable_images(folder):
    (folder / "front.png").write_bytes(b"no picture")
    with pytest.raises(FileError, match=r"front\.png"):
        read_inputs(project(folder, mask="mask.png", camera=CAMERA))
    (folder / "front.png").unlink()
    with pytest.raises(FileError, match="no such file"):
        read_inputs(project(folder, mask="mask.png", camera=CAMERA))


def test_a_camera_of_another_size(folder):
    other = orthographic_camera((0.0, 1.0, 0.0), (0.0, 0.0, 0.2), 400.0, (50, 50))
    with pytest.raises(InputError, match="50"):
        read_inputs(project(folder, mask="mask.png", camera=other))


def write_head(path, scalp=None):
    """Hairloom's own head, its faces in two groups."""
    head = default_head()
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in head.vertices.tolist()]
    for corners, here in zip((head.triangles + 1).tolist(), [] if scalp is None else scalp.tolist(), strict=False):
        lines += [f"g {'Hair' if here else 'Bare'}", "f " + " ".join(map(str, corners))]
    if scalp is None:
        lines += ["f " + " ".join(map(str, corners)) for corners in (head.triangles + 1).tolist()]
    path.write_text("\n".join(lines) + "\n")
    return head


def test_the_scalp_of_the_projects_head(folder):
    # half of our own, so that it is not what would be guessed
    scalp = default_head().scalp & (np.arange(len(default_head().scalp)) % 2 == 0)
    write_head(folder / "head.obj", scalp)
    view = ProjectView("front", "front.png", "mask.png", CAMERA)
    named = Project(folder, (view,), head="head.obj", head_units="m,z-up", scalp="Hair")
    found = read_inputs(named).head
    assert np.array_equal(found.scalp, scalp)
    assert np.allclose(found.vertices, default_head().vertices, atol=1e-6)
    with pytest.raises(FileError, match="Beard"):
        read_inputs(replace(named, scalp="Beard"))


def test_a_head_without_scalp_gets_one_before_cameras_are_placed(folder):
    head = write_head(folder / "head.obj")
    found = read_inputs(
        Project(folder, (ProjectView("front", "front.png", "mask.png"),), head="head.obj", head_units="m,z-up")
    )
    assert (found.head.scalp == head.scalp).mean() > 0.9
    assert any("placed automatically" in remark for remark in found.remarks)
