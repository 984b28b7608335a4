"""The whole way from photos to strands, on small pictures of a known groom: numbers, command line, jobs, bad input."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent / "renders"))

from evaluate import judge, load_head, load_views, own_family
from hairloom.cli import main as command_line
from hairloom.errors import Cancelled, InputError
from hairloom.fourview.database import open_database
from hairloom.fourview.pipeline import FourViewParams, hair_directions, hair_texture, linear_rgba, model_hair
from hairloom.fourview.project import Project, ProjectView, write_project
from hairloom.io.bundle import read_bundle
from hairloom.io.strands import read_strands
from hairloom.registry import run_job
from render_views import main as render

SIZE = 240
SETTINGS = {
    "surface": {"texture_size": 256, "n_scales": 2, "atlas_vertices": 1200},
    "texture": {"iterations": [2, 1]},
    "strands": {"n_guides": 600, "n_strands": 4000, "n_points": 24},
}


def small() -> FourViewParams:
    params = FourViewParams()
    return replace(
        params,
        surface=replace(params.surface, texture_size=256, n_scales=2, atlas_vertices=1200),
        texture=replace(params.texture, iterations=(2, 1)),
        strands=replace(params.strands, n_guides=600, n_strands=4000, n_points=24),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("photos")
    assert render(["--quick", "--size", str(SIZE), "--strands", "8000", "--", str(out), "bob"]) == 0
    return out / "bob"


@pytest.fixture(scope="module")
def database():
    return open_database()


@pytest.fixture(scope="module")
def modelled(folder, database):
    """The result of four views, and what the truth says of it."""
    head, cameras = load_head(folder)
    views = load_views(dict.fromkeys(("front", "back", "left", "right"), folder), cameras)
    result = model_hair(views, head, database, (), small(), exclude=own_family(database, "bob"))
    return result, views, head, read_bundle(folder / "truth.npz")


def test_the_result_looks_like_the_photos(modelled):
    result, views, _, truth = modelled
    numbers = judge(result.strands, truth["strands"], views, truth["head"])
    # the target at 800 pixels and full settings is 0.93 and 15 degrees; a strand is a third of a pixel wide here, and
    # the front's mask is a ring of few pixels
    assert min(numbers["iou"].values()) > 0.75, numbers
    assert np.mean(list(numbers["iou"].values())) > 0.85, numbers
    assert np.mean(list(numbers["orientation_median_deg"].values())) < 20, numbers
    assert result.report["mask_iou"] > 0.85
    assert result.report["penetration"]["point_share"] < 0.01


def test_no_hairstyle_of_the_grooms_own_family_was_used(modelled, database):
    assert "bob" not in database.family(database.index(modelled[0].shape.style))


def test_strands_have_the_photos_colours(modelled):
    result, views, _, _ = modelled
    found = result.strands.strand_attributes["groom_color"]
    assert found.shape == (result.strands.n_strands, 4) and (found[:, 3] == 1).all()
    photo = linear_rgba(np.concatenate([view.image[view.mask] for view in views]).astype(np.float32) / 255)
    assert np.abs(np.median(found[:, :3], axis=0) - np.median(photo[:, :3], axis=0)).max() < 0.06


def test_same_photos_same_bytes(modelled, folder, database):
    first, views, head, _ = modelled
    again = model_hair(views, head, database, (), small(), exclude=own_family(database, "bob"))
    assert again.texture.colour.tobytes() == first.texture.colour.tobytes()
    assert again.strands.points.tobytes() == first.strands.points.tobytes()


def test_the_front_alone_gives_hair_all_around(modelled, database):
    _, views, head, _ = modelled
    result = model_hair(views[:1], head, database, (), small(), exclude=own_family(database, "bob"))
    assert result.report["views"]["front"]["mask_iou"] > 0.75
    behind = result.strands.points[:, 1] > head.vertices[:, 1].mean()
    assert behind.mean() > 0.25


def test_a_photo_that_the_shape_left_out_is_used_nowhere(modelled):
    result, views, head, _ = modelled
    without = replace(result.shape, left_out=("back",))
    three = [view for view in views if view.name != "back"]
    textures = [hair_texture(*given, small())[1] for given in ((without, views), (result.shape, three))]
    assert textures[0].colour.tobytes() == textures[1].colour.tobytes()
    assert textures[0].colour.tobytes() != result.texture.colour.tobytes()
    stage = (result.surface, result.texture)
    directions = [
        hair_directions(shape, *stage, given, head, params=small())
        for shape, given in ((without, views), (result.shape, three))
    ]
    assert directions[0].directions.tobytes() == directions[1].directions.tobytes()


def test_the_command_line_models_a_project(folder, tmp_path, capsys):
    cameras = load_head(folder)[1]
    views = tuple(ProjectView(name, f"{name}.png", f"{name}_mask.png", cameras[name]) for name in ("front", "left"))
    write_project(folder / "P.toml", Project(folder, views, settings=SETTINGS))
    texture = tmp_path / "texture.png"
    arguments = ["four-view", str(folder / "P.toml"), str(tmp_path / "hair.npz"), "--texture", str(texture)]
    assert command_line([*arguments, "--strands", "1500", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    strands = read_strands(tmp_path / "hair.npz")
    assert strands.n_strands == report["strands"] <= 1500 and report["strands"] > 1000
    assert set(report["views"]) == {"front", "left"} and texture.is_file()
    assert {"shape", "texture", "directions", "strands"} <= set(report["seconds"])
    assert "color" in strands.point_attributes


def test_bad_projects_end_with_one_line(folder, tmp_path, capsys):
    bad = folder / "bad.toml"
    bad.write_text('format = "hairloom-four-view"\nversion = 1\n[[view]]\nname = "front"\nimage = "none.png"\n')
    assert command_line(["four-view", str(bad), str(tmp_path / "out.npz")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "none.png" in error
    bad.write_text(bad.read_text().replace("none", "front") + "[settings.strands]\nn_strand = 3\n")
    assert command_line(["four-view", str(bad), str(tmp_path / "out.npz")]) == 2
    assert "n_strand" in capsys.readouterr().err
    assert not (tmp_path / "out.npz").exists()


def test_the_steps_run_as_jobs(modelled, folder):
    """What the wizard does, each step from the results of those before."""
    whole, views, head, _ = modelled
    guess = run_job("four_view_segment", {"image": views[0].image}, {})["mask"]
    assert guess.shape == views[0].mask.shape
    placed = run_job("four_view_place", {"masks": {v.name: v.mask for v in views}, "head": head}, {})
    assert set(placed["cameras"]) == {view.name for view in views} and placed["remarks"] == []
    inputs = {"views": list(views), "head": head, "shape": whole.shape, "directions": whole.directions}
    found = run_job("four_view_strands", inputs, {"strands": SETTINGS["strands"]})
    assert found["strands"].points.tobytes() == whole.strands.points.tobytes()
    assert found["report"]["mask_iou"] == whole.report["mask_iou"]


def test_cancel(modelled, database):
    _, views, head, _ = modelled

    def stop(fraction: float, message: str, /) -> None:
        if fraction > 0.1:
            raise Cancelled

    with pytest.raises(Cancelled):
        model_hair(views, head, database, (), small(), progress=stop)


def test_too_many_views(modelled, database):
    _, views, head, _ = modelled
    with pytest.raises(InputError, match="9 views"):
        model_hair([views[0]] * 9, head, database)
