"""Saved details: saving, the list, applying without the source groom, the asset library, and what is refused."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
from test_transfer import small_groom, strands_of, turning


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """The user's folder of details, an empty one for each test."""
    library = scenes.module("detail_library")
    monkeypatch.setattr(library, "user_folder", lambda: tmp_path)
    return tmp_path


@pytest.fixture
def scene(folder):
    """Curly hair, active, and plain hair on one ball, attached."""
    scenes.module("bridge.hierarchies").clear()
    head = scenes.sphere_head()
    bpy.context.scene.hairloom.head = head
    scenes.small_settings()
    plain = small_groom("Plain", seed=1)
    bpy.ops.hairloom.attach_to_head()
    curly = small_groom("Curly", curl=0.006)
    bpy.ops.hairloom.attach_to_head()
    return curly, plain, head


def names() -> list[str]:
    return [detail.name for detail in scenes.module("detail_library").saved_details() if not detail.is_bundled]


def saved(name: str = "Ringlets", **settings) -> None:
    assert bpy.ops.hairloom.save_detail(name=name, **settings) == {"FINISHED"}


def test_saving_writes_three_files_and_changes_nothing_in_the_scene(scene, folder):
    before, counts = scenes.scene_state(), [len(bpy.data.images), len(bpy.data.materials)]
    saved()
    assert sorted(path.name for path in folder.iterdir()) == ["Ringlets.blend", "Ringlets.npz", "Ringlets.png"]
    assert scenes.scene_state() == before
    assert [len(bpy.data.images), len(bpy.data.materials)] == counts
    assert names() == ["Ringlets"]


def test_a_saved_detail_is_applied_when_its_groom_is_long_gone(scene):
    curly, plain, head = scene
    bpy.context.scene.hairloom.details.source = curly
    scenes.activate(plain)
    bpy.ops.hairloom.transfer_details()
    from_groom = turning(bpy.context.object)
    scenes.activate(curly)
    saved()
    bpy.data.objects.remove(curly)
    scenes.module("bridge.hierarchies").clear()
    scenes.activate(plain)
    assert bpy.ops.hairloom.apply_detail(detail="Ringlets") == {"FINISHED"}
    new = bpy.context.object
    assert (new.name, new.data.surface, len(new.data.curves)) == ("Plain Ringlets", head, len(plain.data.curves))
    assert np.abs(strands_of(new).roots - strands_of(plain).roots).max() < 1e-6
    assert turning(new) == pytest.approx(from_groom, rel=0.05)


def test_a_few_strands_are_enough(scene):
    saved(n_strands=100)
    scenes.activate(scene[1])
    bpy.ops.hairloom.apply_detail(detail="Ringlets")
    assert turning(bpy.context.object) > 1.5 * turning(scene[1])


def test_hair_of_other_settings_is_clustered_as_the_detail_was(scene):
    saved()
    synthesis = bpy.context.scene.hairloom.synthesis
    synthesis.hierarchy.n_levels, synthesis.n_samples = 2, 24
    scenes.activate(scene[1])
    assert bpy.ops.hairloom.apply_detail(detail="Ringlets") == {"FINISHED"}
    # 16 points of the detail's settings, each segment perhaps in several pieces
    segments = len(bpy.context.object.data.points) / len(bpy.context.object.data.curves) - 1
    assert segments % 15 == 0


def test_the_result_can_be_updated_and_followed_live(scene):
    saved()
    scenes.activate(scene[1])
    bpy.ops.hairloom.apply_detail(detail="Ringlets")
    new = bpy.context.object
    first = scenes.positions(new).tobytes()
    bpy.context.scene.hairloom.details.settings.strength = 0.3
    assert bpy.ops.hairloom.update_details() == {"FINISHED"}
    assert scenes.positions(new).tobytes() != first


