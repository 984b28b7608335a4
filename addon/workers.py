"""The worker process of long jobs: Blender's own Python beside it, one request in, JSON lines out.

Nothing here knows operators or the scene, so that tests feed it; `jobs.py` has the operator's side.
"""

from __future__ import annotations

import json
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

import bpy

from . import lazy

WORKER = Path(__file__).parent / "backend" / "worker.py"
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
        self,
        command: list[str],
        request: Values,
        environment: dict[str, str] | None = None,
        *,
        is_patient: bool = False,
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
            os.setpriority(os.PRIO_PROCESS, self._process.pid, 10)
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
        self.error = (
            f"{self.label} failed with a bug in Hairloom ({last}); nothing was changed, the console has the details"
        )

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
        package = f"{__package__}.backend"
        request = {"job": job, "params": params, "outputs": str(self._outputs), "package": package}
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
