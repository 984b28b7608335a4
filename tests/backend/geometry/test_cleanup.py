"""Each rule of clean-up (W-1) on hair made to break it, on a spherical head of known geometry."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hairloom.errors import Cancelled, InputError
from hairloom.geometry.cleanup import CleanUpParams, CleanUpReport, _is_inside, clean_up, find_duplicates, find_outliers
from hairloom.geometry.head import HeadSurface, sphere_head
from hairloom.geometry.strands import from_dense, join_strands, select_strands, strand_lengths
from hairloom.types import StrandSet

RADIUS = 0.1
# the sphere is 64 rings of flat triangles, which lie up to R (1 - cos(pi / 64)) = 0.00012 m below it, twice in a corner
FACET = 2.5e-4


@pytest.fixture(scope="module")
def head():
    return sphere_head(RADIUS)


def directions(n_strands: int, seed: int = 0) -> np.ndarray:
    """Unit vectors in the upper part of the sphere."""
    vectors = np.random.default_rng(seed).normal(size=(n_strands, 3))
    vectors[:, 2] = np.abs(vectors[:, 2]) + 0.5
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def radial(
    n_strands: int = 60, n_points: int = 10, start: float = RADIUS, length: float = 0.1, seed: int = 0
) -> StrandSet:
    """Straight strands along the normals, `start` from the middle."""
    along = start + np.linspace(0.0, length, n_points)
    points = directions(n_strands, seed)[:, None, :] * along[None, :, None]
    strands = from_dense(points.astype(np.float32), {"name": np.arange(n_strands, dtype=np.int32)})
    return dataclasses.replace(strands, point_attributes={"radius": np.arange(len(strands.points), dtype=np.float32)})


def replace_points(strands: StrandSet, change) -> StrandSet:
    points = strands.points.copy().reshape(strands.n_strands, -1, 3)
    change(points)
    return dataclasses.replace(strands, points=points.reshape(-1, 3))


def test_clean_hair_is_left_alone(head):
    strands = radial()
    left, report = clean_up(strands, head, CleanUpParams(snap_roots=False))
    assert report == CleanUpReport() and left.points is strands.points


def test_points_at_one_place_become_one(head):
    def repeat(points):
        points[3, 4] = points[3, 5]
        points[7, 1] = points[7, 0]
        points[7, 2] = points[7, 0]

    strands = replace_points(radial(), repeat)
    left, report = clean_up(strands, head, CleanUpParams(snap_roots=False))
    assert report == CleanUpReport(n_points_merged=3)
    assert left.point_counts[[3, 7]].tolist() == [9, 8] and left.point_counts.sum() == 600 - 3
    np.testing.assert_array_equal(left.roots, strands.roots)
    # the attribute numbers the points: those that went are the second of each pair
    gone = np.setdiff1d(np.arange(600), left.point_attributes["radius"])
    assert gone.tolist() == [35, 71, 72]


def test_strands_of_one_point_and_without_length_are_dropped(head):
    single = StrandSet(np.array([[0, 0, RADIUS]], np.float32), np.array([0, 1], np.int32), {}, {})
    flat = from_dense(np.full((2, 5, 3), [0.0, 0.0, RADIUS], dtype=np.float32))
    tiny = radial(1, length=0.9e-4)
    strands = join_strands([single, radial(5), flat, tiny])
    left, report = clean_up(strands, head, CleanUpParams(snap_roots=False))
    assert (report.n_too_few_points, report.n_too_short) == (1, 3) and report.n_dropped == 4
    np.testing.assert_array_equal(left.points, radial(5).points)


def test_far_roots_are_dropped_and_near_ones_snapped(head):
    far, near = radial(3, start=RADIUS + 0.03, seed=1), radial(40, start=RADIUS + 0.01, seed=2)
    left, report = clean_up(join_strands([far, near]), head)
    assert report == CleanUpReport(n_far_from_scalp=3, n_roots_snapped=40)
    np.testing.assert_allclose(np.linalg.norm(left.roots, axis=1), RADIUS, atol=FACET)
    # straight up from the scalp: the strand follows linearly, so tips stay and steps stay equal
    np.testing.assert_array_equal(left.points[9::10], near.points[9::10])
    np.testing.assert_allclose(strand_lengths(left), 0.11, atol=FACET)
    steps = np.linalg.norm(np.diff(left.points.reshape(40, 10, 3), axis=1), axis=2)
    np.testing.assert_allclose(steps, 0.11 / 9, atol=FACET / 9)


def test_the_scalp_counts_not_the_whole_head(head):
    """Strands that grow from below the scalp's border, the equator."""
    below = replace_points(radial(4), lambda points: np.negative(points, out=points))
    left, report = clean_up(join_strands([below, radial(6)]), head)
    assert report.n_far_from_scalp == 4 and left.n_strands == 6


