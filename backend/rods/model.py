"""What the dynamics knows of the guides: their mechanics, and where they are now."""

from __future__ import annotations

from dataclasses import dataclass

from ..types import Float64, Int32


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
