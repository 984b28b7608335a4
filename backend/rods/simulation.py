"""Guides over the frames of a scene: start in equilibrium, step, log (Bao & Qi 2017, sec. VI; B-22 ... B-28)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import require
from ..types import Float64
from .contacts import ContactParams, ContactSolver, ContactStatistics, Solid, find_contacts
from .dynamics import Stepper
from .equilibrium import Equilibrium, EquilibriumParams, find_rest_shape
from .helices import Helices, evaluate
from .model import Rods, RodState, initial_state
from .motion import RootMotion
from .scene import Scene
from .solids import Solids
from .statics import pose_rods
from .wind import wind_at

# Metres that strands come nearer to each other than they are at rest before they touch, where they do not carry each
# other at rest: much less than one sees, much more than contact forces creep.
_SLACK = 5e-5


@dataclass(frozen=True, slots=True)
class SimulationParams:
    """How guides are simulated.

    substeps : time steps a frame; at 24 frames a second a quick shake needs 4 to stay within 1 mm of the head.
    start_in_equilibrium : find the natural shape under which the groom rests as it is; without, its shape is the
    natural one and it sags. contact, equilibrium : settings of these parts.
    """

    substeps: int = 4
    start_in_equilibrium: bool = True
    contact: ContactParams = field(default_factory=ContactParams)
    equilibrium: EquilibriumParams = field(default_factory=EquilibriumParams)

    def __post_init__(self) -> None:
        require(1 <= self.substeps <= 1000, f"substeps is {self.substeps}; it must be from 1 to 1000")


class Simulation:
    """Guides on a scene, from its first frame on; `advance` goes to the next one.

    Attributes
    ----------
    scene, guides : what is simulated. rods : with the natural curvatures and stiffness that were found.
    equilibrium : how, or None. state : where the guides are. frame : now, counted from the scene's first as 0.
    log : one dict a frame, of energies and contacts in its last step.
    """

    def __init__(self, rods: Rods, guides: Helices, scene: Scene, params: SimulationParams = SimulationParams()):
        self.scene, self.guides = scene, guides
        self.state: RodState = initial_state(guides)
        self.frame = 0
        self.log: list[dict[str, Any]] = []
        self.equilibrium: Equilibrium | None = None
        self.rods = rods
        self._substeps = params.substeps
        self._root_motion = RootMotion(scene)
        self._solids = Solids(scene, guides.roots, float(guides.strand_lengths.max()))
        at_rest = self.solids(0.0, 0.0)
        contacts = find_contacts(rods, params.contact, guides, at_rest)
        if params.start_in_equilibrium:
            self.equilibrium = find_rest_shape(rods, guides, scene.gravity, contacts, params.equilibrium)
            self.rods = self.equilibrium.rods
        self._stepper = Stepper(self.rods)
        self._contact = ContactSolver(self.rods, params.contact, self._stepper)
        slack = 0.0 if params.equilibrium.hair_carries else _SLACK
        self._contact.set_rest(guides.roots, guides.frames, guides.curvatures, at_rest, slack=slack)
        if self.equilibrium is not None:
            self._contact.set_static(contacts, self.equilibrium.forces)
        # where the air is felt: at the elements' starts, where they were a step ago
        self._elements = np.arange(len(rods.lengths), dtype=np.int32)
        self._starts = pose_rods(guides).starts

    def advance(self) -> None:
        """Simulate to the scene's next frame; after its last one, the motion stands still."""
        dt = 1.0 / (self.scene.fps * self._substeps)
        statistics = ContactStatistics()
        for step in range(self._substeps):
            before, now = self.frame + step / self._substeps, self.frame + (step + 1) / self._substeps
            roots, frames = self._root_motion.move(now, self.guides.roots, self.guides.frames)
            wind = wind_at(self.scene, now, self._starts)
            self._stepper.begin(self.state, roots, frames, dt, self.scene.gravity, wind)
            if self.scene.fields:
                self._starts = self._stepper.points(self._elements, np.zeros(len(self._elements)))[0]
            statistics = self._contact.solve(self.solids(now, before), dt)
            self._stepper.end(self.state)
        self.frame += 1
        self.log.append(self._log_entry(statistics))

    def solids(self, frame: float, previous: float) -> Sequence[Solid]:
        """The scene's colliders at a frame, and where they were at the one before."""
        return self._solids.at(frame, previous)

    def sample(self, n_points: int) -> tuple[Float64, Float64]:
        """(S, n, 3) points and (S, n, 3, 3) frames of the guides now, world, at equal steps of arc length."""
        return evaluate(self.shape(), n_points)

    def shape(self) -> Helices:
        """The guides now, world space."""
        now = self.state
        return Helices(now.roots, now.frames, self.guides.offsets, self.guides.lengths, now.curvatures)

    def save(self) -> dict[str, Any]:
        """All that `restore` needs to go on as if nothing had happened; values that a bundle can hold."""
        now = self.state
        return {
            "frame": self.frame,
            "roots": now.roots,
            "frames": now.frames,
            "curvatures": now.curvatures,
            "rates": now.rates,
            "velocities": now.velocities,
            "starts": self._starts,
            "contact": self._contact.save(),
            "log": self.log,
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Go on from what `save` gave, of the same guides and scene.

        Raises
        ------
        InputError : it is of other guides.
        """
        same = saved["curvatures"].shape == self.state.curvatures.shape and len(saved["roots"]) == len(self.state.roots)
        require(same, "the saved state is of other guides; simulate from the start")
        self.frame, self.log = int(saved["frame"]), list(saved["log"])
        names = ("roots", "frames", "curvatures", "rates", "velocities")
        self.state = RodState(**{name: saved[name] for name in names})
        self._starts = saved["starts"]
        self._contact.restore(saved["contact"])

    def _log_entry(self, statistics: ContactStatistics) -> dict[str, Any]:
        energies = self._stepper.energies()
        return {
            "frame": self.scene.frame_start + self.frame,
            "kinetic": float(energies.kinetic.sum()),
            "elastic": float(energies.elastic.sum()),
            "gravity": float(energies.gravity.sum()),
            "contacts": statistics.n_contacts,
            "pressing": statistics.n_pressing,
            "sliding": statistics.n_sliding,
            "deepest": statistics.deepest,
            "residual": statistics.residual,
        }
