"""What happens to the hair: head motion, colliders, wind, gravity, in frames of an animation (B-28)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors import require
from ..types import Float32, Float64, Int32


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


@dataclass(frozen=True, slots=True)
class ForceField:
    """One of Blender's force fields: kind 'wind', 'force', 'vortex', 'turbulence' or 'drag'.

    matrices : (F, 4, 4) float64, to world. strength, flow, noise : (F,) float64, as in Blender's panel.
    falloff_power, distance_min, distance_max : Blender's falloff; distance_max 0 has no end. size : of turbulence, m.
    seed : of the noise.
    """

    kind: str
    matrices: Float64
    strength: Float64
    flow: Float64
    noise: Float64
    falloff_power: float = 0.0
    distance_min: float = 0.0
    distance_max: float = 0.0
    size: float = 0.1
    seed: int = 0


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
        require(self.motion.ndim == 3 and self.motion.shape[1:] == (4, 4), "motion must have shape (F, 4, 4)")
        require(len(self.motion) >= 1, "the scene has no frames")

    @property
    def n_frames(self) -> int:
        return len(self.motion)
