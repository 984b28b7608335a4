"""Playback of simulation caches: frames, sub-frames, undo, reload, moved files, edits, missing caches, motion blur."""

from __future__ import annotations

import shutil

import bpy
import numpy as np
import pytest
import scenes
from caches import simulated


@pytest.fixture
def hair():
    return scenes.groom(scenes.wavy_strands(20))


@pytest.fixture
def playback():
    return scenes.module("playback")


@pytest.fixture
def played(hair, playback, tmp_path):
    frames = simulated(tmp_path / "cache", hair, fingerprint=playback.fingerprint(hair))
    playback.attach(hair, tmp_path / "cache")
    return frames


def shown(name: str = "Hair") -> np.ndarray:
    """What is evaluated, and so rendered."""
    obj = bpy.data.objects[name]
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return scenes.positions(evaluated)


def state(name: str = "Hair") -> str:
    return scenes.module("playback").status(bpy.data.objects[name])[0]


def test_scrubbing_shows_the_frames(hair, played):
    for frame in (3, 1, 6, 2):
        bpy.context.scene.frame_set(frame)
        assert np.array_equal(shown(), played[frame - 1])
    assert np.abs(played[5] - played[0]).max() > 0.04


def test_outside_the_range_the_ends_are_shown(played):
    bpy.context.scene.frame_set(-50)
    assert np.array_equal(shown(), played[0])
    bpy.context.scene.frame_set(500)
    assert np.array_equal(shown(), played[-1])


def test_between_frames(played):
    bpy.context.scene.frame_set(2, subframe=0.25)
    # one rounding each of a difference, a product and a sum of positions of 0.2 m
    assert np.allclose(shown(), 0.75 * played[1] + 0.25 * played[2], rtol=0, atol=1e-7)


def test_attach_shows_the_current_frame_and_detach_the_rest(hair, playback, tmp_path):
    before = scenes.positions(hair)
    bpy.context.scene.frame_set(4)
    frames = simulated(tmp_path / "cache", hair)
    playback.attach(hair, tmp_path / "cache")
    assert np.array_equal(scenes.positions(hair), frames[3])
    assert np.array_equal(playback.rest_positions(hair), before)
    assert playback.folder(hair) == tmp_path / "cache"
    playback.detach(hair)
    assert np.array_equal(scenes.positions(hair), before)
    assert playback.folder(hair) is None
    assert playback.rest_positions(hair) is None
    assert list(hair.modifiers) == []
    assert list(bpy.data.node_groups) == []
    assert not [name for name in (*hair.data.keys(), *hair.data.attributes.keys()) if name.startswith("hairloom")]
    bpy.context.scene.frame_set(2)
    assert np.array_equal(scenes.positions(hair), before)


def test_a_second_simulation_starts_from_the_same_rest(hair, played, playback, tmp_path):
    bpy.context.scene.frame_set(4)
    again = simulated(tmp_path / "second", hair, shift=-0.01)
    playback.attach(hair, tmp_path / "second")
    assert np.array_equal(playback.rest_positions(hair), played[0])
    assert np.array_equal(shown(), again[3])


def test_a_new_simulation_in_the_same_folder_is_taken(hair, played, tmp_path):
    bpy.context.scene.frame_set(3)
    again = simulated(tmp_path / "cache", hair, shift=-0.02)
    bpy.context.scene.frame_set(4)
    assert np.array_equal(shown(), again[3])


def test_save_and_reload(hair, played, playback, tmp_path):
    bpy.context.scene.frame_set(3)
    scenes.reload(tmp_path)
    assert bpy.data.hair_curves["Hair"]["hairloom_cache"] == "//cache"
    assert state() == playback.PLAYING
    assert np.array_equal(shown(), played[2])
    bpy.context.scene.frame_set(5)
    assert np.array_equal(shown(), played[4])


def test_the_folder_of_the_file_is_moved(hair, played, playback, tmp_path):
    scenes.reload(tmp_path)
    moved = tmp_path.with_name(tmp_path.name + "-moved")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    shutil.move(tmp_path, moved)
    bpy.ops.wm.open_mainfile(filepath=str(moved / "saved.blend"))
    bpy.context.scene.frame_set(6)
    assert state() == playback.PLAYING
    assert np.array_equal(shown(), played[5])


