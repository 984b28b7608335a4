"""A cylinder as a hair surface, with everything in closed form: texels, patches, and photos of a pattern on it."""

import numpy as np
from hairloom.fourview.projection import ViewsOnTexels
from hairloom.fourview.surface import HairSurface, Level
from hairloom.fourview.texels import TexelMap
from hairloom.fourview.views import View
from hairloom.geometry.camera import project, standard_camera
from hairloom.types import Mesh

RADIUS = 0.1
PIXELS_PER_METRE = 1200.0
SIZE = (300, 360)
# the angle about z of the direction towards each view's camera
TOWARDS = {"front": -0.5 * np.pi, "left": 0.0, "back": 0.5 * np.pi, "right": np.pi}


def stripes(theta, z, *, slope=1.0, period=0.012):
    """Diagonal stripes that close around the cylinder, with slow shades: (..., 3) in [0, 1]."""
    turns = np.round(2 * np.pi * RADIUS * slope / period)
    phase = turns * theta + 2 * np.pi * z / period
    wave = 0.5 + 0.35 * np.sin(phase)
    return np.stack([wave, 0.8 * wave, 0.6 * wave], axis=-1)


def make_level(size, patch_size=10, stride=5):
    """The texture covers rows 0.3 ... 0.7 of a size x size atlas, all columns; column 0 joins the last."""
    spacing = 2 * np.pi * RADIUS / size
    rows = np.arange(round(0.3 * size), round(0.7 * size))
    row, column = np.meshgrid(rows, np.arange(size), indexing="ij")
    theta = -(column.ravel() + 0.5) / size * 2 * np.pi
    z = (0.5 * size - row.ravel() - 0.5) * spacing
    normals = np.stack([np.cos(theta), np.sin(theta), 0 * theta], axis=1)
    points = RADIUS * normals + z[:, None] * np.array([0, 0, 1.0])
    index = np.arange(row.size).reshape(row.shape)
    right = np.stack([index.ravel(), np.roll(index, -1, axis=1).ravel()], axis=1)
    edges = np.concatenate([np.sort(right, axis=1), np.stack([index[:-1].ravel(), index[1:].ravel()], axis=1)])
    edges = edges[np.lexsort((edges[:, 1], edges[:, 0]))]
    flat = (row.ravel() * size + column.ravel()).astype(np.int32)
    texels = TexelMap(
        size, flat, np.zeros(row.size, np.int32), np.tile(np.float32([1, 0, 0]), (row.size, 1)),
        points.astype(np.float32), normals.astype(np.float32), spacing, edges.astype(np.int32),
    )  # fmt: skip
    return _with_vertices(texels, index, rows, size, spacing, patch_size, stride)


def _with_vertices(texels, index, rows, size, spacing, patch_size, stride):
    height = len(rows) // stride
    i, j = np.meshgrid(np.arange(height), np.arange(size // stride), indexing="ij")
    chosen = index[i * stride + stride // 2, j * stride + stride // 2].ravel()
    vertices, normals = texels.points[chosen], texels.normals[chosen]
    tangents = np.stack([normals[:, 1], -normals[:, 0], 0 * normals[:, 0]], axis=1).astype(np.float32)
    bitangents = np.cross(normals, tangents).astype(np.float32)
    offset = np.arange(patch_size) - 0.5 * (patch_size - 1)
    # along the normal onto the cylinder: the angle's tangent is the offset by the radius
    across = np.arctan(offset * spacing / RADIUS) * size / (2 * np.pi)
    column = (j.ravel() * stride + stride // 2 + 0.5)[:, None] + across
    line = (i.ravel() * stride + stride // 2 + 0.5)[:, None] + offset
    column = np.floor(column).astype(int) % size
    line = np.floor(line).astype(int)
    cells = np.where(
        ((line >= 0) & (line < len(rows)))[:, :, None],
        index[np.clip(line, 0, len(rows) - 1)[:, :, None], column[:, None, :]],
        -1,
    )
    number = np.arange(i.size).reshape(i.shape)
    rings = []
    for a in range(height):
        for b in range(i.shape[1]):
            ring = [number[a, (b - 1) % i.shape[1]], number[a, (b + 1) % i.shape[1]]]
            ring += [number[a + d, b] for d in (-1, 1) if 0 <= a + d < height]
            rings.append(ring)
    offsets = np.concatenate([[0], np.cumsum([len(ring) for ring in rings])]).astype(np.int32)
    return Level(
        texels, vertices, normals, tangents, bitangents, offsets, np.concatenate(rings).astype(np.int32),
        np.arange(i.size, dtype=np.int32), cells.reshape(i.size, -1).astype(np.int32),
    )  # fmt: skip


def make_surface(sizes, **more):
    """A HairSurface; its mesh is no more than a triangle, nothing here looks at it."""
    mesh = Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32))
    levels = tuple(make_level(size, **more) for size in sizes)
    return HairSurface(mesh, np.tile(np.float32([0, 0, 1]), (3, 1)), np.zeros((1, 3, 2), np.float32), levels)


def make_view(name, pattern=stripes):
    """The photo of the cylinder with `pattern(theta, z)`; beyond it a garish background."""
    camera = standard_camera(name, np.zeros(3), PIXELS_PER_METRE, SIZE)
    width, height = SIZE
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    aside = (x - 0.5 * width) / PIXELS_PER_METRE / RADIUS
    inside = np.abs(aside) < 1
    # seen from outside the picture's right is the direction of growing angle
    theta = TOWARDS[name] + np.arcsin(np.clip(aside, -1, 1))
    colour = pattern(theta, (0.5 * height - y) / PIXELS_PER_METRE)
    image = np.where(inside[..., None], colour, [1.0, 0.0, 1.0])
    return View(name, np.rint(image * 255).astype(np.uint8), inside, camera)


def look(level, views, angle=np.pi / 4):
    """ViewsOnTexels in closed form: a cylinder hides nothing that faces the view."""
    texels = level.texels
    pixels = np.stack([project(view.camera, texels.points)[:, :2] for view in views]).astype(np.float32)
    facing = np.stack([
        texels.normals @ np.array([np.cos(TOWARDS[view.name]), np.sin(TOWARDS[view.name]), 0]) for view in views
    ])  # fmt: skip
    return ViewsOnTexels(pixels, facing > 0.05, facing > np.cos(angle), np.maximum(facing, 0).astype(np.float32))
