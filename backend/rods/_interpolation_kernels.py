"""Kernels of `interpolation` and `training`: how guides move the other hair (Chai et al. 2014; B-27, M-27).

A *motion* is what carries a rest position x to where it is now, as a displacement: x + D (x - c) + t, float32, with c
the middle of the guides' roots. At rest D and t are 0 to float64's rounding, so that hair at rest stays where it is.
Its twelve numbers are the columns of D, then t.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from ..kernels import inlined_device, parallel_kernel
from ..types import Float32, Float64, Int32

STRANDS_A_BLOCK = 64  # that share a buffer; the result does not depend on it


@parallel_kernel
def guide_motions(
    rest_points: Float64, rest_frames: Float64, points: Float64, frames: Float64, centre: Float64, motions: Float32
) -> None:
    """motions (G, M, 12): the rigid motion of every sample, R R0^T (x - g0) + g, from rest to now (M-27)."""
    n_guides, n_samples = points.shape[:2]
    for guide in numba.prange(n_guides):
        for sample in range(n_samples):
            for row in range(3):
                offset = points[guide, sample, row] - centre[row]
                for column in range(3):
                    turned = 0.0
                    for axis in range(3):
                        turned += frames[guide, sample, row, axis] * rest_frames[guide, sample, column, axis]
                    offset += turned * (centre[column] - rest_points[guide, sample, column])
                    identity = 1.0 if row == column else 0.0
                    motions[guide, sample, 3 * column + row] = turned - identity
                motions[guide, sample, 9 + row] = offset


@inlined_device
def knot_weight(weights: Float32, strand: int, knot: int, share: Any, neighbour: int) -> Any:
    """The weight of a neighbour between two knots, `share` of the way to the next."""
    start, end = weights[strand, knot, neighbour], weights[strand, knot + 1, neighbour]
    return start + share * (end - start)


@inlined_device
def blend_motions(motions: Float32, guides: Int32, weights: Float32, strand: int, blended: Float32) -> None:
    """blended (M, 12): the weighted mean of the motions of a strand's guides, sample by sample."""
    n_samples = motions.shape[1]
    n_knots = weights.shape[1]
    blended[:] = np.float32(0.0)
    for neighbour in range(guides.shape[1]):
        guide = guides[strand, neighbour]
        for sample in range(n_samples):
            place = np.float32(sample * (n_knots - 1)) / np.float32(n_samples - 1)
            knot = min(int(place), n_knots - 2)
            weight = knot_weight(weights, strand, knot, place - np.float32(knot), neighbour)
            for entry in range(12):
                blended[sample, entry] += weight * motions[guide, sample, entry]


@parallel_kernel
def move_strands(
    points: Float32,
    offsets: Int32,
    places: Float32,
    guides: Int32,
    weights: Float32,
    motions: Float32,
    centre: Float32,
    root_motions: Float32,
    root_shares: Float32,
    out: Float32,
) -> None:
    """out (P, 3): every point moved by the blend of its guides' motions, linear between the samples (B-27).

    places (P,) : samples of a guide that a point is from its root. root_motions (S, 12), (1, 12) for all, or (0, 12)
    for none: where the surface carries a root; a point takes root_shares (P,) of the difference, so roots are there.
    """
    n_strands = len(offsets) - 1
    n_samples = motions.shape[1]
    n_blocks = (n_strands + STRANDS_A_BLOCK - 1) // STRANDS_A_BLOCK
    centre_x, centre_y, centre_z = centre[0], centre[1], centre[2]
    for block in numba.prange(n_blocks):
        blended = np.empty((n_samples, 12), np.float32)
        at_root = np.empty(12, np.float32)
        for strand in range(block * STRANDS_A_BLOCK, min((block + 1) * STRANDS_A_BLOCK, n_strands)):
            blend_motions(motions, guides, weights, strand, blended)
            if len(root_motions) > 0:
                for entry in range(12):
                    at_root[entry] = root_motions[min(strand, len(root_motions) - 1), entry] - blended[0, entry]
            for i in range(offsets[strand], offsets[strand + 1]):
                sample = min(int(places[i]), n_samples - 2)
                share = places[i] - np.float32(sample)
                x, y, z = points[i, 0] - centre_x, points[i, 1] - centre_y, points[i, 2] - centre_z
                for axis in range(3):
                    a, b = blended[sample], blended[sample + 1]
                    before = a[axis] * x + a[3 + axis] * y + a[6 + axis] * z + a[9 + axis]
                    after = b[axis] * x + b[3 + axis] * y + b[6 + axis] * z + b[9 + axis]
                    moved = before + share * (after - before)
                    if len(root_motions) > 0 and root_shares[i] > 0.0:
                        extra = at_root[axis] * x + at_root[3 + axis] * y + at_root[6 + axis] * z + at_root[9 + axis]
                        moved += root_shares[i] * extra
                    out[i, axis] = points[i, axis] + moved
