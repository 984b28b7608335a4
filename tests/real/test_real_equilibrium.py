"""Rest shape of the real grooms: nothing moves, with the head as a collider, where the naive start sags."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hairloom.geometry.collider import comb_collider
from hairloom.geometry.head import read_head
from hairloom.geometry.strands import join_strands, select_strands
from hairloom.io.strands import read_strands
from hairloom.io.units import Units
from hairloom.rods.contacts import ContactParams, ContactSolver, Solid, find_contacts
from hairloom.rods.dynamics import Stepper
from hairloom.rods.equilibrium import find_rest_shape
from hairloom.rods.fitting import fit_helices
from hairloom.rods.helices import Helices, evaluate
from hairloom.rods.material import MaterialParams
from hairloom.rods.model import Rods, initial_state, make_rods
from hairloom.types import Float64

GRAVITY = np.array([0.0, 0.0, -9.81])
DT = 1.0 / 48.0
GROOMS = {
    "sintel": (("hair",), Units(1.0, "Y")),
    "ponytail": (("front_top", "side", "back", "tail"), Units(0.24 / 70.0, "Y", "-Z")),
}


@pytest.fixture(scope="module", params=list(GROOMS))
def groom(request: pytest.FixtureRequest, data_dir: Path) -> tuple[Helices, list[Solid]]:
    """Every hundredth strand, and the head."""
    parts, units = GROOMS[request.param]
    strands = join_strands([read_strands(data_dir / request.param / f"{part}.tfx", units=units) for part in parts])
    guides = select_strands(strands, np.arange(0, strands.n_strands, 100))
    head = read_head(data_dir / request.param / "head.obj", units)
    return fit_helices(guides).helices, [Solid(comb_collider([head], guides.roots), np.eye(4), np.eye(4))]


def moved(rods: Rods, helices: Helices, solids: list[Solid], forces: Float64 | None) -> Float64:
    """(S,) m, after two seconds."""
    state, stepper, params = initial_state(helices), Stepper(rods), ContactParams()
    solver = ContactSolver(rods, params, stepper)
    solver.set_rest(helices.roots, helices.frames, helices.curvatures, solids)
    if forces is not None:
        solver.set_static(find_contacts(rods, params, helices, solids), forces)
    for _ in range(round(2.0 / DT)):
        stepper.begin(state, helices.roots, helices.frames, DT, GRAVITY, np.zeros_like(rods.rest))
        solver.solve(solids, DT)
        stepper.end(state)
    apart = evaluate(replace(helices, curvatures=state.curvatures), 16)[0] - evaluate(helices, 16)[0]
    return np.asarray(np.linalg.norm(apart, axis=2).max(axis=1))


def test_nothing_moves(groom: tuple[Helices, list[Solid]]) -> None:
    """With the stiffness of a single hair, the softest case."""
    helices, solids = groom
    rods = make_rods(helices, MaterialParams())
    contacts = find_contacts(rods, ContactParams(), helices, solids)
    found = find_rest_shape(rods, helices, GRAVITY, contacts)
    assert found.residual.max() < 1e-11
    assert found.stable.all() and found.scale.max() < 100.0
    assert moved(found.rods, helices, solids, found.forces).max() < 1e-4
    assert moved(rods, helices, solids, None).max() > 0.01
