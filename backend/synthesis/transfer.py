"""Cluster-oriented detail transfer (Wang et al. 2009, sec. 5.2; W-21 to W-24).

An output strand gets its shape from its center strand plus the displacement that some input strand has from the center
of its own wisp. Input and output meet in per-strand-aligned frames, so that the way a wisp points does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..errors import require
from ..geometry._grouping_kernels import list_members
from ..geometry.frames import transport_frames
from ..types import Float32, Int32, RootedStrands, WispHierarchy
from ._transfer_kernels import find_donors, transfer_displacements
from .features import fit_features


@dataclass(frozen=True, slots=True)
class TransferParams:
    """Settings of transfer_details. Defaults live here only."""

    n_features: int = 16  # n_f, PCA dimensions of the search for the most similar wisp
    n_donors: int = 1  # input strands blended into an output strand; the paper takes 1

    def __post_init__(self) -> None:
        require(self.n_features >= 1, f"n_features is {self.n_features}; it must be 1 or more")
        require(1 <= self.n_donors <= 16, f"n_donors is {self.n_donors}; it must be in 1..16")


@dataclass(frozen=True, slots=True)
class TransferResult:
    """What transfer_details made.

    strands : S output strands in their root frames.
    wisps : (S,) int32, the output center of each strand.
    matches : (K,) int32, the input wisp matched with each output center.
    donors : (S, D) int32, the input strands each output strand took its displacement from, best first.
    """

    strands: RootedStrands
    wisps: Int32
    matches: Int32
    donors: Int32


def align_frames(strands: RootedStrands) -> tuple[Float32, Float32]:
    """Per-strand-aligned frames (sec. 5.2, eq. 4; W-22).

    The root frame turned about its normal until its tangent points along the strand's average tangent vector, projected
    onto the scalp's tangent plane. A strand that stands straight up keeps its root frame.

    Returns
    -------
    frames : (S, 3, 3) float32, columns tangent, normal, binormal, head space.
    points : (S, N, 3) float32, the strands in these frames, head radii.
    """
    along = strands.points[:, 1:].sum(axis=1, dtype=np.float64)  # v_g before normalisation, root frame
    planar = np.hypot(along[:, 0], along[:, 2])
    upright = planar <= 1e-6 * np.linalg.norm(along, axis=1)
    safe = np.where(upright, 1.0, planar)
    cos = np.where(upright, 1.0, along[:, 0] / safe)
    sin = np.where(upright, 0.0, along[:, 2] / safe)
    # columns of `turn` are the new axes in the old frame; handedness (tangent x normal = binormal) is kept
    turn = np.zeros((strands.n_strands, 3, 3))
    turn[:, 0, 0], turn[:, 2, 0] = cos, sin
    turn[:, 1, 1] = 1.0
    turn[:, 0, 2], turn[:, 2, 2] = -sin, cos
    turned = turn.astype(np.float32)
    return np.matmul(strands.frames, turned), np.matmul(strands.points, turned)


def assign_to_centers(strands_uv: Float32, centers_uv: Float32) -> Int32:
    """(S,) int32: the center whose root is nearest in (u, v) (Kim & Neumann 2002; W-21, M-5)."""
    require(len(centers_uv) > 0, "there is no center strand to assign strands to")
    return np.asarray(cKDTree(centers_uv).query(strands_uv)[1], dtype=np.int32)


def match_wisps(out_centers: RootedStrands, in_centers: RootedStrands, n_features: int = 16) -> Int32:
    """For each output center the input center of most similar shape (W-22).

    Compared in per-strand-aligned frames by the first `n_features` principal components of both sets together.

    Returns
    -------
    (K_out,) int32, indices of input centers.
    """
    require(out_centers.n_points == in_centers.n_points, "input and output strands must have the same number of points")
    aligned_in, aligned_out = align_frames(in_centers)[1], align_frames(out_centers)[1]
    basis = fit_features(np.concatenate([aligned_in, aligned_out]), n_features)
    tree = cKDTree(basis.encode(aligned_in))
    return np.asarray(tree.query(basis.encode(aligned_out))[1], dtype=np.int32)


def root_offsets(roots: Float32, wisps: Int32, centers: RootedStrands, frames: Float32) -> Float32:
    """(S, 3) float32: displacement of each root from its center's root, in the center's aligned frame."""
    offsets = roots - centers.roots[wisps]
    return np.asarray(np.einsum("sij,si->sj", frames[wisps], offsets), dtype=np.float32)


def point_frames(centers_in_head_space: Float32, aligned: Float32) -> Float32:
    """(K, N, 3, 3) float32: frames along the center strands (M-6, W-A1).

    The start is the aligned binormal: it is orthogonal to the plane in which the strand mostly bends, so, unlike the
    scalp normal, it is never parallel to a hair that leaves the scalp straight up.
    """
    return transport_frames(centers_in_head_space, np.ascontiguousarray(aligned[:, :, 2]))


def donor_weights(distances: Float32) -> Float32:
    """(S, D) float32, rows sum to 1: inverse squared distance, an exact hit takes all; missing donors weigh nothing."""
    nearest = distances[:, :1]
    # relative to the typical distance of this strand's donors, so that the blend does not depend on the unit
    softening = 1e-6 * np.where(np.isfinite(distances), distances, 0.0).max(axis=1, keepdims=True) + 1e-20
    weights = np.where(np.isfinite(distances), 1.0 / (distances + softening), 0.0)
    weights[(nearest == 0.0).ravel()] = np.eye(1, distances.shape[1])
    return np.asarray(weights / weights.sum(axis=1, keepdims=True), dtype=np.float32)


def transfer_details(
    example: WispHierarchy,
    level: int,
    centers: RootedStrands,
    roots: RootedStrands,
    params: TransferParams = TransferParams(),
    *,
    wisps: Int32 | None = None,
) -> TransferResult:
    """Give the strands of one output level their shape: center strand plus displacements of the example.

    Each output strand belongs to the nearest center (W-21); each center is matched with the input wisp of most similar
    center (W-22); within it the input strand with the most similar root displacement is the donor. Its relative (eq.
    5) and absolute (eq. 6) displacements are blended from root to tip (eqs. 7 and 8 as corrected; W-23, W-24).

    Parameters
    ----------
    example : the input hairstyle; its wisps of `level` (0 <= level < n_levels - 1) are the source.
    centers : K output strands of level + 1.
    roots : S output strands of `level`, of which only roots, frames and uv are used.
    wisps : (S,) int32, the center of each output strand; None assigns by root distance.

    Raises
    ------
    InputError : no such level, or strands of different point counts.
    """
    require(
        0 <= level < example.n_levels - 1, f"the example has no wisps at level {level}; use 0..{example.n_levels - 2}"
    )
    fine, coarse, in_wisps = example.levels[level], example.levels[level + 1], example.labels[level]
    if wisps is None:
        wisps = assign_to_centers(roots.uv, centers.uv)
    require(wisps.shape == (roots.n_strands,), "wisps must name a center for every output strand")
    matches = match_wisps(centers, coarse, params.n_features)
    in_frames, out_frames = align_frames(coarse)[0], align_frames(centers)[0]
    starts, members = list_members(in_wisps, coarse.n_strands)
    require((np.diff(starts) > 0).all(), f"a wisp of the example's level {level} has no strands; cluster it again")
    donors, distances = find_donors(
        root_offsets(roots.roots, wisps, centers, out_frames),
        matches[wisps],
        root_offsets(fine.roots, in_wisps, coarse, in_frames),
        members,
        starts,
        params.n_donors,
    )
    in_centers, out_centers = coarse.in_head_space(), centers.in_head_space()
    moved = transfer_displacements(
        roots.roots, wisps, out_centers, out_frames, point_frames(out_centers, out_frames),
        donors, donor_weights(distances),
        fine.in_head_space(), in_wisps, in_centers, in_frames, point_frames(in_centers, in_frames),
    )  # fmt: skip
    local = np.matmul(moved - roots.roots[:, None, :], roots.frames)
    return TransferResult(roots.with_points(local), wisps, matches, donors)
