"""Transfer of details between grooms: operators, cache of hierarchies, live update, and what is refused."""

from __future__ import annotations

import time

import bpy
import numpy as np
import pytest
import scenes

LIVE_STEPS = 3  # settings are seen, found at rest, and acted upon


def small_groom(name: str, *, curl: float = 0.0, seed: int = 0) -> bpy.types.Object:
    """300 strands on the ball; `curl` is the radius of a helix around each of them, metres."""
    points = scenes.wavy_strands(seed=seed)
    along = np.linspace(0, 1, points.shape[1])
    phase = 2 * np.pi * 2.5 * along
    points[..., 0] += curl * np.sin(phase) * along
    points[..., 1] += curl * (np.cos(phase) - 1) * along
    return scenes.groom(points.astype(np.float32), name)


@pytest.fixture
def scene():
    """Curly and plain hair on one ball, attached; the plain one is active and the curly one chosen."""
    scenes.module("bridge.hierarchies").clear()
    head = scenes.sphere_head()
    bpy.context.scene.hairloom.head = head
    scenes.small_settings()
    curly = small_groom("Curly", curl=0.006)
    bpy.ops.hairloom.attach_to_head()
    plain = small_groom("Plain", seed=1)
    bpy.ops.hairloom.attach_to_head()
    bpy.context.scene.hairloom.details.source = curly
    return curly, plain, head


@pytest.fixture
def clusterings(monkeypatch):
    """A list that gets an entry for each groom whose wisps are searched."""
    job, calls = scenes.module("backend.jobs.transfer_details"), []
    original = job.analyze

    def counted(strands, *arguments, **named):
        calls.append(strands.n_strands)
        return original(strands, *arguments, **named)

    monkeypatch.setattr(job, "analyze", counted)
    return calls


def transferred() -> bpy.types.Object:
    assert bpy.ops.hairloom.transfer_details() == {"FINISHED"}
    return bpy.context.object


def strands_of(obj: bpy.types.Object):
    return scenes.module("bridge.curves").read_strands(obj)


def settings():
    return bpy.context.scene.hairloom.details.settings


def state():
    return bpy.context.window_manager.hairloom_details


def turning(obj: bpy.types.Object) -> float:
    """Mean angle between successive segments, radians: how curly the hair is."""
    points = strands_of(obj).points.reshape(len(obj.data.curves), -1, 3).astype(np.float64)
    along = np.diff(points, axis=1)
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    return float(np.arccos(np.clip((along[:, 1:] * along[:, :-1]).sum(axis=2), -1, 1)).mean())


def test_a_new_groom_with_the_others_curls_on_the_same_head(scene):
    curly, plain, head = scene
    before = {obj.name: scenes.positions(obj).tobytes() for obj in (curly, plain)}
    new = transferred()
    assert new.name == "Plain Curly"
    assert len(new.data.curves) == len(plain.data.curves)
    assert (new.data.surface, new.data.surface_uv_map, new.parent) == (head, "UVMap", head)
    uv = [scenes.values(obj, "surface_uv_coordinate", np.float32, 2, "vector") for obj in (new, plain)]
    assert (uv[0] == uv[1]).all()
    assert np.abs(strands_of(new).roots - strands_of(plain).roots).max() < 1e-6
    assert new.data.materials[0].name == "Hairloom Hair"
    assert {obj.name: scenes.positions(obj).tobytes() for obj in (curly, plain)} == before
    # most of the way from the plain groom to the curly one
    assert turning(new) > turning(plain) + 0.6 * (turning(curly) - turning(plain))


def test_the_material_and_radius_are_the_base_s(scene):
    _, plain, _ = scene
    mine = bpy.data.materials.new("Mine")
    plain.data.materials.append(mine)
    radius = np.full(len(plain.data.points), 3e-4, np.float32)
    scenes.module("bridge.attributes").write_attribute(plain.data, "radius", "FLOAT", "POINT", radius)
    new = transferred()
    assert new.data.materials[0] == mine
    assert np.allclose(scenes.values(new, "radius", np.float32), 3e-4)


def test_the_result_has_the_base_s_wisps_and_no_other_attributes_of_ours(scene):
    _, plain, _ = scene
    scenes.activate(plain)
    bpy.ops.hairloom.cluster_wisps()
    scenes.module("bridge.curves").write_strand_ints(plain, "mine", np.arange(300, dtype=np.int32))
    scenes.module("bridge.curves").number_strands(plain, "hairloom_flow_strand")
    new = transferred()
    for name in ("hairloom_wisp", "hairloom_wisp_2", "mine"):
        assert (scenes.values(new, name) == scenes.values(plain, name)).all(), name
    assert "hairloom_flow_strand" not in new.data.attributes


