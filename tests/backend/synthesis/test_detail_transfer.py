"""Details of one hairstyle on another: identity, what is kept, curls on other lengths, slow references, bad input."""

import numpy as np
import pytest
from hairloom.errors import Cancelled, InputError
from hairloom.geometry.frames import transport_frames
from hairloom.geometry.strands import polyline_lengths
from hairloom.synthesis._detail_kernels import find_loops, lay_details, split_details
from hairloom.synthesis.detail_sampling import needed_subdivision, shortest_wave, smoother, subdivide_dense
from hairloom.synthesis.detail_transfer import LENGTH_MODES, MATCHINGS, DetailParams, smooth_strands, transfer_style
from hairloom.synthesis.matching import match_evenly
from hairloom.synthesis.transfer import align_frames, point_frames
from hairloom.types import RootedStrands, WispHierarchy

N_POINTS = 64
PLAIN_COPY = DetailParams(smoothing=0.0)  # details as they are: A on A is A


def roots_on_cap(rng, count):
    polar, azimuth = np.arccos(rng.uniform(0.4, 1.0, count)), rng.uniform(0, 2 * np.pi, count)
    normal = np.stack([np.sin(polar) * np.cos(azimuth), np.cos(polar), np.sin(polar) * np.sin(azimuth)], axis=1)
    tangent = np.cross(normal, [0.0, 0.0, 1.0])
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    frames = np.stack([tangent, normal, np.cross(tangent, normal)], axis=2)
    uv = np.stack([np.arctan2(normal[:, 1] + 1, normal[:, 0]), np.arctan2(normal[:, 1] + 1, normal[:, 2])], axis=1)
    return normal, frames, uv


def rooted(roots, frames, uv, points):
    return RootedStrands(*(np.ascontiguousarray(a, dtype=np.float32) for a in (roots, frames, uv, points)))


def arcs(length, bend, n=N_POINTS):
    """(N, 3) centers in root frames: straight up, or an arc that turns by `bend` radians towards +x."""
    s = np.linspace(0, 1, n)
    if bend == 0:
        return np.stack([0 * s, length * s, 0 * s], axis=1)
    radius = length / bend
    return np.stack([radius * (1 - np.cos(bend * s)), radius * np.sin(bend * s), 0 * s], axis=1)


def style(seed=0, length=1.0, bend=0.0, radius=0.0, wavelength=0.25, n_wisps=12, per_wisp=10, spread=0.02, bends=0.0):
    """Two levels: wisps of strands that curl about their centers, all in the same phase within a wisp."""
    rng = np.random.default_rng(seed)
    roots, frames, uv = roots_on_cap(rng, n_wisps)
    lengths = length * rng.uniform(0.9, 1.1, n_wisps)
    centers = rooted(
        roots,
        frames,
        uv,
        np.stack([arcs(one, bend + more) for one, more in zip(lengths, rng.uniform(0, bends, n_wisps))]),
    )
    labels = np.repeat(np.arange(n_wisps, dtype=np.int32), per_wisp)
    offsets = rng.normal(0, spread, (len(labels), 3)) * [1, 0, 1]
    local = centers.points[labels].astype(float)
    along = transport_frames(local, np.tile([0.0, 0.0, 1.0], (len(labels), 1))).astype(float)
    places = np.linspace(0, 1, N_POINTS)[None] * lengths[labels][:, None]
    angle = 2 * np.pi * places / wavelength + rng.uniform(0, 6.28, n_wisps)[labels][:, None]
    grown = radius * (1 - np.exp(-places / 0.1))
    curl = grown[..., None] * (np.cos(angle)[..., None] * along[..., 0] + np.sin(angle)[..., None] * along[..., 1])
    points = local + curl - np.linspace(0, 1, N_POINTS)[:, None] * offsets[:, None]  # wisps taper to their centers
    points[:, 0] = 0.0
    hair_roots = roots[labels] + np.einsum("sij,sj->si", frames[labels], offsets)
    return WispHierarchy((rooted(hair_roots, frames[labels], uv[labels], points), centers), (labels,))


