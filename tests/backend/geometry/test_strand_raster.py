"""Strands in the z-buffer against a slow reference, their angles, what hides them, and the masks of a person."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.geometry.camera import orthographic_camera, perspective_camera, project, standard_camera
from hairloom.geometry.head import sphere_head
from hairloom.geometry.strand_raster import hair_mask, marked_region, raster_strands, scalp_pixels
from hairloom.geometry.strands import from_dense, join_strands
from hairloom.types import Camera, Head, StrandSet

FRONT = standard_camera("front", (0, 0, 0), 1000.0, (100, 100))


def strand(*points: tuple[float, float, float]) -> StrandSet:
    return StrandSet(np.array(points, np.float32), np.array([0, len(points)], np.int32))


@pytest.mark.parametrize(
    ("start", "end", "signed"),
    [
        ((-0.03, 0, 0), (0.03, 0, 0), 0.0),
        ((0, 0, 0.03), (0, 0, -0.03), np.pi / 2),  # downwards in the picture
        ((0, 0, -0.03), (0, 0, 0.03), -np.pi / 2),
        ((-0.03, 0, 0.03), (0.03, 0, -0.03), np.pi / 4),
        ((0.03, 0, 0.03), (-0.03, 0, -0.03), 3 * np.pi / 4),
    ],
)
def test_angles_run_from_right_to_down(start, end, signed):
    raster = raster_strands(FRONT, strand(start, end))
    assert raster.mask.sum() >= 60
    np.testing.assert_allclose(raster.signed_angle[raster.mask], signed, atol=1e-5)
    np.testing.assert_allclose(raster.angle[raster.mask], signed % np.pi, atol=1e-5)
    back = raster_strands(standard_camera("back", (0, 0, 0), 1000.0, (100, 100)), strand(start, end))
    np.testing.assert_allclose(np.cos(back.signed_angle[back.mask]), -np.cos(signed), atol=1e-5)


def _naive(camera: Camera, strands: StrandSet, width_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Strand and depth at every pixel, by distance to every piece."""
    seen = project(camera, strands.points)
    width, height = camera.size
    depth, number = np.full((height, width), np.inf, np.float32), np.full((height, width), -1)
    y, x = np.mgrid[:height, :width] + 0.5
    for s in range(strands.n_strands):
        for p in range(strands.offsets[s], strands.offsets[s + 1] - 1):
            a, b = seen[p], seen[p + 1]
            along = b[:2] - a[:2]
            share = np.clip(((x - a[0]) * along[0] + (y - a[1]) * along[1]) / (along @ along), 0, 1)
            aside = np.hypot(x - a[0] - share * along[0], y - a[1] - share * along[1])
            deep = (a[2] + share * (b[2] - a[2])).astype(np.float32)
            nearer = (aside <= width_px / 2) & (deep < depth)
            depth[nearer], number[nearer] = deep[nearer], s
    return number, depth


@pytest.mark.parametrize("width_px", [1.0, 3.5])
@pytest.mark.parametrize("perspective", [False, True])
def test_agrees_with_the_distance_to_every_piece(width_px, perspective):
    rng = np.random.default_rng(3)
    steps = rng.normal(0, 0.012, (25, 6, 3))
    hair = from_dense((rng.uniform(-0.05, 0.05, (25, 1, 3)) + np.cumsum(steps, axis=1)).astype(np.float32))
    camera = perspective_camera((0.1, -0.5, 0.1), (0, 0, 0), 400.0, (90, 70)) if perspective else FRONT
    raster = raster_strands(camera, hair, width_px=width_px)
    number, depth = _naive(camera, hair, width_px)
    assert (number >= 0).sum() > 300
    np.testing.assert_array_equal(raster.strand, number)
    np.testing.assert_allclose(raster.depth, depth, rtol=1e-6)
    inside = raster.mask
    assert (hair.offsets[raster.strand[inside]] <= raster.segment[inside]).all()
    assert (raster.segment[inside] < hair.offsets[raster.strand[inside] + 1] - 1).all()


def test_thread_count_changes_nothing():
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (200, 4, 3)).astype(np.float32)
    many = raster_strands(FRONT, from_dense(points))
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = raster_strands(FRONT, from_dense(points))
    finally:
        numba.set_num_threads(threads)
    for name in ("strand", "segment", "depth", "signed_angle", "angle", "mask"):
        assert getattr(one, name).tobytes() == getattr(many, name).tobytes()


