"""The quality report on painted views of known strands: good for these, worse for others, and what lies in the head."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.fourview.quality import (
    QualityParams,
    mask_iou,
    orientation_error,
    penetration,
    quality_report,
    smooth_angle,
)
from hairloom.fourview.views import View
from hairloom.geometry.camera import standard_camera
from hairloom.geometry.head import sphere_head
from hairloom.geometry.strand_raster import hair_mask, raster_strands
from hairloom.geometry.strands import from_dense
from hairloom.types import Head, StrandSet

RADIUS = 0.1


def meridians(count: int = 1500, twist: float = 0.0, height: float = 1.03, length: float = 1.4) -> StrandSet:
    """Strands on a sphere from the top to `length` radians down, on a layer at `height` radii; `twist` turns them."""
    rng = np.random.default_rng(0)
    down = 0.05 + np.linspace(0.0, length, 24)[None] * rng.uniform(0.7, 1.0, (count, 1))
    around = rng.uniform(0, 2 * np.pi, (count, 1)) + twist * down
    on_sphere = [np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down)]
    radius = RADIUS * height * rng.uniform(1.0, 1.05, (count, 1, 1))
    return from_dense((radius * np.stack(on_sphere, axis=2)).astype(np.float32))


def painted(strands: StrandSet, head: Head, name: str) -> View:
    """Each strand in a brightness of its own, before grey."""
    camera = standard_camera(name, (0, 0, 0), 1400.0, (320, 320))
    drawn = raster_strands(camera, strands, head)
    shade = np.random.default_rng(1).integers(20, 230, strands.n_strands)
    image = np.where(drawn.mask, shade[drawn.strand], 128).astype(np.uint8)
    return View(name, np.repeat(image[..., None], 3, axis=2), hair_mask(camera, strands, head), camera)


@pytest.fixture(scope="module")
def head() -> Head:
    return sphere_head(RADIUS)


@pytest.fixture(scope="module")
def views(head: Head) -> list[View]:
    return [painted(meridians(), head, name) for name in ("front", "left")]


def test_the_strands_of_the_photo_fit_it(head: Head, views: list[View]) -> None:
    report = quality_report(meridians(), views, head)
    assert set(report["views"]) == {"front", "left"}
    for found in report["views"].values():
        assert found["mask_iou"] == 1.0
        # two hairs apart is four pixels, where the filters are surest; between strands of any brightness they blur
        assert found["orientation_median_deg"] < 8.0
        assert found["orientation_median_deg"] <= found["orientation_mean_deg"] < 20.0
        assert 0.3 < found["compared_share"] <= 0.51
    assert report["mask_iou"] == 1.0
    assert report["penetration"] == {"point_share": 0.0, "strand_share": 0.0, "deepest": 0.0}
    json.dumps(report)


def test_other_strands_fit_worse(head: Head, views: list[View]) -> None:
    good = quality_report(meridians(), views, head)
    twisted = quality_report(meridians(twist=1.0), views, head)
    assert twisted["orientation_median_deg"] > good["orientation_median_deg"] + 10.0
    short = quality_report(meridians(length=0.9), views, head)
    assert short["mask_iou"] < 0.9
    away = StrandSet(meridians().points + np.float32(5.0), meridians().offsets)
    nowhere = quality_report(away, views, head)
    assert nowhere["mask_iou"] == 0.0 and nowhere["orientation_median_deg"] is None
    json.dumps(nowhere)


def test_penetration_counts_points_and_strands(head: Head) -> None:
    outside, inside = meridians(300, height=1.05), meridians(100, height=0.9)
    both = StrandSet(np.concatenate([outside.points, inside.points]), np.arange(401, dtype=np.int32) * 24)
    found = penetration(both, head)
    assert found["point_share"] == pytest.approx(0.25) and found["strand_share"] == pytest.approx(0.25)
    # 0.9 to 0.945 radii: 1 cm at the deepest, a bit less since strands start at random
    assert found["deepest"] == pytest.approx(0.1 * RADIUS, abs=3e-4)
    assert penetration(both, head, QualityParams(tolerance=0.02))["point_share"] == 0.0
    assert penetration(both, head, QualityParams(max_points=1000))["point_share"] == pytest.approx(0.25, abs=0.01)


def test_errors_of_orientations_go_around_half_a_turn() -> None:
    where = np.ones((4, 4), bool)
    a, b = np.full((4, 4), np.radians(175.0)), np.full((4, 4), np.radians(5.0))
    assert orientation_error(a, b, where) == pytest.approx((10.0, 10.0))
    b[0] = np.radians(85.0)
    assert orientation_error(a, b, where) == pytest.approx((10.0, 30.0))  # (3 * 10 + 90) / 4
    where[1:] = False
    assert orientation_error(a, b, where) == pytest.approx((90.0, 90.0))
    with pytest.raises(InputError, match="no pixel"):
        orientation_error(a, b, np.zeros((4, 4), bool))


def test_overlap_of_masks() -> None:
    a, b = np.zeros((10, 10), bool), np.zeros((10, 10), bool)
    assert mask_iou(a, b) == 1.0
    a[:, :6], b[:, 3:] = True, True
    assert mask_iou(a, b) == pytest.approx(0.3)
    with pytest.raises(InputError, match="compared"):
        mask_iou(a, b[:5])


def test_smoothing_goes_around_half_a_turn_too() -> None:
    """Strands at 175 and 5 degrees side by side are level on average, not upright."""
    camera = standard_camera("front", (0, 0, 0), 1000.0, (60, 60))
    x, sign = np.array([-0.025, 0.025]), np.where(np.arange(40) % 2, 1.0, -1.0)
    z = np.linspace(-0.02, 0.02, 40)[:, None] + sign[:, None] * x * np.tan(np.radians(5.0))
    hair = from_dense(np.stack(np.broadcast_arrays(x, 0.0, z), axis=2).astype(np.float32))
    drawn = raster_strands(camera, hair)
    level = np.zeros((60, 60), np.float32)
    assert orientation_error(drawn.angle, level, drawn.mask)[0] == pytest.approx(5.0, abs=0.1)
    middle = drawn.mask.copy()
    middle[:15], middle[45:] = False, False
    assert orientation_error(smooth_angle(drawn, 4.0), level, middle)[0] < 2.0


def test_settings_out_of_range_are_refused() -> None:
    for wrong in ({"confident_share": 0.0}, {"smooth_px": -1.0}, {"tolerance": -0.1}, {"max_points": 0}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            QualityParams(**wrong)
