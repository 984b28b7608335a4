"""Live detail transfer: the active result is made again when a setting changes, and the panel's own state.

A timer compares settings; it runs only while Live is on. What it makes lies between undo steps, like a slider's moves.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from . import detail_library, details, jobs, lazy, scene, warmup
from .backend.errors import HairloomError

if TYPE_CHECKING:
    from .workers import WorkerJob

_TICK_SECONDS = 0.15  # settings that rest for so long are meant
QUICK_STRANDS = 30_000  # up to so many the transfer runs in Blender itself, in a few tenths of a second
# Blender keeps no reference to the texts of a dynamic enum, so they must live on here
_items: list[tuple[str, str, str, int, int]] = []
_numbers: dict[str, int] = {}


def _detail_items(self: object, context: bpy.types.Context | None) -> list[tuple[str, str, str, int, int]]:
    _items.clear()
    for detail in detail_library.saved_details():
        # a number for each name, so that another detail in the list does not change what is chosen
        number = _numbers.setdefault(detail.name, len(_numbers))
        text = "Came with Hairloom" if detail.is_bundled else f"Saved in {detail.path.parent}"
        _items.append((detail.name, detail.name, text, detail_library.icon(detail), number))
    return _items


def _live_switched(self: DetailPanelState, context: bpy.types.Context) -> None:
    self.message = ""
    if self.is_live and not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=_TICK_SECONDS, persistent=True)


class DetailPanelState(bpy.types.PropertyGroup):
    """State of the panel; kept on the window manager, so never saved and never undone."""

    is_live: BoolProperty(
        name="Live", update=_live_switched,
        description="Make the details of the active groom again whenever a setting changes. The groom must come from a "
        "transfer; its wisps are not searched again",
    )  # fmt: skip
    message: StringProperty()
    new_name: StringProperty(
        name="Name", maxlen=60,
        description="Name under which Save Detail keeps the active groom's details; the groom's own when empty",
    )  # fmt: skip
    saved_detail: EnumProperty(
        name="Saved Detail", items=_detail_items, description="Saved detail that Apply Detail gives to the active groom"
    )


class LiveTransfer:
    """Follows the settings: `step` is called again and again while Live is on."""

    def __init__(self) -> None:
        self._uid = 0  # session number of the result that is followed
        self._made = ""  # settings that it was made with
        self._seen = ""  # settings at the last step
        self._worker: WorkerJob | None = None
        self._transfer: Any = None

    def step(self, context: bpy.types.Context, state: DetailPanelState) -> None:
        """Look at the settings, and make the active result again when they changed and came to rest."""
        if jobs.status(context).is_running:
            return
        result = scene.active_groom(context)
        if result is None or not result.hairloom_transfer.is_set:
            self.stop()
            state.message = "Select a groom that was made by a transfer"
            return
        wanted = json.dumps(scene.settings(context).details.settings.to_params())
        if result.session_uid != self._uid:
            # another groom became active: it is as it should be until a setting changes
            self.stop()
            self._uid, self._made, state.message = result.session_uid, wanted, ""
        elif wanted != self._seen:
            self._end_worker()
        elif self._worker is not None:
            self._follow_worker(context, state, result)
        elif wanted != self._made:
            self._made = wanted
            self._start(context, state, result)
        self._seen = wanted

    def stop(self) -> None:
        """Forget the groom that is followed; what runs is ended."""
        self._end_worker()
        self._uid, self._made, self._seen = 0, "", ""

    def _end_worker(self) -> None:
        if self._worker is not None:
            self._worker.close()
            self._worker = None
            # it was for settings that are not wanted any more
            self._made = ""

    def _start(self, context: bpy.types.Context, state: DetailPanelState, result: bpy.types.Object) -> None:
        try:
            sources = details.remembered(result)
            self._transfer = details.prepare(sources, result.hairloom_transfer.saved_detail)
            params = details.job_params(context, self._transfer, compare=False)
            inputs = self._transfer.inputs
            if self._takes_long():
                self._worker = lazy.workers().WorkerJob("Live Transfer", details.JOB, inputs, params)
                state.message = "Working ..."
            else:
                self._write(state, result, lazy.backend("registry").run_job(details.JOB, inputs, params))
        except HairloomError as error:
            self._give_up(state, str(error))

    def _takes_long(self) -> bool:
        """Would Blender's window stand still for more than a moment?"""
        must_compile = not (bpy.app.background or warmup.is_warm())
        n_strands = self._transfer.inputs["base_strands"].n_strands
        return must_compile or self._transfer.needs_clustering or n_strands > QUICK_STRANDS

    def _follow_worker(self, context: bpy.types.Context, state: DetailPanelState, result: bpy.types.Object) -> None:
        run = self._worker.step()
        if run.state == "RUNNING":
            state.message = f"{run.message}  {run.fraction:.0%}"
            return
        try:
            if run.state == "DONE":
                self._write(state, result, self._worker.outputs())
            else:
                self._give_up(state, run.error)
        except HairloomError as error:
            self._give_up(state, str(error))
        finally:
            made = self._made
            self._end_worker()
            self._made = made

    def _write(self, state: DetailPanelState, result: bpy.types.Object, outputs: dict[str, Any]) -> None:
        self._transfer.keep(outputs)
        sources = details.remembered(result)
        lazy.bridge("transferred").update_result(result, sources["base"], sources["base_head"], outputs)
        state.message = f"{self._transfer.remarks()}{outputs['strands'].n_strands:,} strands"

    def _give_up(self, state: DetailPanelState, reason: str) -> None:
        state.is_live = False
        state.message = reason


_live = LiveTransfer()


def _tick() -> float | None:
    context = bpy.context
    state = context.window_manager.hairloom_details
    before = state.message
    if state.is_live:
        _live.step(context, state)
    if state.message != before:
        jobs.redraw(context, "VIEW_3D")
    if state.is_live:
        return _TICK_SECONDS
    _live.stop()
    return None


def register() -> None:
    bpy.utils.register_class(DetailPanelState)
    bpy.types.WindowManager.hairloom_details = bpy.props.PointerProperty(type=DetailPanelState)


def unregister() -> None:
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    _live.stop()
    del bpy.types.WindowManager.hairloom_details
    bpy.utils.unregister_class(DetailPanelState)
