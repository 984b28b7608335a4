"""Hair on a head: where its roots lie on the surface, so that Blender's sculpt brushes and hair nodes know it."""

from __future__ import annotations

import bpy
import numpy as np

from ..backend.errors import require
from ..backend.geometry.head import HeadSurface
from ..backend.types import StrandSet
from . import curves, mesh


def attach_to_head(groom: bpy.types.Object, head: bpy.types.Object, *, snap: bool = False) -> float:
    """Attach a groom to a head mesh at the closest points of its surface.

    With `snap` each strand moves as a whole until its root lies on the surface; else nothing moves.

    Returns
    -------
    The largest distance of a root from the surface before, metres.

    Raises
    ------
    InputError : a groom without strands, or a head without faces or UV map.
    """
    uv_map = mesh.active_uv_map(head)
    strands = curves.read_strands(groom)
    require(strands.n_strands, f"'{groom.name}' has no strands to attach; choose a groom that has")
    surface = HeadSurface(mesh.read_head(head))
    closest, triangle, barycentric = surface.closest_points(strands.roots)
    moves = closest - strands.roots
    if snap:
        moved = strands.points + np.repeat(moves, strands.point_counts, axis=0)
        snapped = StrandSet(moved, strands.offsets, strands.point_attributes, strands.strand_attributes)
        curves.replace_strands(groom, snapped)
    curves.attach(groom, head, uv_map, surface.uv_at(triangle, barycentric))
    return float(np.linalg.norm(moves, axis=1).max())


def attach_at(groom: bpy.types.Object, head: bpy.types.Object, triangle: np.ndarray, barycentric: np.ndarray) -> None:
    """Attach a groom whose roots are known: triangle (S,) int32 of `read_head`'s order and barycentric (S, 3)."""
    corner_uv = mesh.read_head(head).corner_uv
    uv = np.einsum("nk,nkc->nc", barycentric, corner_uv[triangle]).astype(np.float32)
    curves.attach(groom, head, mesh.active_uv_map(head), uv)
