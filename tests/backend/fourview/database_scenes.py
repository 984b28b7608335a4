"""Small hairstyles and views for the tests of the database."""

from __future__ import annotations

import numpy as np
from hairloom.fourview.database_fit import frame_of_head
from hairloom.fourview.database_masks import CLOSING, backdrop, render_mask
from hairloom.fourview.views import View
from hairloom.geometry.camera import standard_camera
from hairloom.geometry.roots import scatter_roots
from hairloom.geometry.strands import from_dense, resample
from hairloom.types import Camera, Head, StrandSet

# name: how long strands are, and how far they go out and down for it, head radii
SHAPES = {
    "cap": (0.15, 1.0, 0.0),
    "ball": (0.9, 1.0, 0.0),
    "long": (3.5, 0.12, 1.0),
    "tent": (2.0, 1.0, 1.0),
    "half": (3.5, 0.12, 1.0),
}


def simple_hair(head: Head, name: str, n_strands: int = 900, n_points: int = 10, seed: int = 0) -> StrandSet:
    """Straight strands on a head, of a shape of SHAPES: world space, metres. "half" has hair on the left side only."""
    length, out, down = SHAPES[name]
    frame = frame_of_head(head)
    roots = scatter_roots(head, head.scalp, n_strands, seed, iterations=3).points.astype(np.float64)
    if name == "half":
        roots = roots[roots[:, 0] > frame.centre[0]]
    outward = (roots - frame.centre) / np.linalg.norm(roots - frame.centre, axis=1, keepdims=True)
    # out first, so that the hair hangs beside the head and not through it
    side = outward * [1.0, 1.0, 0.2] if down else outward
    share = np.linspace(0.0, 1.0, n_points)[None, :, None]
    way = out * np.minimum(4.0 * share, 1.0 if down else 4.0) / (1.0 if down else 4.0) * side[:, None]
    way = way + np.array([0.0, 0.0, -down]) * share
    return from_dense((roots[:, None] + length * frame.radius * way).astype(np.float32))


def camera_of(name: str, head: Head, pixels: int = 160) -> Camera:
    frame = frame_of_head(head)
    centre = frame.centre - [0.0, 0.0, 0.8 * frame.radius]
    return standard_camera(name, centre, pixels / (8.0 * frame.radius), (pixels, pixels))


def view_of(strands: StrandSet, head: Head, camera: Camera, name: str) -> View:
    radius = frame_of_head(head).radius
    pixel = CLOSING * radius * camera.intrinsics[0, 0] if camera.orthographic else 1.3
    mask = render_mask(camera, resample(strands, 12), backdrop(camera, head), pixel, 0.03 * radius)
    return View(name, np.zeros((*mask.shape, 3), np.uint8), mask, camera)
