"""Stand-ins for the tests of directions: an ellipsoid with an atlas of six charts, turned and scaled unevenly."""

import numpy as np
from hairloom.fourview.texels import TexelMap
from hairloom.types import Mesh
from scipy.spatial import cKDTree

RADII = (0.09, 0.11, 0.13)


def cube_charts(side):
    """(6, side, side, 3) unit directions of the texels' middles, each chart turned by another right angle."""
    t = np.tan((np.arange(side) + 0.5) / side * np.pi / 2 - np.pi / 4)
    u, v = np.meshgrid(t, t, indexing="xy")
    one = np.ones_like(u)
    faces = [(one, u, v), (-one, -u, v), (-u, one, v), (u, -one, v), (v, u, one), (-v, u, -one)]
    cells = np.stack([np.stack(face, axis=-1) for face in faces])
    cells = np.stack([np.rot90(cell, k, (0, 1)) for k, cell in enumerate(cells)])
    return cells / np.linalg.norm(cells, axis=-1, keepdims=True)


def ellipsoid_texels(side=96, gutter=2, radii=RADII):
    """A TexelMap of an ellipsoid around the origin; charts are `side` texels wide with a gutter between."""
    size = 3 * (side + gutter)
    grid = np.full((size, size), -1)
    unit = cube_charts(side)
    points, places = [], []
    for k in range(6):
        row, column = (k // 3) * (side + gutter), (k % 3) * (side + gutter)
        rows, columns = np.mgrid[row : row + side, column : column + side]
        places.append((rows * size + columns).ravel())
        points.append(unit[k].reshape(-1, 3))
    order = np.argsort(np.concatenate(places))
    texels = np.concatenate(places)[order].astype(np.int32)
    sphere = np.concatenate(points)[order]
    points = (sphere * radii).astype(np.float32)
    normals = sphere / radii
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    grid.ravel()[texels] = np.arange(len(texels))
    pairs = []
    for a, b in ((grid[:, :-1], grid[:, 1:]), (grid[:-1], grid[1:])):
        both = (a >= 0) & (b >= 0)
        pairs.append(np.stack([a[both], b[both]], axis=1))
    inner = np.concatenate(pairs)
    spacing = float(np.median(np.linalg.norm(points[inner[:, 0]] - points[inner[:, 1]], axis=1)))
    degree = np.bincount(inner.ravel(), minlength=len(texels))
    border = np.flatnonzero(degree < 4)
    near = cKDTree(points[border]).query_pairs(1.2 * spacing, output_type="ndarray")
    edges = np.unique(np.sort(np.concatenate([inner, border[near]]), axis=1), axis=0).astype(np.int32)
    count = len(texels)
    return TexelMap(
        size, texels, np.zeros(count, np.int32), np.tile(np.float32([1, 0, 0]), (count, 1)), points, normals, spacing,
        edges,
    )  # fmt: skip


def ellipsoid_mesh(radii=RADII, n_rings=48):
    """A closed mesh of the same ellipsoid."""
    from hairloom.geometry.analytic_heads import sphere_head

    sphere = sphere_head(1.0, n_rings=n_rings)
    return Mesh((sphere.vertices * np.float32(radii)).astype(np.float32), sphere.triangles)


def level_lines(normals, gradient):
    """(T, 3) unit directions on the surface along which a function with gradient (3,) or (T, 3) does not change."""
    lines = np.cross(normals, np.broadcast_to(gradient, normals.shape))
    return lines / np.maximum(np.linalg.norm(lines, axis=1, keepdims=True), 1e-9)


def degrees_between(a, b, *, signed=False):
    """(n,) angles between unit vectors (n, 3)."""
    cosine = np.einsum("nc,nc->n", a, b)
    return np.degrees(np.arccos(np.clip(cosine if signed else np.abs(cosine), -1, 1)))
