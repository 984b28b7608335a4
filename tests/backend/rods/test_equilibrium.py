"""Rest shape: nothing moves, what is stable is what theory says, contact forces bend least."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.geometry.collider import Collider
from hairloom.rods.contacts import ContactParams, ContactSolver, Solid, find_contacts
from hairloom.rods.detection import ContactSet
from hairloom.rods.dynamics import Stepper
from hairloom.rods.equilibrium import Equilibrium, EquilibriumParams, find_rest_shape, gravity_loads
from hairloom.rods.helices import Helices, evaluate
from hairloom.rods.material import MaterialParams
from hairloom.rods.model import Rods, initial_state, make_rods
from hairloom.rods.statics import load_force, pose_rods
from hairloom.rods.support import contact_force, find_supports, least_bending_forces
from hairloom.types import Float64
from rod_cases import GRAVITY, random_helices, soft_rods, straight
from scipy.optimize import nnls

UNSCALED = EquilibriumParams(scale_stiffness=False)
DT = 1.0 / 48.0


def hair(helices: Helices) -> Rods:
    """A single hair of the spec's finding: 40 um, 3.9 GPa, 1300 kg/m^3."""
    return make_rods(helices, MaterialParams())


def wavy(count: int, *, length: float = 0.25, n_elements: int = 8, seed: int = 5) -> Helices:
    return random_helices([n_elements] * count, length=length, curvature=15.0, seed=seed)


def motion(rods: Rods, helices: Helices, seconds: float, kick: float = 0.0) -> Float64:
    """(S,) m, how far any point of each rod is at the end from where it began; kick, 1/m, on all curvatures."""
    state, stepper = initial_state(helices), Stepper(rods)
    state.curvatures = state.curvatures + kick * np.random.default_rng(3).normal(size=state.curvatures.shape)
    wind = np.zeros((len(helices.lengths), 3))
    for _ in range(round(seconds / DT)):
        stepper.begin(state, helices.roots, helices.frames, DT, GRAVITY, wind)
        stepper.end(state)
    moved = evaluate(replace(helices, curvatures=state.curvatures), 24)[0] - evaluate(helices, 24)[0]
    return np.asarray(np.linalg.norm(moved, axis=2).max(axis=1))


def some_contacts(helices: Helices, on_solids: int, pairs: int, seed: int = 1, friction: float = 0.3) -> ContactSet:
    """Contacts at random places that push up, more or less."""
    rng = np.random.default_rng(seed)
    count = on_solids + pairs
    elements = np.full((count, 2), -1, np.int32)
    elements[:, 0] = rng.integers(0, len(helices.lengths), count)
    elements[on_solids:, 1] = rng.integers(0, len(helices.lengths), pairs)
    arcs = np.where(elements >= 0, rng.uniform(size=(count, 2)) * helices.lengths[elements], 0.0)
    normals = rng.normal(size=(count, 3)) * 0.6 + [0.0, 0.0, 1.0]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    tangents = np.cross(normals, rng.normal(size=(count, 3)))
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    axes = np.stack([normals, tangents, np.cross(normals, tangents)], axis=1)
    numbers = np.zeros(count, np.int32)
    return ContactSet(
        elements, arcs, axes, np.zeros(count), np.zeros(count), np.full(count, friction), numbers, np.arange(count)
    )


def test_hanging_straight_needs_nothing() -> None:
    helices = straight(10, 0.3, (0.0, 0.0, -1.0))
    found = find_rest_shape(hair(helices), helices, GRAVITY)
    assert np.abs(found.rods.rest).max() == 0.0
    # gravity only holds it the better; twist, which gravity does not see, keeps 1
    assert found.stability[0] == pytest.approx(1.0, abs=1e-12)
    assert found.scale[0] == 1.0 and found.stable[0]


