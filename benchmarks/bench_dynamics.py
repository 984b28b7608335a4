"""One implicit step of guides by elements and guides: gravity and wind alone, then with a shaken head's contact.

Hair of 25 cm stands on a sphere of 9 cm and has fallen over it. Beside it the same step's linear system by the dense
3N x 3N mass matrix and numpy's batched solve, as the paper has it. Blender's own dynamics: `bench_dynamics_blender.py`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from hairloom.geometry.analytic_heads import sphere_head
from hairloom.geometry.collider import build_collider
from hairloom.rods.contacts import ContactParams, ContactSolver, Solid
from hairloom.rods.dynamics import Stepper
from hairloom.rods.helices import Helices
from hairloom.rods.material import MaterialParams
from hairloom.rods.model import Rods, RodState, initial_state, make_rods
from scipy.spatial.transform import Rotation

Row = dict[str, Any]
RADIUS, LENGTH = 0.09, 0.25
PRESSING = 8.0  # 1/m
DT, GRAVITY = 1 / 48, np.array([0.0, 0.0, -9.81])
TARGETS = {(1000, 10): 0.008}  # issue 4, with contact; 20 elements: at most 2.2 times 10
ELEMENTS, GUIDES = (5, 10, 20, 25), (100, 300, 3000, 10_000)


def guides_on_sphere(n_guides: int, n_elements: int) -> Helices:
    """Guides from the upper hemisphere that lie over the sphere, each a little differently."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(n_guides, 3))
    normals[:, 2] = np.abs(normals[:, 2])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    sideways = np.cross([0.0, 0.0, 1.0], normals)
    sideways /= np.linalg.norm(sideways, axis=1)[:, None]
    along = np.cross(sideways, normals)
    tangents = 0.28 * normals + 0.96 * along
    frames = np.stack([tangents, sideways, np.cross(tangents, sideways)], axis=2)
    curvatures = rng.normal(size=(n_guides, n_elements, 3)) * 1.5
    curvatures[:, :, 1] += 8.0  # about n1: downwards, nearly as the sphere
    return Helices(
        roots=normals * RADIUS,
        frames=np.ascontiguousarray(frames),
        offsets=np.arange(0, n_guides * n_elements + 1, n_elements, dtype=np.int32),
        lengths=np.full(n_guides * n_elements, LENGTH / n_elements),
        curvatures=curvatures.reshape(-1, 3),
    )


def head_at(step: int) -> np.ndarray:
    """(4, 4): a head shake of 2 Hz and 20 degrees."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec([0.0, 0.0, np.radians(20) * np.sin(2 * np.pi * 2.0 * step * DT)]).as_matrix()
    return matrix


class Shake:
    """Guides that follow the head; `advance` makes a step and keeps how long it took, with and without contact."""

    def __init__(self, n_guides: int, n_elements: int, contact: bool) -> None:
        self.helices = guides_on_sphere(n_guides, n_elements)
        rods = make_rods(self.helices, MaterialParams(stiffness_scale=10.0))
        # naturally more curved than the head is, so that most of the hair presses on it
        self.rods: Rods = replace(rods, rest=rods.rest + np.array([0.0, PRESSING, 0.0]))
        self.state: RodState = initial_state(self.helices)
        self.stepper = Stepper(self.rods)
        self.wind = np.tile([1.0, 0.5, 0.0], (self.rods.n_elements, 1))
        self.solver: ContactSolver | None = None
        if contact:
            self.collider = build_collider([sphere_head(RADIUS, (0.0, 0.0, 0.0))])
            self.solver = ContactSolver(self.rods, ContactParams(), self.stepper)
            rest = [Solid(self.collider, head_at(0), head_at(0), 0.3)]
            self.solver.set_rest(self.state.roots, self.state.frames, self.state.curvatures, rest)
        self.step, self.contacts = 0, 0

    def advance(self) -> None:
        before, now = head_at(self.step), head_at(self.step + 1)
        self.step += 1
        turn = now[:3, :3]
        roots, frames = self.helices.roots @ turn.T, turn @ self.helices.frames
        self.stepper.begin(self.state, roots, frames, DT, GRAVITY, self.wind)
        if self.solver is not None:
            self.contacts = self.solver.solve([Solid(self.collider, now, before, 0.3)], DT).n_contacts
        self.stepper.end(self.state)


def best_step(advance: Callable[[], object], steps: int) -> tuple[float, float]:
    """Seconds of the fastest of several steps, by the wall and by the processor."""
    walls, cpus = [], []
    for _ in range(steps):
        since, cpu = time.perf_counter(), time.process_time()
        advance()
        walls.append(time.perf_counter() - since)
        cpus.append(time.process_time() - cpu)
    return min(walls), min(cpus)


def row(size: str, who: str, seconds: float | None, target: float | None = None, note: str = "") -> Row:
    return {"size": size, "who": who, "seconds": seconds, "target": target, "note": note}


def step_row(n_guides: int, n_elements: int, contact: bool, steps: int) -> Row:
    shake = Shake(n_guides, n_elements, contact)
    seconds, cpu = best_step(shake.advance, steps)
    note = f"processor {cpu * 1e3:.1f} ms, {seconds / (n_guides * n_elements) * 1e6:.2f} us an element"
    if contact:
        note += f", {shake.contacts} contacts"
    size = f"{n_guides} x {n_elements}" + (", with head contact" if contact else "")
    return row(size, "hairloom", seconds, TARGETS.get((n_guides, n_elements)), note)


def dense_row(n_guides: int, n_elements: int, steps: int) -> Row:
    """The paper's way with numpy: Mhat given, its batched solve alone."""
    rng = np.random.default_rng(0)
    factors = rng.normal(size=(n_guides, 3 * n_elements, 3 * n_elements))
    matrices = factors @ factors.transpose(0, 2, 1) + np.eye(3 * n_elements)
    right = rng.normal(size=(n_guides, 3 * n_elements, 1))
    seconds, cpu = best_step(lambda: np.linalg.solve(matrices, right), steps)
    note = f"processor {cpu * 1e3:.1f} ms; only the solve, without making the matrix"
    return row(f"{n_guides} x {n_elements}", "numpy, dense solve", seconds, note=note)


def run(*, quick: bool = False) -> list[Row]:
    """Rows for `hairloom bench dynamics`."""
    steps = 10 if quick else 40
    Shake(4, 3, True).advance()  # compiles
    rows = [step_row(1000, n, False, steps) for n in ELEMENTS]
    rows += [step_row(count, 10, False, steps) for count in GUIDES[: 2 if quick else None]]
    rows += [step_row(1000, n, True, steps) for n in (10, 20)]
    ratio = rows[-1]["seconds"] / rows[-2]["seconds"]
    rows[-1]["target"] = 2.2 * rows[-2]["seconds"]
    rows[-1]["note"] += f", {ratio:.2f} x 10 elements"
    rows += [dense_row(1000, n, max(3, steps // 10)) for n in (10, 20)]
    return rows
