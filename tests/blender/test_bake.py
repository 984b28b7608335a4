"""Baking: Alembic and USD as Blender reads them back, playback without the add-on, files for Unreal."""

from __future__ import annotations

import glob
import sys

import bpy
import numpy as np
import pytest
import scenes
from caches import N_FRAMES, simulated
from test_playback import across, bright, rendered, shown, studio

needs_alembic = pytest.mark.skipif(not bpy.app.build_options.alembic, reason="this Blender was built without Alembic")


@pytest.fixture(scope="module")
def usd() -> None:
    """Python's USD: part of Blender from blender.org; the pip module has it, but not where Python looks."""
    pattern = bpy.utils.resource_path("LOCAL") + "/python/lib/python3*/site-packages"
    sys.path.extend(path for path in glob.glob(pattern) if path not in sys.path)
    pytest.importorskip("pxr.Usd")


@pytest.fixture
def hair(tmp_path):
    """A groom of strands with 3 to 6 points and a radius."""
    counts = [3 + i % 4 for i in range(20)]
    curves = bpy.data.hair_curves.new("Hair")
    curves.add_curves(counts)
    rng = np.random.default_rng(0)
    curves.position_data.foreach_set("vector", rng.normal(size=3 * sum(counts)).astype(np.float32))
    curves.attributes.new("radius", "FLOAT", "POINT")
    curves.attributes["radius"].data.foreach_set("value", rng.random(sum(counts)).astype(np.float32))
    curves.set_types(type="POLY")
    obj = bpy.data.objects.new("Hair", curves)
    bpy.context.collection.objects.link(obj)
    scenes.activate(obj)
    return obj


@pytest.fixture
def played(hair, tmp_path):
    playback = scenes.module("playback")
    frames = simulated(tmp_path / "cache", hair, frame_start=5)
    playback.attach(hair, tmp_path / "cache")
    return frames


def radius(obj: bpy.types.Object) -> np.ndarray:
    return scenes.values(obj, "radius", np.float32)


def in_world(obj: bpy.types.Object) -> np.ndarray:
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    matrix = np.array(evaluated.matrix_world, np.float64)
    return scenes.positions(evaluated) @ matrix[:3, :3].T + matrix[:3, 3]


def imported(path) -> bpy.types.Object:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    if path.suffix == ".abc":
        bpy.ops.wm.alembic_import(filepath=str(path), as_background_job=False)
    else:
        bpy.ops.wm.usd_import(filepath=str(path))
    return next(obj for obj in bpy.data.objects if obj.type == "CURVES")


@needs_alembic
def test_alembic_is_read_by_blender_bit_by_bit(hair, played, tmp_path):
    widths = radius(hair)
    assert bpy.ops.hairloom.bake_alembic(filepath=str(tmp_path / "hair.abc")) == {"FINISHED"}
    back = imported(tmp_path / "hair.abc")
    assert np.array_equal(radius(back), widths)
    assert [curve.points_length for curve in back.data.curves] == [3 + i % 4 for i in range(20)]
    assert (scenes.values(back, "curve_type", np.int8) == 1).all()
    for frame in (5, 10, 7, 6):
        bpy.context.scene.frame_set(frame)
        assert np.array_equal(shown(back.name), played[frame - 5])


def test_usd_is_read_by_blender_bit_by_bit(usd, hair, played, tmp_path):
    widths = radius(hair)
    assert bpy.ops.hairloom.bake_usd(filepath=str(tmp_path / "hair.usdc")) == {"FINISHED"}
    back = imported(tmp_path / "hair.usdc")
    assert np.array_equal(radius(back), widths)
    for frame in (5, 10, 7):
        bpy.context.scene.frame_set(frame)
        assert np.array_equal(shown(back.name), played[frame - 5])