def test_points_inside_are_pushed_to_the_surface(head):
    def sink(points):
        points[2, 3] *= 0.05 / np.linalg.norm(points[2, 3])
        points[2, 4] *= 0.09 / np.linalg.norm(points[2, 4])

    strands = replace_points(radial(), sink)
    left, report = clean_up(strands, head, CleanUpParams(snap_roots=False))
    assert report.n_points_pushed_out == 2 and report.n_inside_head == 0
    radii = np.linalg.norm(left.points[left.offsets[2] : left.offsets[3]], axis=1)
    # both move to the place right above them, and so become one point
    assert report.n_points_merged <= 1 and (radii >= RADIUS - FACET).all()
    np.testing.assert_allclose(radii[3], RADIUS, atol=FACET)
    kept, report = clean_up(strands, head, CleanUpParams(snap_roots=False, push_out=False))
    assert report == CleanUpReport() and np.array_equal(kept.points, strands.points)


@pytest.mark.parametrize(("n_inside", "is_dropped"), [(4, False), (5, True)])
def test_strands_mostly_inside_are_dropped(head, n_inside, is_dropped):
    """With 9 points after the root and a largest share of one half, 4 inside are allowed and 5 are not."""

    def sink(points):
        inside = points[2, 1 : 1 + n_inside]
        inside *= (0.06 + 0.005 * np.arange(n_inside)[:, None]) / np.linalg.norm(inside, axis=1, keepdims=True)

    strands = replace_points(radial(), sink)
    left, report = clean_up(strands, head, CleanUpParams(snap_roots=False))
    assert report.n_inside_head == is_dropped and (2 not in left.strand_attributes["name"]) == is_dropped


def test_inside_agrees_with_the_signed_distance(head):
    points = np.random.default_rng(3).uniform(-0.12, 0.12, (20_000, 3)).astype(np.float32)
    surface = HeadSurface(head)
    distance = surface.signed_distance(points)
    clear = np.abs(distance) > 1e-6  # on the surface itself both are open
    np.testing.assert_array_equal(_is_inside(surface, points)[clear], distance[clear] < 0)


def test_duplicates_go_and_the_first_stays(head):
    strands = radial(30)
    copies = select_strands(strands, [4, 4, 9])
    nudged = replace_points(select_strands(strands, [11]), lambda points: np.add(points, 4e-6, out=points))
    longer = replace_points(select_strands(strands, [12]), lambda points: np.multiply(points, 1.01, out=points))
    everything = join_strands([strands, copies, nudged, longer])
    left, report = clean_up(everything, head, CleanUpParams(snap_roots=False))
    assert report.n_duplicates == 4
    assert left.strand_attributes["name"].tolist() == [*range(30), 12]
    _, report = clean_up(everything, head, CleanUpParams(snap_roots=False, remove_duplicates=False))
    assert report == CleanUpReport()


def _duplicates_naive(strands: StrandSet, distance: float) -> np.ndarray:
    """True for a strand with an earlier one close by; the same as the rounds where no chains of near strands occur."""
    points = strands.points.reshape(strands.n_strands, -1).astype(np.float64)
    apart = np.abs(points[:, None] - points[None]).max(axis=2)
    return np.array([(apart[i, :i] <= distance).any() for i in range(len(points))])