def test_save_as_elsewhere_and_a_copy_keep_the_link(hair, played, playback, tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "first.blend"))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a" / "second.blend"))
    assert bpy.data.hair_curves["Hair"]["hairloom_cache"] == "//../cache"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "b" / "copy.blend"), copy=True)
    assert playback.folder(bpy.data.objects["Hair"]) == tmp_path / "cache"
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "b" / "copy.blend"))
    assert playback.folder(bpy.data.objects["Hair"]) == tmp_path / "cache"


def test_a_temporary_cache_moves_beside_the_file(hair, playback, tmp_path):
    from pathlib import Path

    folder = Path(bpy.app.tempdir, "hairloom", "Hair", "1")
    frames = simulated(folder, hair)
    playback.attach(hair, folder)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert bpy.data.hair_curves["Hair"]["hairloom_cache"] == "//hairloom_cache/saved/Hair/1"
    assert not folder.exists()
    bpy.context.scene.frame_set(5)
    assert np.array_equal(shown(), frames[4])


def test_duplicates_play_and_are_freed_alone(hair, played, playback, tmp_path):
    bpy.ops.object.duplicate()
    bpy.context.scene.frame_set(3)
    assert np.array_equal(shown("Hair.001"), played[2])
    bpy.ops.hairloom.free_cache()
    assert np.array_equal(shown("Hair.001"), played[0])
    bpy.context.scene.frame_set(4)
    assert np.array_equal(shown("Hair.001"), played[0])
    assert np.array_equal(shown("Hair"), played[3])
    assert (tmp_path / "cache" / "header.json").exists()


def test_linked_duplicates_share_playback_and_blur(hair, playback, tmp_path):
    bpy.ops.object.duplicate(linked=True)
    frames = simulated(tmp_path / "cache", hair)
    playback.attach(hair, tmp_path / "cache")
    other = bpy.data.objects["Hair.001"]
    bpy.context.scene.frame_set(3)
    assert np.array_equal(shown("Hair.001"), frames[2])
    assert all(obj.is_deform_modified(bpy.context.scene, "RENDER") for obj in (hair, other))
    playback.detach(other)
    assert [len(obj.modifiers) for obj in (hair, other)] == [0, 0]


def test_a_hostile_header_takes_no_memory(hair, played, playback, tmp_path):
    header = tmp_path / "cache" / "header.json"
    header.write_text(header.read_text().replace('"n_points": 320', '"n_points": 2147483647'))
    with pytest.raises(scenes.module("backend.errors").InputError, match="2,147,483,647 points"):
        playback.attach(hair, tmp_path / "cache")
    scenes.reload(tmp_path)
    bpy.context.scene.frame_set(4)
    assert state() == playback.BROKEN


def test_free_cache_deletes_the_files_and_undo_says_so(hair, played, playback, tmp_path):
    bpy.context.scene.frame_set(3)
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.hairloom.free_cache("EXEC_DEFAULT", True)
    assert not (tmp_path / "cache").exists()
    assert np.array_equal(shown(), played[0])
    bpy.ops.ed.undo()
    assert state() == playback.BROKEN
    assert np.array_equal(shown(), played[0])


def test_keep_shape_makes_the_edit_the_groom(hair, played, playback):
    bpy.context.scene.frame_set(3)
    edited = scenes.positions(hair) + np.float32(0.5)
    hair.data.position_data.foreach_set("vector", edited.ravel())
    bpy.ops.hairloom.free_cache(keep_shape=True)
    bpy.context.scene.frame_set(5)
    assert np.array_equal(scenes.positions(hair), edited)
    assert playback.folder(hair) is None


def test_an_edit_is_not_overwritten(hair, played, playback, tmp_path):
    bpy.context.scene.frame_set(3)
    edited = scenes.positions(hair) + np.float32(0.5)
    hair.data.position_data.foreach_set("vector", edited.ravel())
    assert playback.status(hair)[0] == playback.EDITED
    bpy.context.scene.frame_set(5)
    assert np.array_equal(scenes.positions(hair), edited)
    scenes.reload(tmp_path)
    bpy.context.scene.frame_set(4)
    assert state() == playback.EDITED
    assert np.array_equal(scenes.positions(bpy.data.objects["Hair"]), edited)
    bpy.ops.hairloom.play_again()
    assert state() == playback.PLAYING
    assert np.array_equal(scenes.positions(bpy.data.objects["Hair"]), played[3])


