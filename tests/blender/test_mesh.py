"""Mesh objects against Heads."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import scenes
from mathutils import Matrix


def volume(head) -> float:
    """Signed: above 0 when the triangles are counter-clockwise seen from outside."""
    a, b, c = np.moveaxis(head.vertices[head.triangles].astype(np.float64), 1, 0)
    return float(np.einsum("fc,fc->f", a, np.cross(b, c)).sum() / 6)


def test_a_head_is_read_in_world_space_with_its_scalp():
    obj = scenes.sphere_head()
    obj.location = (1, 2, 3)
    bpy.context.view_layer.update()
    head = scenes.module("bridge.mesh").read_head(obj)
    assert np.abs(np.linalg.norm(head.vertices - [1, 2, 3], axis=1) - scenes.RADIUS).max() < 1e-6
    # all corners of a scalp triangle are in the group, so they lie above its lower edge, and no other triangle's do
    lowest = head.vertices[head.triangles][..., 2].min(axis=1) - 3
    assert (head.scalp == (lowest > 0.02)).all()
    assert 0.3 < head.scalp.mean() < 0.5
    assert volume(head) > 0


def test_corner_uvs_are_those_of_the_loops():
    obj = scenes.sphere_head()
    mesh = obj.data
    head = scenes.module("bridge.mesh").read_head(obj)
    mesh.calc_loop_triangles()
    for index in (0, 100, len(mesh.loop_triangles) - 1):
        triangle = mesh.loop_triangles[index]
        expected = [tuple(mesh.uv_layers.active.data[loop].uv) for loop in triangle.loops]
        assert np.allclose(head.corner_uv[index], expected)


def test_a_mirrored_head_still_faces_outwards():
    obj = scenes.sphere_head()
    obj.scale = (-1, 1, 1)
    bpy.context.view_layer.update()
    assert volume(scenes.module("bridge.mesh").read_head(obj)) > 0


def test_modifiers_count():
    obj = scenes.sphere_head()
    mesh = scenes.module("bridge.mesh")
    plain = mesh.read_head(obj)
    obj.modifiers.new("Subdivision", "SUBSURF").levels = 1
    finer = mesh.read_head(obj)
    assert len(finer.triangles) > 3 * len(plain.triangles)
    assert abs(finer.scalp.mean() - plain.scalp.mean()) < 0.05
    assert len(mesh.read_head(obj, evaluated=False).triangles) == len(plain.triangles)


def test_a_face_attribute_marks_a_region():
    obj = scenes.sphere_head(scalp=False)
    attribute = obj.data.attributes.new("Top", "BOOLEAN", "FACE")
    attribute.data.foreach_set("value", [polygon.center.z > 0.05 for polygon in obj.data.polygons])
    mesh = scenes.module("bridge.mesh")
    region = mesh.read_region(obj, "Top")
    head = mesh.read_head(obj, "Top")
    assert (region == head.scalp).all()
    assert 0.1 < region.mean() < 0.4
    assert mesh.has_region(obj, "Top")
    assert not mesh.has_region(obj, "Scalp")


@pytest.mark.parametrize("name", ["Nowhere", "Empty"])
def test_a_region_that_is_not_there_is_refused(name):
    obj = scenes.sphere_head()
    obj.vertex_groups.new(name="Empty")
    with pytest.raises(scenes.module("backend.errors").InputError, match=name):
        scenes.module("bridge.mesh").read_region(obj, name)


def test_a_mesh_without_faces_is_refused():
    obj = bpy.data.objects.new("Nothing", bpy.data.meshes.new("Nothing"))
    bpy.context.collection.objects.link(obj)
    with pytest.raises(scenes.module("backend.errors").InputError, match="'Nothing' has no faces"):
        scenes.module("bridge.mesh").read_head(obj)


def test_a_head_object_gives_its_head_back():
    head = scenes.module("backend.geometry.analytic_heads").sphere_head(0.1, n_rings=16)
    mesh = scenes.module("bridge.mesh")
    obj = mesh.new_head_object("New", head, bpy.context.collection)
    bpy.context.view_layer.update()
    back = mesh.read_head(obj)
    assert back.vertices.tobytes() == head.vertices.tobytes()
    assert back.triangles.tobytes() == head.triangles.tobytes()
    assert back.corner_uv.tobytes() == head.corner_uv.tobytes()
    assert back.scalp.tobytes() == head.scalp.tobytes()


def test_polygons_that_an_unwrap_cuts_get_uvs_of_their_own():
    """xatlas works on triangles and may cut a quad along its diagonal."""
    obj = scenes.sphere_head(uv=False)
    mesh = scenes.module("bridge.mesh")
    head = mesh.read_head(obj, evaluated=False)
    rng = np.random.default_rng(0)
    corner_uv = np.repeat(rng.random((len(head.triangles), 1, 2)), 3, axis=1).astype(np.float32)
    corner_uv += np.array([[0, 0], [0.001, 0], [0, 0.001]], np.float32)
    mesh.write_uv(obj, corner_uv)
    written = mesh.read_head(obj, evaluated=False)
    corners = written.vertices[written.triangles]
    # every triangle keeps an area in the texture, also the two of a cut quad, and quads do not overlap
    first, second = written.corner_uv[:, 1] - written.corner_uv[:, 0], written.corner_uv[:, 2] - written.corner_uv[:, 0]
    areas = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    assert areas.min() > 1e-9
    centres = written.corner_uv.mean(axis=1)
    assert len(np.unique(centres.round(6), axis=0)) == len(corners)
    assert obj.data.uv_layers.active.name == "UVMap"


def test_the_scalp_follows_moves_of_the_object():
    obj = scenes.sphere_head()
    mesh = scenes.module("bridge.mesh")
    before = mesh.read_head(obj).scalp
    obj.matrix_world = Matrix.Rotation(1.0, 4, "X")
    bpy.context.view_layer.update()
    assert (mesh.read_head(obj).scalp == before).all()
