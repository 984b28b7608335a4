"""The wizard's heavy steps: what the jobs are given, what they leave in the scene, what makes results stale, resuming.

The jobs themselves are the backend's and tested there; here stand-ins answer in their place.
"""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import fourview_scenes as small
import numpy as np
import pytest
import scenes

STAGES = ("shape", "texture", "directions", "strands")


def fourview():
    return scenes.module("fourview")


def sphere(radius: float = 0.12):
    """(V, 3) and (F, 3) of a ball."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3, radius=radius)
    obj = bpy.context.object
    head = scenes.module("bridge.mesh").read_head(obj)
    bpy.data.meshes.remove(obj.data)  # and the object with it
    return head.vertices, head.triangles


def made_shape():
    types, shape = scenes.module("backend.types"), scenes.module("backend.fourview.shape")
    vertices, triangles = sphere()
    upper = vertices[triangles][..., 2].min(axis=1) > 0
    strands = types.StrandSet(np.zeros((2, 3), np.float32), np.array([0, 2], np.int32))
    return shape.RoughShape(
        types.Mesh(vertices, triangles), types.Mesh(vertices, triangles[upper]), strands, "bob",
        np.array([0.96, 0.95, 0.94, 0.93]), ("the back is hidden",),
    )  # fmt: skip


def texture_outputs(inputs):
    """A texture whose upper left quarter is red, on the shape's surface; what nobody looks at is empty."""
    shape = inputs["shape"]
    image = np.zeros((64, 64, 3), np.uint8)
    image[:32, :32] = (255, 0, 0)
    texture = scenes.module("backend.fourview.texture").HairTexture(
        64, np.arange(4, dtype=np.int32), np.zeros((4, 3), np.float32), np.array([1, 1, 1, 0], np.float32)
    )
    corner_uv = np.full((len(shape.open.triangles), 3, 2), (0.25, 0.25), np.float32)
    surface_module = scenes.module("backend.fourview.surface")
    texels = scenes.module("backend.fourview.texels")
    count = 4
    zero3 = np.zeros((count, 3), np.float32)
    texel_map = texels.TexelMap(
        64, np.arange(4, dtype=np.int32), np.zeros(4, np.int32), zero3, zero3, zero3, 0.001, np.zeros((0, 2), np.int32)
    )
    level = surface_module.Level(
        texel_map, zero3, zero3, zero3, zero3, np.zeros(5, np.int32), np.zeros(0, np.int32),
        np.arange(4, dtype=np.int32), np.zeros((4, 9), np.int32),
    )  # fmt: skip
    surface = surface_module.HairSurface(shape.open, np.zeros_like(shape.open.vertices), corner_uv, (level,))
    return {"surface": surface, "texture": texture, "image": image}


def directions_outputs(inputs):
    vertices = inputs["shape"].open.vertices
    normals = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    down = np.tile(np.float32([0, 0, -1]), (len(vertices), 1))
    cls = scenes.module("backend.fourview.directions").SurfaceDirections
    return {"directions": cls(vertices, down, np.ones(len(vertices), np.float32), normals)}


def strands_outputs(inputs):
    types = scenes.module("backend.types")
    points = scenes.wavy_strands(50)
    offsets = np.arange(51, dtype=np.int32) * points.shape[1]
    color = np.tile(np.float32([0.5, 0.2, 0.1, 1.0]), (50, 1))
    strands = types.StrandSet(points.reshape(-1, 3), offsets, {}, {"groom_color": color})
    quality = scenes.module("backend.fourview.quality")
    report = quality.quality_report(strands, inputs["views"], inputs["head"])
    assert report["penetration"]["point_share"] == 0
    report["views"]["front"] |= {"mask_iou": 0.951, "orientation_median_deg": 12.3}
    return {"strands": strands, "report": report}


def answers(monkeypatch):
    """Stand-ins for all jobs."""
    asked = {}
    outputs = {
        "four_view_shape": lambda _: {"shape": made_shape(), "remarks": ["the back is hidden"]},
        "four_view_texture": texture_outputs,
        "four_view_directions": directions_outputs,
        "four_view_strands": strands_outputs,
    }

    def run(name, inputs, params, progress=None):
        asked[name] = (inputs, params)
        return outputs[name](inputs)

    monkeypatch.setattr(scenes.module("backend.registry"), "run_job", run)
    return asked


