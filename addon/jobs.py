"""Long jobs as operators: the mixin that runs a job at once or in a worker process, and what panels show of it.

Called from a script or in the background, an operator runs its job at once in Blender's own process; pressed in a
window, it starts the worker and stays modal until the worker is done, the user presses Esc, or the worker dies.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import bpy

from . import lazy
from .backend.errors import HairloomError

if TYPE_CHECKING:
    from .workers import JobRun

_TICK_SECONDS = 0.1

Values = dict[str, Any]


class JobStatus(bpy.types.PropertyGroup):
    """What panels show of the running job; kept on the window manager, so never saved and never undone."""

    is_running: bpy.props.BoolProperty()
    label: bpy.props.StringProperty()
    message: bpy.props.StringProperty()
    fraction: bpy.props.FloatProperty(min=0.0, max=1.0, subtype="FACTOR")
    wants_cancel: bpy.props.BoolProperty()

    def show(self, run: JobRun) -> None:
        self.is_running, self.label, self.message, self.fraction = True, run.label, run.message, run.fraction

    def clear(self) -> None:
        self.is_running, self.wants_cancel, self.fraction, self.message = False, False, 0.0, ""


def status(context: bpy.types.Context) -> JobStatus:
    return context.window_manager.hairloom_job


def reports_errors(method: Callable[[Any, bpy.types.Context], set[str]]) -> Callable[..., set[str]]:
    """An expected error of an operator's method becomes one ERROR line; any other keeps its traceback."""

    @functools.wraps(method)
    def run(self: Any, context: bpy.types.Context) -> set[str]:
        try:
            return method(self, context)
        except HairloomError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}

    return run


class JobOperator:
    """Mixin of the operators that run a job of the backend's registry.

    A subclass sets `job` and gives `sources`, `read`, `params` and `apply`. While the worker runs
    only the session's numbers of the sources are remembered, since undo replaces the data; if a source is gone or
    changed by then, nothing is written.
    """

    job = ""

    def sources(self, context: bpy.types.Context) -> dict[str, bpy.types.Object]:
        """The objects that the job reads."""
        return {}

    def read(self, sources: dict[str, bpy.types.Object]) -> Values:
        """The job's inputs out of the sources."""
        return {}

    def params(self, context: bpy.types.Context) -> Values:
        """The job's settings, a nested dict."""
        return {}

    def watched(self, sources: dict[str, bpy.types.Object], inputs: Values | None = None) -> Values:
        """What must be the same when the job is over; `inputs` at its start, when they have just been read."""
        return self.read(sources) if inputs is None else inputs

    def apply(self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values) -> str:
        """Write the outputs into the scene, once; returns what to tell the user."""
        raise NotImplementedError

    def when_cancelled(self) -> str:
        """What to tell the user who has cancelled the job."""
        return "nothing was changed"

    @reports_errors
    def execute(self, context: bpy.types.Context) -> set[str]:
        sources = self.sources(context)
        window_manager = context.window_manager
        window_manager.progress_begin(0.0, 1.0)
        try:
            outputs = lazy.backend("registry").run_job(
                self.job, self.read(sources), self.params(context), lambda f, _: window_manager.progress_update(f)
            )
        finally:
            window_manager.progress_end()
        self.report({"INFO"}, self.apply(context, sources, outputs))
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background or context.window is None:
            return self.execute(context)
        return self._start(context)

    @reports_errors
    def _start(self, context: bpy.types.Context) -> set[str]:
        sources = self.sources(context)
        inputs = self.read(sources)
        self._source_uids = {name: obj.session_uid for name, obj in sources.items()}
        self._fingerprint = lazy.bridge("fingerprint").fingerprint(self.watched(sources, inputs))
        self._running = lazy.workers().WorkerJob(self.bl_label, self.job, inputs, self.params(context))
        status(context).show(self._running.run)
        context.window_manager.modal_handler_add(self)
        self._timer = context.window_manager.event_timer_add(_TICK_SECONDS, window=context.window)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC" and event.value == "PRESS":
            status(context).wants_cancel = True
        elif event.type != "TIMER":
            return {"PASS_THROUGH"}
        if status(context).wants_cancel:
            self._running.run.cancel()
        run = self._running.step()
        if run.state == "RUNNING":
            self._show(context, run)
            return {"PASS_THROUGH"} if event.type == "TIMER" else {"RUNNING_MODAL"}
        try:
            return self._finish(context)
        finally:
            self._end(context)

    def _show(self, context: bpy.types.Context, run: JobRun) -> None:
        shown = status(context)
        if (shown.fraction, shown.message) != (run.fraction, run.message):
            shown.show(run)
            context.workspace.status_text_set(f"{run.label}: {run.message}  {run.fraction:.0%}   |   Esc: Cancel")
            redraw(context, "VIEW_3D")
            redraw(context, "PREFERENCES")

    @reports_errors
    def _finish(self, context: bpy.types.Context) -> set[str]:
        run = self._running.run
        if run.state == "CANCELLED":
            self.report({"INFO"}, f"{run.label} cancelled; {self.when_cancelled()}")
            return {"CANCELLED"}
        if run.state == "FAILED":
            if run.traceback:
                sys.stderr.write(f"Hairloom: {run.label}\n{run.traceback}\n")
            self.report({"ERROR"}, run.error)
            return {"CANCELLED"}
        sources = self._find_sources()
        if sources is None or lazy.bridge("fingerprint").fingerprint(self.watched(sources)) != self._fingerprint:
            self.report(
                {"ERROR"}, f"The hair or the head changed while {run.label} ran; nothing was changed. Run it again"
            )
            return {"CANCELLED"}
        self.report({"INFO"}, self.apply(context, sources, self._running.outputs()))
        return {"FINISHED"}

    def _find_sources(self) -> dict[str, bpy.types.Object] | None:
        by_uid = {obj.session_uid: obj for obj in bpy.data.objects}
        if any(uid not in by_uid for uid in self._source_uids.values()):
            return None
        return {name: by_uid[uid] for name, uid in self._source_uids.items()}

    def _end(self, context: bpy.types.Context) -> None:
        self._running.close()
        context.window_manager.event_timer_remove(self._timer)
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        status(context).clear()
        redraw(context, "VIEW_3D")
        redraw(context, "PREFERENCES")

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender itself ends the operator: another file is opened, or the window closes."""
        self._running.run.cancel()
        self._end(context)


def draw_progress(layout: bpy.types.UILayout, job: JobStatus) -> None:
    """The running job's progress and a button that cancels it."""
    row = layout.row(align=True)
    row.progress(factor=job.fraction, text=f"{job.message}  {job.fraction:.0%}")
    row.operator("hairloom.cancel_job", text="", icon="X")


def redraw(context: bpy.types.Context, area_type: str) -> None:
    """Redraw what shows progress: the sidebars of 3D views, not the views themselves, or whole areas of other types."""
    for window in context.window_manager.windows:
        for area in (area for area in window.screen.areas if area.type == area_type):
            for region in area.regions:
                if area_type != "VIEW_3D" or region.type == "UI":
                    region.tag_redraw()


def register() -> None:
    bpy.utils.register_class(JobStatus)
    bpy.types.WindowManager.hairloom_job = bpy.props.PointerProperty(type=JobStatus)


def unregister() -> None:
    del bpy.types.WindowManager.hairloom_job
    bpy.utils.unregister_class(JobStatus)
