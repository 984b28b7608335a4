"""A start in equilibrium: natural curvatures under which the groom, as it was made, stays as it is (B-22, M-26).

K (q - q0) = f_g(q) + H^T r is solved for q0, not for q: q0 = q - A^-1 (f_g + H^T r), with the gravity and the
quadrature of the dynamics, so that its first step and all that follow move nothing. That makes an equilibrium of every
pose, though not a stable one: of a single hair's stiffness, a long wavy strand would fold at the slightest touch. Its
stability is tested, and where it fails the guide is made stiffer by the factor that it takes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import require
from ..types import Bools, Float64, Int32, check_array
from ._kinematics_kernels import NODES, WEIGHTS
from .detection import ContactSet
from .helices import Helices
from .model import Rods
from .stability import smallest_eigenvalues
from .statics import Loads, Pose, load_force, load_stiffness, pose_rods
from .support import (
    Supports,
    contact_force,
    contact_loads,
    find_supports,
    held_legs,
    least_bending_forces,
    rod_means,
    world_forces,
)

# Of a guide's weight: a contact that carries less does not count as holding it.
_LEAST_HOLD = 1e-3
# Times that contact forces and factors are found in turns: forces between guides change with their stiffness.
_TURNS_OF_PAIRS = 3


@dataclass(frozen=True, slots=True)
class EquilibriumParams:
    """Settings of find_rest_shape.

    scale_stiffness : make unstable guides stiffer. margin : the smallest eigenvalue to reach (1: as without gravity;
    0: about to fold). largest_scale : the greatest factor; a guide that needs more is reported as unstable.
    force_cost : how much a contact force of the guide's weight costs, in parts of the energy of bending that gravity
    asks for without contacts; 0 is the least bending whatever the forces.
    friction_share : of the friction coefficient that resting contacts may use, so that they do not slip at once.
    hair_carries : strands that touch each other hold each other up. Without, only solids carry at rest, and strands
    press on each other when they come nearer than the groom has them: bundles lie stiller for that.
    tolerance, iterations : of the contact forces; they only decide how little the natural shape bends.
    """

    scale_stiffness: bool = True
    margin: float = 0.1
    largest_scale: float = 1000.0
    force_cost: float = 0.1
    friction_share: float = 0.9
    hair_carries: bool = False
    tolerance: float = 1e-8
    iterations: int = 200

    def __post_init__(self) -> None:
        require(0.0 <= self.margin < 1.0, f"margin is {self.margin:g}; it must be at least 0 and below 1")
        require(1.0 <= self.largest_scale < 1e12, f"largest_scale is {self.largest_scale:g}; it must be 1 or more")
        require(0.0 <= self.force_cost < 1e6, f"force_cost is {self.force_cost:g}; it must be 0 or more")
        require(0.0 <= self.friction_share <= 1.0, f"friction_share is {self.friction_share:g}; it must be from 0 to 1")
        require(0.0 <= self.tolerance < 1.0, f"tolerance is {self.tolerance:g}; it must be at least 0 and below 1")
        require(self.iterations >= 1, f"iterations is {self.iterations}; it must be 1 or more")


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """Rods that rest in a given pose, and how firmly.

    rods : with the natural curvatures and the stiffness found. forces : (c, 3) float64 N, world, of the contacts on
    their first legs, in their order. residual : (S,) float64, force left over, relative to gravity's.
    stability_before, stability : (S,) float64, smallest eigenvalue of A - df/dq relative to A before and after scaling,
    contacts included; a guide is stable above 0. scale : (S,) float64, factors of the stiffness. stable : (S,) bool.
    bending : (S,) float64, root of the mean squared change of curvature |q0 - q|, 1/m. sweeps : of the contact forces.
    """

    rods: Rods
    forces: Float64
    residual: Float64
    stability_before: Float64
    stability: Float64
    scale: Float64
    stable: Bools
    bending: Float64
    sweeps: int

    def report(self) -> dict[str, Any]:
        """What to tell the user, for JSON."""
        scaled = self.scale[self.scale > 1.0]
        return {
            "n_guides": len(self.scale),
            "n_stable_before": int((self.stability_before > 0.0).sum()),
            "n_stable": int(self.stable.sum()),
            "n_scaled": len(scaled),
            "median_scale": float(np.median(scaled)) if len(scaled) > 0 else 1.0,
            "largest_scale": float(self.scale.max(initial=1.0)),
            "smallest_eigenvalue": float(self.stability.min(initial=1.0)),
            "residual": float(self.residual.max(initial=0.0)),
            "n_contacts": len(self.forces),
            "n_carrying": int((self.forces != 0.0).any(axis=1).sum()),
            "sweeps": self.sweeps,
        }


def find_rest_shape(
    rods: Rods,
    helices: Helices,
    gravity: Float64,
    contacts: ContactSet | None = None,
    params: EquilibriumParams = EquilibriumParams(),
) -> Equilibrium:
    """Natural curvatures, contact forces and stiffness with which `helices` rest as they are (B-22, M-26).

    Without contacts q0 = q - A^-1 f_g exactly. With them the forces are those, in the cones of friction, that bend the
    natural shape least. The Hessian of stability has the gravity and the contact forces as dead loads; directions in
    which contacts hold a guide are left out, with the other guide of a contact taken to stand still.

    Parameters
    ----------
    rods : their `rest` is not used. helices : the pose, world space. gravity : (3,) float64, m/s^2.
    contacts : at rest, as find_contacts gives them; None for none.

    Raises
    ------
    InputError : rods and helices of different elements.
    """
    check_array("gravity", gravity, np.float64, (3,))
    same = np.array_equal(rods.offsets, helices.offsets) and np.array_equal(rods.lengths, helices.lengths)
    require(same, "rods and helices have different elements; make the rods from these helices")
    carries = _may_carry(helices, contacts, params.hair_carries)
    problem = _Problem(rods, helices, gravity, None if contacts is None else contacts.select(carries), params)
    n_rods, owner = len(rods.friction), problem.owner
    scale, before, smallest = np.ones(n_rods), np.ones(n_rods), np.ones(n_rods)
    forces, sweeps = np.zeros((len(problem.supports.friction), 3)), 0
    for turn in range(problem.n_turns):
        stiffness = scale[owner, None] * problem.stiffness
        forces, sweeps = problem.carry(stiffness, forces)
        smallest = problem.stability(stiffness, forces)
        before = smallest if turn == 0 else before
        # with the forces as they are, 1 - smallest is inverse to the stiffness
        needed = scale * (1.0 - smallest) / (1.0 - params.margin)
        if not params.scale_stiffness or (needed <= 1.0).all():
            break
        needed = np.clip(needed, 1.0, params.largest_scale)
        scale, smallest = needed, 1.0 - (1.0 - smallest) * scale / needed
    stiffness = scale[owner, None] * problem.stiffness
    load = problem.weight + contact_force(problem.supports, forces, len(owner))
    bending = load / stiffness
    rest = helices.curvatures - bending
    left = stiffness * (helices.curvatures - rest) - load
    contact_forces = np.zeros((len(carries), 3))
    contact_forces[carries] = world_forces(problem.supports, forces)
    return Equilibrium(
        rods=replace(rods, rest=rest, stiffness=scale[owner, None] * rods.stiffness),
        forces=contact_forces,
        residual=_norms(left, rods.offsets) / np.maximum(_norms(problem.weight, rods.offsets), 1e-300),
        stability_before=before,
        stability=smallest,
        scale=scale,
        stable=smallest > 0.0,
        bending=_norms(bending, rods.offsets) / np.sqrt(np.diff(rods.offsets)),
        sweeps=sweeps,
    )


class _Problem:
    """What stays the same while stiffness and contact forces are found."""

    def __init__(
        self, rods: Rods, helices: Helices, gravity: Float64, contacts: ContactSet | None, params: EquilibriumParams
    ) -> None:
        self.helices, self.params = helices, params
        self.owner = np.repeat(np.arange(len(rods.friction)), np.diff(rods.offsets))
        self.stiffness = rods.lengths[:, None] * rods.stiffness
        self.pose = pose_rods(helices)
        self.weights = gravity_loads(rods, gravity)
        self.weight = load_force(helices, self.pose, self.weights)
        mass = np.bincount(self.owner, rods.mass * rods.lengths, len(rods.friction))
        self.total_weight = mass * np.linalg.norm(gravity)
        self.supports = _supports(helices, self.pose, contacts)
        self.n_turns = _TURNS_OF_PAIRS if (self.supports.signs < 0.0).any() else 1

    def carry(self, stiffness: Float64, start: Float64) -> tuple[Float64, int]:
        work = np.bincount(self.owner, (self.weight**2 / stiffness).sum(axis=1), len(self.total_weight))
        weight = np.where(self.total_weight > 0.0, self.total_weight, np.inf)
        cost = self.params.force_cost * work / weight**2
        return least_bending_forces(
            self.supports,
            len(self.helices.roots),
            self.weight,
            stiffness,
            start,
            friction=self.params.friction_share * self.supports.friction,
            force_cost=rod_means(self.supports, cost),
            tolerance=self.params.tolerance,
            iterations=self.params.iterations,
        )

    def stability(self, stiffness: Float64, forces: Float64) -> Float64:
        loads, held = self.weights, None
        if len(forces) > 0:
            loads = join_loads(loads, contact_loads(self.supports, forces))
            held = held_legs(self.supports, forces, _LEAST_HOLD * self.total_weight)
        change = load_stiffness(self.helices, self.pose, loads)
        return smallest_eigenvalues(self.helices.offsets.astype(np.int64), stiffness, change, held)


def gravity_loads(rods: Rods, gravity: Float64) -> Loads:
    """The weight of rods, N, at the points where the dynamics has it."""
    count, points = len(rods.lengths), len(NODES)
    forces = (rods.mass * rods.lengths)[:, None, None] * (WEIGHTS[:, None] * gravity)
    arcs = (rods.lengths[:, None] * NODES).reshape(-1)
    return Loads(np.repeat(np.arange(count), points), arcs, forces.reshape(-1, 3))


def join_loads(first: Loads, second: Loads) -> Loads:
    """Both, sorted by element."""
    order = np.argsort(np.concatenate([first.elements, second.elements]), kind="stable")
    return Loads(
        np.concatenate([first.elements, second.elements])[order],
        np.concatenate([first.arcs, second.arcs])[order],
        np.concatenate([first.forces, second.forces])[order],
    )


def _supports(helices: Helices, pose: Pose, contacts: ContactSet | None) -> Supports:
    if contacts is None:
        none = np.zeros((0, 2))
        return find_supports(helices, pose, none.astype(np.int32), none, np.zeros((0, 3, 3)), np.zeros(0))
    return find_supports(helices, pose, contacts.elements, contacts.arcs, contacts.axes, contacts.friction)


def _may_carry(helices: Helices, contacts: ContactSet | None, hair_carries: bool) -> Bools:
    """(c,) contacts with solids, and of two guides the nearest: only its gap is what the time steps keep free."""
    if contacts is None:
        return np.zeros(0, np.bool_)
    guides = np.sort(np.searchsorted(helices.offsets, contacts.elements, side="right") - 1, axis=1).astype(np.int64)
    pairs = guides[:, 0] * helices.n_strands + guides[:, 1]
    on_solid = contacts.elements[:, 1] < 0
    if not hair_carries:
        return on_solid
    pairs[on_solid] = -1 - np.arange(on_solid.sum())
    order = np.lexsort((contacts.gaps, pairs))
    carries = np.zeros(len(order), np.bool_)
    carries[order] = np.diff(pairs[order], prepend=np.iinfo(np.int64).min) != 0
    return carries


def _norms(values: Float64, offsets: Int32) -> Float64:
    """(S,) of each rod's values (E, 3)."""
    norms: Float64 = np.sqrt(np.add.reduceat(np.einsum("ei,ei->e", values, values), offsets[:-1]))
    return norms
