"""Fit of helices: each step of the paper against truth or a plain version of it, degenerate strands, invariance."""

import numba
import numpy as np
import pytest
from hairloom.errors import Cancelled, InputError
from hairloom.geometry.strands import from_dense
from hairloom.registry import run_job
from hairloom.rods._fitting_kernels import chain, count_elements, fit_strands, helix_between, relax, set_frame
from hairloom.rods._helix_kernels import turn_coefficients
from hairloom.rods.fitting import FitParams, HelixFit, fit_helices
from hairloom.rods.helices import Helices, evaluate, to_strands
from hairloom.types import StrandSet
from scipy.spatial.transform import Rotation

PAPER = {"tolerance": 0.0}


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def helix(start, tangent, darboux, length):
    """Tip and tangent there, straight from eq. (8)."""
    w = np.linalg.norm(darboux)
    axis = darboux / w
    tau = axis @ tangent
    across = np.cross(tangent, axis)
    tip = start + tau * length * axis + np.sin(w * length) / w * (tangent - tau * axis)
    tip -= (1 - np.cos(w * length)) / w * across
    return tip, tangent + (np.cos(w * length) - 1) * (tangent - tau * axis) - np.sin(w * length) * across


def random_chain(random, n):
    """Break points, tangents, Darboux vectors and lengths of n helices of less than a turn each, in a G1 chain."""
    points, tangents = [random.normal(size=3)], [unit(random.normal(size=3))]
    lengths = random.uniform(0.01, 0.05, n)
    darboux = unit(random.normal(size=(n, 3))) * (random.uniform(0.3, 6.0, n) / lengths)[:, None]
    for i in range(n):
        tip, tangent = helix(points[-1], tangents[-1], darboux[i], lengths[i])
        points.append(tip)
        tangents.append(unit(tangent))
    return np.array(points), np.array(tangents), darboux, lengths


def curly(n_strands=40, n_points=64, seed=0, curl=0.006, pitch=0.06):
    """Hair of 10 to 30 cm: a bent line with curls round it; and its points as an array."""
    random = np.random.default_rng(seed)
    u = np.linspace(0, 1, n_points)
    length = random.uniform(0.1, 0.3, (n_strands, 1))
    phase = random.uniform(0, 6.28, (n_strands, 1)) + length / pitch * 2 * np.pi * u
    x = curl * np.cos(phase) + 0.05 * u**2
    y = curl * np.sin(phase) + 0.02 * u**2
    points = np.stack([x, y, -length * u], -1) + random.normal(0, 0.1, (n_strands, 1, 3))
    return from_dense(points)


def test_a_helix_is_found_again_from_its_ends():
    random = np.random.default_rng(1)
    for _ in range(2000):
        points, tangents, darboux, lengths = random_chain(random, 1)
        found = np.zeros(3)
        length = helix_between(points[0], points[1], tangents[0], tangents[1], 1e-9, found)
        assert abs(length - lengths[0]) < 1e-9 * lengths[0]
        assert np.abs(found - darboux[0]).max() < 1e-9 / lengths[0]  # radians over the element


@pytest.mark.parametrize("n", [1, 2, 7, 25])
def test_piecewise_helices_are_found_again_through_all_steps(n):
    """Break points and tangents of a chain: nothing relaxes, and curvature, torsion and lengths come back to 1e-9."""
    random = np.random.default_rng(n)
    for _ in range(20):
        points, tangents, darboux, lengths = random_chain(random, n)
        relaxed, base, curvatures, positions = np.empty_like(points), np.empty((3, 4)), np.empty((n, 3)), points.copy()
        relax(points, tangents, n, relaxed, np.empty((n, 6)))
        assert np.abs(relaxed - points).max() < 1e-13
        found, found_lengths = np.empty((n, 3)), np.empty(n)
        for i in range(n):
            found_lengths[i] = helix_between(relaxed[i], relaxed[i + 1], tangents[i], tangents[i + 1], 1e-9, found[i])
        assert np.abs(found_lengths / lengths - 1).max() < 1e-9
        assert np.abs((found - darboux) * lengths[:, None]).max() < 1e-9
        set_frame(tangents[0], base)
        base[:, 3] = points[0]
        frame = base[:, :3].copy()
        chain(base, found_lengths, found, n, curvatures, positions, np.empty(3), np.empty((3, 3)))
        assert np.abs(positions - points).max() < 1e-10
        # what must not depend on the frame: torsion is q0 and curvature the rest
        torsion = (darboux * tangents[:-1]).sum(1)
        assert np.abs((curvatures[:, 0] - torsion) * lengths).max() < 1e-9
        strand = Helices(points[:1], frame[None], np.array([0, n], np.int32), found_lengths, curvatures)
        assert np.abs(evaluate(strand, 2)[0][0, -1] - points[-1]).max() < 1e-10


