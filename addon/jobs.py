"""Long jobs: a worker process beside Blender, its messages, and the operator mixin that runs jobs either way.

Called from a script or in the background, an operator runs its job at once in Blender's own process; pressed in a
window, it starts the worker and stays modal until the worker is done, the user presses Esc, or the worker dies.
`WorkerProcess` and `JobRun` know nothing of operators, so that tests feed them; the operator only forwards.
"""

from __future__ import annotations

import functools
import json
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from . import lazy
from .backend.errors import HairloomError

WORKER = Path(__file__).parent / "backend" / "worker.py"
_TICK_SECONDS = 0.1
_LINGER_SECONDS = 0.5  # how long a worker may take to end before it is killed
_STDERR_LINES = 50

Values = dict[str, Any]


def worker_environment() -> dict[str, str]:
    """The environment of the child: Blender's packages on its path, nothing of the user's own Python."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    packages = [path for path in sys.path if path.rstrip("/\\").endswith(("site-packages", "dist-packages"))]
    environment["PYTHONPATH"] = os.pathsep.join(packages)
    environment["PYTHONNOUSERSITE"] = "1"
    environment["PYTHONIOENCODING"] = "utf-8"
    folder = lazy.kernel_cache_folder()
    if folder:
        environment.setdefault("NUMBA_CACHE_DIR", folder)
    return environment


def worker_command() -> list[str]:
    """Blender's own Python on the worker's file; -P keeps that file's folder, which has a `types.py`, off the path."""
    return [sys.executable, "-P", str(WORKER)]


class WorkerProcess:
    """A child process that gets one request and answers in JSON lines; reading it never waits."""

    def __init__(
        self, command: list[str], request: Values, environment: dict[str, str] | None = None, *, is_patient: bool = False
    ) -> None:
        """Start it. `is_patient` gives everything else on the machine the right of way."""
        flags = 0
        if os.name == "nt":
            flags = subprocess.CREATE_NO_WINDOW | (subprocess.BELOW_NORMAL_PRIORITY_CLASS if is_patient else 0)
        self._lines: queue.Queue[str | None] = queue.Queue()
        self._errors: list[str] = []
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment,
            text=True, encoding="utf-8", errors="replace", creationflags=flags,
        )  # fmt: skip
        if is_patient and os.name == "posix":
            os.setpriority(os.PRIO_PROCESS, self._process.pid, 15)
        self._readers = [
            threading.Thread(target=self._read_answers, daemon=True),
            threading.Thread(target=self._read_errors, daemon=True),
        ]
        for reader in self._readers:
            reader.start()
        try:
            # stdin stays open: the worker leaves when it closes, so it never outlives Blender
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        except OSError:
            # dead already (a broken Python); the end of its output says so to `messages`
            self._errors.append("the worker ended before it got its request")

    def _read_answers(self) -> None:
        for line in self._process.stdout:
            self._lines.put(line)
        self._lines.put(None)

    def _read_errors(self) -> None:
        for line in self._process.stderr:
            self._errors.append(line)
            del self._errors[:-_STDERR_LINES]

    def messages(self) -> list[Values]:
        """What the worker said since the last call; {'ended': exit status, 'stderr': text} comes last of all."""
        found: list[Values] = []
        while not self._lines.empty():
            line = self._lines.get()
            if line is None:
                status = self._process.wait()
                self._readers[1].join(_LINGER_SECONDS)
                found.append({"ended": status, "stderr": "".join(self._errors)})
            else:
                found.append(json.loads(line))
        return found

    def stop(self) -> None:
        """End the process, gently and then not, and let go of its pipes."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(_LINGER_SECONDS)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        for reader in self._readers:
            reader.join(_LINGER_SECONDS)
        for pipe in (self._process.stdin, self._process.stdout, self._process.stderr):
            pipe.close()


class JobRun:
    """One running job as its messages tell it: state is 'RUNNING', then 'DONE', 'FAILED' or 'CANCELLED'."""

    def __init__(self, label: str) -> None:
        self.label = label
        self.state = "RUNNING"
        self.fraction = 0.0
        self.message = "Starting"
        self.error = ""
        self.traceback = ""

    def feed(self, message: Values) -> None:
        """Take one message of the worker; once the job is over, nothing changes it any more."""
        if self.state != "RUNNING":
            return
        if "progress" in message:
            self.fraction, self.message = float(message["progress"]), str(message.get("message", ""))
        elif "done" in message:
            self.state, self.fraction = "DONE", 1.0
        elif "error" in message:
            self.state, self.error = "FAILED", str(message["error"])
        elif "crash" in message:
            self._crashed(str(message["crash"]))
        elif "ended" in message:
            self.state, self.traceback = "FAILED", str(message.get("stderr", ""))
            self.error = (
                f"{self.label} stopped: the worker process ended unexpectedly (exit status {message['ended']}); "
                "nothing was changed. Run it again, with fewer strands if memory is short"
            )

    def _crashed(self, traceback: str) -> None:
        self.state, self.traceback = "FAILED", traceback
        last = traceback.strip().splitlines()[-1] if traceback.strip() else "unknown"
        self.error = f"{self.label} failed with a bug in Hairloom ({last}); nothing was changed, the console has the details"

    def cancel(self) -> None:
        """The user wants it to end."""
        if self.state == "RUNNING":
            self.state = "CANCELLED"


class WorkerJob:
    """A job in a worker process with its temporary files: start, `step` now and then, `close` in any case."""

    def __init__(self, label: str, job: str, inputs: Values, params: Values, *, is_patient: bool = False) -> None:
        self.run = JobRun(label)
        self._folder = Path(tempfile.mkdtemp(prefix="hairloom-", dir=bpy.app.tempdir or None))
        self._outputs = self._folder / "outputs.npz"
        request = {"job": job, "params": params, "outputs": str(self._outputs)}
        try:
            if inputs:
                request["inputs"] = str(self._folder / "inputs.npz")
                lazy.backend("io.bundle").write_bundle(request["inputs"], inputs)
            self._worker = WorkerProcess(worker_command(), request, worker_environment(), is_patient=is_patient)
        except BaseException:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise

    def step(self) -> JobRun:
        """Take in what the worker said, without waiting."""
        for message in self._worker.messages():
            self.run.feed(message)
        return self.run

    def outputs(self) -> Values:
        """What the finished job made."""
        return lazy.backend("io.bundle").read_bundle(self._outputs)

    def close(self) -> None:
        """End the worker and remove the files."""
        self._worker.stop()
        shutil.rmtree(self._folder, ignore_errors=True)


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


def reports_errors(execute: Callable[[Any, bpy.types.Context], set[str]]) -> Callable[..., set[str]]:
    """An expected error of an operator's `execute` becomes one ERROR line; any other keeps its traceback."""

    @functools.wraps(execute)
    def run(self: Any, context: bpy.types.Context) -> set[str]:
        try:
            return execute(self, context)
        except HairloomError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}

    return run


