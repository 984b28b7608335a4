"""Hair roots spread evenly over a region of the head (Wang et al. 2009, sec. 5.2; W-19), by repulsion (M-4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import require
from ..types import Bools, Float32, Float64, Head, Int32
from ._roots_kernels import chain_edges, find_neighbours, nearest_distances, relax, sort_into_cells
from .scalp_region import Indices, weld

MOST_ROOTS = 20_000_000

# Turk: the radius of repulsion is twice the side of the square that each point has to itself.
_REACH = 2.0
# Neighbours are listed this much farther than they push, so that a list serves several steps.
_LIST_REACH = 1.25
_MOST_NEIGHBOURS = 40
# The steps before which the lists are made anew: the random start falls apart quickly, later neighbours stay the same.
_UPDATES = (3, 9, 20, 40, 70, 100)
# Move in reaches for a force of 1; from 0.25 the points start to jump about.
_STEP = 0.18
# Fixed points on the border push with this share of the force: less, and roots line up there; more, and it goes bare.
_BORDER_WEIGHT = 0.8


@dataclass(frozen=True, slots=True)
class RootsReport:
    """How even the roots are.

    spacing : mean distance to the nearest root, metres.
    variation_before, variation : standard deviation of that distance over its mean, of the random and the relaxed
        roots; 0.52 for purely random points.
    """

    spacing: float
    variation_before: float
    variation: float


@dataclass(frozen=True, slots=True)
class Roots:
    """n places on a head's surface.

    points : (n, 3) float32, metres, world space. triangles : (n,) int32, of the head.
    barycentric : (n, 3) float32, of the triangles' corners.
    """

    points: Float32
    triangles: Int32
    barycentric: Float32
    report: RootsReport


def scatter_roots(head: Head, region: Bools, count: int, seed: int, *, iterations: int = 40) -> Roots:
    """Spread `count` roots evenly over a region of the head: random by area, then relaxed by repulsion (W-19, M-4).

    Fixed points on the border of the region push too, or the roots would line up along it.

    Parameters
    ----------
    head : the mesh. region : (F,) bool, its triangles that may have roots.
    count : number of roots, 0 or more. seed : of the random start. iterations : relaxation steps; 0 leaves them random.

    Returns
    -------
    Roots, along a space-filling curve but for what the relaxation moved; the same bytes for the same input on any
    number of threads.

    Raises
    ------
    InputError : a mask of the wrong size, a region with no area, a bad count or number of iterations.
    """
    region = np.asarray(region)
    require(
        region.shape == (len(head.triangles),) and region.dtype == np.bool_,
        f"the scalp region must be {len(head.triangles)} booleans, one a triangle, not {region.dtype} {region.shape}",
    )
    require(0 <= count <= MOST_ROOTS, f"the number of roots is {count}; it must be from 0 to {MOST_ROOTS:,}")
    require(iterations >= 0, f"the number of relaxation steps is {iterations}; it must be 0 or more")
    surface = _Region(head, region)
    require(surface.area > 0, "the scalp region has no area; choose faces of the head where hair shall grow")
    triangles, barycentric = surface.random_places(count, np.random.default_rng(seed))
    triangles, barycentric, report = _relax(surface, triangles, barycentric, iterations)
    corners = surface.corners[triangles]
    barycentric = np.clip(barycentric, 0.0, 1.0)
    barycentric /= barycentric.sum(axis=1, keepdims=True)
    points = np.einsum("nk,nkc->nc", barycentric, corners) + surface.middle
    chosen = surface.triangles[triangles]
    return Roots(points.astype(np.float32), chosen.astype(np.int32), barycentric.astype(np.float32), report)


class _Region:
    """The triangles of a region along a space-filling curve, so that what is near in space is near in memory.

    triangles : their numbers in the head; and their corners around their middle, normals, areas, rings and border.
    """

    def __init__(self, head: Head, region: Bools) -> None:
        chosen = np.flatnonzero(region)
        self.triangles = chosen[_along_curve(head.vertices[head.triangles[chosen]].mean(axis=1, dtype=np.float64))]
        corners = head.vertices[head.triangles[self.triangles]].astype(np.float64)
        self.middle = corners.reshape(-1, 3).mean(axis=0) if len(corners) else np.zeros(3)
        self.corners = np.ascontiguousarray(corners - self.middle)
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        doubled = np.linalg.norm(cross, axis=1)
        self.areas: Float64 = 0.5 * doubled
        self.area = float(self.areas.sum())
        self.normals = cross / np.where(doubled > 0, doubled, 1.0)[:, None]
        self._welded = weld(head)[self.triangles]

    def random_places(self, count: int, generator: np.random.Generator) -> tuple[Int32, Float64]:
        """Random triangles (n,) in rising order and uniform barycentric places (n, 3), by area.

        The area is cut into `count` equal shares with a root in each, so no triangle has far too many or too few.
        """
        shares = (np.arange(count) + generator.random(count)) * (self.area / max(count, 1))
        triangles = np.searchsorted(np.cumsum(self.areas), shares, side="right")
        largest = int(np.flatnonzero(self.areas > 0)[-1])
        first, second = generator.random((2, count))
        root = np.sqrt(first)
        places = np.stack([1.0 - root, root * (1.0 - second), root * second], axis=1)
        return np.minimum(triangles, largest).astype(np.int32), places

    def rings(self) -> tuple[Int32, Int32]:
        """For each triangle the others that share a vertex with it: starts (F + 1,) and the concatenated lists."""
        from scipy.sparse import csr_array

        count = len(self._welded)
        used, vertex = np.unique(self._welded, return_inverse=True)
        triangle = np.repeat(np.arange(count), 3)
        incidence = csr_array((np.ones(3 * count, np.int32), (triangle, vertex.ravel())), shape=(count, len(used)))
        touching = csr_array(incidence @ incidence.T)
        touching.setdiag(0)
        touching.eliminate_zeros()
        touching.sort_indices()
        return touching.indptr.astype(np.int32), touching.indices.astype(np.int32)

    def border_points(self, spacing: float) -> tuple[Float64, Float64]:
        """Points (g, 3) about every `spacing` along the region's border, and the normals (g, 3) there."""
        count = len(self._welded)
        edges = np.concatenate([self._welded[:, [0, 1]], self._welded[:, [1, 2]], self._welded[:, [2, 0]]])
        key = np.sort(edges, axis=1) @ np.array([int(self._welded.max()) + 1, 1])
        _, index, uses = np.unique(key, return_index=True, return_counts=True)
        border = index[uses == 1]
        border = border[np.argsort(edges[border, 0], kind="stable")]
        _, vertices = np.unique(edges[border], return_inverse=True)
        starts, ends = np.ascontiguousarray(vertices.reshape(-1, 2).T)
        first = np.searchsorted(starts, np.arange(starts.max(initial=-1) + 2))
        order = np.empty(len(border), np.int64)
        chain_edges(starts, ends, first, order)
        border = border[order]
        triangle, corner = border % count, border // count
        low, high = self.corners[triangle, corner], self.corners[triangle, (corner + 1) % 3]
        lengths = np.linalg.norm(high - low, axis=1)
        reached = np.cumsum(lengths)
        total = float(lengths.sum())
        marks = (np.arange(int(np.ceil(total / spacing))) + 0.5) * spacing
        marks = marks[marks < total]
        edge = np.minimum(np.searchsorted(reached, marks, side="right"), len(border) - 1)
        share = 1.0 - ((reached[edge] - marks) / lengths[edge])[:, None]
        return low[edge] * (1.0 - share) + high[edge] * share, self.normals[triangle[edge]]


