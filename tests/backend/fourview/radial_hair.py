"""Hair that stands off a ball: shapes, views and masks that are known exactly, for the tests of the rough shape."""

import numpy as np
from hairloom.fourview.views import View
from hairloom.geometry.analytic_heads import sphere_head
from hairloom.geometry.camera import perspective_camera, standard_camera
from hairloom.geometry.strands import from_dense
from hairloom.geometry.view_raster import raster_mesh
from hairloom.types import Mesh

RADIUS = 0.1
HEAD = sphere_head(RADIUS, n_rings=32)
SIZE = (240, 240)
FOUR = ("front", "back", "left", "right")


def radial_strands(n_strands=500, length=0.04, stretch=(1.0, 1.0, 1.0)):
    """Strands straight off the upper half of the head, their tips on a stretched sphere."""
    step = np.arange(n_strands) + 0.5
    height = 1.0 - step / n_strands
    angle = step * np.pi * (1.0 + 5.0**0.5)
    across = np.sqrt(1.0 - height**2)
    directions = np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)
    roots, tips = RADIUS * directions, (RADIUS + length) * directions * np.asarray(stretch)
    share = np.linspace(0.0, 1.0, 9)[None, :, None]
    return from_dense(roots[:, None] * (1.0 - share) + tips[:, None] * share)


def dome(outer, stretch=(1.0, 1.0, 1.0), n_rings=48):
    """The outer surface of the upper half of a stretched ball, closed below by a disc."""
    head = sphere_head(1.0, n_rings=n_rings)
    vertices = head.vertices.astype(np.float64)
    vertices[:, 2] = np.maximum(vertices[:, 2], 0.0)
    return Mesh((vertices * outer * np.asarray(stretch)).astype(np.float32), head.triangles)


def camera(name, size=SIZE, perspective=False):
    """A standard camera 0.5 m wide around the head; with perspective 1.5 m away."""
    usual = standard_camera(name, (0.0, 0.0, 0.03), size[0] / 0.5, size)
    if not perspective:
        return usual
    direction = usual.world_to_camera[2, :3]
    position = np.array([0.0, 0.0, 0.03]) - 1.5 * direction
    up = -usual.world_to_camera[1, :3]
    return perspective_camera(position, (0.0, 0.0, 0.03), 1.5 * size[0] / 0.5, size, up)


def view(name, mesh, size=SIZE, perspective=False):
    """A view whose mask is what the mesh shows before the head."""
    where = camera(name, size, perspective)
    depth = raster_mesh(where, HEAD.vertices, HEAD.triangles).depth
    mask = raster_mesh(where, mesh.vertices, mesh.triangles).depth < depth
    return View(name, np.zeros((size[1], size[0], 3), np.uint8), mask, where)


def views(mesh, names=FOUR, perspective=False):
    return [view(name, mesh, perspective=perspective) for name in names]


def overlap(view, mesh):
    """Intersection over union of the mesh, as the view sees it before the head, and the view's mask."""
    depth = raster_mesh(view.camera, HEAD.vertices, HEAD.triangles).depth
    seen = raster_mesh(view.camera, mesh.vertices, mesh.triangles).depth < depth
    return (seen & view.mask).sum() / (seen | view.mask).sum()


def boundary_edges(triangles):
    """How many edges do not have two triangles that run along them opposite ways."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there = {tuple(edge) for edge in edges.tolist()}
    return len(edges) - sum((b, a) in there for a, b in there)


def volume(mesh):
    corners = mesh.vertices[mesh.triangles].astype(np.float64)
    return np.einsum("fc,fc->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
