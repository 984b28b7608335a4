"""The wizard's photos: files to images and planes, masks, scribbles, swapped and mirrored views, saving and undo."""

from __future__ import annotations

import json

import bpy
import fourview_scenes as small
import numpy as np
import pytest
import scenes


def bridge():
    return scenes.module("bridge.image")


def scribble(kind: str, *points: tuple[float, float]) -> None:
    bpy.ops.hairloom.four_view_scribble("EXEC_DEFAULT", True, kind=kind, points=json.dumps(points))


def test_photos_get_their_view_from_their_names_and_keep_their_pixels(tmp_path):
    small.start(tmp_path)
    photos = small.project().photos
    assert [photo.view for photo in photos] == list(small.VIEWS)
    for number, photo in enumerate(photos):
        assert photo.image.packed_file is not None
        assert np.array_equal(bridge().read_pixels(photo.image), small.picture(number))
        assert photo.plane.data == photo.image
        assert photo.plane.users_collection[0].name == "Four Views"


@pytest.mark.parametrize(
    ("names", "views"),
    [
        (("a.png", "b.png", "c.png"), ["front", "back", "left"]),
        (("side_left.png", "x_BACK.png", "me.png"), ["left", "back", "front"]),
        (("front1.png", "front2.png"), ["front", "back"]),
    ],
)
def test_views_that_are_not_named_are_those_that_are_free(names, views):
    taken: set[str] = set()
    for name, view in zip(names, views, strict=True):
        assert scenes.module("fourview").guess_view(name, taken) == view
        taken.add(view)


def test_a_huge_photo_is_scaled_down(tmp_path):
    path = tmp_path / "huge.png"
    scenes.module("backend.io.images").write_image(path, np.zeros((3000, 600, 3), np.uint8))
    assert bridge().read_photo(path).shape == (2000, 400, 3)


