"""The border of a mask that is dragged: what becomes of the mask, undo, stale steps, and the drag's events."""

from __future__ import annotations

import json
from types import SimpleNamespace

import bpy
import fourview_scenes as small
import numpy as np
import pytest
import scenes

# the mask's upper edge, in the middle, and what lies 15 pixels above
TOP, ABOVE = (45.0, 18.5), (45.0, 3.5)


def bridge():
    return scenes.module("bridge.image")


def mask() -> np.ndarray:
    return bridge().read_mask(small.project().photos[0].mask)


def drag(*points: tuple[float, float]) -> set[str]:
    return bpy.ops.hairloom.four_view_border("EXEC_DEFAULT", True, points=json.dumps(points))


@pytest.fixture
def photo(tmp_path):
    small.start(tmp_path, ("front",), with_masks=True)
    small.project().border_size = 24
    return small.project().photos[0]


def test_the_border_goes_where_it_is_dragged(photo):
    before, stamp = mask(), photo.mask_stamp
    assert drag(TOP, ABOVE) == {"FINISHED"}
    photo = small.project().photos[0]
    after = mask()
    assert not (before & ~after).any()
    rows, columns = np.nonzero(after & ~before)
    assert abs(rows.min() - ABOVE[1]) <= 1.5
    assert np.abs(columns + 0.5 - TOP[0]).max() <= 12
    assert photo.mask_stamp == bridge().stamp(after) != stamp
    assert photo.mask_by_hand
    assert photo.mask.packed_file is not None
    assert len(bpy.data.images) == 2, "the old mask is gone"


def test_a_drag_is_one_undo_step(photo):
    first = mask()
    bpy.ops.ed.undo_push(message="before")
    drag(TOP, ABOVE)
    second = mask()
    drag(ABOVE, TOP)
    bpy.ops.ed.undo()
    assert np.array_equal(mask(), second)
    bpy.ops.ed.undo()
    assert np.array_equal(mask(), first)
    assert not small.project().photos[0].mask_by_hand


def test_a_drag_beside_the_border_or_to_the_same_place_changes_nothing(photo):
    before, stamp, image = mask(), photo.mask_stamp, photo.mask.name
    with pytest.raises(RuntimeError, match="press nearer"):
        drag((3.0, 95.0), (20.0, 60.0))
    assert drag(TOP, TOP) == {"CANCELLED"}
    with pytest.raises(RuntimeError, match="No drag is given"):
        bpy.ops.hairloom.four_view_border("EXEC_DEFAULT")
    assert np.array_equal(mask(), before)
    assert (photo.mask_stamp, photo.mask.name) == (stamp, image)
    assert not photo.mask_by_hand


def test_a_mask_cannot_be_dragged_away(photo):
    before = mask()
    small.project().border_size = 4000
    with pytest.raises(RuntimeError, match="is empty"):
        drag(TOP, (45.0, 4000.0))
    assert np.array_equal(mask(), before)


def test_without_a_mask_there_is_no_border(tmp_path):
    small.start(tmp_path, ("front",))
    with pytest.raises(RuntimeError, match="no mask yet"):
        drag(TOP, ABOVE)


def test_later_steps_are_stale_after_a_drag(photo):
    fourview = scenes.module("fourview")
    fourview.write_result(bpy.context, "shape", {"number": 1})
    fourview.remember_result(bpy.context, "shape", "")
    assert fourview.state(bpy.context, "shape").kind == "DONE"
    drag(TOP, ABOVE)
    state = fourview.state(bpy.context, "shape")
    assert (state.kind, "the mask of 'front'" in state.text) == ("STALE", True)


def test_a_mask_by_hand_is_left_alone_unless_segment_is_pressed(photo):
    drag(TOP, ABOVE)
    after = mask()
    with pytest.raises(RuntimeError, match="All photos have a mask"):
        bpy.ops.hairloom.four_view_guess_masks()
    assert np.array_equal(mask(), after)
    bpy.ops.hairloom.four_view_segment()
    assert not np.array_equal(mask(), after)
    assert not small.project().photos[0].mask_by_hand


def test_the_dragged_mask_is_saved_and_in_the_project(photo, tmp_path):
    drag(TOP, ABOVE)
    after = mask()
    scenes.reload(tmp_path)
    assert np.array_equal(mask(), after)
    assert small.project().photos[0].mask_by_hand
    path = tmp_path / "out" / "it.toml"
    path.parent.mkdir()
    bpy.ops.hairloom.four_view_write_project(filepath=str(path))
    project = scenes.module("backend.fourview.project").read_project(path)
    written = scenes.module("backend.io.images").read_mask(project.path(project.views[0].mask))
    assert np.array_equal(written, after)


