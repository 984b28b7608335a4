"""Contacts of strands in a time step: found where the step begins, solved between the stepper's begin and end (B-26).

With r~ the places for the old curvatures on the new root poses and J~ q' what the step still adds, the gap's rate keeps

    n.(J~ q') = n.(u - (r~ - r_n)/dt) >= -(gap(r~) - offset)/dt,

so that contacts are met, not overrun; Coulomb's cone is on the true velocity u relative to what is touched. Samples
that would not come near anyway are left out. A contact's offset is the radius, or the gap that the groom had at rest
where that is less: hair that the artist laid closer, or a little inside, may stay as it is, and carries load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import require
from ..types import Float64, Int32, Int64
from .coulomb import Legs, solve_contacts, sort_legs
from .detection import (
    ContactSet,
    Samples,
    Solid,
    join_contacts,
    near_pairs,
    nearest_of_each,
    no_contacts,
    pair_contacts,
    place_legs,
    sample_rods,
    solid_contacts,
    solid_offsets,
)
from .dynamics import Stepper
from .helices import Helices
from .model import Rods

__all__ = ["ContactParams", "ContactSet", "ContactSolver", "ContactStatistics", "Solid", "find_contacts"]

# Approach of strands to each other in a step, m, beyond which they may miss each other: bounds the pairs looked at.
_PAIR_REACH = 0.004
# Of the spacing: between strands the straight parts between samples must follow the curls.
_PAIR_SPACING = 0.4
# Contacts with other strands on each side of a strand's pairs: in a thick bundle only the nearest count, since a step
# costs the square of a strand's contacts.
_MOST_PAIRS = 6


@dataclass(frozen=True, slots=True)
class ContactParams:
    """How hair meets solids and itself.

    radius : m, of a guide with the hair around it; this much it keeps off. self_contact : strands touch each other
    (parts of the same strand never do). spacing : m between the places along a strand where contact is looked for; on a
    head of 0.1 m, hair between them comes nearer by spacing^2 / 0.8 m, which should be less than the radius.
    margin : m; places that come this near without contact are solved too. push_speed : m/s, at most, with which what
    is too deep is pushed out. tolerance : m/s, of Coulomb's law. iterations : most sweeps over the contacts.
    """

    radius: float = 0.001
    self_contact: bool = False
    spacing: float = 0.025
    margin: float = 0.0005
    push_speed: float = 0.2
    tolerance: float = 2e-5
    iterations: int = 20

    def __post_init__(self) -> None:
        for name, unit in (("radius", "m"), ("margin", "m"), ("push_speed", "m/s")):
            value = getattr(self, name)
            require(0.0 <= value < 1e3, f"contact {name} is {value:g} {unit}; it must be 0 or more")
        for name in ("spacing", "tolerance"):
            value = getattr(self, name)
            require(0.0 < value < 1e3, f"contact {name} is {value:g}; it must be above 0")
        require(self.iterations >= 1, f"contact iterations is {self.iterations}; it must be 1 or more")


@dataclass(frozen=True, slots=True)
class ContactStatistics:
    """Of one step. n_contacts : looked at. n_pressing : with a force, n_sliding : of these, on the cone's edge.
    deepest : m, of a sample in a solid when the step began, beyond what it was at rest. residual : m/s, the worst
    contact's distance from Coulomb's law. iterations : the most sweeps over an island of contacts; n_islands of them.
    """

    n_contacts: int = 0
    n_pressing: int = 0
    n_sliding: int = 0
    deepest: float = 0.0
    residual: float = 0.0
    iterations: int = 0
    n_islands: int = 0


def find_contacts(rods: Rods, params: ContactParams, helices: Helices, solids: Sequence[Solid]) -> ContactSet:
    """Contacts of a pose at rest: all places within a radius of a solid, or of two strands' radii (B-22, M-26).

    Their offsets are their gaps. helices : the pose, world.
    """
    found = []
    if solids:
        samples = sample_rods(rods, params.spacing)
        points = place_legs(helices, samples.elements, samples.arcs)
        radius = solid_offsets(samples, rods.radius, len(solids))
        found.append(solid_contacts(samples, points, np.zeros_like(points), solids, rods.friction, radius, 0.0))
    if params.self_contact:
        found.append(_pairs_at_rest(rods, sample_rods(rods, _PAIR_SPACING * params.spacing), helices))
    contacts = join_contacts(found) if found else no_contacts()
    return replace(contacts, offsets=contacts.gaps.copy())


def _pairs_at_rest(rods: Rods, samples: Samples, helices: Helices) -> ContactSet:
    """Contacts between strands that are nearer than their radii together."""

    def place(elements: Int32, arcs: Float64) -> Float64:
        return place_legs(helices, elements, arcs)

    # farther than they touch: the search is between straight parts, the gaps are between the helices
    points, reach = place(samples.elements, samples.arcs), 2.0 * float(rods.radius.max()) + _PAIR_REACH
    pairs, places = near_pairs(samples, points, np.zeros_like(points), reach, reach)
    contacts = pair_contacts(samples, points, pairs, places, place, rods.friction, rods.radius)
    return contacts.select(contacts.gaps < contacts.offsets)


class ContactSolver:
    """Finds and solves the contacts of each step, and keeps their impulses as the next step's start."""

    def __init__(self, rods: Rods, params: ContactParams, stepper: Stepper) -> None:
        self._rods, self._params, self._stepper = rods, params, stepper
        self._samples = sample_rods(rods, params.spacing)
        self._pair_samples = sample_rods(rods, _PAIR_SPACING * params.spacing) if params.self_contact else None
        self._offsets: Float64 | None = None
        self._pair_keys, self._pair_offsets = np.empty(0, np.int64), np.empty(0)
        # forces, N in the contacts' axes, by key in ascending order
        self._keys, self._forces = np.empty(0, np.int64), np.empty((0, 3))

    def set_rest(
        self, roots: Float64, frames: Float64, curvatures: Float64, solids: Sequence[Solid], *, slack: float = 0.0
    ) -> None:
        """Take the gaps of a pose as offsets, where they are less than the radius, so that it is admissible.

        roots (S, 3), frames (S, 3, 3), curvatures (E, 3) as in RodState. Between two strands the least gap counts, less
        `slack`, metres: strands that do not carry each other at rest then do not touch at the slightest motion.
        """
        rods, samples = self._rods, self._samples
        helices = Helices(roots, frames, rods.offsets, rods.lengths, curvatures)
        contacts = find_contacts(rods, self._params, helices, solids)
        self._offsets = solid_offsets(samples, rods.radius, len(solids))
        on_solid = contacts.solids >= 0
        self._offsets.reshape(-1)[contacts.keys[on_solid]] = contacts.gaps[on_solid]
        keys = self._strand_pairs(contacts.select(~on_solid))
        self._pair_keys, group = np.unique(keys, return_inverse=True)
        self._pair_offsets = np.full(len(self._pair_keys), np.inf)
        np.minimum.at(self._pair_offsets, group, contacts.gaps[~on_solid] - slack)

    def set_static(self, contacts: ContactSet, forces: Float64) -> None:
        """Forces (c, 3), N, world, on the first legs of contacts at rest: what the first step starts from."""
        require(forces.shape == (contacts.n_contacts, 3), "there must be one static force for each contact")
        self._keep(contacts, np.einsum("cij,cj->ci", contacts.axes, forces))

    def save(self) -> dict[str, Any]:
        """What the next step starts from; values that a bundle can hold."""
        return {"keys": self._keys, "forces": self._forces}

    def restore(self, saved: dict[str, Any]) -> None:
        """Start the next step from what `save` gave."""
        self._keys, self._forces = saved["keys"], saved["forces"]

    def solve(self, solids: Sequence[Solid], dt: float) -> ContactStatistics:
        """Find the contacts of the step that the stepper has begun, solve them, apply their impulses.

        Parameters
        ----------
        solids : as many, in the same order, as set_rest had. dt : s, as the stepper's.

        Raises
        ------
        InputError : another number of solids than at rest.
        """
        if self._offsets is None:
            self._offsets = solid_offsets(self._samples, self._rods.radius, len(solids))
        known = len(self._offsets)
        require(known == len(solids), f"there are {len(solids)} solids now and {known} at rest; keep them the same")
        contacts, deepest = self._find(solids, dt)
        if contacts.n_contacts == 0:
            self._keep(contacts, np.empty((0, 3)))
            return ContactStatistics(deepest=deepest)
        strands = self._stepper.element_strands[contacts.elements]
        legs = sort_legs(strands[:, 0], np.where(contacts.solids < 0, strands[:, 1], -1), len(self._rods.friction))
        paired = contacts.solids < 0
        elements = np.concatenate([contacts.elements[:, 0], contacts.elements[paired, 1]])[legs.order]
        arcs = np.concatenate([contacts.arcs[:, 0], contacts.arcs[paired, 1]])[legs.order]
        velocities = self._relative_velocities(contacts, legs, elements, arcs, solids, dt)
        blocks, block_offsets = self._stepper.delassus(legs.offsets, elements, arcs)
        impulses, report = solve_contacts(
            legs, contacts.axes, blocks, block_offsets, velocities, contacts.friction, dt * self._start(contacts.keys),
            tolerance=self._params.tolerance, iterations=self._params.iterations,
        )  # fmt: skip
        self._push(contacts, legs, elements, arcs, impulses)
        self._keep(contacts, impulses / dt)
        pressing = impulses[:, 0] > 0
        sliding = np.hypot(impulses[:, 1], impulses[:, 2]) >= contacts.friction * impulses[:, 0] * (1 - 1e-9)
        counts = contacts.n_contacts, int(pressing.sum()), int((pressing & sliding).sum())
        return ContactStatistics(*counts, deepest, report.residual, report.sweeps, report.n_islands)

    def _push(self, contacts: ContactSet, legs: Legs, elements: Int32, arcs: Float64, impulses: Float64) -> None:
        """Give the stepper the impulses (c, 3), contact axes, of the legs that press."""
        world = np.einsum("cij,ci->cj", contacts.axes, impulses)
        world = np.concatenate([world, -world[contacts.solids < 0]])[legs.order]
        pressing = world.any(axis=1)
        offsets = np.concatenate([[0], np.cumsum(pressing)])[legs.offsets]
        self._stepper.apply(offsets, elements[pressing], arcs[pressing], world[pressing])

    def _find(self, solids: Sequence[Solid], dt: float) -> tuple[ContactSet, float]:
        """What touches or would within the step, and how much deeper than at rest a sample is in a solid."""
        params, samples, rods = self._params, self._samples, self._rods
        found, deepest = [], 0.0
        assert self._offsets is not None
        if solids:
            points, moves = self._predicted(samples, dt)
            # other strands may press what would stay off by itself
            margin = params.margin if self._pair_samples is None else params.margin + _PAIR_REACH
            near = solid_contacts(samples, points, moves, solids, rods.friction, self._offsets, margin)
            deepest = float((np.minimum(near.offsets, 0.0) - near.gaps).max(initial=0.0))
            found.append(near)
        if self._pair_samples is not None:
            points, moves = self._predicted(self._pair_samples, dt)
            touching = 2.0 * float(rods.radius.max()) + params.margin
            pairs, places = near_pairs(self._pair_samples, points, moves, touching + _PAIR_REACH, touching)

            def place(elements: Int32, arcs: Float64) -> Float64:
                return self._stepper.points(elements, arcs)[0]

            contacts = pair_contacts(self._pair_samples, points, pairs, places, place, rods.friction, rods.radius)
            contacts = replace(contacts, offsets=self._lowered(contacts))
            gaps = contacts.gaps - contacts.offsets
            # what pressed goes on, however many: else a pose at rest would lose what carries it
            chosen = nearest_of_each(self._pair_samples, pairs, gaps, _MOST_PAIRS)
            found.append(contacts.select(chosen | (self._start(contacts.keys)[:, 0] > 0.0)))
        return (join_contacts(found) if found else no_contacts()), deepest

    def _predicted(self, samples: Samples, dt: float) -> tuple[Float64, Float64]:
        """r~ (n, 3) of samples, m, and how far the rates without contact would still move them."""
        points, before = self._stepper.points(samples.elements, samples.arcs)
        return points, dt * self._stepper.free_velocities(samples.elements, samples.arcs) - (points - before)

    def _relative_velocities(
        self, contacts: ContactSet, legs: Legs, elements: Int32, arcs: Float64, solids: Sequence[Solid], dt: float
    ) -> Float64:
        """(c, 3) m/s in the contacts' axes: tangential of the material, normal of the gap with the look-ahead."""
        params, paired = self._params, contacts.solids < 0
        now, before = self._stepper.points(elements, arcs)
        velocities = self._stepper.free_velocities(elements, arcs)
        carried = (now - before) / dt
        first, second = legs.of_contact[:, 0], legs.of_contact[paired, 1]
        material, closing = velocities[first], velocities[first] - carried[first]
        material[paired] -= velocities[second]
        closing[paired] -= velocities[second] - carried[second]
        for number, solid in enumerate(solids):
            touched = contacts.solids == number
            material[touched] -= solid.velocities(now[first[touched]], dt)
        relative: Float64 = np.einsum("cij,cj->ci", contacts.axes, material)
        relative[:, 0] = np.einsum("ci,ci->c", contacts.axes[:, 0], closing)
        relative[:, 0] += np.maximum((contacts.gaps - contacts.offsets) / dt, -params.push_speed)
        return relative

    def _lowered(self, contacts: ContactSet) -> Float64:
        """(c,) offsets of contacts between strands, with the gaps at rest where they are less."""
        offsets = contacts.offsets
        if len(self._pair_keys) and contacts.n_contacts:
            keys = self._strand_pairs(contacts)
            place = np.minimum(np.searchsorted(self._pair_keys, keys), len(self._pair_keys) - 1)
            offsets = np.where(self._pair_keys[place] == keys, self._pair_offsets[place], offsets)
        return offsets

    def _strand_pairs(self, contacts: ContactSet) -> Int64:
        strands = np.sort(self._stepper.element_strands[contacts.elements].astype(np.int64), axis=1)
        return np.asarray(strands[:, 0] * len(self._rods.friction) + strands[:, 1])

    def _keep(self, contacts: ContactSet, forces: Float64) -> None:
        order = np.argsort(contacts.keys, kind="stable")
        self._keys, self._forces = contacts.keys[order], forces[order]

    def _start(self, keys: Int64) -> Float64:
        """(c, 3) N in the contacts' axes: what contacts of these keys had in the last step, 0 for new ones."""
        forces = np.zeros((len(keys), 3))
        if len(self._keys):
            place = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
            same = self._keys[place] == keys
            forces[same] = self._forces[place[same]]
        return forces