def test_usd_in_pieces_is_the_same(usd, hair, played, tmp_path, monkeypatch):
    monkeypatch.setattr(scenes.module("bridge.bake"), "_USD_BYTES", 1)
    bpy.ops.hairloom.bake_usd(filepath=str(tmp_path / "hair.usd"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "hair.usd"]
    back = imported(tmp_path / "hair.usd")
    bpy.context.scene.frame_set(9)
    assert np.array_equal(shown(back.name), played[4])


def test_without_usd_the_message_says_so(hair, played, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pxr.Usd", None)
    with pytest.raises(RuntimeError, match="has no USD for Python; bake to Alembic"):
        bpy.ops.hairloom.bake_usd(filepath=str(tmp_path / "hair.usdc"))
    assert not (tmp_path / "hair.usdc").exists()


@needs_alembic
@pytest.mark.parametrize("space", ["WORLD", "OBJECT"])
def test_space_of_the_positions(hair, played, tmp_path, space):
    scene = bpy.context.scene
    for frame, x in ((5, 0.0), (10, 5.0)):
        hair.location.x = x
        hair.keyframe_insert("location", frame=frame)
    hair.rotation_euler.z = 0.5
    scene.frame_set(8)
    world = in_world(hair)
    scene.frame_set(3)
    bpy.ops.hairloom.bake_alembic(filepath=str(tmp_path / "hair.abc"), space=space)
    assert scene.frame_current == 3
    back = imported(tmp_path / "hair.abc")
    bpy.context.scene.frame_set(8)
    wanted = world if space == "WORLD" else played[3]
    assert np.abs(in_world(back) - wanted).max() < 1e-6


@needs_alembic
def test_baked_playback_needs_no_addon(hair, played, tmp_path):
    playback = scenes.module("playback")
    hair.location.x = 2.0
    hair.data.attributes.new("mine", "INT", "CURVE")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert bpy.ops.hairloom.bake_playback(filepath=str(tmp_path / "hair.abc")) == {"FINISHED"}
    assert playback.status(hair)[0] == playback.NONE
    assert [modifier.type for modifier in hair.modifiers] == ["MESH_SEQUENCE_CACHE"]
    assert bpy.data.cache_files[0].filepath == "//hair.abc"
    bpy.ops.wm.save_mainfile()
    addon = bpy.context.preferences.addons
    module = scenes.MODULE
    bpy.ops.preferences.addon_disable(module=module)
    try:
        assert module not in addon
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
        for frame in (5, 10, 8):
            bpy.context.scene.frame_set(frame)
            assert np.array_equal(shown(), played[frame - 5])
            evaluated = bpy.data.objects["Hair"].evaluated_get(bpy.context.evaluated_depsgraph_get())
            assert evaluated.matrix_world.translation.x == 2.0
            assert "mine" in evaluated.data.attributes
    finally:
        bpy.ops.preferences.addon_enable(module=module)


@needs_alembic
def test_a_new_simulation_replaces_the_baked_file(hair, played, tmp_path):
    bpy.ops.hairloom.bake_playback(filepath=str(tmp_path / "hair.abc"))
    assert np.array_equal(scenes.positions(hair), played[0])
    again = simulated(tmp_path / "again", hair, shift=0.1)
    scenes.module("playback").attach(hair, tmp_path / "again")
    bpy.context.scene.frame_set(4)
    assert np.array_equal(shown(), again[3])


@needs_alembic
def test_bake_playback_is_one_undo_step(hair, played, tmp_path):
    path = str(tmp_path / "hair.abc")
    bpy.context.scene.frame_set(8)
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.bake_playback("EXEC_DEFAULT", True, filepath=path)) == 1
    bpy.context.scene.frame_set(9)
    assert np.array_equal(shown(), played[4])


def test_what_cannot_be_baked_says_why(hair, tmp_path):
    operators = [bpy.ops.hairloom.bake_alembic, bpy.ops.hairloom.bake_usd, bpy.ops.hairloom.bake_playback]
    for operator in operators:
        with pytest.raises(RuntimeError, match="no simulation yet: press Simulate first"):
            operator(filepath=str(tmp_path / "hair.abc"))
    with pytest.raises(RuntimeError, match="no simulation yet"):
        bpy.ops.hairloom.export_unreal(filepath=str(tmp_path / "hair.abc"), content="CACHE")
    simulated(tmp_path / "cache", hair)
    scenes.module("playback").attach(hair, tmp_path / "cache")
    for operator in (bpy.ops.hairloom.bake_alembic, bpy.ops.hairloom.export_unreal):
        with pytest.raises(RuntimeError, match="cannot write"):
            operator(filepath=str(tmp_path / "nowhere" / "hair.abc"))
    (tmp_path / "cache" / "header.json").write_text("{")
    with pytest.raises(RuntimeError, match=r"header\.json"):
        bpy.ops.hairloom.bake_alembic(filepath=str(tmp_path / "hair.abc"))
    assert not (tmp_path / "hair.abc").exists()


# --- Unreal ------------------------------------------------------------------------------------------------------


def unreal_objects(path) -> dict[str, object]:
    archive = scenes.module("backend.io.ogawa_read").Archive(path)
    return {found.path: found.properties for found in archive.top.walk()}


def with_guides(hair) -> np.ndarray:
    is_guide = np.arange(20) % 5 == 0
    curves = scenes.module("bridge.curves")
    scenes.module("bridge.attributes").write_attribute(hair.data, "hairloom_guide", "BOOLEAN", "CURVE", is_guide)
    curves.write_strand_ints(hair, "hairloom_guide_of", (np.arange(20) // 5).astype(np.int32))
    return np.flatnonzero(is_guide)


def test_a_groom_for_unreal(hair, tmp_path):
    guides = with_guides(hair)
    uv = np.random.default_rng(1).random((20, 2)).astype(np.float32)
    attributes = scenes.module("bridge.attributes")
    attributes.write_attribute(hair.data, "surface_uv_coordinate", "FLOAT2", "CURVE", uv)
    attributes.write_attribute(hair.data, "color", "FLOAT_COLOR", "CURVE", np.full((20, 4), 0.25, np.float32))
    attributes.write_attribute(hair.data, "groom_group_id", "INT", "CURVE", np.repeat(np.int32([3, 8]), 10))
    hair.location.z = 1.0
    bpy.context.view_layer.update()
    assert bpy.ops.hairloom.export_unreal(filepath=str(tmp_path / "groom.abc")) == {"FINISHED"}
    objects = unreal_objects(tmp_path / "groom.abc")
    assert list(objects)[1:] == ["/groom", *(f"/groom/{n}" for n in ("guides_3", "strands_3", "guides_8", "strands_8"))]
    geom = objects["/groom/strands_8"][".geom"]
    points = np.concatenate(
        [np.arange(c.first_point_index, c.first_point_index + c.points_length) for c in hair.data.curves[10:]]
    )
    wanted = (scenes.positions(hair) + np.float32([0, 0, 1]))[points] * np.float32([100, -100, 100])
    assert np.allclose(geom["P"].sample(), wanted, atol=1e-4)
    assert np.allclose(geom["width"].sample(), radius(hair)[points] * 200, rtol=1e-6)
    params = geom[".arbGeomParams"]
    assert np.array_equal(params["groom_root_uv"].sample(), uv[10:])
    assert (params["groom_color"].sample() == 0.25).all()
    assert (params["groom_group_id"].sample(), params["groom_guide"].sample()) == (8, 0)
    # the guide of its own group of five is always among the closest three
    own = np.arange(10, 20) // 5
    assert (params["groom_closest_guides"].sample() == own[:, None]).any(axis=1).all()
    assert objects["/groom/guides_3"][".geom"]["P"].n_samples == 1
    assert len(guides) == 4


def test_a_groom_cache_for_unreal_has_the_same_strands(hair, played, tmp_path):
    with_guides(hair)
    for frame, x in ((5, 1.0), (10, 5.0)):
        hair.location.x = x
        hair.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(5)
    for content in ("GROOM", "CACHE", "GUIDES"):
        bpy.ops.hairloom.export_unreal(filepath=str(tmp_path / f"{content}.abc"), content=content, axes="Y_UP")
    groom, cache, guides = (unreal_objects(tmp_path / f"{c}.abc") for c in ("GROOM", "CACHE", "GUIDES"))
    assert list(groom) == list(cache)
    assert list(guides)[1:] == ["/groom", "/groom/guides_0"]
    still, moving = (objects["/groom/strands_0"][".geom"] for objects in (groom, cache))
    assert np.array_equal(still["P"].sample(), moving["P"].sample(0))
    assert moving["P"].n_samples == N_FRAMES
    last = moving["P"].sample(N_FRAMES - 1)
    # the hair's motion, from where the object was first, without the object's
    assert np.allclose(np.stack([last[:, 0] - 1, -last[:, 2], last[:, 1]], axis=1), played[-1], atol=1e-6)
    bpy.ops.hairloom.export_unreal(filepath=str(tmp_path / "moved.abc"), content="CACHE", axes="Y_UP", with_motion=True)
    moved = unreal_objects(tmp_path / "moved.abc")["/groom/strands_0"][".geom"]["P"].sample(N_FRAMES - 1)
    assert np.allclose(moved[:, 0] - last[:, 0], 4.0, atol=1e-5)


def test_a_groom_without_guides_or_radius(tmp_path):
    scenes.groom(scenes.wavy_strands(10))
    bpy.ops.hairloom.export_unreal(filepath=str(tmp_path / "groom.abc"))
    objects = unreal_objects(tmp_path / "groom.abc")
    assert list(objects)[1:] == ["/groom", "/groom/strands_0"]
    assert np.allclose(objects["/groom/strands_0"][".geom"]["width"].sample(), 0.008)
    assert objects["/groom/strands_0"][".geom"][".arbGeomParams"]["groom_group_name"].sample() == ["Hair"]


@needs_alembic
def test_blender_reads_the_file_for_unreal(hair, tmp_path):
    with_guides(hair)
    before = scenes.positions(hair)
    bpy.ops.hairloom.export_unreal(filepath=str(tmp_path / "groom.abc"), axes="Y_UP")
    imported(tmp_path / "groom.abc")
    back = max((obj for obj in bpy.data.objects if obj.type == "CURVES"), key=lambda obj: len(obj.data.points))
    assert np.array_equal(shown(back.name), before)


@needs_alembic
def test_cycles_blurs_what_blender_plays(tmp_path):
    line = np.zeros((1, 8, 3), np.float32)
    line[0, :, 2] = np.linspace(-0.15, 0.15, 8)
    line[..., 0] = -0.1
    hair = scenes.groom(line)
    hair.data.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", np.full(8, 0.4 / 48, np.float32))
    bright(hair)
    studio()
    simulated(tmp_path / "cache", hair, shift=5 * 0.4 / 48)
    scenes.module("playback").attach(hair, tmp_path / "cache")
    bpy.ops.hairloom.bake_playback(filepath=str(tmp_path / "hair.abc"))
    bpy.context.scene.frame_set(3)
    sharp, blurred = (across(rendered(tmp_path, blur=blur)) for blur in (False, True))
    # as in test_playback: the variance of an even spread over 5 pixels more
    assert blurred[1] - sharp[1] == pytest.approx(25 / 12, rel=0.1)
