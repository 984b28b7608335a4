"""A frame of 1,000 guides x 20 elements beside Blender's own: legacy hair dynamics, and the Hair Dynamics node of 5.2.

The legacy one needs bpy 4.5 in this Python; the node runs in the Blender that HAIRLOOM_BLENDER names (default:
../shared/tools/blender-gui). All three let the same straight hair fall from the upper half of a ball, a frame of 1/24 s
at a time; ours in two steps, with contact with the ball and friction, which the legacy one has not.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
N_GUIDES, N_ELEMENTS, N_FRAMES = 1000, 20, 12
LEAST_RATIO = 40.0  # the issue's: ours against the legacy dynamics, in the same run

HEAD = """
import bpy, json, os, sys, time
import numpy as np
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24, radius=0.1)
scene, head = bpy.context.scene, bpy.context.object
scene.render.fps = 24
def say(times):
    print("RESULT" + json.dumps({"seconds": sorted(times)[len(times) // 2], "version": bpy.app.version_string}))
    sys.stdout.flush(); os._exit(0)
"""
LEGACY = """
modifier = head.modifiers.new("hair", "PARTICLE_SYSTEM")
system = head.particle_systems[0]
system.settings.type, system.settings.count = "HAIR", N_GUIDES
system.settings.hair_length, system.settings.hair_step = 0.25, N_ELEMENTS
system.use_hair_dynamics = True
system.cloth.settings.quality = 5
scene.frame_set(1)
times = []
for frame in range(2, 2 + N_FRAMES):
    since = time.perf_counter(); scene.frame_set(frame); times.append(time.perf_counter() - since)
say(times)
"""
NODE = """
bpy.ops.object.curves_empty_hair_add()
hair = bpy.context.object
directions = np.random.default_rng(0).normal(size=(N_GUIDES, 3)); directions[:, 2] = abs(directions[:, 2])
directions /= np.linalg.norm(directions, axis=1)[:, None]
points = directions[:, None] * (0.1 + 0.25 * np.linspace(0, 1, N_ELEMENTS + 1))[None, :, None]
hair.data.add_curves([N_ELEMENTS + 1] * N_GUIDES)
hair.data.position_data.foreach_set("vector", points.astype(np.float32).ravel()); hair.data.update_tag()
bpy.ops.curves.snap_curves_to_surface(attach_mode="NEAREST")
modifier = hair.modifiers[0]
mode = next(item.identifier for item in modifier.node_group.interface.items_tree
            if item.item_type == "SOCKET" and item.name == "Mode")
getattr(modifier.properties.inputs, mode).value = "Physics (Experimental)"
hair.update_tag()
scene.frame_set(1)
times = []
for frame in range(2, 2 + N_FRAMES):
    since = time.perf_counter()
    scene.frame_set(frame)
    evaluated = hair.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    times.append(time.perf_counter() - since)
say(times)
"""


def _in_blender(command: list[str], program: str) -> dict[str, Any] | None:
    constants = f"N_GUIDES, N_ELEMENTS, N_FRAMES = {N_GUIDES}, {N_ELEMENTS}, {N_FRAMES}\n"
    done = subprocess.run([*command, constants + HEAD + program], capture_output=True, text=True, timeout=1200)
    if "RESULT" not in done.stdout:
        return None
    return dict(json.loads(done.stdout.split("RESULT")[1].splitlines()[0]))


def ours() -> float:
    """Seconds of a frame, median, from a run of the simulation itself."""
    import statistics
    import time

    import numpy as np
    from hairloom.geometry.head import sphere_head
    from hairloom.rods.fitting import FitParams, fit_helices
    from hairloom.rods.material import MaterialParams
    from hairloom.rods.model import make_rods
    from hairloom.rods.scene import CollisionMesh, Scene
    from hairloom.rods.simulation import Simulation, SimulationParams
    from hairloom.types import StrandSet

    head = sphere_head()
    radius = float(np.linalg.norm(head.vertices, axis=1).max())
    directions = np.random.default_rng(0).normal(size=(N_GUIDES, 3))
    directions[:, 2] = abs(directions[:, 2])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    points = directions[:, None] * (radius + 0.25 * np.linspace(0, 1, N_ELEMENTS + 1))[None, :, None]
    offsets = np.arange(N_GUIDES + 1, dtype=np.int32) * (N_ELEMENTS + 1)
    strands = StrandSet(points.reshape(-1, 3).astype(np.float32), offsets)
    helices = fit_helices(strands, FitParams(n_elements=N_ELEMENTS)).helices
    still = np.tile(np.eye(4), (N_FRAMES + 2, 1, 1))
    scene = Scene(24.0, still, colliders=(CollisionMesh(head.triangles, head.vertices, still),))
    falling = SimulationParams(substeps=2, start_in_equilibrium=False)
    simulation = Simulation(make_rods(helices, MaterialParams()), helices, scene, falling)
    simulation.advance()
    times = []
    for _ in range(N_FRAMES):
        since = time.perf_counter()
        simulation.advance()
        times.append(time.perf_counter() - since)
    return statistics.median(times)


def run(*, quick: bool = False) -> list[dict[str, Any]]:
    """Rows for `hairloom bench dynamics_blender`."""
    size = f"{N_GUIDES} x {N_ELEMENTS}, a frame"
    legacy = _in_blender([sys.executable, "-c"], LEGACY)
    blender = os.environ.get("HAIRLOOM_BLENDER", str(ROOT.parent / "shared" / "tools" / "blender-gui"))
    node = _in_blender([blender, "-b", "--python-expr"], NODE) if Path(blender).exists() else None
    seconds = ours()
    rows: list[dict[str, Any]] = [{"size": size, "who": "hairloom", "seconds": seconds, "target": None, "note": ""}]
    if legacy is not None:
        rows[0] |= {
            "target": legacy["seconds"] / LEAST_RATIO,
            "note": f"{legacy['seconds'] / seconds:.0f} x the legacy",
        }
    peers = (("legacy hair dynamics, quality 5", legacy), ("Hair Dynamics node", node))
    for who, found in peers:
        note = f"Blender {found['version']}" if found else "skipped: that Blender is not here"
        measured = found["seconds"] if found else None
        rows.append({"size": size, "who": who, "seconds": measured, "target": None, "note": note})
    return rows