def test_undo_of_an_edit_plays_on(hair, played, playback):
    bpy.context.scene.frame_set(3)
    bpy.ops.ed.undo_push(message="frame 3")
    data = bpy.data.hair_curves["Hair"]
    data.position_data.foreach_set("vector", np.zeros(3 * len(data.points), np.float32))
    data.update_tag()
    bpy.ops.ed.undo_push(message="edit")
    bpy.ops.ed.undo()
    assert state() == playback.PLAYING
    bpy.context.scene.frame_set(5)
    assert np.array_equal(shown(), played[4])


def test_attach_is_undone(hair, playback, tmp_path):
    before = scenes.positions(hair)
    bpy.context.scene.frame_set(4)
    simulated(tmp_path / "cache", hair)
    bpy.ops.ed.undo_push(message="before")
    playback.attach(bpy.data.objects["Hair"], tmp_path / "cache")
    bpy.ops.ed.undo_push(message="attach")
    bpy.ops.ed.undo()
    assert state() == playback.NONE
    bpy.context.scene.frame_set(5)
    assert np.array_equal(shown(), before)


def test_missing_and_damaged_caches_show_the_rest(hair, played, playback, tmp_path):
    scene = bpy.context.scene
    scene.frame_set(4)
    shutil.move(tmp_path / "cache", tmp_path / "away")
    scene.frame_set(5)
    assert np.array_equal(shown(), played[0])
    state, message = playback.status(hair)
    assert state == playback.BROKEN
    assert "no simulation cache" in message
    assert "simulate again" in message
    shutil.move(tmp_path / "away", tmp_path / "cache")
    scene.frame_set(6)
    assert np.array_equal(shown(), played[5])
    assert playback.status(hair)[0] == playback.PLAYING
    (tmp_path / "cache" / "header.json").write_text("{")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    state, message = playback.status(bpy.data.objects["Hair"])
    assert (state, "header.json" in message) == (playback.BROKEN, True)
    assert np.array_equal(shown(), played[0])


def test_a_cache_that_is_shorter_than_planned_plays_and_says_so(hair, playback, tmp_path):
    frames = simulated(tmp_path / "cache", hair, n_planned=240, fingerprint=playback.fingerprint(hair))
    playback.attach(hair, tmp_path / "cache")
    bpy.context.scene.frame_set(100)
    assert np.array_equal(shown(), frames[-1])
    assert playback.status(hair) == (playback.STALE, "6 of 240 frames are simulated: resume, or simulate again")


def test_stale_caches_play_and_say_so(hair, played, playback):
    assert playback.status(hair) == (playback.PLAYING, "Plays frames 1 to 6")
    bpy.context.scene.render.fps = 30
    assert "24 frames a second, the scene has 30" in playback.status(hair)[1]
    bpy.context.scene.render.fps = 24
    values = scenes.values(hair, "hairloom_rest_position", np.float32, 3, "vector")
    values[0] += 0.01
    hair.data.attributes["hairloom_rest_position"].data.foreach_set("vector", values.ravel())
    hair.data.update_tag()
    bpy.context.view_layer.update()
    assert playback.status(hair) == (playback.STALE, "The groom was changed after this simulation: simulate again")
    bpy.context.scene.frame_set(4)
    assert np.array_equal(shown(), played[3])


def test_other_settings_are_stale(hair, played, playback):
    settings = bpy.context.scene.hairloom.simulation
    settings.material.young *= 2
    assert "Settings were changed" in playback.status(hair)[1]


def test_strands_added_later_are_left_alone(hair, played, playback):
    bpy.context.scene.frame_set(3)
    hair.data.add_curves([16])
    before = scenes.positions(hair)
    bpy.context.scene.frame_set(5)
    assert np.array_equal(scenes.positions(hair), before)
    state, message = playback.status(hair)
    assert state == playback.BROKEN
    assert "strands were added or removed" in message


