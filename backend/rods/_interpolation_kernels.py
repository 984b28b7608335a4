"""Kernels of `interpolation` and `training`: how guides move the other hair (Chai et al. 2014; B-27, M-27).

A *motion* is what carries a rest position x to where it is now, as a displacement: x + D (x - c) + t, float32, with c
the middle of the guides' roots. At rest D and t are 0 to float64's rounding, so that hair at rest stays where it is.
Its twelve numbers are the columns of D, then t.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from ..kernels import inlined_device, parallel_kernel
from ..types import Float32, Float64, Int32

STRANDS_A_BLOCK = 64  # that share a buffer; the result does not depend on it
STRETCH = 0.005  # of its length that a segment may be off; more than float32 makes of a rigid motion
_MOST, _LEAST = np.float32((1.0 + STRETCH) ** 2), np.float32((1.0 - STRETCH) ** 2)


@parallel_kernel
def guide_motions(
    rest_points: Float64, rest_frames: Float64, points: Float64, frames: Float64, centre: Float64, motions: Float32
) -> None:
    """motions (G, 12, M): the rigid motion of every sample, R R0^T (x - g0) + g, from rest to now (M-27)."""
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
                    motions[guide, 3 * column + row, sample] = turned - identity
                motions[guide, 9 + row, sample] = offset


@inlined_device
def blend_motions(
    motions: Float32, guides: Int32, weights: Float32, strand: int, of_samples: Float32, blended: Float32
) -> None:
    """blended (12, M): the weighted mean of the motions of a strand's guides, sample by sample.

    of_samples (M,) : room for the weights of a guide at the samples, linear between the knots.
    """
    n_samples, n_knots = motions.shape[2], weights.shape[1]
    blended[:] = np.float32(0.0)
    step = np.float32(n_knots - 1) / np.float32(n_samples - 1)
    for neighbour in range(guides.shape[1]):
        for sample in range(n_samples):
            place = np.float32(sample) * step
            knot = min(int(place), n_knots - 2)
            start, end = weights[strand, knot, neighbour], weights[strand, knot + 1, neighbour]
            of_samples[sample] = start + (place - np.float32(knot)) * (end - start)
        for entry in range(12):
            motion, mean = motions[guides[strand, neighbour], entry], blended[entry]
            for sample in range(n_samples):
                mean[sample] += of_samples[sample] * motion[sample]


@inlined_device
def move_point(motion: Float32, i: int, x: Any, y: Any, z: Any) -> Any:
    """The displacement, by motion[:, i], of a point that is (x, y, z) from the centre."""
    return (
        motion[0, i] * x + motion[3, i] * y + motion[6, i] * z + motion[9, i],
        motion[1, i] * x + motion[4, i] * y + motion[7, i] * z + motion[10, i],
        motion[2, i] * x + motion[5, i] * y + motion[8, i] * z + motion[11, i],
    )


@inlined_device
def missing_share(rest_square: Any, square: Any) -> Any:
    """What a segment must grow by, as a share, so that its length is within STRETCH of that at rest."""
    missing = np.float32(0.0)
    if square > _MOST * rest_square:
        missing = np.float32(math.sqrt(_MOST * rest_square / square)) - np.float32(1.0)
    elif square < _LEAST * rest_square and square > 0.0:
        missing = np.float32(math.sqrt(_LEAST * rest_square / square)) - np.float32(1.0)
    return missing


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

    Blends of turns are shorter than what they blend: from the root on, segments that are more than STRETCH off their
    length at rest are brought back to it, and the hair beyond goes along.

    places (P,) : samples of a guide that a point is from its root. root_motions (S, 12), (1, 12) for all, or (0, 12)
    for none: where the surface carries a root; a point takes root_shares (P,) of the difference, so roots are there.
    """
    n_strands, n_samples = len(offsets) - 1, motions.shape[2]
    n_blocks = (n_strands + STRANDS_A_BLOCK - 1) // STRANDS_A_BLOCK
    for block in numba.prange(n_blocks):
        blended, of_samples = np.empty((12, n_samples), np.float32), np.empty(n_samples, np.float32)
        at_root = np.empty((12, 1), np.float32)
        for strand in range(block * STRANDS_A_BLOCK, min((block + 1) * STRANDS_A_BLOCK, n_strands)):
            blend_motions(motions, guides, weights, strand, of_samples, blended)
            shift_x = shift_y = shift_z = np.float32(0.0)
            last_x = last_y = last_z = last_u = last_v = last_w = np.float32(0.0)
            for i in range(offsets[strand], offsets[strand + 1]):
                sample = min(int(places[i]), n_samples - 2)
                share = places[i] - np.float32(sample)
                x, y, z = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
                u0, v0, w0 = move_point(blended, sample, x, y, z)
                u1, v1, w1 = move_point(blended, sample + 1, x, y, z)
                u, v, w = u0 + share * (u1 - u0), v0 + share * (v1 - v0), w0 + share * (w1 - w0)
                if i > offsets[strand]:
                    along_x, along_y, along_z = x - last_x, y - last_y, z - last_z
                    now_x, now_y, now_z = along_x + (u - last_u), along_y + (v - last_v), along_z + (w - last_w)
                    missing = missing_share(
                        along_x * along_x + along_y * along_y + along_z * along_z,
                        now_x * now_x + now_y * now_y + now_z * now_z,
                    )
                    shift_x += missing * now_x
                    shift_y += missing * now_y
                    shift_z += missing * now_z
                last_x, last_y, last_z, last_u, last_v, last_w = x, y, z, u, v, w
                out[i, 0] = points[i, 0] + (u + shift_x)
                out[i, 1] = points[i, 1] + (v + shift_y)
                out[i, 2] = points[i, 2] + (w + shift_z)
            if len(root_motions) > 0:
                for entry in range(12):
                    at_root[entry, 0] = root_motions[min(strand, len(root_motions) - 1), entry] - blended[entry, 0]
                for i in range(offsets[strand], offsets[strand + 1]):
                    if root_shares[i] <= 0.0:
                        break
                    x, y, z = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
                    u, v, w = move_point(at_root, 0, x, y, z)
                    out[i, 0] += root_shares[i] * u
                    out[i, 1] += root_shares[i] * v
                    out[i, 2] += root_shares[i] * w
