"""Guides, helices and simulation of a groom as operators: results, playback, undo, files, and what is refused."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes

FRAMES = 10
N_STRANDS, N_GUIDES = 60, 12


@pytest.fixture
def groom(tmp_path):
    """60 wavy strands attached to a ball that shakes, in a saved file with a range of 10 frames; small settings."""
    head = scenes.sphere_head()
    bpy.context.scene.hairloom.head = head
    scenes.small_settings()
    for frame in range(1, FRAMES + 1):
        head.rotation_euler = (0.0, 0.0, math.radians(20.0) * math.sin(2 * math.pi * 2 * (frame - 1) / 24))
        head.keyframe_insert("rotation_euler", frame=frame)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, FRAMES
    scene.frame_set(1)
    scenes.groom(scenes.wavy_strands(N_STRANDS))
    bpy.ops.hairloom.attach_to_head()
    settings().guides.n_guides = N_GUIDES
    settings().fit.n_max = 6
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shake.blend"))
    return hair()


@pytest.fixture
def guided(groom):
    bpy.ops.hairloom.make_guides()
    return groom


@pytest.fixture
def simulated(guided):
    assert bpy.ops.hairloom.simulate() == {"FINISHED"}
    return guided


def settings():
    return bpy.context.scene.hairloom.simulation


def hair() -> bpy.types.Object:
    return next(obj for obj in bpy.data.objects if obj.type == "CURVES" and obj.name == "Hair")


def playback():
    return scenes.module("playback")


def world(obj) -> np.ndarray:
    return scenes.module("bridge.curves").read_strands(obj).points


def refused(run, match: str) -> None:
    """It ends with one line, and nothing is changed but unfinished files."""
    before, playing = scenes.scene_state(), playback().folder(hair())
    with pytest.raises(RuntimeError, match=match) as caught:
        run()
    assert str(caught.value).strip().count("\n") == 0
    assert (scenes.scene_state(), playback().folder(hair())) == (before, playing)


# --- guides ------------------------------------------------------------------------------------------------------


def test_guides_are_attributes_of_the_strands(guided):
    is_guide, guide_of = scenes.values(guided, "hairloom_guide", np.bool_), scenes.values(guided, "hairloom_guide_of")
    assert is_guide.sum() == N_GUIDES
    # each number has one guide, which follows itself
    assert sorted(guide_of[is_guide]) == list(range(N_GUIDES))
    assert guide_of.min() == 0
    assert guided.hairloom_simulation.n_guides == N_GUIDES


def test_guides_are_those_of_the_command_line(guided):
    inputs = scenes.module("bridge.inputs").strands_and_head({"groom": guided, "head": bpy.context.scene.hairloom.head})
    params = settings().guides.to_params()
    outputs = scenes.module("backend.registry").run_job("make_guides", inputs, params)
    guides, number = scenes.module("bridge.guides").read_guides(guided)
    assert (guides == outputs["guides"]).all()
    assert (number == outputs["wisps"]).all()


def test_guides_from_wisps_that_are_there(groom):
    settings().guides_from_wisps = True
    assert "no wisps" in scenes.module("simulation").why_no_guides_job(bpy.context)
    labels = (np.arange(N_STRANDS) % 7).astype(np.int32)
    scenes.module("bridge.wisps").write_labels(groom, [labels])
    bpy.ops.hairloom.make_guides()
    assert (scenes.values(groom, "hairloom_guide_of") == labels).all()


def test_guides_survive_saving_and_duplicating(guided, tmp_path):
    before = scenes.values(guided, "hairloom_guide_of").tobytes()
    scenes.reload(tmp_path)
    assert scenes.values(hair(), "hairloom_guide_of").tobytes() == before
    scenes.activate(hair())
    bpy.ops.object.duplicate()
    copy = bpy.context.object
    assert scenes.values(copy, "hairloom_guide_of").tobytes() == before
    assert copy.hairloom_simulation.n_guides == N_GUIDES


def test_making_guides_is_one_undo_step(groom):
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.make_guides("EXEC_DEFAULT", True)) == 1


def test_removed_strands_keep_the_other_guides(guided):
    """Removing followers does no harm; removing a guide is said."""
    bridge = scenes.module("bridge.guides")
    followers = np.flatnonzero(~scenes.values(guided, "hairloom_guide", np.bool_))
    guided.data.remove_curves(indices=followers[:5].tolist())
    guides, number = bridge.read_guides(guided)
    assert (len(guides), len(number)) == (N_GUIDES, N_STRANDS - 5)
    assert (number[guides] == np.arange(N_GUIDES)).all()
    # one whose wisp has other strands
    lonely = guides[np.bincount(number)[number[guides]] > 1]
    guided.data.remove_curves(indices=[int(lonely[0])])
    with pytest.raises(scenes.module("backend.errors").InputError, match="run Make Guides again"):
        bridge.read_guides(guided)


def test_selecting_guides(guided):
    bpy.ops.hairloom.select_guides()
    selected = scenes.values(guided, ".selection", np.bool_)
    assert (selected == scenes.values(guided, "hairloom_guide", np.bool_)).all()
    assert guided.data.selection_domain == "CURVE"


def test_extracting_guides(guided):
    guided.location.x = 0.5
    bpy.context.view_layer.update()
    bpy.ops.hairloom.extract_guides()
    new = bpy.context.object
    assert (new.name, len(new.data.curves), new.parent, new.data.surface) == (
        "Hair Guides", N_GUIDES, guided.parent, guided.data.surface
    )  # fmt: skip
    guides, _ = scenes.module("bridge.guides").read_guides(guided)
    expected = world(guided).reshape(N_STRANDS, -1, 3)[guides]
    assert np.abs(world(new).reshape(expected.shape) - expected).max() < 1e-6
    assert "hairloom_guide" not in new.data.attributes


def test_no_guides_no_simulation(groom):
    simulation = scenes.module("simulation")
    for why in (simulation.why_no_guides, simulation.why_no_simulation):
        assert why(bpy.context) == "The groom has no guides yet: press Make Guides"
    for operator in ("simulate", "resume_simulation", "fit_helices", "select_guides", "extract_guides"):
        assert not getattr(bpy.ops.hairloom, operator).poll(), operator


# --- helices -----------------------------------------------------------------------------------------------------


def test_helices_are_shown_with_their_break_points(guided):
    bpy.ops.hairloom.fit_helices()
    shown = bpy.data.objects["Hair Helices"]
    assert (shown.parent, shown.hide_render) == (guided, True)
    outputs = scenes.module("backend.registry").run_job(
        "fit_helices", scenes.module("bridge.simulation").fit_inputs(guided), settings().fit.to_params()
    )
    helices = outputs["fit"].helices
    is_break = scenes.values(shown, "hairloom_break", np.bool_)
    n_breaks = (helices.element_counts - 1).sum()
    assert is_break.sum() == n_breaks
    assert len(shown.data.curves) == N_GUIDES + 3 * n_breaks
    # each star is around its break point, and has another colour
    stars = world(shown)[len(is_break) - 6 * n_breaks :].reshape(n_breaks, 6, 3)
    assert np.abs(stars.mean(axis=1) - world(shown)[is_break]).max() < 1e-6
    color = scenes.values(shown, "hairloom_wisp_color", np.float32, 4, "color")
    assert len(np.unique(color, axis=0)) == 2
    # a strand's helices end where the whole strand does, so every piece starts in the right place and frame
    tips = scenes.module("backend.rods.helices").evaluate(helices, 2)[0][:, 1]
    counts = 8 * helices.element_counts + 1
    assert np.abs(world(shown)[np.cumsum(counts) - 1] - tips).max() < 1e-6
    assert "12 guides of" in guided.hairloom_simulation.fit_report


def test_the_overlay_is_replaced_hidden_and_shown(guided):
    for _ in range(2):
        bpy.ops.hairloom.fit_helices()
    assert sum("Helices" in obj.name for obj in bpy.data.objects) == 1
    assert len(bpy.data.hair_curves) == 2
    bpy.ops.hairloom.show_helices(show=False)
    assert bpy.data.objects["Hair Helices"].hide_viewport
    bpy.ops.hairloom.show_helices(show=True)
    assert not bpy.data.objects["Hair Helices"].hide_viewport


# --- simulation --------------------------------------------------------------------------------------------------


def test_a_simulation_plays_back(simulated):
    assert playback().status(simulated) == ("PLAYING", "Plays frames 1 to 10")
    rest = scenes.module("playback").rest_positions(simulated)
    scene = bpy.context.scene
    moved = []
    for frame in range(1, FRAMES + 1):
        scene.frame_set(frame)
        moved.append(np.linalg.norm(scenes.positions(simulated) - rest, axis=1))
    moved = np.array(moved)
    # at the first frame the groom as it was; roots stay on the head; tips lag behind it
    assert moved[0].max() == 0.0
    assert moved[:, ::16].max() < 1e-5
    assert moved[-1].max() > 1e-3
    assert moved.max() < 0.2
    assert "10 frames of 12 guides" in simulated.hairloom_simulation.report


def test_hair_at_rest_stays_in_place(guided):
    """The head does not move: what hangs in equilibrium stays where it is."""
    bpy.context.scene.hairloom.head.animation_data_clear()
    bpy.context.scene.hairloom.head.rotation_euler = (0.0, 0.0, 0.0)
    bpy.ops.hairloom.simulate()
    rest = playback().rest_positions(guided)
    bpy.context.scene.frame_set(FRAMES)
    assert np.linalg.norm(scenes.positions(guided) - rest, axis=1).max() < 1e-4


def test_simulating_is_one_undo_step(guided):
    bpy.context.scene.frame_set(FRAMES)
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.simulate("EXEC_DEFAULT", True)) == 1


def command_simulate(arguments: list[str]) -> None:
    """`hairloom simulate`, without what shows its progress, which Blender does not have."""
    found = {}

    def command(name, run, text, *parents):
        found[name] = argparse.ArgumentParser(parents=parents), run
        return found[name][0]

    groom = argparse.ArgumentParser(add_help=False)
    groom.add_argument("hair", type=Path)
    groom.add_argument("--units")
    scenes.module("backend.cli_rods").add_commands(command, groom)
    parser, run = found["simulate"]
    run(parser.parse_args(arguments), lambda stage: None, lambda fraction, message: None)


def test_the_same_numbers_as_on_the_command_line(groom, tmp_path):
    """The groom, the head as .obj and its motion as .npz, given to `hairloom simulate`; every strand is a guide, since
    the scalp that the command finds is not the vertex group."""
    settings().guides.n_guides = N_STRANDS
    bpy.ops.hairloom.make_guides()
    bpy.ops.hairloom.simulate()
    reading = scenes.module("bridge.simulation").read_scene(
        bpy.context, groom, bpy.context.scene.hairloom.head, [], friction=0.3, air_speed=1.0
    )
    scenes.module("backend.io.strands").write_strands(tmp_path / "hair.npz", reading.strands)
    solid = reading.scene.colliders[0]
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in solid.vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in solid.triangles.tolist()]
    (tmp_path / "head.obj").write_text("\n".join(lines))
    np.savez(tmp_path / "motion.npz", motion=reading.scene.motion)
    (tmp_path / "scene.toml").write_text(
        'fps = 24\n[head]\nmesh = "head.obj"\nunits = "m,z-up"\n[motion]\nfile = "motion.npz"\n'
        f"[guides]\nn_guides = {N_STRANDS}\n[settings.fit]\nn_max = 6\n"
    )
    arguments = [str(tmp_path / name) for name in ("hair.npz", "scene.toml", "out.npz")]
    command_simulate(arguments)
    expected = np.load(tmp_path / "out.npz")["positions"]
    assert expected.shape[0] == FRAMES
    for frame in range(FRAMES):
        bpy.context.scene.frame_set(1 + frame)
        # both are rounded to float32, Blender's in the space of the object
        assert np.abs(world(groom) - expected[frame]).max() < 1e-6, frame


def test_the_operator_makes_what_the_job_makes(guided, tmp_path):
    bpy.ops.hairloom.simulate()
    simulation = scenes.module("bridge.simulation")
    reading = simulation.read_scene(
        bpy.context, guided, bpy.context.scene.hairloom.head, [], friction=0.3, air_speed=1.0
    )
    params = settings().to_params() | {"cache": str(tmp_path / "other")}
    scenes.module("backend.registry").run_job("simulate", simulation.simulation_inputs(reading, guided), params)
    cache = scenes.module("backend.io.sim_cache")
    mine, other = cache.CacheReader(playback().folder(guided)), cache.CacheReader(tmp_path / "other")
    for frame in range(1, FRAMES + 1):
        assert mine.frame(frame).tobytes() == other.frame(frame).tobytes(), frame


def test_simulating_again_starts_from_the_groom_not_from_the_cache(simulated):
    bpy.context.scene.frame_set(FRAMES)
    first = scenes.positions(simulated).tobytes()
    before = playback().folder(simulated)
    bpy.ops.hairloom.simulate()
    assert playback().folder(simulated) != before
    assert scenes.positions(simulated).tobytes() == first


def test_saved_and_opened_again_it_plays(simulated, tmp_path):
    bpy.context.scene.frame_set(7)
    expected = scenes.positions(simulated).tobytes()
    bpy.context.scene.frame_set(1)
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    bpy.context.scene.frame_set(7)
    assert scenes.positions(hair()).tobytes() == expected


def test_caches_lie_beside_the_file_and_old_ones_go(guided, tmp_path):
    for _ in range(4):
        bpy.ops.hairloom.simulate()
    folder = tmp_path / "hairloom_cache" / "shake" / "Hair"
    assert playback().folder(guided).parent == folder
    # the one that plays, and the one before for undo
    assert sorted(path.name for path in folder.iterdir()) == ["3", "4"]


def test_undo_of_the_second_simulation_plays_the_first(guided):
    bpy.ops.hairloom.simulate()
    first = playback().folder(hair())
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.hairloom.simulate("EXEC_DEFAULT", True)
    bpy.ops.ed.undo()
    assert playback().folder(hair()) == first
    assert playback().status(hair())[0] == "PLAYING"


def cut_short(obj, n_frames: int) -> Path:
    """The cache that the next simulation would write, as a worker leaves it that was ended after some frames."""
    job = scenes.module("backend.jobs.simulate")
    original = job.write_cache

    def ended(setting, params):
        for frame in original(setting, params):
            if frame >= n_frames:
                raise scenes.module("backend.errors").Cancelled("ended")
            yield frame

    folder = scenes.module("simulation").next_cache(obj)
    job.write_cache = ended
    try:
        with pytest.raises(RuntimeError):
            bpy.ops.hairloom.simulate()
    finally:
        job.write_cache = original
    return folder


def test_resume_gives_what_one_go_gives(guided):
    folder = cut_short(guided, 5)
    assert playback().folder(guided) is None
    kept = scenes.module("simulation").unfinished(guided)
    assert (kept.folder, kept.n_frames, kept.n_planned) == (folder, 5, FRAMES)
    assert bpy.ops.hairloom.resume_simulation() == {"FINISHED"}
    bpy.context.scene.frame_set(FRAMES)
    resumed = scenes.positions(guided).tobytes()
    assert not bpy.ops.hairloom.resume_simulation.poll()
    bpy.ops.hairloom.simulate()
    assert scenes.positions(guided).tobytes() == resumed


def test_resume_after_a_change_is_refused(guided):
    cut_short(guided, 5)
    settings().material.young = 2.0
    refused(lambda: bpy.ops.hairloom.resume_simulation(), "another groom or with other settings")
    settings().material.young = 3.9
    bpy.context.scene.hairloom.head.animation_data_clear()
    refused(lambda: bpy.ops.hairloom.resume_simulation(), "another groom or with other settings")


# --- refused -----------------------------------------------------------------------------------------------------


def test_a_failure_leaves_what_plays_alone(simulated):
    bpy.context.scene.frame_set(6)
    cut_short(simulated, 3)
    before = scenes.positions(simulated).tobytes()
    bpy.context.scene.frame_set(2)
    bpy.context.scene.frame_set(6)
    assert scenes.positions(simulated).tobytes() == before
    assert playback().status(simulated)[0] == "PLAYING"


def test_one_frame_is_no_simulation(guided):
    bpy.context.scene.frame_end = 1
    assert scenes.module("simulation").why_no_simulation(bpy.context) == "The scene has one frame: set its end frame"


def test_an_edit_after_the_simulation_is_said_and_not_simulated_over(simulated):
    bpy.context.scene.frame_set(5)
    moved = scenes.positions(simulated)
    moved[7] += 0.01
    simulated.data.position_data.foreach_set("vector", moved.ravel())
    bpy.context.scene.frame_set(6)
    assert playback().status(simulated)[0] == "EDITED"
    assert "edited after the simulation" in scenes.module("simulation").why_no_simulation(bpy.context)
    assert not bpy.ops.hairloom.simulate.poll()


def test_strands_added_after_making_guides_are_said(guided):
    guided.data.add_curves([16])
    assert "press it again" in scenes.module("simulation").why_no_simulation(bpy.context)


def test_a_collider_without_faces_is_refused(guided):
    collection = bpy.data.collections.new("Hats")
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(bpy.data.objects.new("Empty", bpy.data.meshes.new("Empty")))
    bpy.context.view_layer.update()
    settings().colliders = collection
    refused(lambda: bpy.ops.hairloom.simulate(), "'Empty' has no faces at frame 1")


def test_a_folder_that_cannot_be_written_is_refused(guided, tmp_path):
    (tmp_path / "file").write_text("")
    settings().cache_folder = str(tmp_path / "file")
    refused(lambda: bpy.ops.hairloom.simulate(), "cannot write a cache in")


def test_the_params_of_the_job_travel_as_json(guided):
    json.dumps(settings().to_params())
