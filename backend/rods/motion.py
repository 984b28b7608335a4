"""Where roots and colliders are at a time between frames: rigid motion, turned at even speed (B-28)."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..types import Float64
from .scene import Scene


class Track:
    """Rigid matrices over frames, (F, ..., 4, 4) or (F, ..., 3, 4); between frames moved straight, turned evenly."""

    def __init__(self, matrices: Float64) -> None:
        self.matrices = matrices
        turns = matrices[..., :3, :3]
        rotations = Rotation.from_matrix(turns.reshape(-1, 3, 3))
        n_moving = len(rotations) // len(matrices)
        # orthonormal even where the matrices are a little off
        self._starts = rotations.as_matrix().reshape(turns.shape)
        changes = rotations[n_moving:] * rotations[:-n_moving].inv() if len(matrices) > 1 else rotations[:0]
        self._changes = changes.as_rotvec().reshape(len(matrices) - 1, *turns.shape[1:-1])

    def at(self, frame: float) -> Float64:
        """(..., 4, 4) or (..., 3, 4) at a frame counted from 0; the ends hold beyond them."""
        place = min(max(frame, 0.0), len(self.matrices) - 1.0)
        first = min(int(place), max(len(self.matrices) - 2, 0))
        share = place - first
        if share == 0.0:
            return np.asarray(self.matrices[first])
        moved = (1.0 - share) * self.matrices[first] + share * self.matrices[first + 1]
        change = Rotation.from_rotvec(share * self._changes[first].reshape(-1, 3)).as_matrix()
        start = self._starts[first]
        moved[..., :3, :3] = np.matmul(change.reshape(start.shape), start)
        return np.asarray(moved)


class RootMotion:
    """What the scene does to S roots: the surface's own motion of each, or one rigid motion of all."""

    def __init__(self, scene: Scene) -> None:
        self._bends = len(scene.root_motion) > 0
        self._track = Track(scene.root_motion if self._bends else scene.motion)
        self._home = np.eye(4) if self._bends else np.linalg.inv(scene.motion[0])

    def at(self, frame: float) -> Float64:
        """(S, 3, 4), or (1, 3, 4) for all: from where roots were at frame 0 to where they are, world space."""
        now = self._track.at(frame)
        return now if self._bends else (now @ self._home)[None, :3]

    def move(self, frame: float, roots: Float64, frames: Float64) -> tuple[Float64, Float64]:
        """Roots (S, 3) and their frames (S, 3, 3), given at frame 0, at `frame`."""
        carried = self.at(frame)
        turns = carried[:, :, :3]
        return np.matmul(turns, roots[:, :, None])[:, :, 0] + carried[:, :, 3], np.matmul(turns, frames)
