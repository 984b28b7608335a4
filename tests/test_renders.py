"""The script of rendered photos: what it writes, through its quick way, which needs no Blender."""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from hairloom.geometry.camera import project
from hairloom.geometry.strand_raster import hair_mask, raster_strands
from hairloom.io.bundle import read_bundle

sys.path.insert(0, str(Path(__file__).parent / "renders"))

from grooms import frame_cameras
from render_views import main, photo, without_windows

SIZE = 200
QUICK = ("--quick", "--size", str(SIZE), "--strands", "6000", "--views", "front", "left")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("renders")
    assert main([*QUICK, "--", str(out), "bob"]) == 0
    return out / "bob"


def test_pictures_masks_and_truth_belong_together(folder: Path) -> None:
    truth, seen = read_bundle(folder / "truth.npz"), read_bundle(folder / "cameras.npz")
    assert set(seen) == {"cameras", "head"} and set(seen["cameras"]) == {"front", "left"}
    for view, camera in seen["cameras"].items():
        picture, mask = cv2.imread(str(folder / f"{view}.png")), cv2.imread(str(folder / f"{view}_mask.png"), 0)
        assert picture.shape == (SIZE, SIZE, 3) and set(np.unique(mask)) == {0, 255}
        inside = project(camera, truth["strands"].points)
        assert (inside[:, :2] > 0).all() and (inside[:, :2] < SIZE).all()
        drawn = raster_strands(camera, truth["strands"], truth["head"]).mask
        marked = mask > 0
        assert marked[drawn].mean() > 0.9
        again = hair_mask(camera, truth["strands"], truth["head"])
        # the mask was made from a finer picture; strands much thinner than these coarse pixels count roughly only
        assert np.count_nonzero(marked & again) / np.count_nonzero(marked | again) > 0.75
        background = picture[0, 0]
        np.testing.assert_allclose(background, [224, 222, 219], atol=1)  # BGR of 0.86, 0.87, 0.88
        assert (np.abs(picture[marked].astype(int) - background).max(axis=1) > 40).mean() > 0.97


def test_background_blur_and_noise(tmp_path: Path) -> None:
    rendered = np.zeros((40, 40, 4), np.float32)
    rendered[:, 20:] = 1.0
    rng = np.random.default_rng(0)
    plain = photo(rendered, "0,0.5,1", 0.0, 0.0, rng)
    assert (plain[:, :20] == [0, 128, 255]).all() and (plain[:, 20:] == 255).all()
    blurred = photo(rendered, "0,0.5,1", 2.0, 0.0, rng)
    assert (blurred[:, 0] == plain[:, 0]).all() and 80 < blurred[20, 19, 0] < 170
    noisy = photo(rendered, "0.5,0.5,0.5", 0.0, 10.0, rng)[:, :20].astype(float)
    assert noisy.std() == pytest.approx(10.0, rel=0.1)  # 2,400 values: 1.5 % standard deviation
    cv2.imwrite(str(tmp_path / "wall.png"), np.full((10, 10, 3), (10, 20, 30), np.uint8))
    assert (photo(rendered, str(tmp_path / "wall.png"), 0.0, 0.0, rng)[:, :20] == [30, 20, 10]).all()


def test_what_is_not_there_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*QUICK, "--", str(tmp_path), "nosuch"]) == 1
    assert "no groom 'nosuch'" in capsys.readouterr().err
    assert main([*QUICK, "--background", "nosuch.png", "--", str(tmp_path), "bob"]) == 1
    assert "nosuch.png" in capsys.readouterr().err
    assert main([*QUICK, "--data", str(tmp_path), "--", str(tmp_path), "sintel"]) == 1
    assert "hair.tfx" in capsys.readouterr().err


def test_thin_hair_over_the_scalp_is_marked_and_a_window_is_not() -> None:
    mask, scalp = np.zeros((60, 80), np.bool_), np.zeros((60, 80), np.bool_)
    mask[5:55, 5:75] = True
    scalp[5:40, 5:75] = True
    mask[10:20, 10:20] = False  # scalp alone
    mask[35:45, 30:40] = False  # half of it is the neck's
    mask[5:12, 60:70] = False  # open above
    filled = without_windows(mask, scalp)
    assert filled[10:20, 10:20].all()
    assert not filled[35:45, 30:40].any() and not filled[5:12, 60:70].any()
    assert (filled[~mask].sum()) == 100


def test_cameras_hold_everything_at_one_scale() -> None:
    points = np.random.default_rng(0).uniform([-1, -2, 0], [3, 0.5, 1], (100, 3)).astype(np.float32)
    cameras = frame_cameras(points, 100, ("front", "left", "top"))
    assert len({camera.intrinsics[0, 0] for camera in cameras.values()}) == 1
    for camera in cameras.values():
        pixels = project(camera, points)[:, :2]
        assert (pixels > 3.9).all() and (pixels < 96.1).all()
