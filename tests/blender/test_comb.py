"""Operator comb: its bytes, its session and collider, the selection, what it refuses, and its tool."""

from __future__ import annotations

import json

import bpy
import numpy as np
import pytest
import scenes
from combed import HEIGHT, WIDTH, across, front_view, refused, stroke_values


@pytest.fixture
def hair():
    return scenes.groom_on_head()[0]


@pytest.fixture
def clustered(hair):
    assert bpy.ops.hairloom.cluster_wisps() == {"FINISHED"}
    return hair


def roots(groom) -> np.ndarray:
    return scenes.positions(groom)[::16]


def lengths(positions: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(positions.reshape(-1, 16, 3), axis=1), axis=2).sum(axis=1)


def test_a_stroke_moves_the_hair_under_it_and_no_root(clustered):
    before = scenes.positions(clustered)
    assert bpy.ops.hairloom.comb(stroke=across(clustered)) == {"FINISHED"}
    after = scenes.positions(clustered)
    moved = np.linalg.norm(after - before, axis=1) > 1e-4
    assert 0.05 < moved.mean() < 0.9
    assert (after - before)[moved, 0].mean() > 0.001  # to the right, as the brush went
    assert (roots(clustered) == before[::16]).all()
    # the 0.5 %
    assert np.abs(lengths(after) / lengths(before) - 1).max() < 0.005


def test_a_stroke_is_one_undo_step(clustered):
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.comb("EXEC_DEFAULT", True, stroke=across(clustered))) == 1


def test_a_stroke_is_that_of_the_backend(clustered):
    comb, strokes = scenes.module("backend.editing.comb"), scenes.module("backend.editing.strokes")
    text = across(clustered)
    strands = scenes.module("bridge.curves").read_strands(clustered)
    labels = [scenes.values(clustered, name) for name in ("hairloom_wisp", "hairloom_wisp_2")]
    bpy.context.scene.hairloom.comb.collide = False
    expected = comb.comb(strands, labels, [strokes.stroke_from_json(text)])
    bpy.ops.hairloom.comb(stroke=text)
    assert scenes.positions(clustered).tobytes() == expected.points.tobytes()


def test_the_same_stroke_gives_the_same_bytes_on_a_kept_session_and_on_a_new_one(clustered):
    cache = scenes.module("comb_cache").kept
    first, second = across(clustered), across(clustered, mode="lift")
    clustered.matrix_world = tilted()
    start = scenes.positions(clustered)
    for text in (first, second):
        bpy.ops.hairloom.comb(stroke=text)
    kept = cache["session"].session
    done = scenes.positions(clustered).tobytes()
    scenes.module("bridge.attributes").write_values(clustered.data.position_data, "vector", start, np.float32, 3)
    bpy.ops.hairloom.comb(stroke=first)
    assert cache["session"].session is kept
    cache.clear()
    bpy.ops.hairloom.comb(stroke=second)
    assert cache["session"].session is not kept
    assert scenes.positions(clustered).tobytes() == done


def tilted():
    from mathutils import Euler, Matrix, Vector

    return Matrix.LocRotScale(Vector((0.013, -0.02, 0.01)), Euler((0.1, -0.2, 0.3)), Vector((1.1, 0.9, 1.05)))


def test_what_was_not_touched_keeps_its_bits_in_a_turned_and_scaled_object(clustered):
    clustered.matrix_world = tilted()
    bpy.context.view_layer.update()
    before = scenes.positions(clustered)
    assert bpy.ops.hairloom.comb(stroke=across(clustered)) == {"FINISHED"}
    after = scenes.positions(clustered)
    same = (after.view(np.uint32) == before.view(np.uint32)).all(axis=1)
    world_before = scenes.module("bridge.curves").transformed(before, clustered.matrix_world)
    still = (scenes.module("comb_cache").kept["session"].session.points == world_before).all(axis=1)
    assert not still.all()
    # nothing is changed by the way to world space and back alone
    assert still.sum() > 100
    assert same[still].all()
    assert same[::16].all()


