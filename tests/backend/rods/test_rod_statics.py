"""Rods at rest against theory: heavy elastica, lateral buckling, a naturally curved ribbon, a spring (M-25)."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hairloom.rods.dynamics import Stepper
from hairloom.rods.energies import generalised_force
from hairloom.rods.helices import Helices
from hairloom.rods.model import Rods, initial_state
from rod_cases import GRAVITY, points_of, relax, soft_rods, straight
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import brentq, minimize, root

LENGTH = 0.25
NO_AIR_OR_LOSS = {"drag": 0.0, "damping": 0.0}
# tip errors over the length, `performance.md` section 2: what piecewise constant curvature itself gives
TABLE = {(1, 10): 4.1e-4, (10, 10): 1.9e-3, (166, 10): 8.0e-3, (1, 20): 1.0e-4, (10, 20): 4.6e-4, (166, 20): 2.0e-3}


def elastica(gamma: float) -> np.ndarray:
    """Tip (x, z) over the length: theta'' = -gamma (1 - s) cos theta, theta(0) = theta'(1) = 0, theta downwards."""
    s = np.linspace(0.0, 1.0, 201)
    guess = np.zeros((4, len(s)))
    for load in np.geomspace(min(gamma, 0.5), gamma, 12):
        solution = solve_bvp(
            lambda x, y, load=load: np.array([y[1], -load * (1 - x) * np.cos(y[0]), np.cos(y[0]), -np.sin(y[0])]),
            lambda a, b: np.array([a[0], b[1], a[2], a[3]]),
            s,
            guess,
            tol=1e-9,
            max_nodes=100000,
        )
        assert solution.success
        s, guess = solution.x, solution.y
    return np.array([solution.y[2, -1], -abs(solution.y[3, -1])])


def planar_minimum(gamma: float, n_elements: int) -> np.ndarray:
    """Tip (x, z) over the length of N elements of constant curvature by planar energy minimisation, on their own."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    at = (0.5 * nodes + 0.5) / n_elements
    shares = 0.5 * weights / n_elements

    def heights(curvatures: np.ndarray) -> tuple[float, np.ndarray]:
        theta, place, potential = 0.0, np.zeros(2), 0.0
        for curvature in curvatures:
            # the position within an element by its own quadrature
            inner = theta + curvature * at[:, None] * (0.5 * nodes + 0.5)
            local = np.stack([np.cos(inner), -np.sin(inner)], axis=2)
            points = place + np.einsum("pik,i->pk", local, 0.5 * weights) * at[:, None]
            potential += shares @ points[:, 1]
            whole = theta + curvature * at
            place = place + np.array([shares @ np.cos(whole), -shares @ np.sin(whole)])
            theta += curvature / n_elements
        return potential, place

    def energy(curvatures: np.ndarray) -> float:
        return 0.5 * (curvatures**2).sum() / n_elements / gamma + heights(curvatures)[0]

    found = minimize(energy, np.linspace(1.0, 0.0, n_elements), method="BFGS", options={"gtol": 1e-7})
    return heights(found.x)[1]


def at_gamma(rods: Rods, gamma: float) -> Rods:
    """Isotropic bending such that rho S g L^3 / (E I) is gamma."""
    bending = rods.mass[0] * 9.81 * LENGTH**3 / gamma
    return dataclasses.replace(rods, stiffness=np.full_like(rods.stiffness, bending))


def cantilever_tip(gamma: float, n_elements: int) -> np.ndarray:
    helices = straight(n_elements, LENGTH)
    rods = at_gamma(soft_rods(helices, damping=0.05, drag=0.0), gamma)
    # air at rest that brakes as fast as the rod falls
    rods = dataclasses.replace(rods, drag=rods.mass * 20.0)
    state = initial_state(helices)
    relax(rods, state, GRAVITY, 0.01, 1e-9)
    return points_of(helices, state)[0, -1] / LENGTH


@pytest.mark.parametrize(("gamma", "n_elements"), list(TABLE))
def test_heavy_cantilever_is_as_close_to_the_elastica_as_its_elements_allow(gamma: int, n_elements: int) -> None:
    tip = cantilever_tip(gamma, n_elements)
    assert abs(tip[1]) < 1e-9
    error = np.linalg.norm(tip[[0, 2]] - elastica(gamma))
    # 5 %, and the table's second digit
    assert abs(error / TABLE[gamma, n_elements] - 1) < 0.05 + 0.05 / float(f"{TABLE[gamma, n_elements]:e}"[:3])


def test_heavy_cantilever_is_the_planar_energy_minimum() -> None:
    # BFGS stops at a gradient of 1e-7 by differences
    assert np.allclose(cantilever_tip(10, 10)[[0, 2]], planar_minimum(10, 10), rtol=0, atol=3e-6)


def test_error_falls_with_the_square_of_the_element_length() -> None:
    truth = elastica(10.0)
    errors = [np.linalg.norm(cantilever_tip(10.0, n)[[0, 2]] - truth) for n in (5, 10, 20, 40)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (np.abs(orders - 2.0) < 0.1).all()


def flat_strip(n_elements: int, load: float) -> tuple[Helices, Rods]:
    """A strip on edge: stiff in the vertical plane, with q L^3 / sqrt(B C) = load by own weight."""
    helices = straight(n_elements, LENGTH)
    rods = soft_rods(helices, **NO_AIR_OR_LOSS)
    lateral, twist = 1.0, 0.7
    unit = rods.mass[0] * 9.81 * LENGTH**3 / load / np.sqrt(lateral * twist)
    # n1 is horizontal, n2 vertical: q1 bends in the vertical plane, q2 sideways
    return helices, dataclasses.replace(
        rods, stiffness=np.tile(unit * np.array([twist, 1e6, lateral]), (n_elements, 1))
    )


def softest(n_elements: int, load: float) -> float:
    """Smallest eigenvalue of A - df/dq over A, at the strip's (nearly straight) equilibrium."""
    helices, rods = flat_strip(n_elements, load)
    pose = (helices.roots, helices.frames)
    stiffness = (rods.lengths[:, None] * rods.stiffness).ravel()
    q = (generalised_force(rods, *pose, helices.curvatures, GRAVITY).ravel() / stiffness).reshape(-1, 3)
    columns = []
    for k in range(q.size):
        change = np.zeros(q.size)
        change[k] = 1e-4 / LENGTH
        ahead, back = (q + change.reshape(-1, 3), q - change.reshape(-1, 3))
        difference = generalised_force(rods, *pose, ahead, GRAVITY) - generalised_force(rods, *pose, back, GRAVITY)
        columns.append(difference.ravel() / (2 * change[k]))
    scaled = np.stack(columns, axis=1) / np.sqrt(np.outer(stiffness, stiffness))
    return float(np.linalg.eigvalsh(np.eye(q.size) - 0.5 * (scaled + scaled.T))[0])


