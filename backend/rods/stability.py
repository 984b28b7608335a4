"""Is a rod's equilibrium stable? The smallest eigenvalue of its energy's Hessian, relative to its stiffness (M-26)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Bools, Float64, Int64
from . import _equilibrium_kernels as kernels
from .statics import LoadStiffness

# Rods whose matrices are held at once; bounds the memory to some 100 MB.
_CHUNK = 512


@dataclass(frozen=True, slots=True)
class HeldLegs:
    """Points of rods that contacts hold: L legs, sorted by rod.

    leg_offsets : (S + 1,) int64. row_offsets : (L + 1,) int64; row_elements : (r,) int64; rows : (r, 3, 3) of H in the
    contacts' axes. is_held : (L, 3), the axes along which the leg cannot move.
    """

    leg_offsets: Int64
    row_offsets: Int64
    row_elements: Int64
    rows: Float64
    is_held: Bools


def smallest_eigenvalues(
    offsets: Int64, stiffness: Float64, change: LoadStiffness, held: HeldLegs | None = None
) -> Float64:
    """(S,) smallest eigenvalue of A - df/dq relative to A for each rod; above 0 it is stable, 1 is without loads.

    offsets : (S + 1,). stiffness : (E, 3) diagonal of A, N m^3. change : df/dq of the loads.
    held : directions in which no motion is possible are left out (they count as 1). Other rods in contact are taken
    to stand still.
    """
    counts = np.diff(offsets)
    result = np.ones(len(counts))
    root = np.sqrt(stiffness)
    basis_offsets = np.concatenate([[0], np.cumsum((3 * counts) ** 2)]).astype(np.int64)
    basis = np.zeros(0)
    if held is not None:
        basis = np.zeros(basis_offsets[-1])
        kernels.held_directions(
            offsets,
            held.leg_offsets,
            held.row_offsets,
            held.row_elements,
            held.rows,
            held.is_held,
            1.0 / stiffness,
            basis_offsets,
            basis,
        )
    for count in np.unique(counts):
        members = np.flatnonzero(counts == count)
        for chunk in np.array_split(members, -(-len(members) // _CHUNK)):
            first = offsets[chunk]
            size = 3 * int(count)
            scale = root[first[:, None] + np.arange(count)].reshape(-1, size)
            matrices = change.dense(first, int(count)) / (scale[:, :, None] * scale[:, None, :])
            if held is not None:
                directions = basis[basis_offsets[chunk][:, None] + np.arange(size**2)].reshape(-1, size, size)
                free = np.eye(size) - np.swapaxes(directions, 1, 2) @ directions
                matrices = free @ matrices @ free
            result[chunk] = 1.0 - np.linalg.eigvalsh(matrices)[:, -1]
    return result
