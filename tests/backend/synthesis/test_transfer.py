"""Detail transfer: identity, invariance, the equations against a slow reference, bad input."""

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.synthesis.transfer import (
    TransferParams,
    align_frames,
    assign_to_centers,
    match_wisps,
    transfer_details,
)
from hairloom.types import RootedStrands, WispHierarchy


def rotation(rng):
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def hemisphere_strands(rng, n_strands, n_points=24):
    """Wavy strands on a unit hemisphere, frames as in the paper (rotation of +y to the normal)."""
    polar = np.arccos(rng.uniform(0.3, 1.0, n_strands))
    azimuth = rng.uniform(0, 2 * np.pi, n_strands)
    normal = np.stack([np.sin(polar) * np.cos(azimuth), np.cos(polar), np.sin(polar) * np.sin(azimuth)], axis=1)
    axis = np.cross([0.0, 1.0, 0.0], normal)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    frames = np.stack([_rotate(np.eye(3)[k], axis, polar) for k in range(3)], axis=2)  # columns R x, R y, R z
    t = np.linspace(0, 1, n_points)[None, :, None]
    bend = rng.normal(size=(n_strands, 1, 3)) * 0.15 + np.array([0.5, 0.2, 0.1])
    wave = 0.05 * np.sin(12 * t + rng.uniform(0, 6, (n_strands, 1, 1))) * np.array([0.0, 0.3, 1.0])
    points = t * np.array([0.1, 0.6, 0.0]) + t**2 * bend + wave - wave[:, :1]
    uv = np.stack([np.arctan2(normal[:, 1] + 1, normal[:, 0]), np.arctan2(normal[:, 1] + 1, normal[:, 2])], axis=1)
    return RootedStrands(*(np.ascontiguousarray(a, dtype=np.float32) for a in (normal, frames, uv, points)))


def _rotate(vector, axis, angle):
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return vector * c + np.cross(axis, vector) * s + axis * (axis @ vector)[:, None] * (1 - c)


def two_levels(rng, n_strands=200, n_wisps=12):
    fine = hemisphere_strands(rng, n_strands)
    centers = hemisphere_strands(rng, n_wisps)
    labels = assign_to_centers(fine.uv, centers.uv)
    labels[:n_wisps] = np.arange(n_wisps)  # no wisp is empty
    return WispHierarchy((fine, centers), (labels,))


def test_own_details_on_own_centers_give_the_hairstyle_back():
    example = two_levels(np.random.default_rng(0))
    fine, centers = example.levels
    result = transfer_details(example, 0, centers, fine, wisps=example.labels[0])
    # float32 rotations of points a head radius away: a few ulp; the issue asks for 1e-4
    assert np.abs(result.strands.in_head_space() - fine.in_head_space()).max() < 5e-6
    assert (result.donors[:, 0] == np.arange(fine.n_strands)).all()
    assert (result.matches == np.arange(centers.n_strands)).all()


def test_a_turned_example_gives_the_same_details():
    """Detail transfer sees wisps only in their own frames, so turning the whole example changes nothing."""
    rng = np.random.default_rng(1)
    example = two_levels(rng)
    fine, centers = example.levels
    turn = rotation(rng).astype(np.float32)

    def turned(strands):
        return RootedStrands(strands.roots @ turn.T, turn @ strands.frames, strands.uv, strands.points)

    moved = WispHierarchy((turned(fine), turned(centers)), example.labels)
    out_roots = hemisphere_strands(np.random.default_rng(2), 150)
    out_centers = hemisphere_strands(np.random.default_rng(3), 9)
    plain = transfer_details(example, 0, out_centers, out_roots)
    from_turned = transfer_details(moved, 0, out_centers, out_roots)
    same = plain.donors[:, 0] == from_turned.donors[:, 0]
    assert same.mean() > 0.98  # rounding may swap two equally good donors
    np.testing.assert_allclose(plain.strands.points[same], from_turned.strands.points[same], atol=2e-5)


def test_roots_are_kept_exactly():
    example = two_levels(np.random.default_rng(4))
    roots = hemisphere_strands(np.random.default_rng(5), 77)
    result = transfer_details(example, 0, example.levels[1], roots, TransferParams(n_donors=3))
    assert (result.strands.points[:, 0] == 0).all()
    assert (result.strands.roots == roots.roots).all()


