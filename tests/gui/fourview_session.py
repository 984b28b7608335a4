"""The four-view wizard in a window: photos of a starter groom, masks, cameras, shape, texture, directions, strands."""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "blender")]

import bpy  # noqa: E402
import driver  # noqa: E402
import numpy as np  # noqa: E402
import scenes  # noqa: E402
from bpy_extras.view3d_utils import location_3d_to_region_2d  # noqa: E402
from mathutils import Vector  # noqa: E402

LIMIT_SECONDS = 1500
WORK_SECONDS = 600  # compiling in the worker included
SIDE = 300  # pixels of the photos
VIEWS = ("front", "back", "left", "right")
groups: list[object] = []  # the gizmo group, once Blender has made it


def project() -> bpy.types.PropertyGroup:
    return bpy.context.scene.hairloom_four_view


def job() -> bpy.types.PropertyGroup:
    return bpy.context.window_manager.hairloom_job


def is_idle() -> bool:
    return not job().is_running


def only_our_panel_open() -> None:
    """The tab with nothing but the wizard, opened: finding a button takes seconds then, not minutes."""
    ui, ours = scenes.module("ui"), scenes.module("ui.fourview_panel")
    for part in reversed([part for part in ui._PARTS if part is not ours and hasattr(part, "unregister")]):
        part.unregister()
    ours.unregister()
    ours.HAIRLOOM_PT_four_view.bl_options = set()
    ours.register()


