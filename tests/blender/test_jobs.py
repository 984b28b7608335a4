"""Jobs in a worker process: messages, the end of the worker in every way it can end, and the operator around it."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest
import scenes

ESCAPE = SimpleNamespace(type="ESC", value="PRESS")
TIMER = SimpleNamespace(type="TIMER", value="NOTHING")
MOUSE = SimpleNamespace(type="MOUSEMOVE", value="NOTHING")

SAYS_PROGRESS = """
import sys, json, time
request = json.loads(sys.stdin.readline())
print(json.dumps({"progress": 0.25, "message": "Working"}), flush=True)
"""
FINISHES = SAYS_PROGRESS + 'open(request["outputs"], "wb").close()\nprint(json.dumps({"done": True}), flush=True)\n'
REFUSES = SAYS_PROGRESS + 'print(json.dumps({"error": "the example has 3 strands"}), flush=True)\n'
CRASHES = SAYS_PROGRESS + 'print(json.dumps({"crash": "Traceback\\n  line\\nValueError: 7"}), flush=True)\n'
HANGS = SAYS_PROGRESS + "time.sleep(600)\n"
IGNORES_THE_END = "import signal\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\n" + HANGS
DIES = SAYS_PROGRESS + 'sys.stderr.write("out of luck")\nsys.stderr.flush()\nimport os\nos._exit(9)\n'


@pytest.fixture
def worker(tmp_path, monkeypatch):
    """Call it with the text of a script: that is the worker from now on. Returns the folder of temporary files."""
    workers = scenes.module("workers")

    def use(text: str) -> Path:
        script = tmp_path / "worker.py"
        script.write_text(text)
        monkeypatch.setattr(workers, "worker_command", lambda: [sys.executable, str(script)])
        folder = tmp_path / "temporary"
        folder.mkdir()
        make = workers.tempfile.mkdtemp
        monkeypatch.setattr(workers.tempfile, "mkdtemp", lambda prefix, dir: make(prefix=prefix, dir=folder))
        return folder

    return use


def until(condition, seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never happened"
        time.sleep(0.01)


def run_to_end(job) -> object:
    until(lambda: job.step().state != "RUNNING")
    return job.run


def is_gone(job) -> bool:
    return job._worker._process.poll() is not None


def test_the_worker_knows_the_package_by_blenders_name(worker):
    """Both share the compiled kernels, which are found by the name of their module."""
    worker(
        'import json, sys\nrequest = json.loads(sys.stdin.readline())\nprint(json.dumps({"error": request["package"]}))'
    )
    job = scenes.module("workers").WorkerJob("Say", "none", {}, {})
    assert run_to_end(job).error == scenes.module("backend").__name__
    job.close()


# --- the run as its messages tell it


def test_a_run_follows_its_messages():
    run = scenes.module("workers").JobRun("Synthesize")
    run.feed({"progress": 0.5, "message": "Placing roots"})
    assert (run.state, run.fraction, run.message) == ("RUNNING", 0.5, "Placing roots")
    run.feed({"done": True})
    assert (run.state, run.fraction) == ("DONE", 1.0)


def test_what_comes_after_the_end_changes_nothing():
    run = scenes.module("workers").JobRun("Synthesize")
    run.feed({"error": "no scalp"})
    run.feed({"ended": 0, "stderr": ""})
    run.feed({"done": True})
    run.cancel()
    assert (run.state, run.error) == ("FAILED", "no scalp")


def test_a_cancelled_run_is_not_done():
    run = scenes.module("workers").JobRun("Synthesize")
    run.cancel()
    run.feed({"done": True})
    assert run.state == "CANCELLED"


@pytest.mark.parametrize(
    ("message", "words"),
    [
        ({"crash": "Traceback\nValueError: 7"}, "bug in Hairloom (ValueError: 7)"),
        ({"crash": ""}, "bug in Hairloom"),
        ({"ended": -9, "stderr": "killed"}, "ended unexpectedly (exit status -9)"),
    ],
)
def test_the_worst_ends_are_one_line_too(message, words):
    run = scenes.module("workers").JobRun("Synthesize")
    run.feed(message)
    assert run.state == "FAILED"
    assert words in run.error
    assert "nothing was changed" in run.error
    assert "\n" not in run.error


# --- the worker process


def test_a_worker_finishes(worker):
    folder = worker(FINISHES)
    job = scenes.module("workers").WorkerJob("Test", "any", {}, {})
    assert run_to_end(job).state == "DONE"
    job.close()
    assert is_gone(job)
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    ("script", "words"), [(REFUSES, "the example has 3 strands"), (CRASHES, "ValueError: 7"), (DIES, "exit status 9")]
)
def test_a_worker_fails(worker, script, words):
    folder = worker(script)
    job = scenes.module("workers").WorkerJob("Test", "any", {}, {})
    assert words in run_to_end(job).error
    job.close()
    assert list(folder.iterdir()) == []


def test_what_a_dead_worker_wrote_to_stderr_is_kept(worker):
    worker(DIES)
    job = scenes.module("workers").WorkerJob("Test", "any", {}, {})
    assert "out of luck" in run_to_end(job).traceback
    job.close()


@pytest.mark.parametrize("script", [HANGS, IGNORES_THE_END])
def test_closing_ends_a_worker_that_lingers(worker, script):
    if sys.platform == "win32" and script is IGNORES_THE_END:
        pytest.skip("Windows has no signal to ignore")
    folder = worker(script)
    job = scenes.module("workers").WorkerJob("Test", "any", {}, {})
    until(lambda: job.step().fraction == 0.25)
    start = time.monotonic()
    job.close()
    assert is_gone(job)
    assert time.monotonic() - start < 5
    assert list(folder.iterdir()) == []


def test_a_killed_worker_is_noticed(worker):
    worker(HANGS)
    job = scenes.module("workers").WorkerJob("Test", "any", {}, {})
    until(lambda: job.step().fraction == 0.25)
    job._worker._process.kill()
    assert "ended unexpectedly" in run_to_end(job).error
    job.close()


def test_a_worker_that_cannot_start_leaves_no_files(worker, monkeypatch):
    folder = worker(FINISHES)
    workers = scenes.module("workers")
    monkeypatch.setattr(workers, "worker_command", lambda: ["/nowhere/python"])
    with pytest.raises(FileNotFoundError):
        workers.WorkerJob("Test", "any", {}, {})
    assert list(folder.iterdir()) == []


def test_the_environment_brings_packages_and_nothing_of_the_users_python(monkeypatch):
    monkeypatch.setenv("PYTHONHOME", "/elsewhere")
    monkeypatch.setenv("PYTHONSTARTUP", "/elsewhere/start.py")
    environment = scenes.module("workers").worker_environment()
    assert "PYTHONHOME" not in environment
    assert "PYTHONSTARTUP" not in environment
    assert "packages" in environment["PYTHONPATH"]


def test_the_real_worker_answers(tmp_path):
    """With Blender's own Python and the file that ships: an unknown job is refused in one line."""
    job = scenes.module("workers").WorkerJob("Test", "no_such_job", {}, {})
    run = run_to_end(job)
    job.close()
    assert run.state == "FAILED"
    assert "no job 'no_such_job'" in run.error