@pytest.mark.parametrize("count, error", [(5, 0.02), (10, 0.005), (20, 0.0013)])
def test_upright_buckles_at_greenhills_height(count: int, error: float) -> None:
    """L^3 = 7.837 E I / (rho S g). Piecewise constant curvature is a little stiffer: error of second order."""
    rods = hair(straight(count, 1.0))
    height = (7.837 * rods.stiffness[0, 1] / (rods.mass[0] * 9.81)) ** (1.0 / 3.0)
    helices = straight(count, height, (0.0, 0.0, 1.0))
    found = find_rest_shape(hair(helices), helices, GRAVITY, params=UNSCALED)
    assert 0.0 < found.stability[0] < error
    for factor, is_stable in ((0.97, True), (1.03, False)):
        helices = straight(count, factor * height, (0.0, 0.0, 1.0))
        assert find_rest_shape(hair(helices), helices, GRAVITY, params=UNSCALED).stable[0] == is_stable


def test_horizontal_bends_against_gravity() -> None:
    """A cantilever that is to be straight under its weight: q0 is the bending moment w x^2 / 2 over E I, upwards."""
    count, length = 40, 0.05
    helices = straight(count, length)
    rods = hair(helices)
    found = find_rest_shape(rods, helices, GRAVITY, params=UNSCALED)
    from_tip = length - (np.arange(count) + 0.5) * length / count
    moment = rods.mass[0] * 9.81 * from_tip**2 / 2.0
    # turning by a positive curvature about n1 lowers the tip (n0 x n1 = n2 is up, n1 x n0 = -n2)
    assert helices.frames[0, 2, 2] == 1.0
    expected = -moment / rods.stiffness[0, 1]
    # mid-element against the mean over the element: the tip's element has the greatest error, (h/2)^2 / 3 of x^2
    assert np.abs(found.rods.rest[:, 1] - expected).max() < 2e-4 * np.abs(expected).max()
    assert np.abs(found.rods.rest[:, [0, 2]]).max() < 1e-12 * np.abs(expected).max()


def test_first_step_has_no_rates() -> None:
    helices = wavy(20)
    found = find_rest_shape(hair(helices), helices, GRAVITY)
    assert found.residual.max() < 1e-13
    state, stepper = initial_state(helices), Stepper(found.rods)
    rates = []
    for rods in (found.rods, hair(helices)):
        state, stepper = initial_state(helices), Stepper(rods)
        stepper.begin(state, helices.roots, helices.frames, DT, GRAVITY, np.zeros((len(helices.lengths), 3)))
        stepper.end(state)
        rates.append(np.abs(state.rates).max())
    # 1e-12 of the rates of the naive start, as far as rounding allows
    assert rates[0] < 1e-12 * rates[1]


def test_nothing_moves_for_ten_seconds_and_the_naive_start_falls() -> None:
    """Issue 4: 0.1 mm for stable guides; the spec's finding for q0 = q is some 30 cm at a length of 25 cm."""
    helices = wavy(40)
    found = find_rest_shape(hair(helices), helices, GRAVITY)
    assert found.stable.all() and (found.scale > 1.0).any()
    assert motion(found.rods, helices, 10.0).max() < 1e-9
    assert np.median(motion(hair(helices), helices, 10.0)) > 0.15


def test_stable_guides_come_back_and_unstable_ones_fall() -> None:
    """The eigenvalue tells what the dynamics does after a kick that moves tips by less than a millimetre."""
    helices = wavy(40, length=0.12)
    rods = hair(helices)
    found = find_rest_shape(rods, helices, GRAVITY, params=UNSCALED)
    assert 8 < found.stable.sum() < 32
    after = motion(found.rods, helices, 12.0, kick=0.02)
    firm, weak = found.stability > 0.05, found.stability < -0.05
    assert after[firm].max() < 1e-5
    assert np.median(after[weak]) > 5e-3
    scaled = find_rest_shape(rods, helices, GRAVITY)
    assert motion(scaled.rods, helices, 12.0, kick=0.02).max() < 1e-5