def test_the_head_hides_what_is_behind_it():
    head = sphere_head(0.03)
    before, behind = strand((-0.045, -0.04, 0), (0.045, -0.04, 0)), strand((-0.045, 0.04, 0), (0.045, 0.04, 0))
    assert raster_strands(FRONT, before, head).mask.sum() == raster_strands(FRONT, before).mask.sum()
    hidden = raster_strands(FRONT, behind, head).mask
    assert hidden.any() and not hidden[:, 22:78].any()


def test_strands_of_one_point_and_strange_widths():
    assert not raster_strands(FRONT, strand((0, 0, 0))).mask.any()
    with pytest.raises(InputError, match="wide"):
        raster_strands(FRONT, strand((0, 0, 0), (0, 0, 1)), width_px=0.0)
    with pytest.raises(InputError, match="closed"):
        marked_region(np.zeros((10, 10), np.float32), close_px=0.0)


CURTAIN = orthographic_camera((0, 1, 0), (0, 0, 0), 1000.0, (300, 300))


def _curtain(x: np.ndarray, y: float = 0.0) -> StrandSet:
    """Vertical strands 0.16 m long at x, metres, that is 160 pixels."""
    ends = np.array([0.08, -0.08])
    points = np.stack(np.broadcast_arrays(x[:, None], y, ends[None, :]), axis=2)
    return from_dense(np.ascontiguousarray(points, np.float32))


def test_a_person_marks_the_curtain_and_not_the_stray_strand():
    hair = _curtain(np.concatenate([np.arange(-0.08, 0.08, 0.0016), [0.12]]))  # a strand on two of three pixels
    mask = hair_mask(CURTAIN, hair, strand_width=0.001)
    expected = np.zeros((300, 300), bool)
    expected[70:230, 70:230] = True
    # at 63 % density the border lies 1.6 pixels further in, on four sides of 160
    assert np.count_nonzero(mask & expected) / np.count_nonzero(mask | expected) > 0.94
    solid = hair_mask(CURTAIN, _curtain(np.arange(-0.08, 0.08, 0.0008)), strand_width=0.001)
    assert np.count_nonzero(solid & expected) / np.count_nonzero(solid | expected) > 0.985
    assert not mask[:, 255:].any()


def test_thin_strands_have_to_be_dense():
    """Lines of 0.5 pixels on a share D of the pixels cover 1 - sqrt(1 - D): 45 % from D = 70 % on."""
    rng = np.random.default_rng(0)
    for share, hair in ((0.62, False), (0.78, True)):
        drawn = (rng.random((300, 300)) < share).astype(np.float32)
        assert marked_region(drawn).mean() > 0.99
        assert (marked_region(drawn, line_share=0.5).mean() > 0.9) == hair


def test_gaps_close_and_windows_stay():
    drawn = np.zeros((300, 300), np.float32)
    drawn[50:250, 50:250] = 1.0
    drawn[100:104, 60:240] = 0.0  # a gap of 4 pixels closes
    drawn[140:200, 100:160] = 0.0  # a window stays
    mask = marked_region(drawn)
    assert mask[100:104, 70:230].all()
    assert not mask[145:195, 105:155].any()
    assert mask[60:90, 60:240].all() and not mask[:40].any()


def test_a_parting_is_marked_and_a_bald_forehead_is_not():
    sphere = sphere_head(0.1)
    middles = sphere.vertices[sphere.triangles].mean(axis=1)
    head = Head(sphere.vertices, sphere.triangles, middles[:, 2] > 0.0, sphere.corner_uv)
    x = np.arange(-0.06, 0.06, 0.0008)
    parted = _curtain(x[np.abs(x) > 0.008], y=-0.12)  # 16 pixels of scalp show
    mask = hair_mask(CURTAIN, parted, head)
    assert mask[90:140, 148:152].all()  # above the middle of the head is scalp
    assert not mask[160:220, 148:152].any()  # below it is skin
    scalp = scalp_pixels(CURTAIN, head)
    assert scalp[60:145, 140:160].all() and not scalp[155:].any()
    fringe = join_strands([_curtain(np.arange(-0.06, -0.03, 0.0008), y=-0.12)])
    assert not hair_mask(CURTAIN, fringe, head)[:, 160:].any()
