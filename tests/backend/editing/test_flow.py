"""Flow: the hair follows its flow strands with details, lengths and roots; identity, rigid motion, edits, refusals."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numba
import numpy as np
import pytest
from hairloom.editing import _flow_kernels
from hairloom.editing.flow import (
    UNBOUND,
    Flow,
    FlowBinding,
    FlowSession,
    apply_flow,
    edited_strands,
    extract_flow,
    strand_marks,
)
from hairloom.errors import InputError
from hairloom.geometry.strands import from_dense, join_strands, polyline_lengths, resample_set, select_strands
from hairloom.types import StrandSet
from scipy.spatial.transform import Rotation

# a float32 of 1.7 m is exact to 1.2e-7 m; two of them are subtracted, and the flow and the hair are both rounded
ROUNDING = 4e-7


def curly_groom(n_strands: int = 240, n_points: int = 48, seed: int = 0) -> tuple[StrandSet, np.ndarray]:
    """Strands of different lengths that rise from a ball at 1.6 m, fall and curl; and 12 wisps by azimuth."""
    rng = np.random.default_rng(seed)
    height, azimuth = rng.uniform(0.3, 0.98, n_strands), rng.uniform(0, 2 * np.pi, n_strands)
    flat = np.sqrt(1 - height**2)
    outward = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), height], axis=1)
    along = np.linspace(0, 1, n_points)[None, :, None] * rng.uniform(0.5, 1.5, n_strands)[:, None, None]
    side = np.cross(outward, [0.0, 0.0, 1.0])
    turn = 25 * along + azimuth[:, None, None]
    points = 0.1 * outward[:, None] * (1 + along) + side[:, None] * 0.004 * np.sin(turn) * along
    points += np.cross(side, outward)[:, None] * 0.004 * np.cos(turn) * along
    points[..., 2:] += 1.6 - 0.1 * along**2
    return from_dense(points), (azimuth / (2 * np.pi) * 12).astype(np.int32)


def wisp_around(flow: np.ndarray, n_strands: int = 40, radius: float = 0.01, turns: float = 6.0) -> StrandSet:
    """Helices around a straight flow (N, 3), their mean exactly on it, all as long as each other."""
    phase = 2 * np.pi * np.arange(n_strands)[:, None] / n_strands + np.linspace(0, 2 * np.pi * turns, len(flow))
    x, y = radius * np.cos(phase), radius * np.sin(phase)
    return from_dense(flow[None] + np.stack([x, y, np.zeros_like(x)], axis=-1))


def dense(flow: Flow) -> np.ndarray:
    return flow.strands.points.reshape(flow.strands.n_strands, -1, 3).astype(np.float64)


def with_points(flow: Flow, points: np.ndarray) -> Flow:
    return replace(flow, strands=from_dense(points))


def bent(flow: Flow, degrees: float = 90.0) -> Flow:
    """Each flow strand turned about x through its root, more and more towards the tip; roots stay."""
    points = dense(flow)
    angles = np.radians(degrees) * np.linspace(0, 1, points.shape[1])
    turns = Rotation.from_rotvec(angles[:, None] * [1.0, 0.0, 0.0]).as_matrix()
    root = points[:, :1]
    return with_points(flow, root + np.einsum("nij,knj->kni", turns, points - root))


def moved(flow: Flow, matrix: np.ndarray, by: np.ndarray) -> Flow:
    turn = matrix.T.astype(np.float32)
    return replace(
        with_points(flow, dense(flow) @ matrix.T + by), normals=flow.normals @ turn, tangents=flow.tangents @ turn
    )


def segments(strands: StrandSet) -> np.ndarray:
    lengths = np.linalg.norm(np.diff(strands.points.astype(np.float64), axis=0), axis=1)
    return np.delete(lengths, strands.offsets[1:-1] - 1)


@pytest.fixture(scope="module")
def groom() -> tuple[StrandSet, np.ndarray]:
    return curly_groom()


@pytest.fixture(scope="module")
def extracted(groom) -> tuple[Flow, FlowBinding]:
    return extract_flow(*groom)


# --- extract_flow


def test_flow_strands_are_the_means_of_their_wisps(groom, extracted):
    strands, labels = groom
    points = strands.points.reshape(strands.n_strands, -1, 3)
    flow = dense(extracted[0])
    assert flow.shape == (12, 32, 3)
    for wisp in range(12):
        for place in (0, -1):
            wanted = points[labels == wisp, place].astype(np.float64).mean(axis=0)
            np.testing.assert_allclose(flow[wisp, place], wanted, rtol=0, atol=ROUNDING)


def test_labels_may_leave_numbers_out(groom, extracted):
    strands, labels = groom
    flow, binding = extract_flow(strands, labels * 3 + 1)
    assert dense(flow).tobytes() == dense(extracted[0]).tobytes()
    assert (binding.ids == extracted[1].ids).all()


def test_ids_are_unique_and_those_of_another_groom_are_others(groom, extracted):
    other, _ = extract_flow(*curly_groom(seed=1))
    ids = np.concatenate([extracted[0].ids, other.ids])
    assert len(np.unique(ids)) == 24
    assert ids.min() > UNBOUND
    again, _ = extract_flow(*groom)
    assert (again.ids == extracted[0].ids).all()


def test_a_short_strand_beside_a_long_flow_ends_where_it_lies():
    """Nine long strands and one of their half length beside them: its tip belongs to the flow's middle."""
    long = np.linspace([0, 0, 0], [0, 0, 0.2], 21)
    aside = np.arange(10)[:, None, None] * [0.001, 0, 0]
    points = long * np.where(np.arange(10) < 9, 1.0, 0.5)[:, None, None] + aside
    flow, binding = extract_flow(from_dense(points), np.zeros(10, np.int32))
    places = binding.places.reshape(10, -1)
    assert flow.lengths[0] == pytest.approx(0.19, abs=1e-3)
    # reaches are tried in steps of 1/32 of the flow
    np.testing.assert_allclose(places[:, -1], [0.2] * 9 + [0.1], rtol=0, atol=0.19 / 32)