def test_scaling_reaches_the_margin_and_says_so() -> None:
    helices = wavy(40)
    rods = hair(helices)
    before = find_rest_shape(rods, helices, GRAVITY, params=UNSCALED)
    assert (before.scale == 1.0).all()
    found = find_rest_shape(rods, helices, GRAVITY, params=EquilibriumParams(margin=0.2))
    again = find_rest_shape(found.rods, helices, GRAVITY, params=UNSCALED)
    weak = before.stability < 0.2
    assert weak.sum() > 10
    assert np.abs(again.stability[weak] - 0.2).max() < 1e-9
    assert np.array_equal(found.scale[~weak], np.ones((~weak).sum()))
    assert np.abs(again.stability - found.stability).max() < 1e-9
    report = found.report()
    assert report["n_scaled"] == weak.sum() and report["n_stable"] == report["n_guides"] == 40
    assert report["n_stable_before"] == before.stable.sum()
    assert report["largest_scale"] == found.scale.max() > 2.0


def test_guides_beyond_the_largest_factor_are_reported() -> None:
    helices = wavy(40)
    found = find_rest_shape(hair(helices), helices, GRAVITY, params=EquilibriumParams(largest_scale=3.0))
    assert found.scale.max() == 3.0
    assert 0 < found.report()["n_stable"] < 40
    assert (found.scale[~found.stable] == 3.0).all()


def test_wisps_are_stabler_than_hairs() -> None:
    """A guide of 50 hairs weighs 50 times as much and is 50^1.5 times as stiff."""
    helices = wavy(10)
    alone = find_rest_shape(hair(helices), helices, GRAVITY, params=UNSCALED)
    rods = make_rods(helices, MaterialParams(), hairs=np.full(10, 50.0))
    wisps = find_rest_shape(rods, helices, GRAVITY, params=UNSCALED)
    assert np.allclose(1.0 - wisps.stability, (1.0 - alone.stability) / 50.0**0.5, rtol=1e-9)


def carried(helices: Helices, contacts: ContactSet, **changes: float) -> tuple[Equilibrium, Float64]:
    """The equilibrium, and the contact forces in the contacts' axes."""
    params = EquilibriumParams(hair_carries=True, **changes)  # type: ignore[arg-type]
    found = find_rest_shape(soft_rods(helices), helices, GRAVITY, contacts, params)
    return found, np.einsum("cij,cj->ci", contacts.axes, found.forces)


@pytest.mark.parametrize("on_solids, pairs", [(30, 0), (15, 15)])
def test_contact_forces_are_in_the_cone_and_balance(on_solids: int, pairs: int) -> None:
    helices = wavy(6)
    contacts = some_contacts(helices, on_solids, pairs)
    found, forces = carried(helices, contacts)
    sizes = np.hypot(forces[:, 1], forces[:, 2])
    assert (forces[:, 0] >= 0.0).all()
    assert (sizes <= 0.9 * 0.3 * forces[:, 0] * (1.0 + 1e-12)).all()
    assert (forces[:, 0] > 0.0).sum() > 10
    # A (q - q0) = f_g + H^T r, with H from the supports and A with its factors
    supports = find_supports(
        helices, pose_rods(helices), contacts.elements, contacts.arcs, contacts.axes, contacts.friction
    )
    weight = load_force(helices, pose_rods(helices), gravity_loads(found.rods, GRAVITY))
    elastic = found.rods.lengths[:, None] * found.rods.stiffness * (helices.curvatures - found.rods.rest)
    left = elastic - weight - contact_force(supports, forces, len(elastic))
    assert np.abs(left).max() < 1e-12 * np.abs(weight).max()


def test_contact_that_does_not_push_carries_nothing() -> None:
    """A ceiling above a horizontal strand, and a floor below it."""
    helices = straight(8, 0.05)
    floor = some_contacts(helices, 8, 0)
    axes = np.tile(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), (8, 1, 1))
    floor = replace(floor, axes=axes)
    ceiling = replace(floor, axes=axes * np.array([-1.0, 1.0, -1.0])[:, None])
    rods = hair(helices)
    free = find_rest_shape(rods, helices, GRAVITY)
    assert np.array_equal(find_rest_shape(rods, helices, GRAVITY, ceiling).forces, np.zeros((8, 3)))
    held = find_rest_shape(rods, helices, GRAVITY, floor)
    weight = rods.mass[0] * 9.81 * 0.05
    # the root carries the rest, or pulls down
    assert 0.5 * weight < held.forces[:, 2].sum() < 2.0 * weight
    assert held.bending[0] < 0.1 * free.bending[0]


