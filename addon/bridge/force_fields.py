"""Blender's force fields as moving air: strength in metres a second, over the frames of a scene."""

from __future__ import annotations

import bpy
import numpy as np

from .. import air
from ..backend.rods.scene import ForceField
from .motion import rigid_part, scaled

_USUAL_SIZE = 1.0  # of turbulence whose size is 0, in Blender's units, as Blender has it


class FieldTrack:
    """A force field over the frames; `record` is called at each frame in turn."""

    def __init__(self, obj: bpy.types.Object, kind: str, unit: float, speed: float) -> None:
        """`speed`: m/s of the air for a strength of 1."""
        self._obj, self._kind, self._unit, self._speed = obj, kind, unit, speed
        self._matrices: list[np.ndarray] = []
        self._strength: list[float] = []
        self._noise: list[float] = []

    def record(self, frame: int) -> None:
        shown = self._obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
        self._matrices.append(scaled(rigid_part(np.array(shown.matrix_world, np.float64)), self._unit))
        strength, noise = float(shown.field.strength), float(shown.field.noise)
        self._strength.append(strength * self._speed)
        # Blender adds noise to the strength; the simulation has it as a share
        self._noise.append(noise / abs(strength) if strength else 0.0)

    def force_field(self) -> ForceField:
        settings = self._obj.field
        size = settings.size if self._kind == "turbulence" and settings.size > 0 else _USUAL_SIZE
        return ForceField(
            kind=self._kind,
            matrices=np.stack(self._matrices),
            strength=np.array(self._strength),
            noise=np.array(self._noise),
            falloff_power=float(settings.falloff_power),
            distance_min=self._unit * float(settings.distance_min) if settings.use_min_distance else 0.0,
            distance_max=self._unit * float(settings.distance_max) if settings.use_max_distance else 0.0,
            size=self._unit * float(size),
            seed=int(settings.seed),
        )


def tracks(context: bpy.types.Context, unit: float, speed: float) -> tuple[list[FieldTrack], list[str]]:
    """The fields that act, not yet recorded, and remarks on those that act otherwise than in Blender or not at all."""
    found = air.fields(context)
    objects = context.view_layer.objects
    acting = [FieldTrack(objects[field.name], field.kind, unit, speed) for field in found if field.kind]
    return acting, [field.remark for field in found if field.remark]
