"""Scribbles and strokes as text and while they are drawn; what the brushes do with the mouse's events."""

from __future__ import annotations

import json
from types import SimpleNamespace

import bpy
import fourview_scenes as small
import pytest
import scenes
from mathutils import Matrix


def strokes():
    return scenes.module("fourview_strokes")


def test_a_draft_leaves_out_what_says_nothing_new():
    draft = strokes().Draft()
    assert draft.move(10.0, 10.0)
    assert not draft.move(10.4, 10.3)
    assert draft.move(13.0, 14.0)
    assert draft.points == [(10.0, 10.0), (13.0, 14.0)]
    assert draft.length == 5.0


def test_the_eraser_cuts_a_scribble_in_two_and_leaves_others_alone():
    text = strokes().add_scribble("", "hair", 4.0, [(0.0, 0.0), (100.0, 0.0)])
    text = strokes().add_scribble(text, "background", 4.0, [(0.0, 50.0), (100.0, 50.0)])
    erased = strokes().read(strokes().add_scribble(text, "erase", 6.0, [(50.0, -20.0), (50.0, 20.0)]))
    assert [one["kind"] for one in erased] == ["hair", "hair", "background"]
    # half the widths of scribble and eraser away from the eraser's path, to a step of half that
    assert 50 - 5 - 2.5 <= erased[0]["points"][-1][0] < 45
    assert 55 < erased[1]["points"][0][0] <= 50 + 5 + 2.5
    assert erased[2]["points"] == [[0.0, 50.0], [100.0, 50.0]]
    assert strokes().add_scribble(text, "erase", 6.0, [(50.0, 25.0)]) == text


@pytest.mark.parametrize(
    ("point", "expected"), [((5.0, 3.0), 3.0), ((-4.0, 3.0), 5.0), ((10.0, 14.0), 4.0), ((13.0, 5.0), 3.0)]
)
def test_distance_to_a_path(point, expected):
    assert strokes().distance_to_path(point, [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0)]) == pytest.approx(expected)


def event(kind: str, value: str = "NOTHING", x: float = 0, y: float = 0) -> SimpleNamespace:
    return SimpleNamespace(type=kind, value=value, mouse_region_x=x, mouse_region_y=y)


class Operator:
    """What a brush needs of an operator, with the mouse's place as the pixel."""

    points = ""
    done: str | None = None

    def pixel(self, context, mouse):
        return None if mouse.mouse_region_x < 0 else (mouse.mouse_region_x, mouse.mouse_region_y)

    def in_world(self, context, points):
        return points

    def color(self):
        return (1, 1, 1, 1)

    def execute(self, context):
        self.done = self.points
        return {"FINISHED"}


@pytest.fixture
def brush():
    """A brush in a window that notes what it asks for."""
    mixin = scenes.module("ops.four_view_scribble").MouseStroke
    operator = type("Brush", (Operator, mixin), {})()
    said = []
    context = SimpleNamespace(
        region_data=object(), area=SimpleNamespace(tag_redraw=lambda: None),
        workspace=SimpleNamespace(status_text_set=said.append),
        window_manager=SimpleNamespace(modal_handler_add=lambda _: None),
    )  # fmt: skip
    return operator, context, said


def test_a_drag_becomes_a_stroke(brush):
    operator, context, said = brush
    assert operator.invoke(context, event("LEFTMOUSE", "PRESS", 5, 6)) == {"RUNNING_MODAL"}
    assert operator.modal(context, event("MOUSEMOVE", x=-1)) == {"RUNNING_MODAL"}  # nowhere on the plane
    operator.modal(context, event("INBETWEEN_MOUSEMOVE", x=9, y=6))
    operator.modal(context, event("MOUSEMOVE", x=20, y=6))
    overlay = scenes.module("fourview_overlay")
    assert overlay.draft[0][1] == [(5, 6), (9, 6), (20, 6)]
    assert operator.modal(context, event("TIMER")) == {"PASS_THROUGH"}
    assert operator.modal(context, event("LEFTMOUSE", "RELEASE")) == {"FINISHED"}
    assert json.loads(operator.done) == [[5, 6], [9, 6], [20, 6]]
    assert overlay.draft == []
    assert said[-1] is None


@pytest.mark.parametrize("key", ["ESC", "RIGHTMOUSE"])
def test_a_cancelled_drag_does_nothing(brush, key):
    operator, context, said = brush
    operator.invoke(context, event("LEFTMOUSE", "PRESS", 5, 6))
    operator.modal(context, event("MOUSEMOVE", x=9, y=6))
    assert operator.modal(context, event(key, "PRESS")) == {"CANCELLED"}
    assert operator.done is None
    assert scenes.module("fourview_overlay").draft == []
    assert said[-1] is None


def test_the_circle_of_the_brush_is_as_large_as_its_scribble(tmp_path):
    small.start(tmp_path, ("front",))
    plane = small.project().photos[0].plane
    plane.matrix_world = Matrix.Scale(0.5, 4)
    view = SimpleNamespace(
        window_matrix=Matrix.Diagonal((4.0, 5.0, 1.0, 1.0)), is_perspective=False, view_distance=1.0
    )  # fmt: skip
    context = SimpleNamespace(scene=bpy.context.scene, region_data=view, region=SimpleNamespace(height=800))
    # half a metre over 100 pixels of the photo; 2 / 5 of a metre over 800 pixels of the region
    found = scenes.module("fourview").pixels_per_photo_pixel(context)
    assert found == pytest.approx(0.5 / 100 * 800 * 5 / 2)


def test_handles_are_there_in_step_cameras_alone(tmp_path):
    small.start(tmp_path, ("front",))
    poll = scenes.module("gizmos.view_plane").HAIRLOOM_GGT_view_plane.poll
    small.project().step = "SEGMENT"
    assert not poll(bpy.context)
    small.project().step = "CAMERAS"
    assert poll(bpy.context)
    small.project().shown = "NONE"
    assert not poll(bpy.context)
