"""Hair for the tests of wisps, and what the paper says about wisps, checked slowly."""

from __future__ import annotations

import numpy as np
from hairloom.geometry.root_graph import connect_roots
from hairloom.synthesis.wisps import WispSet
from hairloom.types import RootedStrands
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components


def rooted(uv: np.ndarray, points: np.ndarray) -> RootedStrands:
    """Strands (S, N, 3) in root frames on the unit sphere's upper half, with roots at `uv` (paper, eq. 2)."""
    a, b = 1.0 / np.tan(uv[:, 0]), 1.0 / np.tan(uv[:, 1])
    up = 2.0 / (1.0 + a**2 + b**2)
    roots = np.stack([a * up, up - 1.0, b * up], axis=-1)
    frames = np.tile(np.eye(3), (len(uv), 1, 1))
    return RootedStrands(*(np.ascontiguousarray(x, dtype=np.float32) for x in (roots, frames, uv, points)))


def noisy_hair(count: int, n_points: int = 6, seed: int = 0) -> RootedStrands:
    """Strands whose shape varies smoothly over the scalp, with noise: no two distances are equal."""
    rng = np.random.default_rng(seed)
    uv = rng.uniform(0.9, 2.2, (count, 2))
    t = np.linspace(0.0, 1.0, n_points)[:, None]
    lean = np.stack([np.sin(3 * uv[:, 0]), np.ones(count), np.cos(4 * uv[:, 1])], axis=-1)
    points = t * (lean + rng.normal(0.0, 0.15, (count, 3)))[:, None, :]
    return rooted(uv, points)


def separate_wisps(side: int = 4, per_wisp: int = 25, seed: int = 0) -> tuple[RootedStrands, np.ndarray]:
    """side^2 wisps, each in a square of its own of the scalp and 1.0 apart in shape; and the true labels."""
    rng = np.random.default_rng(seed)
    truth = np.repeat(np.arange(side * side), per_wisp)
    column, row = truth % side, truth // side
    uv = 0.9 + 0.3 * (np.stack([column, row], axis=-1) + 0.02 + 0.96 * rng.random((len(truth), 2)))
    t = np.linspace(0.0, 1.0, 8)[:, None]
    direction = np.stack([column, np.ones_like(row), row], axis=-1).astype(float)
    points = t * direction[:, None, :] + rng.normal(0.0, 0.01, (len(truth), 1, 3)) * t
    return rooted(uv, points), truth


def same_partition(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two labellings differ by the numbering only."""
    pairs = np.unique(np.stack([a, b]), axis=1)
    return pairs.shape[1] == len(np.unique(a)) == len(np.unique(b))


def largest_error(strands: RootedStrands, wisps: WispSet) -> float:
    """The largest L2 of a strand to its center, in float64 from the definition (W-8)."""
    difference = strands.points.astype(np.float64) - wisps.centers[wisps.labels].astype(np.float64)
    return float((difference**2).sum(axis=(1, 2)).max())


def check_wisps(strands: RootedStrands, wisps: WispSet) -> None:
    """Complete, disjoint, connected; centers are means, seeds the nearest; errors and energies are what they say."""
    count, k = strands.n_strands, wisps.n_wisps
    assert wisps.labels.dtype == np.int32 and wisps.labels.shape == (count,)
    np.testing.assert_array_equal(np.unique(wisps.labels), np.arange(k))
    graph = connect_roots(strands.uv)
    rows = np.repeat(np.arange(count), np.diff(graph.offsets))
    inside = wisps.labels[rows] == wisps.labels[graph.neighbours]
    matrix = coo_matrix((np.ones(inside.sum()), (rows[inside], graph.neighbours[inside])), shape=(count, count))
    assert connected_components(matrix, directed=False)[0] == k
    points = strands.points.astype(np.float64)
    means = np.zeros((k, *points.shape[1:]))
    np.add.at(means, wisps.labels, points)
    means /= np.bincount(wisps.labels)[:, None, None]
    scale = max(1.0, np.abs(points).max())
    # one float32 rounding of a float64 mean
    np.testing.assert_allclose(wisps.centers, means, rtol=0, atol=1e-6 * scale)
    errors = ((points - wisps.centers[wisps.labels].astype(np.float64)) ** 2).sum(axis=(1, 2))
    # float32 sums of squares of float32 differences
    np.testing.assert_allclose(wisps.errors, errors, rtol=1e-5, atol=1e-10 * scale**2)
    np.testing.assert_array_equal(wisps.labels[wisps.seeds], np.arange(k))
    least = np.full(k, np.inf, np.float32)
    np.minimum.at(least, wisps.labels, wisps.errors)
    np.testing.assert_array_equal(wisps.errors[wisps.seeds], least)
    assert max(wisps.energies) == wisps.energies[0]
    np.testing.assert_allclose(wisps.energies[-1], errors.sum(), rtol=1e-5, atol=1e-9)
    assert all(0 < iteration < len(wisps.energies) for iteration, _ in wisps.splits)
    if wisps.splits:
        assert wisps.splits[-1][1] == k
