"""Wisp clustering beside k-means: one Lloyd iteration, whole clusterings, adaptive hierarchies, growth, memory.

The hair is synthetic (`benchmark_hair`), because the rows up to 100,000 strands need one kind of hair in all sizes, and
sintel's 11,400 strands where the data is at hand. All peers run in this process, on the same rows of 192 numbers.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from hairloom.geometry.analytic_heads import sphere_head
from hairloom.geometry.head import find_scalp, read_head
from hairloom.geometry.scalp_space import fit_scalp_space, root_strands
from hairloom.io.strands import read_strands
from hairloom.synthesis import wisps as clustering
from hairloom.synthesis.hierarchy import HierarchyParams, build_hierarchy
from hairloom.synthesis.wisps import WispParams, cluster_wisps
from hairloom.types import RootedStrands
from scipy.cluster.vq import kmeans2
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

DATA = Path(os.environ.get("HAIRLOOM_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
Row = dict[str, Any]
SIZES = ((10_000, 200), (40_000, 220), (40_000, 1000), (100_000, 400), (100_000, 2000))
ITERATION_TARGETS = {(40_000, 220): 0.05, (100_000, 400): 0.2, (100_000, 2000): 0.2}
PEER_ITERATIONS = 20


def benchmark_hair(n_strands: int, n_points: int = 64, seed: int = 0) -> RootedStrands:
    """Curly and wavy wisps on a hemisphere: n_strands / 60 true wisps, each with a curl of its own, and noisy members.

    Length, lean and number of turns also vary smoothly over the head. Head radii; strands come in random order.
    """
    rng = np.random.default_rng(seed)
    n_wisps = max(1, n_strands // 60)

    def on_cap(count: int) -> np.ndarray:
        height, turn = rng.uniform(0.05, 1.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
        flat = np.sqrt(1.0 - height**2)
        return np.stack([flat * np.cos(turn), height, flat * np.sin(turn)], axis=-1)

    roots, wisp_roots = on_cap(n_strands), on_cap(n_wisps)
    wisp = cKDTree(wisp_roots).query(roots)[1]

    def member(values: np.ndarray, noise: float) -> np.ndarray:
        return (values[wisp] + rng.normal(0.0, noise, n_strands))[:, None]

    smooth = np.sin(wisp_roots @ rng.normal(0.0, 2.0, (3, 5)) + rng.uniform(0.0, 6.28, 5))
    length = member(1.0 + 0.4 * smooth[:, 0] + rng.normal(0.0, 0.08, n_wisps), 0.024)
    lean_x = length * member(0.6 * smooth[:, 1] + rng.normal(0.0, 0.15, n_wisps), 0.018)
    lean_z = length * member(0.6 * smooth[:, 2] + rng.normal(0.0, 0.15, n_wisps), 0.018)
    droop = member(0.5 + 0.3 * smooth[:, 3] + rng.normal(0.0, 0.1, n_wisps), 0.018)
    turns = member(2.0 + 1.5 * smooth[:, 4] + rng.normal(0.0, 0.3, n_wisps), 0.036)
    phase = member(rng.uniform(0.0, 2.0 * np.pi, n_wisps), 0.15)
    radius = member(0.03 + 0.05 * rng.random(n_wisps), 0.0036)
    t = np.linspace(0.0, 1.0, n_points)
    curl = radius * np.minimum(1.0, 3.0 * t)
    points = np.empty((n_strands, n_points, 3), np.float32)
    points[..., 0] = lean_x * t**1.5 + curl * np.cos(2.0 * np.pi * turns * t + phase)
    points[..., 1] = length * (t - droop * t**2)
    points[..., 2] = lean_z * t**1.5 + curl * np.sin(2.0 * np.pi * turns * t + phase)
    points -= points[:, :1]
    axis = np.cross([0.0, 1.0, 0.0], roots)
    axis *= (np.arccos(roots[:, 1]) / np.maximum(np.linalg.norm(axis, axis=1), 1e-12))[:, None]
    frames = Rotation.from_rotvec(axis).as_matrix()
    uv = np.arctan2(roots[:, 1:2] + 1.0, roots[:, [0, 2]])
    return RootedStrands(*(np.ascontiguousarray(array, np.float32) for array in (roots, frames, uv, points)))


def best_of(repeats: int, job: Callable[[], Any]) -> tuple[float, float, Any]:
    """The least wall time and the least processor time (of all threads) of several runs, and the last result."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter(), time.process_time()
        result = job()
        times.append((time.perf_counter() - start[0], time.process_time() - start[1]))
    walls, processors = zip(*times)
    return min(walls), min(processors), result