def test_the_coarsest_level_is_kept(scene):
    curly, plain, head = scene
    inputs = {
        "detail_strands": strands_of(curly), "base_strands": strands_of(plain),
        **dict.fromkeys(("detail_head", "base_head"), scenes.module("bridge.mesh").read_head(head)),
    }  # fmt: skip
    params = {"analysis": bpy.context.scene.hairloom.synthesis.to_params(), "detail": settings().to_params()}
    outputs = scenes.module("backend.registry").run_job("transfer_details", inputs, params)
    new = transferred()
    assert strands_of(new).points.tobytes() == outputs["strands"].points.tobytes()
    # each coarsest wisp of the result runs where the base's runs: means over the wisp's strands
    hierarchy = outputs["base_hierarchy"]
    labels = hierarchy.labels[1][hierarchy.labels[0]]
    resample = scenes.module("backend.geometry.strands").resample
    mine, base = (
        np.asarray([strands[labels == wisp].mean(axis=0) for wisp in range(labels.max() + 1)])
        for strands in (resample(strands_of(new), 16), resample(strands_of(plain), 16))
    )
    # the curls themselves move a mean by about their radius, 6 mm; the hair is up to 100 mm long
    assert np.linalg.norm(mine - base, axis=2).mean() < 0.006


def test_the_second_run_takes_the_wisps_that_were_found_before(scene, clusterings):
    _, plain, _ = scene
    first = scenes.positions(transferred()).tobytes()
    assert len(clusterings) == 2
    scenes.activate(plain)
    assert scenes.positions(transferred()).tobytes() == first
    assert len(clusterings) == 2
    # colours are no shape, so nothing is searched anew
    scenes.activate(plain)
    scenes.module("bridge.curves").number_strands(plain, "something")
    transferred()
    assert len(clusterings) == 2


def test_an_edited_groom_is_clustered_again_and_the_report_says_so(scene, clusterings, capfd):
    curly, plain, _ = scene
    transferred()
    moved = scenes.positions(curly)
    moved[:, 2] *= 1.01
    curly.data.position_data.foreach_set("vector", moved.ravel())
    scenes.activate(plain)
    capfd.readouterr()
    transferred()
    assert len(clusterings) == 3
    assert "'Curly' changed since: the wisps were found anew" in capfd.readouterr().out


def test_other_wisp_settings_are_another_hierarchy(scene, clusterings):
    transferred()
    scenes.activate(scene[1])
    bpy.context.scene.hairloom.synthesis.hierarchy.wisps.n_wisps = 60
    transferred()
    assert len(clusterings) == 4


def test_a_groom_on_itself_without_smoothing_is_itself(scene):
    curly, *_ = scene
    settings().smoothing = 0.0
    scenes.activate(curly)
    new = transferred()
    original = scenes.module("backend.geometry.strands").resample_smooth(strands_of(curly), 16)
    assert np.abs(strands_of(new).points.reshape(original.shape) - original).max() < 1e-4 * scenes.RADIUS


def test_grooms_on_different_heads(scene):
    _, plain, head = scene
    other = scenes.sphere_head("Other")
    other.location.x = 1.0
    bpy.context.view_layer.update()
    far = small_groom("Far", curl=0.006)
    far.location.x = 1.0
    bpy.context.view_layer.update()
    bpy.context.scene.hairloom.head = other
    bpy.ops.hairloom.attach_to_head()
    bpy.context.scene.hairloom.details.source = far
    scenes.activate(plain)
    new = transferred()
    assert new.data.surface == head
    assert np.abs(strands_of(new).roots - strands_of(plain).roots).max() < 1e-6


def test_one_undo_step(scene):
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.transfer_details("EXEC_DEFAULT", True)) == 1


def test_unattached_hair_uses_the_head_of_the_panel(scene):
    bare = small_groom("Bare", seed=2)
    new = transferred()
    assert bare.data.surface is None
    assert new.data.surface == scene[2]


# --- refused -----------------------------------------------------------------------------------------------------


def reason() -> str:
    return scenes.module("details").why_no_transfer(bpy.context)


def test_no_source(scene):
    bpy.context.scene.hairloom.details.source = None
    assert "Choose the groom with the details" in reason()
    assert not bpy.ops.hairloom.transfer_details.poll()


def test_a_deleted_source(scene):
    bpy.data.scenes[0].collection.objects.unlink(scene[0])
    assert "Choose the groom with the details" in reason()


def test_a_source_without_head(scene):
    bare = small_groom("Bare")
    bpy.context.scene.hairloom.details.source = bare
    scenes.activate(scene[1])
    assert reason() == "'Bare' hangs on no head: attach it to one, or choose Its Head"
    bpy.context.scene.hairloom.details.source_head = scene[2]
    assert reason() == ""
    transferred()


