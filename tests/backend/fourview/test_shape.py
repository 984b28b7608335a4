import numpy as np
import pytest
from hairloom.errors import Cancelled, InputError
from hairloom.fourview.shape import RoughShape, ShapeParams, find_shape, remove_detail
from hairloom.fourview.views import View
from hairloom.geometry.head import HeadSurface
from hairloom.types import Head, StrandSet
from radial_hair import FOUR, HEAD, RADIUS, boundary_edges, dome, overlap, radial_strands, view, views, volume

PARAMS = ShapeParams(resolution=64)
STRANDS = radial_strands()
TRUTH = dome(0.15, (1.15, 0.95, 1.1))


@pytest.fixture(scope="module")
def rough():
    return find_shape(STRANDS, "radial", views(TRUTH), HEAD, PARAMS)


def test_the_volume_without_detail_reaches_from_the_scalp_to_the_tips():
    mesh = remove_detail(STRANDS, HEAD, PARAMS)
    assert boundary_edges(mesh.triangles) == 0 and volume(mesh) > 0
    upper = mesh.vertices[mesh.vertices[:, 2] > 0.04]
    away = np.linalg.norm(upper, axis=1)
    outer = away[away > RADIUS]
    # tips at 0.14, half a tube and a voxel around
    assert np.median(outer) == pytest.approx(0.14, abs=0.008)
    # the inner side is in the head
    inner = away[away < RADIUS]
    assert len(inner) > 100 and inner.max() < RADIUS - 0.01


def test_wisps_and_gaps_leave_no_trace():
    # one strand in four: gaps of 2 cm between tips
    sparse = radial_strands(150)
    mesh = remove_detail(sparse, HEAD, PARAMS)
    away = np.linalg.norm(mesh.vertices[mesh.vertices[:, 2] > 0.04], axis=1)
    outer = away[away > RADIUS]
    assert outer.std() < 0.006 and abs(np.median(outer) - 0.14) < 0.012


def test_the_blur_takes_a_thin_spike_off():
    spike = np.zeros((1, 9, 3))
    spike[0, :, 2] = np.linspace(RADIUS, 0.22, 9)
    points = np.concatenate([STRANDS.points, spike[0].astype(np.float32)])
    spiked = StrandSet(points, np.append(STRANDS.offsets, np.int32(len(points))))
    assert remove_detail(spiked, HEAD, PARAMS).vertices[:, 2].max() < 0.165


def test_the_shape_fills_the_masks(rough):
    sample = views(TRUTH)
    assert rough.mask_iou.shape == (4,) and rough.remarks == ()
    assert np.allclose(rough.mask_iou, [overlap(view, rough.closed) for view in sample])
    # pictures of 240 pixels, where a third of a pixel along the border is 1 %
    assert rough.mask_iou.min() > 0.96
    assert boundary_edges(rough.closed.triangles) == 0


def test_the_shape_is_near_the_true_one_also_between_the_views(rough):
    upper = rough.open.vertices[rough.open.vertices[:, 2] > 0.03].astype(np.float64)
    off = np.linalg.norm(upper / (0.15 * np.array([1.15, 0.95, 1.1])), axis=1) - 1.0
    assert np.percentile(np.abs(off), 90) < 0.08


def test_the_open_shape_is_the_outer_side(rough):
    distance = HeadSurface(HEAD).signed_distance(rough.open.vertices)
    assert distance.min() > -0.005
    assert min(overlap(view, rough.open) for view in views(TRUTH)) > 0.95
    assert len(rough.open.triangles) < 0.9 * len(rough.closed.triangles)


def test_the_strands_come_along_and_keep_their_roots(rough):
    assert np.allclose(rough.strands.roots, STRANDS.roots, atol=1e-6)
    tips = rough.strands.points[rough.strands.offsets[1:] - 1]
    upper = tips[:, 2] > 0.04
    stretched = np.linalg.norm(tips / (0.15 * np.array([1.15, 0.95, 1.1])), axis=1)
    assert abs(np.median(stretched[upper]) - 1.0) < 0.06
    assert rough.style == "radial" and (rough.strands.offsets == STRANDS.offsets).all()