def test_the_new_place_is_right_in_a_turned_and_scaled_object(clustered):
    """The hair in world space must be the same, wherever the object's origin lies."""
    plain = clustered.copy()
    plain.data = clustered.data.copy()
    bpy.context.collection.objects.link(plain)
    matrix = np.array(tilted())
    positions = scenes.positions(clustered)
    inverse = np.linalg.inv(matrix)
    moved = (positions @ inverse[:3, :3].T + inverse[:3, 3]).astype(np.float32)
    scenes.module("bridge.attributes").write_values(clustered.data.position_data, "vector", moved, np.float32, 3)
    clustered.matrix_world = tilted()
    bpy.context.view_layer.update()
    text = across(plain)
    world = []
    for groom in (plain, clustered):
        scenes.activate(groom)
        assert bpy.ops.hairloom.comb(stroke=text) == {"FINISHED"}
        world.append(scenes.module("bridge.curves").read_strands(groom).points)
    # the points differ by their rounding before the stroke, and which wisps the brush grips may turn on that: most of
    # the hair must lie in the same place, where the stroke moves it by centimetres
    differences = np.linalg.norm(world[0] - world[1], axis=1)
    assert np.percentile(differences, 90) < 1e-3
    assert np.linalg.norm(world[0] - positions, axis=1).max() > 0.03


def test_a_live_stroke_can_be_taken_back_to_the_bit(clustered):
    clustered.matrix_world = tilted()
    before = scenes.positions(clustered).tobytes()
    live = live_stroke(clustered)
    changed = [live.move(x, 440.0) for x in range(250, 400, 10)]
    assert any(changed)
    assert live.has_changed
    assert scenes.positions(clustered).tobytes() != before
    live.cancel()
    assert scenes.positions(clustered).tobytes() == before


def live_stroke(groom, **changes):
    """A stroke by hand in a view that the test makes up: in the background no view has a matrix."""
    comb, strokes = scenes.module("bridge.comb"), scenes.module("backend.editing.strokes")
    view = strokes.View(np.array(front_view(), np.float64), WIDTH, HEIGHT)
    params = strokes.CombParams(radius=60.0, **changes)
    return comb.LiveStroke(groom, [], params, view, np.array(groom.matrix_world, np.float64), None)


def test_live_and_replayed_strokes_give_the_same_bytes(clustered):
    bpy.context.scene.hairloom.comb.collide = False
    clustered.matrix_world = tilted()
    bpy.context.view_layer.update()
    before = scenes.positions(clustered)
    live = live_stroke(clustered)
    for x in range(250, 400, 10):
        live.move(x + 0.25, 440.0, 0.7)
    text = live.end()
    done = scenes.positions(clustered)
    assert (done != before).any()
    scenes.module("bridge.attributes").write_values(clustered.data.position_data, "vector", before, np.float32, 3)
    assert bpy.ops.hairloom.comb(stroke=text) == {"FINISHED"}
    assert scenes.positions(clustered).tobytes() == done.tobytes()


def test_a_groom_that_loses_strands_during_a_stroke_ends_it(clustered):
    live = live_stroke(clustered)
    clustered.data.remove_curves(indices=[0])
    with pytest.raises(scenes.module("backend.errors").InputError, match="changed by something else"):
        for x in range(250, 400, 10):
            live.move(x, 440.0)


@pytest.mark.parametrize("mode", ["comb", "lift", "twist", "smooth", "length"])
def test_every_mode_moves_hair_and_no_root(clustered, mode):
    before = scenes.positions(clustered)
    assert bpy.ops.hairloom.comb(stroke=across(clustered, mode=mode)) == {"FINISHED"}
    after = scenes.positions(clustered)
    assert np.linalg.norm(after - before, axis=1).max() > 1e-3
    assert (after[::16] == before[::16]).all()


def test_a_groom_without_wisps_is_combed_strand_by_strand(hair):
    before = scenes.positions(hair)
    assert bpy.ops.hairloom.comb(stroke=across(hair)) == {"FINISHED"}
    assert (scenes.positions(hair) != before).any()


def test_without_a_head_there_is_no_collision(clustered):
    bpy.context.scene.hairloom.head = None
    assert bpy.ops.hairloom.comb(stroke=across(clustered)) == {"FINISHED"}
    assert scenes.module("comb_cache").kept["session"].collider is None


