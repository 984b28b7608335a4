"""Energies of rods, and the forces that loads along them are on their curvatures (B-23, B-24; M-25)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import require
from ..types import Float64, check_array
from ._energy_kernels import place_quadrature, pull_back
from ._kinematics_kernels import N_QUADRATURE, WEIGHTS
from .model import Rods, RodState


class Energies(NamedTuple):
    """Per rod, (S,) float64: kinetic, elastic, potential in gravity (J), and the damping's power loss (W)."""

    kinetic: Float64
    elastic: Float64
    gravity: Float64
    dissipation: Float64


def energies(rods: Rods, state: RodState, gravity: Float64) -> Energies:
    """All energies of a state; gravity (3,) m/s^2."""
    return Energies(
        kinetic(rods, state.velocities),
        elastic(rods, state.curvatures),
        gravity_potential(rods, state.roots, state.frames, state.curvatures, gravity),
        dissipation(rods, state.rates),
    )


def kinetic(rods: Rods, velocities: Float64) -> Float64:
    """(S,) J: 1/2 int rho S |r'|^2 ds by quadrature; velocities (E, Q, 3) m/s. Without T_r (see `dynamics`)."""
    squares = np.einsum("epi,epi,p->e", velocities, velocities, WEIGHTS)
    return _per_rod(rods, 0.5 * rods.mass * rods.lengths * squares)


def elastic(rods: Rods, curvatures: Float64) -> Float64:
    """(S,) J: V = 1/2 int sum_j E I_j (q_j - q_j^0)^2 ds."""
    return _per_rod(rods, 0.5 * rods.lengths * np.einsum("ej,ej->e", rods.stiffness, (curvatures - rods.rest) ** 2))


def dissipation(rods: Rods, rates: Float64) -> Float64:
    """(S,) W: 2 D = mu int sum_j E I_j q_j'^2 ds, the power that Kelvin-Voigt damping takes."""
    return _per_rod(rods, rods.damping * rods.lengths * np.einsum("ej,ej->e", rods.stiffness, rates**2))


def gravity_potential(rods: Rods, roots: Float64, frames: Float64, curvatures: Float64, gravity: Float64) -> Float64:
    """(S,) J: -int rho S g.r ds by quadrature, 0 at the world's origin."""
    heights = quadrature_points(rods, roots, frames, curvatures) @ gravity
    return _per_rod(rods, -rods.mass * rods.lengths * (heights @ WEIGHTS))


def quadrature_points(rods: Rods, roots: Float64, frames: Float64, curvatures: Float64) -> Float64:
    """(E, Q, 3) float64, m, world: the material points that carry the rods' mass."""
    _check_pose(rods, roots, frames, curvatures)
    points = np.empty((rods.n_elements, N_QUADRATURE, 3))
    place_quadrature(rods.offsets, rods.lengths, curvatures, roots, frames, points)
    return points


def generalised_force(rods: Rods, roots: Float64, frames: Float64, curvatures: Float64, gravity: Float64) -> Float64:
    """(E, 3) J m: the weight's force on the curvatures, int J^T rho S g ds (eq. 9, 10), by the step's quadrature."""
    check_array("gravity", gravity, np.float64, (3,))
    shares = (rods.mass * rods.lengths)[:, None] * WEIGHTS
    return pulled_back(rods, roots, frames, curvatures, shares[:, :, None] * gravity)


def pulled_back(rods: Rods, roots: Float64, frames: Float64, curvatures: Float64, forces: Float64) -> Float64:
    """(E, 3) J m: sum of J^T F over forces (E, Q, 3) N, world, at the quadrature points."""
    _check_pose(rods, roots, frames, curvatures)
    check_array("forces", forces, np.float64, (rods.n_elements, N_QUADRATURE, 3))
    result = np.empty((rods.n_elements, 3))
    pull_back(rods.offsets, rods.lengths, curvatures, roots, frames, np.ascontiguousarray(forces), result)
    return result


def _check_pose(rods: Rods, roots: Float64, frames: Float64, curvatures: Float64) -> None:
    check_array("roots", roots, np.float64, (rods.n_strands, 3))
    check_array("frames", frames, np.float64, (rods.n_strands, 3, 3))
    check_array("curvatures", curvatures, np.float64, (rods.n_elements, 3))
    require(all(a.flags.c_contiguous for a in (roots, frames, curvatures)), "poses of rods must be contiguous arrays")


def _per_rod(rods: Rods, values: Float64) -> Float64:
    return np.asarray(np.add.reduceat(values, rods.offsets[:-1])) if rods.n_strands else np.zeros(0)
