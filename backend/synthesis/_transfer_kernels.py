"""Compiled loops of detail transfer (Wang et al. 2009, sec. 5.2). All lengths are head radii, in head space."""

from __future__ import annotations

import numba
import numpy as np

from ..kernels import device, parallel_kernel
from ..types import Float32, Int32


@parallel_kernel
def find_donors(
    out_offsets: Float32,
    out_matches: Int32,
    in_offsets: Float32,
    in_members: Int32,
    in_starts: Int32,
    n_donors: int,
) -> tuple[Int32, Float32]:
    """For each output strand the `n_donors` members of its matched input wisp with the most similar root displacement.

    out_offsets (S, 3), in_offsets (T, 3): root displacement from the center's root, in the aligned frame.
    out_matches (S,): the input wisp of each output strand; wisp w owns in_members[in_starts[w]:in_starts[w + 1]].
    Returns donors (S, n_donors) int32, best first, and their squared distances (inf where a wisp has fewer members).
    """
    count = out_offsets.shape[0]
    donors = np.empty((count, n_donors), np.int32)
    distances = np.full((count, n_donors), np.inf, np.float32)
    for s in numba.prange(count):
        wisp = out_matches[s]
        first = in_starts[wisp]
        donors[s, :] = in_members[first]
        for m in range(first, in_starts[wisp + 1]):
            strand = in_members[m]
            dx = out_offsets[s, 0] - in_offsets[strand, 0]
            dy = out_offsets[s, 1] - in_offsets[strand, 1]
            dz = out_offsets[s, 2] - in_offsets[strand, 2]
            distance = dx * dx + dy * dy + dz * dz
            slot = n_donors - 1
            if distance >= distances[s, slot]:
                continue
            while slot > 0 and distances[s, slot - 1] > distance:
                distances[s, slot] = distances[s, slot - 1]
                donors[s, slot] = donors[s, slot - 1]
                slot -= 1
            distances[s, slot] = distance
            donors[s, slot] = strand
    return donors, distances


@device
def _turn_between(  # type: ignore[no-untyped-def]
    from_frame, to_frame, x: float, y: float, z: float
):  # M_to (M_from^T v)
    a = from_frame[0, 0] * x + from_frame[1, 0] * y + from_frame[2, 0] * z
    b = from_frame[0, 1] * x + from_frame[1, 1] * y + from_frame[2, 1] * z
    c = from_frame[0, 2] * x + from_frame[1, 2] * y + from_frame[2, 2] * z
    return (
        to_frame[0, 0] * a + to_frame[0, 1] * b + to_frame[0, 2] * c,
        to_frame[1, 0] * a + to_frame[1, 1] * b + to_frame[1, 2] * c,
        to_frame[2, 0] * a + to_frame[2, 1] * b + to_frame[2, 2] * c,
    )


@parallel_kernel
def transfer_displacements(
    roots: Float32,
    wisps: Int32,
    out_centers: Float32,
    out_root_frames: Float32,
    out_point_frames: Float32,
    donors: Int32,
    weights: Float32,
    in_strands: Float32,
    in_wisps: Int32,
    in_centers: Float32,
    in_root_frames: Float32,
    in_point_frames: Float32,
) -> Float32:
    """Eqs. (5)-(8): displacements of the donors, seen in their center's frames, put onto the output's center strand.

    roots (S, 3) and wisps (S,): prescribed root and center of each output strand; donors, weights (S, D).
    *_centers (K, N, 3); *_root_frames (K, 3, 3) aligned frames; *_point_frames (K, N, 3, 3). Returns (S, N, 3).
    """
    count = roots.shape[0]
    n = out_centers.shape[1]
    result = np.empty((count, n, 3), np.float32)
    for s in numba.prange(count):
        center = wisps[s]
        shift_x = roots[s, 0] - out_centers[center, 0, 0]
        shift_y = roots[s, 1] - out_centers[center, 0, 1]
        shift_z = roots[s, 2] - out_centers[center, 0, 2]
        for i in range(n):
            t = np.float32(i) / np.float32(n - 1)
            x = (1.0 - t) * shift_x
            y = (1.0 - t) * shift_y
            z = (1.0 - t) * shift_z
            for d in range(donors.shape[1]):
                weight = weights[s, d]
                if weight == 0.0:
                    continue
                a = donors[s, d]
                b = in_wisps[a]
                dx = in_strands[a, i, 0] - in_centers[b, i, 0]
                dy = in_strands[a, i, 1] - in_centers[b, i, 1]
                dz = in_strands[a, i, 2] - in_centers[b, i, 2]
                relative_x = dx - (in_strands[a, 0, 0] - in_centers[b, 0, 0])
                relative_y = dy - (in_strands[a, 0, 1] - in_centers[b, 0, 1])
                relative_z = dz - (in_strands[a, 0, 2] - in_centers[b, 0, 2])
                alpha = _turn_between(in_root_frames[b], out_root_frames[center], relative_x, relative_y, relative_z)
                beta = _turn_between(in_point_frames[b, i], out_point_frames[center, i], dx, dy, dz)
                x += weight * ((1.0 - t) * alpha[0] + t * beta[0])
                y += weight * ((1.0 - t) * alpha[1] + t * beta[1])
                z += weight * ((1.0 - t) * alpha[2] + t * beta[2])
            result[s, i, 0] = out_centers[center, i, 0] + x
            result[s, i, 1] = out_centers[center, i, 1] + y
            result[s, i, 2] = out_centers[center, i, 2] + z
        result[s, 0] = roots[s]
    return result