def photo_of(camera: object, strands: object, head: object, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) uint8: each strand of its own brown, brighter where it lies across; skin, a grey wall. And the mask."""
    raster = scenes.module("backend.geometry.strand_raster")
    mesh = scenes.module("backend.geometry.view_raster").raster_mesh(camera, head.vertices, head.triangles)
    drawn = raster.raster_strands(camera, strands, head, width_px=1.5)
    rng = np.random.default_rng(seed)
    picture = np.full((*drawn.strand.shape, 3), 225.0)
    picture[mesh.triangle >= 0] = (205, 160, 135)
    hair = drawn.strand >= 0
    shade = rng.uniform(0.55, 1.0, strands.n_strands)[drawn.strand[hair]]
    shade *= 0.7 + 0.5 * np.abs(np.cos(drawn.angle[hair]))
    picture[hair] = shade[:, None] * (110, 70, 42)
    picture += rng.normal(0, 3, picture.shape)
    return np.clip(picture, 0, 255).astype(np.uint8), raster.hair_mask(camera, strands, head)


def make_photos(folder: Path) -> None:
    """Four photos and masks of a starter groom on our head, which is left in the scene, bald."""
    assets = scenes.module("assets")
    names = [name for name, _ in assets.starter_grooms()]
    bpy.ops.hairloom.add_starter_groom(groom="Wavy" if "Wavy" in names else names[0])
    hair, head = bpy.context.object, bpy.context.scene.hairloom.head
    strands = scenes.module("bridge.curves").read_strands(hair)
    solid = scenes.module("bridge.mesh").read_head(head, "Scalp")
    points = np.concatenate([strands.points, solid.vertices])
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    scale = 0.9 * SIDE / float(np.ptp(points, axis=0).max())
    write = scenes.module("backend.io.images").write_image
    for number, view in enumerate(VIEWS):
        camera = scenes.module("backend.geometry.camera").standard_camera(view, centre, scale, (SIDE, SIDE))
        picture, mask = photo_of(camera, strands, solid, number)
        write(folder / f"{view}.png", picture)
        write(folder / f"{view}_mask.png", mask)
    bpy.data.hair_curves.remove(hair.data)


def set_the_scene(user: driver.User, folder: Path) -> driver.Steps:
    with user.override():
        bpy.ops.object.select_all(action="SELECT")
        bpy.ops.object.delete()
        make_photos(folder)
        space = user.area().spaces.active
        space.show_region_ui = True
        space.overlay.show_floor = space.overlay.show_cursor = space.overlay.show_axis_x = False
        space.show_gizmo_empty_image = False
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / "wizard.blend"))
        bpy.ops.ed.undo_push(message="Set the scene")
    yield 1.0
    user.region("UI").active_panel_category = "Hairloom"
    yield 1.0


def on_screen(user: driver.User, points: np.ndarray) -> list[tuple[float, float]]:
    """World points as pixels of the window."""
    region = user.region()
    view = user.area().spaces.active.region_3d
    found = [location_3d_to_region_2d(region, view, Vector(point)) for point in np.asarray(points).tolist()]
    return [(region.x + place.x, region.y + place.y) for place in found]


def pixels_on_screen(user: driver.User, photo: object, pixels: list[tuple[float, float]]) -> list[tuple[float, float]]:
    return on_screen(user, scenes.module("bridge.camera").pixels_in_world(photo, np.array(pixels)))


def choose(user: driver.User, index: int) -> driver.Steps:
    with user.override():
        bpy.ops.hairloom.four_view_choose("EXEC_DEFAULT", True, index=index, look=True)
    yield 1.0


def photos_are_added(user: driver.User, folder: Path) -> driver.Steps:
    with user.override():
        files = [{"name": f"{view}.png"} for view in VIEWS]
        bpy.ops.hairloom.four_view_add_images(
            "EXEC_DEFAULT", True, directory=str(folder), files=files, filepath=str(folder / "front.png")
        )
        project().shown = "ALL"
        for photo in project().photos:
            photo.plane.select_set(True)
        bpy.ops.view3d.view_selected()
    yield from user.picture("fourview_images")
    project().shown = "ACTIVE"
    yield from user.press("bpy.ops.hairloom.four_view_choose(")
    assert project().photos[project().active].view == "front"
    assert not user.area().spaces.active.region_3d.is_perspective


def a_mask_from_scribbles(user: driver.User, folder: Path) -> driver.Steps:
    yield from user.press("bpy.ops.hairloom.four_view_step(by=1")
    assert project().step == "SEGMENT"
    yield from user.press("bpy.ops.hairloom.four_view_guess_masks(")
    yield from user.wait(lambda: all(photo.mask is not None for photo in project().photos), 60, "guessed masks")
    yield from choose(user, 0)
    yield from user.picture("fourview_guessed")
    with user.override():
        bpy.ops.wm.tool_set_by_id(name="hairloom.four_view_scribble_tool")
    truth = scenes.module("backend.io.images").read_mask(folder / "front_mask.png")
    rows, columns = np.nonzero(truth)
    top = float(rows.min())
    middle = float(columns[rows < top + 30].mean())
    hair = [(middle + dx, top + 20.0) for dx in np.linspace(-20, 20, 12)]
    wall = [(4.0 + 12 * i, 6.0) for i in range(24)]
    yield from user.drag(pixels_on_screen(user, project().photos[0], hair))
    assert [one["kind"] for one in json.loads(project().photos[0].scribbles)] == ["hair"]
    yield from user.drag(pixels_on_screen(user, project().photos[0], wall), ctrl=True)
    kinds = [one["kind"] for one in json.loads(project().photos[0].scribbles)]
    assert kinds == ["hair", "background"], kinds
    yield from user.key("Z", ctrl=True)
    assert len(json.loads(project().photos[0].scribbles)) == 1, "Ctrl-Z takes the last scribble back"
    yield from user.key("Z", ctrl=True, shift=True)
    drawn = json.loads(project().photos[0].scribbles)[0]["points"]
    assert np.allclose(drawn[0], hair[0], atol=2.0), (drawn[0], hair[0])
    yield from user.picture("fourview_scribbles")
    stamp = project().photos[0].mask_stamp
    yield from user.press("bpy.ops.hairloom.four_view_segment(")
    yield from user.wait(is_idle, WORK_SECONDS, "the segmentation")
    yield 0.5
    found = scenes.module("bridge.image").read_mask(project().photos[0].mask)
    iou = (found & truth).sum() / (found | truth).sum()
    print(f"mask from scribbles: IoU {iou:.3f}, changed {stamp != project().photos[0].mask_stamp}", flush=True)
    assert iou > 0.6
    yield from user.picture("fourview_segmented")
    with user.override():
        bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
        for index, view in enumerate(VIEWS):
            project().active = index
            bpy.ops.hairloom.four_view_load_mask("EXEC_DEFAULT", True, filepath=str(folder / f"{view}_mask.png"))


def the_masks_border_is_dragged(user: driver.User) -> driver.Steps:
    yield from choose(user, 0)
    yield from user.press('bpy.ops.wm.tool_set_by_id(name="hairloom.four_view_border_tool"')
    project().border_size = 70
    before, stamp = front_mask(), project().photos[0].mask_stamp
    rows = np.flatnonzero(before.any(axis=1))
    y = int(rows[len(rows) // 3])
    x = float(np.flatnonzero(before[y])[-1] + 1)
    way = pixels_on_screen(user, project().photos[0], [(x + 2 + 3 * i, y + 0.5) for i in range(12)])
    yield from user.drag(way, release=False)
    yield from user.picture("fourview_border")
    yield from user.key("ESC")
    user.event("LEFTMOUSE", "RELEASE")
    yield 0.5
    assert project().photos[0].mask_stamp == stamp, "Esc leaves the mask as it was"
    yield from user.drag(way)
    after = front_mask()
    reached = int(np.flatnonzero(after[y])[-1] + 1)
    print(f"border: from {x:.0f} to {reached} pixels, {(after ^ before).sum()} pixels changed", flush=True)
    assert abs(reached - x - 33) <= 3, (x, reached)
    assert not (before & ~after).any() and project().photos[0].mask_stamp != stamp
    assert project().photos[0].mask_by_hand
    yield from user.picture("fourview_border_after")
    yield from user.into_view()
    yield from user.key("Z", ctrl=True)
    assert np.array_equal(front_mask(), before), "Ctrl-Z brings the mask back"
    # a press where no border is near grabs nothing
    far = pixels_on_screen(user, project().photos[0], [(3.0, 3.0), (30.0, 30.0)])
    yield from user.drag(far)
    assert np.array_equal(front_mask(), before)
    with user.override():
        bpy.ops.wm.tool_set_by_id(name="builtin.select_box")


def front_mask() -> np.ndarray:
    return scenes.module("bridge.image").read_mask(project().photos[0].mask)


def cameras_are_placed_and_corrected_by_hand(user: driver.User) -> driver.Steps:
    group = scenes.module("gizmos.view_plane").HAIRLOOM_GGT_view_plane
    original = group.setup

    def setup(self, context):
        original(self, context)
        groups.append(self)

    group.setup = setup
    yield from user.press("bpy.ops.hairloom.four_view_step(by=1")
    yield from user.press("bpy.ops.hairloom.four_view_place(")
    yield from user.wait(lambda: not is_idle(), 20, "the placement starts")
    yield from user.wait(is_idle, WORK_SECONDS, "the placement")
    yield from choose(user, 0)
    yield from user.picture("fourview_cameras")
    project().shown = "ALL"
    view = user.area().spaces.active.region_3d
    view.view_rotation = (0.85, 0.42, 0.13, 0.27)
    yield from user.picture("fourview_planes")
    project().shown = "ACTIVE"
    yield from choose(user, 0)
    yield from user.wait(lambda: bool(groups), 10, "handles")
    for name, change in (("move_x", "moved"), ("scale", "scaled"), ("tilt_y", "tilted"), ("turn", "turned")):
        yield from drag_handle(user, name, change)


def place_of(name: str) -> np.ndarray:
    matrix = groups[-1].handles[name].matrix_basis
    return np.array(matrix.translation), np.array(matrix.col[2].to_3d())


def drag_handle(user: driver.User, name: str, change: str) -> driver.Steps:
    """Find the handle along its arrow or ring, drag it 40 pixels, and take it back."""
    yield 0.5
    start, along = place_of(name)
    first, second = on_screen(user, np.stack([start, start + 0.01 * along]))
    step = np.array([0.7071, 0.7071]) if name == "turn" else np.subtract(second, first)
    step = step / np.linalg.norm(step)
    found = None
    for reach in range(2, 130, 4):
        user.move(*(np.array(first) + reach * step))
        yield 0.08
        if groups[-1].handles[name].is_highlight:
            found = np.array(user.place, float)
            break
    assert found is not None, f"the handle {name} is nowhere under the mouse"
    if name == "move_x":
        yield from user.picture("fourview_gizmo")
    way = np.array([-step[1], step[0]]) if name == "turn" else step
    before = np.array(project().photos[0].plane.matrix_world)
    yield from user.drag([tuple(found + 4 * i * way) for i in range(11)])
    after = np.array(project().photos[0].plane.matrix_world)
    grown = np.linalg.norm(after[:3, 0]) / np.linalg.norm(before[:3, 0])
    turn = before[:3, :3].T @ after[:3, :3] / (np.linalg.norm(before[:3, 0]) * np.linalg.norm(after[:3, 0]))
    is_so = {
        "moved": np.allclose(turn, np.eye(3), atol=1e-4) and abs(grown - 1) < 1e-4 and not np.allclose(before, after),
        "scaled": abs(grown - 1) > 0.02 and np.allclose(turn, np.eye(3), atol=1e-4),
        "tilted": abs(grown - 1) < 1e-3 and turn[2, 2] < 0.9995 and turn[1, 1] > 0.9999,
        "turned": abs(grown - 1) < 1e-3 and turn[2, 2] > 0.9999 and turn[0, 0] < 0.9995,
    }[change]
    assert is_so, f"{name}: {before.tolist()} became {after.tolist()}"
    print(
        f"handle {name}: {change}, scale {grown:.3f}, turn {np.degrees(np.arccos(min(turn.trace() / 2 - 0.5, 1))):.1f}"
    )
    yield from user.into_view()
    yield from user.key("Z", ctrl=True)
    assert np.allclose(np.array(project().photos[0].plane.matrix_world), before, atol=1e-5), f"{name} is not undone"


def stage(user: driver.User, name: str) -> driver.Steps:
    """Go on to a stage and press its button."""
    yield from user.press("bpy.ops.hairloom.four_view_step(by=1")
    assert project().step == name.upper()
    yield from user.press(f"bpy.ops.hairloom.four_view_{name}(")
    yield from user.wait(lambda: not is_idle(), 30, f"{name} starts")
    yield from user.wait(is_idle, WORK_SECONDS, name)
    yield 1.0
    report = getattr(project(), name).report
    print(f"{name}: {report!r}", flush=True)
    assert scenes.module("fourview").state(bpy.context, name).kind == "DONE"
    assert report


def the_stages_one_after_another(user: driver.User) -> driver.Steps:
    settings = bpy.context.scene.hairloom.four_view
    settings.shape.resolution = 64
    settings.surface.texture_size = 512
    settings.strands.n_guides, settings.strands.n_strands = 300, 2000
    yield from stage(user, "shape")
    yield from choose(user, 0)
    yield 2.0
    yield from user.picture("fourview_shape")
    yield from stage(user, "texture")
    yield 20.0  # shaders are compiled before anything is drawn
    yield from user.picture("fourview_texture")
    user.area().spaces.active.shading.type = "SOLID"
    yield from stage(user, "directions")
    yield from user.picture("fourview_directions")
    yield from a_stroke_makes_directions_stale(user)
    yield from stage(user, "strands")
    hair = project().hair_object
    assert len(hair.data.curves) >= 1000, len(hair.data.curves)
    assert hair.parent == bpy.context.scene.hairloom.head
    user.area().spaces.active.shading.type = "SOLID"
    yield from choose(user, 2)
    yield 3.0
    yield from user.picture("fourview_strands")


def a_stroke_makes_directions_stale(user: driver.User) -> driver.Steps:
    fourview = scenes.module("fourview")
    yield from choose(user, 1)
    with user.override():
        bpy.ops.wm.tool_set_by_id(name="hairloom.four_view_stroke_tool")
    mask = scenes.module("bridge.image").read_mask(project().photos[1].mask)
    rows, columns = np.nonzero(mask)
    x, top = float(np.median(columns)), float(rows.min())
    way = [(x, top + 0.25 * np.ptp(rows) + 5.0 * i) for i in range(12)]
    yield from user.drag(pixels_on_screen(user, project().photos[1], way))
    strokes = json.loads(project().strokes)
    assert len(strokes) == 1
    assert strokes[0].get("view") == "back", strokes[0].keys()
    assert np.allclose(strokes[0]["points"][0], way[0], atol=2.0)
    assert fourview.state(bpy.context, "directions").kind == "STALE"
    yield from user.picture("fourview_stroke")
    with user.override():
        bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
    yield from user.press("bpy.ops.hairloom.four_view_directions(")
    yield from user.wait(lambda: fourview.state(bpy.context, "directions").kind == "DONE", WORK_SECONDS, "directions")
    yield from user.wait(is_idle, 10, "the job over")


def saved_and_opened_again_it_goes_on(user: driver.User, folder: Path) -> driver.Steps:
    fourview = scenes.module("fourview")
    with user.override():
        bpy.ops.wm.save_mainfile()
        bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    yield 3.0
    assert project().step == "STRANDS"
    assert [fourview.state(bpy.context, name).kind for name in fourview.STAGES] == ["DONE"] * 4
    with user.override():
        bpy.ops.hairloom.four_view_write_project(filepath=str(folder / "out.toml"))
        bpy.ops.hairloom.four_view_step("EXEC_DEFAULT", True, by=-4)
    assert (folder / "out_front_mask.png").is_file()
    assert project().step == "CAMERAS"
    project().photos[0].plane.location.z += 0.02
    yield 0.5
    states = [fourview.state(bpy.context, name) for name in fourview.STAGES]
    assert [state.kind for state in states] == ["STALE"] * 4
    assert "the camera of 'front'" in states[0].text
    project().step = "TEXTURE"
    yield from user.picture("fourview_stale")


def test(user: driver.User) -> driver.Steps:
    folder = Path(tempfile.mkdtemp(prefix="hairloom-session-"))
    only_our_panel_open()
    yield from set_the_scene(user, folder)
    for part, arguments in (
        (photos_are_added, (folder,)), (a_mask_from_scribbles, (folder,)),
        (the_masks_border_is_dragged, ()),
        (cameras_are_placed_and_corrected_by_hand, ()), (the_stages_one_after_another, ()),
        (saved_and_opened_again_it_goes_on, (folder,)),
    ):  # fmt: skip
        yield from part(user, *arguments)
        print(f"passed: {part.__name__.replace('_', ' ')}", flush=True)


bpy.context.preferences.view.show_splash = False
driver.run(test, LIMIT_SECONDS)
