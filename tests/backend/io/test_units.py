"""Units and axes of files."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.io.units import PRESETS, Units

POINTS = np.array([[1.0, 2.0, 3.0], [-4.0, 5.0, 0.5]], dtype=np.float32)


def test_y_up_files_turn_to_z_up():
    x, y, z = POINTS.T
    np.testing.assert_array_equal(Units(1.0, "Y").to_world(POINTS), np.stack([x, -z, y], axis=1))


def test_metres_z_up_is_the_world():
    assert np.array_equal(Units().to_world(POINTS), POINTS) and np.array_equal(Units().rotation, np.eye(3))


def test_a_face_towards_minus_z_looks_along_minus_y():
    units = Units(1.0, "Y", "-Z")
    np.testing.assert_array_equal(
        units.to_world(np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])), [[0, -1, 0], [0, 0, 1]]
    )


def test_every_pair_of_axes_is_a_rotation():
    axes = ("X", "Y", "Z", "-X", "-Y", "-Z")
    for up, forward in itertools.product(axes, ("", *axes)):
        if forward[-1:] == up[-1]:
            continue
        units = Units(0.01, up, forward)
        assert np.linalg.det(units.rotation) == 1.0
        there = units.to_world(POINTS)
        np.testing.assert_allclose(units.from_world(there), POINTS, rtol=3e-7)  # two roundings to float32
        np.testing.assert_allclose(np.linalg.norm(there, axis=1), np.linalg.norm(POINTS, axis=1) * 0.01, rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("cm,y-up", Units(0.01, "Y")),
        ("Z-up", Units()),
        ("m", Units()),
        ("0.0035, y up, -z forward", Units(0.0035, "Y", "-Z")),
        ("dm,+y-up", Units(0.1, "Y")),
        ("-y-up", Units(1.0, "-Y")),
    ],
)
def test_texts_are_understood(text, units):
    assert Units.parse(text) == units


@pytest.mark.parametrize(
    "text", ["", "furlong", "cm,y", "0", "-1", "nan", "inf", "y-up,z-forward,y-forward", "cm;y-up"]
)
def test_other_texts_are_refused(text):
    with pytest.raises(InputError):
        Units.parse(text)


@pytest.mark.parametrize("arguments", [(0.0,), (-1.0,), (float("nan"),), (1.0, "W"), (1.0, "Y", "-Y"), (1.0, "Y", "Q")])
def test_impossible_units_are_refused(arguments):
    with pytest.raises(InputError):
        Units(*arguments)


def test_presets_are_what_they_are_called():
    scales = {"metres": 1.0, "decimetres": 0.1, "centimetres": 0.01, "millimetres": 0.001}
    for name, units in PRESETS.items():
        unit, axis, _ = name.split("_")
        assert units == Units(scales[unit], axis.upper())