def test_strip_buckles_sideways_at_prandtls_own_weight() -> None:
    # q L^3 / sqrt(B C) = 12.85 (Prandtl and Michell; Timoshenko and Gere, sec. 6.3, table value)
    critical = brentq(lambda load: softest(20, load), 8.0, 18.0, xtol=1e-3)
    assert abs(critical / 12.85 - 1) < 0.01


@pytest.mark.parametrize(("factor", "buckles"), [(0.9, False), (1.1, True)])
def test_strip_in_motion_buckles_above_that_weight_only(factor: float, buckles: bool) -> None:
    helices, rods = flat_strip(10, 12.85 * factor)
    rods = dataclasses.replace(rods, damping=0.02, drag=rods.mass * 5.0)
    state = initial_state(helices)
    state.curvatures[:, 2] += 0.05 / LENGTH
    stepper = Stepper(rods)
    for _ in range(600):
        stepper.begin(state, state.roots, state.frames, 0.02, GRAVITY, np.zeros((10, 3)))
        stepper.end(state)
    sideways = abs(points_of(helices, state)[0, -1, 1]) / LENGTH
    assert (sideways > 0.1) if buckles else (sideways < 1e-3)


def hanging_ribbon(n_elements: int) -> tuple[Helices, Rods]:
    """A ribbon, naturally curved about both its axes and twisted, clamped aslant; gravity bends and twists it."""
    helices = straight(n_elements, LENGTH, (1.0, 0.4, 0.3))
    helices = dataclasses.replace(helices, curvatures=np.tile([4.0, 6.0, 9.0], (n_elements, 1)))
    rods = soft_rods(helices, damping=0.05, drag=0.0)
    unit = rods.mass[0] * 9.81 * LENGTH**3 / 10.0
    stiffness = np.tile(unit * np.array([0.6, 0.5, 2.0]), (n_elements, 1))
    return helices, dataclasses.replace(rods, stiffness=stiffness, drag=rods.mass * 20.0)


