"""Shapes like a head of hair for the tests of the surface: known, bumpy, open, closed, in pieces."""

from __future__ import annotations

import igl
import numpy as np
from hairloom.fourview.views import View
from hairloom.geometry.camera import standard_camera
from hairloom.geometry.view_raster import raster_mesh
from hairloom.types import Mesh

RADII = np.array([0.10, 0.11, 0.13])


def compact(vertices, triangles) -> Mesh:
    used, numbered = np.unique(triangles, return_inverse=True)
    return Mesh(np.asarray(vertices[used], np.float32), numbered.reshape(-1, 3).astype(np.int32))


def ellipsoid(n: int = 48, bumps: float = 0.0) -> Mesh:
    """A closed ellipsoid of RADII, metres, by marching cubes on n^3, with bumps of that height."""
    axis = np.linspace(-0.15, 0.15, n)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    level = (np.linalg.norm(points / RADII, axis=1) - 1) * RADII.min()
    level -= bumps * np.sin(60 * points[:, 0]) * np.sin(50 * points[:, 1] + 1) * np.cos(45 * points[:, 2])
    vertices, triangles = igl.marching_cubes(level, points, n, n, n, 0.0)[:2]
    corners = vertices[triangles]
    outwards = np.einsum(
        "fc,fc->f", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners[:, 0]
    )
    return compact(vertices, triangles if outwards.sum() > 0 else triangles[:, ::-1])


def hair_shape(n: int = 48, bumps: float = 0.004) -> tuple[Mesh, Mesh]:
    """(open, closed): the ellipsoid without its face and neck, whose edge is as ragged as the triangles are."""
    closed = ellipsoid(n, bumps)
    middle = closed.vertices[closed.triangles].mean(axis=1)
    keep = ~((middle[:, 1] < -0.03) & (middle[:, 2] < 0.05)) & (middle[:, 2] > -0.09)
    return compact(closed.vertices, closed.triangles[keep]), closed


def paint(points) -> np.ndarray:
    """(..., 3) in [0, 1]: a smooth known colour of every point in space."""
    return 0.5 + 0.3 * np.sin(np.asarray(points, np.float64) * [70.0, 60.0, 80.0] + [0.3, 1.0, 2.0])


def painted_views(open_mesh: Mesh, closed: Mesh, names=("front", "back", "left", "right"), size: int = 200):
    """Views of the closed shape in `paint`, the hair mask where the open part shows, the rest magenta."""
    views = []
    for name in names:
        camera = standard_camera(name, (0, 0, 0), 3.2 * size, (size, size))
        whole = raster_mesh(camera, closed.vertices, closed.triangles)
        part = raster_mesh(camera, open_mesh.vertices, open_mesh.triangles)
        with np.errstate(invalid="ignore"):
            mask = (part.triangle >= 0) & (part.depth - whole.depth < 1e-4)
        corners = closed.vertices[closed.triangles[np.maximum(whole.triangle, 0)]]
        image = np.rint(255 * paint((corners * whole.barycentric[..., None]).sum(axis=-2))).astype(np.uint8)
        image[~mask] = (255, 0, 255)
        views.append(View(name, image, mask, camera))
    return views
