"""All hair from its guides beside Blender's own node: one frame, growth with the strands, collision, binding, memory.

Guides and hair stand on a sphere of 9 cm and bend smoothly over it; the guides sway. The peer is Blender's node group
Interpolate Hair Curves in a process of its own, with as many guides and points, evaluated after its guides moved.
"""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from hairloom.geometry.analytic_heads import sphere_head
from hairloom.geometry.collider import build_collider
from hairloom.geometry.strands import from_dense
from hairloom.rods.helices import Helices, evaluate
from hairloom.rods.interpolation import bind_followers, interpolate, keep_out, rest_depths
from hairloom.types import StrandSet

Row = dict[str, Any]
N_GUIDES, N_POINTS, N_ELEMENTS = 1000, 64, 10
TARGET = {100_000: 0.1}
RADIUS, LENGTH = 0.09, 0.25
INWARDS = 12.0  # 1/m, more bend, by which a part of the hair gets into the head

# prints one JSON line: seconds of the evaluations after the guides moved, strands and points a strand
PEER = """
import glob, json, os, sys, time
import bpy
import numpy as np
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=RADIUS)
head = bpy.context.object
rng = np.random.default_rng(0)
guides = bpy.data.hair_curves.new("Guides")
guides.add_curves([N_POINTS] * N_GUIDES)
uv = rng.random((N_GUIDES, 2))
longitude, latitude = 2 * np.pi * uv[:, 0], np.pi * (uv[:, 1] - 0.5)
outward = np.stack([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)], -1)
t = np.linspace(0, 1, N_POINTS)[None, :, None]
points = ((RADIUS + LENGTH * t) * outward[:, None]).astype(np.float32)
guides.surface, guides.surface_uv_map = head, head.data.uv_layers[0].name
guides.attributes.new("surface_uv_coordinate", "FLOAT2", "CURVE").data.foreach_set(
    "vector", np.ascontiguousarray(uv, np.float32).reshape(-1))
positions = guides.attributes["position"].data
positions.foreach_set("vector", points.reshape(-1))
hair = bpy.data.objects.new("Guides", guides)
bpy.context.collection.objects.link(hair)
library = glob.glob(os.path.join(bpy.utils.resource_path("LOCAL"), "datafiles", "assets", "*",
    "procedural_hair_node_assets.blend"))[0]
with bpy.data.libraries.load(library) as (_, wanted):
    wanted.node_groups = ["Interpolate Hair Curves"]
group = bpy.data.node_groups["Interpolate Hair Curves"]
node = hair.modifiers.new("Interpolate", "NODES")
node.node_group = group
inputs = {item.name: item.identifier for item in group.interface.items_tree
    if item.item_type == "SOCKET" and item.in_out == "INPUT" and item.socket_type != "NodeSocketGeometry"}
uv_map = inputs["Surface UV Map"]
settings = {inputs["Surface"]: head, inputs["Density"]: N_STRANDS / (4 * np.pi * RADIUS**2),
    inputs["Poisson Disk Distribution"]: False, inputs["Viewport Amount"]: 1.0,
    f"{uv_map}_use_attribute": True, f"{uv_map}_attribute_name": head.data.uv_layers[0].name}
for name, value in settings.items():
    node[name] = value
times = []
for k in range(REPEATS + 1):
    moved = points + 0.02 * t * np.sin([k, 1.3 * k, 0.7 * k]) * t
    positions.foreach_set("vector", moved.astype(np.float32).reshape(-1))
    guides.update_tag()
    since = time.perf_counter()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    depsgraph.update()
    made = hair.evaluated_get(depsgraph).data
    times.append(time.perf_counter() - since)
print("RESULT" + json.dumps({"times": times[1:], "strands": len(made.curves), "points": len(made.points),
    "version": bpy.app.version_string}))
sys.stdout.flush(); os._exit(0)
"""


def hair_on_sphere(n_strands: int, seed: int) -> Helices:
    """Strands that leave the upper half of a sphere along its normals and bend down."""
    rng = np.random.default_rng(seed)
    height, turn = rng.uniform(0.1, 1.0, n_strands), rng.uniform(0.0, 2.0 * np.pi, n_strands)
    flat = np.sqrt(1.0 - height**2)
    outward = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=-1)
    side = np.cross([0.0, 0.0, 1.0], outward)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    count = n_strands * N_ELEMENTS
    bend = np.repeat(2.0 + 3.0 * flat, N_ELEMENTS)
    return Helices(
        RADIUS * outward,
        np.stack([outward, side, np.cross(outward, side)], axis=-1),
        np.arange(n_strands + 1, dtype=np.int32) * N_ELEMENTS,
        np.full(count, LENGTH / N_ELEMENTS),
        np.stack([np.full(count, 1.0), bend, np.full(count, 0.5)], axis=-1),
    )


