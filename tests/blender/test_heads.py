"""Operators of the Head section: add_head, set_up_head, attach_to_head."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import scenes


def scalp_height(obj) -> float:
    """Lowest z of the scalp's triangles over the ball's radius."""
    head = scenes.module("bridge.mesh").read_head(obj)
    return float(head.vertices[head.triangles[head.scalp]][..., 2].min() / scenes.RADIUS)


# --- add_head


def test_add_head_gives_a_head_with_scalp_and_uvs():
    assert bpy.ops.hairloom.add_head() == {"FINISHED"}
    obj = bpy.context.object
    assert bpy.context.scene.hairloom.head == obj
    head = scenes.module("bridge.mesh").read_head(obj)
    default = scenes.module("backend.geometry.head").default_head()
    assert (head.scalp == default.scalp).mean() > 0.99
    assert head.vertices.tobytes() == default.vertices.tobytes()
    assert obj.data.uv_layers.active is not None


def test_add_head_is_one_undo_step():
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.add_head("EXEC_DEFAULT", True)) == 1


def test_add_head_survives_saving(tmp_path):
    bpy.ops.hairloom.add_head()
    scenes.reload(tmp_path)
    assert bpy.context.scene.hairloom.head.name == "Head"
    assert "Scalp" in bpy.context.scene.hairloom.head.vertex_groups


def test_add_head_wants_object_mode():
    scenes.sphere_head()
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Switch to Object Mode first"):
        bpy.ops.hairloom.add_head()


# --- set_up_head


def test_set_up_head_finds_the_scalp_under_the_hair():
    head = scenes.sphere_head(scalp=False)
    hair = scenes.groom()
    scenes.activate(head)
    assert bpy.ops.hairloom.set_up_head() == {"FINISHED"}
    assert bpy.context.scene.hairloom.head == head
    # the roots of the wavy groom lie between 0.35 and 0.98 of the ball's height; a ring of the ball is 0.13 high
    assert 0.05 < scalp_height(head) < 0.36
    assert len(hair.data.curves) == 300


def test_set_up_head_makes_uvs_where_there_are_none():
    head = scenes.sphere_head(uv=False)
    bpy.ops.hairloom.set_up_head()
    read = scenes.module("bridge.mesh").read_head(head)
    edges = np.diff(read.corner_uv, axis=1)
    areas = np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    assert (areas > 0).all()


def test_set_up_head_keeps_a_scalp_that_is_there_unless_told():
    head = scenes.sphere_head()
    before = scalp_height(head)
    scenes.groom()
    scenes.activate(head)
    bpy.ops.hairloom.set_up_head()
    assert scalp_height(head) == before
    bpy.ops.hairloom.set_up_head(scalp_from="HAIR")
    assert scalp_height(head) != before


def test_set_up_head_takes_the_selected_hair_only():
    head = scenes.sphere_head(scalp=False)
    all_over = scenes.wavy_strands(300)
    all_over[..., 2] *= -1
    scenes.groom(all_over, "Beard")
    hair = scenes.groom()
    scenes.activate(head)
    hair.select_set(True)
    bpy.ops.hairloom.set_up_head()
    assert scalp_height(head) > 0.1


def test_set_up_head_is_one_undo_step():
    head = scenes.sphere_head(scalp=False, uv=False)
    scenes.groom()
    scenes.activate(head)
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.set_up_head("EXEC_DEFAULT", True)) == 1


def test_set_up_head_without_scalp_and_hair_says_what_to_do():
    scenes.sphere_head(scalp=False)
    before = scenes.scene_state()
    with pytest.raises(RuntimeError, match="no vertex group 'Scalp' and there is no hair"):
        bpy.ops.hairloom.set_up_head()
    assert scenes.scene_state() == before


def test_set_up_head_with_an_empty_scalp_says_so():
    head = scenes.sphere_head(scalp=False)
    head.vertex_groups.new(name="Scalp")
    with pytest.raises(RuntimeError, match="no face of 'Ball' is in 'Scalp'"):
        bpy.ops.hairloom.set_up_head()


def test_set_up_head_wants_a_mesh():
    scenes.groom()
    with pytest.raises(RuntimeError, match="Select the mesh that is to be the head"):
        bpy.ops.hairloom.set_up_head()


# --- attach_to_head


def root_uv_error(hair, head) -> float:
    """Largest distance between the roots and where their surface coordinates say they are, metres."""
    read = scenes.module("bridge.mesh").read_head(head)
    uv = scenes.values(hair, "surface_uv_coordinate", np.float32, 2, "vector")
    roots = scenes.module("bridge.curves").read_strands(hair).roots
    flat = np.concatenate([read.corner_uv, np.zeros((*read.corner_uv.shape[:2], 1), np.float32)], axis=2)
    surface = scenes.module("backend.geometry.head").HeadSurface(
        scenes.module("backend.types").Head(
            np.ascontiguousarray(flat.reshape(-1, 3)),
            np.arange(flat.shape[0] * 3, dtype=np.int32).reshape(-1, 3),
            read.scalp,
            read.corner_uv,
        )
    )
    _, triangle, barycentric = surface.closest_points(np.concatenate([uv, np.zeros((len(uv), 1))], axis=1))
    places = np.einsum("nk,nkc->nc", barycentric, read.vertices[read.triangles[triangle]])
    return float(np.linalg.norm(places - roots, axis=1).max())


def test_attaching_writes_where_the_roots_are():
    hair, head = scenes.groom_on_head()
    before = scenes.positions(hair)
    assert bpy.ops.hairloom.attach_to_head() == {"FINISHED"}
    assert (hair.data.surface, hair.data.surface_uv_map, hair.parent) == (head, "UVMap", head)
    assert (scenes.positions(hair) == before).all()
    # the roots lie on the ball, its facets up to 0.3 mm within
    assert root_uv_error(hair, head) < 5e-4


def test_attaching_with_snap_puts_the_roots_on_the_surface():
    hair, _head = scenes.groom_on_head()
    lifted = scenes.positions(hair) * 1.1
    hair.data.position_data.foreach_set("vector", lifted.ravel())
    bpy.ops.hairloom.attach_to_head(snap=True)
    roots = scenes.module("bridge.curves").read_strands(hair).roots
    assert np.abs(np.linalg.norm(roots, axis=1) - scenes.RADIUS).max() < 5e-4
    # strands move as a whole
    shape = np.diff(scenes.positions(hair).reshape(300, -1, 3), axis=1)
    assert np.abs(shape - np.diff(lifted.reshape(300, -1, 3), axis=1)).max() < 1e-6


def test_blender_itself_finds_the_attached_roots():
    """Blender's own operator moves the roots to where the surface coordinates say: nowhere."""
    hair, _head = scenes.groom_on_head()
    bpy.ops.hairloom.attach_to_head(snap=True)
    before = scenes.positions(hair)
    scenes.activate(hair)
    bpy.ops.curves.snap_curves_to_surface(attach_mode="DEFORM")
    assert np.abs(scenes.positions(hair) - before).max() < 1e-5


def test_attaching_is_one_undo_step():
    scenes.groom_on_head()
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.attach_to_head("EXEC_DEFAULT", True)) == 1


def test_attaching_to_a_head_without_uvs_says_what_to_do():
    head = scenes.sphere_head(uv=False)
    bpy.context.scene.hairloom.head = head
    scenes.groom()
    before = scenes.scene_state()
    with pytest.raises(RuntimeError, match="no UV map, which attached hair needs; run Set Up Head"):
        bpy.ops.hairloom.attach_to_head()
    assert scenes.scene_state() == before


def test_attaching_wants_a_head_and_a_groom():
    with pytest.raises(RuntimeError, match=r"Select a groom \(hair Curves\)"):
        bpy.ops.hairloom.attach_to_head()
    scenes.groom()
    with pytest.raises(RuntimeError, match="Choose a head in the Head panel"):
        bpy.ops.hairloom.attach_to_head()


def test_a_head_that_was_deleted_is_not_taken():
    _hair, head = scenes.groom_on_head()
    bpy.context.view_layer.objects.active = bpy.data.objects["Hair"]
    bpy.context.collection.objects.unlink(head)
    with pytest.raises(RuntimeError, match="Choose a head"):
        bpy.ops.hairloom.attach_to_head()