def test_hair_stays_out_of_the_head(clustered):
    """A stroke straight down through the middle of the ball pushes hair into it unless it collides."""
    deepest = {}
    before = scenes.positions(clustered)
    for collide in (False, True):
        bpy.context.scene.hairloom.comb.collide = collide
        scenes.module("bridge.attributes").write_values(clustered.data.position_data, "vector", before, np.float32, 3)
        text = json.dumps(stroke_values(clustered, (0.0, 0.14), (0.0, -0.02), through=True))
        assert bpy.ops.hairloom.comb(stroke=text) == {"FINISHED"}
        moved = (scenes.positions(clustered) != before).any(axis=1)
        distance = np.linalg.norm(scenes.positions(clustered)[moved], axis=1) - scenes.RADIUS
        deepest[collide] = float(distance.min())
    assert deepest[False] < -0.005
    # the 0.5 mm; the ball of flat faces lies up to 0.2 mm inside the sphere
    assert deepest[True] > -0.0007


def test_the_collider_is_kept_until_a_mesh_changes(clustered):
    kept = scenes.module("comb_cache").kept
    bpy.ops.hairloom.comb(stroke=across(clustered))
    first = kept["collider"][1]
    bpy.ops.hairloom.comb(stroke=across(clustered))
    assert kept["collider"][1] is first
    bpy.context.scene.hairloom.head.location.x += 0.001
    bpy.context.view_layer.update()
    bpy.ops.hairloom.comb(stroke=across(clustered))
    assert kept["collider"][1] is not first


def test_a_collection_of_colliders_counts_too(clustered):
    extra = scenes.sphere_head("Hat", scalp=False, uv=False)
    shelf = bpy.data.collections.new("Things")
    shelf.objects.link(extra)
    shelf.objects.link(clustered)  # no mesh: left out
    scenes.activate(clustered)
    settings = bpy.context.scene.hairloom.comb
    settings.colliders = shelf
    obstacles = scenes.module("ops.comb").obstacles
    assert [obj.name for obj in obstacles(bpy.context)] == ["Ball", "Hat"]
    settings.collide = False
    assert obstacles(bpy.context) == []


def test_opening_a_file_drops_what_was_kept(clustered):
    bpy.ops.hairloom.comb(stroke=across(clustered))
    assert scenes.module("comb_cache").kept
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert scenes.module("comb_cache").kept == {}


# --- the selection -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "domain"), [("BOOLEAN", "POINT"), ("FLOAT", "POINT"), ("FLOAT", "CURVE")])
def test_the_selection_is_one_value_a_strand(hair, kind, domain):
    read = scenes.module("bridge.comb").read_selection
    assert read(hair) is None
    hair.data.attributes.new(".selection", kind, domain)
    data = hair.data.attributes[".selection"].data
    values = np.ones(len(data), np.float32)
    each = 16 if domain == "POINT" else 1
    values[: 10 * each] = 0.0
    if domain == "POINT":
        values[10 * each : 10 * each + 4] = 0.0
    data.foreach_set("value", values if kind == "FLOAT" else values.astype(bool))
    found = read(hair)
    assert found.dtype == np.float32
    assert (found[:10] == 0).all()
    assert found[10] == (0.75 if domain == "POINT" else 1.0)
    assert (found[11:] == 1).all()


def test_all_selected_is_no_mask_and_none_selected_is_refused(hair):
    read = scenes.module("bridge.comb").read_selection
    hair.data.attributes.new(".selection", "FLOAT", "CURVE")
    data = hair.data.attributes[".selection"].data
    data.foreach_set("value", np.ones(300, np.float32))
    assert read(hair) is None
    data.foreach_set("value", np.zeros(300, np.float32))
    with pytest.raises(scenes.module("backend.errors").InputError, match="no strand of 'Hair' is selected"):
        read(hair)


def test_a_strand_that_is_not_selected_stays(clustered):
    values = stroke_values(clustered, (-0.04, 0.12), (0.06, 0.12))
    values["selection"] = [float(i % 2) for i in range(300)]
    before = scenes.positions(clustered)
    assert bpy.ops.hairloom.comb(stroke=json.dumps(values)) == {"FINISHED"}
    moved = (scenes.positions(clustered) != before).any(axis=1).reshape(-1, 16).any(axis=1)
    assert moved[1::2].any()
    assert not moved[::2].any()


