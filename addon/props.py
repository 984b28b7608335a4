"""Settings of the scene: a PropertyGroup for each Params class of the backend, and what only Blender knows.

The defaults repeat those of the Params classes, which must not be imported when the add-on is enabled;
`tests/blender/test_props.py` compares them.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    IntVectorProperty,
    PointerProperty,
    StringProperty,
)

from .comb_settings import CombSettings
from .detail_settings import DetailSettings, DetailTransferSettings, TransferSettings
from .fourview_params import CLASSES as FOUR_VIEW_CLASSES
from .fourview_params import FourViewSettings
from .params_group import ParamsGroup
from .simulation_settings import CLASSES as SIMULATION_CLASSES
from .simulation_settings import SimulationSettings


class WispSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the finest level's wisps"""

    n_wisps: IntProperty(
        name="Wisps", default=200, min=1, soft_max=2000, max=1_000_000,
        description="Number of wisps to start with; more are added where strands differ too much from their wisp",
    )  # fmt: skip
    error_threshold: FloatProperty(
        name="Largest Error", default=0.2, min=1e-4, soft_min=0.02, soft_max=1.0, max=1000.0, precision=3, step=1,
        description="How much a strand may differ from its wisp's center: the sum of squared distances over its "
        "points, in head radii squared. 0.1 to 0.3 suits most hair; smaller values give more wisps",
    )  # fmt: skip
    adaptive: BoolProperty(
        name="Adaptive", default=True,
        description="Split wisps until no strand differs from its wisp by more than the largest error",
    )  # fmt: skip
    max_iterations: IntProperty(
        name="Iterations", default=40, min=1, soft_max=100, max=10_000,
        description="Most iterations of the clustering; it stops earlier when nothing changes",
    )  # fmt: skip
    iterations_per_split: IntProperty(
        name="Iterations per Split", default=1, min=0, soft_max=10, max=10_000,
        description="Most iterations of the clustering after wisps were split",
    )  # fmt: skip
    seeds_per_wisp: IntProperty(
        name="Seeds per Wisp", default=16, min=1, soft_max=32, max=1000,
        description="Random strands tried for each first wisp; 1 is quickest and finds the worst wisps",
    )  # fmt: skip
    seeds_per_split: IntProperty(
        name="Seeds per Split", default=32, min=1, soft_max=64, max=1000,
        description="How many wisps a wisp with too large an error may be split into at once",
    )  # fmt: skip
    merge: BoolProperty(
        name="Merge", default=True,
        description="At the end, merge neighbouring wisps where the largest error allows it",
    )  # fmt: skip
    seed: IntProperty(name="Seed", default=0, min=0, description="Another number starts from other strands")


class HierarchySettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the levels of wisps"""

    n_levels: IntProperty(
        name="Levels", default=3, min=2, max=4,
        description="Levels of the hairstyle, strands included: 2 for spiky hair, 3 for most other hair",
    )  # fmt: skip
    ratio: FloatProperty(
        name="Wisps per Coarser Wisp", default=4.0, min=1.01, soft_min=2.0, soft_max=10.0, max=1000.0, precision=1,
        description="How many wisps of a level go into one wisp of the next coarser level",
    )  # fmt: skip
    wisps: PointerProperty(type=WispSettings)


class TextureSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the texture optimisation, which lays out the coarsest wisps"""

    window_sizes: IntVectorProperty(
        name="Windows", default=(32, 16, 8), size=3, min=0, soft_min=4, soft_max=64, max=512,
        description="Sizes of the pieces of the example that are fitted together, in cells of the feature map, largest "
        "first; 0 leaves a size out",
    )  # fmt: skip
    n_scales: IntProperty(
        name="Scales", default=3, min=1, max=8,
        description="Resolutions of the feature map that are worked on in turn, each half as fine as the next",
    )  # fmt: skip
    n_iterations: IntProperty(
        name="Iterations", default=10, min=1, soft_max=50, max=1000,
        description="Most iterations for each window size at each scale",
    )  # fmt: skip
    exponent: FloatProperty(
        name="Robustness", default=0.8, min=0.01, soft_min=0.4, max=2.0, precision=2,
        description="Exponent of the energy: 2 blends pieces that disagree, smaller values let one of them win",
    )  # fmt: skip
    layout_weight: FloatProperty(
        name="Keep Layout", default=5.0, min=0.0, soft_max=20.0, max=1000.0, precision=2,
        description="Pull towards pieces from the same place on the scalp; 0, as in the paper, lays hair out freely",
    )  # fmt: skip
    coverage_weight: FloatProperty(
        name="Use All", default=0.5, min=0.0, soft_max=2.0, max=1000.0, precision=2,
        description="How much pieces of the example that were used often are avoided, so that all of it is used",
    )  # fmt: skip

    def to_params(self) -> dict[str, Any]:
        params = super().to_params()
        params["window_sizes"] = [size for size in self.window_sizes if size > 0]
        return params


class RefineSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the refinement, which lets strands run together"""

    spacing: FloatProperty(
        name="Spacing", default=0.02, min=1e-4, soft_min=0.005, soft_max=0.1, max=1.0, precision=4, step=0.1,
        description="Cell size of the flow field, in head radii, for the coarsest level; each finer level halves it",
    )  # fmt: skip
    step: FloatProperty(
        name="Step", default=0.02, min=1e-4, soft_min=0.005, soft_max=0.1, max=1.0, precision=4, step=0.1,
        description="Step of a strand that follows the flow, in head radii",
    )  # fmt: skip
    iterations: IntProperty(
        name="Passes", default=2, min=1, soft_max=6, max=16,
        description="Passes of averaging in the flow field; each trusts strands less that run across the others",
    )  # fmt: skip
    grid: EnumProperty(
        name="Cells", default="auto", description="Where the cells of the flow field lie",
        items=(
            ("auto", "Automatic", "Over the scalp, or in the room where the hair hangs below it"),
            ("scalp", "Over the Scalp", "Cells follow the scalp: best for short and middle lengths"),
            ("world", "In the Room", "Straight cells: best for long draped hair"),
        ),
    )  # fmt: skip
    blend: FloatProperty(
        name="Strength", default=0.25, min=0.0, max=1.0, precision=2, subtype="FACTOR",
        description="Share of the flow in a strand's direction: 0 leaves strands as they are, 1 follows the flow alone",
    )  # fmt: skip
    angle_limit_deg: FloatProperty(
        name="Angle Limit", default=30.0, min=1.0, max=180.0, precision=0,
        description="The flow is trusted less where it turns away from the strand by more degrees than this",
    )  # fmt: skip
    protect_curls: BoolProperty(
        name="Protect Curls", default=True, description="Leave strands alone whose curls are smaller than a cell"
    )
    keep_length: BoolProperty(
        name="Keep Length", default=True,
        description="Keep the length of each strand; otherwise take that of an example strand that grows close by",
    )  # fmt: skip
    fill_gaps: BoolProperty(
        name="Fill Gaps", default=True,
        description="Where no other hair is, go on in the strand's own shape; otherwise the strand ends there",
    )  # fmt: skip
    clearance: FloatProperty(
        name="Clearance", default=0.003, min=-1.0, soft_min=0.0, soft_max=0.05, max=1.0, precision=4, step=0.1,
        description="Height over the scalp, in head radii, below which no strand is pushed",
    )  # fmt: skip


class CleanUpSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the clean-up"""

    min_points: IntProperty(
        name="Fewest Points", default=2, min=2, soft_max=10, max=1000,
        description="Strands with fewer points are removed",
    )  # fmt: skip
    min_length: FloatProperty(
        name="Shortest Strand", default=1e-4, min=0.0, soft_max=0.1, max=1e6, precision=5, step=0.01, unit="LENGTH",
        description="Strands that are shorter are removed",
    )  # fmt: skip
    merge_distance: FloatProperty(
        name="Merge Points", default=1e-6, min=0.0, soft_max=0.001, max=1e6, precision=6, step=0.001, unit="LENGTH",
        description="A point that is nearer than this to the one before it is merged with it",
    )  # fmt: skip
    max_root_distance: FloatProperty(
        name="Farthest Root", default=0.02, min=0.0, soft_max=0.1, max=1e6, precision=4, step=0.1, unit="LENGTH",
        description="Strands that start farther from the scalp are removed",
    )  # fmt: skip
    snap_roots: BoolProperty(
        name="Snap Roots", default=True, description="Move the roots of the strands that stay onto the scalp"
    )
    inside_tolerance: FloatProperty(
        name="Inside Tolerance", default=1e-4, min=0.0, soft_max=0.01, max=1e6, precision=5, step=0.01, unit="LENGTH",
        description="How deep in the head a point may lie before it counts as inside",
    )  # fmt: skip
    max_inside_share: FloatProperty(
        name="Most Inside", default=0.5, min=0.0, max=1.0, precision=2, subtype="FACTOR",
        description="Strands with a greater share of their points inside the head are removed",
    )  # fmt: skip
    push_out: BoolProperty(
        name="Push Out", default=True, description="Move points that lie inside the head to its surface"
    )
    remove_duplicates: BoolProperty(
        name="Remove Doubles", default=True, description="Remove strands that lie on another strand all along"
    )
    duplicate_distance: FloatProperty(
        name="Double Within", default=1e-5, min=0.0, soft_max=0.001, max=1e6, precision=6, step=0.001, unit="LENGTH",
        description="How close two strands must be all along to count as the same",
    )  # fmt: skip
    remove_outliers: BoolProperty(
        name="Remove Outliers", default=False, description="Remove strands that run unlike all strands around them"
    )
    outlier_factor: FloatProperty(
        name="Outlier Factor", default=4.0, min=1.0, soft_max=20.0, max=1e6, precision=1,
        description="How many times more than its neighbours a strand must deviate to count as an outlier",
    )  # fmt: skip
    outlier_neighbours: IntProperty(
        name="Neighbours", default=16, min=3, soft_max=64, max=1000,
        description="How many strands around it a strand is compared with",
    )  # fmt: skip


class SynthesisSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the synthesis"""

    n_strands: IntProperty(
        name="Strands", default=0, min=0, soft_max=200_000, max=2_000_000,
        description="Strands of the new hairstyle; 0 keeps the density of the example",
    )  # fmt: skip
    n_samples: IntProperty(
        name="Points per Strand", default=64, min=4, soft_min=16, soft_max=128, max=512,
        description="Points of each new strand, and of the strands that are compared",
    )  # fmt: skip
    n_features: IntProperty(
        name="Features", default=16, min=1, soft_max=64, max=256,
        description="Numbers that describe the shape of a strand in the feature map (principal components)",
    )  # fmt: skip
    map_spacing: FloatProperty(
        name="Map Spacing", default=0.02, min=0.002, soft_min=0.01, soft_max=0.1, max=0.5, precision=3, step=0.1,
        description="Cell size of the feature map over the scalp, in radians; the head spans about 1.6",
    )  # fmt: skip
    sharpness: FloatProperty(
        name="Sharpness", default=1.0, min=0.0, max=1.0, precision=2, subtype="FACTOR",
        description="Share of real example strands in the coarsest level; 0 rebuilds strands from the map alone",
    )  # fmt: skip
    hierarchy: PointerProperty(type=HierarchySettings)
    texture: PointerProperty(type=TextureSettings)
    transfer: PointerProperty(type=TransferSettings)
    refine: PointerProperty(type=RefineSettings)
    use_refinement: BoolProperty(
        name="Refine", default=True,
        description="Let the strands of each level follow a common flow, so that they run together like combed hair",
    )  # fmt: skip
    seed: IntProperty(
        name="Seed", default=0, min=0, description="Another number makes another hairstyle of the same kind"
    )


def _is_head(self: Any, obj: bpy.types.Object) -> bool:
    return obj.type == "MESH"


class SceneSettings(bpy.types.PropertyGroup):
    """Hairloom's settings of a scene"""

    head: PointerProperty(
        name="Head", type=bpy.types.Object, poll=_is_head,
        description="Mesh on which the hair grows; when empty, the mesh that the active groom is attached to",
    )  # fmt: skip
    scalp_group: StringProperty(
        name="Scalp", default="Scalp",
        description="Vertex group, or attribute of the faces, that marks where the example's hair grows",
    )  # fmt: skip
    region_group: StringProperty(
        name="Region", default="",
        description="Vertex group, or attribute of the faces, where the new hair grows; the whole scalp when empty",
    )  # fmt: skip
    clean_up: PointerProperty(type=CleanUpSettings)
    synthesis: PointerProperty(type=SynthesisSettings)
    comb: PointerProperty(type=CombSettings)
    details: PointerProperty(type=DetailTransferSettings)
    simulation: PointerProperty(type=SimulationSettings)
    four_view: PointerProperty(type=FourViewSettings)


CLASSES = (
    WispSettings, HierarchySettings, TextureSettings, TransferSettings, RefineSettings, CleanUpSettings,
    SynthesisSettings, DetailSettings, DetailTransferSettings, CombSettings, *SIMULATION_CLASSES, *FOUR_VIEW_CLASSES,
    SceneSettings,
)  # fmt: skip


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.hairloom = PointerProperty(type=SceneSettings)


def unregister() -> None:
    del bpy.types.Scene.hairloom
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
