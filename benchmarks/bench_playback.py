"""Playback and baking of 50,000 strands x 32 points in Blender, evaluated Curves included. Needs bpy."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
MODULE = "bl_ext.user_default.hairloom"

# runs in a fresh process with the add-on staged; prints one JSON line
PROGRAM = """
import importlib, json, os, sys, time
import bpy
import numpy as np
bpy.ops.preferences.addon_enable(module=MODULE)
bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
playback = importlib.import_module(MODULE + ".playback")
cache = importlib.import_module(MODULE + ".backend.io.sim_cache")
found = {}
def best(work, times=N_RUNS):
    seconds = []
    for _ in range(times):
        since = time.perf_counter(); work(); seconds.append(time.perf_counter() - since)
    return min(seconds)
rest = np.random.default_rng(0).normal(size=(50_000 * 32, 3)).astype(np.float32)
curves = bpy.data.hair_curves.new("Hair")
curves.add_curves([32] * 50_000)
curves.position_data.foreach_set("vector", rest.ravel())
curves.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", np.full(len(rest), 1e-4, np.float32))
obj = bpy.data.objects.new("Hair", curves)
bpy.context.collection.objects.link(obj)
bpy.context.view_layer.objects.active = obj
writer = cache.CacheWriter.create(FOLDER + "/cache", len(rest), fps=24)
since = time.perf_counter()
for frame in range(N_FRAMES):
    writer.append(rest + np.float32(0.01 * frame))
found["append"] = (time.perf_counter() - since) / N_FRAMES
playback.attach(obj, FOLDER + "/cache")
def play(subframe=0.0):
    for frame in range(1, N_FRAMES):
        bpy.context.scene.frame_set(frame, subframe=subframe)
        obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
found["play"] = best(play) / (N_FRAMES - 1)
found["between"] = best(lambda: play(0.5)) / (N_FRAMES - 1)
found["handler"] = best(lambda: playback.players.play(curves, 7.0))
found["status"] = best(lambda: playback.status(obj))
since = time.perf_counter()
bpy.ops.hairloom.bake_alembic(filepath=FOLDER + "/hair.abc", space="OBJECT")
found["bake"] = (time.perf_counter() - since) / N_FRAMES
print("RESULT" + json.dumps(found)); sys.stdout.flush(); os._exit(0)
"""


def run(*, quick: bool = False) -> list[dict[str, Any]]:
    """Rows for `hairloom bench playback`; seconds are of one frame."""
    if importlib.util.find_spec("bpy") is None:
        return [{"size": "", "who": "hairloom", "seconds": None, "target": None, "note": "skipped: no bpy here"}]
    sys.path.insert(0, str(ROOT))
    import build_addon

    with tempfile.TemporaryDirectory() as folder:
        build_addon.stage(Path(folder) / "extensions" / "user_default" / "hairloom")
        sizes = f"N_FRAMES, N_RUNS = {(8, 2) if quick else (24, 5)}"
        program = f"MODULE, FOLDER = {MODULE!r}, {folder!r}\n{sizes}\n{PROGRAM}"
        env = {**os.environ, "BLENDER_USER_RESOURCES": folder}
        done = subprocess.run([sys.executable, "-c", program], env=env, check=True, capture_output=True, text=True)
    found = json.loads(done.stdout.split("RESULT")[1].splitlines()[0])
    rows = [
        ("50k x 32: play a frame", "play", 1 / 24, f"{1 / found['play']:.0f} frames/s"),
        ("50k x 32: play between frames", "between", 1 / 24, f"{1 / found['between']:.0f} frames/s"),
        ("50k x 32: the handler alone", "handler", None, "looks for edits first, as in the background"),
        ("50k x 32: status for the panel", "status", None, ""),
        ("50k x 32: append a frame to the cache", "append", None, "as fast as the disk"),
        ("50k x 32: bake a frame to Alembic", "bake", None, "as fast as the disk"),
    ]
    return [{"size": s, "who": "hairloom", "seconds": found[k], "target": t, "note": n} for s, k, t, n in rows]