class JobOperator:
    """Mixin of the operators that run a job of the backend's registry.

    A subclass sets `job` and gives `sources`, `read`, `params` and `apply`. Only the names of the sources' data are
    remembered while the worker runs (undo replaces the data); if they are gone or changed by then, nothing is written.
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

    def apply(self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values) -> str:
        """Write the outputs into the scene, once; returns what to tell the user."""
        raise NotImplementedError

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
        self._fingerprint = lazy.bridge("fingerprint").fingerprint(inputs)
        self._running = WorkerJob(self.bl_label, self.job, inputs, self.params(context))
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
            return self._finish(context, run)
        finally:
            self._end(context)

    def _show(self, context: bpy.types.Context, run: JobRun) -> None:
        shown = status(context)
        if (shown.fraction, shown.message) != (run.fraction, run.message):
            shown.show(run)
            redraw_sidebars(context)
        context.workspace.status_text_set(f"{run.label}: {run.message}  {run.fraction:.0%}   |   Esc: Cancel")

    @reports_errors
    def _finish(self, context: bpy.types.Context, run: JobRun) -> set[str]:
        if run.state == "CANCELLED":
            self.report({"INFO"}, f"{run.label} cancelled; nothing was changed")
            return {"CANCELLED"}
        if run.state == "FAILED":
            if run.traceback:
                sys.stderr.write(f"Hairloom: {run.label}\n{run.traceback}\n")
            self.report({"ERROR"}, run.error)
            return {"CANCELLED"}
        sources = self._find_sources()
        if sources is None or lazy.bridge("fingerprint").fingerprint(self.read(sources)) != self._fingerprint:
            self.report({"ERROR"}, f"The hair or the head changed while {run.label} ran; nothing was changed. Run it again")
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
        redraw_sidebars(context)

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender itself ends the operator: another file is opened, or the window closes."""
        self._running.run.cancel()
        self._end(context)


def redraw_sidebars(context: bpy.types.Context) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in {"VIEW_3D", "PREFERENCES"}:
                area.tag_redraw()


def register() -> None:
    bpy.utils.register_class(JobStatus)
    bpy.types.WindowManager.hairloom_job = bpy.props.PointerProperty(type=JobStatus)


def unregister() -> None:
    del bpy.types.WindowManager.hairloom_job
    bpy.utils.unregister_class(JobStatus)