@pytest.mark.parametrize("kind", ["missing", "text", "cut", "tiny"])
def test_a_bad_file_adds_nothing(tmp_path, kind):
    good = small.write_pictures(tmp_path, ("front",))
    bad = tmp_path / "bad_back.png"
    data = (tmp_path / "photo_front.png").read_bytes()
    if kind == "tiny":
        scenes.module("backend.io.images").write_image(bad, np.zeros((4, 4, 3), np.uint8))
    elif kind != "missing":
        bad.write_bytes({"text": b"no picture", "cut": data[: len(data) // 2]}[kind])
    with pytest.raises(RuntimeError, match=r"bad_back\.png"):
        small.add_photos([*good, str(bad)])
    assert not small.project().photos
    assert not bpy.data.images


def test_there_are_eight_photos_at_most(tmp_path):
    paths = small.write_pictures(tmp_path, ("front", "back", "left", "right", "top"))
    small.add_photos(paths)
    with pytest.raises(RuntimeError, match="3 more can be added"):
        small.add_photos(paths)
    small.add_photos(paths[:3])
    fourview = scenes.module("fourview")
    assert fourview.names(small.project())[5:] == ["other", "other_2", "other_3"] or len(small.project().photos) == 8
    with pytest.raises(RuntimeError, match="which is the most"):
        small.add_photos(paths[:1])


def test_scribbles_are_drawn_where_they_are(tmp_path):
    small.start(tmp_path, ("front",))
    small.project().brush_size = 4
    scribble("hair", (20, 30), (60, 30))
    scribble("background", (5, 90), (5, 95))
    inputs = bridge().segment_inputs(small.project().photos[0], guess=False)
    assert inputs["hair"].shape == small.SIZE[::-1]
    rows, columns = np.nonzero(inputs["hair"])
    assert abs(rows.mean() + 0.5 - 30) < 0.6  # the middle of the line, to a pixel's half
    assert 17 <= columns.min() <= 19
    assert 60 <= columns.max() <= 62
    assert 3 <= np.ptp(rows) + 1 <= 6  # 4 pixels wide, to how OpenCV rounds
    assert inputs["background"][92, 5]
    assert not (inputs["hair"] & inputs["background"]).any()


def test_the_eraser_takes_out_what_it_passes(tmp_path):
    small.start(tmp_path, ("front",))
    small.project().brush_size = 4
    scribble("hair", (10, 30), (80, 30))
    scribble("erase", (40, 10), (40, 60))
    drawn = bridge().drawn(small.project().photos[0].scribbles, "hair", small.SIZE)
    assert not drawn[:, 38:42].any()
    assert drawn[30, 15]
    assert drawn[30, 75]
    scribble("erase", (0, 30), (89, 30))
    assert small.project().photos[0].scribbles == ""


def test_each_scribble_is_one_undo_step(tmp_path):
    small.start(tmp_path, ("front",))
    bpy.ops.ed.undo_push(message="before")
    scribble("hair", (10, 30), (80, 30))
    first = small.project().photos[0].scribbles
    scribble("hair", (10, 40), (80, 40))
    assert small.project().photos[0].scribbles != first
    bpy.ops.ed.undo()
    assert small.project().photos[0].scribbles == first
    bpy.ops.ed.undo()
    assert small.project().photos[0].scribbles == ""


def test_a_scribble_beside_the_photo_changes_nothing(tmp_path):
    small.start(tmp_path, ("front",))
    assert bpy.ops.hairloom.four_view_scribble(kind="hair", points="[[-5, 3], [-9, 8]]") == {"CANCELLED"}
    with pytest.raises(RuntimeError, match="No stroke is given"):
        bpy.ops.hairloom.four_view_scribble(kind="hair")


def test_the_brush_paints_the_mask_itself_and_undo_leads_back(tmp_path):
    small.start(tmp_path, ("front",), with_masks=True)
    small.project().brush_paints, small.project().brush_size = "MASK", 10
    bpy.ops.ed.undo_push(message="before")
    before = small.project().photos[0].mask_stamp
    scribble("hair", (45, 80), (45, 90))
    photo = small.project().photos[0]
    assert photo.mask_stamp != before
    assert bridge().read_mask(photo.mask)[85, 45]
    scribble("background", (0, 40), (89, 40))
    assert not bridge().read_mask(small.project().photos[0].mask)[40].any()
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    photo = small.project().photos[0]
    assert photo.mask_stamp == before
    assert np.array_equal(bridge().read_mask(photo.mask), small.mask())


def test_segmenting_follows_the_scribbles(tmp_path):
    small.start(tmp_path, ("front",))
    small.project().brush_size = 6
    scribble("hair", (30, 40), (60, 40))
    scribble("background", (4, 10), (4, 95), (85, 95), (85, 10))
    bpy.ops.hairloom.four_view_segment()
    photo = small.project().photos[0]
    found = bridge().read_mask(photo.mask)
    assert (found & small.mask()).sum() / (found | small.mask()).sum() > 0.93
    assert photo.mask.packed_file is not None


def test_guessing_masks_leaves_those_that_exist(tmp_path):
    small.start(tmp_path, ("front", "back"))
    bridge().set_mask(small.project().photos[1], "back", small.mask())
    kept = small.project().photos[1].mask_stamp
    bpy.ops.hairloom.four_view_guess_masks()
    assert small.project().photos[0].mask is not None
    assert small.project().photos[1].mask_stamp == kept
    with pytest.raises(RuntimeError, match="All photos have a mask"):
        bpy.ops.hairloom.four_view_guess_masks()


def test_masks_are_loaded_also_of_another_size(tmp_path):
    small.start(tmp_path, ("front",))
    images = scenes.module("backend.io.images")
    for name, made in (("same", small.mask()), ("double", small.mask((180, 200)))):
        images.write_image(tmp_path / f"{name}.png", made)
        bpy.ops.hairloom.four_view_load_mask(filepath=str(tmp_path / f"{name}.png"))
        found = bridge().read_mask(small.project().photos[0].mask)
        # the border of the smaller disc is a pixel's part off that of the larger
        assert np.mean(found != small.mask()) < 0.02, name


@pytest.mark.parametrize(
    ("size", "value", "message"), [((90, 100), 0, "marks nothing as hair"), ((100, 50), 1, "take a mask of this photo")]
)
def test_bad_masks_are_refused(tmp_path, size, value, message):
    small.start(tmp_path, ("front",), with_masks=True)
    before = small.project().photos[0].mask_stamp
    path = tmp_path / "bad.png"
    scenes.module("backend.io.images").write_image(path, np.full(size[::-1], bool(value)))
    with pytest.raises(RuntimeError, match=message):
        bpy.ops.hairloom.four_view_load_mask(filepath=str(path))
    assert small.project().photos[0].mask_stamp == before


def test_the_mask_cannot_be_painted_away(tmp_path):
    small.start(tmp_path, ("front",), with_masks=True)
    small.project().brush_paints, small.project().brush_size = "MASK", 1000
    with pytest.raises(RuntimeError, match="is empty"):
        scribble("background", (0, 50), (89, 50))


def test_swapped_photos_keep_their_cameras(tmp_path):
    small.start(tmp_path, ("left", "right"), with_masks=True)
    places = [photo.plane.matrix_world.copy() for photo in small.project().photos]
    small.project().active = 0
    bpy.ops.hairloom.four_view_swap(index=1)
    for index, photo in enumerate(small.project().photos):
        assert photo.plane.matrix_world == places[index]
        assert photo.plane.data == photo.image
        assert np.array_equal(bridge().read_pixels(photo.image), small.picture(1 - index))
        assert photo.image_stamp == bridge().stamp(small.picture(1 - index))
    assert [photo.view for photo in small.project().photos] == ["left", "right"]
    with pytest.raises(RuntimeError, match="with itself"):
        bpy.ops.hairloom.four_view_swap(index=0)


def test_a_mirrored_photo_is_mirrored_with_all_its_marks(tmp_path):
    small.start(tmp_path, ("left",), with_masks=True)
    photo = small.project().photos[0]
    scribble("hair", (10, 30), (20, 30))
    photo.landmarks = json.dumps({"nose": [15.0, 40.0]})
    bpy.ops.hairloom.four_view_mirror()
    photo = small.project().photos[0]
    assert np.array_equal(bridge().read_pixels(photo.image), small.picture(0)[:, ::-1])
    assert json.loads(photo.landmarks) == {"nose": [75.0, 40.0]}
    assert json.loads(photo.scribbles)[0]["points"] == [[80.0, 30.0], [70.0, 30.0]]
    assert np.array_equal(bridge().read_mask(photo.mask), small.mask()[:, ::-1])


def test_a_removed_photo_leaves_nothing_behind(tmp_path):
    small.start(tmp_path, with_masks=True)
    small.project().active = 3
    bpy.ops.hairloom.four_view_remove_image()
    assert [photo.view for photo in small.project().photos] == ["front", "back", "left"]
    assert small.project().active == 2
    assert len(bpy.data.images) == 6
    assert sorted(obj.name for obj in bpy.data.objects if obj.type == "EMPTY") == [
        "Back Photo", "Front Photo", "Left Photo"
    ]  # fmt: skip


def test_everything_is_saved(tmp_path):
    small.start(tmp_path, with_masks=True)
    scribble("hair", (10, 30), (20, 30))
    small.project().step = "CAMERAS"
    small.project().photos[1].plane.location.x = 0.25
    bpy.context.view_layer.update()
    scenes.reload(tmp_path)
    project = small.project()
    assert project.step == "CAMERAS"
    assert json.loads(project.photos[0].scribbles)[0]["kind"] == "hair"
    camera = scenes.module("bridge.camera").camera_of(project.photos[1])
    # the plane of a photo that is not shown has no place in Blender's own `matrix_world` then
    assert abs(scenes.module("backend.geometry.camera").camera_position(camera)[0] - 0.25) < 1e-6
    for number, photo in enumerate(project.photos):
        assert np.array_equal(bridge().read_pixels(photo.image), small.picture(number))
        assert np.array_equal(bridge().read_mask(photo.mask), small.mask())


def test_the_active_photo_alone_is_shown_unless_asked(tmp_path):
    small.start(tmp_path)
    project = small.project()

    def shown():
        return [not photo.plane.hide_viewport for photo in project.photos]

    project.active = 2
    assert shown() == [False, False, True, False]
    project.shown = "ALL"
    assert all(shown())
    project.shown = "NONE"
    assert not any(shown())
