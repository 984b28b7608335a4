"""Settings of the simulation, and what a groom remembers of it.

Small quantities are shown in the units in which they are talked about (micrometres, gigapascals) and become SI in
`to_params`; they do not depend on the scene's unit scale.
"""

from __future__ import annotations

from typing import Any, ClassVar

import bpy
from bpy.props import (
    BoolProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from .params_group import ParamsGroup

# the scene's settings that are no Params of the job
_BLENDERS_OWN = (
    "guides", "guides_from_wisps", "collide_head", "colliders", "collider_friction", "air_speed", "cache_folder"
)  # fmt: skip


class UnitsGroup(ParamsGroup):
    """A group of settings of which some are shown in other units than SI: `units` has SI per shown unit by name."""

    units: ClassVar[dict[str, float]] = {}

    def to_params(self) -> dict[str, Any]:
        params = super().to_params()
        return {name: _in_si(value, self.units.get(name)) for name, value in params.items()}


def _in_si(value: Any, unit: float | None) -> Any:
    return value if unit is None else float(f"{value * unit:.7g}")


class MaterialSettings(UnitsGroup, bpy.types.PropertyGroup):
    """Physical properties of one hair, and of how the hairs of a wisp hold together"""

    units = {"young": 1e9, "radius_major": 1e-6, "radius_minor": 1e-6, "drag": 1e-6}

    young: FloatProperty(
        name="Stiffness (GPa)", default=3.9, min=1e-6, soft_min=0.5, soft_max=10.0, max=1e5, precision=2,
        description="Young's modulus of the hair's substance; dry hair has 3 to 5 GPa, wet hair under half of that",
    )  # fmt: skip
    stiffness_scale: FloatProperty(
        name="Stiffness Factor", default=1.0, min=1e-6, soft_min=0.1, soft_max=100.0, max=1e6, precision=2,
        description="Artist's factor on the stiffness: above 1 hair moves less than its substance says",
    )  # fmt: skip
    radius_major: FloatProperty(
        name="Long Radius (µm)", default=40.0, min=0.1, soft_min=15.0, soft_max=60.0, max=1e5, precision=1,
        step=100, description="Half the greater width of a hair's cross-section; fine hair has 25, thick hair 50 µm",
    )  # fmt: skip
    radius_minor: FloatProperty(
        name="Short Radius (µm)", default=40.0, min=0.1, soft_min=15.0, soft_max=60.0, max=1e5, precision=1, step=100,
        description="Half the smaller width of a hair's cross-section; curly hair is flat, straight hair round",
    )  # fmt: skip
    density: FloatProperty(
        name="Density (kg/m³)", default=1300.0, min=1.0, soft_min=800.0, soft_max=2000.0, max=1e5, precision=0,
        step=1000, description="Mass of the hair's substance by volume; dry hair has 1300 kg/m³",
    )  # fmt: skip
    poisson: FloatProperty(
        name="Poisson's Ratio", default=0.48, min=-0.99, soft_min=0.0, max=0.5, precision=2,
        description="How much the substance thins when stretched; the greater, the more easily hair twists",
    )  # fmt: skip
    damping: FloatProperty(
        name="Damping", default=0.1, min=0.0, soft_max=1.0, max=1e5, precision=3, step=1, subtype="TIME_ABSOLUTE",
        description="How soon swinging dies away within the hair itself, in seconds (Kelvin-Voigt)",
    )  # fmt: skip
    drag: FloatProperty(
        name="Drag (mg/m s)", default=20.0, min=0.0, soft_max=200.0, max=1e9, precision=1, step=100,
        description="How strongly the air holds one hair, by its length and speed; wind acts through it too",
    )  # fmt: skip
    friction: FloatProperty(
        name="Friction", default=0.3, min=0.0, soft_max=1.5, max=1000.0, precision=2,
        description="Coulomb's coefficient between hair and hair, and hair and skin; 0 slides freely",
    )  # fmt: skip
    cohesion: FloatProperty(
        name="Cohesion", default=0.5, min=0.0, max=1.0, precision=2, subtype="FACTOR",
        description="How the hairs that a guide stands for hold together: at 0 they slide freely past each other, at 1 "
        "they are glued into one thick strand, which is much stiffer",
    )  # fmt: skip


class GuideSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the choice of guides"""

    n_guides: IntProperty(
        name="Guides", default=1000, min=1, soft_min=50, soft_max=5000, max=1_000_000,
        description="Strands that are simulated; all other hair follows them. 1000 suit most grooms",
    )  # fmt: skip
    n_samples: IntProperty(
        name="Points Compared", default=32, min=4, soft_max=64, max=512,
        description="Points of each strand that count when strands are grouped around guides",
    )  # fmt: skip
    max_iterations: IntProperty(
        name="Iterations", default=40, min=1, soft_max=100, max=10_000,
        description="Most iterations of the clustering; it stops earlier when nothing changes",
    )  # fmt: skip
    seeds_per_wisp: IntProperty(
        name="Seeds per Guide", default=16, min=1, soft_max=32, max=1000,
        description="Random strands tried for each guide at the start; more take longer and spread guides better",
    )  # fmt: skip
    seed: IntProperty(name="Seed", default=0, min=0, description="Another number starts from other strands")


class FitSettings(UnitsGroup, bpy.types.PropertyGroup):
    """Settings of the fit of helices to guides"""

    units = {"l_min": 1e-2, "l_max": 1e-2, "tolerance": 1e-3}

    n_min: IntProperty(
        name="Fewest Elements", default=3, min=1, soft_max=25, max=1000,
        description="Helices that a short guide is made of at least",
        update=lambda self, _: setattr(self, "n_max", self.n_min) if self.n_max < self.n_min else None,
    )  # fmt: skip
    n_max: IntProperty(
        name="Most Elements", default=25, min=1, soft_max=50, max=1000,
        description="Helices that a long or curly guide is made of at most; more follow curls more closely and take "
        "longer to simulate",
        update=lambda self, _: setattr(self, "n_min", self.n_max) if self.n_max < self.n_min else None,
    )  # fmt: skip
    l_min: FloatProperty(
        name="Short Below (cm)", default=5.0, min=0.0, soft_max=50.0, max=1e6, precision=1, step=100,
        description="Guides that are shorter get the fewest elements",
        update=lambda self, _: setattr(self, "l_max", self.l_min) if self.l_max < self.l_min else None,
    )  # fmt: skip
    l_max: FloatProperty(
        name="Long Above (cm)", default=80.0, min=0.0, soft_max=200.0, max=1e6, precision=1, step=100,
        description="Guides that are longer get the most elements",
        update=lambda self, _: setattr(self, "l_min", self.l_max) if self.l_max < self.l_min else None,
    )  # fmt: skip
    n_elements: IntProperty(
        name="Fixed Elements", default=0, min=0, soft_max=50, max=1000,
        description="The same number of elements for every guide; 0 chooses by length and curls",
    )  # fmt: skip
    tolerance: FloatProperty(
        name="Tolerance (mm)", default=0.5, min=0.0, soft_max=5.0, max=1e6, precision=2, step=10,
        description="Guides that are farther than this from their helices get more elements; 0 never adds any",
    )  # fmt: skip
    samples_per_segment: IntProperty(
        name="Points per Segment", default=3, min=1, soft_max=10, max=1000,
        description="Points of a guide for each piece of the smooth curve that is fitted first; more smooth it more",
    )  # fmt: skip
    polish: IntProperty(
        name="Polish", default=0, min=0, soft_max=20, max=1000,
        description="Steps that bring the helices nearer to the guides after the fit; 5 halve the distance and take "
        "out needless twist, and take longer",
    )  # fmt: skip


class EquilibriumSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the rest shape, in which hair hangs still in the pose that was groomed"""

    scale_stiffness: BoolProperty(
        name="Stiffen Where Needed", default=True,
        description="Make guides stiffer that could not stand in their pose against gravity; otherwise they fold over",
    )  # fmt: skip
    margin: FloatProperty(
        name="Margin", default=0.1, min=0.0, soft_max=0.9, max=0.99, precision=2,
        description="How firmly guides stand at least: at 0 they are about to fold, at 1 gravity makes no difference",
    )  # fmt: skip
    largest_scale: FloatProperty(
        name="Stiffer at Most", default=1000.0, min=1.0, soft_max=10_000.0, max=1e9, precision=0, step=1000,
        description="Largest factor by which a guide is stiffened; a guide that needs more is reported as unstable",
    )  # fmt: skip
    force_cost: FloatProperty(
        name="Cost of Contact", default=0.1, min=0.0, soft_max=1.0, max=1e5, precision=4,
        description="How much resting contacts may press to hold the hair up: at 0 as much as helps the shape most, "
        "greater values let the hair's own stiffness carry more",
    )  # fmt: skip
    friction_share: FloatProperty(
        name="Share of Friction", default=0.9, min=0.0, max=1.0, precision=2, subtype="FACTOR",
        description="How much of the friction hair may use to lie still at the start, so that it does not slip at once",
    )  # fmt: skip
    hair_carries: BoolProperty(
        name="Hair Carries Hair", default=False,
        description="Strands that touch hold each other up at the start; without, only the head and other colliders "
        "do, and thick hair lies stiller",
    )  # fmt: skip
    tolerance: FloatProperty(
        name="Tolerance", default=1e-8, min=0.0, soft_max=1e-3, max=0.5, precision=9,
        description="Accuracy of the resting contact forces, relative; they decide how little the rest shape bends",
    )  # fmt: skip
    iterations: IntProperty(
        name="Iterations", default=200, min=1, soft_max=1000, max=100_000,
        description="Most iterations of the search for the resting contact forces",
    )  # fmt: skip


class FollowerSettings(UnitsGroup, bpy.types.PropertyGroup):
    """Settings of the hair that follows the guides"""

    units = {"root_reach": 1e-2}

    n_neighbours: IntProperty(
        name="Guides per Strand", default=4, min=1, max=8,
        description="Guides that move a strand together, those nearest to it",
    )  # fmt: skip
    n_samples: IntProperty(
        name="Places along Guides", default=33, min=2, soft_max=64, max=512,
        description="Places along a guide whose motion is handed on to the hair",
    )  # fmt: skip
    n_knots: IntProperty(
        name="Knots", default=9, min=2, soft_max=32, max=64,
        description="Places along a strand that follow the guides with weights of their own",
    )  # fmt: skip
    power: FloatProperty(
        name="Falloff", default=2.0, min=0.5, soft_max=6.0, max=16.0, precision=1,
        description="How fast a guide's influence falls off with distance; the greater, the more the nearest one wins",
    )  # fmt: skip
    clumping: FloatProperty(
        name="Clumping", default=0.5, min=0.0, max=1.0, precision=2, subtype="FACTOR",
        description="How much a strand follows its own wisp's guide alone: at 1 wisps stay together and part from "
        "each other",
    )  # fmt: skip
    root_reach: FloatProperty(
        name="Scalp Reach (cm)", default=3.0, min=0.01, soft_max=10.0, max=1000.0, precision=1, step=100,
        description="How far from the root a scalp that bends pulls a strand away from what its guides do",
    )  # fmt: skip
    training: BoolProperty(
        name="Train Weights", default=True,
        description="Simulate some of the other hair for a moment first, and follow the guides so that it moves alike",
    )  # fmt: skip
    training_strands: IntProperty(
        name="Training Strands", default=20_000, min=1, soft_max=100_000, max=1_000_000,
        description="Strands that are simulated for the training, at most",
    )  # fmt: skip
    training_frames: IntProperty(
        name="Training Frames", default=24, min=2, soft_max=96, max=10_000,
        description="Frames of the training's motion, at 24 a second",
    )  # fmt: skip
    ridge: FloatProperty(
        name="Ridge", default=0.02, min=1e-6, soft_max=1.0, max=1e5, precision=3, step=1,
        description="How strongly trained weights are held at those by distance",
    )  # fmt: skip
    seed: IntProperty(name="Seed", default=0, min=0, description="Another number trains with other strands")


class ContactSettings(UnitsGroup, bpy.types.PropertyGroup):
    """Settings of the contacts of guides"""

    units = {"radius": 1e-3, "spacing": 1e-3, "margin": 1e-3}

    radius: FloatProperty(
        name="Guide Radius (mm)", default=1.0, min=0.0, soft_max=10.0, max=1e5, precision=2, step=10,
        description="Radius of a guide with the hair around it: how far it stays off the head, and half of how far off "
        "other guides",
    )  # fmt: skip
    self_contact: BoolProperty(
        name="Hair against Hair", default=False,
        description="Guides also collide with each other and rub; takes longer",
    )  # fmt: skip
    spacing: FloatProperty(
        name="Spacing (mm)", default=25.0, min=0.1, soft_max=50.0, max=1e5, precision=1, step=100,
        description="Distance along a guide between the places where contact is looked for",
    )  # fmt: skip
    margin: FloatProperty(
        name="Margin (mm)", default=0.5, min=0.0, soft_max=10.0, max=1e5, precision=2, step=10,
        description="Places that come this near to a surface are watched even before they touch it",
    )  # fmt: skip
    push_speed: FloatProperty(
        name="Push Out (m/s)", default=0.2, min=0.0, soft_max=2.0, max=900.0, precision=2, step=10,
        description="Highest speed with which hair that is too deep in a surface is pushed out",
    )  # fmt: skip
    tolerance: FloatProperty(
        name="Tolerance (m/s)", default=2e-5, min=1e-12, soft_max=1e-2, max=100.0, precision=7,
        description="How exactly contacts keep Coulomb's law of friction",
    )  # fmt: skip
    iterations: IntProperty(
        name="Iterations", default=20, min=1, soft_max=500, max=100_000,
        description="Most sweeps over all contacts in a step",
    )  # fmt: skip


class StepSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the simulation of the guides"""

    substeps: IntProperty(
        name="Substeps", default=4, min=1, soft_max=20, max=1000,
        description="Time steps a frame; fast motion and many contacts need more",
    )  # fmt: skip
    start_in_equilibrium: BoolProperty(
        name="Start at Rest", default=True,
        description="Find the shape that the hair has without gravity, so that with it the groom hangs exactly as it "
        "was made. Otherwise the groom is taken to be the shape without gravity, and sags as soon as it plays",
    )  # fmt: skip
    contact: PointerProperty(type=ContactSettings)
    equilibrium: PointerProperty(type=EquilibriumSettings)


class SimulationSettings(ParamsGroup, bpy.types.PropertyGroup):
    """Settings of the simulation"""

    guides: PointerProperty(type=GuideSettings)
    guides_from_wisps: BoolProperty(
        name="From Wisps", default=False,
        description="Make one guide for each of the groom's smallest wisps, as Cluster Wisps found them, instead of "
        "searching wisps anew",
    )  # fmt: skip
    fit: PointerProperty(type=FitSettings)
    material: PointerProperty(type=MaterialSettings)
    simulation: PointerProperty(type=StepSettings)
    followers: PointerProperty(type=FollowerSettings)
    collide_head: BoolProperty(name="Head", default=True, description="Keep the hair out of the head that it grows on")
    colliders: PointerProperty(
        name="Colliders", type=bpy.types.Collection,
        description="Meshes besides the head that the hair is kept out of, such as shoulders, hands or a hat; they may "
        "move and bend",
    )  # fmt: skip
    collider_friction: FloatProperty(
        name="Surface Friction", default=0.3, min=0.0, soft_max=1.5, max=1000.0, precision=2,
        description="Coulomb's coefficient of head and colliders; the greater of it and the hair's own counts",
    )  # fmt: skip
    air_speed: FloatProperty(
        name="Wind (m/s)", default=1.0, min=0.0, soft_max=10.0, max=1e6, precision=2,
        description="Speed of the air that a force field of strength 1 makes; Blender's fields have no unit",
    )  # fmt: skip
    cache_folder: StringProperty(
        name="Cache", default="//hairloom_cache/", subtype="DIR_PATH",
        options={"OUTPUT_PATH", "PATH_SUPPORTS_BLEND_RELATIVE"},
        description="Folder for the simulated frames, 12 bytes a point and frame. A folder starting with // lies "
        "beside the file; in a file that was never saved it is temporary",
    )  # fmt: skip

    @classmethod
    def setting_names(cls) -> tuple[str, ...]:
        return tuple(name for name in super().setting_names() if name not in _BLENDERS_OWN)


class SimulationMemory(bpy.types.PropertyGroup):
    """What a groom remembers of its guides and its simulation, for the panel"""

    n_guides: IntProperty()
    n_strands: IntProperty()
    helices: PointerProperty(type=bpy.types.Object)
    fit_report: StringProperty()
    report: StringProperty()


# the settings are registered with the rest of the scene's, by props
CLASSES = (
    GuideSettings, FitSettings, MaterialSettings, ContactSettings, EquilibriumSettings, StepSettings, FollowerSettings,
    SimulationSettings,
)  # fmt: skip


def register() -> None:
    bpy.utils.register_class(SimulationMemory)
    bpy.types.Object.hairloom_simulation = PointerProperty(type=SimulationMemory)


def unregister() -> None:
    del bpy.types.Object.hairloom_simulation
    bpy.utils.unregister_class(SimulationMemory)
