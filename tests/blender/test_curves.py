"""Curves objects against StrandSets: bulk, exact, with attributes, in world space."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import scenes
from mathutils import Euler, Matrix


@pytest.fixture
def ragged():
    """Strands of 2 to 9 points with attributes of every type that is carried."""
    rng = np.random.default_rng(3)
    counts = rng.integers(2, 10, 40)
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    total = int(offsets[-1])
    return scenes.module("backend.types").StrandSet(
        rng.normal(size=(total, 3)).astype(np.float32),
        offsets,
        {"radius": rng.random(total).astype(np.float32), "color": rng.random((total, 4)).astype(np.float32)},
        {
            "hairloom_wisp": rng.integers(0, 9, 40).astype(np.int32),
            "kept": rng.random(40) > 0.5,
            "uv": rng.random((40, 2)).astype(np.float32),
            "tint": rng.random((40, 3)).astype(np.float32),
        },
    )


def test_round_trip_is_exact(ragged):
    curves = scenes.module("bridge.curves")
    obj = curves.new_object("Ragged", ragged, bpy.context.collection)
    back = curves.read_strands(obj)
    assert back.points.tobytes() == ragged.points.tobytes()
    assert back.offsets.tobytes() == ragged.offsets.tobytes()
    for there, here in (
        (back.point_attributes, ragged.point_attributes),
        (back.strand_attributes, ragged.strand_attributes),
    ):
        assert set(there) == set(here)
        for name, array in here.items():
            assert there[name].dtype == array.dtype
            assert there[name].tobytes() == array.tobytes()


def test_strands_survive_saving(ragged, tmp_path):
    curves = scenes.module("bridge.curves")
    curves.new_object("Ragged", ragged, bpy.context.collection)
    scenes.reload(tmp_path)
    back = curves.read_strands(bpy.data.objects["Ragged"])
    assert back.points.tobytes() == ragged.points.tobytes()
    assert back.strand_attributes["hairloom_wisp"].tobytes() == ragged.strand_attributes["hairloom_wisp"].tobytes()


def test_strands_are_poly_curves(ragged):
    obj = scenes.module("bridge.curves").new_object("Ragged", ragged, bpy.context.collection)
    poly = 1
    assert (scenes.values(obj, "curve_type", np.int8) == poly).all()


def test_world_space_is_read():
    points = scenes.wavy_strands(20)
    obj = scenes.groom(points)
    obj.matrix_world = Matrix.LocRotScale((1, 2, 3), Euler((0.3, 0.2, 0.1)), (2, 2, 2))
    bpy.context.view_layer.update()
    expected = points.reshape(-1, 3) @ np.array(obj.matrix_world)[:3, :3].T + np.array([1, 2, 3])
    # float32 positions of about 4 m
    assert np.abs(scenes.module("bridge.curves").read_strands(obj).points - expected).max() < 1e-6


def test_replaced_strands_lie_in_world_space_and_keep_surface_and_material(ragged):
    head = scenes.sphere_head()
    obj = scenes.groom(scenes.wavy_strands(20))
    obj.matrix_world = Matrix.LocRotScale((1, 2, 3), Euler((0.3, 0.2, 0.1)), (2, 2, 2))
    bpy.context.view_layer.update()
    obj.data.surface, obj.data.surface_uv_map = head, "UVMap"
    obj.data.materials.append(bpy.data.materials.new("Mine"))
    curves = scenes.module("bridge.curves")
    curves.replace_strands(obj, ragged)
    assert np.abs(curves.read_strands(obj).points - ragged.points).max() < 2e-6
    assert (obj.data.name, obj.data.surface, obj.data.materials[0].name) == ("Hair", head, "Mine")
    assert len(bpy.data.hair_curves) == 1


def test_a_radius_of_each_strand_reaches_its_points():
    strands = scenes.module("backend.types").StrandSet(
        np.zeros((5, 3), np.float32) + np.arange(5, dtype=np.float32)[:, None],
        np.array([0, 2, 5], np.int32),
        {},
        {"radius": np.array([1.0, 2.0], np.float32)},
    )
    obj = scenes.module("bridge.curves").new_object("Thick", strands, bpy.context.collection)
    assert [point.radius for point in obj.data.points] == [1, 1, 2, 2, 2]


def test_bulk_writes_refuse_any_other_dtype():
    """foreach_set takes float64 as well, 150 times slower: it must not get that far."""
    obj = scenes.groom(scenes.wavy_strands(4))
    attributes = scenes.module("bridge.attributes")
    with pytest.raises(TypeError, match="float64"):
        attributes.write_values(obj.data.position_data, "vector", np.zeros((64, 3)), np.float32, 3)
    with pytest.raises(ValueError, match="63"):
        attributes.write_values(obj.data.position_data, "vector", np.zeros((21, 3), np.float32), np.float32, 3)


def test_a_new_attribute_does_not_lose_the_ones_before():
    """Blender 4.5 invalidates references to attributes when one is added."""
    obj = scenes.groom(scenes.wavy_strands(10))
    curves = scenes.module("bridge.curves")
    for level in range(1, 5):
        curves.write_strand_ints(obj, f"level_{level}", np.full(10, level, np.int32))
    assert [int(scenes.values(obj, f"level_{level}")[0]) for level in range(1, 5)] == [1, 2, 3, 4]


def test_an_attribute_of_another_type_is_replaced():
    obj = scenes.groom(scenes.wavy_strands(10))
    obj.data.attributes.new("hairloom_wisp", "FLOAT", "POINT")
    scenes.module("bridge.curves").write_strand_ints(obj, "hairloom_wisp", np.arange(10, dtype=np.int32))
    assert (obj.data.attributes["hairloom_wisp"].data_type, obj.data.attributes["hairloom_wisp"].domain) == (
        "INT",
        "CURVE",
    )


def test_not_a_number_is_refused():
    points = scenes.wavy_strands(10)
    points[3, 4, 1] = np.nan
    with pytest.raises(scenes.module("backend.errors").InputError, match="NaN"):
        scenes.module("bridge.curves").read_strands(scenes.groom(points))


def test_curves_without_strands_give_none():
    obj = bpy.data.objects.new("Bald", bpy.data.hair_curves.new("Bald"))
    bpy.context.collection.objects.link(obj)
    assert scenes.module("bridge.curves").read_strands(obj).n_strands == 0


def test_attaching_moves_nothing():
    head = scenes.sphere_head()
    head.matrix_world = Matrix.LocRotScale((0.5, 0, 0), Euler((0, 0, 1)), (1, 1, 1))
    obj = scenes.groom()
    bpy.context.view_layer.update()
    curves = scenes.module("bridge.curves")
    before = curves.read_strands(obj).points
    curves.attach(obj, head, "UVMap", np.zeros((300, 2), np.float32))
    bpy.context.view_layer.update()
    assert np.abs(curves.read_strands(obj).points - before).max() < 1e-6
    assert (obj.parent, obj.data.surface, obj.data.surface_uv_map) == (head, head, "UVMap")


def test_fingerprints_tell_inputs_apart():
    fingerprint = scenes.module("bridge.fingerprint").fingerprint
    curves = scenes.module("bridge.curves")
    obj = scenes.groom()
    first = fingerprint({"strands": curves.read_strands(obj), "region": None})
    assert fingerprint({"strands": curves.read_strands(obj), "region": None}) == first
    obj.data.points[77].position.x += 1e-5
    assert fingerprint({"strands": curves.read_strands(obj), "region": None}) != first
