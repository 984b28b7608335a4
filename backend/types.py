"""The data that travels between the parts of Hairloom: frozen dataclasses of checked arrays.

World space is Blender's: metres, z up. Head space is the paper's (Wang et al. 2009, sec. 3): origin at the centre of
the head's hemisphere, y up, the head radius as unit; `geometry.scalp_space.ScalpSpace` converts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InputError, require

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Floats = NDArray[np.floating[Any]]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
Bools = NDArray[np.bool_]
AttributeArrays = Mapping[str, NDArray[Any]]


def check_array(name: str, array: object, dtype: type, shape: tuple[int | None, ...]) -> None:
    """Refuse what is no array of this type and shape (None: any), or not finite; cheap, since time steps call it."""
    if not isinstance(array, np.ndarray):
        raise InputError(f"{name} must be a numpy array, not {type(array).__name__}")
    if array.dtype != dtype:
        raise InputError(f"{name} must be {np.dtype(dtype)}, not {array.dtype}")
    fits = array.ndim == len(shape) and all(want is None or have == want for have, want in zip(array.shape, shape))
    if not fits:
        raise InputError(f"{name} must have shape {shape} (None: any), not {array.shape}")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise InputError(f"{name} has NaN or infinite values; clean the data up first")


@dataclass(frozen=True, slots=True)
class StrandSet:
    """S strands with P points in all, each strand's points stored root first.

    points : (P, 3) float32, metres, world space.
    offsets : (S + 1,) int32; strand s owns points[offsets[s]:offsets[s + 1]], at least one point.
    point_attributes, strand_attributes : arrays whose first axis is P, respectively S.
    """

    points: Float32
    offsets: Int32
    point_attributes: AttributeArrays = field(default_factory=dict)
    strand_attributes: AttributeArrays = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_array("points", self.points, np.float32, (None, 3))
        check_array("offsets", self.offsets, np.int32, (None,))
        require(len(self.offsets) >= 1 and self.offsets[0] == 0, "offsets must start with 0")
        require(self.offsets[-1] == len(self.points), "the last offset must be the number of points")
        require((np.diff(self.offsets) > 0).all(), "every strand must have a point")
        for name, array in self.point_attributes.items():
            require(len(array) == len(self.points), f"point attribute '{name}' must have one value a point")
        for name, array in self.strand_attributes.items():
            require(len(array) == self.n_strands, f"strand attribute '{name}' must have one value a strand")

    @property
    def n_strands(self) -> int:
        return len(self.offsets) - 1

    @property
    def roots(self) -> Float32:
        """(S, 3) float32, metres, world space."""
        return np.asarray(self.points[self.offsets[:-1]])

    @property
    def point_counts(self) -> Int32:
        """(S,) int32."""
        return np.diff(self.offsets)


@dataclass(frozen=True, slots=True)
class Head:
    """A triangle mesh with its scalp.

    vertices : (V, 3) float32, metres, world space.
    triangles : (F, 3) int32, counter-clockwise seen from outside.
    scalp : (F,) bool, the triangles where hair grows.
    corner_uv : (F, 3, 2) float32, texture coordinates of each triangle corner.
    """

    vertices: Float32
    triangles: Int32
    scalp: Bools
    corner_uv: Float32

    def __post_init__(self) -> None:
        check_array("vertices", self.vertices, np.float32, (None, 3))
        check_array("triangles", self.triangles, np.int32, (None, 3))
        check_array("scalp", self.scalp, np.bool_, (len(self.triangles),))
        check_array("corner_uv", self.corner_uv, np.float32, (len(self.triangles), 3, 2))
        require(len(self.triangles) > 0, "the head has no faces; choose a mesh with faces")
        inside = (self.triangles >= 0) & (self.triangles < len(self.vertices))
        require(inside.all(), "a triangle of the head names a vertex that does not exist")


@dataclass(frozen=True, slots=True)
class RootedStrands:
    """S strands of N points each, in the frames of their roots (Wang et al. 2009, sec. 3 and 4.1).

    roots : (S, 3) float32, head space.
    frames : (S, 3, 3) float32, columns tangent, normal, binormal (R x, R y, R z) in head space.
    uv : (S, 2) float32, scalp coordinates of the roots, radians.
    points : (S, N, 3) float32, head radii: frames^T (position - root), so points[:, 0] is 0.
    """

    roots: Float32
    frames: Float32
    uv: Float32
    points: Float32

    def __post_init__(self) -> None:
        count = len(self.roots)
        check_array("roots", self.roots, np.float32, (None, 3))
        check_array("frames", self.frames, np.float32, (count, 3, 3))
        check_array("uv", self.uv, np.float32, (count, 2))
        check_array("points", self.points, np.float32, (count, None, 3))

    @property
    def n_strands(self) -> int:
        return len(self.roots)

    @property
    def n_points(self) -> int:
        """Points of a strand."""
        return int(self.points.shape[1])

    def in_head_space(self) -> Float32:
        """(S, N, 3) float32: the strands in head space, head radii."""
        turned = np.matmul(self.points, self.frames.transpose(0, 2, 1))
        return np.asarray(turned + self.roots[:, None, :], dtype=np.float32)

    def with_points(self, points: Float32) -> RootedStrands:
        """The same roots with other strands, (S, N, 3) float32 in the root frames."""
        return RootedStrands(self.roots, self.frames, self.uv, points)


@dataclass(frozen=True, slots=True)
class WispHierarchy:
    """Levels of a hairstyle (Wang et al. 2009, sec. 4): level 0 is the hair, level l + 1 the centers of its wisps.

    levels : L sets of strands, finest first.
    labels : L - 1 arrays; labels[l] (S_l,) int32 is the wisp of each strand of level l, a strand index of level l + 1.
    """

    levels: tuple[RootedStrands, ...]
    labels: tuple[Int32, ...]

    def __post_init__(self) -> None:
        require(len(self.levels) >= 1, "a wisp hierarchy needs a level")
        require(len(self.labels) == len(self.levels) - 1, "a wisp hierarchy needs labels for all levels but the last")
        for fine, coarse, labels in zip(self.levels, self.levels[1:], self.labels):
            check_array("labels", labels, np.int32, (fine.n_strands,))
            require(labels.min() >= 0 and labels.max() < coarse.n_strands, "a label names a wisp that does not exist")

    @property
    def n_levels(self) -> int:
        return len(self.levels)


@dataclass(frozen=True, slots=True)
class FeatureMap:
    """A grid of feature vectors over the scalp coordinates (Wang et al. 2009, sec. 5.1).

    values : (H, W, C) float32; row i, column j lies at v = origin[1] + i * spacing, u = origin[0] + j * spacing.
    mask : (H, W) bool, where values are meant.
    origin : (2,) float64, radians (u, v). spacing : radians.
    """

    values: Float32
    mask: Bools
    origin: Float64
    spacing: float

    def __post_init__(self) -> None:
        check_array("values", self.values, np.float32, (None, None, None))
        check_array("mask", self.mask, np.bool_, self.values.shape[:2])
        check_array("origin", self.origin, np.float64, (2,))
        require(self.spacing > 0, f"the map spacing is {self.spacing}; it must be above 0")


@dataclass(frozen=True, slots=True)
class Mesh:
    """A triangle mesh without a scalp.

    vertices : (V, 3) float32, metres, world space. triangles : (F, 3) int32, counter-clockwise seen from outside.
    """

    vertices: Float32
    triangles: Int32

    def __post_init__(self) -> None:
        check_array("vertices", self.vertices, np.float32, (None, 3))
        check_array("triangles", self.triangles, np.int32, (None, 3))
        inside = (self.triangles >= 0) & (self.triangles < len(self.vertices))
        require(inside.all(), "a triangle of the mesh names a vertex that does not exist")


@dataclass(frozen=True, slots=True)
class Camera:
    """A perspective or orthographic camera with OpenCV's axes: x right, y down, z forward (away from the camera).

    intrinsics : (3, 3) float64, K. Perspective: pixel = K (x / z, y / z, 1). Orthographic: pixel = K (x, y, 1), so that
        K[0, 0] is in pixels a metre. Pixel (row r, column c) of the image covers x in [c, c + 1), y in [r, r + 1).
    world_to_camera : (4, 4) float64, rigid.
    size : (width, height), pixels.
    """

    intrinsics: Float64
    world_to_camera: Float64
    size: tuple[int, int]
    orthographic: bool = True

    def __post_init__(self) -> None:
        check_array("intrinsics", self.intrinsics, np.float64, (3, 3))
        check_array("world_to_camera", self.world_to_camera, np.float64, (4, 4))
        turn = self.world_to_camera[:3, :3]
        rigid = np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) and np.linalg.det(turn) > 0
        require(rigid, "world_to_camera must be a rotation and a move, without scale or mirror")
        require(min(self.size) >= 1, f"a camera of {self.size} pixels has no picture; take 1 or more")
        require(
            self.intrinsics[0, 0] > 0 and self.intrinsics[1, 1] > 0,
            f"the camera's scale is {self.intrinsics[0, 0]:g} x {self.intrinsics[1, 1]:g}; it must be above 0",
        )


@dataclass(frozen=True, slots=True)
class OrientationMap:
    """Unsigned orientation of hair at each pixel.

    angle : (H, W) float32, radians in [0, pi), from +x (right) towards +y (down).
    confidence : (H, W) float32 in [0, 1], higher is better.
    """

    angle: Float32
    confidence: Float32

    def __post_init__(self) -> None:
        check_array("angle", self.angle, np.float32, (None, None))
        check_array("confidence", self.confidence, np.float32, self.angle.shape)
