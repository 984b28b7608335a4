"""What happens to the hair: head motion, colliders, wind, gravity, in frames of an animation (B-28)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors import require
from ..types import Float32, Float64, Int32, check_array

KINDS = ("wind", "force", "vortex", "turbulence")


@dataclass(frozen=True, slots=True)
class CollisionMesh:
    """A solid mesh, animated.

    triangles : (T, 3) int32. vertices : (V, 3) float32 in its own space where it only moves rigidly, else (F, V, 3)
    float32, one shape a frame. matrices : (F, 4, 4) float64, own space to world, metres; rigid.
    friction : Coulomb's coefficient; the greater of the hair's and this counts.
    """

    triangles: Int32
    vertices: Float32
    matrices: Float64
    friction: float = 0.3

    def __post_init__(self) -> None:
        check_array("triangles", self.triangles, np.int32, (None, 3))
        check_array("matrices", self.matrices, np.float64, (None, 4, 4))
        shape = (len(self.matrices), None, 3) if self.is_deforming else (None, 3)
        check_array("vertices", self.vertices, np.float32, shape)
        inside = (self.triangles >= 0) & (self.triangles < self.vertices.shape[-2])
        require(bool(inside.all()), "a triangle of a collider names a vertex that does not exist")
        require(self.friction >= 0, f"a collider's friction is {self.friction:g}; it must be 0 or more")

    @property
    def is_deforming(self) -> bool:
        return self.vertices.ndim == 3


@dataclass(frozen=True, slots=True)
class ForceField:
    """One of Blender's force fields, read as moving air: `kind` is one of KINDS.

    matrices : (F, 4, 4) float64, to world; wind blows along the local z axis, a vortex turns about it.
    strength : (F,) float64, m/s of the air. noise : (F,) float64, gusts as a share of the strength.
    falloff_power, distance_min, distance_max : as in Blender's panel, m; distance_max 0 has no end.
    size : m, of the eddies of turbulence. seed : of the noise.
    """

    kind: str
    matrices: Float64
    strength: Float64
    noise: Float64
    falloff_power: float = 0.0
    distance_min: float = 0.0
    distance_max: float = 0.0
    size: float = 0.1
    seed: int = 0

    def __post_init__(self) -> None:
        require(self.kind in KINDS, f"a force field of kind '{self.kind}' is not known; use {', '.join(KINDS)}")
        check_array("matrices", self.matrices, np.float64, (None, 4, 4))
        check_array("strength", self.strength, np.float64, (len(self.matrices),))
        check_array("noise", self.noise, np.float64, (len(self.matrices),))
        require(self.size > 0, f"the size of a turbulence is {self.size:g} m; it must be above 0")
        require(0 <= self.distance_min < np.inf, f"distance_min is {self.distance_min:g} m; it must be 0 or more")


@dataclass(frozen=True, slots=True)
class Scene:
    """F frames, the first of which is the groom at rest.

    fps : frames a second. frame_start : number of the first.
    motion : (F, 4, 4) float64 world matrices of what the roots sit on; strands are given in the world at motion[0].
    root_motion : (F, S, 3, 4) float64, world, from a root's place at frame 0 to where it is at frame f, where the
        head's surface bends and `motion` is not enough; (0, 0, 3, 4) for none.
    gravity : (3,) float64, m/s^2.
    """

    fps: float
    motion: Float64
    frame_start: int = 1
    root_motion: Float64 = field(default_factory=lambda: np.zeros((0, 0, 3, 4)))
    colliders: tuple[CollisionMesh, ...] = ()
    fields: tuple[ForceField, ...] = ()
    gravity: Float64 = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))

    def __post_init__(self) -> None:
        require(np.isfinite(self.fps) and self.fps > 0, f"fps is {self.fps:g}; it must be above 0")
        check_array("motion", self.motion, np.float64, (None, 4, 4))
        check_array("gravity", self.gravity, np.float64, (3,))
        require(len(self.motion) >= 1, "the scene has no frames")
        check_array("root_motion", self.root_motion, np.float64, (None, None, 3, 4))
        require(
            len(self.root_motion) in (0, self.n_frames), "root_motion must have a transform for each frame, or none"
        )
        for name, moving in (("collider", self.colliders), ("force field", self.fields)):
            require(
                all(len(one.matrices) == self.n_frames for one in moving),
                f"a {name} has another number of frames than the scene's {self.n_frames}",
            )

    @property
    def n_frames(self) -> int:
        return len(self.motion)