def kirchhoff_tip(helices: Helices, rods: Rods, moment: np.ndarray) -> np.ndarray:
    """Tip of the continuous rod: R' = [R q]x R, M' = -n0 x (weight beyond), M = R K (q - q0), M(L) = 0, by shooting."""
    stiffness, rest, weight = rods.stiffness[0], rods.rest[0], rods.mass[0] * GRAVITY

    def slope(s: float, y: np.ndarray) -> np.ndarray:
        frame = y[3:12].reshape(3, 3)
        omega = frame @ (rest + frame.T @ y[12:] / stiffness)
        turned = np.cross(omega, frame, axisb=0, axisc=0)
        return np.concatenate([frame[:, 0], turned.ravel(), -np.cross(frame[:, 0], weight * (LENGTH - s))])

    def shoot(start: np.ndarray) -> np.ndarray:
        y = np.concatenate([np.zeros(3), helices.frames[0].ravel(), start * unit])
        return solve_ivp(slope, (0.0, LENGTH), y, rtol=1e-9, atol=1e-12).y[:, -1]

    unit = stiffness[0] / LENGTH
    found = root(lambda start: shoot(start)[12:] / unit, moment / unit, tol=1e-9)
    assert found.success
    return shoot(found.x)[:3]


def test_curved_ribbon_bends_and_twists_as_kirchhoffs_rod_does() -> None:
    errors = []
    for n_elements in (10, 20, 40):
        helices, rods = hanging_ribbon(n_elements)
        state = initial_state(helices)
        relax(rods, state, GRAVITY, 0.01, 1e-8)
        tip = points_of(helices, state)[0, -1]
        # far from the shape at rest: the weight matters
        assert np.linalg.norm(tip - points_of(helices, initial_state(helices))[0, -1]) > 0.3 * LENGTH
        if n_elements == 10:
            bent = state.curvatures[0] - rods.rest[0]
            truth = kirchhoff_tip(helices, rods, helices.frames[0] @ (rods.stiffness[0] * bent))
        errors.append(np.linalg.norm(tip - truth) / LENGTH)
    assert errors[0] < 5e-3
    assert np.allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.15)


@pytest.mark.parametrize("pitch_angle", [0.05, 0.3])
def test_hanging_coil_lengthens_as_a_spring(pitch_angle: float) -> None:
    """A coil of radius R: L/2 times the weight times R^2 (cos^2 a / C + sin^2 a / B), from its curved rod's energy."""
    radius, turns, per_turn = 0.005, 12, 6
    coil = 2 * np.pi * radius / np.cos(pitch_angle)
    curvature, torsion = np.cos(pitch_angle) ** 2 / radius, np.cos(pitch_angle) * np.sin(pitch_angle) / radius
    # the axis is down: tangent at the pitch angle below the horizontal, the curvature vector along n2
    tangent = np.array([0.0, np.cos(pitch_angle), -np.sin(pitch_angle)])
    binormal = np.array([0.0, -np.sin(pitch_angle), -np.cos(pitch_angle)])
    frame = np.stack([tangent, np.cross(binormal, tangent), binormal], axis=1)
    elements = turns * per_turn
    helices = Helices(
        roots=np.zeros((1, 3)),
        frames=np.ascontiguousarray(frame[None]),
        offsets=np.array([0, elements], np.int32),
        lengths=np.full(elements, coil / per_turn),
        curvatures=np.tile([torsion, 0.0, curvature], (elements, 1)),
    )
    rods = soft_rods(helices, **NO_AIR_OR_LOSS)
    length, bending, twisting = coil * turns, rods.stiffness[0, 2], rods.stiffness[0, 0]
    compliance = radius**2 * (np.cos(pitch_angle) ** 2 / twisting + np.sin(pitch_angle) ** 2 / bending)
    axial = length * np.sin(pitch_angle)
    # so little weight that the coil lengthens by a thousandth
    gravity = GRAVITY * (1e-3 * axial / (0.5 * rods.mass[0] * 9.81 * length**2 * compliance))
    state = initial_state(helices)
    relax(rods, state, gravity, 100.0, 1e-12)
    before, after = points_of(helices, initial_state(helices))[0, -1], points_of(helices, state)[0, -1]
    # of 1 part in turns: the weight below a section is not on the axis
    assert abs((before[2] - after[2]) / (1e-3 * axial) - 1) < 0.02