def row(size: str, who: str, seconds: float, target: float | None = None, note: str = "") -> Row:
    return {"size": size, "who": who, "seconds": seconds, "target": target, "note": note}


def iteration_row(hair: RootedStrands, k: int, repeats: int) -> Row:
    """One Lloyd iteration from the state after five iterations from k random seeds, all wisps active."""
    arranged = clustering._arrange(hair)
    curve = clustering._Curve()
    start = WispParams(n_wisps=k, seeds_per_wisp=1, max_iterations=5)
    partition = clustering._cluster_fixed(arranged, start, curve, clustering.NO_PROGRESS)
    everywhere = np.ones(k, np.bool_)
    seconds, cpu, _ = best_of(repeats, lambda: clustering._iteration(arranged, partition, everywhere))
    size = f"{hair.n_strands} x {hair.n_points}, K {k}: one iteration"
    return row(size, "hairloom", seconds, ITERATION_TARGETS.get((hair.n_strands, k)), f"processor {cpu:.3f} s")


def peers(points: np.ndarray, k: int, *, slow: bool) -> dict[str, Callable[[], float]]:
    """k-means by others, each returning its energy (sum of squared distances); `slow` adds those that take minutes."""
    found: dict[str, Callable[[], float]] = {}
    if importlib.util.find_spec("faiss"):
        import faiss

        def by_faiss() -> float:
            kmeans = faiss.Kmeans(points.shape[1], k, niter=PEER_ITERATIONS, max_points_per_centroid=1 << 30, seed=1)
            kmeans.train(points)
            return float(kmeans.index.search(points, 1)[0].sum())

        found[f"faiss k-means, {PEER_ITERATIONS} iterations"] = by_faiss
    if importlib.util.find_spec("sklearn"):
        from sklearn.cluster import KMeans, MiniBatchKMeans

        found["sklearn MiniBatchKMeans"] = lambda: float(
            -MiniBatchKMeans(k, n_init=1, random_state=0, batch_size=4096).fit(points).score(points)
        )
        if slow:
            found[f"sklearn KMeans, {PEER_ITERATIONS} iterations"] = lambda: float(
                KMeans(k, n_init=1, random_state=0, max_iter=PEER_ITERATIONS).fit(points).inertia_
            )
    if slow and len(points) <= 10_000:

        def by_scipy() -> float:
            centers, labels = kmeans2(points, k, iter=PEER_ITERATIONS, minit="++", seed=0)
            return float(((points - centers[labels]) ** 2).sum())

        found[f"scipy kmeans2, {PEER_ITERATIONS} iterations"] = by_scipy
    return found


def fixed_rows(hair: RootedStrands, name: str, k: int, *, repeats: int, slow: bool) -> list[Row]:
    """k connected wisps from scratch (neighbourhood included), beside k-means without that constraint."""
    points = hair.points.reshape(hair.n_strands, -1)
    size = f"{name}, K {k}: whole clustering"
    seconds, cpu, wisps = best_of(repeats, lambda: cluster_wisps(hair, WispParams(n_wisps=k, adaptive=False)))
    rows = [row(size, "hairloom", seconds, note=f"processor {cpu:.2f} s, energy {wisps.energies[-1]:.0f}")]
    for who, job in peers(points, k, slow=slow).items():
        their_seconds, their_cpu, energy = best_of(1, job)
        ratio = wisps.energies[-1] / energy
        note = f"processor {their_cpu:.2f} s ({their_cpu / cpu:.1f} x ours), energy {energy:.0f} (ours {ratio:.2f} x)"
        rows.append(row(size, who, their_seconds, note=note))
    return rows