def three_levels(seed=0, **kinds):
    """Three levels: the centers of `style`'s wisps gathered in fours."""
    fine = style(seed, **kinds)
    centers = fine.levels[1]
    labels = (np.arange(centers.n_strands) // 4).astype(np.int32)
    rows = np.arange(0, centers.n_strands, 4)
    means = np.stack([centers.points[labels == wisp].mean(axis=0) for wisp in range(len(rows))])
    top = rooted(centers.roots[rows], centers.frames[rows], centers.uv[rows], means)
    return WispHierarchy((*fine.levels, top), (*fine.labels, labels))


def curl_of(result):
    """Radius (S, N) and phase (S, N) of strands about their centers, in the frames along these."""
    fine, centers = result.levels[0].in_head_space(), result.levels[1].in_head_space()
    wisps = np.repeat(np.arange(len(centers)), len(fine) // len(centers))
    frames = transport_frames(centers, result.levels[1].frames[:, :, 2].copy())
    local = np.einsum("snij,sni->snj", frames[wisps], fine - centers[wisps])
    # less the root's offset, which fades to the tip, the curl is left
    fade = np.linspace(1, 0, fine.shape[1])[:, None]
    local = local - fade * local[:, :1]
    return np.hypot(local[..., 0], local[..., 1]), np.unwrap(np.arctan2(local[..., 1], local[..., 0]), axis=1)


def wavelengths(result):
    """(S,) mean wavelength along the center, over the middle of the strand."""
    _, phase = curl_of(result)
    lengths = polyline_lengths(result.levels[1].points).repeat(phase.shape[0] // result.levels[1].n_strands)
    n = phase.shape[1]
    first, last = n // 5, (9 * n) // 10
    turned = np.abs(phase[:, last] - phase[:, first]) / (2 * np.pi)
    return lengths * (last - first) / (n - 1) / turned


def own_details_on(hair, centers):
    """Eqs. 5 to 8 with each strand of the finest level as its own donor, on other centers; head space."""
    fine, wisps = hair.levels[0].in_head_space(), hair.labels[0]
    sides = []
    for side in (hair.levels[1], centers):
        aligned = align_frames(side)[0]
        points = side.in_head_space()
        sides.append((points, aligned, point_frames(points, aligned)))
    (b, in_root, in_point), (c, out_root, out_point) = ([array[wisps] for array in side] for side in sides)
    d = fine - b
    t = np.linspace(0, 1, fine.shape[1])[:, None]
    turn = np.einsum("sij,skj->sik", out_root, in_root)
    alpha = np.einsum("sik,snk->sni", turn, d - d[:, :1]) + fine[:, :1] - c[:, :1]
    beta = np.einsum("snij,snkj,snk->sni", out_point, in_point, d)
    return c + (1 - t) * alpha + t * beta


@pytest.mark.parametrize("mode", LENGTH_MODES)
@pytest.mark.parametrize("matching", MATCHINGS)
def test_a_style_on_itself_is_itself(mode, matching):
    hair = three_levels(radius=0.05, bend=1.0, bends=1.0)
    result = transfer_style(hair, hair, DetailParams(smoothing=0.0, length_mode=mode, matching=matching))
    assert result.subdivision == 1
    for made, own in zip(result.levels, hair.levels):
        # float32 at one head radius from the origin, through two levels of frames
        np.testing.assert_allclose(made.in_head_space(), own.in_head_space(), atol=1e-5)


def test_strength_zero_and_no_levels_change_nothing():
    detail, base = three_levels(0, radius=0.05), three_levels(1, bend=1.0)
    for params in (DetailParams(strength=0.0), DetailParams(levels=())):
        result = transfer_style(detail, base, params)
        for made, own in zip(result.levels, base.levels):
            assert made.points.tobytes() == own.points.tobytes()
    barely = transfer_style(detail, base, DetailParams(strength=1e-9, max_subdivision=1))
    np.testing.assert_allclose(barely.strands.points, base.levels[0].points, atol=1e-5)


def test_strength_is_linear_and_exaggerates_above_one():
    detail, base = style(0, radius=0.05), style(1, bend=1.0, radius=0.01, wavelength=0.5)
    none, half, whole, twice = (
        transfer_style(detail, base, DetailParams(strength=s)).strands.points for s in (0.0, 0.5, 1.0, 2.0)
    )
    np.testing.assert_allclose(half, (none + whole) / 2, atol=1e-5)
    np.testing.assert_allclose(twice, 2 * whole - none, atol=1e-5)
    assert np.abs(whole - none).max() > 0.05


@pytest.mark.parametrize("length", [0.3, 1.0, 3.0])
def test_the_coarsest_level_and_the_roots_are_kept_exactly(length):
    detail, base = three_levels(0, radius=0.05), three_levels(1, length=length, bend=1.0)
    result = transfer_style(detail, base)
    kept = result.levels[-1].points[:, :: result.subdivision]
    assert kept.tobytes() == base.levels[-1].points.tobytes()
    for made, own in zip(result.levels, base.levels):
        assert made.roots.tobytes() == own.roots.tobytes()
        assert (made.points[:, 0] == 0).all()
    assert result.levels[0] is result.strands


def test_a_level_that_is_not_taken_keeps_its_own_details():
    detail, base = three_levels(0, bend=0.5, radius=0.08), three_levels(1, bend=1.0, radius=0.04)
    result = transfer_style(detail, base, DetailParams(levels=(1,), smoothing=0.0))
    assert result.donors[0].shape[1] == 0 and len(result.matches[0]) == 0 and result.donors[1].shape[1] == 1
    np.testing.assert_allclose(result.levels[0].in_head_space(), own_details_on(base, result.levels[1]), atol=1e-5)
    untouched = transfer_style(detail, base, DetailParams(levels=(0,), smoothing=0.0))
    assert untouched.levels[1].points.tobytes() == base.levels[1].points.tobytes()
    assert np.abs(untouched.levels[0].points - base.levels[0].points).max() > 0.02


def test_curls_of_short_hair_keep_their_size_on_hair_three_times_as_long():
    detail, base = style(0, length=1.0, radius=0.05), style(1, length=3.0)
    tile = transfer_style(detail, base, PLAIN_COPY)
    assert tile.subdivision >= 2
    np.testing.assert_allclose(wavelengths(tile), 0.25, rtol=0.03)
    radius = curl_of(tile)[0]
    n = radius.shape[1]
    # the smooth part, which is stretched, holds 0.15 of the curl at the example's tip
    np.testing.assert_allclose(np.quantile(radius[:, n // 5 :], [0.05, 0.95]), 0.05, rtol=0.15)
    np.testing.assert_allclose(radius[:, n // 5 :], 0.05, rtol=0.5)
    assert abs(radius[:, n // 5 :].mean() - 0.05) < 0.03 * 0.05
    plain = transfer_style(detail, base, DetailParams(smoothing=0.0, length_mode="plain"))
    np.testing.assert_allclose(np.median(wavelengths(plain)), 0.75, rtol=0.12)  # stretched as the paper says
    scaled = transfer_style(detail, base, DetailParams(smoothing=0.0, length_mode="scale"))
    assert abs(np.median(curl_of(scaled)[0][:, -1]) - 0.15) < 0.02


def test_short_hair_takes_the_first_part_of_long_details():
    detail, base = style(0, length=3.0, radius=0.05), style(1, length=1.0)
    result = transfer_style(detail, base, PLAIN_COPY)
    assert result.subdivision == 1
    np.testing.assert_allclose(wavelengths(result), 0.25, rtol=0.05)
    np.testing.assert_allclose(curl_of(result)[0][:, N_POINTS // 2 :].mean(), 0.05, rtol=0.05)
    plain = transfer_style(detail, base, DetailParams(smoothing=0.0, length_mode="plain"))
    assert np.median(wavelengths(plain)) < 0.12


def test_equal_lengths_on_straight_hair_are_the_papers_and_bends_do_not_flatten_curls():
    """Where frames turn along a center the paper's blend of two frames shrinks curls; waves take one frame alone."""
    detail = style(0, radius=0.05)
    straight = WispHierarchy(style(0).levels, style(0).labels)
    tile, plain = (
        transfer_style(detail, straight, DetailParams(smoothing=0.0, length_mode=mode)).strands.points
        for mode in ("tile", "plain")
    )
    np.testing.assert_allclose(tile, plain, atol=2e-5)
    detail, bent = style(0, radius=0.05, spread=0.0), style(0, bend=2.8, spread=0.0)
    radius = {}
    for mode in ("tile", "plain"):
        result = transfer_style(detail, bent, DetailParams(smoothing=0.0, length_mode=mode))
        radius[mode] = curl_of(result)[0][:, N_POINTS // 4 : -N_POINTS // 4]
    np.testing.assert_allclose(radius["tile"], 0.05, rtol=0.15)
    assert radius["plain"].min() < 0.03


def test_smoothing_brings_the_curls_of_the_coarsest_level_too():
    curly = style(0, radius=0.05, per_wisp=1, spread=0.0)
    # the curly strands themselves are the coarsest level, so there are no finer-level curls
    detail, base = WispHierarchy((curly.levels[0],) * 2, curly.labels), style(1, per_wisp=1, spread=0.0)
    none, some = (transfer_style(detail, base, DetailParams(smoothing=amount)) for amount in (0.0, 0.5))
    assert curl_of(none)[0].max() < 1e-4
    assert abs(np.median(curl_of(some)[0][:, N_POINTS // 4 :]) - 0.05) < 0.006
    np.testing.assert_allclose(np.median(wavelengths(some)), 0.25, rtol=0.05)


def test_details_without_waves_do_not_start_to_wave_beyond_the_tip():
    """A spike that widens to its tip, on hair four times as long: shape only, so no new bends."""
    detail, base = style(0), style(1, length=4.0)
    fan = detail.levels[0].points * (1 + 0 * detail.levels[0].points)
    s = np.linspace(0, 1, N_POINTS)
    fan[:, :, 0] += (0.1 * s**2 * np.random.default_rng(2).normal(size=(len(fan), 1))).astype(np.float32)
    spiky = WispHierarchy((detail.levels[0].with_points(fan), detail.levels[1]), detail.labels)
    result = transfer_style(spiky, base, DetailParams(smoothing=0.0, max_subdivision=1))
    radius, phase = curl_of(result)
    offsets = (radius * np.exp(1j * phase)).T
    powers = np.vander(s, 3).astype(complex)
    wiggles = offsets - powers @ np.linalg.lstsq(powers, offsets, rcond=None)[0]
    assert np.abs(offsets).max() > 0.1 and np.abs(wiggles).max() < 0.05 * np.abs(offsets).max()


def test_seams_do_not_show():
    rng = np.random.default_rng(3)
    detail, base = style(0, radius=0.05), style(1, length=3.5)
    noisy = detail.levels[0].points + np.cumsum(rng.normal(0, 0.002, detail.levels[0].points.shape), axis=1)
    noisy = (noisy - noisy[:, :1]).astype(np.float32)
    hair = WispHierarchy((detail.levels[0].with_points(noisy), detail.levels[1]), detail.labels)
    result = transfer_style(hair, base, DetailParams(smoothing=0.0, max_subdivision=4)).strands.points
    steps = np.linalg.norm(np.diff(result, axis=1), axis=2)
    first = steps.shape[1] // 4
    assert steps[:, first:].max() < 1.6 * steps[:, :first].max()


def test_a_turned_detail_style_gives_the_same_details():
    rng = np.random.default_rng(4)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn = (turn * np.sign(np.linalg.det(turn))).astype(np.float32)
    detail, base = style(0, radius=0.05), style(1, length=2.0, bend=1.0)
    turned = WispHierarchy(
        tuple(RootedStrands(h.roots @ turn.T, turn @ h.frames, h.uv, h.points) for h in detail.levels), detail.labels
    )
    first, second = transfer_style(detail, base), transfer_style(turned, base)
    assert (first.matches[0] == second.matches[0]).all()
    same = (first.donors[0] == second.donors[0]).ravel()
    assert same.mean() > 0.95  # rounding may swap two equally good donors
    np.testing.assert_allclose(first.strands.points[same], second.strands.points[same], atol=5e-5)


def test_seeds_give_variations_and_the_same_seed_the_same_bytes():
    detail, base = three_levels(0, radius=0.05, n_wisps=40), three_levels(1, length=2.0, n_wisps=40)
    made = [transfer_style(detail, base, DetailParams(seed=seed)) for seed in (0, 1, 1, 2)]
    assert made[1].strands.points.tobytes() == made[2].strands.points.tobytes()
    assert (made[0].matches[1] != made[1].matches[1]).any() and (made[1].matches[1] != made[3].matches[1]).any()


def test_even_matching_uses_all_wisps_and_finer_wisps_follow():
    detail, base = three_levels(0, radius=0.05, n_wisps=40), three_levels(1, length=2.0, bend=2.0, n_wisps=40)
    result = transfer_style(detail, base)
    assert len(np.unique(result.matches[1])) == 10
    assert (result.matches[0] == result.donors[1][:, 0]).all()
    similar = transfer_style(detail, base, DetailParams(matching="similar"))
    assert len(np.unique(similar.matches[1])) < 10


def test_matching_of_equal_sets_is_one_to_one_and_of_others_even():
    rng = np.random.default_rng(5)
    some = rng.normal(size=(300, 8))
    assert (match_evenly(some, some) == np.arange(300)).all()
    used = np.bincount(match_evenly(rng.normal(size=(1000, 8)), some), minlength=300)
    assert used.max() <= 8 and (used > 0).mean() > 0.9
    clusters = np.repeat(np.eye(4) * 10, 50, axis=0)
    labels = np.repeat(np.arange(4), 50)
    matches = match_evenly(clusters + 0.1 * rng.normal(size=(200, 4)), clusters[::2])
    assert (labels[::2][matches] == labels).mean() > 0.9
    assert (match_evenly(some, some[:1]) == 0).all()
    with pytest.raises(InputError, match="no wisp"):
        match_evenly(some, some[:0])


def test_smoother_keeps_lines_and_the_root_and_takes_a_curl_to_its_axis():
    matrix = smoother(N_POINTS, 6.0)
    line = np.linspace(0, 5, N_POINTS)
    np.testing.assert_allclose(matrix @ line, line, atol=1e-12)
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(matrix[0], np.eye(N_POINTS)[0], atol=1e-12)
    curl = np.cos(2 * np.pi * np.arange(N_POINTS) / 10)
    assert np.abs(matrix @ curl)[12:].max() < 0.15  # at the tip
    assert np.abs(matrix @ curl)[24:40].max() < 0.01
    strands = style(0, radius=0.05).levels[0]
    assert smooth_strands(strands, 0.0) is strands
    assert polyline_lengths(smooth_strands(strands, 0.5).points).mean() < 0.8 * polyline_lengths(strands.points).mean()


def test_subdivision_keeps_points_and_parabolas():
    s = np.linspace(0, 1, 12)
    parabola = np.stack([s, s**2, 1 - s**2], axis=1)[None].astype(np.float32)
    fine = subdivide_dense(parabola, 3)
    assert fine.shape == (1, 34, 3)
    assert fine[:, ::3].tobytes() == parabola.tobytes()
    t = np.linspace(0, 1, 34)[3:-3]  # the ends know no neighbour beyond
    np.testing.assert_allclose(fine[0, 3:-3], np.stack([t, t**2, 1 - t**2], axis=1), atol=1e-6)


def test_subdivision_is_as_fine_as_the_waves_need():
    detail = style(0, radius=0.05, wavelength=0.16)
    assert abs(shortest_wave(detail.levels[0]) - 10) < 1.5
    longer = style(1, length=3.0).levels[1]
    assert needed_subdivision(detail.levels[0], detail.levels[1], longer, 4) == 3
    assert needed_subdivision(detail.levels[0], detail.levels[1], longer, 2) == 2
    assert needed_subdivision(detail.levels[0], longer, detail.levels[1], 4) == 1
    straight = style(0)
    assert needed_subdivision(straight.levels[0], straight.levels[1], longer, 4) == 1


def test_split_details_is_what_it_says():
    hair = style(0, radius=0.05, bend=1.0)
    fine, centers = (level.in_head_space() for level in hair.levels)
    frames = transport_frames(centers, hair.levels[1].frames[:, :, 2].copy())
    chosen = np.array([7, 3, 60], np.int32)
    matrix = smoother(N_POINTS, 5.0)
    details, smooth = split_details(
        fine, chosen, hair.labels[0], centers, frames, np.ascontiguousarray(matrix.T, dtype=np.float32)
    )
    for row, strand in enumerate(chosen):
        wisp = hair.labels[0][strand]
        expected = np.stack([frames[wisp, i].T @ (fine[strand, i] - centers[wisp, i]) for i in range(N_POINTS)])
        np.testing.assert_allclose(details[row].T, expected, atol=1e-6)
        np.testing.assert_allclose(smooth[row].T, matrix @ expected, atol=2e-6)


def test_loops_continue_a_helix_exactly_and_nothing_where_there_is_no_wave():
    i = np.arange(N_POINTS)
    angle = 2 * np.pi * i / 11.3
    helix = np.stack([np.cos(angle), np.sin(angle), 0 * angle])
    bend = np.stack([np.maximum(0, i - 50) ** 2 / 100.0, 0 * i, 0 * i])
    waves = np.stack([helix, bend]).astype(np.float32)
    starts, seams = find_loops(waves, 8, 16, 40)
    turned = np.exp(1j * angle[starts[0]]) * (seams[0, 0] + 1j * seams[0, 1])
    assert abs(turned - np.exp(1j * angle[-1])) < 1e-3  # the residue is what the seam's rest holds
    assert np.abs(seams[0, 2:5]).max() < 1e-3 and seams[0, 5] == 1
    assert seams[1, 5] == 0


def catmull_rom(values, place):
    """Values (3, N) at `place`, by the tangents at the points beside it."""
    padded = np.concatenate([2 * values[:, :1] - values[:, 1:2], values, 2 * values[:, -1:] - values[:, -2:-1]], axis=1)
    i = min(int(place), values.shape[1] - 2)
    t = place - i
    before, start, end, after = padded[:, i : i + 4].T
    into, out_of = (end - before) / 2, (after - start) / 2
    return (
        (2 * t**3 - 3 * t**2 + 1) * start
        + (t**3 - 2 * t**2 + t) * into
        + (3 * t**2 - 2 * t**3) * end
        + (t**3 - t**2) * out_of
    )


def test_lay_details_against_plain_loops():
    rng = np.random.default_rng(6)
    hair, onto = style(0, radius=0.05, bend=1.0), style(1, bend=2.0)
    in_centers, out_centers = hair.levels[1].in_head_space(), onto.levels[1].in_head_space()
    in_roots, out_roots = hair.levels[1].frames, onto.levels[1].frames
    in_frames = transport_frames(in_centers, in_roots[:, :, 2].copy())
    out_frames = transport_frames(out_centers, out_roots[:, :, 2].copy())
    count, donors = 6, rng.integers(0, 9, (6, 2)).astype(np.int32)
    weights = rng.random((count, 2)).astype(np.float32)
    shapes = rng.normal(size=(9, 3, N_POINTS)).astype(np.float32)
    waves = rng.normal(size=(9, 3, N_POINTS)).astype(np.float32)
    donor_wisps = rng.integers(0, 12, 9).astype(np.int32)
    wisps = rng.integers(0, 12, count).astype(np.int32)
    roots = rng.normal(size=(count, 3)).astype(np.float32)
    scales, rates = rng.random((count, 2)).astype(np.float32), rng.random((count, 2)).astype(np.float32)
    starts, seams = find_loops(waves, 8, 16, 40)
    result = np.zeros((count, N_POINTS, 3), np.float32)
    lay_details(
        result, roots, wisps, out_roots, out_centers, out_frames, donors, weights, shapes, waves, starts, seams,
        np.float32(8.0),
        donor_wisps, in_roots, in_frames, scales, rates,
    )  # fmt: skip
    expected = np.zeros((count, N_POINTS, 3))
    for s in range(count):
        o = wisps[s]
        for d in range(2):
            u, scale = donors[s, d], scales[s, d]
            b = donor_wisps[u]
            for i in range(N_POINTS):
                t = i / (N_POINTS - 1)
                place = i * rates[s, d]
                wave = catmull_rom(waves[u], place)
                relative = in_frames[b, i] @ shapes[u, :, i] - in_frames[b, 0] @ shapes[u, :, 0]
                alpha = out_roots[o] @ in_roots[b].T @ (scale * relative) + roots[s] - out_centers[o, 0]
                beta = out_frames[o, i] @ (scale * shapes[u, :, i])
                expected[s, i] += weights[s, d] * ((1 - t) * alpha + t * beta + out_frames[o, i] @ wave)
    np.testing.assert_allclose(result, expected, atol=2e-5)


def test_progress_is_told_and_can_cancel():
    detail, base = three_levels(0, radius=0.05), three_levels(1)
    said = []
    transfer_style(detail, base, progress=lambda fraction, message: said.append((fraction, message)))
    assert [fraction for fraction, _ in said] == [0.0, 0.5, 1.0] and "level 1" in said[0][1]

    def cancel(fraction, message):
        raise Cancelled("stop")

    with pytest.raises(Cancelled):
        transfer_style(detail, base, progress=cancel)


def test_bad_input_is_refused():
    two, three = style(0), three_levels(0)
    with pytest.raises(InputError, match="has 3 levels, the base 2; cluster"):
        transfer_style(three, two)
    short = WispHierarchy(
        tuple(level.with_points(np.ascontiguousarray(level.points[:, ::2])) for level in two.levels), two.labels
    )
    with pytest.raises(InputError, match="have 32 points, those of the base 64"):
        transfer_style(short, two)
    alone = WispHierarchy(two.levels[:1], ())
    with pytest.raises(InputError, match="one level only"):
        transfer_style(alone, alone)
    empty = WispHierarchy(two.levels, (np.zeros_like(two.labels[0]),))
    with pytest.raises(InputError, match="has no strands"):
        transfer_style(empty, two)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"strength": 2.1}, "strength is 2.1"),
        ({"strength": float("nan")}, "strength is nan"),
        ({"smoothing": -0.1}, "smoothing is -0.1"),
        ({"length_mode": "stretch"}, "length_mode is 'stretch'"),
        ({"matching": "best"}, "matching is 'best'"),
        ({"levels": (3,)}, r"levels is \(3,\)"),
        ({"max_subdivision": 0}, "max_subdivision is 0"),
        ({"seed": -1}, "seed is -1"),
    ],
)
def test_bad_settings_are_refused(values, words):
    with pytest.raises(InputError, match=words):
        DetailParams(**values)
