"""All strands: blends of guides with partings kept, masks filled and obeyed, nothing in the head."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest
from flowing_hair import HEAD, flow, make_head, make_shape, make_views, make_volume, outside
from hairloom.fields.grid import dense_grid
from hairloom.fourview._filling_kernels import blend_guides, choose_blends, cut_strands, smooth_moves
from hairloom.fourview.detail import half_turns
from hairloom.fourview.filling import _spread, grow_strands
from hairloom.fourview.growth import GrowthParams
from hairloom.fourview.hair_space import make_hair_space
from hairloom.fourview.masks import bend_into_masks, hairy_region, mask_limits
from hairloom.fourview.views import View
from hairloom.geometry.camera import project
from hairloom.geometry.frames import transport_frames
from hairloom.geometry.head import HeadSurface
from hairloom.geometry.strand_raster import raster_strands
from hairloom.geometry.strands import polyline_lengths
from hairloom.geometry.view_raster import raster_mesh

PARAMS = GrowthParams(n_guides=300, n_strands=4000, n_points=24)


@pytest.fixture(scope="module")
def scene():
    shape, volume, head = make_shape(), make_volume(), make_head()
    views = make_views(shape)
    return shape, volume, head, views, grow_strands(volume, shape, views, head, PARAMS)


def overlap(a, b):
    return (a & b).sum() / (a | b).sum()


def test_the_photos_masks_are_filled(scene):
    _, _, head, views, strands = scene
    assert strands.n_strands == PARAMS.n_strands
    assert (strands.point_counts == PARAMS.n_points).all()
    for view in views:
        drawn = raster_strands(view.camera, strands, head, 2.0).mask  # 4,000 strands of 3 mm: as thick as 30,000
        assert drawn[view.mask].mean() > 0.98, view.name
        assert overlap(drawn, view.mask) > 0.96, view.name


def test_what_is_seen_runs_along_the_field(scene):
    _, _, head, views, strands = scene
    for view in views:
        raster = raster_strands(view.camera, strands, head)
        points = strands.points[raster.segment[raster.mask]].astype(np.float64)
        step = (project(view.camera, points + 1e-4 * flow(points)) - project(view.camera, points))[:, :2]
        apart = np.abs((np.arctan2(step[:, 1], step[:, 0]) - raster.angle[raster.mask] + np.pi / 2) % np.pi - np.pi / 2)
        assert np.degrees(np.median(apart)) < 5.0, view.name


def test_no_strand_is_in_the_head_and_all_are_rooted_on_the_scalp(scene):
    _, _, head, _, strands = scene
    surface = HeadSurface(head)
    points = strands.points.reshape(strands.n_strands, -1, 3)
    assert surface.signed_distance(points[:, 1:].reshape(-1, 3)).min() > 0.0
    assert np.abs(surface.signed_distance(points[:, 0])).max() < 1e-6
    assert points[:, 0, 2].min() > -1e-3
    # spread evenly: relaxed roots vary by less than random ones (0.52), also after some were left out
    from scipy.spatial import cKDTree

    nearest = cKDTree(points[:, 0]).query(points[:, 0], k=2)[0][:, 1]
    assert nearest.std() / nearest.mean() < 0.3


def test_strands_stay_in_the_shape(scene):
    strands = scene[4]
    # a cell of the grid is 2.5 mm; the masks' pixels are 1.6 mm
    assert np.percentile(outside(strands.points), 99) < 0.002
    assert outside(strands.points).max() < 0.006


def test_a_smaller_mask_is_obeyed(scene):
    """One photo shows shorter hair, and nothing right of a line, than the shape has."""
    shape, volume, head, views, _ = scene
    rows, columns = np.mgrid[:200, :200]
    front = views[0]
    narrow = front.mask & (rows < 140) & (columns < 150)
    limited = [View("front", front.image, narrow, front.camera), *views[1:]]
    strands = grow_strands(volume, shape, limited, head, replace(PARAMS, n_strands=2000))
    surface = HeadSurface(head)
    depth = raster_mesh(front.camera, head.vertices, head.triangles).depth
    seen = project(front.camera, strands.points)
    row, column = np.floor(seen[:, 1]).astype(int), np.floor(seen[:, 0]).astype(int)
    shown = seen[:, 2] < depth[row, column]  # what the head hides may hang lower
    off = ~narrow[row, column] & shown
    distance = mask_limits(limited, head).away[0, row, column]
    assert distance[off].max(initial=0.0) <= PARAMS.mask_margin + 2.5  # roots, and a step out of the head
    assert surface.signed_distance(strands.points).min() > -1e-6
    assert seen[shown, 1].max() < 140 + PARAMS.mask_margin + 1
    # cut or bent, but not thrown away
    assert strands.n_strands > 1800


def test_roots_leave_out_what_a_photo_shows_bare(scene):
    _, _, head, views, _ = scene
    rows = np.mgrid[:200, :200][0]
    bald = [View("front", views[0].image, views[0].mask & (rows > 100), views[0].camera)]
    region = hairy_region(bald, head, HeadSurface(head))
    middles = head.vertices[head.triangles].mean(axis=1)
    front = head.scalp & (middles[:, 1] < -0.05) & (middles[:, 2] > 0.03)
    assert not region[front].any()
    assert region[head.scalp & (middles[:, 1] > 0.02)].all()
    assert not region[~head.scalp].any()


def test_detail_stays_off_the_head_and_in_the_masks(scene):
    """Waves in the field become helices, whose depth the head and the masks limit like all hair."""
    shape, _, head, views, _ = scene
    cells = make_volume()
    middles = np.stack(np.meshgrid(*[np.arange(60)] * 3, indexing="ij"), axis=-1) * cells.spacing + cells.origin
    straight = cells.dense()
    waving = straight + 0.8 * np.cos(2 * np.pi * middles[..., 2:] / 0.03) * np.cross(straight, middles) / 0.1
    volume = dense_grid((waving * straight.any(axis=3)[..., None]).astype(np.float32), cells.origin, cells.spacing)
    normals = dense_grid(middles.astype(np.float32), cells.origin, cells.spacing)
    params = replace(PARAMS, n_strands=500, n_points=80)
    flat = grow_strands(volume, shape, views, head, params)
    round_ = grow_strands(volume, shape, views, head, params, normals=normals)
    moved = np.linalg.norm(round_.points - flat.points, axis=1)
    assert half_turns(flat, normals).mean() > 3 and np.percentile(moved, 90) > 0.001
    assert HeadSurface(head).signed_distance(round_.points.reshape(500, -1, 3)[:, 1:].reshape(-1, 3)).min() > 0.0
    for view in views:
        seen = project(view.camera, round_.points)
        off = mask_limits([view], head).away[0, np.floor(seen[:, 1]).astype(int), np.floor(seen[:, 0]).astype(int)]
        assert np.percentile(off, 99.9) <= params.mask_margin + 1.0


def test_no_views_and_one_view(scene):
    shape, volume, head, views, _ = scene
    small = replace(PARAMS, n_strands=300)
    assert grow_strands(volume, shape, [], head, small).n_strands == 300
    assert grow_strands(volume, shape, views[:1], head, small).n_strands == 300


def test_same_bytes_for_any_number_of_threads(scene):
    shape, volume, head, views, _ = scene
    small = replace(PARAMS, n_strands=500)
    first = grow_strands(volume, shape, views, head, small)
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        second = grow_strands(volume, shape, views, head, small)
    finally:
        numba.set_num_threads(before)
    assert first.points.tobytes() == second.points.tobytes()


def _naive_blend(roots, chosen, weights, guides, frames):
    out = np.zeros((len(roots), guides.shape[1], 3))
    for s, root in enumerate(roots):
        for guide, weight in zip(chosen[s], weights[s]):
            for i in range(guides.shape[1]):
                turn = frames[guide, i].astype(np.float64) @ frames[guide, 0].astype(np.float64).T
                out[s, i] += weight * (guides[guide, i] + turn @ (root - guides[guide, 0]))
    return out


def test_blends_are_linear_blend_skinning():
    random = np.random.default_rng(0)
    guides = np.cumsum(random.normal(size=(5, 9, 3)), axis=1).astype(np.float32)
    frames = transport_frames(guides, random.normal(size=(5, 3)).astype(np.float32))
    roots = random.normal(size=(7, 3)).astype(np.float32)
    chosen = random.integers(0, 5, (7, 3)).astype(np.int32)
    weights = random.random((7, 3)).astype(np.float32)
    weights /= weights.sum(axis=1, keepdims=True)
    points = np.empty((7, 9, 3), np.float32)
    blend_guides(roots, chosen, weights, guides, frames, np.ones((5, 9), np.float32), points)
    np.testing.assert_allclose(points, _naive_blend(roots, chosen, weights, guides, frames), atol=1e-5)
    np.testing.assert_allclose(points[:, 0], roots, atol=1e-5)  # a rigid copy keeps its root


def test_copies_come_together_as_their_guides_do():
    """Guides that meet in a point, as at the knot of a tail, bring strands between them there too."""
    roots = np.array([[x, y, 0.0] for x in (-0.02, 0.0, 0.02) for y in (-0.02, 0.0, 0.02)], np.float32)
    along = np.linspace(0.0, 1.0, 9)[None, :, None]
    guides = ((1.0 - along) * roots[:, None] + along * np.array([0.0, 0.0, 0.1])).astype(np.float32)
    spread = _spread(guides)
    np.testing.assert_allclose(spread, np.broadcast_to(1.0 - along[..., 0], spread.shape), atol=1e-5)
    frames = np.broadcast_to(np.eye(3, dtype=np.float32), (9, 9, 3, 3)).copy()
    points = np.empty((1, 9, 3), np.float32)
    chosen = np.array([[0]], np.int32)
    blend_guides(roots[:1] + 0.005, chosen, np.ones((1, 1), np.float32), guides, frames, spread, points)
    np.testing.assert_allclose(points[0, 0], roots[0] + 0.005, atol=1e-6)
    np.testing.assert_allclose(points[0, -1], [0.0, 0.0, 0.1], atol=1e-6)
    apart = guides + np.linspace(0.0, 0.3, 9)[None, :, None] * np.sign(roots)[:, None]
    assert (_spread(apart.astype(np.float32)) <= 1.0).all(), "hair that spreads keeps its distances"


def test_partings_stay():
    """Guides left of a parting fall left, those right of it right; no strand hangs between."""
    fall = np.linspace(0.0, 0.1, 10)
    guides = np.zeros((2, 10, 3), np.float32)
    guides[0, :, 0], guides[1, :, 0] = -0.001 - fall, 0.001 + fall
    guides[:, :, 2] = -(fall**2)
    near = np.tile(np.array([[0, 1]], np.int32), (50, 1))
    weights = np.empty((50, 2), np.float32)
    lengths = polyline_lengths(guides)
    primary = (np.arange(50) % 2).astype(np.int32)
    choose_blends(primary, near, np.full((50, 2), 0.001), guides, lengths, 0.35, np.full((50, 2), 0.5), 0.001, weights)
    assert (weights[np.arange(50), primary] == 1.0).all()
    # with any shape allowed they are mixed
    choose_blends(primary, near, np.full((50, 2), 0.001), guides, lengths, 9.0, np.full((50, 2), 0.5), 0.001, weights)
    assert (weights > 0.2).all()


def test_masks_bend_strands_back_and_cut_what_stays_off():
    shape, head = make_shape(36), make_head()
    space = make_hair_space(make_volume(), shape, head)
    view = make_views(shape, ("front",))[0]
    limits = mask_limits([view], head)
    fall = np.linspace(0.0, 1.0, 12)[:, None]
    start = np.array([HEAD, 0.0, 0.0])
    # one leans out of the mask by 4 mm below, one leaves it for good
    leaning = start + fall * np.array([0.024, 0.0, -0.1])
    leaving = start + fall * np.array([0.2, 0.0, 0.0])
    points = np.stack([leaning, leaving]).astype(np.float32)
    lengths = polyline_lengths(points)
    kept = bend_into_masks(points, limits, space, 0.001, 2.0)
    assert kept[0] == 1.0 and polyline_lengths(points)[0] > 0.9 * lengths[0]
    seen = project(view.camera, points.reshape(-1, 3))
    row, column = np.floor(seen[:, 1]).astype(int), np.floor(seen[:, 0]).astype(int)
    assert limits.away[0, row, column].max() <= 2.0
    assert (points[:, 0] == start.astype(np.float32)).all()


def test_cutting_keeps_the_first_part_of_a_strand():
    points = np.zeros((2, 5, 3), np.float32)
    points[:, :, 0] = [0.0, 1.0, 2.0, 3.0, 4.0]
    cut_strands(points, np.array([0.5, 1.0]))
    np.testing.assert_allclose(points[0, :, 0], [0.0, 0.5, 1.0, 1.5, 2.0])
    np.testing.assert_allclose(points[1, :, 0], [0.0, 1.0, 2.0, 3.0, 4.0])


def test_moves_fade_along_a_strand():
    moves = np.zeros((9, 3))
    moves[6] = [0.0, 0.0, 1.0]
    smooth_moves(moves)
    assert moves[0].any() == False and moves[5, 2] > 0.1 and 0.2 < moves[6, 2] < 0.6  # noqa: E712
    whole = np.ones((9, 3))
    smooth_moves(whole)
    np.testing.assert_allclose(whole[5:], 1.0)  # only the root holds them back


def test_100_000_strands_of_few_points(scene):
    shape, volume, head, views, _ = scene
    many = replace(PARAMS, n_strands=100_000, n_points=8, n_guides=200)
    assert grow_strands(volume, shape, views, head, many).n_strands == 100_000
