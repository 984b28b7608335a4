"""Physical properties of hair in SI units, and what they make of an element: stiffness, mass, drag (B-24, M-25)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from ..errors import require
from ..types import Float64


@dataclass(frozen=True, slots=True)
class MaterialParams:
    """One hair, and how the hairs of a wisp that a guide stands for hold together.

    young : Pa. poisson : 1. density : kg/m^3. radius_major, radius_minor : m, half axes of the cross-section.
    damping : s, Kelvin-Voigt (paper: mu). drag : kg/(m s), air drag of one hair per length and speed (paper: nu).
    friction : Coulomb's coefficient. cohesion : 0 hairs of a wisp slide freely (n hairs are n times as stiff),
    1 they are glued (n^2 times). stiffness_scale : 1, the artist's factor.
    """

    young: float = 3.9e9
    poisson: float = 0.48
    density: float = 1300.0
    radius_major: float = 4.0e-5
    radius_minor: float = 4.0e-5
    damping: float = 0.1
    drag: float = 2.0e-5
    friction: float = 0.3
    cohesion: float = 0.5
    stiffness_scale: float = 1.0

    def __post_init__(self) -> None:
        for name in ("young", "density", "radius_major", "radius_minor", "stiffness_scale"):
            value = getattr(self, name)
            require(0.0 < value < 1e15, f"{name} is {value:g}; it must be above 0")
        for name in ("damping", "drag", "friction"):
            value = getattr(self, name)
            require(0.0 <= value < 1e6, f"{name} is {value:g}; it must be 0 or more")
        require(-1.0 < self.poisson <= 0.5, f"poisson is {self.poisson:g}; it must be above -1 and at most 0.5")
        require(0.0 <= self.cohesion <= 1.0, f"cohesion is {self.cohesion:g}; it must be from 0 to 1")

    @property
    def area(self) -> float:
        """m^2, of a hair's cross-section."""
        return math.pi * self.radius_major * self.radius_minor


def section_stiffness(material: MaterialParams) -> Float64:
    """(3,) float64, N m^2: E I_j of one hair for the twist and the bendings about n1 and n2 (B-24, M-25).

    With the half axes a1 along n1 (`radius_major`) and a2 along n2: E I_0 = G J, the torsion constant
    J = pi a1^3 a2^3 / (a1^2 + a2^2) times G = E / (2 (1 + sigma)); I_1 = pi a1 a2^3 / 4 and I_2 = pi a1^3 a2 / 4.
    A hair therefore bends about n1, the long axis, first. Times the artist's `stiffness_scale`.
    """
    a1, a2 = material.radius_major, material.radius_minor
    twist = math.pi * a1**3 * a2**3 / (2.0 * (1.0 + material.poisson) * (a1**2 + a2**2))
    bending = math.pi / 4.0 * a1 * a2
    return material.young * material.stiffness_scale * np.array([twist, bending * a2**2, bending * a1**2])


PRESETS: Mapping[str, MaterialParams] = MappingProxyType(
    {
        "fine": MaterialParams(radius_major=2.8e-5, radius_minor=2.5e-5, damping=0.08),
        "thick": MaterialParams(radius_major=4.8e-5, radius_minor=4.5e-5, damping=0.1),
        "wavy": MaterialParams(radius_major=4.5e-5, radius_minor=3.0e-5, friction=0.4),
        # water swells keratin by a seventh and softens it to under half, fills the wisp and glues it together
        "wet": MaterialParams(
            young=1.7e9,
            density=1700.0,
            radius_major=4.5e-5,
            radius_minor=4.5e-5,
            damping=0.2,
            friction=0.6,
            cohesion=1.0,
        ),
    }
)
"""Physical properties by kind of hair: 'fine', 'thick', 'wavy' (an oval section), 'wet'."""