def test_the_name_typed_in_the_panel_or_that_of_the_groom_is_taken(scene):
    state = bpy.context.window_manager.hairloom_details
    scene[0].name = "Mine: a/b"
    bpy.ops.hairloom.save_detail()
    bpy.ops.hairloom.save_detail()
    state.new_name = "Tight Coils"
    bpy.ops.hairloom.save_detail()
    state.new_name = ""
    assert names() == ["Mine  a b", "Mine  a b 2", "Tight Coils"]


def test_a_taken_name_is_refused_unless_overwritten(scene):
    saved()
    with pytest.raises(RuntimeError, match="there is a detail 'Ringlets' already; choose another name, or Overwrite"):
        bpy.ops.hairloom.save_detail(name="ringlets")
    saved(overwrite=True)
    assert names() == ["Ringlets"]


@pytest.mark.parametrize(
    "name", ["../evil", "a/b", "a\\b", "C:evil", ".hidden", "con", "LPT1.x", "dots..", "a\nb", "x" * 60 + "ü", "nul"]
)
def test_names_that_are_no_file_names_are_refused(scene, folder, name):
    library = scenes.module("detail_library")
    with pytest.raises(scenes.module("backend.errors").InputError):
        library.checked_name(name)
    assert list(folder.iterdir()) == []


def test_good_names_are_taken_as_they_are():
    library = scenes.module("detail_library")
    for name in ("Curly", "Engelslocken, weich", "3B coils (tight)", "巻き毛", "a.b"):
        assert library.checked_name(f" {name} ") == name


# --- the list and the asset browser --------------------------------------------------------------------------------


def test_the_list_follows_the_folder(scene, folder):
    items = scenes.module("live_details")._detail_items
    saved()
    item = next(item for item in items(None, None) if item[0] == "Ringlets")
    saved("Before")
    assert next(item for item in items(None, None) if item[0] == "Ringlets")[4] == item[4]
    (folder / "Before.npz").unlink()
    assert "Before" not in [item[0] for item in items(None, None)]
    bpy.context.window_manager.hairloom_details.saved_detail = "Ringlets"
    assert scenes.module("details").chosen_detail(bpy.context) == "Ringlets"


def test_files_that_are_being_written_are_not_listed(folder):
    (folder / ".saving-x").mkdir()
    (folder / ".part.npz").touch()
    (folder / "Folder.npz").mkdir()
    assert names() == []


def test_the_picture_shows_hair(scene, folder):
    saved()
    image = bpy.data.images.load(str(folder / "Ringlets.png"))
    pixels = np.empty(256 * 256 * 4, np.float32)
    image.pixels.foreach_get(pixels)
    red, green, blue, alpha = pixels.reshape(-1, 4).T
    assert 0.1 < alpha.mean() < 0.9
    # brown on a transparent ground, neither flat nor black
    hair = (alpha == 1) & (red > 1.3 * blue) & (green > blue)
    # 300 strands are few
    assert hair.mean() > 0.03
    assert red[hair].std() > 0.05


def asset(folder: Path) -> bpy.types.Object:
    with bpy.data.libraries.load(str(folder / "Ringlets.blend"), assets_only=True) as (source, wanted):
        assert list(source.objects) == ["Ringlets"]
        wanted.objects = ["Ringlets"]
    bpy.context.collection.objects.link(wanted.objects[0])
    return wanted.objects[0]


def test_the_asset_has_strands_material_picture_and_words(scene, folder):
    scene[0].data.materials.append(bpy.data.materials.new("Mine"))
    saved(n_strands=200)
    bpy.data.materials.remove(bpy.data.materials["Mine"])
    obj = asset(folder)
    assert (obj.type, obj.data.materials[0].name) == ("CURVES", "Mine")
    assert 80 < len(obj.data.curves) <= 200
    assert [tag.name for tag in obj.asset_data.tags] == ["detail"]
    assert "Details of 'Curly'" in obj.asset_data.description
    assert tuple(obj.preview.image_size) == (256, 256)
    # on the head that the groom was on
    assert np.abs(np.linalg.norm(strands_of(obj).roots, axis=1) - scenes.RADIUS).max() < 2e-3


