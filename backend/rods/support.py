"""Contact forces that carry rods at rest with the least bending of their natural shape (B-22, M-26).

min over forces r in Coulomb's cones of 1/2 (f + H^T r)^T A^-1 (f + H^T r): a convex second-order cone programme. Every
force in its cone gives an equilibrium exactly, whether it is the minimum or not, since the natural shape follows from
it; the minimum only bends least. A small cost of the forces themselves keeps contacts beside the root, where forces of
a thousand weights hardly bend the strand, from having those; without it the minimum is also slow to find, or not
unique. De Saxce's term of moving contacts has no place here: nothing moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ..types import Float64, Int32, Int64
from . import _equilibrium_kernels as kernels
from .helices import Helices
from .stability import HeldLegs
from .statics import Loads, Pose, jacobians


@dataclass(frozen=True, slots=True)
class Supports:
    """c contacts of rods at rest, with one leg (on a solid) or two (on another rod).

    contacts, elements, arcs, signs : (L,) of the legs, sorted by rod and element; 1 of a first leg, -1 of a second.
    leg_offsets : (S + 1,) legs of each rod. axes : (c, 3, 3), rows normal (towards the first leg) and two tangents.
    friction : (c,). row_offsets : (L + 1,), row_elements : (r,), rows : (r, 3, 3) of H, axes and sign included.
    """

    contacts: Int64
    elements: Int64
    arcs: Float64
    signs: Float64
    leg_offsets: Int64
    axes: Float64
    friction: Float64
    row_offsets: Int64
    row_elements: Int64
    rows: Float64


def find_supports(
    helices: Helices, pose: Pose, elements: Int32, arcs: Float64, axes: Float64, friction: Float64
) -> Supports:
    """Jacobians of contacts whose legs are on `elements` (c, 2), the second -1 on a solid, at `arcs` (c, 2)."""
    contacts, side = np.nonzero(elements >= 0)
    order = np.argsort(elements[contacts, side], kind="stable")
    contacts, side = contacts[order], side[order]
    leg_elements, leg_arcs = elements[contacts, side].astype(np.int64), arcs[contacts, side]
    row_offsets, row_elements, rows = jacobians(helices, pose, leg_elements, leg_arcs)
    signs = 1.0 - 2.0 * side
    place = np.repeat(np.arange(len(contacts)), np.diff(row_offsets))
    rows = signs[place, None, None] * (axes[contacts[place]] @ rows)
    leg_offsets = np.searchsorted(leg_elements, helices.offsets).astype(np.int64)
    return Supports(
        contacts, leg_elements, leg_arcs, signs, leg_offsets, axes, friction, row_offsets, row_elements, rows
    )


def _islands(supports: Supports, n_rods: int) -> tuple[Int64, Int64]:
    """Contacts in order of islands, whose rods do not touch those of others, and where each island begins (I + 1,)."""
    rods = _rods_of_legs(supports)
    first, second = (rods[supports.signs == sign] for sign in (1.0, -1.0))
    of_first, of_second = (supports.contacts[supports.signs == sign] for sign in (1.0, -1.0))
    rod = np.empty(len(supports.friction), np.int64)
    rod[of_first] = first
    graph = sparse.coo_array((np.ones(len(second)), (rod[of_second], second)), shape=(n_rods, n_rods))
    island = connected_components(graph, directed=False)[1][rod]
    order = np.argsort(island, kind="stable")
    return order, np.append(np.flatnonzero(np.diff(island[order], prepend=-1)), len(order)).astype(np.int64)


def least_bending_forces(
    supports: Supports,
    n_rods: int,
    force: Float64,
    stiffness: Float64,
    start: Float64,
    *,
    friction: Float64,
    force_cost: Float64,
    tolerance: float,
    iterations: int,
) -> tuple[Float64, int]:
    """Forces r (c, 3), N in the contacts' axes on the first leg, and the most sweeps of any island.

    force (E, 3): f. stiffness (E, 3): diagonal of A, N m^3. start (c, 3): forces to begin with. friction (c,): of the
    cones. force_cost (c,): m/N of a force. The kernel's docstring says what tolerance and iterations are.
    """
    forces, compliance = start.copy(), 1.0 / stiffness
    bending = compliance * (force + contact_force(supports, forces, len(stiffness)))
    if len(forces) == 0:
        return forces, 0
    order, islands = _islands(supports, n_rods)
    # the rows of a contact's legs, one after the other
    legs = np.argsort(supports.contacts, kind="stable")
    counts = np.diff(supports.row_offsets)[legs]
    rows = np.arange(counts.sum()) + np.repeat(supports.row_offsets[legs] - (np.cumsum(counts) - counts), counts)
    of_contact = np.bincount(supports.contacts, np.diff(supports.row_offsets), len(forces))
    row_offsets = np.concatenate([[0], np.cumsum(of_contact)]).astype(np.int64)
    sweeps = np.zeros(len(islands) - 1, np.int64)
    kernels.least_bending(
        islands, order, row_offsets, supports.row_elements[rows], supports.rows[rows], friction, force_cost, compliance,
        tolerance, iterations, bending, forces, sweeps,
    )  # fmt: skip
    return forces, int(sweeps.max())


def contact_force(supports: Supports, forces: Float64, n_elements: int) -> Float64:
    """H^T r (E, 3), N m^2, of forces (c, 3) in the contacts' axes."""
    place = np.repeat(supports.contacts, np.diff(supports.row_offsets))
    result = np.zeros((n_elements, 3))
    np.add.at(result, supports.row_elements, np.einsum("rij,ri->rj", supports.rows, forces[place]))
    return result


def rod_means(supports: Supports, values: Float64) -> Float64:
    """(c,) of values (S,) of rods, for each contact; of two rods the mean."""
    rods = _rods_of_legs(supports)
    counts = np.bincount(supports.contacts, minlength=len(supports.friction))
    means: Float64 = np.bincount(supports.contacts, values[rods], len(supports.friction)) / counts
    return means


def _rods_of_legs(supports: Supports) -> Int64:
    return np.searchsorted(supports.leg_offsets, np.arange(len(supports.contacts)), side="right") - 1


def world_forces(supports: Supports, forces: Float64) -> Float64:
    """(c, 3) N on the first leg in world axes, of forces in the contacts'."""
    world: Float64 = np.einsum("cij,ci->cj", supports.axes, forces)
    return world


def contact_loads(supports: Supports, forces: Float64) -> Loads:
    """The contacts' forces (c, 3), N in their axes, as loads on both legs."""
    world = world_forces(supports, forces)[supports.contacts]
    return Loads(supports.elements, supports.arcs, supports.signs[:, None] * world)


def held_legs(supports: Supports, forces: Float64, least: Float64) -> HeldLegs:
    """Legs that cannot move along some axes: not at all inside the cone, not along the normal on its surface.

    least : (S,) N, normal force below which a contact of that rod does not count as holding.
    """
    normal, tangential = forces[:, 0], np.hypot(forces[:, 1], forces[:, 2])
    rods = _rods_of_legs(supports)
    is_held = np.zeros((len(supports.contacts), 3), np.bool_)
    sticks = tangential < (1.0 - 1e-6) * supports.friction * normal
    is_held[:, 0] = normal[supports.contacts] > least[rods]
    is_held[:, 1:] = (is_held[:, 0] & sticks[supports.contacts])[:, None]
    return HeldLegs(supports.leg_offsets, supports.row_offsets, supports.row_elements, supports.rows, is_held)