@pytest.mark.parametrize("names", [("front",), (*FOUR, "top")])
def test_one_to_five_views(names):
    shape = find_shape(STRANDS, "radial", views(TRUTH, names), HEAD, PARAMS)
    assert shape.mask_iou.min() > 0.95
    # the depth that no view tells is the hairstyle's: tips at 0.14
    if names == ("front",):
        assert shape.closed.vertices[:, 1].max() == pytest.approx(0.14, abs=0.02)


def test_perspective_cameras():
    shape = find_shape(STRANDS, "radial", views(TRUTH, perspective=True), HEAD, PARAMS)
    assert shape.mask_iou.min() > 0.96


def test_a_hole_in_the_mask_stays_free_of_hair():
    front = view("front", TRUTH)
    y, x = np.mgrid[:240, :240]
    holed = View("front", front.image, front.mask & (np.hypot(x - 120, y - 115) > 14), front.camera)
    sample = [holed, *views(TRUTH, FOUR[1:])]
    # the face is before the hair: nothing else explains a hole
    shape = find_shape(STRANDS, "radial", sample, HEAD, PARAMS)
    assert overlap(holed, shape.closed) > 0.95


def test_a_view_that_contradicts_the_others_is_named_and_left_out():
    sample = views(TRUTH)
    sample[1] = view("back", dome(0.21))
    shape = find_shape(STRANDS, "radial", sample, HEAD, PARAMS)
    assert len(shape.remarks) == 1 and "'back'" in shape.remarks[0] and "left out" in shape.remarks[0]
    assert "'left'" not in shape.remarks[0]
    assert shape.left_out == ("back",)
    assert shape.mask_iou[[0, 2, 3]].min() > 0.94 and shape.mask_iou[1] < 0.8


def test_two_views_that_contradict_each_other_are_both_named():
    sample = [view("front", TRUTH), view("left", dome(0.21))]
    shape = find_shape(STRANDS, "radial", sample, HEAD, PARAMS)
    assert len(shape.remarks) == 1 and "'front' and 'left'" in shape.remarks[0]


def test_a_head_without_a_marked_scalp_takes_it_from_the_roots():
    bare = Head(HEAD.vertices, HEAD.triangles, np.zeros(len(HEAD.triangles), np.bool_), HEAD.corner_uv)
    shape = find_shape(STRANDS, "radial", views(TRUTH, ("front", "left")), bare, PARAMS)
    assert shape.mask_iou.min() > 0.94


def test_the_same_bytes_again(rough):
    again = find_shape(STRANDS, "radial", views(TRUTH), HEAD, PARAMS)
    assert again.closed.vertices.tobytes() == rough.closed.vertices.tobytes()
    assert again.open.vertices.tobytes() == rough.open.vertices.tobytes()
    assert again.strands.points.tobytes() == rough.strands.points.tobytes()


def test_it_reports_progress_and_can_be_cancelled():
    reached = []

    def stop(fraction, message):
        reached.append(fraction)
        if fraction > 0.4:
            raise Cancelled

    with pytest.raises(Cancelled):
        find_shape(STRANDS, "radial", views(TRUTH), HEAD, PARAMS, progress=stop)
    assert reached == sorted(reached) and len(reached) > 2


def test_bad_input():
    sample = views(TRUTH)
    none = StrandSet(np.zeros((0, 3), np.float32), np.zeros(1, np.int32))
    with pytest.raises(InputError, match="no strands"):
        find_shape(none, "none", sample, HEAD, PARAMS)
    with pytest.raises(InputError, match="0 views"):
        find_shape(STRANDS, "radial", [], HEAD, PARAMS)
    with pytest.raises(InputError, match="9 views"):
        find_shape(STRANDS, "radial", [sample[0]] * 9, HEAD, PARAMS)
    for wrong in (
        {"resolution": 8},
        {"blur": -1.0},
        {"tube": 0.0},
        {"gap": 1.0},
        {"conflict": 0.0},
        {"growth_rounds": -1},
    ):
        with pytest.raises(InputError):
            ShapeParams(**wrong)
    with pytest.raises(InputError):
        RoughShape(TRUTH, TRUTH, STRANDS, "x", np.zeros((2, 2)))
