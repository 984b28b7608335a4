"""The comb inside Blender: starting a stroke, and one mouse move with its positions written into Curves. Needs bpy."""

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
# the numbers: seconds for a move, for a brush over a tenth of the strands, and for a start
MOVE_TARGET = {20_000: 0.033, 100_000: 0.1}
START_TARGET = 0.5

# runs in a process of its own with the add-on staged; prints one JSON line
PROGRAM = """
import importlib, json, os, sys, time
import bpy
bpy.ops.preferences.addon_enable(module=MODULE)
import numpy as np
def module(name): return importlib.import_module(f"{MODULE}.{name}")
comb, strokes, curves, wisps = (module(name) for name in (
    "bridge.comb", "backend.editing.strokes", "bridge.curves", "bridge.wisps"))
bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
# a starter groom of 10,000 strands; more strands are copies of them beside themselves, in the same wisps
bpy.ops.hairloom.add_starter_groom(groom="Wavy")
bpy.ops.hairloom.cluster_wisps()
example, head = bpy.context.object, bpy.context.scene.hairloom.head
labels = [wisps.read_labels(example, level) for level in (1, 2)]
geometry = module("backend.geometry.strands")
points = geometry.resample(curves.read_strands(example), 64)
copies = -(-N_STRANDS // len(points))
shifts = np.random.default_rng(0).normal(0, 0.0005, (copies * len(points), 1, 3))
points = (np.tile(points, (copies, 1, 1)) + shifts)[:N_STRANDS].astype(np.float32)
groom = curves.new_object("Hair", geometry.from_dense(points), bpy.context.collection)
wisps.write_labels(groom, [np.tile(of_strand, copies)[:N_STRANDS] for of_strand in labels])
# seen from the left, 0.25 m to each side
middle = np.median(points.reshape(-1, 3), axis=0)
matrix = np.array([[0, -1, 0, middle[1]], [0, 0, 1, -middle[2]], [-1, 0, 0, 0], [0, 0, 0, 0.25]], float) / 0.25
view = strokes.View(matrix, 1000.0, 1000.0)
def start(radius, **changes):
    params = strokes.CombParams(radius=radius, **changes)
    return comb.LiveStroke(groom, [head], params, view, np.array(groom.matrix_world, float), None)
def seconds(work):
    since = time.perf_counter(); result = work(); return time.perf_counter() - since, result
before = np.array(points)
def touched():
    now = np.empty(before.size, np.float32); groom.data.position_data.foreach_get("vector", now)
    return float((now.reshape(before.shape) != before).any(axis=(1, 2)).mean())
def moves(radius, times, **changes):
    live, found = start(radius, **changes), []
    for i in range(times):
        found.append(seconds(lambda: live.move(460.0 + 8 * i, 520.0))[0])
    share = touched()
    live.cancel()
    return found[1:], share
moves(60.0, 4)  # compiles, builds the collider
radius, share = 60.0, 0.0
for _ in range(8):  # the radius whose brush holds a tenth of the strands: without drag nothing else moves
    share = moves(radius, 2, drag=0.0)[1]
    if 0.08 < share < 0.12: break
    radius *= (0.1 / max(share, 0.002)) ** 0.5
def live_write():
    module("bridge.attributes").write_values(groom.data.position_data, "vector", before.reshape(-1, 3), np.float32, 3)
    groom.data.update_tag()
kept = module("comb_cache").kept
colliding = []
for _ in range(3):
    kept.pop("session", None); colliding.append(seconds(lambda: start(radius))[0])
def cancelled(): live = start(radius); live.cancel()
again = min(seconds(cancelled)[0] for _ in range(5))
steps, moved = moves(radius, 12)
write = min(seconds(lambda: live_write())[0] for _ in range(5))
live = start(radius); live.move(460.0, 520.0)
def drawn():
    live.move(live_place[0], 520.0); live_place[0] += 8; bpy.context.view_layer.update()
live_place = [468.0]
updates = [seconds(drawn)[0] for _ in range(8)]
live.cancel()
print("RESULT" + json.dumps({"new": min(colliding), "again": again, "move": sorted(steps)[len(steps) // 2],
    "move_most": max(steps), "updated": sorted(updates)[len(updates) // 2], "share": share, "radius": radius,
    "moved": moved, "write": write}))
sys.stdout.flush(); os._exit(0)
"""


def _run(n_strands: int) -> dict[str, Any]:
    sys.path.insert(0, str(ROOT))
    import build_addon

    with tempfile.TemporaryDirectory() as resources:
        build_addon.stage(Path(resources) / "extensions" / "user_default" / "hairloom")
        program = f"MODULE, N_STRANDS = {MODULE!r}, {n_strands}\n{PROGRAM}"
        env = {
            **os.environ,
            "BLENDER_USER_RESOURCES": resources,
            "NUMBA_CACHE_DIR": str(ROOT / ".cache" / "numba-bench"),
        }
        done = subprocess.run([sys.executable, "-c", program], env=env, capture_output=True, text=True)
    if "RESULT" not in done.stdout:
        raise RuntimeError(done.stdout + done.stderr)
    return dict(json.loads(done.stdout.split("RESULT")[1].splitlines()[0]))


def run(*, quick: bool = False) -> list[dict[str, Any]]:
    """Rows for `hairloom bench comb_blender`."""
    if importlib.util.find_spec("bpy") is None:
        return [{"size": "", "who": "hairloom", "seconds": None, "target": None, "note": "skipped: no bpy here"}]
    rows = []
    for n_strands, target in MOVE_TARGET.items():
        if quick and n_strands > 20_000:
            continue
        found = _run(n_strands)
        size = f"{n_strands // 1000}k x 64"
        share, moved = f"{found['share']:.0%}", f"{found['moved']:.0%}"
        brush = f"brush of {found['radius']:.0f} pixels over {share} of the strands; 12 moves moved {moved}"
        rows += [
            (f"{size}: start of the first stroke", found["new"], START_TARGET, "collider kept, session new"),
            (f"{size}: start of the next stroke", found["again"], 0.1, "session kept"),
            (f"{size}: mouse move to Curves, median", found["move"], target, brush),
            (f"{size}: mouse move to Curves, slowest", found["move_most"], None, ""),
            (f"{size}: of it the write into Curves", found["write"], None, ""),
            (f"{size}: move and depsgraph, median", found["updated"], None, ""),
        ]
    return [{"size": size, "who": "hairloom", "seconds": s, "target": t, "note": note} for size, s, t, note in rows]
