"""PROJECT.toml: what is written is read again; hostile paths, wrong names and values are one line."""

from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from hairloom.errors import FileError, InputError
from hairloom.fourview.pipeline import FourViewParams
from hairloom.fourview.project import (
    SINGLE,
    Project,
    ProjectStroke,
    ProjectView,
    Scribble,
    paint_scribbles,
    read_project,
    sized,
    write_project,
)
from hairloom.geometry.camera import orthographic_camera, perspective_camera, project
from hairloom.registry import build_params

HEADER = 'format = "hairloom-four-view"\nversion = 1\n'
VIEW = '[[view]]\nname = "front"\nimage = "front.png"\n'


def whole(folder) -> Project:
    camera = orthographic_camera((0.1, 1.0, -0.2), (0.0, 0.02, 0.2), 1500.0, (640, 480))
    top = orthographic_camera((0.0, 0.0, -1.0), (0.0, 0.0, 0.2), 900.0, (400, 400), up=(0, 1, 0))
    away = perspective_camera((0.0, -1.0, 0.3), (0.0, 0.0, 0.2), 800.0, (320, 240))
    scribbles = (
        Scribble("hair", np.array([[1.5, 2.0], [30.0, 40.0]]), 6.0),
        Scribble("background", np.array([[5.0, 5]])),
    )
    return Project(
        folder,
        (
            ProjectView("front", "photos/front.png", "front mask.png", camera, {"nose": (100.0, 120.5)}, scribbles),
            ProjectView('the "other" one', "b.png", camera=away),
        ),
        (ProjectStroke("front", np.array([[1.0, 2.0], [3.0, 4.5]])), ProjectStroke("top", np.eye(2) * 7, top)),
        head="head.obj",
        head_units="cm,y-up",
        grooms=("own",),
        settings={
            "strands": {"n_strands": 1234},
            "with_detail": False,
            "n_tried": 3,
            "shape": {"deformation": {"rounds": 2}, "blur": 2.5},
        },
        scalp="Hair here",
    )


def test_what_is_written_is_read(tmp_path):
    before = whole(tmp_path)
    write_project(tmp_path / "P.toml", before)
    after = read_project(tmp_path / "P.toml")
    assert after.folder == tmp_path and after.head == "head.obj" and after.head_units == "cm,y-up"
    assert after.grooms == ("own",) and after.settings == before.settings and after.scalp == "Hair here"
    for one, two in zip(before.views, after.views):
        assert (one.name, one.image, one.mask, one.landmarks) == (two.name, two.image, two.mask, two.landmarks)
        assert np.array_equal(one.camera.intrinsics, two.camera.intrinsics)
        assert np.array_equal(one.camera.world_to_camera, two.camera.world_to_camera)
        assert (one.camera.size, one.camera.orthographic) == (two.camera.size, two.camera.orthographic)
        for a, b in zip(one.scribbles, two.scribbles, strict=True):
            assert (a.kind, a.width) == (b.kind, b.width) and np.array_equal(a.points, b.points)
    for one, two in zip(before.strokes, after.strokes, strict=True):
        assert one.view == two.view and np.array_equal(one.points, two.points)
        assert (one.camera is None) == (two.camera is None)
    write_project(tmp_path / "Q.toml", after)
    assert (tmp_path / "Q.toml").read_bytes() == (tmp_path / "P.toml").read_bytes()


def test_a_camera_by_where_it_looks(tmp_path):
    (tmp_path / "P.toml").write_text(
        HEADER + VIEW + "[view.camera]\ndirection = [0, 1, 0]\ncentre = [0.0, 0.0, 0.2]\npixels_per_metre = 1000\n"
    )
    camera = sized(read_project(tmp_path / "P.toml").views[0].camera, (800, 600))
    assert camera.size == (800, 600)
    # the middle of the picture, and 10 cm to the person's left and up
    assert np.allclose(project(camera, np.array([[0, 0, 0.2], [0.1, 0, 0.3]]))[:, :2], [[400, 300], [500, 200]])