def test_duplicates_agree_with_all_pairs():
    rng = np.random.default_rng(4)
    base = radial(80, n_points=8)
    order = rng.integers(0, 80, 300)
    strands = select_strands(base, order)
    # within 0.4 of the distance of their original, so all copies of a strand are within 0.8 of each other
    jitter = rng.uniform(-4e-6, 4e-6, (300, 1, 3)).astype(np.float32)
    strands = replace_points(strands, lambda points: np.add(points, jitter, out=points))
    found = find_duplicates(strands, 1e-5)
    np.testing.assert_array_equal(found, _duplicates_naive(strands, 1e-5))
    assert (~found).sum() == len(np.unique(order))


def test_ten_thousand_copies_of_one_strand_are_fast():
    strands = select_strands(radial(2), np.zeros(10_000, dtype=np.int64))
    assert find_duplicates(strands, 1e-5).sum() == 9_999


def test_outliers_in_length_and_direction_are_found(head):
    def spoil(points):
        points[5] = points[5, :1] + (points[5] - points[5, :1]) * 3.0
        points[50] = points[50, :1] + (points[50] - points[50, :1]) @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]])

    strands = replace_points(radial(400), spoil)
    spoiled = np.flatnonzero(find_outliers(strands, CleanUpParams()))
    assert 5 in spoiled and set(spoiled) <= {5, 50}
    left, report = clean_up(strands, head, CleanUpParams(snap_roots=False, remove_outliers=True))
    assert report.n_outliers == len(spoiled) and left.n_strands == 400 - len(spoiled)
    assert not find_outliers(radial(10), CleanUpParams()).any()


def test_a_second_clean_up_finds_nothing(head):
    rng = np.random.default_rng(5)
    strands = radial(300, start=RADIUS - 0.004)
    wild = rng.normal(size=(300, 1, 3)) * 0.002 + rng.normal(size=(300, 10, 3)).cumsum(axis=1) * 0.012
    strands = replace_points(strands, lambda points: np.add(points, wild, out=points, casting="unsafe"))
    once, first = clean_up(strands, head)
    twice, second = clean_up(once, head)
    assert first.n_points_pushed_out > 20 and first.n_roots_snapped > 250
    assert second == CleanUpReport() and np.array_equal(once.points, twice.points)


def test_strand_order_does_not_matter(head):
    strands = join_strands(
        [radial(50), radial(20, start=RADIUS + 0.005, seed=1), radial(5, start=RADIUS - 0.08, seed=2)]
    )
    order = np.random.default_rng(6).permutation(75)
    straight, report = clean_up(strands, head)
    shuffled, report_shuffled = clean_up(select_strands(strands, order), head)
    assert report == report_shuffled
    key = np.lexsort(shuffled.roots.T), np.lexsort(straight.roots.T)
    np.testing.assert_array_equal(shuffled.roots[key[0]], straight.roots[key[1]])


def test_an_empty_set_stays_empty(head):
    empty = select_strands(radial(), [])
    left, report = clean_up(empty, head)
    assert left.n_strands == 0 and report == CleanUpReport()


def test_dropping_everything_is_an_error_that_says_why(head):
    metres_for_centimetres = replace_points(radial(), lambda points: np.multiply(points, 100, out=points))
    with pytest.raises(InputError, match=r"60 far from scalp.*units"):
        clean_up(metres_for_centimetres, head)
    one_point = StrandSet(np.array([[0, 0, RADIUS]], np.float32), np.array([0, 1], np.int32))
    with pytest.raises(InputError, match="1 too few points"):
        clean_up(one_point, head)


def test_a_head_without_a_scalp_is_refused(head):
    with pytest.raises(InputError, match="scalp"):
        clean_up(radial(), dataclasses.replace(head, scalp=np.zeros_like(head.scalp)))


@pytest.mark.parametrize(
    "setting",
    [
        {"min_points": 1},
        {"min_length": -1.0},
        {"max_inside_share": 1.5},
        {"merge_distance": float("nan")},
        {"outlier_factor": 0.5},
        {"outlier_neighbours": 2},
    ],
)
def test_settings_out_of_range_are_refused(setting):
    with pytest.raises(InputError, match=next(iter(setting))):
        CleanUpParams(**setting)


def test_it_can_be_cancelled(head):
    def cancel(fraction, message):
        if fraction > 0.1:
            raise Cancelled("stop")

    with pytest.raises(Cancelled):
        clean_up(radial(), head, progress=cancel)
