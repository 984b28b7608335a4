"""Direction fields: building the grid, tracing beside SciPy, and the refinement of a whole hairstyle by stages.

The tracing job is that of the peers: 100,000 strands, 100 steps, a dense 200 x 100 x 100 field. The hair of the other
rows is sintel's where the data is at hand, its strands copied with jittered roots and lengths; else synthetic.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from hairloom.fields.grid import DirectionGrid, build_direction_grid, dense_grid, tangent_spread
from hairloom.fields.tracing import follow, trace, trace_steps
from hairloom.geometry.analytic_heads import sphere_head
from hairloom.geometry.head import find_scalp, read_head
from hairloom.geometry.scalp_space import ScalpSpace, fit_scalp_space, root_strands
from hairloom.io.strands import read_strands
from hairloom.synthesis.refinement import RefineParams, refine
from hairloom.types import RootedStrands
from scipy.ndimage import map_coordinates

DATA = Path(os.environ.get("HAIRLOOM_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
Row = dict[str, Any]


def best(work: Callable[[], object], repeats: int) -> float:
    """Seconds of the fastest run; the first, which compiles, does not count."""
    work()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def row(size: str, who: str, seconds: float, target: float | None = None, note: str = "") -> Row:
    return {"size": size, "who": who, "seconds": seconds, "target": target, "note": note}


def swirl() -> DirectionGrid:
    """A dense 200 x 100 x 100 field that swirls about the z axis and waves along it; cells of 1."""
    x, y, _ = np.meshgrid(*[np.arange(n, dtype=np.float32) for n in (200, 100, 100)], indexing="ij")
    field = np.stack([53 - y, 0.5 * x - 49, 20 * np.sin(x / 20) + 5], axis=-1)
    return dense_grid(field / np.linalg.norm(field, axis=-1, keepdims=True), (0, 0, 0), 1.0)


def scipy_euler(field: np.ndarray, roots: np.ndarray, n_steps: int, step: float) -> np.ndarray:
    """(S, K, 3) the same job with scipy.ndimage.map_coordinates."""
    lines = np.empty((len(roots), n_steps + 1, 3), np.float32)
    lines[:, 0] = at = roots
    channels = [np.ascontiguousarray(field[..., c]) for c in range(3)]
    for i in range(n_steps):
        mean = np.stack([map_coordinates(c, (at - 0.5).T, order=1, mode="constant") for c in channels], axis=1)
        at = at + step * mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-6)
        lines[:, i + 1] = at
    return lines


def tracing_rows(n_strands: int, repeats: int) -> list[Row]:
    grid, n_steps, step = swirl(), 100, 0.2
    roots = np.random.default_rng(0).uniform(0.25, 0.75, (n_strands, 3)) * [200, 100, 100]
    roots = roots.astype(np.float32)
    lengths = np.full(n_strands, n_steps * step)
    size = f"trace {n_strands} x {n_steps} steps, 200 x 100 x 100"
    target = 0.25 if n_strands == 100_000 else None
    ours, _ = trace_steps(grid, roots, lengths, step)
    theirs = scipy_euler(grid.dense(), roots, n_steps, step)
    note = f"largest difference to SciPy {np.abs(ours - theirs).max():.1e} cells"
    one = _with_threads(1, lambda: trace_steps(grid, roots, lengths, step)[0].tobytes())
    note += ", bit-identical on 1 thread" if one == ours.tobytes() else ", NOT identical on 1 thread"
    del ours, theirs, one
    return [
        row(size, "hairloom", best(lambda: trace_steps(grid, roots, lengths, step), repeats), target, note),
        row(size, "hairloom, 64 even points", best(lambda: trace(grid, roots, lengths, step), repeats), target),
        row(size, "scipy map_coordinates", best(lambda: scipy_euler(grid.dense(), roots, n_steps, step), 1)),
    ]


def _with_threads(n_threads: int, work: Callable[[], Any]) -> Any:
    before = numba.get_num_threads()
    numba.set_num_threads(n_threads)
    try:
        return work()
    finally:
        numba.set_num_threads(before)


def hair(n_strands: int) -> tuple[RootedStrands, ScalpSpace, str]:
    """`n_strands` strands of 64 points, their scalp space, and where they come from."""
    rng = np.random.default_rng(0)
    if (DATA / "sintel" / "hair.tfx").exists():
        groom = read_strands(DATA / "sintel" / "hair.tfx")
        space = fit_scalp_space(find_scalp(read_head(DATA / "sintel" / "head.obj"), groom.roots))
        rooted, source = root_strands(groom, space, 64), "sintel"
    else:
        space = fit_scalp_space(sphere_head())
        t = np.linspace(0, 1, 64)[:, None]
        uvw = np.concatenate([rng.uniform(0.9, 2.2, (4000, 2)), np.zeros((4000, 1))], axis=1)
        roots, uv = space.from_scalp(uvw), uvw[:, :2].astype(np.float32)
        shapes = (rng.normal(size=(4000, 1, 3)) * 0.2 + [0.4, 0.4, 0.1]) * t + t**2 * [0.5, -0.2, 0.2]
        rooted, source = RootedStrands(roots, space.frames_at(uv), uv, shapes.astype(np.float32)), "synthetic"
    chosen = rng.integers(0, rooted.n_strands, n_strands)
    uvw = space.to_scalp(rooted.roots[chosen] + rng.normal(0, 0.01, (n_strands, 3)).astype(np.float32))
    uvw[:, 2] = 0.0
    uv = np.ascontiguousarray(uvw[:, :2])
    scale = rng.uniform(0.8, 1.2, (n_strands, 1, 1)).astype(np.float32)
    many = RootedStrands(space.from_scalp(uvw), space.frames_at(uv), uv, rooted.points[chosen] * scale)
    return many, space, source


def refinement_rows(n_strands: int, spacing: float, repeats: int) -> list[Row]:
    strands, space, source = hair(n_strands)
    points = strands.in_head_space()
    weights = np.full(n_strands, 0.5)
    grid = build_direction_grid(points, space, spacing)
    size = f"{source} {n_strands} x 64, spacing {spacing}"
    large = n_strands == 100_000 and spacing == 0.005
    _, report = refine(strands, space, RefineParams(spacing=spacing))
    spread = f"spread {report.spread_before:.2f} -> {report.spread_after:.2f} degrees, {report.cells} cells"
    jobs: tuple[tuple[str, Callable[[], object], float | None, str], ...] = (
        ("grid, scalp space", lambda: build_direction_grid(points, space, spacing), 1.0, f"{_megabytes(grid)} MB"),
        ("grid, head space", lambda: build_direction_grid(points, None, spacing), None, ""),
        ("follow", lambda: follow(grid, points, weights, space=space), None, ""),
        ("spread", lambda: tangent_spread(points, spacing), None, ""),
        ("refine", lambda: refine(strands, space, RefineParams(spacing=spacing)), 2.0, spread),
    )
    return [
        row(f"{job}; {size}", "hairloom", best(work, repeats), target if large else None, note)
        for job, work, target, note in jobs
    ]


def _megabytes(grid: DirectionGrid) -> int:
    return round(grid.directions.nbytes / 1e6)


def memory_row(n_strands: int) -> Row:
    """Peak memory of building a grid at spacing 0.005, in a process of its own."""
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); import bench_fields as b, resource, time\n"
        f"s, space, _ = b.hair({n_strands}); p = s.in_head_space(); b.build_direction_grid(p[:9], space, 0.005)\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss; t = time.perf_counter()\n"
        "b.build_direction_grid(p, space, 0.005)\n"
        "print(time.perf_counter() - t, before / 1e3, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3)"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    seconds, before, peak = map(float, out.split())
    note = f"peak {peak:.0f} MB, of which {before:.0f} before"
    return row(f"grid, first in a process; {n_strands} x 64, spacing 0.005", "hairloom", seconds, None, note)


def run(*, quick: bool = False) -> list[Row]:
    """Rows for `hairloom bench fields`."""
    repeats = 2 if quick else 5
    rows = tracing_rows(10_000 if quick else 100_000, repeats)
    for spacing in (0.02,) if quick else (0.02, 0.01, 0.005):
        rows += refinement_rows(10_000 if quick else 100_000, spacing, repeats)
    if sys.platform == "linux":
        rows.append(memory_row(10_000 if quick else 100_000))
    return rows


if __name__ == "__main__":
    for line in run(quick="--quick" in sys.argv):
        print(f"{line['size']:56} {line['who']:26} {line['seconds']:8.4f} s  target {line['target']}  {line['note']}")