@pytest.mark.parametrize("on_solids, pairs", [(5, 0), (3, 3)])
def test_forces_bend_least(on_solids: int, pairs: int) -> None:
    """The same convex programme with cones of 200 edges, by scipy's non-negative least squares."""
    helices = wavy(2, n_elements=5, length=0.2, seed=8)
    rods = hair(helices)
    contacts = some_contacts(helices, on_solids, pairs, seed=4)
    pose = pose_rods(helices)
    weight = load_force(helices, pose, gravity_loads(rods, GRAVITY))
    stiffness = rods.lengths[:, None] * rods.stiffness
    supports = find_supports(helices, pose, contacts.elements, contacts.arcs, contacts.axes, contacts.friction)
    count = on_solids + pairs
    unit, whole = np.sqrt((weight**2 / stiffness).sum()), rods.mass[0] * 9.81 * 0.2

    def deflection(forces: Float64) -> Float64:
        return ((weight + contact_force(supports, forces, len(weight))) / np.sqrt(stiffness)).ravel() / unit

    angles = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    edges = np.stack([np.ones(200), 0.3 * np.cos(angles), 0.3 * np.sin(angles)], axis=1)
    columns = np.empty((len(weight) * 3, count, 200))
    for contact, edge in np.ndindex(count, 200):
        forces = np.zeros((count, 3))
        forces[contact] = edges[edge] * rods.mass[0] * 9.81
        columns[:, contact, edge] = deflection(forces) - deflection(np.zeros((count, 3)))
    # rows of the forces' cost: 1e-3 of the energy for a force of the weight
    cost = np.sqrt(1e-3)
    rows = np.einsum("ab,kx->akbx", np.eye(count), edges.T).reshape(3 * count, -1) * cost / 0.2
    columns = np.concatenate([columns.reshape(len(columns), -1), rows])
    aim = np.concatenate([-deflection(np.zeros((count, 3))), np.zeros(3 * count)])
    reference = nnls(columns, aim)[1] ** 2

    def energy(iterations: int, tolerance: float) -> float:
        forces, _ = least_bending_forces(
            supports, 2, weight, stiffness, np.zeros((count, 3)),
            friction=contacts.friction, force_cost=np.full(count, (cost * unit / whole) ** 2), tolerance=tolerance,
            iterations=iterations,
        )  # fmt: skip
        return float((deflection(forces) ** 2).sum() + ((cost / whole * forces) ** 2).sum())

    assert reference < 0.95  # of the energy without contacts
    # the cone of edges is inside the round one, by at most 1 - cos(pi / 200) = 1.2e-4 of its width
    assert reference - 1e-3 < energy(5000, 0.0) <= reference + 1e-9
    # as many sweeps as are made by default are near it
    defaults = EquilibriumParams()
    assert energy(defaults.iterations, defaults.tolerance) < reference + 0.01