# --- apply_flow


def test_with_the_flow_unchanged_the_hair_is_where_it_was(groom, extracted):
    strands, _ = groom
    flow, binding = extracted
    found = apply_flow(strands, binding, flow)
    # 1e-6 of a head radius of 0.1 m; float32 itself is exact to 1.2e-7 here
    np.testing.assert_allclose(found.points, strands.points, rtol=0, atol=1.2e-7)
    np.testing.assert_allclose(found.roots, strands.roots, rtol=0, atol=1e-8)


def test_a_rigid_motion_of_the_flow_is_that_motion_of_the_hair(groom, extracted):
    strands, _ = groom
    flow, binding = extracted
    matrix, by = Rotation.from_rotvec([0.7, -1.9, 1.1]).as_matrix(), np.array([0.3, -0.2, 0.5])
    found = apply_flow(strands, binding, moved(flow, matrix, by))
    # places near the tips move along the flow by the rounding of its length, frames turn by that of its chords
    np.testing.assert_allclose(found.points, strands.points.astype(np.float64) @ matrix.T + by, rtol=0, atol=3e-6)


@pytest.mark.parametrize("degrees", [30.0, 90.0, 170.0])
def test_roots_and_lengths_are_kept_under_a_bend(groom, extracted, degrees):
    strands, _ = groom
    flow, binding = extracted
    found = apply_flow(strands, binding, bent(flow, degrees))
    assert np.abs(found.points - strands.points).max() > 0.03
    np.testing.assert_allclose(found.roots, strands.roots, rtol=0, atol=1.2e-7)
    # the issue asks for 0.5 %; the kernel lets 0.01 % pass, and segments of 4 mm are rounded to 1.2e-7 m
    np.testing.assert_allclose(segments(found), segments(strands), rtol=2e-4, atol=2.5e-7)


