"""Start in equilibrium, beside the naive one, on real grooms: `python docs/figure_equilibrium.py`.

Ten seconds under gravity with the head as a collider; q0 = q (naive) and q0 of find_rest_shape (B-22). Needs the real
test data (HAIRLOOM_DATA, default ../shared/data) and matplotlib; a few minutes on two cores. Writes
docs/pictures/equilibrium.png and docs/figure_equilibrium.md.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from hairloom.geometry.collider import comb_collider
from hairloom.geometry.head import read_head
from hairloom.geometry.strands import join_strands, select_strands
from hairloom.io.strands import read_strands
from hairloom.io.units import Units
from hairloom.rods.contacts import ContactParams, ContactSet, ContactSolver, Solid, find_contacts
from hairloom.rods.dynamics import Stepper
from hairloom.rods.equilibrium import Equilibrium, EquilibriumParams, find_rest_shape
from hairloom.rods.fitting import fit_helices
from hairloom.rods.helices import Helices, evaluate
from hairloom.rods.material import MaterialParams
from hairloom.rods.model import Rods, initial_state, make_rods
from hairloom.types import Float64, Head

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("HAIRLOOM_DATA") or ROOT.parent / "shared" / "data")
PICTURE, PAGE = ROOT / "docs" / "pictures" / "equilibrium.png", ROOT / "docs" / "figure_equilibrium.md"
GRAVITY = np.array([0.0, 0.0, -9.81])
DT = 1.0 / 48.0
SECONDS = 10.0
EVERY = 20  # of the strands is a guide
GROOMS = {
    "sintel": (("hair",), Units(1.0, "Y")),
    "ponytail": (("front_top", "side", "back", "tail"), Units(0.24 / 70.0, "Y", "-Z")),
}


@dataclass
class Case:
    """Guides on a head: how they are, and where they are ten seconds later."""

    name: str
    helices: Helices
    head: Head | None
    solids: list[Solid]
    rods: Rods
    contacts: ContactSet | None
    found: Equilibrium
    unscaled: Equilibrium
    seconds: float
    later: dict[str, Float64]


def real_groom(name: str) -> tuple[Helices, Head]:
    """Every twentieth strand as helices, and the head."""
    parts, units = GROOMS[name]
    strands = join_strands([read_strands(DATA / name / f"{part}.tfx", units=units) for part in parts])
    guides = select_strands(strands, np.arange(0, strands.n_strands, EVERY))
    return fit_helices(guides).helices, read_head(DATA / name / "head.obj", units)


def wavy_strands(count: int = 12) -> Helices:
    """The spec's case: strands of 25 cm that stick out of a line, waves of 4 cm, 8 elements."""
    rng = np.random.default_rng(1)
    elements = 8
    frame = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    curvatures = np.zeros((count, elements, 3))
    phase = 2.0 * np.pi * (np.arange(elements) / 3.0 + rng.uniform(size=(count, 1)))
    curvatures[:, :, 1], curvatures[:, :, 2] = 20.0 * np.cos(phase), 20.0 * np.sin(phase)
    roots = np.zeros((count, 3))
    roots[:, 1] = 0.03 * np.arange(count)
    offsets = np.arange(count + 1, dtype=np.int32) * elements
    lengths = np.full(count * elements, 0.25 / elements)
    return Helices(roots, np.tile(frame, (count, 1, 1)), offsets, lengths, curvatures.reshape(-1, 3))


def play(rods: Rods, helices: Helices, solids: list[Solid], static: tuple[ContactSet, Float64] | None) -> Float64:
    """(S, 24, 3) points after ten seconds."""
    state, stepper, wind = initial_state(helices), Stepper(rods), np.zeros((len(helices.lengths), 3))
    contact = ContactSolver(rods, ContactParams(), stepper)
    contact.set_rest(helices.roots, helices.frames, helices.curvatures, solids)
    if static is not None:
        contact.set_static(*static)
    for _ in range(round(SECONDS / DT)):
        stepper.begin(state, helices.roots, helices.frames, DT, GRAVITY, wind)
        if solids:
            contact.solve(solids, DT)
        stepper.end(state)
    return evaluate(replace(helices, curvatures=state.curvatures), 24)[0]


def make_case(name: str) -> Case:
    head, solids, contacts = None, [], None
    if name == "wavy strands":
        helices = wavy_strands()
    else:
        helices, head = real_groom(name)
        solids = [Solid(comb_collider([head], helices.roots), np.eye(4), np.eye(4))]
    rods = make_rods(helices, MaterialParams())
    if solids:
        contacts = find_contacts(rods, ContactParams(), helices, solids)
    begin = time.perf_counter()
    found = find_rest_shape(rods, helices, GRAVITY, contacts)
    seconds = time.perf_counter() - begin
    unscaled = find_rest_shape(rods, helices, GRAVITY, contacts, EquilibriumParams(scale_stiffness=False))
    static = None if contacts is None else (contacts, found.forces)
    later = {"naive": play(rods, helices, solids, None), "ours": play(found.rods, helices, solids, static)}
    if (found.scale > 1.0).mean() > 0.1:
        later["naive, stiffened"] = play(replace(found.rods, rest=helices.curvatures), helices, solids, None)
    return Case(name, helices, head, solids, rods, contacts, found, unscaled, seconds, later)


