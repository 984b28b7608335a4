"""Coulomb friction solved properly: contacts one by one exactly, all together by block Gauss-Seidel (B-26, M-26).

After Daviet et al. 2011, with the local problem solved by its one-unknown equation within a bracket, where they use
the quartic's coefficients and a Fischer-Burmeister Newton; no penalty springs, no facets for the cone. Strands that
touch only solids are independent of each other and are solved side by side; strands that touch each other form islands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ..errors import require
from ..types import Float64, Int32, Int64
from ._coulomb_kernels import System, local_impulses, own_matrices, solve_islands, turn_blocks


@dataclass(frozen=True, slots=True)
class Legs:
    """The points of strands where contacts push, sorted by strand; a contact has one (against a solid) or two.

    of_contact : (c, 2) int64, the legs of each contact, -1 for none. strands : (L,) int32.
    offsets : (S + 1,) int64, strand s owns the legs offsets[s]:offsets[s + 1].
    order : (L,) int64, which of the first legs of all contacts and then the second legs each is.
    """

    of_contact: Int64
    strands: Int32
    offsets: Int64
    order: Int64


def sort_legs(first: Int32, second: Int32, n_strands: int) -> Legs:
    """Legs of contacts between strands first (c,) and second (c,), -1 for a solid."""
    paired = np.flatnonzero(second >= 0)
    strands = np.concatenate([first, second[paired]])
    order = np.argsort(strands, kind="stable")
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    of_contact = np.full((len(first), 2), -1, np.int64)
    of_contact[:, 0] = place[: len(first)]
    of_contact[paired, 1] = place[len(first) :]
    offsets = np.zeros(n_strands + 1, np.int64)
    np.cumsum(np.bincount(strands, minlength=n_strands), out=offsets[1:])
    return Legs(of_contact, strands[order].astype(np.int32), offsets, order)


@dataclass(frozen=True, slots=True)
class CoulombReport:
    """residual : m/s, the worst contact's distance from Coulomb's law. sweeps : the most of any island.
    n_islands : groups of strands that do not touch each other. converged : the residual is within the tolerance.
    """

    residual: float
    sweeps: int
    n_islands: int
    converged: bool


def solve_contacts(
    legs: Legs,
    axes: Float64,
    blocks: Float64,
    block_offsets: Int64,
    velocities: Float64,
    friction: Float64,
    impulses: Float64,
    *,
    tolerance: float = 1e-6,
    iterations: int = 100,
) -> tuple[Float64, CoulombReport]:
    """The impulses of all contacts that make Coulomb's law hold (Daviet et al. 2011; B-26).

    Parameters
    ----------
    legs : of c contacts, as of sort_legs.
    axes : (c, 3, 3) float64, rows normal (towards the first leg), tangent, tangent, world space, right-angled.
    blocks : float64, each strand's Delassus matrix H M^-1 H^T of its k legs, (3 k, 3 k) row by row, world axes, 1/kg;
        turned in place into the contacts' axes. block_offsets : (S + 1,) where each begins.
    velocities : (c, 3) float64, m/s, of the first leg relative to what it touches without any contact, in the contact's
        axes; the normal one with the look-ahead's gap / dt added.
    friction : (c,) Coulomb's coefficients. impulses : (c, 3) N s, a start, in the contacts' axes.
    tolerance : m/s. iterations : most sweeps.

    Returns
    -------
    (c, 3) impulses on the first leg, N s, in the contacts' axes (the second gets the opposite), and how well they fit.
    """
    count = len(friction)
    if count == 0:
        return np.zeros((0, 3)), CoulombReport(0.0, 0, 0, True)
    leg_axes = np.empty((len(legs.strands), 3, 3))
    leg_impulses = np.empty((len(legs.strands), 3))
    first, paired = legs.of_contact[:, 0], np.flatnonzero(legs.of_contact[:, 1] >= 0)
    second = legs.of_contact[paired, 1]
    # the second leg's axes point the other way, so that both legs share the contact's impulse and add up
    leg_axes[first], leg_axes[second] = axes, -axes[paired]
    leg_impulses[first], leg_impulses[second] = impulses, impulses[paired]
    turn_blocks(blocks, block_offsets, legs.offsets, leg_axes)
    system = System(
        legs.of_contact, legs.strands, legs.offsets, blocks, block_offsets, np.empty((count, 3, 3)), np.empty(count),
        np.ascontiguousarray(velocities), friction,
    )  # fmt: skip
    own_matrices(system)
    system.traces[:] = np.trace(system.matrices, axis1=1, axis2=2)
    order, islands = _islands(legs)
    residuals, sweeps = np.zeros(len(islands) - 1), np.zeros(len(islands) - 1, np.int64)
    solve_islands(system, islands, order, tolerance, iterations, leg_impulses, residuals, sweeps)
    residual = float(residuals.max())
    report = CoulombReport(residual, int(sweeps.max()), len(islands) - 1, residual <= tolerance)
    return leg_impulses[first], report


def solve_one_by_one(matrices: Float64, velocities: Float64, friction: Float64) -> Float64:
    """(c, 3) impulses, N s, of contacts that have nothing to do with each other, each solved exactly.

    Parameters
    ----------
    matrices : (c, 3, 3) float64, symmetric positive definite, 1/kg, of axes normal, tangent, tangent.
    velocities : (c, 3) float64, m/s, without contact. friction : (c,) float64.

    Raises
    ------
    InputError : shapes that do not fit.
    """
    count = len(matrices)
    shapes = matrices.shape == (count, 3, 3) and velocities.shape == (count, 3) and friction.shape == (count,)
    require(shapes, "solve_one_by_one needs matrices (c, 3, 3), velocities (c, 3) and friction (c,)")
    impulses = np.empty((count, 3))
    local_impulses(matrices, velocities, friction, impulses)
    return impulses


def _islands(legs: Legs) -> tuple[Int64, Int64]:
    """Contacts in order of islands (c,), within one as given, and where each island begins (I + 1,)."""
    first = legs.strands[legs.of_contact[:, 0]]
    paired = np.flatnonzero(legs.of_contact[:, 1] >= 0)
    island = first
    if len(paired) > 0:
        n_strands = len(legs.offsets) - 1
        second = legs.strands[legs.of_contact[paired, 1]]
        graph = sparse.coo_array((np.ones(len(paired)), (first[paired], second)), shape=(n_strands, n_strands))
        island = connected_components(graph, directed=False)[1][first]
    order = np.argsort(island, kind="stable")
    begins = np.flatnonzero(np.diff(island[order], prepend=-1))
    return order, np.append(begins, len(order))
