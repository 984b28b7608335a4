"""Uniform vertices on a surface: approximated centroidal Voronoi clusters (Valette & Chassery 2004; Z-8, M-33)."""

from __future__ import annotations

import igl
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..errors import require
from ..types import Float32, Float64, Floats, Int32, Mesh
from ._remeshing_kernels import grow_labels, label_parts, relax_clusters

MAX_SWEEPS = 100
REPAIRS = 4  # times that clusters in several parts are mended and relaxed again
RIM_SAMPLES = 20000  # along the boundary of a surface that points are drawn to
ITEMS_A_CLUSTER = 10  # a mesh with fewer vertices a cluster is subdivided first


def cluster_evenly(
    points: Floats, weights: Floats, edges: Int32, n_clusters: int, max_sweeps: int = MAX_SWEEPS
) -> Int32:
    """Part items into connected clusters of about equal weight, round ones where they can be.

    Minimises the sum over clusters of sum_j w_j |g_j|^2 - |sum_j w_j g_j|^2 / sum_j w_j by moving items over the
    borders between clusters (Valette & Chassery 2004; M-33), from runs of a space-filling curve.

    Parameters
    ----------
    points : (n, 3) float, metres. weights : (n,) float, above 0, the items' areas. edges : (E, 2) int32, neighbours.
    max_sweeps : over all edges, between repairs of clusters in several parts.

    Returns
    -------
    labels : (n,) int32 from 0 on, every number in use. There are more than `n_clusters` where the items do not hang
        together and a part of them would get no cluster of its own.

    Raises
    ------
    InputError : more clusters than items, or none.
    """
    count = len(points)
    require(1 <= n_clusters <= count, f"{count} items cannot make {n_clusters} clusters; take 1 to {count}")
    middle = np.asarray(points, np.float64).mean(axis=0)
    # float32 positions of millions of texels save a third of the time; their sums are float64
    centred = np.ascontiguousarray(points - middle, np.float32)
    weight = np.ascontiguousarray(weights, np.float32)
    labels = _runs(centred, weight, n_clusters)
    changed = np.zeros(n_clusters, np.int32)
    for _ in range(REPAIRS):
        sums, counts = _sums(centred, weight, labels)
        relax_clusters(centred, weight, edges, labels, sums, counts, changed, max_sweeps)
        touched = _release_parts(weight, edges, labels)
        if len(touched) == 0:
            break
        changed = np.full(int(labels.max()) + 1, -1, np.int32)
        changed[touched] = 0
    return labels


def _sums(points: Floats, weights: Floats, labels: Int32, least: int = 0) -> tuple[Float64, Int32]:
    """(k, 4) float64 weight and weighted point of each cluster, (k,) int32 items; for `least` clusters or more."""
    count = max(int(labels.max()) + 1, least)
    columns = [np.bincount(labels, weights, count)]
    columns += [np.bincount(labels, weights * points[:, axis].astype(np.float64), count) for axis in range(3)]
    return np.stack(columns, axis=1), np.bincount(labels, minlength=count).astype(np.int32)


def _runs(points: Floats, weights: Floats, n_clusters: int) -> Int32:
    """Clusters of equal weight from runs along the Morton curve; each has an item."""
    low = points.min(axis=0)
    extent = max(float((points.max(axis=0) - low).max()), 1e-30)
    cells = np.minimum((points - low) * (1023.999 / extent), 1023).astype(np.uint32)
    code = _spread(cells[:, 0]) | (_spread(cells[:, 1]) << 1) | (_spread(cells[:, 2]) << 2)
    order = np.argsort(code, kind="stable")
    total = np.cumsum(weights[order], dtype=np.float64)
    run = np.minimum((total - 0.5 * weights[order]) * (n_clusters / total[-1]), n_clusters - 1).astype(np.int64)
    # at least one item each: a run may start neither before its number of items nor so late that the rest get none
    index = np.arange(len(points))
    run = np.minimum(run, index)
    run = np.maximum(run, n_clusters - len(points) + index)
    steps = np.minimum(np.diff(run, prepend=-1), 1)
    if (np.diff(run, prepend=-1) > 1).any():
        run = np.maximum(np.minimum(np.cumsum(steps) - 1, n_clusters - 1), n_clusters - len(points) + index)
    labels = np.empty(len(points), np.int32)
    labels[order] = run
    return labels