# --- the operator around it, with a window manager that only keeps books


class Window:
    """A context for modal operators: real data, pretended handlers."""

    def __init__(self) -> None:
        real = bpy.context.window_manager
        self.timers = 0
        self.texts: list[str | None] = []
        self.window_manager = SimpleNamespace(
            hairloom_job=real.hairloom_job,
            windows=real.windows,
            modal_handler_add=lambda operator: None,
            event_timer_add=self._add,
            event_timer_remove=self._remove,
        )
        self.workspace = SimpleNamespace(status_text_set=self.texts.append)
        self.window = real.windows[0]

    def _add(self, seconds, window):
        self.timers += 1
        return "timer"

    def _remove(self, timer):
        self.timers -= 1


@pytest.fixture
def operator():
    """A job operator without Blender's part: it notes what it would report and apply."""

    class Operator(scenes.module("jobs").JobOperator):
        bl_label = "Test Job"
        job = "any"

        def __init__(self) -> None:
            self.reports: list[tuple[str, str]] = []
            self.applied = 0

        def report(self, kinds, text):
            self.reports.append((next(iter(kinds)), text))

        def sources(self, context):
            return {"groom": bpy.data.objects["Hair"]}

        def read(self, sources):
            return {"strands": scenes.module("bridge.curves").read_strands(sources["groom"])}

        def apply(self, context, sources, outputs):
            self.applied += 1
            return "42 wisps"

    scenes.groom()
    return Operator()


@pytest.fixture
def no_bundles(monkeypatch):
    """Jobs of these tests read and write no bundles."""
    workers = scenes.module("workers")
    nothing = SimpleNamespace(write_bundle=lambda path, values: None, read_bundle=lambda path: {})
    monkeypatch.setattr(workers.lazy, "backend", lambda name: nothing)


def drive(operator, context, event=TIMER) -> set[str]:
    """Tick until the operator ends."""
    end = time.monotonic() + 20
    while True:
        result = operator.modal(context, event)
        event = TIMER
        if result & {"FINISHED", "CANCELLED"}:
            return result
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.fixture
def started(operator, worker, no_bundles):
    """Start the operator on a script; returns (operator, context, folder of temporary files)."""

    def start(script: str):
        folder = worker(script)
        context = Window()
        assert operator._start(context) == {"RUNNING_MODAL"}
        assert context.window_manager.hairloom_job.is_running
        return operator, context, folder

    return start


