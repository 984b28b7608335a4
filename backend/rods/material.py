"""Physical properties of hair in SI units, and what they make of an element: stiffness, mass, drag (B-24, M-25)."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import require


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