def _spread(values: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """The ten low bits, three places apart."""
    spread = values & np.uint32(0x3FF)
    for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
        spread = (spread | (spread << np.uint32(shift))) & np.uint32(mask)
    return np.asarray(spread, np.uint32)


def _release_parts(weights: Floats, edges: Int32, labels: Int32) -> Int32:
    """Give all but the heaviest part of each cluster to the neighbours, in place; returns the clusters that changed."""
    parts = np.empty_like(labels)
    label_parts(edges, labels, parts)
    heads = np.flatnonzero(parts == np.arange(len(parts), dtype=np.int32))
    weight = np.bincount(parts, weights, len(parts))[heads]
    order = np.lexsort((heads, -weight, labels[heads]))
    first = np.ones(len(order), np.bool_)
    first[1:] = np.diff(labels[heads[order]]) != 0
    if first.all():
        return np.empty(0, np.int32)
    kept = np.zeros(len(parts), np.bool_)
    kept[heads[order[first]]] = True
    before = labels.copy()
    labels[~kept[parts]] = -1
    while (labels < 0).any() and grow_labels(edges, labels) > 0:
        pass
    # islands of the item graph have no other cluster to join, and become clusters themselves
    lost = labels < 0
    _, names = np.unique(parts[lost], return_inverse=True)
    labels[lost] = before.max() + 1 + names
    moved = labels != before
    return np.asarray(np.unique(np.concatenate([labels[moved], before[moved]])), np.int32)


def mesh_edges(triangles: Int32) -> Int32:
    """(E, 2) int32: each edge of the triangles once, the smaller vertex first, sorted."""
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    low, high = sides.min(axis=1), sides.max(axis=1)
    keys = np.unique(low << 32 | high)
    return np.asarray(np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=1), np.int32)


def boundary_edges(triangles: Int32) -> Int32:
    """(B, 2) int32: the directed edges of the triangles that no other triangle runs back along."""
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    forward, backward = sides[:, 0] << 32 | sides[:, 1], sides[:, 1] << 32 | sides[:, 0]
    return np.asarray(sides[~np.isin(forward, backward)], np.int32)


