"""Settings of the four-view wizard's heavy steps: those of the backend's Params that an artist has use for.

What is not here keeps the backend's default; `tests/blender/test_fourview_settings.py` compares the others.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import BoolProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from .params_group import ParamsGroup

# the scene's settings that are no Params of the jobs
_BLENDERS_OWN = ("grooms_folder", "cache_folder")


class RoughShapeSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the rough shape of the hair"""

    resolution: IntProperty(
        name="Resolution", default=100, min=32, soft_max=200, max=400,
        description="Cells along the longest side of the hair in which its shape is found",
    )  # fmt: skip
    blur: FloatProperty(
        name="Smoothing", default=3.0, min=0.0, soft_max=6.0, max=10.0, precision=1,
        description="How far details are smoothed away, in cells; the strands bring their own detail later",
    )  # fmt: skip
    growth_rounds: IntProperty(
        name="Fitting Rounds", default=2, min=0, soft_max=5, max=20,
        description="How often the shape is carved and grown to the masks after it was bent to them",
    )  # fmt: skip


class SurfaceSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the surface that carries the texture"""

    texture_size: IntProperty(
        name="Size", default=2048, min=512, soft_max=4096, max=8192, subtype="PIXEL",
        description="Width and height of the texture: 1024 for a quick look, 2048 for the result; a power of 2",
    )  # fmt: skip
    patch_size: IntProperty(
        name="Patches", default=10, min=3, soft_max=20, max=32, subtype="PIXEL",
        description="Width of the pieces of photos that the texture is put together of",
    )  # fmt: skip


class SurfaceTextureSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the texture around the hair"""

    screening: FloatProperty(
        name="Keep Colors", default=0.1, min=1e-4, soft_max=1.0, max=1000.0, precision=3, step=1,
        description="How much the colours of the photos are kept where photos meet; less lets them flow together more",
    )  # fmt: skip
    seed: IntProperty(name="Seed", default=0, min=0, description="Another number puts the texture together otherwise")


class HairGrowthSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the strands"""

    n_guides: IntProperty(
        name="Guides", default=2500, min=1, soft_max=5000, max=100_000,
        description="Strands that follow the directions themselves; all others are blended of them",
    )  # fmt: skip
    n_strands: IntProperty(
        name="Strands",
        default=30_000,
        min=1,
        soft_max=100_000,
        max=5_000_000,
        description="Strands in all, guides included",
    )
    n_points: IntProperty(
        name="Points per Strand", default=32, min=4, soft_max=128, max=1000, description="Points of each strand"
    )
    clearance: FloatProperty(
        name="Clearance", default=0.001, min=0.0, soft_max=0.005, max=0.02, precision=4, step=0.1, unit="LENGTH",
        description="How far the hair keeps off the head",
    )  # fmt: skip
    mask_margin: FloatProperty(
        name="Mask Margin", default=2.0, min=0.0, soft_max=10.0, max=50.0, precision=1,
        description="How many pixels of a photo hair may lie off its mask",
    )  # fmt: skip
    seed: IntProperty(name="Seed", default=0, min=0, description="Another number grows the hair from other places")


class FourViewSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the four-view wizard"""

    n_tried: IntProperty(
        name="Hairstyles Tried", default=1, min=1, max=20,
        description="So many of the most similar hairstyles of the database are bent to the masks; the best one stays",
    )  # fmt: skip
    grooms_folder: StringProperty(
        name="Own Hairstyles", default="", subtype="DIR_PATH", options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        description="Folder with grooms of your own (.hair, .data, .npz) that join the database of hairstyles",
    )  # fmt: skip
    shape: PointerProperty(type=RoughShapeSettings)
    surface: PointerProperty(type=SurfaceSettings)
    texture: PointerProperty(type=SurfaceTextureSettings)
    strands: PointerProperty(type=HairGrowthSettings)
    with_detail: BoolProperty(
        name="Curls", default=True,
        description="Give the strands small curls and waves that the photos show but the directions smooth away",
    )  # fmt: skip
    cache_folder: StringProperty(
        name="Results", default="//hairloom_cache/", subtype="DIR_PATH",
        options={"OUTPUT_PATH", "PATH_SUPPORTS_BLEND_RELATIVE"},
        description="Folder for the results of the steps. A folder starting with // lies beside the file; in a file "
        "that was never saved it is temporary",
    )  # fmt: skip

    def to_params(self) -> dict[str, Any]:
        params = super().to_params()
        for name in _BLENDERS_OWN:
            del params[name]
        return params

    def of_stage(self, stage: str) -> dict[str, Any]:
        """The settings that change a stage's result."""
        params = self.to_params()
        own = {"grooms_folder": self.grooms_folder} if stage == "shape" else {}
        return own | {name: params[name] for name in OF_STAGE[stage]}


OF_STAGE = {
    "shape": ("n_tried", "shape"),
    "texture": ("surface", "texture"),
    "directions": (),
    "strands": ("strands", "with_detail"),
}
CLASSES = (
    RoughShapeSettings, SurfaceSettings, SurfaceTextureSettings, HairGrowthSettings, FourViewSettings,
)  # fmt: skip