def relax_naive(points, tangents):
    """Eq. (5) as the paper has it: 2N unknowns a_j in bases D_j of the planes orthogonal to the tangents' changes."""
    n = len(points) - 1
    bases = [np.linalg.svd((tangents[j + 1] - tangents[j])[None])[2][1:].T for j in range(n)]
    matrix = np.zeros((3 * n, 2 * n))
    for i in range(1, n + 1):
        for j in range(i):
            matrix[3 * i - 3 : 3 * i, 2 * j : 2 * j + 2] = bases[j]
    moves = np.linalg.solve(matrix.T @ matrix, matrix.T @ (points[1:] - points[0]).ravel())
    return points[0] + np.concatenate([np.zeros((1, 3)), (matrix @ moves).reshape(-1, 3)])


@pytest.mark.parametrize("n", [1, 2, 3, 14, 25])
def test_relaxation_agrees_with_the_papers_linear_system(n):
    random = np.random.default_rng(n)
    points = np.cumsum(random.normal(size=(n + 1, 3)), axis=0)
    tangents = unit(random.normal(size=(n + 1, 3)))
    relaxed = np.empty_like(points)
    relax(points, tangents, n, relaxed, np.empty((n, 6)))
    assert np.abs(relaxed - relax_naive(points, tangents)).max() < 1e-10
    assert np.array_equal(relaxed[0], points[0])
    cohelical = (np.diff(relaxed, axis=0) * np.diff(tangents, axis=0)).sum(1)
    assert np.abs(cohelical).max() < 1e-13


def test_element_count_follows_algorithm_2():
    tangents = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.cumsum([0, 0.1, 0.5, 1.6, 1.7, 0.2, 0.31, 0.33])])
    # products: > 0.95 for 0.1, 0.2 and 0.31 (cos 0.317), <= 0 for 1.6 and 1.7
    assert count_elements(tangents, 7, 1, 25) == 7 - 3 + 2
    assert count_elements(tangents, 7, 7, 25) == 7
    straight = np.tile([[0.0, 0.0, 1.0]], (15, 1))
    assert count_elements(straight, 14, 3, 25) == 3
    back_and_forth = straight * np.where(np.arange(15) % 2, 1.0, -1.0)[:, None]
    assert count_elements(back_and_forth, 14, 3, 25) == 25


def test_lengths_outside_the_limits_fix_the_number():
    params = FitParams(**PAPER)
    for length, wanted in ((0.049, 3), (0.81, 25)):
        line = np.linspace(0, length, 20)[:, None] * [[0.0, 0.6, 0.8]]
        assert fit_helices(from_dense(line[None]), params).helices.element_counts.tolist() == [wanted]


def test_the_chain_is_g1():
    fit = fit_helices(curly())
    helices = fit.helices
    for strand in range(5):
        first, end = helices.offsets[strand : strand + 2]
        frame, root = helices.frames[strand], helices.roots[strand]
        for e in range(first, end):
            one = Helices(
                root[None], frame[None], np.array([0, 1], np.int32), helices.lengths[e : e + 1],
                helices.curvatures[e : e + 1],
            )  # fmt: skip
            points, frames = evaluate(one, 2)
            root, frame = points[0, -1], frames[0, -1]
            if e + 1 < end:
                after = helices.curvatures[e + 1]
                _, b, c = turn_coefficients(np.linalg.norm(after), 1e-7)
                step = 1e-7 * frame[:, 0] + frame @ (b * np.cross(after, [1, 0, 0]) + c * np.cross(after, np.cross(after, [1, 0, 0])))  # noqa: E501  # fmt: skip
                # leaves along the tangent it arrived with, but for its own curvature over 0.1 micrometres
                assert np.linalg.norm(step / 1e-7 - frame[:, 0]) < np.linalg.norm(after) * 1e-7
        assert abs(np.linalg.norm(frame[:, 0]) - 1) < 1e-12