def test_what_cannot_be_attached_changes_nothing(hair, playback, tmp_path):
    errors = scenes.module("backend.errors")
    before, keys = scenes.scene_state(), list(hair.data.keys())
    other = scenes.groom(scenes.wavy_strands(5), "Other")
    simulated(tmp_path / "other", other)
    bpy.data.objects.remove(other)
    bpy.data.hair_curves.remove(bpy.data.hair_curves["Other"])
    with pytest.raises(errors.InputError, match="The cache is of 80 points, 'Hair' has 320"):
        playback.attach(hair, tmp_path / "other")
    with pytest.raises(errors.FileError, match="no simulation cache"):
        playback.attach(hair, tmp_path / "nowhere")
    scenes.module("backend.io.sim_cache").CacheWriter.create(tmp_path / "empty", len(hair.data.points), fps=24).close()
    with pytest.raises(errors.FileError, match="no whole frame"):
        playback.attach(hair, tmp_path / "empty")
    assert scenes.scene_state() == before
    assert list(hair.data.keys()) == keys
    assert list(hair.modifiers) == []


def test_other_scenes_and_grooms_without_a_cache_are_left_alone(hair, played, playback):
    still = scenes.groom(scenes.wavy_strands(5, seed=1), "Still")
    before = scenes.positions(still)
    bpy.context.scene.frame_set(4)
    assert np.array_equal(scenes.positions(still), before)
    elsewhere = bpy.data.scenes.new("Elsewhere")
    elsewhere.frame_set(2)
    assert np.array_equal(scenes.positions(hair), played[3])


def test_the_operators_want_a_cache(hair):
    for operator in (bpy.ops.hairloom.free_cache, bpy.ops.hairloom.play_again):
        with pytest.raises(RuntimeError, match="plays no simulation cache"):
            operator()


# --- Cycles ------------------------------------------------------------------------------------------------------


def rendered(tmp_path, *, blur: bool) -> np.ndarray:
    """(H, W) brightness of a tiny picture from the front."""
    scene = bpy.context.scene
    scene.render.use_motion_blur = blur
    scene.render.filepath = str(tmp_path / f"blur-{blur}.png")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    pixels = np.empty(4 * 48 * 48, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(48, 48, 4)[..., 0]


def studio() -> None:
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", 32
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.render.resolution_x = scene.render.resolution_y = 48
    scene.render.motion_blur_shutter = 1.0
    (scene.render if hasattr(scene.render, "motion_blur_position") else scene.cycles).motion_blur_position = "CENTER"
    scene.view_settings.view_transform = "Raw"
    scene.world = None  # black
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 0.4
    camera.location = (0.0, -1.0, 0.0)
    camera.rotation_euler = (np.pi / 2, 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera


def bright(obj: bpy.types.Object) -> None:
    material = bpy.data.materials.new("Bright")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    emission, output = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    obj.data.materials.append(material)


def test_cycles_blurs_the_motion(playback, tmp_path):
    """One upright strand that moves 5 pixels a frame: blurred over the frame it is 5 wider, and as much fainter."""
    line = np.zeros((1, 8, 3), np.float32)
    line[0, :, 2] = np.linspace(-0.15, 0.15, 8)
    line[..., 0] = -0.1
    hair = scenes.groom(line)
    radius = hair.data.attributes.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", np.full(8, 0.4 / 48, np.float32))
    bright(hair)
    studio()
    simulated(tmp_path / "cache", hair, shift=5 * 0.4 / 48)
    playback.attach(hair, tmp_path / "cache")
    bpy.context.scene.frame_set(3)
    sharp, blurred = (rendered(tmp_path, blur=blur) for blur in (False, True))
    (place, spread, light), (blurred_place, blurred_spread, blurred_light) = across(sharp), across(blurred)
    # the shutter is open half a frame before and after: the same place, the same light, and the variance of an even
    # spread over 5 pixels, 25 / 12, more; 32 samples a pixel over 24 rows leave about a per cent of noise
    assert blurred_place == pytest.approx(place, abs=0.2)
    assert blurred_light == pytest.approx(light, rel=0.03)
    assert blurred_spread - spread == pytest.approx(25 / 12, rel=0.1)
    hair.modifiers["Hairloom Motion Blur"].show_render = False
    assert across(rendered(tmp_path, blur=True))[1] == pytest.approx(spread, abs=0.02)


def across(picture: np.ndarray) -> tuple[float, float, float]:
    """Mean, variance and sum of the brightness from left to right, pixels, in the middle rows."""
    row = picture[12:36].mean(axis=0)
    column = np.arange(len(row))
    mean = (column * row).sum() / row.sum()
    return mean, ((column - mean) ** 2 * row).sum() / row.sum(), row.sum()
