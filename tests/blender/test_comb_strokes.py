"""Recorded strokes: operators save_strokes, play_strokes and clear_strokes."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import scenes
from combed import across, refused


@pytest.fixture
def hair():
    return scenes.groom_on_head()[0]


@pytest.fixture
def clustered(hair):
    assert bpy.ops.hairloom.cluster_wisps() == {"FINISHED"}
    return hair


def test_recorded_strokes_are_saved_and_played_to_the_same_bytes(clustered, tmp_path):
    bpy.context.scene.hairloom.comb.record = True
    before = scenes.positions(clustered)
    for mode in ("comb", "lift"):
        bpy.ops.hairloom.comb(stroke=across(clustered, mode=mode))
    done = scenes.positions(clustered).tobytes()
    path = str(tmp_path / "strokes.json")
    assert bpy.ops.hairloom.save_strokes(filepath=path) == {"FINISHED"}
    assert bpy.ops.hairloom.clear_strokes() == {"FINISHED"}
    assert not bpy.ops.hairloom.save_strokes.poll()
    scenes.module("bridge.attributes").write_values(clustered.data.position_data, "vector", before, np.float32, 3)
    scenes.module("comb_cache").kept.clear()
    assert bpy.ops.hairloom.play_strokes(filepath=path) == {"FINISHED"}
    assert scenes.positions(clustered).tobytes() == done
    assert len(scenes.module("recording").strokes(clustered.data)) == 2


def test_playing_strokes_is_one_undo_step(clustered, tmp_path):
    path = strokes_file(clustered, tmp_path, [across(clustered), across(clustered, mode="lift")])
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.play_strokes("EXEC_DEFAULT", True, filepath=path)) == 1


def strokes_file(groom, tmp_path, texts) -> str:
    strokes = scenes.module("backend.editing.strokes")
    path = tmp_path / "strokes.json"
    made = tuple(strokes.stroke_from_json(text) for text in texts)
    strokes.write_strokes(path, strokes.StrokeFile(len(groom.data.curves), len(groom.data.points), made))
    return str(path)


def test_undo_takes_the_last_stroke_out_of_the_record(clustered):
    recording = scenes.module("recording")
    bpy.context.scene.hairloom.comb.record = True
    bpy.ops.ed.undo_push(message="before")
    for mode in ("comb", "lift"):
        bpy.ops.hairloom.comb("EXEC_DEFAULT", True, stroke=across(clustered, mode=mode))
        clustered = bpy.data.objects["Hair"]
    assert len(recording.strokes(clustered.data)) == 2
    bpy.ops.ed.undo()
    assert len(recording.strokes(bpy.data.objects["Hair"].data)) == 1


def test_the_record_survives_saving_and_starts_anew_with_other_strands(clustered, tmp_path):
    recording = scenes.module("recording")
    bpy.context.scene.hairloom.comb.record = True
    bpy.ops.hairloom.comb(stroke=across(clustered))
    scenes.reload(tmp_path)
    groom = bpy.data.objects["Hair"]
    assert len(recording.strokes(groom.data)) == 1
    groom.data.remove_curves(indices=[0])
    scenes.activate(groom)
    bpy.ops.hairloom.comb(stroke=across(groom))
    assert len(recording.strokes(groom.data)) == 1
    assert recording.size(groom.data) == (299, 299 * 16)


def test_a_stroke_that_is_not_recorded_leaves_no_trace(clustered):
    bpy.ops.hairloom.comb(stroke=across(clustered))
    assert scenes.module("recording").strokes(clustered.data) == []
    assert list(clustered.data.keys()) == []


@pytest.mark.parametrize("collide", [True, False])
def test_the_command_line_gives_the_same_bytes(clustered, tmp_path, collide):
    pytest.importorskip("tqdm", reason="the command line's own packages are not in Blender")
    groom, head, out = str(tmp_path / "hair.npz"), tmp_path / "head.obj", tmp_path / "combed.npz"
    assert bpy.ops.hairloom.export_groom(filepath=groom) == {"FINISHED"}
    write_obj(head, scenes.module("bridge.mesh").read_head(bpy.context.scene.hairloom.head))
    settings = bpy.context.scene.hairloom.comb
    settings.record, settings.collide = True, collide
    for mode in ("comb", "lift", "smooth"):
        bpy.ops.hairloom.comb(stroke=across(clustered, mode=mode))
    strokes = str(tmp_path / "strokes.json")
    bpy.ops.hairloom.save_strokes(filepath=strokes)
    command = ["comb", groom, strokes, str(out), "--head", str(head), "--head-units", "m,z-up"]
    assert scenes.module("backend.cli").main([*command, *([] if collide else ["--no-collide"])]) == 0
    combed = scenes.module("backend.io.strands").read_strands(out)
    assert combed.points.tobytes() == scenes.positions(clustered).tobytes()


def write_obj(path, head) -> None:
    """To the bit: the shortest decimals of float32 give the same float32 back."""
    lines = [f"v {x} {y} {z}" for x, y, z in head.vertices]
    lines += [f"f {a} {b} {c}" for a, b, c in (head.triangles + 1).tolist()]
    path.write_text("\n".join(lines) + "\n")


def test_strokes_of_another_groom_are_refused(clustered, tmp_path):
    path = strokes_file(clustered, tmp_path, [across(clustered)])
    clustered.data.remove_curves(indices=[0])
    refused(lambda: bpy.ops.hairloom.play_strokes(filepath=path), "recorded on a groom of 300 strands")
    refused(lambda: bpy.ops.hairloom.play_strokes(filepath=str(tmp_path / "none.json")), "none.json")


def test_a_stroke_that_fails_takes_back_those_before_it(clustered, tmp_path):
    path = strokes_file(clustered, tmp_path, [across(clustered), across(clustered, level=3)])
    refused(lambda: bpy.ops.hairloom.play_strokes(filepath=path), "level is 3")