def test_curls_are_followed_and_roots_stay():
    strands = curly()
    fit = fit_helices(strands, FitParams(n_elements=20))
    assert fit.rms.max() < 1e-3  # metres; curls of 6 mm radius
    assert (fit.rms <= fit.maximum).all()
    points, _ = evaluate(fit.helices, 64)
    assert np.array_equal(points[:, 0].astype(np.float32), strands.roots)
    assert np.array_equal(to_strands(fit.helices, strands.point_counts).roots, strands.roots)


def test_reported_distances_are_those_of_points_on_the_helices():
    strands = curly(seed=5)
    fit = fit_helices(strands, FitParams(n_elements=12))
    dense, _ = evaluate(fit.helices, 2000)
    for strand in range(strands.n_strands):
        given = strands.points[strands.offsets[strand] : strands.offsets[strand + 1]]
        nearest = np.linalg.norm(given[:, None] - dense[strand][None], axis=2).min(axis=1)
        # the reported one is to the point at the same share, so never below the nearest (but for the dense steps)
        assert nearest.max() < fit.maximum[strand] + 1e-5
        assert np.sqrt((nearest**2).mean()) < fit.rms[strand] + 1e-5
        assert fit.rms[strand] < 2.0 * np.sqrt((nearest**2).mean()) + 1e-4


def test_a_sampled_helix_comes_back_nearly():
    """Through the polyline the spline limits: 200 points of a helix of 2 turns give its numbers within 0.5 %."""
    helices = Helices(
        np.zeros((1, 3)), np.eye(3)[None], np.array([0, 1], np.int32), np.array([0.2]), np.array([[30.0, 40.0, 50.0]])
    )
    strands = to_strands(helices, np.array([200], np.int32))
    fit = fit_helices(strands, FitParams(n_elements=8))
    assert fit.maximum[0] < 1e-5
    inner = fit.helices.curvatures[1:-1]
    assert np.abs(inner[:, 0] / 30.0 - 1).max() < 5e-3
    assert np.abs(np.linalg.norm(inner[:, 1:], axis=1) / np.hypot(40, 50) - 1).max() < 5e-3
    assert abs(fit.helices.lengths.sum() / 0.2 - 1) < 1e-4


def test_more_elements_are_nearer_and_adaptive_is_never_behind_fixed():
    strands = curly(n_strands=100)
    errors = [np.sqrt((fit_helices(strands, FitParams(n_elements=n)).rms ** 2).mean()) for n in (8, 12, 18, 27)]
    assert errors == sorted(errors, reverse=True)
    paper = fit_helices(strands, FitParams(**PAPER))
    adaptive = fit_helices(strands)
    assert (adaptive.rms <= paper.rms).all()
    counts = adaptive.helices.element_counts
    assert (adaptive.rms[counts < 25] <= FitParams().tolerance).all()
    for n in np.unique(counts):
        fixed = fit_helices(strands, FitParams(n_elements=int(n)))
        assert np.array_equal(fixed.rms[counts == n], adaptive.rms[counts == n])


def test_polish_is_nearer_at_the_same_number():
    strands = curly(curl=0.002)
    plain, polished = fit_helices(strands, FitParams(**PAPER)), fit_helices(strands, FitParams(polish=5, **PAPER))
    assert np.array_equal(plain.helices.offsets, polished.helices.offsets)
    assert np.sqrt((polished.rms**2).mean()) < 0.7 * np.sqrt((plain.rms**2).mean())
    assert np.array_equal(polished.helices.roots, plain.helices.roots)


def test_rigid_motion_and_scale_carry_over():
    points = curly().points.astype(np.float64).reshape(-1, 64, 3)
    turn = Rotation.from_rotvec([0.7, -0.2, 1.9]).as_matrix()
    moved = 2.0 * points @ turn.T + 0.5
    params = FitParams(n_elements=15)
    one, two = fit_helices(from_dense(points), params), fit_helices(from_dense(moved), params)
    # float32 coordinates of about a metre: 6e-8, over pieces of a centimetre
    assert np.abs(two.helices.lengths / one.helices.lengths / 2 - 1).max() < 1e-3
    tips, moved_tips = evaluate(one.helices, 2)[0][:, 1], evaluate(two.helices, 2)[0][:, 1]
    assert np.abs(moved_tips - (2.0 * tips @ turn.T + 0.5)).max() < 2e-5