def test_curls_stay_around_the_flow_that_was_bent_into_an_arc():
    straight = np.linspace([0, 0, 0], [0, 0, 0.3], 200)
    strands = wisp_around(straight)
    flow, binding = extract_flow(strands, np.zeros(strands.n_strands, np.int32), 64)
    radius = 0.3 / (np.pi / 2)
    angle = np.linspace(0, np.pi / 2, 64)
    arc = np.stack([radius * (1 - np.cos(angle)), np.zeros(64), radius * np.sin(angle)], axis=1)
    found = apply_flow(strands, binding, with_points(flow, arc[None])).points.reshape(strands.n_strands, -1, 3)
    # distance of each point from the arc's circle; the roots' own plane is kept, so the first tenth is left out
    from_axis = np.hypot(radius - found[..., 0], found[..., 2]) - radius
    distance = np.hypot(from_axis, found[..., 1])[:, 20:-10]
    assert abs(distance.mean() - 0.01) < 2e-4
    assert np.abs(distance - 0.01).max() < 1e-3
    assert found[:, -1, 0].mean() > 0.17


@pytest.mark.parametrize("axis", [[1.0, 1.0, 0.0], [1.0, -0.2, 0.0], [-0.3, 1.0, 0.0]])
def test_a_flow_turned_about_its_root_turns_its_hair_without_twist(axis):
    """All points turned in Edit Mode: the stored frame stays as it was, and the hair turns by the smallest rotation."""
    strands = wisp_around(np.linspace([0, 0, 0], [0, 0, 0.3], 200), radius=0.01, turns=0.0)
    flow, binding = extract_flow(strands, np.zeros(strands.n_strands, np.int32), 64)
    matrix = Rotation.from_rotvec(1.4 * np.array(axis) / np.linalg.norm(axis)).as_matrix()
    found = apply_flow(strands, binding, with_points(flow, dense(flow) @ matrix.T)).points
    np.testing.assert_allclose(found.reshape(-1, 200, 3)[:, 0], strands.roots, rtol=0, atol=1e-8)
    # beyond four times the roots' distance from the flow; the way there is a little longer for some strands, so that
    # they end a little earlier along the flow
    aside = ((found - strands.points @ matrix.T) @ matrix).reshape(-1, 200, 3)[:, 60:, :2]
    assert np.abs(aside).max() < 1e-6


def sharpest_turn(strands: StrandSet) -> float:
    """The least cosine between successive segments of strands of one point count."""
    steps = np.diff(strands.points.reshape(strands.n_strands, -1, 3).astype(np.float64), axis=1)
    steps /= np.linalg.norm(steps, axis=2, keepdims=True)
    return float(np.einsum("sic,sic->si", steps[:, 1:], steps[:, :-1]).min())


