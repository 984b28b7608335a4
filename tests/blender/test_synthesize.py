"""Operator synthesize: from the active groom to a new one on the head."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import scenes
from test_heads import root_uv_error


@pytest.fixture
def scene():
    return scenes.groom_on_head()


def synthesized():
    assert bpy.ops.hairloom.synthesize() == {"FINISHED"}
    return bpy.context.object


def test_a_new_groom_on_the_head(scene):
    hair, head = scene
    before = scenes.positions(hair)
    new = synthesized()
    assert (new.name, new.type) == ("Hair New", "CURVES")
    # the example's density on the same region
    assert 290 <= len(new.data.curves) <= 310
    assert len(new.data.points) == 16 * len(new.data.curves)
    assert (new.data.surface, new.data.surface_uv_map, new.parent) == (head, "UVMap", head)
    assert root_uv_error(new, head) < 1e-5
    assert new.data.materials[0].name == "Hairloom Hair"
    radius = scenes.values(new, "radius", np.float32)
    assert 0 < radius.min() < radius.max() < 1e-3
    assert (scenes.positions(hair) == before).all()
    assert new.select_get() and not hair.select_get()


def test_the_new_hair_is_like_the_example(scene):
    new = synthesized()
    lengths = []
    for obj in (scene[0], new):
        points = scenes.module("bridge.curves").read_strands(obj).points.reshape(len(obj.data.curves), -1, 3)
        lengths.append(np.linalg.norm(np.diff(points, axis=1), axis=2).sum(axis=1).mean())
    # 300 strands are a poor example: this only tells hair from a tangle or a stubble
    assert 0.6 < lengths[1] / lengths[0] < 1.6


def test_the_same_settings_give_the_same_hair_and_another_seed_another(scene):
    first = scenes.positions(synthesized()).tobytes()
    scenes.activate(scene[0])
    assert scenes.positions(synthesized()).tobytes() == first
    scenes.activate(scene[0])
    bpy.context.scene.hairloom.synthesis.seed = 1
    assert scenes.positions(synthesized()).tobytes() != first


def test_the_operator_gives_what_the_job_gives(scene):
    hair, head = scene
    inputs = scenes.module("bridge.inputs").synthesis_inputs({"groom": hair, "head": head})
    params = bpy.context.scene.hairloom.synthesis.to_params()
    outputs = scenes.module("backend.registry").run_job("synthesize", inputs, params)
    new = synthesized()
    assert scenes.module("bridge.curves").read_strands(new).points.tobytes() == outputs["strands"].points.tobytes()


def test_hair_grows_in_the_chosen_region_only(scene):
    _hair, head = scene
    group = head.vertex_groups.new(name="Top")
    group.add([v.index for v in head.data.vertices if v.co.z > 0.06], 1.0, "REPLACE")
    bpy.context.scene.hairloom.region_group = "Top"
    new = synthesized()
    assert scenes.module("bridge.curves").read_strands(new).roots[:, 2].min() > 0.055
    assert len(new.data.curves) < 250


def test_the_count_of_strands_is_a_setting(scene):
    bpy.context.scene.hairloom.synthesis.n_strands = 123
    assert len(synthesized().data.curves) == 123


def test_a_moved_head_takes_the_result_along(scene):
    hair, head = scene
    for obj in (hair, head):
        obj.location = (1.0, 0.5, 0.0)
    bpy.context.view_layer.update()
    new = synthesized()
    bpy.context.view_layer.update()
    roots = scenes.module("bridge.curves").read_strands(new).roots
    assert np.abs(np.linalg.norm(roots - [1.0, 0.5, 0.0], axis=1) - scenes.RADIUS).max() < 1e-3


def test_the_example_may_show_its_wisps(scene):
    bpy.ops.hairloom.cluster_wisps()
    bpy.ops.hairloom.show_wisps(level=1)
    assert synthesized().data.materials[0].name == "Hairloom Hair"


def test_synthesis_is_one_undo_step(scene):
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.synthesize("EXEC_DEFAULT", True)) == 1


def test_the_result_survives_saving(scene, tmp_path):
    points = scenes.positions(synthesized())
    scenes.reload(tmp_path)
    new = bpy.data.objects["Hair New"]
    assert scenes.positions(new).tobytes() == points.tobytes()
    assert new.data.surface.name == "Ball"


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda hair, head: head.vertex_groups.remove(head.vertex_groups["Scalp"]), "'Ball' has no scalp"),
        (lambda hair, head: setattr(bpy.context.scene.hairloom, "region_group", "Nowhere"), "'Nowhere'"),
        (lambda hair, head: head.data.uv_layers.remove(head.data.uv_layers[0]), "has no UV map"),
        (lambda hair, head: setattr(hair.data.points[3].position, "x", float("inf")), "NaN or infinite"),
        (lambda hair, head: hair.data.remove_curves(indices=list(range(5, 300))), "5"),
        (lambda hair, head: setattr(bpy.context.scene.hairloom.synthesis.texture, "window_sizes", (0, 0, 0)), "window"),
    ],
)
def test_what_cannot_work_is_refused_and_changes_nothing(scene, spoil, words):
    spoil(*scene)
    before = scenes.scene_state()
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.hairloom.synthesize()
    assert scenes.scene_state() == before


def test_what_is_missing_is_said():
    with pytest.raises(RuntimeError, match=r"Select a groom \(hair Curves\): import one, or add a starter groom"):
        bpy.ops.hairloom.synthesize()
    scenes.groom()
    with pytest.raises(RuntimeError, match="Choose a head in the Head panel: add one, or set up a mesh of yours"):
        bpy.ops.hairloom.synthesize()
    bpy.context.scene.hairloom.head = scenes.sphere_head()
    bald = bpy.data.objects.new("Bald", bpy.data.hair_curves.new("Bald"))
    bpy.context.collection.objects.link(bald)
    scenes.activate(bald)
    with pytest.raises(RuntimeError, match="'Bald' has no strands"):
        bpy.ops.hairloom.synthesize()


def test_an_attached_groom_needs_no_chosen_head(scene):
    bpy.ops.hairloom.attach_to_head()
    bpy.context.scene.hairloom.head = None
    assert len(synthesized().data.curves) > 0


def test_invoking_without_a_window_runs_at_once(scene):
    if not bpy.app.background:
        pytest.skip("has a window")
    assert bpy.ops.hairloom.synthesize("INVOKE_DEFAULT") == {"FINISHED"}
    assert bpy.context.object.name == "Hair New"
