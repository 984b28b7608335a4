"""Frames along strands: minimal rotation, degenerate segments, agreement with Bloomenthal's rotation matrices (M-6)."""

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.geometry.frames import transport_frames


def _naive_frames(points, start_normal):
    """One strand by explicit rotations about t_i x t_i+1 (Bloomenthal 1990)."""
    tangents = np.diff(points, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    tangents = np.vstack([tangents, tangents[-1]])
    normal = start_normal - (start_normal @ tangents[0]) * tangents[0]
    normal /= np.linalg.norm(normal)
    frames = []
    for i, tangent in enumerate(tangents):
        if i > 0:
            axis = np.cross(tangents[i - 1], tangent)
            sine, cosine = np.linalg.norm(axis), tangents[i - 1] @ tangent
            if sine > 1e-12:
                x, y, z = axis / sine
                skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
                normal = (np.eye(3) + sine * skew + (1 - cosine) * skew @ skew) @ normal
        frames.append(np.column_stack([normal, np.cross(tangent, normal), tangent]))
    return np.array(frames)


def _random_strands(count=40, n_points=24, seed=3):
    generator = np.random.default_rng(seed)
    points = np.cumsum(generator.normal(size=(count, n_points, 3)) * 0.4 + [0, 0, 0.5], axis=1)
    return points, generator.normal(size=(count, 3))


def _assert_rotations(frames):
    identity = np.einsum("snji,snjk->snik", frames, frames)
    # float32 entries: products of unit vectors are off by some 1e-7
    np.testing.assert_allclose(identity, np.broadcast_to(np.eye(3), identity.shape), atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-6)


def test_agrees_with_naive_rotations():
    points, normals = _random_strands()
    frames = transport_frames(points, normals)
    _assert_rotations(frames)
    expected = np.array([_naive_frames(p, n) for p, n in zip(points, normals)])
    # float32 output; both sides in float64 inside
    np.testing.assert_allclose(frames, expected, atol=1e-6)


def test_planar_curve_keeps_its_binormal_and_turns_by_the_tangent():
    angle = np.linspace(0, 1.5 * np.pi, 50)
    points = np.stack([np.cos(angle), np.sin(angle), np.zeros(50)], axis=1)[None]
    frames = transport_frames(points, np.array([[0.0, 0.0, 1.0]]))
    # in a plane nothing turns about the tangent: the normal stays the plane's
    np.testing.assert_allclose(frames[0, :, :, 0], np.tile([0, 0, 1.0], (50, 1)), atol=1e-6)
    chord = np.diff(points[0], axis=0)
    np.testing.assert_allclose(frames[0, :-1, :, 2], chord / np.linalg.norm(chord, axis=1, keepdims=True), atol=1e-6)
    np.testing.assert_allclose(frames[0, 0, :, 1], np.cross(frames[0, 0, :, 2], [0, 0, 1.0]), atol=1e-6)


def test_helix_turns_less_than_the_frenet_frame():
    t = np.linspace(0, 6 * np.pi, 2000)
    radius, pitch = 1.0, 0.4
    points = np.stack([radius * np.cos(t), radius * np.sin(t), pitch * t], axis=1)[None]
    frames = transport_frames(points, np.array([[-1.0, 0.0, 0.0]]))
    inward = -np.stack([np.cos(t), np.sin(t), np.zeros_like(t)], axis=1)
    across = np.einsum("nc,nc->n", frames[0, :, :, 0], inward)
    up = np.einsum("nc,nc->n", frames[0, :, :, 1], inward)
    turned = np.unwrap(np.arctan2(up, across))[-2]
    # the Frenet normal turns against a minimal frame by the total torsion, tau L = pitch / sqrt(r^2 + pitch^2) t
    expected = pitch / np.hypot(radius, pitch) * t[-2]
    assert abs(turned) == pytest.approx(expected, rel=2e-3)


def test_turns_with_the_strand():
    points, normals = _random_strands()
    rotation = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    turned = transport_frames(points @ rotation.T + 5.0, normals @ rotation.T)
    np.testing.assert_allclose(turned, rotation @ transport_frames(points, normals), atol=2e-6)


def test_degenerate_segments():
    points = np.zeros((5, 4, 3))
    points[0, :, 2] = [0, 0, 1, 2]  # root doubled
    points[1, :, 2] = [0, 1, 1, 2]  # middle doubled
    points[2, :, 2] = [0, 1, 0, 1]  # back and forth
    points[3] = 0.0  # no length at all
    points[4, :, 0] = [0, 1, 2, 3]  # start normal parallel to the strand
    frames = transport_frames(points, np.tile([1.0, 0.0, 0.0], (5, 1)))
    _assert_rotations(frames)
    np.testing.assert_allclose(frames[[0, 1], :, :, 2], np.tile([0, 0, 1.0], (2, 4, 1)), atol=1e-7)
    np.testing.assert_allclose(frames[2, :, :, 0], np.tile([1.0, 0, 0], (4, 1)), atol=1e-7)
    np.testing.assert_allclose(frames[2, :, 2, 2], [1, -1, 1, 1], atol=1e-7)
    np.testing.assert_allclose(frames[3, :, :, 2], np.tile([0, 0, 1.0], (4, 1)), atol=1e-7)
    assert np.abs(frames[4, 0, 0, 0]) < 1e-6


def test_zero_normals_and_single_points():
    frames = transport_frames(np.random.default_rng(1).normal(size=(6, 5, 3)), np.zeros((6, 3)))
    _assert_rotations(frames)
    _assert_rotations(transport_frames(np.zeros((2, 1, 3), np.float32), np.ones((2, 3), np.float32)))
    assert transport_frames(np.zeros((0, 4, 3)), np.zeros((0, 3))).shape == (0, 4, 3, 3)


def test_bad_shapes():
    with pytest.raises(InputError, match="start normals"):
        transport_frames(np.zeros((2, 4, 3)), np.zeros((3, 3)))
    with pytest.raises(InputError, match="shape"):
        transport_frames(np.zeros((2, 4)), np.zeros((2, 3)))
    with pytest.raises(InputError, match="a point"):
        transport_frames(np.zeros((2, 0, 3)), np.zeros((2, 3)))
