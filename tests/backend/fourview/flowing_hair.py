"""A head of hair whose every direction is known: from the crown down over a ball, and straight down below it."""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np
from hairloom.fields.grid import DirectionGrid, dense_grid
from hairloom.fourview.views import View
from hairloom.geometry.camera import standard_camera
from hairloom.geometry.head import sphere_head
from hairloom.geometry.strands import from_dense
from hairloom.geometry.view_raster import raster_mesh
from hairloom.types import Mesh, StrandSet

HEAD, OUTER, BOTTOM = 0.09, 0.11, -0.12  # metres: radii of head and hair, height where the hair ends


@dataclass(frozen=True)
class Shape:
    closed: Mesh
    open: Mesh
    strands: StrandSet


def flow(points) -> np.ndarray:
    """(..., 3) unit: the way hair grows at points."""
    points = np.asarray(points, np.float64)
    out = points / np.maximum(np.linalg.norm(points, axis=-1, keepdims=True), 1e-9)
    out = np.where(points[..., 2:] > 0, out, 0.0)
    down = np.array([0.0, 0.0, -1.0]) + out[..., 2:] * out
    return down / np.maximum(np.linalg.norm(down, axis=-1, keepdims=True), 1e-9)


def outside(points) -> np.ndarray:
    """Signed distance to the hair's outer border: a ball on a cylinder that is cut off below."""
    points = np.asarray(points, np.float64)
    above = np.maximum(points[..., 2], 0.0)
    round_ = np.sqrt(points[..., 0] ** 2 + points[..., 1] ** 2 + above**2) - OUTER
    return np.maximum(round_, BOTTOM - points[..., 2])


def _grid(n):
    axis = np.linspace(-0.15, 0.15, n)
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)


def _compact(vertices, triangles) -> Mesh:
    used, numbered = np.unique(triangles, return_inverse=True)
    return Mesh(vertices[used].astype(np.float32), numbered.reshape(-1, 3).astype(np.int32))


def make_shape(n: int = 72) -> Shape:
    """The hair's closed shape, hollow where the head is, and its outer surface without the cut below."""
    nodes = _grid(n)
    level = np.maximum(outside(nodes), HEAD - 0.002 - np.linalg.norm(nodes, axis=-1))
    vertices, triangles = igl.marching_cubes(level.ravel(), nodes.reshape(-1, 3), n, n, n, 0.0)[:2]
    corners = vertices[triangles]
    volume = np.einsum("fc,fc->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    triangles = triangles if volume > 0 else triangles[:, ::-1]
    middle = vertices[triangles].mean(axis=1)
    outer = (np.abs(outside(middle)) < 0.002) & (middle[:, 2] > BOTTOM + 0.003)
    return Shape(_compact(vertices, triangles), _compact(vertices, triangles[outer]),
                 from_dense(np.empty((0, 2, 3), np.float32)))  # fmt: skip


def make_volume(n: int = 60, sign: float = 1.0) -> DirectionGrid:
    """Known directions in the cells of the hair, none elsewhere."""
    spacing = 0.3 / n
    cells = _grid(n + 1)[:-1, :-1, :-1] + 0.5 * spacing
    inside = (outside(cells) < spacing) & (np.linalg.norm(cells, axis=-1) > HEAD - spacing)
    directions = np.where(inside[..., None], sign * flow(cells), 0.0)
    return dense_grid(directions.astype(np.float32), np.full(3, -0.15), spacing)


def make_views(shape: Shape, names=("front", "back", "left", "right"), size: int = 200, image=None) -> list[View]:
    """The shape's outlines as masks."""
    views = []
    for name in names:
        camera = standard_camera(name, (0.0, 0.0, -0.01), 3.2 * size, (size, size))
        mask = raster_mesh(camera, shape.closed.vertices, shape.closed.triangles).triangle >= 0
        picture = np.zeros((size, size, 3), np.uint8) if image is None else image
        views.append(View(name, picture, mask, camera))
    return views


def make_head():
    return sphere_head(HEAD, n_rings=32)