def vertex_areas(vertices: Floats, triangles: Int32) -> Float64:
    """(V,) float64, m^2: a third of the area of the triangles around each vertex."""
    corners = np.asarray(vertices, np.float64)[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 6
    return np.asarray(np.bincount(triangles.ravel(), np.repeat(area, 3), len(vertices)))


def vertex_normals(vertices: Floats, triangles: Int32) -> Float32:
    """(V, 3) float32 unit normals, mean of the triangles around weighted by area; (0, 0, 1) for a lone vertex."""
    corners = np.asarray(vertices, np.float64)[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    repeated = np.repeat(cross, 3, axis=0)
    sums = np.stack([np.bincount(triangles.ravel(), repeated[:, axis], len(vertices)) for axis in range(3)], axis=1)
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.where(lengths > 0, sums / np.where(lengths > 0, lengths, 1), [0.0, 0.0, 1.0]).astype(np.float32)


def subdivide(mesh: Mesh, corner_values: Floats | None = None) -> tuple[Mesh, Floats | None]:
    """Each triangle into four by the middles of its edges.

    corner_values : (F, 3, c) float, for instance texture coordinates, or None; the new triangles' come back,
    (4 F, 3, c). Triangle f becomes 4 f ... 4 f + 3; the old vertices keep their numbers.
    """
    triangles, count = mesh.triangles, len(mesh.vertices)
    edges = mesh_edges(triangles)
    keys = edges[:, 0].astype(np.int64) << 32 | edges[:, 1]
    following = triangles[:, [1, 2, 0]].astype(np.int64)
    low, high = np.minimum(triangles, following), np.maximum(triangles, following)
    middle = (count + np.searchsorted(keys, low << 32 | high)).astype(np.int32)
    vertices = np.concatenate([mesh.vertices, 0.5 * (mesh.vertices[edges[:, 0]] + mesh.vertices[edges[:, 1]])])
    a, b, c = triangles.T
    ab, bc, ca = middle.T
    parts = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
    fine = Mesh(vertices.astype(np.float32), np.ascontiguousarray(parts, np.int32))
    if corner_values is None:
        return fine, None
    u, v, w = corner_values[:, 0], corner_values[:, 1], corner_values[:, 2]
    uv, vw, wu = 0.5 * (u + v), 0.5 * (v + w), 0.5 * (w + u)
    values = np.stack([u, uv, wu, uv, v, vw, wu, vw, w, uv, vw, wu], axis=1)
    return fine, values.reshape(-1, 3, corner_values.shape[2])


class SurfaceSnap:
    """Draws points to a mesh: to its surface, and points of a boundary to its boundary."""

    def __init__(self, mesh: Mesh) -> None:
        self._vertices = np.ascontiguousarray(mesh.vertices, np.float64)
        self._triangles = np.ascontiguousarray(mesh.triangles, np.int64)
        self._tree = igl.AABB()
        self._tree.init(self._vertices, self._triangles)
        self._ends = self._vertices[boundary_edges(mesh.triangles)]
        # samples along the boundary tell which of its edges is near; the place on that edge is exact
        lengths = np.linalg.norm(self._ends[:, 1] - self._ends[:, 0], axis=1)
        step = max(lengths.sum() / RIM_SAMPLES, 1e-12)
        counts = np.ceil(lengths / step).astype(np.int64) + 1
        self._edge_of_sample = np.repeat(np.arange(len(counts)), counts)
        place = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        share = (place / np.repeat(counts - 1, counts).clip(1))[:, None]
        start, end = self._ends[self._edge_of_sample, 0], self._ends[self._edge_of_sample, 1]
        self._samples = cKDTree(start + share * (end - start)) if len(counts) else None

    def snap(self, mesh: Mesh, start: int = 0) -> Mesh:
        """The mesh with its vertices from number `start` on drawn to the surface, its boundary to the boundary."""
        vertices = mesh.vertices.astype(np.float64)
        queries = np.ascontiguousarray(vertices[start:])
        if len(queries) == 0:
            return mesh
        _, _, closest = self._tree.squared_distance(self._vertices, self._triangles, queries)
        vertices[start:] = closest
        rim = np.unique(boundary_edges(mesh.triangles))
        rim = rim[rim >= start]
        if len(rim) and self._samples is not None:
            vertices[rim] = self._on_boundary(mesh.vertices[rim].astype(np.float64), self._samples)
        return Mesh(vertices.astype(np.float32), mesh.triangles)

    def _on_boundary(self, points: Float64, samples: cKDTree) -> Float64:
        start, end = self._ends[self._edge_of_sample[samples.query(points)[1]]].transpose(1, 0, 2)
        along = end - start
        share = np.einsum("nc,nc->n", points - start, along) / np.maximum((along**2).sum(axis=1), 1e-30)
        return np.asarray(start + share.clip(0, 1)[:, None] * along)


def remesh(mesh: Mesh, n_vertices: int) -> Mesh:
    """A mesh of the same surface with about `n_vertices` vertices, evenly spread (Valette & Chassery 2004; Z-8, M-33).

    The dual of the clusters of `cluster_evenly`: a triangle where three of them meet. The vertices lie on the surface,
    at the clusters' centres; those of clusters at an open boundary lie on the boundary. Parts of the mesh that are too
    small for a triangle between three clusters are left out.

    Raises
    ------
    InputError : a mesh without triangles, or fewer than 4 vertices asked for.
    """
    require(len(mesh.triangles) > 0, "the mesh to be remeshed has no triangles; give a surface")
    require(n_vertices >= 4, f"a mesh of {n_vertices} vertices was asked for; take 4 or more")
    fine = _without_lone_vertices(mesh)
    while len(fine.vertices) < ITEMS_A_CLUSTER * n_vertices:
        fine, _ = subdivide(fine)
    areas = np.maximum(vertex_areas(fine.vertices, fine.triangles), 1e-18)
    labels = cluster_evenly(fine.vertices, areas, mesh_edges(fine.triangles), n_vertices)
    centres = _centres(fine, areas, labels)
    coarse = _dual(fine, labels, centres)
    return SurfaceSnap(fine).snap(coarse)


def _centres(mesh: Mesh, areas: Float64, labels: Int32) -> Float64:
    """(k, 3): the weighted means of the clusters, of their boundary vertices alone where they have some."""
    sums, _ = _sums(mesh.vertices, areas, labels)
    centres = sums[:, 1:] / sums[:, :1]
    rim = np.unique(boundary_edges(mesh.triangles))
    if len(rim):
        on_rim, counts = _sums(mesh.vertices[rim], np.ones(len(rim)), labels[rim], len(sums))
        bound = counts > 0
        centres[bound] = on_rim[bound, 1:] / on_rim[bound, :1]
    return np.asarray(centres)


def _dual(mesh: Mesh, labels: Int32, centres: Float64) -> Mesh:
    """The triangles between clusters that meet at a triangle of the mesh; no directed edge twice."""
    meets = labels[mesh.triangles]
    distinct = (meets[:, 0] != meets[:, 1]) & (meets[:, 1] != meets[:, 2]) & (meets[:, 2] != meets[:, 0])
    triangles = meets[distinct]
    # the smallest vertex first, so that the same triangle found twice can be told
    turn = triangles.argmin(axis=1)[:, None]
    triangles = np.take_along_axis(triangles, (np.arange(3) + turn) % 3, axis=1)
    triangles = np.unique(triangles, axis=0)
    while True:
        keys = triangles.astype(np.int64) << 32 | triangles[:, [1, 2, 0]]
        _, first = np.unique(keys.ravel(), return_index=True)
        repeated = np.ones(keys.size, np.bool_)
        repeated[first] = False
        surplus = repeated.reshape(-1, 3).any(axis=1)
        if not surplus.any():
            break
        triangles = triangles[~surplus]
    return _without_lone_vertices(Mesh(centres.astype(np.float32), np.ascontiguousarray(triangles, np.int32)))


def _without_lone_vertices(mesh: Mesh) -> Mesh:
    used, triangles = np.unique(mesh.triangles, return_inverse=True)
    if len(used) == len(mesh.vertices):
        return mesh
    return Mesh(np.ascontiguousarray(mesh.vertices[used]), triangles.reshape(-1, 3).astype(np.int32))
