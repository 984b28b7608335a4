"""Settings of the detail transfer, and what a groom made by it remembers."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import (
    BoolVectorProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from .params_group import ParamsGroup


class TransferSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the search for the strands that lend their details"""

    n_features: IntProperty(
        name="Features", default=16, min=1, soft_max=64, max=256,
        description="Numbers that describe the shape of a wisp when the most similar one is searched",
    )  # fmt: skip
    n_donors: IntProperty(
        name="Donors", default=1, min=1, max=16,
        description="Example strands blended into the details of a new strand; 1 keeps details crispest",
    )  # fmt: skip


class DetailSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the transfer of details from one groom to another"""

    levels: BoolVectorProperty(
        name="Levels", default=(True, True, True), size=3,
        description="Levels that take the other groom's details: the hair within its wisps, those within the next "
        "coarser ones, and so on. A level that is off keeps its own",
    )  # fmt: skip
    strength: FloatProperty(
        name="Strength", default=1.0, min=0.0, max=2.0, precision=2, step=5,
        description="0 leaves the hair as it is, 1 replaces its details by the other groom's, more exaggerates them",
    )  # fmt: skip
    smoothing: FloatProperty(
        name="Take Waves", default=0.5, min=0.0, max=1.0, precision=2, subtype="FACTOR",
        description="How far the other groom's coarsest strands are smoothed first, so that their waves count as "
        "details and come across as well",
    )  # fmt: skip
    length_mode: EnumProperty(
        name="Lengths", default="tile", description="What is done where the hair is longer or shorter",
        items=(
            ("tile", "Keep Curl Size", "Waves and curls keep their size and go on for as long as the hair does"),
            ("scale", "Scale", "Details grow and shrink with the length of the hair"),
            ("plain", "Stretch", "Details are stretched along the hair, as in the paper: curls lengthen with it"),
        ),
    )  # fmt: skip
    matching: EnumProperty(
        name="Wisps", default="even", description="Which wisp of the other groom lends its details",
        items=(
            ("even", "All", "Every wisp of the other groom about equally often, to wisps of similar shape"),
            ("similar", "Most Similar", "The wisp of most similar shape, searched on each level anew, as in the paper"),
        ),
    )  # fmt: skip
    max_subdivision: IntProperty(
        name="Finer Strands", default=4, min=1, max=8,
        description="Strands get up to this many times their points where curls need them on longer hair; 1 never",
    )  # fmt: skip
    transfer: PointerProperty(type=TransferSettings)
    seed: IntProperty(
        name="Seed", default=0, min=0,
        description="0 matches wisps by their shapes; each other number makes its own choice among similar ones",
    )  # fmt: skip

    def to_params(self) -> dict[str, Any]:
        params = super().to_params()
        params["levels"] = [level for level, is_taken in enumerate(self.levels) if is_taken]
        return params


def _is_groom(self: Any, obj: bpy.types.Object) -> bool:
    return obj.type == "CURVES"


def _is_mesh(self: Any, obj: bpy.types.Object) -> bool:
    return obj.type == "MESH"


class DetailTransferSettings(bpy.types.PropertyGroup):
    """What the next transfer takes, and its settings"""

    source: PointerProperty(
        name="Details From", type=bpy.types.Object, poll=_is_groom,
        description="Groom whose curls and wisps the active groom takes over; a saved detail from the asset browser "
        "does as well",
    )  # fmt: skip
    source_head: PointerProperty(
        name="Its Head", type=bpy.types.Object, poll=_is_mesh,
        description="Head that the groom with the details grows on; when empty, the mesh that it is attached to",
    )  # fmt: skip
    settings: PointerProperty(type=DetailSettings)


class TransferMemory(bpy.types.PropertyGroup):
    """Where the details of a groom came from, so that they can be made again with other settings"""

    source: PointerProperty(type=bpy.types.Object)
    source_head: PointerProperty(type=bpy.types.Object)
    source_name: StringProperty()
    saved_detail: StringProperty()
    base: PointerProperty(type=bpy.types.Object)
    base_head: PointerProperty(type=bpy.types.Object)
    base_name: StringProperty()

    @property
    def is_set(self) -> bool:
        """Was the groom made by a transfer?"""
        return bool(self.base_name)


# the other classes are registered with the rest of the scene's settings, by props


def register() -> None:
    bpy.utils.register_class(TransferMemory)
    bpy.types.Object.hairloom_transfer = PointerProperty(type=TransferMemory)


def unregister() -> None:
    del bpy.types.Object.hairloom_transfer
    bpy.utils.unregister_class(TransferMemory)