def test_a_bend_tighter_than_the_wisp_is_wide_folds_no_hair():
    """A right angle of 1.5 cm radius, hair 2 cm beside it: frames that turn as the flow does would run backwards."""
    strands = wisp_around(np.linspace([0, 0, 0], [0, 0, 0.3], 64), radius=0.02, turns=0.0)
    flow, binding = extract_flow(strands, np.zeros(strands.n_strands, np.int32), 64)
    angle = np.linspace(0, np.pi / 2, 12)
    corner = [0, 0, 0.12] + 0.015 * np.stack([1 - np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    before, after = np.linspace([0, 0, 0], corner[0], 20), np.linspace(corner[-1], corner[-1] + [0.15, 0, 0], 20)
    target = with_points(flow, np.concatenate([before[:-1], corner, after[1:]])[None])
    assert sharpest_turn(apply_flow(strands, binding, target)) > 0.5
    narrow = np.zeros(1, np.float32)
    assert sharpest_turn(apply_flow(strands, binding, replace(target, widths=narrow))) < 0.0


def test_a_flow_of_other_point_counts_leads_the_hair_alike(groom, extracted):
    strands, _ = groom
    flow, binding = extracted
    target = bent(flow)
    wanted = apply_flow(strands, binding, target)
    found = apply_flow(strands, binding, replace(target, strands=resample_set(target.strands, 57)))
    # a chord of the resampled flow misses the curve by 0.1 mm where curls of the flow are tight
    assert np.abs(found.points - wanted.points).max() < 1e-3


def test_hair_without_its_flow_strand_stays_and_is_counted(groom, extracted):
    strands, labels = groom
    flow, binding = extracted
    kept = np.arange(12) != 5
    less = bent(flow)
    less = Flow(
        select_strands(less.strands, kept),
        *(getattr(less, n)[kept] for n in ("ids", "normals", "tangents", "widths", "lengths")),
    )
    session = FlowSession(strands, binding)
    session.update(less)
    assert session.n_missing == (labels == 5).sum()
    moved_points = (session.points != strands.points).any(axis=1).reshape(strands.n_strands, -1).any(axis=1)
    assert (moved_points == (labels != 5)).all()


def test_joined_grooms_follow_their_joined_flows(groom, extracted):
    other, other_labels = curly_groom(seed=1)
    flow, binding = extracted
    other_flow, other_binding = extract_flow(other, other_labels)
    names = ("ids", "normals", "tangents", "widths", "lengths")
    both_flows = Flow(
        join_strands([bent(other_flow).strands, bent(flow).strands]),
        *(np.concatenate([getattr(other_flow, n), getattr(flow, n)]) for n in names),
    )
    both = FlowBinding(
        *(
            np.concatenate([getattr(binding, n), getattr(other_binding, n)])
            for n in ("ids", "places", "offsets", "steps")
        )
    )
    found = apply_flow(join_strands([groom[0], other]), both, both_flows)
    alone = [apply_flow(groom[0], binding, bent(flow)), apply_flow(other, other_binding, bent(other_flow))]
    assert found.points.tobytes() == np.concatenate([part.points for part in alone]).tobytes()


def test_hair_grows_with_its_flow_only_when_asked(groom, extracted):
    strands, _ = groom
    flow, binding = extracted
    points = dense(flow)
    longer = with_points(flow, points[:, :1] + 1.5 * (points - points[:, :1]))
    before = polyline_lengths(strands.points.reshape(strands.n_strands, -1, 3))
    for follow_length, growth in ((False, 1.0), (True, 1.5)):
        found = apply_flow(strands, binding, longer, follow_length=follow_length)
        after = polyline_lengths(found.points.reshape(strands.n_strands, -1, 3))
        np.testing.assert_allclose(after / before, growth, rtol=2e-4)


# --- FlowSession


def test_a_session_lays_only_what_changed_and_ends_where_one_step_leads(groom, extracted):
    strands, labels = groom
    flow, binding = extracted
    session = FlowSession(strands, binding)
    assert session.update(flow) == strands.n_strands
    points = dense(flow)
    points[3] = dense(bent(flow))[3]
    one = with_points(flow, points)
    array = session.points
    assert session.update(one) == (labels == 3).sum()
    assert session.update(one) == 0
    assert session.points is array
    assert session.points.tobytes() == apply_flow(strands, binding, one).points.tobytes()
    session.update(flow)
    assert session.points.tobytes() == apply_flow(strands, binding, flow).points.tobytes()


def test_the_result_does_not_depend_on_the_thread_count(groom, extracted):
    strands, labels = groom
    results = []
    for count in (1, 2):
        before = numba.get_num_threads()
        numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))
        try:
            flow, binding = extract_flow(strands, labels)
            results.append((apply_flow(strands, binding, bent(flow)).points.tobytes(), binding.offsets.tobytes()))
        finally:
            numba.set_num_threads(before)
    assert results[0] == results[1]


# --- the walk


