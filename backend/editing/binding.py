"""Hair bound to the center strands of its wisps: what moves with what when a center strand is deformed (W-U5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import require
from ..geometry._grouping_kernels import list_members
from ..geometry.root_graph import RootGraph, connect_roots
from ..geometry.strands import resample_smooth
from ..types import Float32, Float64, Int32, StrandSet
from ._binding_kernels import average_members, bound_wisps, measure_widths, place_points


@dataclass(frozen=True, slots=True)
class Binding:
    """S strands bound to K centers of N points.

    centers : (K, N, 3) float32, metres, world space; the mean of a wisp's strands at equal shares of their length.
    labels : (S,) int32, the center of each strand.
    members, starts : (S,) and (K + 1,) int32, the strands of each center in rows.
    places : (P,) float32, where along its center each point of the hair lies, in samples, 0 .. N - 1.
    lengths : (S,) float64, of the strands, metres.
    """

    centers: Float32
    labels: Int32
    members: Int32
    starts: Int32
    places: Float32
    lengths: Float64

    @property
    def n_centers(self) -> int:
        return len(self.centers)


def bind_strands(strands: StrandSet, labels: Int32 | None, n_points: int) -> Binding:
    """Bind strands to the centers of their wisps; None makes each strand its own center.

    strands : world space, metres. labels : (S,) int32, the wisp of each strand; numbers may be left out.

    Raises
    ------
    InputError : labels for another number of strands.
    """
    samples = resample_smooth(strands, n_points)
    if labels is None:
        compact = np.arange(strands.n_strands, dtype=np.int32)
    else:
        require(
            labels.shape == (strands.n_strands,),
            f"there are wisps for {len(labels)} strands but the groom has {strands.n_strands}; run Cluster Wisps again",
        )
        compact = np.unique(labels, return_inverse=True)[1].reshape(-1).astype(np.int32)
    starts, members = list_members(compact, int(compact.max(initial=-1)) + 1)
    if labels is None:
        centers = samples
    else:
        centers = np.empty((len(starts) - 1, n_points, 3), np.float32)
        average_members(samples, members, starts, centers)
    places, lengths = np.empty(len(strands.points), np.float32), np.empty(strands.n_strands)
    place_points(strands.points, strands.offsets, n_points - 1, places, lengths)
    return Binding(centers, compact, members, starts, places, lengths)


def wisp_labels(strands: StrandSet) -> tuple[Int32, ...]:
    """Per level, finest first, (S,) int32: the wisps that the strand attributes `hairloom_wisp`, `hairloom_wisp_2` ...
    tell, as the add-on writes them."""
    found: list[Int32] = []
    while True:
        name = "hairloom_wisp" if not found else f"hairloom_wisp_{len(found) + 1}"
        labels = strands.strand_attributes.get(name)
        if labels is None:
            return tuple(found)
        require(
            labels.ndim == 1 and labels.dtype.kind in "iu",
            f"'{name}' must be one whole number for each strand, not {labels.dtype} of shape {labels.shape}",
        )
        found.append(np.asarray(labels, dtype=np.int32))


def wisp_spheres(points: Float32, offsets: Int32, binding: Binding, chosen: Int32) -> Float64:
    """(n, 4) float64: centre and radius of a sphere around all hair of each of the chosen centers (n,) int32."""
    spheres = np.empty((len(chosen), 4))
    bound_wisps(points, offsets, binding.members, binding.starts, chosen, spheres)
    return spheres


def wisp_widths(points: Float32, offsets: Int32, binding: Binding) -> tuple[Float64, Float64]:
    """How far the hair of each center is from it: (K,) root mean square, in samples, and (K,) at most, metres."""
    means, most = np.empty(binding.n_centers), np.empty(binding.n_centers)
    measure_widths(points, offsets, binding.members, binding.starts, binding.places, binding.centers, means, most)
    return means, most


def neighbour_graph(roots: Float32) -> RootGraph:
    """The Delaunay neighbourhood of roots (K, 3) on a scalp that is not known: seen from within the sphere they fit.

    The sphere is unrolled stereographically from the side opposite to their middle; roots in a plane are taken as they
    lie in it.
    """
    outward, across, is_flat = _around(roots)
    if is_flat:
        flat = (roots - roots.mean(axis=0, dtype=np.float64)) @ across[:2].T
    else:
        flat = outward @ across[1:].T / np.maximum(1.0 + outward @ across[0], 1e-3)[:, None]
    return connect_roots(flat.astype(np.float32))


def outward_normals(roots: Float32) -> Float64:
    """(K, 3) unit directions away from the middle of the sphere that the roots (K, 3) fit."""
    outward, across, is_flat = _around(roots)
    return np.tile(across[2], (len(roots), 1)) if is_flat else outward


def _around(roots: Float32) -> tuple[Float64, Float64, bool]:
    """Unit directions (K, 3) from the fitted sphere's middle; axes (3, 3); are the roots (nearly) in a plane?

    The axes: the mean direction and two across it; of a plane, two in it and its normal.
    """
    spread = roots.astype(np.float64) - roots.mean(axis=0, dtype=np.float64)
    _, sizes, axes = np.linalg.svd(np.concatenate([spread, np.zeros((3, 3))]), full_matrices=False)
    unknowns = np.column_stack([2.0 * spread, np.ones(len(roots))])
    if len(roots) < 5 or sizes[2] < 1e-3 * sizes[0]:
        return spread, axes, True
    centre = np.linalg.lstsq(unknowns, (spread**2).sum(axis=1), rcond=None)[0][:3]
    outward = spread - centre
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    pole = outward.mean(axis=0)
    return outward, np.linalg.svd(np.stack([pole, pole * 0, pole * 0]))[2], False
