"""Live flows: a groom's link to its flow, and the handlers that move the hair while the flow is edited or simulated.

A handler writes between undo steps; what it writes depends on the flow and the kept details alone, so after an undo of
the flow's edit the hair goes back by itself.
"""

from __future__ import annotations

import time
from typing import Any

import bpy
from bpy.props import BoolProperty, PointerProperty

from . import flow_link, jobs, lazy
from .backend.errors import HairloomError

_BUSY_SECONDS = 0.05  # an update that takes longer waits for a pause of its own length, so that brushes stay fluid


class LiveFlows:
    """The grooms that follow their flows in this session, by the session's numbers of the objects."""

    def __init__(self) -> None:
        self.problems: dict[int, str] = {}  # why a groom does not follow
        self._followers: dict[int, Any] = {}
        self._seconds: dict[int, float] = {}
        self._waiting: set[int] = set()
        self._is_writing = False

    def on_update(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Move the grooms whose flow changed."""
        if self._is_writing:
            return
        ids = [update.id for update in depsgraph.updates]
        changed = {
            obj.original.session_uid for obj in ids if isinstance(obj, bpy.types.Object) and obj.type == "CURVES"
        }
        if changed:
            for groom in _live_grooms():
                if groom.hairloom_flow.source.session_uid in changed or (
                    groom.session_uid in changed and groom.session_uid in self.problems
                ):
                    self._follow_soon(groom, depsgraph)

    def on_frame(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Move all grooms: animation and simulation change flows without an update of their own."""
        for groom in _live_grooms():
            self.follow(groom, depsgraph)

    def _follow_soon(self, groom: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> None:
        uid = groom.session_uid
        if self._seconds.get(uid, 0.0) <= _BUSY_SECONDS or bpy.app.background:
            self.follow(groom, depsgraph)
            return
        self._waiting.add(uid)
        if not bpy.app.timers.is_registered(_follow_waiting):
            bpy.app.timers.register(_follow_waiting, first_interval=self._seconds[uid])

    def follow_waiting(self) -> None:
        waiting, self._waiting = self._waiting, set()
        depsgraph = bpy.context.evaluated_depsgraph_get()
        for groom in _live_grooms():
            if groom.session_uid in waiting:
                self.follow(groom, depsgraph)

    def follow(self, groom: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> None:
        """Bring one groom to its flow as it is now; a problem is kept for the panel."""
        uid, link, start = groom.session_uid, groom.hairloom_flow, time.perf_counter()
        before = self.problems.pop(uid, "")
        flow = link.source.evaluated_get(depsgraph)
        self._is_writing = True
        try:
            if uid not in self._followers:
                self._followers[uid] = lazy.bridge("flow").Follower()
            self._followers[uid].follow(groom, flow, follow_length=link.follow_length)
        except HairloomError as error:
            self.problems[uid] = str(error)
            self._followers.pop(uid, None)
        finally:
            self._is_writing = False
        self._seconds[uid] = time.perf_counter() - start
        if self.problems.get(uid, "") != before:
            jobs.redraw(bpy.context, "VIEW_3D")

    def forget(self, *_: object) -> None:
        """Read everything again at the next change: the file, or its past, is another one."""
        self.problems.clear()
        self._followers.clear()
        self._seconds.clear()
        self._waiting.clear()


live = LiveFlows()


def _live_grooms() -> list[bpy.types.Object]:
    return [
        obj
        for obj in bpy.data.objects
        if obj.type == "CURVES" and obj.hairloom_flow.is_live and flow_link.flow_of(obj) and flow_link.is_bound(obj)
    ]


def _switched(self: FlowLink, context: bpy.types.Context) -> None:
    """The hair follows at once when Live is switched on, or a setting changes while it is on."""
    groom = self.id_data
    live.problems.pop(groom.session_uid, None)
    if self.is_live and self.source is not None and flow_link.is_bound(groom):
        live.follow(groom, context.evaluated_depsgraph_get())


def _can_be_flow(self: FlowLink, obj: bpy.types.Object) -> bool:
    return flow_link.is_flow(obj) and obj != self.id_data


class FlowLink(bpy.types.PropertyGroup):
    """A groom's flow; kept on the object, so that it is saved, duplicated and undone with it."""

    source: PointerProperty(
        name="Flow", type=bpy.types.Object, poll=_can_be_flow, update=_switched,
        description="The flow that this groom follows: strands made by Extract Flow, one for each wisp",
    )  # fmt: skip
    is_live: BoolProperty(
        name="Live", update=_switched,
        description="Move the hair along whenever its flow changes: while it is sculpted, edited, or simulated",
    )  # fmt: skip
    follow_length: BoolProperty(
        name="Grow with Flow", update=_switched,
        description="Let strands grow and shrink with their flow strand. Otherwise the hair keeps its lengths",
    )  # fmt: skip


def _follow_waiting() -> None:
    live.follow_waiting()


@bpy.app.handlers.persistent
def _on_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    live.on_update(depsgraph)


@bpy.app.handlers.persistent
def _on_frame(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    live.on_frame(depsgraph)


@bpy.app.handlers.persistent
def _on_other_past(*_: object) -> None:
    live.forget()


_HANDLERS = {
    "depsgraph_update_post": _on_update,
    "frame_change_post": _on_frame,
    "undo_post": _on_other_past,
    "redo_post": _on_other_past,
    "load_post": _on_other_past,
}


def register() -> None:
    bpy.utils.register_class(FlowLink)
    bpy.types.Object.hairloom_flow = PointerProperty(type=FlowLink)
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    if bpy.app.timers.is_registered(_follow_waiting):
        bpy.app.timers.unregister(_follow_waiting)
    live.forget()
    del bpy.types.Object.hairloom_flow
    bpy.utils.unregister_class(FlowLink)
