"""What moves over the frames of a scene: objects as rigid motion, meshes that bend, roots on a surface that bends."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ..backend.errors import require
from ..backend.geometry.head import HeadSurface
from ..backend.rods.scene import CollisionMesh
from ..backend.types import Head
from .attributes import read_values
from .mesh import evaluated_mesh

# A mesh whose points stay where they are but for this share of its size only moves rigidly: what rounding leaves.
_SAME = 1e-5
# Motions that differ by less, in metres and radians, are the same.
_SAME_MOTION = 1e-5


@contextmanager
def frames_kept(scene: bpy.types.Scene) -> Iterator[None]:
    """Whatever frames are visited within, the scene is back at its own one afterwards."""
    frame, subframe = scene.frame_current, scene.frame_subframe
    try:
        yield
    finally:
        scene.frame_set(frame, subframe=subframe)


def rigid_part(matrix: np.ndarray) -> np.ndarray:
    """(4, 4) float64: the nearest rotation, and the place, of an object's matrix (4, 4)."""
    found = np.eye(4)
    left, _, right = np.linalg.svd(matrix[:3, :3])
    left[:, 2] *= np.linalg.det(left @ right)
    found[:3, :3] = left @ right
    found[:3, 3] = matrix[:3, 3]
    return found


def scaled(matrix: np.ndarray, unit: float) -> np.ndarray:
    """A rigid matrix with its place in metres; one of Blender's units is `unit` metres."""
    found = matrix.copy()
    found[:3, 3] *= unit
    return found


class ObjectTrack:
    """The motion of an object; `record` is called at each frame in turn."""

    def __init__(self, obj: bpy.types.Object, unit: float) -> None:
        self._obj, self._unit = obj, unit
        self._matrices: list[np.ndarray] = []

    def record(self, frame: int) -> None:
        self._matrices.append(np.array(self._obj.matrix_world, np.float64))

    def matrices(self) -> np.ndarray:
        """(F, 4, 4) float64, rigid, metres."""
        return np.stack([scaled(rigid_part(matrix), self._unit) for matrix in self._matrices])

    def from_object(self) -> np.ndarray:
        """(F, 4, 4) float64: the object's own space, scale included, to the world in metres."""
        return np.diag([self._unit] * 3 + [1.0]) @ np.stack(self._matrices)