def adaptive_row(count: int, repeats: int) -> Row:
    """Adaptive clustering with all three levels."""
    space = fit_scalp_space(sphere_head())
    hair = benchmark_hair(count)
    params = HierarchyParams(wisps=WispParams(n_wisps=min(200, count // 5)))
    seconds, cpu, (hierarchy, wisp_sets) = best_of(repeats, lambda: build_hierarchy(hair, space, params))
    levels = [level.n_strands for level in hierarchy.levels]
    per = 1e9 * cpu / (count * np.log2(count))
    error = wisp_sets[0].errors.max()
    note = f"processor {cpu:.2f} s = {per:.0f} ns / (S log2 S), levels {levels}, largest error {error:.4f}"
    return row(f"{count} x 64: adaptive, 3 levels", "hairloom", seconds, 2.0 if count == 100_000 else None, note)


_MEMORY_SCRIPT = """
import sys
import numpy as np
from hairloom.synthesis.wisps import WispParams, cluster_wisps
from hairloom.types import RootedStrands
arrays = [np.load(f"{sys.argv[1]}/{i}.npy") for i in range(4)]
few = RootedStrands(*(array[:2000].copy() for array in arrays))
cluster_wisps(few, WispParams(error_threshold=0.02))
strands = RootedStrands(*arrays)

def megabytes(name):
    with open("/proc/self/status") as lines:
        return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(name))

with open("/proc/self/clear_refs", "w") as peak:
    peak.write("5")  # the peak counts from here
before = megabytes("VmRSS")
cluster_wisps(strands)
print(megabytes("VmHWM") - before)
"""


def memory_row(count: int) -> Row:
    """Peak memory above that of the strands, in a process of its own. Linux only."""
    hair = benchmark_hair(count)
    with tempfile.TemporaryDirectory() as folder:
        for i, array in enumerate((hair.roots, hair.frames, hair.uv, hair.points)):
            np.save(f"{folder}/{i}.npy", array)
        command = [sys.executable, "-c", _MEMORY_SCRIPT, folder]
        extra = float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    share = extra / (hair.points.nbytes / 2**20)
    note = f"extra memory {extra:.0f} MB = {share:.2f} x the strands (target 1)"
    return row(f"{count} x 64: adaptive, memory", "hairloom", float("nan"), note=note)


def sintel_hair() -> RootedStrands:
    strands = read_strands(DATA / "sintel" / "hair.tfx")
    space = fit_scalp_space(find_scalp(read_head(DATA / "sintel" / "head.obj"), strands.roots))
    return root_strands(strands, space, 64)


def run(*, quick: bool = False) -> list[Row]:
    """Rows for `hairloom bench wisps`."""
    sizes = SIZES[:1] if quick else SIZES
    repeats = 2 if quick else 5
    cluster_wisps(benchmark_hair(2000), WispParams(error_threshold=0.02))  # compiles
    hairs = {count: benchmark_hair(count) for count, _ in sizes}
    rows = [iteration_row(hairs[count], k, 2 * repeats) for count, k in sizes]
    growth = (1000, 10_000) if quick else (1000, 3000, 10_000, 30_000, 100_000)
    rows += [adaptive_row(count, repeats) for count in growth]
    for count, k in sizes:
        rows += fixed_rows(hairs[count], f"{count} x 64", k, repeats=repeats, slow=count * k <= 10_000_000)
    if (DATA / "sintel" / "hair.tfx").exists():
        hair = sintel_hair()
        for k in (200,) if quick else (200, 1000):
            rows += fixed_rows(hair, f"sintel {hair.n_strands} x 64", k, repeats=repeats, slow=False)
    if sys.platform == "linux":
        rows.append(memory_row(10_000 if quick else 100_000))
    return rows


if __name__ == "__main__":
    for line in run(quick="--quick" in sys.argv):
        print(f"{line['size']:44} {line['who']:32} {line['seconds']:9.4f} s  target {line['target']}  {line['note']}")