def test_the_asset_in_the_scene_serves_as_source(scene, folder):
    _, plain, _ = scene
    saved()
    scenes.activate(plain)
    bpy.ops.hairloom.apply_detail(detail="Ringlets")
    applied = scenes.positions(bpy.context.object).tobytes()
    bpy.context.scene.hairloom.details.source = asset(folder)
    scenes.activate(plain)
    assert bpy.ops.hairloom.transfer_details() == {"FINISHED"}
    assert scenes.positions(bpy.context.object).tobytes() == applied
    assert bpy.context.object.hairloom_transfer.saved_detail == "Ringlets"


@pytest.mark.parametrize("named", ["Gone.npz", "../../etc/passwd", 7])
def test_an_asset_whose_file_is_missing_says_so(scene, named):
    curly, plain, _ = scene
    curly[scenes.module("detail_library").FILE_PROPERTY] = named
    bpy.context.scene.hairloom.details.source = curly
    scenes.activate(plain)
    if named == 7:
        assert bpy.ops.hairloom.transfer_details() == {"FINISHED"}
        return
    with pytest.raises(RuntimeError, match="stands for the saved detail"):
        bpy.ops.hairloom.transfer_details()


def test_the_library_is_registered_and_taken_away():
    library = scenes.module("detail_library")
    libraries = bpy.context.preferences.filepaths.asset_libraries
    library.register()
    assert [item.name for item in libraries].count("Hairloom Details") == 1
    library.unregister()
    assert "Hairloom Details" not in [item.name for item in libraries]
    library.register()


# --- refused -----------------------------------------------------------------------------------------------------


def test_no_such_detail(scene):
    before = scenes.scene_state()
    with pytest.raises(RuntimeError, match="there is no saved detail 'Nothing'"):
        bpy.ops.hairloom.apply_detail(detail="Nothing")
    with pytest.raises(RuntimeError, match="there is no saved detail"):
        bpy.ops.hairloom.apply_detail(detail="../Ringlets")
    assert scenes.scene_state() == before


@pytest.mark.parametrize("damage", ["cut", "text", "empty", "groom"])
def test_a_damaged_file_is_one_line(scene, folder, damage):
    saved()
    path = folder / "Ringlets.npz"
    content = path.read_bytes()
    if damage == "groom":
        strands = strands_of(scene[0])
        scenes.module("backend.io.strands").write_strands(path, strands)
    else:
        path.write_bytes({"cut": content[: len(content) // 2], "text": b"no zip", "empty": b""}[damage])
    scenes.activate(scene[1])
    before = scenes.scene_state()
    with pytest.raises(RuntimeError) as error:
        bpy.ops.hairloom.apply_detail(detail="Ringlets")
    assert "Ringlets.npz" in str(error.value)
    assert len(str(error.value).strip().splitlines()) == 1
    assert scenes.scene_state() == before


def test_a_folder_that_cannot_be_written_says_so(scene, monkeypatch):
    monkeypatch.setattr(scenes.module("detail_library"), "user_folder", lambda: None)
    with pytest.raises(RuntimeError, match="the user folder of Blender cannot be written"):
        bpy.ops.hairloom.save_detail(name="Ringlets")


def test_nothing_is_left_when_a_file_cannot_be_written(scene, folder, monkeypatch):
    def refuse(*_):
        raise RuntimeError("disk full")

    monkeypatch.setattr(scenes.module("bridge.detail_assets"), "write_asset", refuse)
    before = scenes.scene_state()
    with pytest.raises(RuntimeError, match=r"cannot save the detail 'Ringlets'.*disk full"):
        bpy.ops.hairloom.save_detail(name="Ringlets")
    assert list(folder.iterdir()) == []
    assert scenes.scene_state() == before


def test_polls_say_what_is_missing():
    details = scenes.module("details")
    assert "Select a groom" in details.why_no_base(bpy.context)
    assert not bpy.ops.hairloom.save_detail.poll()
    assert not bpy.ops.hairloom.apply_detail.poll()