def test_equations_5_to_8_against_plain_loops():
    from hairloom.geometry.frames import transport_frames

    example = two_levels(np.random.default_rng(6), 40, 4)
    fine, in_centers = example.levels
    out_centers = hemisphere_strands(np.random.default_rng(7), 3)
    roots = hemisphere_strands(np.random.default_rng(8), 20)
    result = transfer_details(example, 0, out_centers, roots)
    a, b, c = fine.in_head_space(), in_centers.in_head_space(), out_centers.in_head_space()
    in_aligned, out_aligned = align_frames(in_centers)[0], align_frames(out_centers)[0]
    in_vertex = transport_frames(b, np.ascontiguousarray(in_aligned[:, :, 2]))
    out_vertex = transport_frames(c, np.ascontiguousarray(out_aligned[:, :, 2]))
    n = fine.n_points
    got = result.strands.in_head_space()
    for s in range(roots.n_strands):
        donor, o = result.donors[s, 0], result.wisps[s]
        w = example.labels[0][donor]
        assert w == result.matches[o]
        for i in range(n):
            d_alpha = in_aligned[w].T @ ((a[donor, i] - b[w, i]) - (a[donor, 0] - b[w, 0]))
            d_beta = in_vertex[w, i].T @ (a[donor, i] - b[w, i])
            g_alpha = c[o, i] + out_aligned[o] @ d_alpha + roots.roots[s] - c[o, 0]
            g_beta = c[o, i] + out_vertex[o, i] @ d_beta
            t = i / (n - 1)
            np.testing.assert_allclose(got[s, i], (1 - t) * g_alpha + t * g_beta, atol=5e-6)


def test_donor_is_the_member_with_the_most_similar_root_displacement():
    example = two_levels(np.random.default_rng(9))
    out_centers = hemisphere_strands(np.random.default_rng(10), 6)
    roots = hemisphere_strands(np.random.default_rng(11), 50)
    result = transfer_details(example, 0, out_centers, roots, TransferParams(n_donors=2))
    fine, in_centers = example.levels
    in_frames, out_frames = align_frames(in_centers)[0], align_frames(out_centers)[0]
    for s in range(roots.n_strands):
        o = result.wisps[s]
        w = result.matches[o]
        want = out_frames[o].T @ (roots.roots[s] - out_centers.roots[o])
        members = np.flatnonzero(example.labels[0] == w)
        offsets = (fine.roots[members] - in_centers.roots[w]) @ in_frames[w]
        order = np.argsort(np.linalg.norm(offsets - want, axis=1))
        assert result.donors[s, 0] == members[order[0]]


def test_aligned_frames_are_rotations_along_the_strand():
    strands = hemisphere_strands(np.random.default_rng(12), 100)
    frames, points = align_frames(strands)
    np.testing.assert_allclose(np.einsum("sij,sik->sjk", frames, frames), np.eye(3)[None].repeat(100, 0), atol=1e-5)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-5)
    np.testing.assert_allclose(frames[:, :, 1], strands.frames[:, :, 1], atol=1e-6)  # the normal stays
    mean = points[:, 1:].sum(axis=1)
    assert (mean[:, 0] > 0).all()  # the tangent points along v_g
    np.testing.assert_allclose(mean[:, 2] / np.linalg.norm(mean, axis=1), 0.0, atol=1e-5)
    back = np.matmul(points, frames.transpose(0, 2, 1)) + strands.roots[:, None]
    np.testing.assert_allclose(back, strands.in_head_space(), atol=1e-5)


def test_an_upright_strand_keeps_its_root_frame():
    strands = hemisphere_strands(np.random.default_rng(13), 5)
    upright = np.zeros_like(strands.points)
    upright[:, :, 1] = np.linspace(0, 1, strands.n_points)
    frames, _ = align_frames(strands.with_points(upright))
    assert (frames == strands.frames).all()


def test_matching_discounts_the_direction_a_wisp_points_to():
    centers = hemisphere_strands(np.random.default_rng(14), 30)
    angle = 2.0
    c, s = np.cos(angle), np.sin(angle)
    about_normal = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]], np.float32)
    turned = centers.with_points(np.ascontiguousarray(centers.points @ about_normal.T))
    assert (match_wisps(turned, centers) == np.arange(30)).all()


def test_same_input_same_bytes():
    example = two_levels(np.random.default_rng(15))
    roots = hemisphere_strands(np.random.default_rng(16), 300)
    first = transfer_details(example, 0, example.levels[1], roots, TransferParams(n_donors=4))
    second = transfer_details(example, 0, example.levels[1], roots, TransferParams(n_donors=4))
    assert first.strands.points.tobytes() == second.strands.points.tobytes()


def test_bad_input_is_refused():
    example = two_levels(np.random.default_rng(17))
    roots = hemisphere_strands(np.random.default_rng(18), 10)
    with pytest.raises(InputError, match="no wisps at level 1"):
        transfer_details(example, 1, example.levels[1], roots)
    short = hemisphere_strands(np.random.default_rng(19), 5, n_points=10)
    with pytest.raises(InputError, match="same number of points"):
        transfer_details(example, 0, short, roots)
    with pytest.raises(InputError, match="n_donors is 0"):
        TransferParams(n_donors=0)
    with pytest.raises(InputError, match="center for every"):
        transfer_details(example, 0, example.levels[1], roots, wisps=np.zeros(3, np.int32))