class MeshTrack:
    """A mesh object over the frames, split into rigid motion and, where it bends, a shape for each frame."""

    def __init__(self, obj: bpy.types.Object, unit: float) -> None:
        self._obj, self._unit = obj, unit
        self._triangles, self._n_points = np.empty((0, 3), np.int32), 0
        self._matrices: list[np.ndarray] = []
        self._shapes: list[np.ndarray] = []

    def record(self, frame: int) -> None:
        """Raises InputError for a mesh without faces, or one whose faces are others than at the first frame."""
        matrix = np.array(self._obj.matrix_world, np.float64)
        with evaluated_mesh(self._obj) as mesh:
            mesh.calc_loop_triangles()
            found = mesh.loop_triangles
            require(len(found), f"'{self._obj.name}' has no faces at frame {frame}; hair cannot collide with it")
            triangles = read_values(found, "vertices", np.int32, 3)
            points = read_values(mesh.vertices, "co", np.float32, 3)
        if np.linalg.det(matrix[:3, :3]) < 0:
            # a mirrored object turns its faces inside out
            triangles = np.ascontiguousarray(triangles[:, ::-1])
        rigid = rigid_part(matrix)
        shape = points @ (rigid[:3, :3].T @ matrix[:3, :3]).T * self._unit
        require(np.isfinite(shape).all(), f"'{self._obj.name}' has NaN or infinite points at frame {frame}; repair it")
        if not self._shapes:
            self._triangles, self._n_points = triangles, len(points)
        # the diagonals of bent quads may swap, which is no change of topology
        require(
            (len(points), len(triangles)) == (self._n_points, len(self._triangles)),
            f"'{self._obj.name}' has other points or faces at frame {frame} than at the first; colliders must keep "
            "their topology: apply or switch off the modifier that changes it",
        )
        self._matrices.append(scaled(rigid, self._unit))
        is_same = bool(self._shapes) and self._is_first(shape)
        self._shapes.append(self._shapes[0] if is_same else shape.astype(np.float32))

    @property
    def first_shape(self) -> np.ndarray:
        """(V, 3) float32, metres, in the axes of the object at the first frame."""
        return self._shapes[0]

    def _is_first(self, shape: np.ndarray) -> bool:
        size = float(np.ptp(self.first_shape, axis=0).max())
        return bool(np.abs(shape - self.first_shape).max() <= _SAME * size)

    @property
    def is_deforming(self) -> bool:
        """Does the mesh more than move?"""
        return any(shape is not self._shapes[0] for shape in self._shapes)

    def matrices(self) -> np.ndarray:
        """(F, 4, 4) float64, rigid, metres."""
        return np.stack(self._matrices)

    def collision_mesh(self, friction: float) -> CollisionMesh:
        shapes = np.stack(self._shapes) if self.is_deforming else self.first_shape
        return CollisionMesh(self._triangles, shapes, self.matrices(), friction)

    def head(self) -> Head:
        """The mesh at the first frame, world space, metres; no scalp."""
        first = self._matrices[0]
        world = self.first_shape @ first[:3, :3].T + first[:3, 3]
        count = len(self._triangles)
        return Head(
            world.astype(np.float32), self._triangles, np.zeros(count, np.bool_), np.zeros((count, 3, 2), np.float32)
        )

    def root_motion(self, roots: np.ndarray) -> np.ndarray:
        """(F, S, 3, 4) float64, world: what carries roots (S, 3) of the first frame along with the surface below them.

        A root stays at its place on its triangle and turns as the triangle does (the rotation nearest to the
        triangle's deformation), so hair keeps its angle to the skin.
        """
        _, triangle, weights = HeadSurface(self.head()).closest_points(roots.astype(np.float32))
        used, of_root = np.unique(triangle, return_inverse=True)
        corners = self._triangles[used]
        at_rest = self._world(0)[corners]
        inverse = np.linalg.inv(_spans(at_rest))
        place_at_rest = np.einsum("sk,ska->sa", weights, at_rest[of_root])
        motion = np.empty((len(self._matrices), len(roots), 3, 4))
        # one over frames; all roots at once
        for frame in range(len(self._matrices)):
            now = self._world(frame)[corners]
            turns = _rotations(_spans(now) @ inverse)[of_root]
            place = np.einsum("sk,ska->sa", weights, now[of_root])
            motion[frame, :, :, :3] = turns
            motion[frame, :, :, 3] = place - np.einsum("sij,sj->si", turns, place_at_rest)
        return motion

    def _world(self, frame: int) -> np.ndarray:
        matrix = self._matrices[frame]
        return self._shapes[frame].astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def common_motion(root_motion: np.ndarray, roots: np.ndarray) -> np.ndarray | None:
    """(F, 4, 4) the one rigid motion of all roots (S, 3), as on a scalp that hangs on one bone; else None."""
    first = root_motion[:, 0]
    carried = np.einsum("fij,sj->fsi", first[:, :, :3], roots) + first[:, None, :, 3]
    own = np.einsum("fsij,sj->fsi", root_motion[..., :3], roots) + root_motion[..., 3]
    turned = np.abs(root_motion[..., :3] - first[:, None, :, :3]).max()
    if max(np.abs(own - carried).max(), turned) > _SAME_MOTION:
        return None
    motion = np.tile(np.eye(4), (len(first), 1, 1))
    motion[:, :3] = first
    return motion


def _spans(corners: np.ndarray) -> np.ndarray:
    """(T, 3, 3): columns two edges and the unit normal, times the root of the area, of triangles (T, 3, 3)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(first, second)
    twice_area = np.linalg.norm(normal, axis=1)[:, None]
    normal /= np.sqrt(np.maximum(twice_area, 1e-30))
    return np.stack([first, second, normal], axis=2)


def _rotations(gradients: np.ndarray) -> np.ndarray:
    """(T, 3, 3) the rotation nearest to each deformation gradient (T, 3, 3)."""
    left, _, right = np.linalg.svd(gradients)
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    return left @ right
