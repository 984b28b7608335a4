"""Blender's side: 100,000 x 64 points into native Curves, enabling the add-on, and the first operator. Needs bpy."""

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
import json, os, sys, time
import bpy
found = {}
since = time.perf_counter()
bpy.ops.preferences.addon_enable(module=MODULE)
found["enable"] = time.perf_counter() - since
found["heavy"] = [name for name in ("numba", "scipy", "igl", "embreex") if name in sys.modules]
import numpy as np
import importlib
def best(work, times=7):
    seconds = []
    for _ in range(times):
        since = time.perf_counter(); work(); seconds.append(time.perf_counter() - since)
    return min(seconds)
if SMALL:
    since = time.perf_counter()
    bpy.ops.hairloom.add_head()
    found["first operator"] = time.perf_counter() - since
else:
    curves_bridge = importlib.import_module(MODULE + ".bridge.curves")
    strands_module = importlib.import_module(MODULE + ".backend.geometry.strands")
    points = np.random.default_rng(0).random((100_000, 64, 3), dtype=np.float32)
    strands = strands_module.from_dense(points)
    flat, target = strands.points, np.empty_like(strands.points)
    found["copy"] = best(lambda: np.copyto(target, flat))
    obj = curves_bridge.new_object("bench", strands, bpy.context.scene.collection)
    attributes = importlib.import_module(MODULE + ".bridge.attributes")
    write = lambda: attributes.write_values(obj.data.position_data, "vector", flat, np.float32, 3)
    found["positions"] = best(write)
    graph = bpy.context.evaluated_depsgraph_get()
    def update():
        write(); obj.data.update_tag(); bpy.context.view_layer.update(); obj.evaluated_get(graph)
    found["positions and depsgraph"] = best(update, 5)
    found["read"] = best(lambda: curves_bridge.read_strands(obj), 5)
    found["new object"] = best(lambda: curves_bridge.new_curves("more", strands), 3)
print("RESULT" + json.dumps(found)); sys.stdout.flush(); os._exit(0)
"""


def _run(small: bool) -> dict[str, Any]:
    sys.path.insert(0, str(ROOT))
    import build_addon

    with tempfile.TemporaryDirectory() as resources:
        build_addon.stage(Path(resources) / "extensions" / "user_default" / "hairloom")
        program = f"MODULE, SMALL = {MODULE!r}, {small}\n{PROGRAM}"
        env = {
            **os.environ,
            "BLENDER_USER_RESOURCES": resources,
            "NUMBA_CACHE_DIR": str(ROOT / ".cache" / "numba-bench"),
        }
        done = subprocess.run([sys.executable, "-c", program], env=env, check=True, capture_output=True, text=True)
    return dict(json.loads(done.stdout.split("RESULT")[1].splitlines()[0]))


def run(*, quick: bool = False) -> list[dict[str, Any]]:
    """Rows for `hairloom bench blender`."""
    if importlib.util.find_spec("bpy") is None:
        return [{"size": "", "who": "hairloom", "seconds": None, "target": None, "note": "skipped: no bpy here"}]
    _run(True)  # fills the kernel cache
    starts = [_run(True) for _ in range(1 if quick else 3)]
    bulk = _run(False)
    copy = bulk["copy"]
    rows = [
        ("enable the add-on", min(s["enable"] for s in starts), 0.15, f"heavy imports: {starts[0]['heavy'] or 'none'}"),
        ("first operator (Add Head), cached", min(s["first operator"] for s in starts), 0.8, ""),
        ("100k x 64: numpy copy", copy, None, "the yardstick"),
        ("100k x 64: positions into Curves", bulk["positions"], 1.2 * copy, f"{bulk['positions'] / copy:.2f} copies"),
        ("100k x 64: positions and depsgraph", bulk["positions and depsgraph"], 0.1, ""),
        ("100k x 64: read strands", bulk["read"], None, ""),
        ("100k x 64: new Curves with all data", bulk["new object"], None, ""),
    ]
    return [{"size": size, "who": "hairloom", "seconds": s, "target": t, "note": note} for size, s, t, note in rows]