def test_a_perspective_camera_by_where_it_looks(tmp_path):
    (tmp_path / "P.toml").write_text(
        HEADER
        + VIEW
        + "[view.camera]\northographic = false\nposition = [0, -2, 0.2]\ntarget = [0, 0, 0.2]\nfocal_px = 500\n"
    )
    camera = sized(read_project(tmp_path / "P.toml").views[0].camera, (100, 100))
    assert np.allclose(project(camera, np.array([[0.2, 0, 0.2]]))[0, :2], [100, 50])


@pytest.mark.parametrize("name", ["../front.png", "/etc/passwd", "a/../../b.png", "C:\\\\x.png", "..\\\\x.png", ""])
def test_paths_out_of_the_folder_are_refused(tmp_path, name):
    (tmp_path / "P.toml").write_text(HEADER + f'[[view]]\nname = "front"\nimage = "{name}"\n')
    with pytest.raises(InputError):
        read_project(tmp_path / "P.toml")


def test_a_link_out_of_the_folder_is_refused(tmp_path):
    inner = tmp_path / "project"
    inner.mkdir()
    (tmp_path / "secret.png").write_bytes(b"x")
    (inner / "front.png").symlink_to(tmp_path / "secret.png")
    (inner / "P.toml").write_text(HEADER + VIEW)
    with pytest.raises(InputError, match="leads out"):
        read_project(inner / "P.toml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nonsense", "TOML"),
        (HEADER, r"\[\[view\]\]"),
        (HEADER.replace("1", "2") + VIEW, "version 2"),
        (VIEW, "format"),
        (HEADER + VIEW + VIEW, "two views"),
        (
            HEADER + VIEW.replace("front", "v0") + "".join(VIEW.replace("front", f"v{n}") for n in range(1, 9)),
            "9 views",
        ),
        (HEADER + VIEW + 'imag = "x"\n', "imag"),
        (HEADER + VIEW + "[view.camera]\ndirection = [0, 1]\n", "direction"),
        (HEADER + VIEW + "[view.camera]\ndirection = [0, 0, 1]\ncentre = [0, 0, 0]\npixels_per_metre = 9\n", "up"),
        (HEADER + VIEW + '[view.landmarks]\nnose = ["a", 2]\n', "nose"),
        (HEADER + VIEW + '[[view.scribble]]\nkind = "skin"\npoints = [[1, 2]]\n', "skin"),
        (HEADER + VIEW + '[[stroke]]\nview = "front"\npoints = [[1, 2]]\n', "2 or more"),
        (HEADER + VIEW + '[[stroke]]\nview = "front"\npoints = [[1, nan], [1, 2]]\n', "finite"),
        (HEADER + "view = 3\n", r"\[\[view\]\]"),
        (HEADER + "[[view]]\nname = 3\nimage = 'a.png'\n", "name"),
        (HEADER + VIEW + "[settings]\nstrands = 4\n", "settings"),
        (HEADER + 'scalp = "Scalp"\n' + VIEW, "scalp"),
        (HEADER + 'head = "head.obj"\nscalp = 3\n' + VIEW, "scalp"),
        (HEADER + "view = [3]\n", "table"),
    ],
)
def test_bad_projects_are_one_line(tmp_path, text, words):
    (tmp_path / "P.toml").write_text(text)
    with pytest.raises((InputError, FileError), match=words) as caught:
        read_project(tmp_path / "P.toml")
    assert "\n" not in str(caught.value)


def test_scribbles_are_painted_by_kind_and_width():
    scribbles = (
        Scribble("hair", np.array([[2.0, 10.5], [18.0, 10.5]]), 1.0),
        Scribble("background", np.array([[10.0, 2.0], [10.0, 18.0]]), 5.0),
        Scribble("hair", np.array([[4.0, 4.0]]), 3.0),
    )
    hair = paint_scribbles(scribbles, "hair", (20, 20))
    assert hair[10, 3:17].all() and not hair[12:].any() and hair[3:5, 3:5].any()
    assert paint_scribbles(scribbles, "background", (20, 20)).sum() > 5 * hair.sum() / 2


def test_single_settings_are_those_of_the_pipeline():
    default = FourViewParams()
    assert set(SINGLE) == {f.name for f in fields(default) if not is_dataclass(getattr(default, f.name))}
    assert build_params(FourViewParams, {"n_tried": 4, "with_detail": False}).n_tried == 4
    with pytest.raises(InputError, match="with_detail"):
        build_params(FourViewParams, {"with_detail": 1})