def moved(case: Case, start: str) -> Float64:
    """(S,) metres, the farthest that a point of each guide is from where it began."""
    return np.asarray(np.linalg.norm(case.later[start] - evaluate(case.helices, 24)[0], axis=2).max(axis=1))


def millimetres(case: Case, start: str, statistic: Callable[[Float64], Any]) -> str:
    if start not in case.later:
        return "-"
    value = float(statistic(moved(case, start))) * 1e3
    return f"{value:.0f}" if value >= 10.0 else f"{value:.1g}"


def draw(axes: Axes, points: Float64, head: Head | None, box: tuple[Float64, Float64], title: str) -> None:
    """From the side: y to the right, z up."""
    if head is not None:
        corners = head.vertices[head.triangles]
        order = np.argsort(corners[:, :, 0].mean(axis=1))
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
        shade = 0.75 + 0.2 * np.abs(normals @ [0.6, 0.2, 0.77])
        colors = np.repeat(shade[order, None], 3, axis=1)
        axes.add_collection(PolyCollection(corners[order][:, :, 1:], facecolors=colors, edgecolors="none"))
    order = np.argsort(points[:, :, 0].mean(axis=1))
    axes.add_collection(LineCollection(points[order][:, :, 1:], colors="#5a3217", linewidths=0.5))
    axes.set_xlim(box[0][1], box[1][1])
    axes.set_ylim(box[0][2], box[1][2])
    axes.set_aspect("equal")
    axes.set_title(title, fontsize=8)
    axes.axis("off")


def make_picture(cases: list[Case]) -> None:
    figure, grid = plt.subplots(len(cases), 3, figsize=(10.5, 3.6 * len(cases)), squeeze=False)
    for row, case in zip(grid, cases):
        rest = evaluate(case.helices, 24)[0]
        everything = np.concatenate([rest, *case.later.values()]).reshape(-1, 3)
        box = everything.min(axis=0) - 0.01, everything.max(axis=0) + 0.01
        draw(row[0], rest, case.head, box, f"{case.name}: the groom")
        for axes, start in zip(row[1:], ("naive", "ours")):
            words = f"moved {millimetres(case, start, np.median)} mm median, {millimetres(case, start, np.max)} most"
            draw(axes, case.later[start], case.head, box, f"{start}, after 10 s\n{words}")
    figure.tight_layout()
    figure.savefig(PICTURE, dpi=90)


def table(cases: list[Case]) -> list[str]:
    rows = ["| | " + " | ".join(case.name for case in cases) + " |", "|---|" + "---|" * len(cases)]

    def add(what: str, values: list[str]) -> None:
        rows.append(f"| {what} | " + " | ".join(values) + " |")

    reports = [case.found.report() for case in cases]
    add("guides", [str(report["n_guides"]) for report in reports])
    add("longest, cm", [f"{case.helices.strand_lengths.max() * 100:.0f}" for case in cases])
    add("contacts with the head, carrying", [f"{report['n_contacts']}, {report['n_carrying']}" for report in reports])
    add("stable as they are", [f"{report['n_stable_before']}" for report in reports])
    add("smallest eigenvalue before", [f"{case.unscaled.stability.min():.2g}" for case in cases])
    add("made stiffer", [f"{report['n_scaled']}" for report in reports])
    add("factor, median of these", [f"{report['median_scale']:.2f}" for report in reports])
    add("factor, largest", [f"{report['largest_scale']:.2f}" for report in reports])
    add("stable then", [f"{report['n_stable']}" for report in reports])
    add("force left over, relative", [f"{report['residual']:.1e}" for report in reports])
    for start in ("naive", "naive, stiffened", "ours"):
        add(f"{start}: median moved, mm", [millimetres(case, start, np.median) for case in cases])
        add(f"{start}: most moved, mm", [millimetres(case, start, np.max) for case in cases])
    stable = [moved(case, "ours")[case.found.stable] for case in cases]
    add("ours: stable guides that moved more than 0.1 mm", [f"{(one > 1e-4).sum()}" for one in stable])
    add("find_rest_shape, s", [f"{case.seconds:.2f}" for case in cases])
    return rows


PAGE_HEAD = """# Start in equilibrium

Made by `python docs/figure_equilibrium.py`.

![start in equilibrium](pictures/equilibrium.png)

Ten seconds under gravity with nothing else happening, time step 1/48 s, the head a collider with friction 0.3. Guides
are every twentieth strand of the grooms, each with the material of a single hair (40 um, 3.9 GPa, 1300 kg/m^3), the
softest case. *naive*: the natural shape is the groom's (q0 = q), so the hair sags. *naive, stiffened*: the same with
the stiffness that ours has, where that was raised for more than a tenth of the guides. *ours*: natural shape, contact
forces and stiffness of `find_rest_shape` (B-22, M-26). Distances are of the farthest point of each guide. Times are of
a machine that was busy with other things.
"""


def main() -> None:
    cases = [make_case(name) for name in ("wavy strands", *GROOMS)]
    make_picture(cases)
    PAGE.write_text("\n".join([PAGE_HEAD, *table(cases)]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