def _along_curve(points: Float64) -> Indices:
    """The order of points (n, 3) along Morton's curve through a grid of 1024^3."""
    if len(points) == 0:
        return np.empty(0, np.int64)
    low, size = points.min(axis=0), float(np.ptp(points, axis=0).max())
    cells = ((points - low) * (1023.0 / size if size > 0 else 0.0)).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


def _relax(
    region: _Region, triangles: Int32, barycentric: Float64, iterations: int
) -> tuple[Int32, Float64, RootsReport]:
    """Move the roots apart for a number of steps."""
    count = len(triangles)
    moving = np.einsum("nk,nkc->nc", barycentric, region.corners[triangles])
    if count < 2:
        return triangles, barycentric, RootsReport(0.0, 0.0, 0.0)
    side = float(np.sqrt(region.area / count))
    border, border_normals = region.border_points(side)
    points = np.vstack([moving, border])
    normals = np.vstack([region.normals[triangles], border_normals])
    ring_starts, rings = region.rings()
    lists = _Neighbours(count, len(points), _REACH * _LIST_REACH * side)
    lists.update(points, normals)
    before = lists.nearest(points)
    new_points, new_triangles = points.copy(), triangles.copy()
    barycentric = barycentric.copy()
    for iteration in range(iterations):
        if iteration in _UPDATES:
            lists.update(points, normals)
        relax(
            points, normals, triangles, lists.neighbours, lists.counts, _REACH * side, _STEP, _BORDER_WEIGHT,
            region.corners, region.normals, ring_starts, rings, new_points, new_triangles, barycentric,
        )  # fmt: skip
        points, new_points = new_points, points
        triangles, new_triangles = new_triangles, triangles
    after = lists.nearest(points)
    report = RootsReport(float(after.mean()), float(before.std() / before.mean()), float(after.std() / after.mean()))
    return triangles, barycentric, report


class _Neighbours:
    """Lists of the neighbours of the first `count` points within `reach`, and the memory to remake them."""

    def __init__(self, count: int, n_points: int, reach: float) -> None:
        self.reach = reach
        self.neighbours = np.empty((count, _MOST_NEIGHBOURS), np.int32)
        self.counts = np.empty(count, np.int32)
        self._starts = np.empty(2 ** int(np.ceil(np.log2(2 * n_points))) + 1, np.int32)
        self._order = np.empty(n_points, np.int32)
        self._cells = np.empty((n_points, 3), np.int32)
        self._places = np.empty((n_points, 6))

    def update(self, points: Float64, normals: Float64) -> None:
        grid = (self._starts, self._order, self._cells, self._places)
        sort_into_cells(points, normals, self.reach, *grid)
        find_neighbours(self.reach, *grid, self.neighbours, self.counts)

    def nearest(self, points: Float64) -> Float64:
        """(n,) distance of each point to the nearest other, at most the reach."""
        distances = np.empty(len(self.counts))
        nearest_distances(points, self.neighbours, self.counts, self.reach, distances)
        return distances
