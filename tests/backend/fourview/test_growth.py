"""Guides: along the field, from the scalp to the border, over all of the outer surface, never in the head."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest
from flowing_hair import BOTTOM, HEAD, OUTER, flow, make_head, make_shape, make_volume, outside
from hairloom.errors import Cancelled, InputError
from hairloom.fields.grid import dense_grid
from hairloom.fields.tracing import trace
from hairloom.fourview._growth_kernels import respace_lines
from hairloom.fourview.growth import GrowthParams, grow_guides, share_bare
from hairloom.fourview.hair_space import HEAD as OF_HEAD
from hairloom.fourview.hair_space import OUTER as OF_OUTER
from hairloom.fourview.hair_space import SCALP, SHAPE, make_hair_space
from hairloom.geometry.head import HeadSurface
from hairloom.geometry.roots import scatter_roots
from hairloom.types import Mesh

PARAMS = GrowthParams(n_guides=300, n_strands=2000, n_points=40)


@pytest.fixture(scope="module")
def scene():
    shape, volume, head = make_shape(), make_volume(), make_head()
    space = make_hair_space(volume, shape, head)
    return shape, volume, head, space, grow_guides(volume, shape, head, PARAMS, space=space)


def test_space_has_the_true_distances_and_directions(scene):
    space = scene[3]
    random = np.random.default_rng(0)
    points = random.uniform(-0.1, 0.1, (4000, 3))
    inside = (outside(points) < -0.006) & (np.linalg.norm(points, axis=1) > HEAD + 0.004)
    points = points[inside]
    at = space.at(points)
    # the grid's cells are 2.5 mm, the marching cubes' 4 mm: both leave less than a third of a millimetre
    to_head = np.linalg.norm(points, axis=1) - HEAD
    near = to_head < 0.007  # farther off, the head's distance need only be large
    assert np.abs(at[near, OF_HEAD] - to_head[near]).max() < 4e-4
    assert at[~near, OF_HEAD].min() > 0.006
    assert at[:, SHAPE].max() < -0.003
    border = random.normal(size=(1000, 3))
    border *= OUTER / np.linalg.norm(border, axis=1, keepdims=True)
    border = border[border[:, 2] > 0.0] * random.uniform(0.98, 1.02, (int((border[:, 2] > 0.0).sum()), 1))
    assert np.abs(space.at(border)[:, SHAPE] - outside(border)).max() < 5e-4
    above = points[:, 2] > 0.01
    assert np.abs(at[above, OF_OUTER] + outside(points)[above]).max() < 4e-4
    assert np.abs(at[above, SCALP] - to_head[above]).max() < 4e-4
    unit = at[:, 4:7] / np.linalg.norm(at[:, 4:7], axis=1, keepdims=True)
    far = np.linalg.norm(points[:, :2], axis=1) > 0.03
    assert np.einsum("nc,nc->n", unit, flow(points))[far].min() > np.cos(np.radians(6.0))
    gradient = at[near, 7 + 3 * OF_HEAD : 10 + 3 * OF_HEAD]
    out = points[near] / np.linalg.norm(points[near], axis=1, keepdims=True)
    # at the end of the head's own grid, 9 mm off it, the gradient is a twentieth short
    assert np.einsum("nc,nc->n", gradient, out).min() > 0.95


def test_guides_run_from_the_scalp_to_the_border(scene):
    _, _, head, _, guides = scene
    surface = HeadSurface(head)
    assert 200 < len(guides.points) <= PARAMS.n_guides
    assert guides.points.shape[1:] == (PARAMS.n_points, 3)
    roots = guides.points[:, 0]
    assert np.abs(surface.signed_distance(roots)).max() < 1e-6
    assert roots[:, 2].min() > -0.002  # the scalp is the upper half
    assert surface.signed_distance(guides.points[:, 2:].reshape(-1, 3)).min() > 0.0
    # the whole way down: what is left is a step, half of a cell of 2.5 mm, and the rounded edge of marching cubes
    assert np.median(guides.points[:, -1, 2]) < BOTTOM + 0.006
    assert outside(guides.points).max() < 0.002


def test_guides_follow_the_field(scene):
    points = scene[4].points.astype(np.float64)
    middles, steps = 0.5 * (points[:, 1:] + points[:, :-1]), np.diff(points, axis=1)
    tangents = steps / np.linalg.norm(steps, axis=2, keepdims=True)
    # beyond the first centimetres, where strands rise from the scalp to their layers
    free = np.linalg.norm(middles - points[:, :1], axis=2) > 0.04
    cosine = np.einsum("snc,snc->sn", tangents, flow(middles))[free]
    assert np.degrees(np.arccos(np.clip(np.median(cosine), -1, 1))) < 5.0
    assert np.percentile(cosine, 5) > np.cos(np.radians(25.0))


def test_the_outer_surface_is_covered(scene):
    shape, volume, head, space, guides = scene
    assert guides.bare < 0.01
    assert guides.bare == share_bare(shape.open, space, guides.points, PARAMS)
    # streamlines alone stay near the scalp: this is why guides rise, and are traced back from bare places
    roots = scatter_roots(head, head.scalp, PARAMS.n_guides, 0).points
    lifted = (roots * 1.02).astype(np.float32)
    plain, _ = trace(volume, lifted, np.full(len(roots), 0.6), 0.002, n_points=40)
    assert share_bare(shape.open, space, plain, PARAMS) > 0.5


def test_hair_from_near_the_crown_lies_on_top(scene):
    points = scene[4].points[~scene[4].covering]
    from_crown = np.arccos(np.clip(points[:, 0, 2] / HEAD, -1, 1))
    # where strands pass the ball's widest place
    place = np.abs(points[:, :, 2] + 0.02).argmin(axis=1)
    radius = np.linalg.norm(points[np.arange(len(points)), place, :2], axis=1)
    top, low = radius[from_crown < 0.5], radius[from_crown > 1.2]
    assert np.median(top) > np.median(low) + 0.3 * (OUTER - HEAD)


def test_the_other_way_round_nothing_grows_down(scene):
    shape, _, head, _, _ = scene
    guides = grow_guides(make_volume(sign=-1.0), shape, head, PARAMS)
    assert np.median(guides.points[:, -1, 2]) > 0.0


def test_maximum_length(scene):
    shape, volume, head, space, _ = scene
    guides = grow_guides(volume, shape, head, replace(PARAMS, max_length=0.06), space=space)
    from_scalp = guides.points[~guides.covering]
    lengths = np.linalg.norm(np.diff(from_scalp, axis=1), axis=2).sum(axis=1)
    assert np.median(lengths) > 0.05 and lengths.max() < 0.06 * 1.05


def test_same_bytes_for_any_number_of_threads(scene):
    shape, volume, head, space, guides = scene
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        again = grow_guides(volume, shape, head, PARAMS, space=space)
    finally:
        numba.set_num_threads(before)
    assert again.points.tobytes() == guides.points.tobytes()
    other = grow_guides(volume, shape, head, replace(PARAMS, seed=1), space=space)
    assert other.points.tobytes() != guides.points.tobytes()


def test_lines_are_respaced_evenly():
    lines = np.zeros((1, 6, 3))
    lines[0, :4, 0] = [0.0, 0.1, 0.4, 1.0]
    out = np.empty((1, 5, 3), np.float32)
    respace_lines(lines, np.array([4], np.int32), out)
    np.testing.assert_allclose(out[0, :, 0], [0.0, 0.25, 0.5, 0.75, 1.0], atol=1e-7)


def test_bad_input(scene):
    shape, volume, head, _, _ = scene
    far = Mesh(shape.closed.vertices + np.float32(2.0), shape.closed.triangles)
    with pytest.raises(InputError, match="nowhere near the scalp"):
        grow_guides(volume, replace(shape, closed=far, open=far), head, PARAMS)
    with pytest.raises(InputError, match="no directions"):
        grow_guides(dense_grid(np.zeros((4, 4, 4, 3), np.float32), np.zeros(3), 0.1), shape, head, PARAMS)
    with pytest.raises(InputError, match="no scalp"):
        grow_guides(volume, shape, replace(head, scalp=np.zeros_like(head.scalp)), PARAMS)
    with pytest.raises(InputError, match="no outer surface"):
        empty = Mesh(shape.open.vertices, np.empty((0, 3), np.int32))
        grow_guides(volume, replace(shape, open=empty), head, PARAMS)
    with pytest.raises(InputError, match="n_guides is 0"):
        GrowthParams(n_guides=0)


def test_cancel(scene):
    shape, volume, head, space, _ = scene

    def stop(fraction, message):
        raise Cancelled("stop")

    with pytest.raises(Cancelled):
        grow_guides(volume, shape, head, PARAMS, space=space, progress=stop)
