"""What the dynamics knows of the guides: their mechanics, and where they are now."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import require
from ..types import Float64, Int32, check_array
from ._kinematics_kernels import N_QUADRATURE
from .helices import Helices
from .material import MaterialParams, section_stiffness


@dataclass(frozen=True, slots=True)
class Rods:
    """S inextensible rods of E elements in all (M-25); per-element arrays in the order of `Helices`.

    offsets : (S + 1,) int32. lengths : (E,) m. rest : (E, 3) natural curvatures q^0, 1/m.
    stiffness : (E, 3) N m^2, E I_j of twist and the two bendings (the matrix A of eq. 11 is lengths * stiffness).
    mass : (E,) kg/m. drag : (E,) kg/(m s). damping : s.
    friction : (S,) Coulomb's coefficient. radius : (S,) m, of contacts.
    All float64 but the offsets.
    """

    offsets: Int32
    lengths: Float64
    rest: Float64
    stiffness: Float64
    mass: Float64
    drag: Float64
    damping: float
    friction: Float64
    radius: Float64

    def __post_init__(self) -> None:
        elements, strands = len(self.lengths), len(self.offsets) - 1
        check_array("offsets", self.offsets, np.int32, (None,))
        require(
            strands >= 0 and self.offsets[0] == 0 and self.offsets[-1] == elements, "offsets must span the elements"
        )
        require((np.diff(self.offsets) > 0).all(), "every rod must have an element")
        for name, shape in (("lengths", ()), ("rest", (3,)), ("stiffness", (3,)), ("mass", ()), ("drag", ())):
            check_array(f"{name} of the rods", getattr(self, name), np.float64, (elements, *shape))
        for name in ("lengths", "stiffness", "mass"):
            _above_zero(name, getattr(self, name))
        _not_negative("drag", self.drag)
        require(0.0 <= self.damping < np.inf, f"damping of the rods is {self.damping:g}; it must be 0 or more")
        for name in ("friction", "radius"):
            check_array(f"{name} of the rods", getattr(self, name), np.float64, (strands,))
            _not_negative(name, getattr(self, name))

    @property
    def n_strands(self) -> int:
        return len(self.offsets) - 1

    @property
    def n_elements(self) -> int:
        return len(self.lengths)


@dataclass(slots=True)
class RodState:
    """Where the rods are, world space; a time step replaces the arrays.

    roots : (S, 3) m. frames : (S, 3, 3), columns n0, n1, n2 at the roots. curvatures : (E, 3) q, 1/m.
    rates : (E, 3) q', 1/(m s). velocities : (E, Q, 3) m/s of the material points at the elements' quadrature points.
    All float64.
    """

    roots: Float64
    frames: Float64
    curvatures: Float64
    rates: Float64
    velocities: Float64


def make_rods(
    helices: Helices, material: MaterialParams, *, hairs: Float64 | None = None, radius: float | Float64 = 0.001
) -> Rods:
    """Rods of a material that are at rest, without load, as the helices are now (B-24, M-25).

    A guide that stands for a wisp of n hairs has their mass; n^(1 + cohesion) times a hair's stiffness, from hairs
    that slide freely (n) to hairs glued together (n^2); and n^(1 - cohesion / 2) times its drag, from hairs that the
    air reaches one by one (n) to a bundle whose thickness grows with the root of n.

    Parameters
    ----------
    hairs : (S,) float64, 1 or more, hairs that each guide stands for; None for 1.
    radius : m, of contacts, one value or (S,) float64.

    Raises
    ------
    InputError : hairs or radius out of range or not finite.
    """
    strands = helices.n_strands
    hairs = np.ones(strands) if hairs is None else np.asarray(hairs, np.float64)
    check_array("hairs", hairs, np.float64, (strands,))
    if strands:
        require(hairs.min() >= 1.0, f"hairs of a guide is {hairs.min():g}; it must be 1 or more")
    radii = np.array(np.broadcast_to(np.asarray(radius, np.float64), (strands,)))
    each = np.repeat(hairs, helices.element_counts)
    return Rods(
        offsets=helices.offsets,
        lengths=helices.lengths,
        rest=helices.curvatures,
        stiffness=each[:, None] ** (1.0 + material.cohesion) * section_stiffness(material),
        mass=each * (material.density * material.area),
        drag=each ** (1.0 - material.cohesion / 2.0) * material.drag,
        damping=material.damping,
        friction=np.full(strands, material.friction),
        radius=radii,
    )


def initial_state(helices: Helices) -> RodState:
    """The helices' pose, at rest; copies."""
    elements = len(helices.lengths)
    return RodState(
        roots=helices.roots.copy(),
        frames=helices.frames.copy(),
        curvatures=helices.curvatures.copy(),
        rates=np.zeros((elements, 3)),
        velocities=np.zeros((elements, N_QUADRATURE, 3)),
    )


def _above_zero(name: str, values: Float64) -> None:
    require((values > 0.0).all(), f"{name} of the rods is {values.min(initial=0.0):g} somewhere; it must be above 0")


def _not_negative(name: str, values: Float64) -> None:
    require((values >= 0.0).all(), f"{name} of the rods is {values.min(initial=0.0):g} somewhere; it must be 0 or more")
