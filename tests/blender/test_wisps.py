"""Operators cluster_wisps, show_wisps and extract_centers."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import scenes


@pytest.fixture
def hair():
    return scenes.groom_on_head()[0]


@pytest.fixture
def clustered(hair):
    assert bpy.ops.hairloom.cluster_wisps() == {"FINISHED"}
    return hair


def test_every_strand_gets_a_wisp_on_every_level(clustered):
    first, second = scenes.values(clustered, "hairloom_wisp"), scenes.values(clustered, "hairloom_wisp_2")
    assert first.shape == second.shape == (300,)
    for labels in (first, second):
        assert (np.unique(labels) == np.arange(labels.max() + 1)).all()
    assert first.max() + 1 >= 80
    assert second.max() + 1 == round((first.max() + 1) / 4)
    # a wisp of level 1 lies within one wisp of level 2
    assert all(len(np.unique(second[first == wisp])) == 1 for wisp in np.unique(first))


def test_clustering_is_that_of_the_backend(clustered):
    inputs = scenes.module("bridge.inputs").strands_and_head(
        {"groom": clustered, "head": bpy.context.scene.hairloom.head}
    )
    params = bpy.context.scene.hairloom.synthesis.to_params()
    outputs = scenes.module("backend.registry").run_job("cluster_wisps", inputs, params)
    assert (outputs["labels"][0] == scenes.values(clustered, "hairloom_wisp")).all()


def test_clustering_again_with_fewer_levels_leaves_no_stale_labels(clustered):
    bpy.context.scene.hairloom.synthesis.hierarchy.n_levels = 2
    bpy.ops.hairloom.cluster_wisps()
    assert "hairloom_wisp_2" not in clustered.data.attributes


def test_clustering_is_one_undo_step(hair):
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.cluster_wisps("EXEC_DEFAULT", True)) == 1


def test_wisps_survive_saving(clustered, tmp_path):
    labels = scenes.values(clustered, "hairloom_wisp")
    scenes.reload(tmp_path)
    assert (scenes.values(bpy.data.objects["Hair"], "hairloom_wisp") == labels).all()


def test_more_wisps_than_strands_is_refused(hair):
    bpy.context.scene.hairloom.synthesis.hierarchy.wisps.n_wisps = 301
    before = scenes.scene_state()
    with pytest.raises(RuntimeError, match=r"30[01]"):
        bpy.ops.hairloom.cluster_wisps()
    assert scenes.scene_state() == before


def test_a_head_without_scalp_is_refused(hair):
    bpy.context.scene.hairloom.scalp_group = "Nowhere"
    with pytest.raises(RuntimeError, match="'Ball' has no scalp: no face is in 'Nowhere'"):
        bpy.ops.hairloom.cluster_wisps()


def test_not_a_number_is_refused(hair):
    hair.data.points[7].position.z = float("nan")
    with pytest.raises(RuntimeError, match="NaN"):
        bpy.ops.hairloom.cluster_wisps()


# --- show_wisps


def test_wisps_have_colours_of_their_own(clustered):
    clustered.data.materials.append(bpy.data.materials.new("Mine"))
    assert bpy.ops.hairloom.show_wisps(level=1) == {"FINISHED"}
    assert clustered.data.materials[0].name == "Hairloom Wisps"
    colors = scenes.values(clustered, "hairloom_wisp_color", np.float32, 4, "color")
    labels = scenes.values(clustered, "hairloom_wisp")
    assert len(np.unique(np.column_stack([labels, colors]), axis=0)) == labels.max() + 1
    assert len(np.unique(colors, axis=0)) == labels.max() + 1
    assert colors.min() >= 0 and colors.max() <= 1


def test_the_hair_material_comes_back(clustered):
    clustered.data.materials.append(bpy.data.materials.new("Mine"))
    bpy.ops.hairloom.show_wisps(level=1)
    bpy.ops.hairloom.show_wisps(level=2)
    bpy.ops.hairloom.show_wisps(level=0)
    assert [m.name for m in clustered.data.materials] == ["Mine"]
    assert "hairloom_wisp_color" not in clustered.data.attributes
    assert "hairloom_wisp" in clustered.data.attributes


def test_colours_follow_a_new_clustering(clustered):
    bpy.ops.hairloom.show_wisps(level=1)
    bpy.context.scene.hairloom.synthesis.hierarchy.wisps.n_wisps = 120
    bpy.ops.hairloom.cluster_wisps()
    colors = scenes.values(clustered, "hairloom_wisp_color", np.float32, 4, "color")
    assert len(np.unique(colors, axis=0)) == scenes.values(clustered, "hairloom_wisp").max() + 1


def test_a_level_that_is_not_there_is_refused(clustered):
    with pytest.raises(RuntimeError, match="has 2 levels of wisps, not 4"):
        bpy.ops.hairloom.show_wisps(level=4)


def test_showing_wants_wisps(hair):
    with pytest.raises(RuntimeError, match="The groom has no wisps yet; run Cluster Wisps first"):
        bpy.ops.hairloom.show_wisps(level=1)


def test_showing_is_one_undo_step(clustered):
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.show_wisps("EXEC_DEFAULT", True, level=1)) == 1


# --- extract_centers


@pytest.mark.parametrize("level", [1, 2])
def test_centers_are_a_groom_of_one_strand_a_wisp(hair, level):
    assert bpy.ops.hairloom.extract_centers(level=level) == {"FINISHED"}
    centers = bpy.context.object
    name = "hairloom_wisp" if level == 1 else "hairloom_wisp_2"
    labels = scenes.values(hair, name)
    assert centers.name == f"Hair Centers {level}"
    assert len(centers.data.curves) == labels.max() + 1
    assert (scenes.values(centers, name) == np.arange(labels.max() + 1)).all()
    assert centers.data.surface == bpy.context.scene.hairloom.head
    # a center lies where its wisp does
    read = scenes.module("bridge.curves").read_strands
    wisp = int(np.bincount(labels).argmax())
    middle = read(hair).points.reshape(300, -1, 3)[labels == wisp].mean(axis=(0, 1))
    center = read(centers)
    found = center.points[center.offsets[wisp] : center.offsets[wisp + 1]].mean(axis=0)
    assert np.linalg.norm(found - middle) < 0.3 * scenes.RADIUS


def test_centers_of_a_level_that_does_not_exist_are_refused_before_the_work(hair):
    before = scenes.scene_state()
    with pytest.raises(RuntimeError, match="no level 4 of wisps; choose 1 to 2"):
        bpy.ops.hairloom.extract_centers(level=4)
    assert scenes.scene_state() == before


def test_extracting_is_one_undo_step(hair):
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.extract_centers("EXEC_DEFAULT", True, level=1)) == 1