def walk_naive(path: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Divider walking on a path that is cut into very many pieces and goes on straight."""
    way = np.concatenate([np.linspace(a, b, 20000, endpoint=False) for a, b in itertools.pairwise(path)])
    end = path[-1] - path[-2]
    way = np.concatenate([way, path[-1] + np.linspace(0, 2, 40000)[:, None] * end / np.linalg.norm(end) * steps.sum()])
    out, at = [path[0]], 0
    for step in steps[1:]:
        at += int(np.argmax(np.linalg.norm(way[at:] - out[-1], axis=1) >= step))
        out.append(way[at])
    return np.array(out)


@pytest.mark.parametrize("growth", [0.6, 1.0, 1.4])
def test_walking_agrees_with_the_reference(growth):
    rng = np.random.default_rng(2)
    path = np.cumsum(rng.normal([0, 0, 1.0], 0.5, (12, 3)), axis=0)
    steps = np.concatenate([[0.0], rng.uniform(0.5, 1.5, 11)]).astype(np.float32)
    out = np.empty_like(path)
    end = path[-1] - path[-2]
    _flow_kernels._walk(path, steps, growth, end / np.linalg.norm(end), out)
    np.testing.assert_allclose(np.linalg.norm(np.diff(out, axis=0), axis=1), growth * steps[1:], rtol=2e-4)
    # pieces of 1e-4, and a vertex taken for up to 1e-4 of a step shifts all that follow a little
    np.testing.assert_allclose(out, walk_naive(path, growth * steps), rtol=0, atol=2e-3)


# --- edited_strands


def turned(strands: StrandSet, chosen: np.ndarray, matrix: np.ndarray) -> StrandSet:
    points = strands.points.reshape(strands.n_strands, -1, 3).astype(np.float64).copy()
    roots = points[:, :1].copy()
    points[chosen] = (roots + (points - roots) @ matrix.T)[chosen]
    return from_dense(points)


def test_edits_are_found_and_motions_of_the_whole_are_none(groom):
    strands, _ = groom
    marks, counts = strand_marks(strands), strands.point_counts
    turn = Rotation.from_rotvec([0.0, 0.02, 0.0]).as_matrix()
    some = np.arange(strands.n_strands) % 7 == 0

    def edited(after: StrandSet) -> np.ndarray:
        return edited_strands(marks, strand_marks(after), counts)

    assert not edited(strands).any()
    assert not edited(StrandSet(strands.points + np.float32(0.25), strands.offsets)).any()
    assert not edited(turned(strands, np.ones(len(some), bool), turn)).any()
    longer = strands.points.reshape(strands.n_strands, -1, 3).copy()
    longer[some, -1] += 0.001
    assert (edited(from_dense(longer)) == some).all()
    # single strands that turn about their roots, each by an axis of its own
    points = strands.points.reshape(strands.n_strands, -1, 3).astype(np.float64).copy()
    for strand in np.flatnonzero(some):
        own = Rotation.from_rotvec([0.02 * np.cos(strand), 0.02 * np.sin(strand), 0]).as_matrix()
        points[strand] = points[strand, :1] + (points[strand] - points[strand, :1]) @ own.T
    assert (edited(from_dense(points)) == some).sum() > len(some) - 3


# --- refusals


def test_bad_input(groom, extracted):
    strands, labels = groom
    flow, binding = extracted
    with pytest.raises(InputError, match="there are 3 wisp numbers for 240 strands; run Cluster Wisps again"):
        extract_flow(strands, labels[:3])
    with pytest.raises(InputError, match="is in no wisp; run Cluster Wisps again"):
        extract_flow(strands, labels - 1)
    with pytest.raises(InputError, match="cannot have 2 points; choose 4 to 512"):
        extract_flow(strands, labels, 2)
    with pytest.raises(InputError, match="there are no strands"):
        extract_flow(StrandSet(np.zeros((0, 3), np.float32), np.zeros(1, np.int32)), labels[:0])
    other = replace(flow, ids=flow.ids + 1000)
    with pytest.raises(InputError, match=r"none of the 12 flow strands belongs to this hair; .*run Extract Flow again"):
        apply_flow(strands, binding, other)
    with pytest.raises(InputError, match="does not fit 239 strands"):
        apply_flow(select_strands(strands, np.arange(239)), binding, flow)
    with pytest.raises(InputError, match="the flow has no strands"):
        replace(flow, strands=select_strands(flow.strands, []))
    with pytest.raises(InputError, match="the flow's widths have shape"):
        replace(flow, widths=flow.widths[:2])


def test_a_flow_strand_shrunk_to_its_root_and_a_strand_of_one_point_are_no_error(groom, extracted):
    strands, labels = groom
    flow, binding = extracted
    points = dense(flow)
    points[:] = points[:, :1]
    found = apply_flow(strands, binding, with_points(flow, points))
    np.testing.assert_allclose(segments(found), segments(strands), rtol=2e-4, atol=2.5e-7)
    single = StrandSet(strands.points[:1], np.array([0, 1], np.int32))
    flow, binding = extract_flow(single, labels[:1])
    np.testing.assert_array_equal(apply_flow(single, binding, flow).points, single.points)