def test_strand_order_and_threads_change_no_bit():
    strands = curly(n_strands=150)
    fit = fit_helices(strands, FitParams(polish=2))
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        alone = fit_helices(strands, FitParams(polish=2))
    finally:
        numba.set_num_threads(threads)
    assert fit.helices.curvatures.tobytes() == alone.helices.curvatures.tobytes()
    assert fit.rms.tobytes() == alone.rms.tobytes()
    dense = strands.points.reshape(150, 64, 3)
    reverse = fit_helices(from_dense(dense[::-1].copy()), FitParams(polish=2))
    assert reverse.rms[::-1].tobytes() == fit.rms.tobytes()
    assert np.array_equal(reverse.helices.frames[::-1], fit.helices.frames)


def strand_set(*strands):
    counts = [len(strand) for strand in strands]
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return StrandSet(np.concatenate(strands).astype(np.float32), offsets)


LINE = np.linspace(0, 0.2, 30)[:, None] * [[1.0, 0.0, 0.0]]
ARC = 0.05 * np.stack([np.sin(np.linspace(0, 3.0, 40)), 1 - np.cos(np.linspace(0, 3.0, 40)), np.zeros(40)], 1)
LOOPS = 0.03 * np.stack([np.sin(np.linspace(0, 12.6, 90)), 1 - np.cos(np.linspace(0, 12.6, 90)), np.zeros(90)], 1)
S_CURVE = np.stack([np.linspace(0, 0.2, 40), 0.01 * np.sin(np.linspace(0, 12.6, 40)), np.zeros(40)], 1)


@pytest.mark.parametrize("polish", [0, 3])
@pytest.mark.parametrize("n_elements", [0, 1, 2, 6])
@pytest.mark.parametrize(
    ("name", "strand", "distance"),
    [
        ("straight", LINE, 1e-6),
        ("two points", LINE[[0, 29]], 1e-6),
        ("three points", LINE[[0, 3, 29]], 1e-6),
        ("coincident points", np.repeat(LINE, 3, axis=0), 1e-6),
        ("two coincident points of three", LINE[[0, 0, 29]], 1e-6),
        ("an arc of half a turn", ARC, 1e-4),
        ("plane loops", LOOPS, 0.06),
        ("plane waves", S_CURVE, 0.07),
        ("there and back", np.concatenate([LINE, LINE[::-1]]), 0.2),
        ("long and fine", LINE * 1e4, 1e-2),
        ("noise", np.random.default_rng(0).normal(0, 0.05, (50, 3)), 1.0),
    ],
)
def test_degenerate_strands_are_kept(name, strand, distance, n_elements, polish):
    fit = fit_helices(strand_set(strand, ARC), FitParams(n_elements=n_elements, polish=polish))
    assert fit.helices.n_strands == 2
    assert np.isfinite(fit.helices.curvatures).all()
    assert not fit.degenerate.any()
    assert fit.rms[0] <= distance, name
    if name in ("straight", "two points", "coincident points"):
        assert np.abs(fit.helices.curvatures[: fit.helices.offsets[1], 1:]).max() < 1e-2
        assert abs(fit.helices.strand_lengths[0] / 0.2 - 1) < 1e-6


@pytest.mark.parametrize(("strand", "tangent"), [
    (np.zeros((1, 3)), [0, 0, 1]),
    (np.full((5, 3), 0.3), [0, 0, 1]),
    (LINE[:2] * 1e-2, [1, 0, 0]),
])  # fmt: skip
def test_strands_without_length_become_a_counted_stub(strand, tangent):
    strands = strand_set(LINE, strand, ARC)
    for polish in (0, 3):
        fit = fit_helices(strands, FitParams(polish=polish))
        assert fit.degenerate.tolist() == [False, True, False]
        e = fit.helices.offsets[1]
        assert fit.helices.element_counts[1] == 1
        assert fit.helices.lengths[e] == 1e-4
        assert np.array_equal(fit.helices.curvatures[e], [0, 0, 0])
        assert np.allclose(fit.helices.frames[1][:, 0], tangent, atol=1e-6)
        assert fit.maximum[1] <= 1e-4
    report = fit.report(strands)
    assert report["without_length"] == 1
    assert report["strands"] == 3


