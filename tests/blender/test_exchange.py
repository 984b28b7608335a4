"""Operators import_groom and export_groom."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import scenes


@pytest.fixture
def hair():
    return scenes.groom(scenes.wavy_strands(50))


def imported(path, **options):
    assert bpy.ops.hairloom.import_groom(filepath=str(path), **options) == {"FINISHED"}
    return bpy.context.object


@pytest.mark.parametrize("suffix", [".hair", ".data", ".tfx", ".ply", ".obj", ".npz"])
def test_what_is_exported_is_imported(hair, tmp_path, suffix):
    path = tmp_path / f"hair{suffix}"
    before = scenes.positions(hair)
    assert bpy.ops.hairloom.export_groom(filepath=str(path)) == {"FINISHED"}
    back = imported(path)
    assert (back.name, len(back.data.curves)) == ("hair", 50)
    # text formats keep 6 digits or more of 0.2 m
    assert np.abs(scenes.positions(back) - before).max() < 1e-6
    assert back.data.materials[0].name == "Hairloom Hair"


@pytest.mark.parametrize("suffix", [".abc", ".usd", ".usdc"])
def test_blenders_own_formats(hair, tmp_path, suffix):
    if not getattr(bpy.app.build_options, "alembic" if suffix == ".abc" else "usd"):
        pytest.skip("this Blender was built without it")
    path = tmp_path / f"hair{suffix}"
    before = scenes.positions(hair)
    bpy.ops.hairloom.export_groom(filepath=str(path))
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert bpy.context.object == hair
    bpy.data.objects.remove(hair)
    back = imported(path)
    world = scenes.module("bridge.curves").read_strands(back).points
    assert np.abs(world - before).max() < 1e-5
    assert [o.name for o in bpy.data.objects if o.type != "CURVES"] == []


def test_without_alembic_the_message_says_so(hair, tmp_path, monkeypatch):
    exchange = scenes.module("exchange")
    monkeypatch.setattr(exchange, "is_built_with", lambda name: False)
    with pytest.raises(RuntimeError, match=r"this Blender was built without Alembic; use \.npz"):
        bpy.ops.hairloom.export_groom(filepath=str(tmp_path / "hair.abc"))
    with pytest.raises(RuntimeError, match="this Blender was built without USD"):
        bpy.ops.hairloom.import_groom(filepath=str(tmp_path / "hair.usd"))


def test_unit_and_axes(hair, tmp_path):
    path = tmp_path / "hair.npz"
    before = scenes.positions(hair)
    bpy.ops.hairloom.export_groom(filepath=str(path))
    centimetres = imported(path, unit="cm", up_axis="Y")
    assert np.allclose(scenes.positions(centimetres), 0.01 * before[:, [0, 2, 1]] * [1, -1, 1], atol=1e-7)
    custom = imported(path, unit="CUSTOM", custom_unit=0.5)
    assert np.allclose(scenes.positions(custom), 0.5 * before, atol=1e-7)


def test_export_is_in_world_space_and_import_takes_it_back(hair, tmp_path):
    hair.location.x = 2.0
    bpy.context.view_layer.update()
    path = tmp_path / "hair.npz"
    bpy.ops.hairloom.export_groom(filepath=str(path))
    assert abs(scenes.positions(imported(path))[:, 0].mean() - 2.0) < 0.05


def test_import_attaches_to_the_chosen_head(hair, tmp_path):
    path = tmp_path / "hair.npz"
    bpy.ops.hairloom.export_groom(filepath=str(path))
    bpy.context.scene.hairloom.head = scenes.sphere_head()
    attached = imported(path)
    assert attached.data.surface.name == "Ball"
    assert imported(path, attach=False).data.surface is None


def test_import_is_one_undo_step(hair, tmp_path):
    path = str(tmp_path / "hair.npz")
    bpy.ops.hairloom.export_groom(filepath=path)
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.import_groom("EXEC_DEFAULT", True, filepath=path)) == 1


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("missing.hair", None, "no such file"),
        ("short.hair", b"HAIR\x01\x00", "short.hair"),
        ("picture.png", b"not hair", "no known strand format"),
        ("empty.npz", b"", "empty.npz"),
        ("missing.abc", None, "no such file|built without Alembic"),
    ],
)
def test_files_that_cannot_be_read_change_nothing(tmp_path, name, content, words):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    scenes.sphere_head()
    before = scenes.scene_state()
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.hairloom.import_groom(filepath=str(path))
    assert scenes.scene_state() == before


def test_import_beside_a_head_without_uvs_does_not_attach(hair, tmp_path):
    path = tmp_path / "hair.npz"
    bpy.ops.hairloom.export_groom(filepath=str(path))
    bpy.context.scene.hairloom.head = scenes.sphere_head(uv=False)
    assert imported(path).data.surface is None


def test_a_failed_export_keeps_the_old_file(hair, tmp_path):
    folder = tmp_path / "hair.npz"
    folder.mkdir()
    with pytest.raises(RuntimeError, match="cannot write"):
        bpy.ops.hairloom.export_groom(filepath=str(folder))
    with pytest.raises(RuntimeError, match="cannot write"):
        bpy.ops.hairloom.export_groom(filepath=str(tmp_path / "nowhere" / "hair.hair"))
    assert list(tmp_path.iterdir()) == [folder]
    assert list(folder.iterdir()) == []


def test_export_wants_a_groom():
    scenes.sphere_head()
    with pytest.raises(RuntimeError, match="Select a groom"):
        bpy.ops.hairloom.export_groom(filepath="/tmp/never.npz")
