"""Energies and generalised forces: finite differences, sums over parts, bad input."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from dense_reference import DenseRod
from hairloom.errors import InputError
from hairloom.rods.energies import (
    dissipation,
    elastic,
    generalised_force,
    gravity_potential,
    kinetic,
    pulled_back,
    quadrature_points,
)
from hairloom.rods.material import PRESETS, MaterialParams, section_stiffness
from hairloom.rods.model import make_rods
from rod_cases import GRAVITY, random_helices, random_motion, soft_rods

HELICES = random_helices([3, 1, 6], curvature=15.0)
RODS = soft_rods(HELICES)
STATE = random_motion(RODS, HELICES)
POSE = (STATE.roots, STATE.frames)


def test_generalised_force_is_the_slope_of_the_potential() -> None:
    force = generalised_force(RODS, *POSE, STATE.curvatures, GRAVITY)
    step = 1e-2
    for element in range(RODS.n_elements):
        for axis in range(3):
            change = np.zeros_like(STATE.curvatures)
            change[element, axis] = step
            ahead, back = (
                gravity_potential(RODS, *POSE, STATE.curvatures + sign * change, GRAVITY).sum() for sign in (1, -1)
            )
            slope = -(ahead - back) / (2 * step)
            assert np.isclose(force[element, axis], slope, rtol=1e-5, atol=1e-7 * np.abs(force).max())


def test_forces_are_pulled_back_by_the_dense_jacobian() -> None:
    forces = np.random.default_rng(0).normal(size=(RODS.n_elements, 3, 3))
    result = pulled_back(RODS, *POSE, STATE.curvatures, forces)
    points = quadrature_points(RODS, *POSE, STATE.curvatures)
    for s in range(RODS.n_strands):
        at = slice(RODS.offsets[s], RODS.offsets[s + 1])
        rod = DenseRod(STATE.roots[s], STATE.frames[s], RODS.lengths[at], STATE.curvatures[at])
        places, _, jacobians = rod.quadrature()
        expected = np.einsum("pik,pi->k", jacobians, forces[at].reshape(-1, 3)).reshape(-1, 3)
        assert np.allclose(points[at].reshape(-1, 3), places, rtol=0, atol=1e-14)
        assert np.allclose(result[at], expected, rtol=1e-11, atol=1e-12 * np.abs(expected).max())


def test_energies_of_a_rigid_motion_and_of_a_bend() -> None:
    masses = np.add.reduceat(RODS.mass * RODS.lengths, RODS.offsets[:-1])
    moving = np.broadcast_to(np.array([3.0, 0.0, 4.0]), STATE.velocities.shape)
    assert np.allclose(kinetic(RODS, moving), 0.5 * masses * 25.0)
    change = np.tile([1.0, 2.0, 3.0], (RODS.n_elements, 1))
    expected = np.add.reduceat(RODS.lengths * (RODS.stiffness @ [1.0, 4.0, 9.0]), RODS.offsets[:-1])
    assert np.allclose(elastic(RODS, RODS.rest + change), 0.5 * expected)
    assert np.allclose(dissipation(RODS, change), RODS.damping * expected)
    lifted = gravity_potential(RODS, STATE.roots + np.array([0.0, 0.0, 2.0]), STATE.frames, STATE.curvatures, GRAVITY)
    assert np.allclose(lifted - gravity_potential(RODS, *POSE, STATE.curvatures, GRAVITY), masses * 9.81 * 2.0)


def test_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match="curvatures must have shape"):
        generalised_force(RODS, *POSE, STATE.curvatures[1:], GRAVITY)
    with pytest.raises(InputError, match="forces must be float64"):
        pulled_back(RODS, *POSE, STATE.curvatures, np.zeros((RODS.n_elements, 3, 3), np.float32))  # type: ignore[arg-type]


def test_wisps_have_more_mass_stiffness_and_drag() -> None:
    hairs = np.array([1.0, 10.0, 100.0])
    material = MaterialParams(cohesion=0.5, radius_major=5e-5, radius_minor=3e-5)
    rods, counts = make_rods(HELICES, material, hairs=hairs, radius=0.002), HELICES.element_counts
    each = np.repeat(hairs, counts)
    assert np.allclose(rods.mass, each * 1300.0 * np.pi * 5e-5 * 3e-5)
    assert np.allclose(rods.stiffness, each[:, None] ** 1.5 * section_stiffness(material))
    assert np.allclose(rods.drag, each**0.75 * material.drag)
    assert (rods.radius == 0.002).all() and (rods.friction == material.friction).all()
    with pytest.raises(InputError, match="hairs of a guide is 0"):
        make_rods(HELICES, material, hairs=hairs * 0.0)
    with pytest.raises(InputError, match="radius of the rods is -1"):
        make_rods(HELICES, material, radius=-1.0)
    with pytest.raises(InputError, match="damping of the rods is"):
        dataclasses.replace(rods, damping=float("nan"))


def test_stiffness_of_sections() -> None:
    # a round section: E pi a^4 / 4, and the torsion of a circle G pi a^4 / 2
    round_hair = MaterialParams(young=2e9, poisson=0.3, radius_major=1e-4, radius_minor=1e-4)
    twist, first, second = section_stiffness(round_hair)
    assert np.isclose(first, 2e9 * np.pi * 1e-16 / 4) and np.isclose(second, first)
    assert np.isclose(twist, 2e9 / 2.6 * np.pi * 1e-16 / 2)
    # an oval bends about its long axis first
    _, first, second = section_stiffness(PRESETS["wavy"])
    assert np.isclose(second / first, (4.5 / 3.0) ** 2)
    assert set(PRESETS) == {"fine", "thick", "wavy", "wet"}
    for bad in ({"young": -1.0}, {"density": float("nan")}, {"radius_minor": 0.0}, {"damping": -0.1}, {"poisson": 0.7}):
        with pytest.raises(InputError, match="it must be"):
            MaterialParams(**bad)
