"""Benchmark hair and timings of wisp clustering."""

from __future__ import annotations

import numpy as np

from hairloom.types import RootedStrands


def benchmark_hair(n_strands: int, n_points: int = 64, seed: int = 0) -> RootedStrands:
    """Curly and wavy wisps on a hemisphere: n_strands / 60 true wisps, each with a curl of its own and noisy members."""
    rng = np.random.default_rng(seed)
    n_wisps = max(1, n_strands // 60)

    def on_cap(count: int) -> np.ndarray:
        height = rng.uniform(0.05, 1.0, count)
        turn = rng.uniform(0.0, 2.0 * np.pi, count)
        flat = np.sqrt(1.0 - height**2)
        return np.stack([flat * np.cos(turn), height, flat * np.sin(turn)], axis=-1)

    roots = on_cap(n_strands)
    wisp_roots = on_cap(n_wisps)
    from scipy.spatial import cKDTree

    wisp = cKDTree(wisp_roots).query(roots)[1]
    t = np.linspace(0.0, 1.0, n_points)
    smooth = np.sin(wisp_roots @ rng.normal(0.0, 2.0, (3, 12)) + rng.uniform(0, 6.28, 12))  # varies over the head
    length = 1.0 + 0.4 * smooth[:, 0] + rng.normal(0.0, 0.08, n_wisps)
    lean = 0.6 * smooth[:, 1:3] + rng.normal(0.0, 0.15, (n_wisps, 2))
    droop = 0.5 + 0.3 * smooth[:, 3] + rng.normal(0.0, 0.1, n_wisps)
    radius = 0.03 + 0.05 * rng.random(n_wisps)
    turns = 2.0 + 1.5 * smooth[:, 4] + rng.normal(0.0, 0.3, n_wisps)
    phase = rng.uniform(0.0, 6.28, n_wisps)

    def per(values: np.ndarray, noise: float) -> np.ndarray:
        return (values[wisp] + rng.normal(0.0, noise, n_strands))[:, None]

    a, k, r = per(phase, 0.25), per(turns, 0.06), per(radius, 0.006)
    own_length = per(length, 0.04)
    curl = r * np.minimum(1.0, 3.0 * t)
    points = np.empty((n_strands, n_points, 3), np.float32)
    points[..., 0] = own_length * per(lean[:, 0], 0.03) * t**1.5 + curl * np.cos(6.28 * k * t + a)
    points[..., 1] = own_length * (t - per(droop, 0.03) * t**2)
    points[..., 2] = own_length * per(lean[:, 1], 0.03) * t**1.5 + curl * np.sin(6.28 * k * t + a)
    points -= points[:, :1]
    normal = roots
    axis = np.cross([0.0, 1.0, 0.0], normal)
    angle = np.arccos(np.clip(normal[:, 1], -1.0, 1.0))
    from scipy.spatial.transform import Rotation

    size = np.linalg.norm(axis, axis=1, keepdims=True)
    turn = Rotation.from_rotvec(axis / np.maximum(size, 1e-12) * angle[:, None]).as_matrix()
    uv = np.stack([np.arctan2(roots[:, 1] + 1.0, roots[:, 0]), np.arctan2(roots[:, 1] + 1.0, roots[:, 2])], axis=-1)
    f32 = np.float32
    return RootedStrands(roots.astype(f32), turn.astype(f32), uv.astype(f32), points)
