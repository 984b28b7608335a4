"""The time step of super-helices: linearly implicit, as a projection, in linear time (B-25, eq. 11; M-25).

Given the curvatures q_n, the roots' poses at the step's end and the world velocities v_old that the material
quadrature points had after the last step, with r~ the positions for q_n on the new root poses, r_n on the old ones:

    v(p) = (r~ - r_n)/dt + J~(p) q'
    q' = argmin  sum_p m_p |v - v_old|^2 / 2 - dt sum_p m_p g.v + dt sum_p nu_p |v - wind|^2 / 2
                 + sum_elements l (dt mu K |q'|^2 / 2 + K |dt q' + q_n - q0|^2 / 2),     K = (E I_0, E I_1, E I_2)
    q_{n+1} = q_n + dt q',  v_old := v

With the root at rest this is eq. 11 as derived in the spec, with implicit drag: M q'' appears as the difference of
momenta projected on the present motions, which holds the Coriolis, centrifugal and root acceleration terms (to first
order in dt, as the step itself). Since it is a projection, kinetic and elastic energy together cannot grow without
forcing, whatever dt. The 3N x 3N system of a rod is never built: `_dynamics_kernels`.

The rotational energy T_r of the cross-section (eq. in B-24) is left out, as in Bertails 2006: it goes with the fourth
power of the radius, 1e-7 of the translational energy for a hair that bends over a centimetre.
"""

from __future__ import annotations

import numpy as np

from ..errors import require
from ..types import Float64, Int32, Int64, check_array
from . import _dynamics_kernels as kernels
from . import _impulse_kernels as impulse_kernels
from ._kinematics_kernels import N_QUADRATURE
from .energies import Energies, energies
from .model import Rods, RodState