def test_special_pairs():
    found = np.zeros(3)
    x, y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    zero = np.zeros(3)
    # opposite tangents: half a circle of diameter 0.1
    length = helix_between(zero, 0.1 * y, x, -x, 1e-9, found)
    assert abs(length - np.pi * 0.05) < 1e-15
    assert np.allclose(found, [0, 0, 20], atol=1e-12)
    # equal tangents along the chord: straight; aside of it: one full turn about the chord
    assert helix_between(zero, 0.1 * x, x, x, 1e-9, found) == 0.1
    assert np.array_equal(found, zero)
    tip = np.array([0.1, 0.02, 0.0])
    length = helix_between(zero, tip, x, x, 1e-9, found)
    reached, tangent = helix(zero, x, found, length)
    assert np.allclose(reached, tip, atol=1e-15)
    assert np.allclose(tangent, x, atol=1e-14)
    # no way between the points, and backwards: the shortest element stands in
    assert helix_between(zero, zero, x, y, 1e-3, found) == 1e-3
    assert np.isfinite(found).all()
    assert helix_between(zero, -0.1 * x, x, x, 1e-3, found) == 1e-3
    assert helix_between(zero, zero, x, -x, 1e-3, found) == 1e-3
    assert np.isfinite(found).all()


def test_mirrored_hair_has_mirrored_helices():
    points = curly().points.reshape(-1, 64, 3)
    mirrored = points * np.float32([-1, 1, 1])
    one = fit_helices(from_dense(points), FitParams(n_elements=10))
    two = fit_helices(from_dense(mirrored), FitParams(n_elements=10))
    # torsion changes its sign; rounding differs only in the frames
    assert np.abs(one.helices.curvatures[:, 0] + two.helices.curvatures[:, 0]).max() < 1e-6
    assert np.abs(one.helices.lengths - two.helices.lengths).max() < 1e-12


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ({"n_min": 0}, "n_min is 0"),
        ({"n_max": 2}, "n_max is 2"),
        ({"n_max": 5000}, "n_max is 5000"),
        ({"l_min": -1.0}, "l_min is -1"),
        ({"l_max": 0.01}, "l_max is 0.01"),
        ({"n_elements": -1}, "n_elements is -1"),
        ({"tolerance": -0.1}, "tolerance is -0.1"),
        ({"tolerance": float("nan")}, "tolerance is nan"),
        ({"samples_per_segment": 0}, "samples_per_segment is 0"),
        ({"polish": -1}, "polish is -1"),
    ],
)
def test_bad_settings_are_refused(setting, words):
    with pytest.raises(InputError, match=words):
        FitParams(**setting)


def test_no_strands_and_cancel():
    empty = StrandSet(np.zeros((0, 3), np.float32), np.zeros(1, np.int32))
    fit = fit_helices(empty, FitParams(polish=1))
    assert fit.helices.n_strands == 0
    assert fit.report(empty) == {"strands": 0}

    def cancel(fraction, message):
        raise Cancelled("stop")

    with pytest.raises(Cancelled):
        fit_helices(curly(), progress=cancel)


def test_the_job_gives_fit_and_report(tmp_path):
    from hairloom.io.bundle import read_bundle, write_bundle

    strands = curly()
    outputs = run_job("fit_helices", {"strands": strands}, {"n_elements": 5})
    write_bundle(tmp_path / "a.npz", outputs)
    read = read_bundle(tmp_path / "a.npz")
    assert isinstance(read["fit"], HelixFit)
    assert np.array_equal(read["fit"].helices.curvatures, outputs["fit"].helices.curvatures)
    assert read["report"]["elements_per_strand"] == [5, 5.0, 5]
    assert read["report"]["compression"] == round(3 * 64 / (4 * 5 + 6), 2)
    with pytest.raises(InputError, match="'strands' is missing"):
        run_job("fit_helices", {}, {})


def test_the_kernel_leaves_its_input_alone():
    strands = curly()
    before = strands.points.copy()
    fit_helices(strands)
    assert np.array_equal(strands.points, before)
    assert fit_strands.dispatcher.signatures
