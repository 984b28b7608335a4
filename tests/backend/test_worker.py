"""The worker process: started by file path, talks JSON lines, leaves nothing behind when it fails or is left."""

import json
import subprocess
import sys
from pathlib import Path

import hairloom
import numpy as np
from hairloom.geometry.head import default_head
from hairloom.geometry.strands import from_dense
from hairloom.io.bundle import read_bundle, write_bundle

WORKER = Path(hairloom.__file__).with_name("worker.py")


def start():
    return subprocess.Popen(
        [sys.executable, "-I", str(WORKER)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip


def ask(request):
    process = start()
    process.stdin.write(json.dumps(request) + "\n")
    process.stdin.flush()
    messages = [json.loads(line) for line in process.stdout]
    process.wait(timeout=60)
    process.stdin.close()
    return messages


def write_inputs(path):
    head = default_head()
    centres = head.vertices[head.triangles[head.scalp]].mean(axis=1)[:50]
    points = centres[:, None] + np.linspace(0, 0.05, 5)[None, :, None] * np.array([0.0, 0.0, 1.0])
    write_bundle(path, {"strands": from_dense(points.astype(np.float32)), "head": head})


def test_a_job_reports_progress_and_writes_its_outputs(tmp_path):
    write_inputs(tmp_path / "in.npz")
    messages = ask(
        {"job": "clean_up", "inputs": str(tmp_path / "in.npz"), "outputs": str(tmp_path / "out.npz"), "params": {}}
    )
    assert messages[-1] == {"done": True}
    assert all(0 <= m["progress"] <= 1 for m in messages[:-1]) and len(messages) > 1
    assert read_bundle(tmp_path / "out.npz")["strands"].n_strands > 0


def test_bad_input_is_one_error_line_and_no_output(tmp_path):
    write_inputs(tmp_path / "in.npz")
    request = {"job": "cluster_wisps", "inputs": str(tmp_path / "in.npz"), "outputs": str(tmp_path / "out.npz")}
    messages = ask({**request, "params": {"hierarchy": {"wisps": {"n_wisps": 4000}}}})
    assert "4000" in messages[-1]["error"] and "\n" not in messages[-1]["error"]
    assert not (tmp_path / "out.npz").exists()


def test_a_bug_comes_back_with_its_traceback(tmp_path):
    write_bundle(tmp_path / "in.npz", {"strands": 3, "head": None})
    messages = ask({"job": "clean_up", "inputs": str(tmp_path / "in.npz"), "outputs": str(tmp_path / "out.npz")})
    assert "Traceback" in messages[-1].get("crash", "")


def test_it_leaves_when_its_parent_is_gone(tmp_path):
    process = start()
    process.stdin.write(json.dumps({"job": "warm_up", "outputs": str(tmp_path / "out.npz")}) + "\n")
    process.stdin.flush()
    process.stdin.close()  # what the end of the parent looks like
    assert process.wait(timeout=30) in (0, 1)
    process.stdout.close()
    process.stderr.close()


def test_kernels_belong_to_the_package_that_the_parent_names():
    """Blender and its worker share compiled kernels, and a kernel is loaded again by the name of its module."""
    program = f"""
import importlib, importlib.util
spec = importlib.util.spec_from_file_location("worker", {str(WORKER)!r})
worker = importlib.util.module_from_spec(spec)
spec.loader.exec_module(worker)
worker._import_package("bl_ext.user_default.hairloom.backend")
importlib.import_module("bl_ext.user_default.hairloom.backend.editing.flow")  # imports from other packages in turn
kernels = importlib.import_module("bl_ext.user_default.hairloom.backend.geometry._strands_kernels")
print(kernels.resample_values.name)
"""
    done = subprocess.run([sys.executable, "-I", "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "bl_ext.user_default.hairloom.backend.geometry._strands_kernels.resample_values"
