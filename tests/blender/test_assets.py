"""The content that ships: asset library and starter grooms."""

from __future__ import annotations

import bpy
import pytest
import scenes


@pytest.fixture(scope="module")
def grooms() -> list[str]:
    names = [name for name, _ in scenes.module("assets").starter_grooms()]
    if not names:
        pytest.skip("no .blend files in blend_templates; make_grooms.py makes them")
    return names


def test_the_asset_library_is_registered_once():
    assets = scenes.module("assets")
    assets.register()
    libraries = bpy.context.preferences.filepaths.asset_libraries
    paths = [library.path for library in libraries if library.name == "Hairloom"]
    assert len(paths) == 1
    assert paths[0].rstrip("/\\") == assets.folder()


def test_a_starter_groom_arrives_with_its_head(grooms):
    assert bpy.ops.hairloom.add_starter_groom(groom=grooms[0]) == {"FINISHED"}
    hair = bpy.context.object
    assert (hair.type, hair.asset_data) == ("CURVES", None)
    assert len(hair.data.curves) >= 10_000
    head = bpy.context.scene.hairloom.head
    assert head == hair.data.surface == hair.parent
    assert head.name in bpy.context.view_layer.objects
    assert scenes.module("bridge.mesh").read_head(head).scalp.any()


def test_another_starter_groom_goes_onto_the_same_head(grooms):
    bpy.ops.hairloom.add_starter_groom(groom=grooms[0])
    head = bpy.context.scene.hairloom.head
    bpy.ops.hairloom.add_starter_groom(groom=grooms[-1])
    assert bpy.context.object.data.surface == head == bpy.context.scene.hairloom.head
    assert [obj.name for obj in bpy.data.objects if obj.type == "MESH"] == [head.name]
    assert len(bpy.data.meshes) == 1


def test_a_starter_groom_goes_onto_a_head_of_the_users(grooms):
    head = scenes.sphere_head()
    bpy.context.scene.hairloom.head = head
    bpy.ops.hairloom.add_starter_groom(groom=grooms[0])
    assert bpy.context.object.data.surface == head


def test_adding_is_one_undo_step(grooms):
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.add_starter_groom("EXEC_DEFAULT", True, groom=grooms[0])) == 1


def test_a_copy_without_starter_grooms_says_so(monkeypatch):
    operator = scenes.module("ops.add_starter_groom")
    monkeypatch.setattr(operator, "_ITEMS", [])
    monkeypatch.setattr(operator.assets, "starter_grooms", lambda: ())
    with pytest.raises(RuntimeError, match="no starter grooms came with this copy"):
        bpy.ops.hairloom.add_starter_groom()
