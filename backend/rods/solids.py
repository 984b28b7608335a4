"""The scene's colliders as signed distances that move (B-26, B-28)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..geometry.collider import Collider, build_collider
from ..types import Float32, Float64, Head
from .contacts import Solid
from .motion import Track
from .scene import CollisionMesh, Scene

# Cells along the roots' extent. A mesh that bends gets a new grid every frame, so a coarser one.
_CELLS, _CELLS_DEFORMING = 80, 40


class Solids:
    """The solids of a scene; those that bend have a new grid each frame, the others one for all.

    The grids cover where hair may come: as far from the roots (S, 3) as the longest strand `reach`, metres, is.
    """

    def __init__(self, scene: Scene, roots: Float64, reach: float) -> None:
        self._scene = scene
        self._extent = max(float(np.ptp(roots, axis=0).max()), 0.2 * reach)
        # where hair may come, relative to what the roots sit on
        self._low, self._high = roots.min(axis=0) - reach, roots.max(axis=0) + reach
        self._home = np.linalg.inv(scene.motion[0])
        self._tracks = [Track(mesh.matrices) for mesh in scene.colliders]
        self._rigid = {
            number: self._collider(mesh, mesh.vertices, 0)
            for number, mesh in enumerate(scene.colliders)
            if not mesh.is_deforming
        }
        self._bent: dict[int, tuple[int, Collider]] = {}

    def at(self, frame: float, previous: float) -> Sequence[Solid]:
        """The solids at a frame, and where they were at the one before; frames count from 0."""
        return [
            Solid(
                self._rigid[number] if number in self._rigid else self._bent_collider(number, frame),
                self._tracks[number].at(frame),
                self._tracks[number].at(previous),
                mesh.friction,
            )
            for number, mesh in enumerate(self._scene.colliders)
        ]

    def _bent_collider(self, number: int, frame: float) -> Collider:
        mesh = self._scene.colliders[number]
        nearest = min(max(round(frame), 0), len(mesh.vertices) - 1)
        kept = self._bent.get(number)
        if kept is None or kept[0] != nearest:
            kept = (nearest, self._collider(mesh, mesh.vertices[nearest], nearest))
            self._bent[number] = kept
        return kept[1]

    def _collider(self, mesh: CollisionMesh, vertices: Float32, frame: int) -> Collider:
        """A grid over where hair may come to the mesh, in the mesh's own space."""
        n_triangles = len(mesh.triangles)
        solid = Head(
            np.ascontiguousarray(vertices, np.float32),
            mesh.triangles,
            np.zeros(n_triangles, np.bool_),
            np.zeros((n_triangles, 3, 2), np.float32),
        )
        # the box around the hair, carried by what the roots sit on, in the mesh's space; a mesh that moves by itself
        # may meet the hair anywhere, so its grid covers all of it
        if self._moves_with_roots(mesh):
            corners = np.array(np.meshgrid(*zip(self._low, self._high))).reshape(3, -1).T
            into = np.linalg.inv(mesh.matrices[frame]) @ self._scene.motion[frame] @ self._home
            around = corners @ into[:3, :3].T + into[:3, 3]
        else:
            around = None
        cells = _CELLS_DEFORMING if mesh.is_deforming else _CELLS
        return build_collider([solid], around=around, scalp_size=self._extent * _CELLS / cells)

    def _moves_with_roots(self, mesh: CollisionMesh) -> bool:
        relative = np.linalg.inv(self._scene.motion) @ mesh.matrices
        return bool(np.allclose(relative, relative[0], atol=1e-6))
