"""Rigid motion between frames."""

import numpy as np
from hairloom.rods.motion import RootMotion, Track
from hairloom.rods.scene import Scene
from scipy.spatial.transform import Rotation


def turning(n_frames: int = 5, degrees: float = 40.0) -> np.ndarray:
    """(F, 4, 4): turned about z by `degrees` a frame, moved along x by 1 a frame."""
    matrices = np.tile(np.eye(4), (n_frames, 1, 1))
    angles = np.radians(degrees) * np.arange(n_frames)
    matrices[:, :3, :3] = Rotation.from_rotvec(angles[:, None] * np.array([0, 0, 1])).as_matrix()
    matrices[:, 0, 3] = np.arange(n_frames)
    return matrices


def test_between_frames_the_turn_is_even_and_the_way_straight():
    between = Track(turning()).at(1.25)
    expected = Rotation.from_rotvec(np.radians(50.0) * np.array([0, 0, 1])).as_matrix()
    np.testing.assert_allclose(between[:3, :3], expected, atol=1e-12)
    np.testing.assert_allclose(between[:3, 3], [1.25, 0, 0], atol=1e-12)


def test_frames_themselves_and_the_ends():
    matrices = turning()
    for frame in range(5):
        np.testing.assert_allclose(Track(matrices).at(frame), matrices[frame], atol=1e-12)
    np.testing.assert_allclose(Track(matrices).at(9.0), matrices[-1], atol=1e-12)
    np.testing.assert_allclose(Track(matrices[:1]).at(3.0), matrices[0], atol=1e-12)


def test_roots_are_carried_from_where_they_were_at_the_first_frame():
    """The head does not stand at the origin at frame 0: only what it does from there on counts."""
    start = np.eye(4)
    start[:3, :3], start[:3, 3] = Rotation.from_euler("xyz", [0.3, -0.2, 0.5]).as_matrix(), [0.1, 0.2, 1.5]
    scene = Scene(24.0, turning() @ start)
    roots, frames = np.random.default_rng(0).normal(size=(6, 3)), Rotation.random(6, random_state=0).as_matrix()
    same, _ = RootMotion(scene).move(0.0, roots, frames)
    np.testing.assert_allclose(same, roots, atol=1e-12)
    moved, turned = RootMotion(scene).move(2.0, roots, frames)
    expected = turning()[2]
    np.testing.assert_allclose(moved, roots @ expected[:3, :3].T + expected[:3, 3], atol=1e-12)
    np.testing.assert_allclose(turned, expected[:3, :3] @ frames, atol=1e-12)


def test_each_root_has_its_own_motion_where_the_surface_bends():
    own = np.stack([turning(degrees=10.0), turning(degrees=-30.0)], axis=1)[:, :, :3]
    scene = Scene(24.0, np.tile(np.eye(4), (5, 1, 1)), root_motion=own)
    between = RootMotion(scene).at(1.5)
    np.testing.assert_allclose(between[0], Track(turning(degrees=10.0)).at(1.5)[:3], atol=1e-12)
    np.testing.assert_allclose(between[1], Track(turning(degrees=-30.0)).at(1.5)[:3], atol=1e-12)
