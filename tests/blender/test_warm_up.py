"""Operator warm_up and the compiling in the background."""

from __future__ import annotations

import bpy
import pytest
import scenes


@pytest.fixture
def registry(monkeypatch):
    """The registry with a warm-up that takes no time."""
    real = scenes.module("backend.registry")
    monkeypatch.setattr(real, "run_job", lambda name, inputs, params, progress: {"report": {"kernels": 7}})


def test_warm_up_remembers_that_it_ran(registry, tmp_path, monkeypatch):
    warmup = scenes.module("warmup")
    monkeypatch.setattr(warmup.lazy, "kernel_cache_folder", lambda: str(tmp_path / "kernels"))
    assert not warmup.is_warm()
    assert bpy.ops.hairloom.warm_up() == {"FINISHED"}
    assert warmup.is_warm()


def test_another_version_compiles_again(tmp_path, monkeypatch):
    warmup = scenes.module("warmup")
    monkeypatch.setattr(warmup.lazy, "kernel_cache_folder", lambda: str(tmp_path / "kernels"))
    warmup.mark_warm()
    monkeypatch.setattr(warmup, "_version", lambda: "99.0.0")
    assert not warmup.is_warm()


def test_nothing_is_compiled_in_the_background_of_a_script():
    warmup = scenes.module("warmup")
    if not bpy.app.background:
        pytest.skip("has a window")
    assert not warmup.is_running()
    assert not bpy.app.timers.is_registered(warmup._tick)


class Job:
    """A worker job that is told what to say."""

    def __init__(self, messages):
        self.run = scenes.module("workers").JobRun("Compile Kernels")
        self.messages = messages
        self.closed = 0

    def step(self):
        self.run.feed(self.messages.pop(0))
        return self.run

    def close(self):
        self.closed += 1


@pytest.mark.parametrize(("end", "is_warm"), [({"done": True}, True), ({"ended": 1, "stderr": ""}, False)])
def test_the_background_worker_is_followed_to_its_end(tmp_path, monkeypatch, end, is_warm):
    warmup = scenes.module("warmup")
    monkeypatch.setattr(warmup.lazy, "kernel_cache_folder", lambda: str(tmp_path / "kernels"))
    job = Job([{"progress": 0.5, "message": "Compiling"}, end])
    monkeypatch.setattr(scenes.module("workers"), "WorkerJob", lambda *_, **__: job)
    assert warmup._tick() > 0
    assert warmup._tick() > 0
    assert (warmup.is_running(), warmup.progress()) == (True, (0.5, "Compiling"))
    with pytest.raises(RuntimeError, match="being compiled in the background"):
        bpy.ops.hairloom.warm_up()
    assert warmup._tick() is None
    assert (warmup.is_running(), warmup.is_warm(), job.closed) == (False, is_warm, 1)
