"""Strokes of the comb, seen in a view that the tests make up: in the background no view of Blender has a matrix."""

from __future__ import annotations

import json

import numpy as np
import pytest
import scenes

WIDTH = HEIGHT = 600.0
REACH = 0.25  # metres that the view shows to each side


def front_view() -> list[list[float]]:
    """World to clip space seen along +y without perspective: x to the right, z up, 0.25 m to each side."""
    return [[1 / REACH, 0, 0, 0], [0, 0, 1 / REACH, 0], [0, 1, 0, 0], [0, 0, 0, 1]]


def stroke_values(groom, start, end, steps: int = 10, **params) -> dict:
    """A straight stroke between two places (x, z) in metres."""
    places = np.linspace(start, end, steps) / REACH * WIDTH / 2 + WIDTH / 2
    samples = [[x, y, 1.0] for x, y in places.tolist()]
    return {
        "params": {"radius": 60.0, **params},
        "view": {"matrix": front_view(), "width": WIDTH, "height": HEIGHT},
        "frame": [list(row) for row in groom.matrix_world],
        "samples": samples,
    }


def across(groom, **params) -> str:
    """A stroke over the front of the hair's top, to the right."""
    return json.dumps(stroke_values(groom, (-0.04, 0.12), (0.06, 0.12), **params))


def refused(run, match: str) -> None:
    before = scenes.scene_state()
    with pytest.raises(RuntimeError, match=match) as caught:
        run()
    assert str(caught.value).strip().count("\n") == 0
    assert scenes.scene_state() == before