def test_a_source_without_strands(scene):
    empty = bpy.data.objects.new("Empty", bpy.data.hair_curves.new("Empty"))
    bpy.context.collection.objects.link(empty)
    bpy.context.scene.hairloom.details.source = empty
    assert "'Empty' has no strands" in reason()


def test_nothing_active(scene):
    bpy.context.view_layer.objects.active = None
    assert "Select a groom" in reason()


def test_a_head_without_scalp_is_refused_before_anything_changes(scene):
    bare = scenes.sphere_head("Bald", scalp=False)
    bpy.context.scene.hairloom.details.source_head = bare
    scenes.activate(scene[1])
    before = scenes.scene_state()
    with pytest.raises(RuntimeError, match="'Bald' has no scalp"):
        bpy.ops.hairloom.transfer_details()
    assert scenes.scene_state() == before


# --- made again --------------------------------------------------------------------------------------------------


def test_update_makes_the_same_object_again(scene, clusterings):
    new = transferred()
    first, count = scenes.positions(new).tobytes(), len(bpy.data.objects)
    assert bpy.ops.hairloom.update_details() == {"FINISHED"}
    assert scenes.positions(new).tobytes() == first
    settings().strength = 0.5
    bpy.ops.hairloom.update_details()
    assert scenes.positions(new).tobytes() != first
    assert (len(bpy.data.objects), len(clusterings), len(bpy.data.hair_curves)) == (count, 2, 3)
    assert new.data.surface == scene[2]


def test_update_is_remembered_by_the_file(scene, tmp_path):
    transferred()
    scenes.reload(tmp_path)
    memory = bpy.context.object.hairloom_transfer
    assert (memory.base.name, memory.source.name) == ("Plain", "Curly")
    assert bpy.ops.hairloom.update_details() == {"FINISHED"}


def test_only_results_can_be_updated(scene):
    assert not bpy.ops.hairloom.update_details.poll()
    assert "made by Transfer Details" in scenes.module("details").why_no_update(bpy.context, scene[1])


@pytest.fixture
def live():
    follower = scenes.module("live_details")._live
    follower.stop()
    state().is_live = True
    yield lambda: [follower.step(bpy.context, state()) for _ in range(LIVE_STEPS)]
    follower.stop()
    state().is_live = False
    state().message = ""


def test_live_follows_a_setting_and_clusters_nothing(scene, clusterings, live):
    new = transferred()
    first = scenes.positions(new).tobytes()
    live()
    assert scenes.positions(new).tobytes() == first
    settings().strength = 0.4
    live()
    followed = scenes.positions(new).tobytes()
    assert followed != first
    assert len(clusterings) == 2
    bpy.ops.hairloom.update_details()
    assert scenes.positions(new).tobytes() == followed
    assert (new.data.surface, len(new.data.materials)) == (scene[2], 1)


def test_live_waits_until_a_slider_rests(scene, live, monkeypatch):
    new = transferred()
    follower = scenes.module("live_details")._live
    first = scenes.positions(new).tobytes()
    live()
    for strength in (0.9, 0.8, 0.7):
        settings().strength = strength
        follower.step(bpy.context, state())
        assert scenes.positions(new).tobytes() == first
    live()
    assert scenes.positions(new).tobytes() != first


def test_live_leaves_a_groom_alone_that_has_just_become_active(scene, live):
    first = transferred()
    live()
    settings().strength = 0.3
    scenes.activate(scene[1])
    second = transferred()
    live()
    before = scenes.positions(first).tobytes()
    scenes.activate(first)
    live()
    assert scenes.positions(first).tobytes() == before
    assert second.name == "Plain Curly.001"


def test_live_stops_and_says_so_when_a_groom_is_gone(scene, live):
    curly, *_ = scene
    new = transferred()
    live()
    bpy.data.objects.remove(curly)
    settings().strength = 0.2
    live()
    assert not state().is_live
    assert state().message == f"'Curly', whose details '{new.name}' has, was deleted"


def test_live_uses_the_worker_for_much_hair(scene, live, monkeypatch):
    new = transferred()
    first = scenes.positions(new).tobytes()
    module = scenes.module("live_details")
    monkeypatch.setattr(module, "QUICK_STRANDS", 10)
    live()
    settings().strength = 0.4
    live()
    follower = module._live
    assert follower._worker is not None
    assert scenes.positions(new).tobytes() == first
    for _ in range(600):
        if follower._worker is None:
            break
        follower.step(bpy.context, state())
        time.sleep(0.1)
    assert scenes.positions(new).tobytes() != first
    followed = scenes.positions(new)
    bpy.ops.hairloom.update_details()
    assert (scenes.positions(new) == followed).all()