def swayed(guides: Helices, seconds: float, bend: float = 0.0) -> Helices:
    """A motion that varies over the head, and `bend` 1/m towards it."""
    roots = np.repeat(guides.roots, guides.element_counts, axis=0) / RADIUS
    phase = 9.0 * seconds + 1.5 * roots[:, 0]
    swing = [np.sin(0.7 * phase), 2.0 * np.sin(phase) + roots[:, 1], 1.5 * np.cos(1.3 * phase + roots[:, 2])]
    curvatures = guides.curvatures + np.stack(swing, axis=-1) + [0.0, bend, 0.0]
    return Helices(guides.roots, guides.frames, guides.offsets, guides.lengths, curvatures)


def best_of(repeats: int, job: Callable[[], Any]) -> tuple[float, float]:
    """The least wall time and the least processor time (of all threads) of several runs, after one to warm up."""
    times = []
    for _ in range(repeats + 1):
        start = time.perf_counter(), time.process_time()
        job()
        times.append((time.perf_counter() - start[0], time.process_time() - start[1]))
    walls, processors = zip(*times[1:])
    return min(walls), min(processors)


def row(size: str, who: str, seconds: float | None, target: float | None = None, note: str = "") -> Row:
    return {"size": size, "who": who, "seconds": seconds, "target": target, "note": note}


def our_rows(n_strands: int, repeats: int) -> list[Row]:
    guides = hair_on_sphere(min(N_GUIDES, n_strands), 0)
    # not `as_strands` of the helices at once: a block at a time keeps the frames small
    blocks = [evaluate(hair_on_sphere(min(10_000, n_strands - i), 1 + i), N_POINTS)[0].astype(np.float32)
              for i in range(0, n_strands, 10_000)]  # fmt: skip
    strands: StrandSet = from_dense(np.concatenate(blocks))
    size = f"{guides.n_strands} -> {n_strands} x {N_POINTS}"
    bind, _ = best_of(1, lambda: bind_followers(strands, guides))
    followers = bind_followers(strands, guides)
    points, frames = evaluate(swayed(guides, 0.5), followers.n_samples)
    out = np.empty_like(strands.points)
    seconds, cpu = best_of(repeats, lambda: interpolate(followers, points, frames, out))
    copy, _ = best_of(repeats, lambda: np.copyto(out, strands.points))
    own = followers.places.nbytes + followers.root_shares.nbytes + followers.guides.nbytes + followers.weights.nbytes
    note = f"processor {cpu:.3f} s, {seconds / copy:.1f} copies, {own / 1e6:.0f} MB of places and weights"
    rows = [row(size, "hairloom", seconds, TARGET.get(n_strands), note), row(f"{size}: bind", "hairloom", bind)]
    solid = SimpleNamespace(collider=build_collider([sphere_head(RADIUS, (0.0, 0.0, 0.0))]), matrix=np.eye(4))
    depths = rest_depths(followers, [solid])
    interpolate(followers, *evaluate(swayed(guides, 0.5, INWARDS), followers.n_samples), out)
    before = out.copy()
    keep_out(followers, out, [solid], depths)
    moved = float((out != before).any(axis=1).mean())

    def again() -> None:
        np.copyto(out, before)
        keep_out(followers, out, [solid], depths)

    kept, cpu = best_of(repeats, again)
    rows.append(row(f"{size}: out of the head", "hairloom", kept, note=f"processor {cpu:.3f} s, {moved:.1%} moved"))
    return rows


def peer_row(n_strands: int, repeats: int) -> Row:
    size = f"{N_GUIDES} -> {n_strands} x {N_POINTS}"
    if importlib.util.find_spec("bpy") is None:
        return row(size, "Blender's node", None, note="skipped: no bpy here")
    constants = f"N_STRANDS, N_GUIDES, N_POINTS, REPEATS = {n_strands}, {N_GUIDES}, {N_POINTS}, {repeats}\n"
    program = f"{constants}RADIUS, LENGTH = {RADIUS}, {LENGTH}\n{PEER}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    if "RESULT" not in done.stdout:
        raise RuntimeError(done.stdout + done.stderr)
    found = json.loads(done.stdout.split("RESULT")[1].splitlines()[0])
    note = f"Interpolate Hair Curves of {found['version']}: {found['strands']} strands, {found['points']} points"
    return row(size, "Blender's node", min(found["times"]), note=note)


def run(*, quick: bool = False) -> list[Row]:
    """Rows for `hairloom bench interpolation`."""
    rows = []
    for n_strands in (1000, 10_000) if quick else (1000, 10_000, 100_000):
        rows += our_rows(n_strands, 7)
        if n_strands >= 10_000:
            rows.append(peer_row(n_strands, 2 if quick else 4))
    return rows