def run_stages(*stages: str) -> None:
    for stage in stages or STAGES:
        getattr(bpy.ops.hairloom, f"four_view_{stage}")("EXEC_DEFAULT", True)


def states() -> list[str]:
    return [fourview().state(bpy.context, stage).kind for stage in STAGES]


def test_the_shape_job_gets_views_as_they_are(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    asked = answers(monkeypatch)
    run_stages("shape")
    inputs, params = asked["four_view_shape"]
    assert [view.name for view in inputs["views"]] == list(small.VIEWS)
    for number, view in enumerate(inputs["views"]):
        assert np.array_equal(view.image, small.picture(number))
        assert np.array_equal(view.mask, small.mask())
        assert view.camera.size == small.SIZE
    assert inputs["head"].scalp.any()
    assert params == bpy.context.scene.hairloom.four_view.to_params()


def test_each_step_shows_its_result(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    answers(monkeypatch)
    project = small.project()
    run_stages("shape")
    shape = made_shape()
    assert len(project.closed_object.data.polygons) == len(shape.closed.triangles)
    assert len(project.open_object.data.polygons) == len(shape.open.triangles)
    assert project.closed_object.hide_get()
    assert "Most like 'bob'" in project.shape.report
    assert "front 96%" in project.shape.report
    assert "the back is hidden" in project.shape.report
    run_stages("texture")
    picture = bpy.data.images["Hair Texture"]
    assert picture.packed_file is not None
    # our v counts down, Blender's up: (0.25, 0.25) of ours is in the upper left, which is red
    uv = project.open_object.data.uv_layers.active.uv[0].vector
    assert tuple(uv) == (0.25, 0.75)
    pixel = 4 * (int(uv[1] * 64) * 64 + int(uv[0] * 64))
    assert tuple(picture.pixels[pixel : pixel + 3]) == (1, 0, 0)
    assert project.open_object.data.materials[0].node_tree.nodes["Hair Texture"].image == picture
    assert "75% of the hair" in project.texture.report
    run_stages("directions")
    lines = project.lines_object.data
    assert len(lines.edges) == 2 * len(shape.open.vertices)
    first, second = (np.array(lines.vertices[v].co) for v in lines.edges[0].vertices)
    assert np.allclose((second - first) / np.linalg.norm(second - first), [0, 0, -1], atol=1e-5)
    run_stages("strands")
    hair = project.hair_object
    assert len(hair.data.curves) == 50
    assert hair.parent == hair.data.surface == bpy.context.scene.hairloom.head
    assert "surface_uv_coordinate" in hair.data.attributes
    assert np.allclose(scenes.values(hair, "groom_color", np.float32, 4, "color")[0], [0.5, 0.2, 0.1, 1])
    assert hair.data.materials[0].name == "Hairloom Photo Hair"
    assert "Front: mask 95%, directions 12° off" in project.strands.report
    assert states() == ["DONE"] * 4


def test_running_a_step_again_replaces_its_objects(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    answers(monkeypatch)
    run_stages()
    before = sorted(obj.name for obj in bpy.data.objects)
    images, meshes = len(bpy.data.images), len(bpy.data.meshes)
    run_stages()
    assert sorted(obj.name for obj in bpy.data.objects) == before
    assert (len(bpy.data.images), len(bpy.data.meshes)) == (images, meshes)


def test_later_steps_get_what_earlier_ones_made(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    asked = answers(monkeypatch)
    run_stages()
    assert set(asked["four_view_texture"][0]) == {"views", "head", "shape"}
    assert set(asked["four_view_directions"][0]) == {"views", "head", "shape", "surface", "texture", "strokes"}
    assert set(asked["four_view_strands"][0]) == {"views", "head", "shape", "directions"}
    assert np.array_equal(asked["four_view_strands"][0]["shape"].closed.vertices, made_shape().closed.vertices)


def test_own_hairstyles_join_the_search(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    asked = answers(monkeypatch)
    run_stages("shape")
    assert "folders" not in asked["four_view_shape"][0]
    bpy.context.scene.hairloom.four_view.grooms_folder = str(tmp_path)
    assert states()[0] == "STALE"
    run_stages("shape")
    assert asked["four_view_shape"][0]["folders"] == [str(tmp_path)]


def test_no_step_before_its_turn(tmp_path, monkeypatch):
    small.start(tmp_path)
    answers(monkeypatch)
    with pytest.raises(RuntimeError, match="has no mask yet"):
        run_stages("shape")
    small.give_masks()
    with pytest.raises(RuntimeError, match="There is no shape yet"):
        run_stages("texture")
    run_stages("shape")
    with pytest.raises(RuntimeError, match="There is no texture yet"):
        run_stages("directions")


@pytest.mark.parametrize(
    ("change", "stale", "reason"),
    [
        ("camera", 4, "the camera of 'left'"), ("mask", 4, "the mask of 'front'"), ("head", 4, "the head"),
        ("shape_setting", 4, "the settings of the shape"), ("texture_setting", 3, "the settings of the texture"),
        ("stroke", 2, "the strokes"), ("strands_setting", 1, "the settings of the strands"), ("photo", 4, "the photo"),
    ],
)  # fmt: skip
def test_what_changed_makes_later_results_stale(tmp_path, monkeypatch, change, stale, reason):
    small.start(tmp_path, with_masks=True)
    answers(monkeypatch)
    run_stages()
    project, settings = small.project(), bpy.context.scene.hairloom.four_view
    if change == "camera":
        project.photos[2].plane.location.x += 0.01
    elif change == "mask":
        project.brush_paints = "MASK"
        bpy.ops.hairloom.four_view_scribble(kind="background", points="[[40, 40]]")
    elif change == "head":
        bpy.context.scene.hairloom.head.location.z += 0.01
    elif change == "shape_setting":
        settings.shape.resolution = 64
    elif change == "texture_setting":
        settings.texture.seed = 3
    elif change == "strands_setting":
        settings.strands.n_strands = 100
    elif change == "stroke":
        project.strokes = '[{"view":"front","points":[[40,30],[40,60]]}]'
    elif change == "photo":
        project.photos[0].image_stamp = "other"
    assert states() == ["DONE"] * (4 - stale) + ["STALE"] * stale
    first = STAGES[4 - stale]
    assert reason in fourview().state(bpy.context, first).text
    if stale > 1:
        later = STAGES[5 - stale]
        with pytest.raises(RuntimeError, match="out of date"):
            run_stages(later)


def test_changing_it_back_makes_results_good_again(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    answers(monkeypatch)
    run_stages()
    plane = small.project().photos[0].plane
    before = plane.location.copy()
    plane.location.x += 0.01
    assert states() == ["STALE"] * 4
    plane.location = before
    assert states() == ["DONE"] * 4


def test_a_step_is_one_undo_step_and_undo_leads_back_to_the_result_before(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    answers(monkeypatch)
    run_stages("shape")
    bpy.ops.ed.undo_push(message="before")
    key = small.project().shape.key
    bpy.context.scene.hairloom.four_view.shape.resolution = 64
    bpy.ops.ed.undo_push(message="setting")
    run_stages("shape")
    assert small.project().shape.key != key
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    assert small.project().shape.key == key
    assert states()[0] == "DONE"
    assert fourview().read_result(bpy.context, "shape")["shape"].style == "bob"


def test_saving_takes_the_results_along_and_reloading_resumes(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    answers(monkeypatch)
    run_stages("shape", "texture")
    assert fourview().result_path("shape", small.project().shape.key).is_relative_to(bpy.app.tempdir)
    scenes.reload(tmp_path)
    project = small.project()
    assert states() == ["DONE", "DONE", "NONE", "NONE"]
    path = fourview().result_path("shape", project.shape.key)
    assert path == tmp_path / "hairloom_cache" / "saved" / "four_view" / f"shape-{project.shape.key}.npz"
    monkeypatch.undo()
    asked = answers(monkeypatch)
    run_stages("directions", "strands")
    assert asked["four_view_directions"][0]["shape"].style == "bob"
    assert states() == ["DONE"] * 4
    path.unlink()
    assert states()[0] == "LOST"
    with pytest.raises(RuntimeError, match="is gone"):
        run_stages("texture")


def test_only_the_last_two_results_are_kept(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    answers(monkeypatch)
    for resolution in (50, 60, 70, 80):
        bpy.context.scene.hairloom.four_view.shape.resolution = resolution
        run_stages("shape")
    assert len(list(fourview().results_folder().glob("shape-*.npz"))) == 2


def test_a_full_disk_changes_nothing(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    answers(monkeypatch)
    (tmp_path / "file").write_text("no folder")
    bpy.context.scene.hairloom.four_view.cache_folder = str(tmp_path / "file")
    before = scenes.scene_state()
    with pytest.raises(RuntimeError, match="choose another Results folder"):
        run_stages("shape")
    assert scenes.scene_state() == before
    assert small.project().shape.key == ""


def test_a_stage_stays_as_it_was_when_its_job_fails(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    answers(monkeypatch)
    run_stages("shape")
    key = small.project().shape.key
    error = scenes.module("backend.errors").InputError("the mask of view 'left' cannot be satisfied")

    def fails(*_, **__):
        raise error

    monkeypatch.setattr(scenes.module("backend.registry"), "run_job", fails)
    with pytest.raises(RuntimeError, match="'left' cannot be satisfied"):
        run_stages("texture")
    assert (small.project().shape.key, small.project().texture.key) == (key, "")


# --- strokes -----------------------------------------------------------------------------------------------------


def stroke(points: list[tuple[float, float]], camera: str = "") -> set[str]:
    return bpy.ops.hairloom.four_view_stroke("EXEC_DEFAULT", True, points=json.dumps(points), camera=camera)


def test_strokes_lie_on_the_hair_and_reach_the_job(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    asked = answers(monkeypatch)
    run_stages("shape", "texture")
    width, height = small.SIZE
    centre = (0.5 * width, 0.31 * height)  # of the upper half of the ball, where the shape is
    stroke([centre, (centre[0], centre[1] + 9)])
    bridge = scenes.module("bridge.fourview")
    line = bridge.strokes_in_world(bpy.context)[0]
    # drawn on the front, so before the ball, 2 mm off it; from above down
    assert np.allclose(np.linalg.norm(line, axis=1), 0.12, atol=4e-3)
    assert (line[:, 1] < 0).all()
    assert line[0, 2] > line[1, 2]
    run_stages("directions")
    found = asked["four_view_directions"][0]["strokes"]
    assert len(found) == 1
    assert np.allclose(found[0].points, [centre, (centre[0], centre[1] + 9)])
    assert np.array_equal(
        found[0].camera.world_to_camera, asked["four_view_directions"][0]["views"][0].camera.world_to_camera
    )


def test_strokes_from_any_side_keep_the_camera_of_their_view(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    answers(monkeypatch)
    run_stages("shape", "texture")
    cameras = scenes.module("backend.geometry.camera")
    above = cameras.standard_camera("top", (0, 0, 0), 1000.0, (400, 400))
    numbers = json.dumps({"camera": scenes.module("bridge.camera").camera_numbers(above)})
    stroke([(200, 200), (260, 200)], numbers)
    line = scenes.module("bridge.fourview").strokes_in_world(bpy.context)[0]
    assert line[0, 2] == pytest.approx(0.122, abs=2e-3)  # on the ball's top
    assert line[1, 0] == pytest.approx(0.06, abs=1e-3)  # right in the picture is the person's left
    assert len(scenes.module("bridge.fourview").read_strokes(bpy.context)) == 1


@pytest.mark.parametrize(
    ("points", "message"), [([(1, 1), (1, 20)], "does not touch the hair"), ([], "No stroke is given")]
)
def test_strokes_off_the_hair_are_refused(tmp_path, monkeypatch, points, message):
    small.start(tmp_path, with_masks=True)
    answers(monkeypatch)
    run_stages("shape")
    with pytest.raises(RuntimeError, match=message):
        bpy.ops.hairloom.four_view_stroke(points=json.dumps(points) if points else "")
    assert small.project().strokes == ""


def test_a_dot_is_no_stroke_and_strokes_are_removed(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    answers(monkeypatch)
    run_stages("shape")
    assert stroke([(45, 40), (46, 40)]) == {"CANCELLED"}
    stroke([(45, 30), (45, 45)])
    stroke([(40, 30), (40, 45)])
    bpy.ops.hairloom.four_view_remove_strokes(every=False)
    assert len(json.loads(small.project().strokes)) == 1
    bpy.ops.hairloom.four_view_remove_strokes(every=True)
    assert small.project().strokes == ""


def test_no_stroke_without_a_shape(tmp_path):
    small.start(tmp_path, with_masks=True)
    with pytest.raises(RuntimeError, match="no shape yet to draw on"):
        stroke([(45, 30), (45, 45)])


# --- lines over the view, and the project's file -----------------------------------------------------------------


def test_the_border_of_the_shape_is_where_its_camera_sees_it(tmp_path, monkeypatch):
    head = small.start(tmp_path, with_masks=True)
    answers(monkeypatch)
    run_stages("shape")
    photo = small.project().photos[0]
    lines = scenes.module("bridge.fourview").silhouette(bpy.context, photo)
    assert len(lines) % 2 == 0
    # the solid is a ball around the head: its border in every view is a circle of its radius on the plane
    from_middle = lines - np.array(photo.plane.matrix_world.translation)[None]
    centre = np.array(head.location) - np.array(photo.plane.matrix_world.translation)
    radius = np.linalg.norm(from_middle - centre * np.array([1, 0, 1]), axis=1)
    pixel = 1 / scenes.module("bridge.camera").camera_of(photo).intrinsics[0, 0]
    assert np.allclose(radius, 0.12, atol=1.5 * pixel)


def test_the_border_of_the_mask_is_on_the_plane(tmp_path):
    small.start(tmp_path, with_masks=True)
    photo = small.project().photos[1]
    lines = scenes.module("bridge.fourview").mask_outline(photo)
    camera = scenes.module("bridge.camera").camera_of(photo)
    pixels = scenes.module("backend.geometry.camera").project(camera, lines)[:, :2]
    rows, columns = np.nonzero(small.mask())
    assert np.allclose(pixels.min(axis=0), [columns.min(), rows.min()], atol=1.5)
    assert np.allclose(pixels.max(axis=0), [columns.max() + 1, rows.max() + 1], atol=1.5)


def test_the_project_file_says_what_the_wizard_knows(tmp_path, monkeypatch):
    small.start(tmp_path, with_masks=True)
    answers(monkeypatch)
    run_stages("shape")
    small.project().brush_size = 5
    bpy.ops.hairloom.four_view_scribble(kind="hair", points="[[30, 30], [50, 30]]")
    small.project().photos[0].landmarks = json.dumps({"nose": [44.0, 60.0]})
    stroke([(45, 30), (45, 45)])
    settings = bpy.context.scene.hairloom.four_view
    settings.strands.n_strands, settings.n_tried, settings.with_detail = 1234, 3, False
    path = tmp_path / "out" / "hair.toml"
    path.parent.mkdir()
    bpy.ops.hairloom.four_view_write_project(filepath=str(path))
    project = scenes.module("backend.fourview.project").read_project(Path(path))
    found = scenes.module("backend.fourview.inputs").read_inputs(project)
    expected = scenes.module("bridge.fourview").read_views(bpy.context)
    for view, other in zip(found.views, expected, strict=True):
        assert view.name == other.name
        assert np.array_equal(view.image, other.image)
        assert np.array_equal(view.mask, other.mask)
        assert np.allclose(view.camera.world_to_camera, other.camera.world_to_camera)
        assert np.allclose(view.camera.intrinsics, other.camera.intrinsics)
    assert project.views[0].scribbles[0].width == 5
    assert project.views[0].landmarks["nose"] == (44, 60)
    assert len(found.strokes) == 1
    assert project.settings["strands"]["n_strands"] == 1234
    head = scenes.module("bridge.mesh").read_head(bpy.context.scene.hairloom.head)
    assert np.allclose(found.head.vertices[found.head.triangles], head.vertices[head.triangles], atol=1e-6)
    scalp = scenes.module("bridge.inputs").read_scalp(bpy.context.scene.hairloom.head).scalp
    assert 0 < scalp.sum() < len(scalp)
    assert np.array_equal(found.head.scalp, scalp)
    params = scenes.module("backend.fourview.pipeline").FourViewParams
    built = scenes.module("backend.registry").build_params(params, project.settings)
    assert (built.strands.n_strands, built.n_tried, built.with_detail) == (1234, 3, False)


def test_steps_go_on_and_back():
    project = small.project()
    bpy.ops.hairloom.four_view_step(by=-1)
    assert project.step == "IMAGES"
    for _ in range(9):
        bpy.ops.hairloom.four_view_step(by=1)
    assert project.step == "STRANDS"
    bpy.ops.hairloom.four_view_step(by=-2)
    assert project.step == "TEXTURE"
