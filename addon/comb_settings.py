"""Settings of the comb: those of the backend's CombParams, and what only Blender knows."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty, IntProperty, PointerProperty

from .params_group import ParamsGroup, plain_value

# mirroring is not among them: Blender keeps it with the Curves, for its own brushes
_BLENDERS_OWN = ("collide", "colliders", "record")


class CombSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the comb's brush"""

    mode: EnumProperty(
        name="Mode", default="comb", description="What the brush does to the hair",
        items=(
            ("comb", "Comb", "Grip the hair and draw it along; the comb slides along the strands"),
            ("lift", "Lift", "Lift the hair off the head, or press it down"),
            ("twist", "Twist", "Turn the hair about the wisp's own line, to curl it up or to uncurl it"),
            ("smooth", "Smooth", "Smooth the flow of the wisps; the curls within them stay"),
            ("length", "Length", "Let the hair grow, or trim it"),
        ),
    )  # fmt: skip
    radius: FloatProperty(
        name="Radius", default=50.0, min=0.5, soft_min=5.0, soft_max=300.0, max=100_000.0, precision=0, step=100,
        subtype="PIXEL", description="Radius of the brush in pixels of the view; F in the view changes it",
    )  # fmt: skip
    strength: FloatProperty(
        name="Strength", default=1.0, min=0.0, max=1.0, precision=2, subtype="FACTOR",
        description="Strength of the brush; at 1 the hair stays in the comb. Shift F in the view changes it",
    )  # fmt: skip
    hardness: FloatProperty(
        name="Hardness", default=0.7, min=0.0, max=1.0, precision=2, subtype="FACTOR",
        description="Share of the radius, the inner circle, in which the brush has its full strength",
    )  # fmt: skip
    profile: FloatVectorProperty(
        name="Profile", default=(1.0, 1.0, 1.0), size=3, min=0.0, max=1.0, precision=2,
        description="Strength of the brush at the root, in the middle and at the tip of a strand",
    )  # fmt: skip
    through: BoolProperty(
        name="Through", default=False,
        description="Act on all hair under the brush; otherwise on its front only, as deep as the brush is wide",
    )  # fmt: skip
    level: IntProperty(
        name="Level", default=-1, min=-1, max=3,
        description="What the brush moves: 0 single strands, 1 the smallest wisps, 2 the next larger ones, "
        "-1 always the largest",
    )  # fmt: skip
    drag: FloatProperty(
        name="Drag", default=0.3, min=0.0, max=1.0, precision=2, subtype="FACTOR",
        description="How much neighbouring wisps turn along with those in the brush",
    )  # fmt: skip
    slip: FloatProperty(
        name="Slip", default=1.0, min=0.0, max=1.0, precision=2, subtype="FACTOR",
        description="How freely the comb slides along the hair; at 0 it pulls at the same place all the time",
    )  # fmt: skip
    only_first: BoolProperty(
        name="Only First", default=False,
        description="Keep to the wisps that the first touch of a stroke found; others are left alone",
    )  # fmt: skip
    invert: BoolProperty(
        name="Invert", default=False,
        description="The other way round: press down, turn the other way, trim. Ctrl while dragging does the same",
    )  # fmt: skip
    pressure_radius: BoolProperty(
        name="Radius by Pressure", default=False, description="The pen's pressure scales the radius of the brush"
    )
    pressure_strength: BoolProperty(
        name="Strength by Pressure", default=True, description="The pen's pressure scales the strength of the brush"
    )
    collide: BoolProperty(
        name="Collide", default=True, description="Keep the hair that is combed out of the head and the colliders"
    )
    colliders: PointerProperty(
        name="Colliders", type=bpy.types.Collection,
        description="Meshes besides the head that the hair is kept out of, such as shoulders, ears or a hat",
    )  # fmt: skip
    record: BoolProperty(
        name="Record", default=False,
        description="Keep every stroke with the groom, so that the strokes can be saved to a file and played again",
    )  # fmt: skip

    def to_params(self) -> dict[str, Any]:
        """The settings as `strokes.comb_params` takes them, without `mirror`."""
        params = super().to_params()
        params["profile"] = [plain_value(value) for value in self.profile]
        return params

    @classmethod
    def setting_names(cls) -> tuple[str, ...]:
        return tuple(name for name in super().setting_names() if name not in _BLENDERS_OWN)
