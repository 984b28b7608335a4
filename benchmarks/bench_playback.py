"""Playback and baking of 50,000 strands x 32 points in Blender: milliseconds a frame and peak memory.

python benchmarks/bench_playback.py        with the pip module bpy; stages the working tree as tests/blender does
"""

from __future__ import annotations

import importlib
import os
import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
N_STRANDS, N_POINTS, N_FRAMES, N_RUNS = 50_000, 32, 24, 5
MODULE = "bl_ext.user_default.hairloom"


def fastest(run: Callable[[], None]) -> float:
    """Seconds of the fastest of some runs."""
    times = []
    for _ in range(N_RUNS):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def main(folder: Path) -> None:
    sys.path.insert(0, str(ROOT))
    import build_addon

    resources = folder / "blender"
    build_addon.stage(resources / "extensions" / "user_default" / "hairloom")
    os.environ["BLENDER_USER_RESOURCES"] = str(resources)
    import bpy
    import numpy as np

    bpy.ops.preferences.addon_enable(module=MODULE)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    playback, cache = (importlib.import_module(f"{MODULE}.{name}") for name in ("playback", "backend.io.sim_cache"))
    curves = bpy.data.hair_curves.new("Hair")
    curves.add_curves([N_POINTS] * N_STRANDS)
    obj = bpy.data.objects.new("Hair", curves)
    bpy.context.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    rng = np.random.default_rng(0)
    rest = rng.normal(size=(N_STRANDS * N_POINTS, 3)).astype(np.float32)
    curves.position_data.foreach_set("vector", rest.ravel())
    curves.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", np.full(len(rest), 1e-4, np.float32))
    writer = cache.CacheWriter.create(folder / "cache", len(rest), fps=24)
    start = time.perf_counter()
    for frame in range(N_FRAMES):
        writer.append(rest + np.float32(0.01 * frame))
    print(f"append          {(time.perf_counter() - start) / N_FRAMES * 1e3:6.1f} ms a frame")
    playback.attach(obj, folder / "cache")
    scene = bpy.context.scene

    def play(step: float = 0.0) -> None:
        for frame in range(1, N_FRAMES):
            scene.frame_set(frame, subframe=step)
            obj.evaluated_get(bpy.context.evaluated_depsgraph_get())

    whole, between = fastest(play) / (N_FRAMES - 1), fastest(lambda: play(0.5)) / (N_FRAMES - 1)
    print(f"frame_set       {whole * 1e3:6.1f} ms a frame = {1 / whole:.0f} frames/s, evaluated Curves included")
    print(f"  between two   {between * 1e3:6.1f} ms a frame = {1 / between:.0f} frames/s")
    player = playback.players._ready_player(curves)
    print(f"  handler alone {fastest(lambda: playback.players.play(curves, 7.0)) * 1e3:6.1f} ms, edits looked for")
    print(f"  show alone    {fastest(lambda: player.show(curves, 7.0)) * 1e3:6.1f} ms")
    print(f"panel's status  {fastest(lambda: playback.status(obj)) * 1e3:6.2f} ms")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.perf_counter()
    bpy.ops.hairloom.bake_alembic(filepath=str(folder / "hair.abc"), space="OBJECT")
    seconds = time.perf_counter() - start
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    size = (folder / "hair.abc").stat().st_size / 2**20
    print(f"bake to Alembic {seconds / N_FRAMES * 1e3:6.1f} ms a frame, {size:.0f} MiB, peak memory + {grown:.0f} MiB")
    sys.stdout.flush()


if __name__ == "__main__":
    scratch = Path(tempfile.mkdtemp())
    try:
        main(scratch)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        sys.stdout.flush()
        os._exit(0)  # the bpy module sometimes hangs when the interpreter ends in the normal way