# --- refused -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "No stroke is given"),
        ("{", "no JSON"),
        ("{}", "has no 'params'"),
    ],
)
def test_a_damaged_stroke_is_refused(clustered, text, match):
    refused(lambda: bpy.ops.hairloom.comb(stroke=text), match)


def test_a_stroke_for_another_selection_or_level_is_refused(clustered):
    values = stroke_values(clustered, (-0.04, 0.12), (0.06, 0.12))
    refused(lambda: bpy.ops.hairloom.comb(stroke=json.dumps({**values, "selection": [1.0] * 7})), "7 strands")
    refused(lambda: bpy.ops.hairloom.comb(stroke=across(clustered, level=3)), "level is 3")


def test_a_stroke_beside_the_hair_changes_nothing(clustered):
    text = json.dumps(stroke_values(clustered, (-0.24, -0.24), (-0.2, -0.24)))
    before = scenes.scene_state()
    assert bpy.ops.hairloom.comb(stroke=text) == {"CANCELLED"}
    assert scenes.scene_state() == before


def why_not() -> str:
    return scenes.module("ops.comb").why_no_comb(bpy.context)


def test_the_poll_says_why_not(clustered):
    assert why_not() == ""
    clustered.hide_set(True)
    assert "is hidden" in why_not()
    clustered.hide_set(False)
    bpy.ops.object.mode_set(mode="EDIT")
    assert "Object Mode or Sculpt Mode" in why_not()
    bpy.ops.object.mode_set(mode="SCULPT_CURVES")
    assert why_not() == ""
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.objects.active = bpy.data.objects["Ball"]
    assert "Select a groom" in why_not()


def test_a_linked_groom_is_refused(clustered, tmp_path):
    path = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = ["Hair"]
    groom = bpy.data.objects["Hair"]
    bpy.context.collection.objects.link(groom)
    bpy.context.view_layer.objects.active = groom
    assert "linked from another file" in why_not()


def test_a_stroke_in_sculpt_mode(clustered):
    bpy.ops.object.mode_set(mode="SCULPT_CURVES")
    before = scenes.positions(clustered)
    assert bpy.ops.hairloom.comb(stroke=across(clustered)) == {"FINISHED"}
    bpy.ops.object.mode_set(mode="OBJECT")
    assert (scenes.positions(clustered) != before).any()


def test_joined_grooms_with_the_same_wisps_are_noticed(clustered):
    stale = scenes.module("bridge.comb")._why_wisps_are_stale
    strands = scenes.module("bridge.curves").read_strands(clustered)
    labels = [scenes.values(clustered, "hairloom_wisp")]
    assert stale("Hair", strands.roots, labels) == ""
    far = np.concatenate([strands.roots, strands.roots + np.float32([1.0, 0.0, 0.0])])
    assert "run Cluster Wisps again" in stale("Hair", far, [np.tile(labels[0], 2)])


# --- tool and panel ------------------------------------------------------------------------------------------------


def test_the_tool_is_in_both_toolbars():
    from bl_ui.space_toolsystem_toolbar import VIEW3D_PT_tools_active as toolbar

    for mode in ("OBJECT", "SCULPT_CURVES"):
        names = [item.idname for item in toolbar._tools_flatten(toolbar._tools[mode]) if item is not None]
        assert names.count("hairloom.comb_tool") == 1


def test_mirror_comes_from_the_curves_and_the_rest_from_the_settings(clustered):
    strokes = scenes.module("backend.editing.strokes")
    settings = bpy.context.scene.hairloom.comb
    settings.mode, settings.radius, settings.profile = "twist", 33.0, (0.2, 0.4, 0.6)
    clustered.data.use_mirror_x = True
    seen = {}
    bridge = scenes.module("bridge.comb")

    def note(_groom, _obstacles, params, *_rest):
        seen["params"] = params

    original, bridge.LiveStroke = bridge.LiveStroke, note
    view_of, bridge.view_of = bridge.view_of, lambda *_: None
    try:
        bridge.start_stroke(clustered, settings, {"invert": True}, (None, None), [])
    finally:
        bridge.LiveStroke, bridge.view_of = original, view_of
    assert seen["params"] == strokes.CombParams(
        mode="twist", radius=33.0, profile=(0.2, 0.4, 0.6), invert=True, mirror=(True, False, False)
    )