def test_who_made_the_mask_goes_with_it(tmp_path):
    small.start(tmp_path, ("front", "back"), with_masks=True)
    small.project().active = 0
    drag(TOP, ABOVE)
    bpy.ops.hairloom.four_view_mirror()
    assert small.project().photos[0].mask_by_hand
    bpy.ops.hairloom.four_view_swap(index=1)
    assert [photo.mask_by_hand for photo in small.project().photos] == [False, True]
    small.project().brush_paints = "MASK"
    bpy.ops.hairloom.four_view_scribble("EXEC_DEFAULT", kind="hair", points="[[45, 20]]")
    assert small.project().photos[0].mask_by_hand


# --- events --------------------------------------------------------------------------------------------------------


def event(kind: str, value: str = "NOTHING", place: tuple[float, float] = (0, 0)) -> SimpleNamespace:
    return SimpleNamespace(type=kind, value=value, mouse_region_x=place[0], mouse_region_y=place[1])


class Operator:
    """What the drag needs of an operator, with the mouse's place as the pixel."""

    points = ""
    done: str | None = None

    def pixel(self, context, mouse):
        return None if mouse.mouse_region_x < 0 else (mouse.mouse_region_x, mouse.mouse_region_y)

    def in_world(self, context, points):
        return np.array(points)

    def report(self, kind, text):
        self.said.append(text)

    def execute(self, context):
        self.done = self.points
        return {"FINISHED"}


@pytest.fixture
def tool(photo):
    """The operator in a window in which a pixel of the photo is a pixel of the region."""
    mixin = scenes.module("ops.four_view_border").BorderDrag
    operator = type("Tool", (Operator, mixin), {})()
    operator.said = said = []
    context = SimpleNamespace(
        scene=bpy.context.scene, region_data=object(), area=SimpleNamespace(tag_redraw=lambda: None),
        workspace=SimpleNamespace(status_text_set=said.append),
        window_manager=SimpleNamespace(modal_handler_add=lambda _: None),
    )  # fmt: skip
    return operator, context, said


def draft() -> list[np.ndarray]:
    return [line for _, line in scenes.module("fourview_overlay").draft]


def test_the_moved_border_is_shown_while_it_is_dragged(tool):
    operator, context, said = tool
    assert operator.invoke(context, event("LEFTMOUSE", "PRESS", TOP)) == {"RUNNING_MODAL"}
    operator.modal(context, event("MOUSEMOVE", place=(45, 10)))
    operator.modal(context, event("MOUSEMOVE", place=ABOVE))
    (line,) = draft()
    assert np.array_equal(line[0], line[-1])
    assert abs(line[:, 1].min() - ABOVE[1]) <= 1.5
    assert operator.modal(context, event("LEFTMOUSE", "RELEASE")) == {"FINISHED"}
    points = json.loads(operator.done)
    assert (points[0], points[-1]) == (list(TOP), list(ABOVE))
    assert not draft()
    assert said[-1] is None


@pytest.mark.parametrize("key", ["ESC", "RIGHTMOUSE"])
def test_a_cancelled_drag_leaves_the_mask(tool, key):
    operator, context, _ = tool
    before = mask()
    operator.invoke(context, event("LEFTMOUSE", "PRESS", TOP))
    operator.modal(context, event("MOUSEMOVE", place=ABOVE))
    assert operator.modal(context, event(key, "PRESS")) == {"CANCELLED"}
    assert operator.done is None
    assert not draft()
    assert np.array_equal(mask(), before)


def test_a_press_far_from_the_border_or_on_a_plane_seen_edge_on_begins_nothing(tool):
    operator, context, said = tool
    assert operator.invoke(context, event("LEFTMOUSE", "PRESS", (3, 95))) == {"CANCELLED"}
    assert "press nearer" in said[-1]
    assert operator.invoke(context, event("LEFTMOUSE", "PRESS", (-1, 0))) == {"CANCELLED"}
    assert "edge on" in said[-1]
    assert not draft()


def test_the_tool_is_in_the_toolbar():
    from bl_ui.space_toolsystem_toolbar import VIEW3D_PT_tools_active as toolbar

    names = [item.idname for item in toolbar._tools_flatten(toolbar._tools["OBJECT"]) if item is not None]
    assert names.count("hairloom.four_view_border_tool") == 1
