"""Handles on the plane of a photo in step Cameras: move, turn, scale, and tilt the direction of view.

All lie in the picture's plane, so that they work while one looks through the photo; the arrows at the picture's middle
move it, those near its right and upper border tilt it, the one near its corner scales it, the ring turns it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
from mathutils import Matrix, Vector

from .. import fourview
from . import plane_moves

_INSIDE = 0.75  # of half the picture: where handles near its border are
_RED, _GREEN, _BLUE, _WHITE = (0.9, 0.25, 0.3), (0.45, 0.8, 0.2), (0.3, 0.55, 1.0), (0.9, 0.9, 0.9)
_TO_X = Matrix(((0, 0, 1, 0), (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 0, 1)))  # a gizmo's z onto the plane's x
_TO_Y = Matrix(((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)))
_TO_CORNER = Matrix.Rotation(-0.25 * 3.14159265, 4, "Z") @ _TO_Y


def half_sizes(plane: bpy.types.Object) -> tuple[float, float]:
    """Half the picture's width and height, metres."""
    width, height = plane.data.size
    unit = plane.empty_display_size * fourview.matrix_of(plane).col[0].to_3d().length / max(width, height, 1)
    return 0.5 * unit * width, 0.5 * unit * height


class HAIRLOOM_GGT_view_plane(bpy.types.GizmoGroup):
    bl_idname = "HAIRLOOM_GGT_view_plane"
    bl_label = "Photo's Camera"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"3D", "PERSISTENT", "SHOW_MODAL_ALL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        found = fourview.project(context)
        photo = fourview.active_photo(context)
        return (
            found.step == "CAMERAS"
            and context.mode == "OBJECT"
            and photo is not None
            and photo.plane is not None
            and photo.image is not None
            and photo.plane.visible_get()
        )

    def setup(self, context: bpy.types.Context) -> None:
        self.start = Matrix()  # of the plane when a drag begins
        self.size = 1.0
        self.pivot = Vector()
        self.values: dict[str, float] = {}
        self.was_dragged = False
        arrow, dial = "GIZMO_GT_arrow_3d", "GIZMO_GT_dial_3d"
        self.handles: dict[str, Any] = {}
        self._add("move_x", arrow, _RED, lambda v: plane_moves.moved(self.start, 0, v))
        self._add("move_y", arrow, _GREEN, lambda v: plane_moves.moved(self.start, 1, v))
        self._add("scale", arrow, _WHITE, lambda v: plane_moves.scaled(self.start, self.pivot, 1.0 + v / self.size))
        # pulled by the distance to the middle, the picture turns by a radian
        self._add("tilt_y", arrow, _BLUE, lambda v: plane_moves.tilted(self.start, self.pivot, 1, v / self.size))
        self._add("tilt_x", arrow, _BLUE, lambda v: plane_moves.tilted(self.start, self.pivot, 0, -v / self.size))
        self._add("turn", dial, _WHITE, lambda v: plane_moves.turned(self.start, self.pivot, v))
        for name in ("scale", "tilt_x", "tilt_y"):
            self.handles[name].draw_style = "BOX"
            self.handles[name].length = 0.35
        for name in ("move_x", "move_y"):
            self.handles[name].length = 0.8
        self.handles["turn"].scale_basis = 0.45
        self.handles["turn"].line_width = 3

    def _add(self, name: str, kind: str, color: tuple[float, ...], result: Callable[[float], Matrix]) -> None:
        handle = self.gizmos.new(kind)
        handle.color, handle.alpha = color, 0.8
        handle.color_highlight, handle.alpha_highlight = (1.0, 1.0, 0.6), 1.0
        handle.use_draw_modal = True
        if hasattr(handle, "use_undo"):
            handle.use_undo = False  # from 5.1 on; 4.5 knows none, so that `_push_undo` makes the step everywhere
        self.values[name] = 0.0

        def put(value: float) -> None:
            self.values[name] = value
            photo = fourview.active_photo(bpy.context)
            if photo is not None and photo.plane is not None:
                photo.plane.matrix_world = result(value)

        handle.target_set_handler("offset", get=lambda: self.values[name], set=put)
        self.handles[name] = handle

    def draw_prepare(self, context: bpy.types.Context) -> None:
        if any(handle.is_modal for handle in self.handles.values()):
            self.was_dragged = True
            return  # the frame of a drag stays as it was at its start
        plane = fourview.active_photo(context).plane
        if self.was_dragged and fourview.matrix_of(plane) != self.start:
            # a drag of a gizmo that sets by a function leaves no undo step of its own
            bpy.app.timers.register(_push_undo, first_interval=0.0)
        self.was_dragged = False
        place, turn, _ = fourview.matrix_of(plane).decompose()
        rigid = Matrix.LocRotScale(place, turn, None)
        # within the picture, where it fills the view
        across, up = (_INSIDE * half for half in half_sizes(plane))
        self.start, self.size = fourview.matrix_of(plane), max(across, up)
        self.pivot = Vector(fourview.head_middle(context) or place)
        places = {
            "move_x": _TO_X, "move_y": _TO_Y, "turn": Matrix(),
            "scale": Matrix.Translation((across, up, 0.0)) @ _TO_CORNER,
            "tilt_y": Matrix.Translation((across, 0.0, 0.0)) @ _TO_X,
            "tilt_x": Matrix.Translation((0.0, up, 0.0)) @ _TO_Y,
        }  # fmt: skip
        for name, matrix in places.items():
            self.values[name] = 0.0
            self.handles[name].matrix_basis = rigid @ matrix


def _push_undo() -> None:
    windows = bpy.context.window_manager.windows
    if windows:
        with bpy.context.temp_override(window=windows[0]):
            bpy.ops.ed.undo_push(message="Move Photo")


register, unregister = bpy.utils.register_classes_factory([HAIRLOOM_GGT_view_plane])