def test_contact_that_holds_makes_a_guide_stabler() -> None:
    """A strand that leans at a wall, at twice its critical height: it slips without friction, hardly with it.

    With its tip pinned a clamped column buckles at L^3 = 52.5 E I / (rho S g) instead of 7.84.
    """
    helices = replace(straight(10, 0.2, (0.0, 0.0, 1.0)), curvatures=np.tile([0.0, -3.0, 0.0], (10, 1)))
    rods = hair(helices)
    tip = evaluate(helices, 2)[0][0, 1]
    assert tip[1] > 0.05
    axes = np.array([[[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]])
    wall = replace(
        some_contacts(helices, 1, 0), elements=np.array([[9, -1]], np.int32), arcs=np.array([[0.02, 0.0]]), axes=axes
    )
    free = find_rest_shape(rods, helices, GRAVITY, params=UNSCALED)
    slippery = find_rest_shape(rods, helices, GRAVITY, replace(wall, friction=np.zeros(1)), UNSCALED)
    sticky = find_rest_shape(rods, helices, GRAVITY, wall, UNSCALED)
    assert slippery.forces[0, 1] < 0.0 and np.abs(slippery.forces[0, [0, 2]]).max() == 0.0
    assert free.stability[0] < -6.0 and slippery.stability[0] < -6.0
    assert sticky.stability[0] > -1.0
    assert sticky.bending[0] < 0.1 * free.bending[0]


def draped(count: int) -> tuple[Helices, Collider]:
    """Strands that lie on a ball of 10 cm, 0.8 mm off it, half the circumference or less, and then hang."""
    rng = np.random.default_rng(2)
    polar, azimuth = rng.uniform(0.1, 1.2, count), rng.uniform(0.0, 2.0 * np.pi, count)
    out = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)
    down = np.stack([np.cos(polar) * np.cos(azimuth), np.cos(polar) * np.sin(azimuth), -np.sin(polar)], axis=1)
    elements, length, radius = 10, 0.025, 0.1008
    on_ball = polar[:, None] + np.arange(elements) * length / radius < np.pi / 2.0
    curvatures = np.zeros((count, elements, 3))
    curvatures[:, :, 1] = on_ball / radius
    helices = Helices(
        radius * out,
        np.stack([down, np.cross(out, down), out], axis=2),
        np.arange(count + 1, dtype=np.int32) * elements,
        np.full(count * elements, length),
        curvatures.reshape(-1, 3),
    )
    axis = np.arange(-0.112, 0.1121, 0.004)
    nodes = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    return helices, Collider((np.linalg.norm(nodes, axis=-1) - 0.1).astype(np.float32), np.full(3, axis[0]), 0.004)


def motion_in_contact(
    rods: Rods, helices: Helices, solids: list[Solid], params: ContactParams, seconds: float, forces: Float64 | None
) -> Float64:
    """(S,) m, how far any point is at the end from where it began; forces are those of the contacts at rest."""
    state, stepper = initial_state(helices), Stepper(rods)
    solver = ContactSolver(rods, params, stepper)
    solver.set_rest(helices.roots, helices.frames, helices.curvatures, solids)
    if forces is not None:
        solver.set_static(find_contacts(rods, params, helices, solids), forces)
    wind = np.zeros((len(helices.lengths), 3))
    for _ in range(round(seconds / DT)):
        stepper.begin(state, helices.roots, helices.frames, DT, GRAVITY, wind)
        solver.solve(solids, DT)
        stepper.end(state)
    moved = evaluate(replace(helices, curvatures=state.curvatures), 24)[0] - evaluate(helices, 24)[0]
    return np.asarray(np.linalg.norm(moved, axis=2).max(axis=1))


def test_nothing_moves_on_a_head() -> None:
    helices, ball = draped(6)
    solids, params = [Solid(ball, np.eye(4), np.eye(4))], ContactParams()
    rods = hair(helices)
    contacts = find_contacts(rods, params, helices, solids)
    found = find_rest_shape(rods, helices, GRAVITY, contacts)
    free = find_rest_shape(rods, helices, GRAVITY, params=UNSCALED)
    assert found.report()["n_carrying"] > 15
    # the ball carries what else the natural shape would have to
    assert np.median(found.bending) < 0.5 * np.median(free.bending)
    assert found.stability_before.min() > free.stability.min() + 0.2
    assert motion_in_contact(found.rods, helices, solids, params, 10.0, found.forces).max() < 1e-6
    assert motion_in_contact(rods, helices, solids, params, 1.0, None).max() > 5e-3


