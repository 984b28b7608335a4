"""Operator clean_up."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import scenes


@pytest.fixture
def dirty():
    """The wavy groom with strands that must not stay: two doubled, one far away, one of no length."""
    _, head = scenes.groom_on_head()
    points = scenes.wavy_strands()
    spoiled = np.concatenate([points, points[:2], points[2:3] + 5.0, np.repeat(points[3:4, :1], 16, axis=1)])
    bpy.data.hair_curves.remove(bpy.data.hair_curves["Hair"])
    hair = scenes.groom(spoiled)
    hair.data.attributes.new("kept", "INT", "CURVE").data.foreach_set("value", np.arange(304, dtype=np.int32))
    return hair, head


def test_bad_strands_go_and_good_ones_stay(dirty):
    hair, _head = dirty
    bpy.context.scene.hairloom.head = dirty[1]
    assert bpy.ops.hairloom.clean_up() == {"FINISHED"}
    kept = scenes.values(hair, "kept")
    assert len(hair.data.curves) == len(kept) == 300
    assert (np.sort(kept) == np.arange(300)).all()
    assert (hair.name, hair.data.name) == ("Hair", "Hair")


def test_clean_up_is_one_undo_step(dirty):
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.clean_up("EXEC_DEFAULT", True)) == 1


def test_a_clean_groom_stays_as_it_is():
    hair, _ = scenes.groom_on_head()
    before = scenes.positions(hair)
    bpy.ops.hairloom.clean_up()
    # the roots are on the ball, its facets up to 0.4 mm within: they are snapped by that much
    assert np.abs(scenes.positions(hair) - before).max() < 4.3e-4


def test_clean_up_wants_a_head():
    scenes.groom()
    with pytest.raises(RuntimeError, match="Choose a head"):
        bpy.ops.hairloom.clean_up()
