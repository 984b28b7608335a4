"""Head motion for the command line, read from an Alembic file that Blender wrote."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import scenes


@pytest.fixture
def exported(tmp_path):
    """An .abc of a head that turns on a rig that moves, and its world matrices (12, 4, 4)."""
    if "alembic_export" not in dir(bpy.ops.wm):
        pytest.skip("this Blender has no Alembic")
    bpy.ops.object.empty_add()
    rig = bpy.context.object
    rig.name = "Rig"
    head = scenes.sphere_head("Head")
    head.parent, head.location = rig, (0.1, 0.2, 0.3)
    for frame in (1, 12):
        rig.rotation_euler, rig.location = (0.1 * frame, 0.05 * frame, 0.2 * frame), (0.1 * frame, 0, 0.3)
        head.rotation_euler = (0, 0.1 * frame, 0)
        for item, path in ((rig, "rotation_euler"), (rig, "location"), (head, "rotation_euler")):
            item.keyframe_insert(path, frame=frame)
    matrices = []
    for frame in range(1, 13):
        bpy.context.scene.frame_set(frame)
        matrices.append(np.array(head.matrix_world))
    path = tmp_path / "head.abc"
    bpy.ops.wm.alembic_export(filepath=str(path), start=1, end=12)
    return path, np.array(matrices)


def test_the_motion_is_blenders(exported):
    path, matrices = exported
    found = scenes.module("backend.io.alembic_motion").read_motion(path, "Head")
    # Blender's matrices are float32
    np.testing.assert_allclose(found, matrices, atol=1e-6)


def test_an_object_must_be_named_where_several_move(exported):
    read_motion = scenes.module("backend.io.alembic_motion").read_motion
    errors = scenes.module("backend.errors")
    with pytest.raises(errors.FileError, match="Head, Rig"):
        read_motion(exported[0])
    with pytest.raises(errors.FileError, match="one object 'Nobody'"):
        read_motion(exported[0], "Nobody")