def test_nothing_moves_on_another_strand() -> None:
    """Two strands laid across two others that stick out, stiff enough to stay up."""
    below, above = straight(6, 0.06, (1.0, 0.0, 0.0)), straight(6, 0.06, (0.0, 1.0, 0.0))
    helices = Helices(
        np.array([[0.0, 0.0, 0.0], [0.0, 0.02, 0.0], [0.02, -0.03, 0.0009], [0.045, -0.03, 0.0009]]),
        np.concatenate([below.frames, below.frames, above.frames, above.frames]),
        np.arange(5, dtype=np.int32) * 6,
        np.tile(below.lengths, 4),
        np.zeros((24, 3)),
    )
    rods = make_rods(helices, MaterialParams(), radius=0.0005)
    params = ContactParams(self_contact=True)
    contacts = find_contacts(rods, params, helices, [])
    none = find_rest_shape(rods, helices, GRAVITY, contacts)
    assert none.report()["n_carrying"] == 0
    found = find_rest_shape(rods, helices, GRAVITY, contacts, EquilibriumParams(hair_carries=True))
    assert contacts.n_contacts == 4 and found.report()["n_carrying"] >= 2
    # up on the strands above, whichever leg is the first
    up = np.where(contacts.elements[:, 0] >= 12, 1.0, -1.0) * found.forces[:, 2]
    assert up.min() >= 0.0 and up.sum() > 0.1 * rods.mass[0] * 9.81 * 0.06
    assert motion_in_contact(found.rods, helices, [], params, 3.0, found.forces).max() < 1e-6


def test_of_two_guides_only_the_nearest_contact_carries() -> None:
    """The time steps keep the least gap of two strands free; what is farther apart cannot push."""
    helices = wavy(2)
    contacts = some_contacts(helices, 2, 6)
    elements = contacts.elements.copy()
    elements[2:] = np.sort(np.stack([np.arange(6) + 1, np.arange(6) + 9], axis=1), axis=1)
    contacts = replace(contacts, elements=elements, gaps=np.array([0.0, 0.0, 5.0, 4.0, 3.0, 2.0, 3.0, 6.0]) * 1e-4)
    for axes in (contacts.axes, -contacts.axes):
        forces = carried(helices, replace(contacts, axes=axes))[0].forces
        assert (forces[[2, 3, 4, 6, 7]] == 0.0).all()
        if forces[5].any():
            break
    assert forces[5].any()


def test_rotation_and_order_do_not_matter() -> None:
    helices = wavy(5)
    found = find_rest_shape(hair(helices), helices, GRAVITY)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    turned = replace(helices, roots=helices.roots @ turn.T, frames=turn @ helices.frames)
    other = find_rest_shape(hair(turned), turned, turn @ GRAVITY)
    assert np.abs(other.rods.rest - found.rods.rest).max() < 1e-9 * np.abs(found.rods.rest).max()
    assert np.allclose(other.scale, found.scale, rtol=1e-9)


def test_same_bytes_every_time() -> None:
    helices = wavy(8)
    contacts = some_contacts(helices, 20, 10)
    first, second = (carried(helices, contacts)[0] for _ in range(2))
    assert first.rods.rest.tobytes() == second.rods.rest.tobytes()
    assert first.forces.tobytes() == second.forces.tobytes()


def test_without_gravity_nothing_changes() -> None:
    helices = wavy(3)
    found = find_rest_shape(hair(helices), helices, np.zeros(3))
    assert np.array_equal(found.rods.rest, helices.curvatures)
    assert (found.stability == 1.0).all() and (found.residual == 0.0).all()


def test_no_guides() -> None:
    none = Helices(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(1, np.int32), np.zeros(0), np.zeros((0, 3)))
    assert find_rest_shape(hair(none), none, GRAVITY).report()["n_guides"] == 0


def test_bad_input() -> None:
    helices = wavy(3)
    with pytest.raises(InputError, match="different elements"):
        find_rest_shape(hair(wavy(2)), helices, GRAVITY)
    with pytest.raises(InputError, match="gravity"):
        find_rest_shape(hair(helices), helices, np.zeros(2))
    with pytest.raises(InputError, match="gravity"):
        find_rest_shape(hair(helices), helices, np.array([0.0, 0.0, np.nan]))
    for changes in ({"margin": 1.0}, {"largest_scale": 0.5}, {"friction_share": 1.5}, {"iterations": 0}):
        with pytest.raises(InputError, match=next(iter(changes))):
            EquilibriumParams(**changes)  # type: ignore[arg-type]