def assert_all_is_quiet(context, folder) -> None:
    assert not context.window_manager.hairloom_job.is_running
    assert context.timers == 0
    assert context.texts[-1] is None
    assert list(folder.iterdir()) == []


def test_an_operator_applies_what_its_job_made(started):
    operator, context, folder = started(FINISHES)
    assert drive(operator, context) == {"FINISHED"}
    assert operator.applied == 1
    assert operator.reports == [("INFO", "42 wisps")]
    assert_all_is_quiet(context, folder)


def test_events_of_the_user_pass_through_while_it_runs(started):
    operator, context, folder = started(HANGS)
    assert operator.modal(context, MOUSE) == {"PASS_THROUGH"}
    until(lambda: operator.modal(context, TIMER) and context.window_manager.hairloom_job.fraction == 0.25)
    assert "Working" in context.texts[-1]
    assert drive(operator, context, ESCAPE) == {"CANCELLED"}
    assert_all_is_quiet(context, folder)


def test_escape_cancels(started):
    operator, context, folder = started(HANGS)
    before = scenes.scene_state()
    assert drive(operator, context, ESCAPE) == {"CANCELLED"}
    assert operator.applied == 0
    assert operator.reports == [("INFO", "Test Job cancelled; nothing was changed")]
    assert scenes.scene_state() == before
    assert_all_is_quiet(context, folder)


def test_escape_wins_over_a_result_that_came_in_the_meantime(started):
    operator, context, folder = started(FINISHES)
    time.sleep(0.5)
    assert drive(operator, context, ESCAPE) == {"CANCELLED"}
    assert operator.applied == 0
    assert_all_is_quiet(context, folder)


def test_the_cancel_button_cancels(started):
    operator, context, folder = started(HANGS)
    assert bpy.ops.hairloom.cancel_job() == {"FINISHED"}
    assert drive(operator, context) == {"CANCELLED"}
    assert_all_is_quiet(context, folder)


@pytest.mark.parametrize("script", [REFUSES, CRASHES, DIES])
def test_a_failed_job_is_one_error_line_and_no_change(started, script):
    operator, context, folder = started(script)
    assert drive(operator, context) == {"CANCELLED"}
    assert operator.applied == 0
    assert [kind for kind, _ in operator.reports] == ["ERROR"]
    assert "\n" not in operator.reports[0][1]
    assert_all_is_quiet(context, folder)


def test_hair_that_changed_meanwhile_is_left_alone(started):
    operator, context, folder = started(FINISHES)
    bpy.data.objects["Hair"].data.points[5].position.x += 0.01
    assert drive(operator, context) == {"CANCELLED"}
    assert operator.applied == 0
    assert "changed while Test Job ran" in operator.reports[0][1]
    assert_all_is_quiet(context, folder)


def test_hair_that_was_deleted_meanwhile_is_no_error(started):
    operator, context, folder = started(FINISHES)
    bpy.data.objects.remove(bpy.data.objects["Hair"])
    assert drive(operator, context) == {"CANCELLED"}
    assert "changed while" in operator.reports[0][1]
    assert_all_is_quiet(context, folder)


def test_other_data_under_the_old_name_is_not_mistaken_for_the_hair(started):
    operator, context, folder = started(FINISHES)
    bpy.data.objects["Hair"].name = "Old Hair"
    scenes.groom(name="Hair")
    assert drive(operator, context) == {"FINISHED"}
    assert_all_is_quiet(context, folder)


def test_a_bug_in_apply_still_ends_the_job(started):
    operator, context, folder = started(FINISHES)

    def broken(*_):
        raise ZeroDivisionError

    operator.apply = broken
    with pytest.raises(ZeroDivisionError):
        drive(operator, context)
    assert_all_is_quiet(context, folder)


def test_opening_another_file_ends_the_job(started):
    operator, context, folder = started(HANGS)
    operator.cancel(context)
    assert is_gone(operator._running)
    assert_all_is_quiet(context, folder)


def test_a_second_job_is_refused():
    scenes.groom_on_head()
    job = bpy.context.window_manager.hairloom_job
    job.is_running, job.label = True, "Synthesize"
    try:
        for name in ("synthesize", "cluster_wisps", "extract_centers", "clean_up", "warm_up"):
            with pytest.raises(RuntimeError, match="Synthesize is still running"):
                getattr(bpy.ops.hairloom, name)()
    finally:
        job.clear()
