"""Where roots and colliders are at a time between frames: rigid motion, turned at even speed (B-28)."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..types import Float64
from .scene import Scene


def frame_share(n_frames: int, frame: float) -> tuple[int, int, float]:
    """(first, last, share) of a frame between two, counted from 0; the ends hold beyond them."""
    place = min(max(frame, 0.0), n_frames - 1.0)
    first = min(int(place), max(n_frames - 2, 0))
    return first, min(first + 1, n_frames - 1), place - first


def rigid_between(first: Float64, last: Float64, share: float) -> Float64:
    """(..., 4, 4) or (..., 3, 4) rigid matrices between those of two frames: moved straight, turned at even speed."""
    matrices = (1.0 - share) * first + share * last
    before, after = first[..., :3, :3].reshape(-1, 3, 3), last[..., :3, :3].reshape(-1, 3, 3)
    start = Rotation.from_matrix(before)
    turn = (Rotation.from_matrix(after) * start.inv()).as_rotvec()
    matrices[..., :3, :3] = (Rotation.from_rotvec(share * turn) * start).as_matrix().reshape(first[..., :3, :3].shape)
    return np.asarray(matrices)


def matrix_at(matrices: Float64, frame: float) -> Float64:
    """(4, 4) of (F, 4, 4) rigid matrices at a frame."""
    first, last, share = frame_share(len(matrices), frame)
    return rigid_between(matrices[first], matrices[last], share)


def root_transforms(scene: Scene, frame: float, n_roots: int) -> Float64:
    """(S, 3, 4) float64, world: what carries each root from its place at rest (frame 0) to where it is at `frame`."""
    if len(scene.root_motion):
        first, last, share = frame_share(scene.n_frames, frame)
        return rigid_between(scene.root_motion[first], scene.root_motion[last], share)
    moved = matrix_at(scene.motion, frame) @ np.linalg.inv(matrix_at(scene.motion, 0.0))
    return np.broadcast_to(moved[:3], (n_roots, 3, 4))


def move_roots(transforms: Float64, roots: Float64, frames: Float64) -> tuple[Float64, Float64]:
    """The roots (S, 3) and their frames (S, 3, 3) carried by transforms (S, 3, 4)."""
    turns = transforms[:, :, :3]
    moved = np.einsum("sij,sj->si", turns, roots) + transforms[:, :, 3]
    return moved, np.einsum("sij,sjk->sik", turns, frames)