class Stepper:
    """Steps a set of rods: `begin`, then any number of contact queries and `apply`, then `end`.

    Holds the work arrays and the factorisation of one step. Legs are material points of rods: the element (k,) int32
    and the arc length from its start (k,) float64, m. All in the world, SI units, float64.
    """

    root_force: Float64
    """(S, 3) N, the mean force of the last step by which each root holds its rod (up, for a hanging one)."""

    def __init__(self, rods: Rods) -> None:
        elements, strands = rods.n_elements, rods.n_strands
        counts = np.diff(rods.offsets)
        blocks = -(-strands // kernels.BLOCK)
        self.rods = rods
        self.root_force = np.zeros((strands, 3))
        self.element_strands: Int32 = np.repeat(np.arange(strands, dtype=np.int32), counts)
        arrays = (rods.offsets, rods.lengths, rods.rest, rods.stiffness, rods.mass, rods.drag)
        self._properties = kernels.Properties(*map(np.ascontiguousarray, arrays))
        self._work = kernels.Work(
            poses=np.zeros((elements, kernels.N_POSE)),
            links=np.zeros((elements, kernels.N_LINK)),
            factors=np.zeros((elements, kernels.N_FACTOR)),
            motion=np.zeros((elements, kernels.N_MOTION)),
            rates=np.zeros((elements, 3)),
            velocities=np.zeros((elements, N_QUADRATURE, 3)),
            drifts=np.zeros((strands, kernels.N_DRIFT)),
            impulses=np.zeros((strands, 3)),
            scratch=np.zeros((blocks, int(counts.max(initial=1)), kernels.N_SCRATCH)),
        )
        self._step: kernels.Step | None = None
        self._last: tuple[RodState, Float64] | None = None

    def begin(
        self, state: RodState, roots: Float64, frames: Float64, dt: float, gravity: Float64, wind: Float64
    ) -> None:
        """Place the rods on their new root poses, factorise, and find the rates without contact.

        Parameters
        ----------
        state : where the rods are; not changed.
        roots, frames : (S, 3), (S, 3, 3) float64, at the step's end; frames rotations, columns n0, n1, n2.
        dt : s. gravity : (3,) float64, m/s^2. wind : (E, 3) float64, m/s of the air at each element.

        Raises
        ------
        InputError : time step not above 0, arrays of another size, values that are not finite, frames that are no
            rotations.
        """
        elements, strands = self.rods.n_elements, self.rods.n_strands
        require(np.isfinite(dt) and dt > 0.0, f"the time step is {dt:g} s; it must be above 0")
        check_array("gravity", gravity, np.float64, (3,))
        check_array("wind", wind, np.float64, (elements, 3))
        check_array("curvatures of the state", state.curvatures, np.float64, (elements, 3))
        check_array("velocities of the state", state.velocities, np.float64, (elements, N_QUADRATURE, 3))
        for name, array in (("roots", state.roots), ("new roots", roots)):
            check_array(name, array, np.float64, (strands, 3))
        for name, array in (("frames", state.frames), ("new frames", frames)):
            _check_rotations(name, array, strands)
        self._step = kernels.Step(
            float(dt),
            float(self.rods.damping),
            np.ascontiguousarray(gravity),
            np.ascontiguousarray(state.roots),
            np.ascontiguousarray(state.frames),
            np.ascontiguousarray(roots),
            np.ascontiguousarray(frames),
            np.ascontiguousarray(state.curvatures),
            np.ascontiguousarray(state.velocities),
            np.ascontiguousarray(wind),
        )
        kernels.begin_step(self._properties, self._step, self._work)

    def points(self, elements: Int32, arcs: Float64) -> tuple[Float64, Float64]:
        """r~ (k, 3), positions for the old curvatures on the new root poses, and r_n (k, 3), where they were; m."""
        step = self._begun()
        self._check_legs(elements, arcs)
        now, before = np.empty((len(elements), 3)), np.empty((len(elements), 3))
        impulse_kernels.place_legs(
            self.element_strands, step.next_roots, self._work, step.dt, elements, arcs, now, before
        )
        return now, before

    def free_velocities(self, elements: Int32, arcs: Float64) -> Float64:
        """(k, 3) m/s, world velocities with the impulses that were applied so far: without contact, before `apply`."""
        step = self._begun()
        self._check_legs(elements, arcs)
        velocities = np.empty((len(elements), 3))
        impulse_kernels.leg_velocities(self.element_strands, step.next_roots, self._work, elements, arcs, velocities)
        return velocities

    def delassus(self, leg_offsets: Int64, elements: Int32, arcs: Float64) -> tuple[Float64, Int64]:
        """H Mhat^-1 H^T, by which impulses at the legs change the legs' velocities, rod by rod (B-26).

        Parameters
        ----------
        leg_offsets : (S + 1,) int64; rod s has the legs leg_offsets[s]:leg_offsets[s + 1].

        Returns
        -------
        blocks : float64, 1/kg, the rods' (3 k_s, 3 k_s) symmetric matrices in rows, one after the other.
        block_offsets : (S + 1,) int64 into blocks.
        """
        self._begun()
        self._check_legs(elements, arcs, leg_offsets)
        sizes = (3 * np.diff(leg_offsets)) ** 2
        block_offsets = np.zeros(len(leg_offsets), np.int64)
        np.cumsum(sizes, out=block_offsets[1:])
        blocks = np.empty(int(block_offsets[-1]))
        impulse_kernels.couple_legs(self._properties, self._work, leg_offsets, elements, arcs, block_offsets, blocks)
        return blocks, block_offsets

    def apply(self, leg_offsets: Int64, elements: Int32, arcs: Float64, impulses: Float64) -> None:
        """Add impulses (k, 3) N s, world, at the legs: changes rates, velocities and the roots' force."""
        self._begun()
        self._check_legs(elements, arcs, leg_offsets)
        check_array("impulses", impulses, np.float64, (len(elements), 3))
        impulse_kernels.push_legs(self._properties, self._work, leg_offsets, elements, arcs, impulses)

    def end(self, state: RodState) -> None:
        """Move the rods: new arrays in `state`, and `root_force`."""
        step = self._begun()
        state.curvatures = step.curvatures + step.dt * self._work.rates
        state.rates = self._work.rates.copy()
        state.velocities = self._work.velocities.copy()
        state.roots, state.frames = step.next_roots.copy(), step.next_frames.copy()
        self.root_force = self._work.impulses / step.dt
        self._last = (
            RodState(state.roots, state.frames, state.curvatures, state.rates, state.velocities),
            step.gravity,
        )
        self._step = None

    def energies(self) -> Energies:
        """The rods' energies after the last `end`, for logs."""
        require(self._last is not None, "no time step has been made yet; call begin and end first")
        assert self._last is not None
        return energies(self.rods, *self._last)

    def _begun(self) -> kernels.Step:
        require(self._step is not None, "no time step is under way; call begin first")
        assert self._step is not None
        return self._step

    def _check_legs(self, elements: Int32, arcs: Float64, leg_offsets: Int64 | None = None) -> None:
        check_array("elements of the legs", elements, np.int32, (None,))
        check_array("arcs of the legs", arcs, np.float64, (len(elements),))
        if len(elements):
            known = elements.min() >= 0 and elements.max() < self.rods.n_elements
            require(known, "a leg names an element that does not exist")
        if leg_offsets is not None:
            check_array("leg_offsets", leg_offsets, np.int64, (self.rods.n_strands + 1,))
            spans = leg_offsets[0] == 0 and leg_offsets[-1] == len(elements) and (np.diff(leg_offsets) >= 0).all()
            require(spans, "leg_offsets must span the legs, rod by rod")
            owners = np.repeat(np.arange(self.rods.n_strands), np.diff(leg_offsets))
            require((self.element_strands[elements] == owners).all(), "a leg is listed under another rod than its own")


def _check_rotations(name: str, frames: Float64, strands: int) -> None:
    check_array(name, frames, np.float64, (strands, 3, 3))
    if strands:
        worst = float(np.abs(np.matmul(frames.transpose(0, 2, 1), frames) - np.eye(3)).max())
        require(worst < 1e-6, f"{name} of the rods are no rotations (off by {worst:.2g}); give orthonormal columns")
