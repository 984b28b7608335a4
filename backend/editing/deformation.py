"""Gradient-domain deformation of strands (Xu et al. 2007, sec. 3.1, in the per-strand form of M-7; W-U5).

Each strand keeps its edges up to a rotation of each, R_i, while handles pull at its points. Two solves alternate: the
points for given rotations, sum |(p_i+1 - p_i) - R_i e_i|^2 + sum w_h |p_h - target_h|^2, and the rotations for given
points, the smallest turns that take the edges to where they are now, smooth along the strand and agreeing with those of
the neighbours. Both are tridiagonal per strand: the elimination costs no more than the back-substitution, so nothing is
kept between steps and handles may change freely. Rotations are quaternions that turn on from step to step: after a full
turn they have gone all the way round and a curl is wound up, not collapsed.

The first point and the first edge are fixed, unless they are handles. At the end each strand gets its lengths back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ..errors import require
from ..geometry.collider import Collider
from ..geometry.root_graph import RootGraph
from ..types import Float32, Float64, Floats, Int32
from ._deformation_kernels import relax, settle


@dataclass(frozen=True, slots=True)
class DeformParams:
    """Settings of `deform`. Defaults live here only."""

    iterations: int = 4  # alternations of a step; the paper's 3 to 5
    bend_length: float = 0.08  # share of the strand over which a bend is spread
    drag: float = 0.3  # 0 .. 1, how much strands without handles turn along with their neighbours
    margin: float = 0.001  # metres kept from the collider by hair that was as far off; its grid errs at folds

    def __post_init__(self) -> None:
        require(1 <= self.iterations <= 1000, f"iterations is {self.iterations}; it must be in 1..1000")
        require(0 < self.bend_length <= 1, f"bend_length is {self.bend_length}; it must be in 0..1, above 0")
        require(0 <= self.drag <= 1, f"drag is {self.drag}; it must be in 0..1")


@dataclass(frozen=True, slots=True)
class Deformed:
    """points : (K, N, 3) float64. turns : (K, N - 1, 4) float64 unit quaternions (w, x, y, z) of the edges."""

    points: Float64
    turns: Float64


def deform(
    strands: Floats,
    weights: Floats,
    targets: Floats,
    graph: RootGraph | None = None,
    params: DeformParams = DeformParams(),
    *,
    rest: Floats | None = None,
    active: Int32 | None = None,
    collider: Collider | None = None,
) -> Deformed:
    """Deform strands by handles (M-7).

    Parameters
    ----------
    strands : (K, N, 3), N >= 3, any unit, root first. weights : (K, N), 0 where there is no handle; 100 is firm.
    targets : (K, N, 3), where handles shall go.
    graph : the neighbourhood of all strands (Delaunay of the roots); None couples nothing.
    rest : (K, N, 3) strands that the lengths are taken from; None is `strands`.
    active : (K,) int32, which nodes of the graph the strands are; None is all of them in order.
    collider : what the strands must stay out of (metres, world space).

    Raises
    ------
    InputError : shapes that do not fit.
    """
    points = np.array(strands, np.float64)
    require(points.ndim == 3 and points.shape[1] >= 3, f"strands must have shape (K, N, 3), N >= 3, not {points.shape}")
    require(weights.shape == points.shape[:2], f"weights must have shape {points.shape[:2]}, not {weights.shape}")
    require(targets.shape == points.shape, f"targets must have shape {points.shape}, not {targets.shape}")
    count, n_points = points.shape[:2]
    firm, wanted = np.ascontiguousarray(weights, np.float64), np.ascontiguousarray(targets, np.float64)
    original = points.copy() if rest is None else np.ascontiguousarray(rest, np.float64)
    edges = np.diff(points, axis=1)
    turns = np.zeros((count, n_points - 1, 4))
    turns[:, :, 0] = 1.0
    moved = firm[:, :2] > 0
    if moved.any():
        turns[:] = _common_turn(points, firm, wanted)
        points[:, :2][moved] = wanted[:, :2][moved]
    nodes = np.arange(count, dtype=np.int32) if active is None else active
    offsets, neighbours, slots = _graph_rows(graph, nodes, count)
    is_coupled = graph is not None and params.drag > 0
    coupling = params.drag if is_coupled else 0.0
    hold = (1.0 - params.drag) / params.drag if is_coupled else 0.0
    stiffness = (params.bend_length * n_points) ** 2
    pulls = np.where(firm > 0, np.arange(n_points), 0).max(axis=1).astype(np.int32)
    solid = collider_arrays(collider)
    other = np.empty_like(turns)
    for _ in range(params.iterations):
        relax(
            points, original, edges, wanted, firm, pulls, turns, other, nodes, slots, offsets, neighbours,
            stiffness, coupling, hold, *solid, params.margin,
        )  # fmt: skip
        turns, other = other, turns
    settle(points, original, edges, turns, *solid, params.margin)
    return Deformed(points, turns)


def collider_arrays(collider: Collider | None) -> tuple[Float32, Float64, float]:
    """What kernels need of a collider; an empty grid for none."""
    if collider is None:
        return np.zeros((0, 0, 0), np.float32), np.zeros(3), 1.0
    return collider.distance, collider.origin, float(collider.cell)


def _graph_rows(graph: RootGraph | None, nodes: Int32, count: int) -> tuple[Int32, Int32, Int32]:
    if graph is None:
        empty = np.zeros(int(nodes.max(initial=-1)) + 2, np.int32)
        return empty, np.zeros(0, np.int32), np.full(len(empty), -1, np.int32)
    slots = np.full(len(graph.offsets) - 1, -1, np.int32)
    slots[nodes] = np.arange(count, dtype=np.int32)
    return graph.offsets, graph.neighbours, slots


def _common_turn(points: Float64, weights: Float64, targets: Float64) -> Float64:
    """(4,) the rotation of the rigid motion that fits all handles best: where roots are moved too, the start."""
    chosen = weights > 0
    before, after = points[chosen], targets[chosen]
    share = (weights[chosen] / weights[chosen].sum())[:, None]
    before, after = before - (share * before).sum(axis=0), after - (share * after).sum(axis=0)
    u, _, vt = np.linalg.svd((share * after).T @ before)
    matrix = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return np.asarray(Rotation.from_matrix(matrix).as_quat(canonical=True, scalar_first=True))
