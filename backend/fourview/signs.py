"""The sign of directions whose orientation is known: a quadratic binary programme (M-38; Chai et al. 2013).

Nodes are regions of a surface or short strands, x_i says which of its two directions node i takes, s_i = 2 x_i - 1.
Minimised is

    E = - sum over edges J_ij s_i s_j - sum h_i s_i,

J_ij being how well the two orientations go on in each other (negative when as stored they are opposite), h_i how well
node i agrees with where its hair is thought to grow. Nodes under strokes are fixed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow, minimum_spanning_tree

from ..errors import require
from ..types import Float64, Floats, check_array
from ._sign_kernels import signs_of_tree, turn_branches, turn_nodes

Int8 = NDArray[np.int8]
Indices = NDArray[np.integer[Any]]

_SWEEPS = 100
_ROUNDS = 20


@dataclass(frozen=True, slots=True)
class SignParams:
    """Settings of solve_signs."""

    flow_nodes: int = 4000  # up to so many nodes the maximum flow is asked, which decides most of them for good
    exact_nodes: int = 150  # up to so many undecided nodes the exact solver is asked for the rest
    node_limit: int = 200  # branches after which it gives up, and the signs of the search stay

    def __post_init__(self) -> None:
        require(0 <= self.flow_nodes <= 100_000, f"flow_nodes is {self.flow_nodes}; it must be in 0..100000")
        require(0 <= self.exact_nodes <= 2000, f"exact_nodes is {self.exact_nodes}; it must be in 0..2000")
        require(1 <= self.node_limit <= 1_000_000, f"node_limit is {self.node_limit}; it must be in 1..1000000")


@dataclass(frozen=True, slots=True)
class Signs:
    """signs : (N,) int8, -1 or 1. energy : E of these. is_exact : no signs have a lower one (to 1e-6 of its size)."""

    signs: Int8
    energy: float
    is_exact: bool


def solve_signs(
    edges: Indices, couplings: Floats, fields: Floats, fixed: Int8 | None = None, params: SignParams = SignParams()
) -> Signs:
    """The signs of N nodes with the least energy (M-38).

    A spanning tree of the strongest ties, improved by turning single nodes and branches. With not too many nodes then a
    maximum flow (roof duality) tells most signs of the best solution for sure, and a mixed-integer programme (HiGHS)
    the others.

    Parameters
    ----------
    edges : (E, 2) int. couplings : (E,) float, J. fields : (N,) float, h.
    fixed : (N,) int8, -1 or 1 where the sign is given, else 0.

    Raises
    ------
    InputError : shapes that do not fit.
    """
    count = len(fields)
    given = np.zeros(count, np.int8) if fixed is None else fixed
    check_array("fixed", given, np.int8, (count,))
    require(edges.ndim == 2 and edges.shape[1] == 2 and len(edges) == len(couplings), "one coupling for each edge")
    require(len(edges) == 0 or (edges.min() >= 0 and edges.max() < count), "an edge names a node that does not exist")
    strengths, pulls = np.asarray(couplings, np.float64), np.asarray(fields, np.float64)
    signs = _search(edges, strengths, pulls, given)
    is_exact = False
    if 0 < count <= params.flow_nodes:
        rest = _reduced(edges, strengths, pulls, given)
        known = given.copy()
        known[rest.nodes] = _persistent(*rest.problem)
        rest = _reduced(edges, strengths, pulls, known)
        better = np.where(known != 0, known, signs).astype(np.int8)
        if len(rest.nodes) == 0:
            is_exact = True
        elif len(rest.nodes) <= params.exact_nodes:
            better[rest.nodes], is_exact = _exact(*rest.problem, signs[rest.nodes], params.node_limit)
        if energy_of(better, edges, strengths, pulls) < energy_of(signs, edges, strengths, pulls):
            signs = better
    return Signs(signs, energy_of(signs, edges, strengths, pulls), is_exact)


def energy_of(signs: Int8, edges: Indices, couplings: Floats, fields: Floats) -> float:
    """E of signs (N,)."""
    s = signs.astype(np.float64)
    return float(-(couplings * s[edges[:, 0]] * s[edges[:, 1]]).sum() - (fields * s).sum())


@dataclass(frozen=True, slots=True)
class _Rest:
    """The programme over the nodes that are not known: those (n,), and its edges, couplings and fields."""

    nodes: NDArray[np.int64]
    problem: tuple[Indices, Float64, Float64]


def _reduced(edges: Indices, couplings: Float64, fields: Float64, known: Int8) -> _Rest:
    """Known nodes turn into fields of their neighbours."""
    pulls = fields.copy()
    for a, b in ((0, 1), (1, 0)):
        np.add.at(pulls, edges[:, a], couplings * known[edges[:, b]])
    nodes = np.flatnonzero(known == 0)
    place = np.full(len(known), -1)
    place[nodes] = np.arange(len(nodes))
    inner = (place[edges] >= 0).all(axis=1)
    return _Rest(nodes, (place[edges[inner]], couplings[inner], pulls[nodes]))


def _persistent(edges: Indices, couplings: Float64, fields: Float64) -> Int8:
    """(n,) the signs that a best solution has for sure, 0 where roof duality cannot tell.

    Every node has a copy of the opposite sign. A positive coupling ties nodes and ties copies, a negative one ties
    nodes to copies, fields tie them to source and sink; a node on the source's side of the least cut whose copy is on
    the other has sign 1, and the other way round.
    """
    count = len(fields)
    total = float(np.abs(couplings).sum() * 4.0 + np.abs(fields).sum() * 2.0)
    if count == 0 or total == 0.0:
        return np.zeros(count, np.int8)
    scale = 2.0**30 / total  # capacities are whole numbers whose sum must fit 31 bits
    source, sink = 2 * count, 2 * count + 1
    i, j = edges[:, 0], edges[:, 1]
    other = np.where(couplings > 0, 0, count)
    up, down = np.flatnonzero(fields > 0), np.flatnonzero(fields < 0)
    tails = np.concatenate([i, j + other, i + count, j + count - other, np.full(len(up) + len(down), source)])
    heads = np.concatenate([j + other, i, j + count - other, i + count, up, down + count])
    tails = np.concatenate([tails, up + count, down])
    heads = np.concatenate([heads, np.full(len(up) + len(down), sink)])
    pulls = np.abs(np.concatenate([fields[up], fields[down]]))
    amounts = np.concatenate([np.tile(np.abs(couplings), 4), pulls, pulls])
    whole = np.floor(amounts * scale).astype(np.int32)
    capacity: csr_array = coo_array((whole, (tails, heads)), shape=(2 * count + 2, 2 * count + 2)).tocsr()
    capacity.sum_duplicates()
    flow = maximum_flow(capacity, source, sink).flow
    residual = capacity - flow
    residual.data = np.maximum(residual.data, 0)
    residual.eliminate_zeros()
    reached = np.zeros(2 * count + 2, np.bool_)
    reached[breadth_first_order(residual, source, return_predecessors=False)] = True
    plain, copy = reached[:count], reached[count : 2 * count]
    return (plain & ~copy).astype(np.int8) - (copy & ~plain).astype(np.int8)


def _search(edges: Indices, couplings: Float64, fields: Float64, fixed: Int8) -> Int8:
    """Spanning tree and local search; fields and fixed signs are edges to one more node whose sign is 1."""
    count = len(fields)
    huge = 1.0 + 4.0 * (np.abs(couplings).sum() + np.abs(fields).sum())
    pulls = np.where(fixed != 0, fixed * huge, fields)
    # a tie of no strength at all keeps the tree in one piece
    pulls = np.where(pulls == 0, 1e-12 * huge / max(count, 1), pulls)
    first = np.concatenate([edges[:, 0], np.arange(count)])
    second = np.concatenate([edges[:, 1], np.full(count, count)])
    every = np.concatenate([couplings, pulls])
    graph: csr_array = coo_array(
        (np.tile(every, 2), (np.concatenate([first, second]), np.concatenate([second, first]))),
        shape=(count + 1, count + 1),
    ).tocsr()
    graph.eliminate_zeros()
    strengths = np.abs(graph.data)
    tree = minimum_spanning_tree(csr_array((2.0 * huge - strengths, graph.indices, graph.indptr), graph.shape))
    order, parents = breadth_first_order(tree, count, directed=False)
    parents = np.where(parents < 0, -1, parents).astype(np.int64)
    depths, ties = np.zeros(count + 1, np.int64), np.zeros(count + 1)
    for node in order[1:]:  # parents come before their children
        depths[node] = depths[parents[node]] + 1
    children = np.flatnonzero(parents >= 0)
    ties[children] = np.asarray(graph[children, parents[children]]).ravel()
    signs = np.ones(count + 1, np.int8)
    arrays = (graph.indptr.astype(np.int64), graph.indices.astype(np.int64), graph.data)
    branches = (np.asarray(order, np.int64), parents, depths)
    signs_of_tree(branches[0], parents, ties, signs)
    for _ in range(_ROUNDS):
        changes = turn_nodes(*arrays, count, signs, _SWEEPS) + turn_branches(*arrays, *branches, signs, 50)
        if changes == 0:
            break
    return signs[:count]


def _exact(edges: Indices, couplings: Float64, fields: Float64, start: Int8, node_limit: int) -> tuple[Int8, bool]:
    """The mixed-integer programme over x and y_ij = x_i x_j, in the gauge in which `start` is all 1.

    There nearly all couplings are positive, and a programme with positive couplings alone is solved by its linear
    relaxation.
    """
    count = len(fields)
    gauge = start.astype(np.float64)
    strong = np.abs(couplings) > 0
    i, j = edges[strong, 0], edges[strong, 1]
    tie = couplings[strong] * gauge[i] * gauge[j]
    pull = fields * gauge
    # s_i s_j = 4 y - 2 x_i - 2 x_j + 1
    cost = -2.0 * pull
    np.add.at(cost, i, 2.0 * tie)
    np.add.at(cost, j, 2.0 * tie)
    n_edges = len(i)
    costs = np.concatenate([cost, -4.0 * tie])
    columns = count + np.arange(n_edges)
    friendly, hostile = np.flatnonzero(tie > 0), np.flatnonzero(tie < 0)
    # y <= x_i and y <= x_j where y is pushed up, y >= x_i + x_j - 1 where it is pushed down
    n_up = len(friendly)
    row = np.arange(2 * n_up + len(hostile))
    down = row[2 * n_up :]
    rows = np.concatenate([row[: 2 * n_up], row[: 2 * n_up], down, down, down])
    column = np.concatenate([
        columns[friendly], columns[friendly], i[friendly], j[friendly], columns[hostile], i[hostile], j[hostile]
    ])  # fmt: skip
    ones = np.ones(2 * n_up)
    entries = np.concatenate([ones, -ones, -np.ones(len(hostile)), np.ones(2 * len(hostile))])
    matrix = csr_array((entries, (rows, column)), shape=(len(row), count + n_edges))
    above = np.concatenate([np.zeros(2 * n_up), np.ones(len(hostile))])
    low, high = np.zeros(count + n_edges), np.ones(count + n_edges)
    whole = np.concatenate([np.ones(count), np.zeros(n_edges)])
    constraints = LinearConstraint(matrix, -np.inf, above) if len(row) else ()
    found = milp(
        costs, integrality=whole, bounds=Bounds(low, high), constraints=constraints,
        options={"node_limit": node_limit, "mip_rel_gap": 1e-6},
    )  # fmt: skip
    if found.x is None:
        return start, False
    better = np.where(found.x[:count] > 0.5, start, -start).astype(np.int8)
    energies = [energy_of(s, edges, couplings, fields) for s in (start, better)]
    return (better if energies[1] < energies[0] else start), found.status == 0
