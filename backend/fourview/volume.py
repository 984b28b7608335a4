"""Fields inside the hair, from what is known on its surface (Zhang et al. 2017, sec. 4.4 and 4.6; Z-20, Z-23).

min sum |grad D|^2 + w sum over the surface |D - d|^2 + v sum over the roots |D - n|^2 on the voxels of the hair, n
being the scalp's normals: a screened Laplace equation (M-38), solved by `fields.diffusion`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion, distance_transform_edt, generate_binary_structure

from ..errors import require
from ..fields.diffusion import DiffusionSolver
from ..fields.grid import DirectionGrid, dense_grid
from ..geometry.head import HeadSurface
from ..geometry.roots import scatter_roots
from ..types import Bools, Float32, Float64, Floats, Head, Int64
from .directions import DirectionParams, Shape, SurfaceDirections
from .solid import Voxels, head_voxels, mesh_voxels, point_voxels

_MARGIN = 2  # voxels beyond the surface that directions go on for, so that tracing does not end early
_SCALP_GAP = 0.015  # metres over the scalp that count as hair: the shape may begin a little above it
_AROUND = generate_binary_structure(3, 2)
_ROOTS = 4000
_DEEP = 2  # voxels under the head's skin from where there is no hair


@dataclass(frozen=True, slots=True)
class HairVoxels:
    """The voxels of hair.

    origin : (3,) float64, metres, world space, the middle of voxel (0, 0, 0). cell : metres, a voxel's edge.
    inside : (X, Y, Z) bool.
    """

    origin: Float64
    cell: float
    inside: Bools

    def places(self, points: Floats) -> Int64:
        """(n,) the voxel that each point (n, 3) lies in, as a flat index; -1 for those off the hair."""
        nearest = np.rint((np.asarray(points, np.float64).reshape(-1, 3) - self.origin) / self.cell).astype(np.int64)
        within = ((nearest >= 0) & (nearest < self.inside.shape)).all(axis=1)
        flat = np.ravel_multi_index(tuple(np.where(within[:, None], nearest, 0).T), self.inside.shape)
        return np.where(within & self.inside.ravel()[flat], flat, -1)


def direction_volume(
    directions: SurfaceDirections, shape: Shape, head: Head, params: DirectionParams = DirectionParams()
) -> DirectionGrid:
    """Directions from root to tip in the voxels of the hair (Z-20, M-38).

    Returns
    -------
    A dense grid in world space, metres, of unit directions; 0 outside the hair and two voxels around it.

    Raises
    ------
    InputError : a shape without an inside, or directions that all lie off it.
    """
    voxels = _hair_voxels(shape, head, params.cells)
    roots, normals = _roots(head)
    known = [
        (directions.points, directions.directions, params.surface_weight * (0.05 + 0.95 * directions.confidence)),
        (roots, normals, np.full(len(roots), params.root_weight)),
    ]
    return _volume(voxels, known)


def normal_volume(
    directions: SurfaceDirections, shape: Shape, head: Head, params: DirectionParams = DirectionParams()
) -> DirectionGrid:
    """Normals of the surface carried into the hair (Z-23), on the voxels of `direction_volume`.

    Under the hair the scalp's own normals count as those of the surface.
    """
    voxels = _hair_voxels(shape, head, params.cells)
    roots, normals = _roots(head)
    known = [
        (directions.points, directions.normals, np.full(len(directions.points), params.surface_weight)),
        (roots, normals, np.full(len(roots), params.root_weight)),
    ]
    return _volume(voxels, known)


def _hair_voxels(shape: Shape, head: Head, cells: int) -> HairVoxels:
    """The voxels in the closed shape or a little over the scalp, `_MARGIN` around them, not deep in the head."""
    require(len(shape.closed.triangles) > 0, "the hair shape is empty; run the shape step again")
    scalp = head.vertices[np.unique(head.triangles[head.scalp])] if head.scalp.any() else head.vertices[:0]
    every = np.concatenate([shape.closed.vertices, scalp]).astype(np.float64)
    low, high = every.min(axis=0), every.max(axis=0)
    cell = float((high - low).max()) / cells
    count = cells + 2 * (_MARGIN + 2)
    cube = Voxels(0.5 * (low + high) - 0.5 * cell * (count - 1), cell, count)
    inside = mesh_voxels(shape.closed.vertices, shape.closed.triangles, cube)
    require(inside.any(), "the hair shape has no inside; run the shape step again")
    skull = head_voxels(head, cube)
    on_scalp = point_voxels(cube.indices(scalp), cube)
    rows = [np.flatnonzero((inside | on_scalp).any(axis=axes)) for axes in ((1, 2), (0, 2), (0, 1))]
    steps = max(round(_SCALP_GAP / cell), 1)
    # of the cube, the box around all hair
    starts = [max(int(row[0]) - steps - _MARGIN - 1, 0) for row in rows]
    window = tuple(slice(start, int(row[-1]) + steps + _MARGIN + 2) for start, row in zip(starts, rows))
    hair = inside[window]
    if len(scalp):
        # without these hair whose root lies a little below the shape would have no way into it
        hair = hair | (distance_transform_edt(~on_scalp[window]) <= steps)
    deep = binary_erosion(skull[window], iterations=_DEEP, border_value=1)
    return HairVoxels(cube.origin + cell * np.array(starts), cell, binary_dilation(hair, _AROUND, _MARGIN) & ~deep)


def _roots(head: Head) -> tuple[Float32, Float32]:
    """Even places (n, 3) on the scalp and the scalp's unit normals there; none without a scalp."""
    if not head.scalp.any():
        return np.empty((0, 3), np.float32), np.empty((0, 3), np.float32)
    roots = scatter_roots(head, head.scalp, _ROOTS, 0, iterations=2)
    return roots.points, HeadSurface(head).normals_at(roots.triangles, roots.barycentric)


def _volume(voxels: HairVoxels, known: Sequence[tuple[Floats, Floats, Floats]]) -> DirectionGrid:
    """Unit vectors on the voxels inside, from (points, vectors, weights) of what is known."""
    inside = voxels.inside
    weights, values = np.zeros(inside.size), np.zeros((inside.size, 3))
    for points, vectors, weight in known:
        place = voxels.places(points)
        on = place >= 0
        count = np.bincount(place[on], minlength=inside.size)
        # as many points as there may be in a voxel, together they weigh like one
        share = weight[on] / count[place[on]]
        weights += np.bincount(place[on], share, inside.size)
        for c in range(3):
            values[:, c] += np.bincount(place[on], share * vectors[on, c], inside.size)
    met = np.flatnonzero(weights)
    require(len(met) > 0, "no direction lies in the hair shape; run the directions step again")
    values[met] /= weights[met, None]
    solver = DiffusionSolver(np.zeros_like(inside), inside, weights.reshape(inside.shape).astype(np.float32))
    solved = solver.solve(values.reshape(*inside.shape, 3).astype(np.float32), tolerance=1e-4).values
    length = np.linalg.norm(solved, axis=3, keepdims=True)
    directions = np.where(length > 1e-6, solved / np.maximum(length, 1e-6), np.float32(0))
    return dense_grid(directions, voxels.origin - 0.5 * voxels.cell, voxels.cell)
