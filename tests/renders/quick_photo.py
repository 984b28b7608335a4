"""Pictures of a groom in a second each, without Blender: the z-buffer's strands with simple light, for first tries."""

from __future__ import annotations

import cv2
import numpy as np
from grooms import Groom
from hairloom.geometry.camera import resized, towards
from hairloom.geometry.head import HeadSurface
from hairloom.geometry.strand_raster import StrandRaster, raster_strands, scalp_pixels
from hairloom.geometry.view_raster import raster_mesh
from hairloom.types import Camera, Float32, Floats

FINE = 3  # drawn at so many times the size
SKIN, DARK_SCALP = (0.82, 0.66, 0.57), (0.12, 0.1, 0.09)  # sRGB
LIGHT = (-0.35, -0.45, -0.8)  # towards the light: the camera's right, down, forward
SHADE = 0.012  # metres: strands that lie so deep under the outermost ones get 1 / e of the light


def draw_view(groom: Groom, camera: Camera, melanin: float) -> tuple[Float32, Float32]:
    """Picture (H, W, 4) float32 in [0, 1], sRGB and not multiplied by its alpha, and the hair's share (H, W)."""
    fine = resized(camera, FINE)
    width = 2.0 * float(np.median(groom.strands.point_attributes["radius"])) * fine.intrinsics[0, 0]
    drawn = raster_strands(fine, groom.strands, groom.head, max(width, 1.0))
    light = np.asarray(LIGHT) @ fine.world_to_camera[:3, :3]
    light /= np.linalg.norm(light)
    picture = _shaded_head(groom, fine, light)
    picture[drawn.mask, :3] = _shaded_strands(groom, fine, drawn, light, melanin)
    picture[drawn.mask, 3] = 1.0
    picture[..., :3] *= picture[..., 3:]
    small = cv2.resize(picture, camera.size, interpolation=cv2.INTER_AREA)
    small[..., :3] /= np.maximum(small[..., 3:], 1e-6)
    share = cv2.resize(drawn.mask.astype(np.float32), camera.size, interpolation=cv2.INTER_AREA)
    return small, share


def _shaded_head(groom: Groom, camera: Camera, light: Floats) -> Float32:
    seen = raster_mesh(camera, groom.head.vertices, groom.head.triangles)
    covered = seen.triangle >= 0
    normals = HeadSurface(groom.head).normals_at(seen.triangle[covered], seen.barycentric[covered])
    lit = 0.35 + 0.65 * np.clip(normals @ light, 0.0, 1.0)
    skin = np.where(scalp_pixels(camera, groom.head)[covered][:, None], DARK_SCALP, SKIN)
    picture = np.zeros((*covered.shape, 4), np.float32)
    picture[covered, :3] = skin * lit[:, None]
    picture[covered, 3] = 1.0
    return picture


def _shaded_strands(groom: Groom, camera: Camera, drawn: StrandRaster, light: Floats, melanin: float) -> Float32:
    """(n, 3) sRGB of the pixels of strands: Kajiya and Kay's light on lines, darker the deeper they lie."""
    points, segment = groom.strands.points, drawn.segment[drawn.mask]
    tangents = (points[segment + 1] - points[segment]).astype(np.float64)
    tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-12)
    eye = towards(camera, points[segment])
    along_light, along_eye = tangents @ light, np.einsum("nc,nc->n", tangents, eye)
    across_light, across_eye = np.sqrt(1.0 - along_light**2), np.sqrt(np.maximum(1.0 - along_eye**2, 0.0))
    glint = np.clip(across_light * across_eye - along_light * along_eye, 0.0, 1.0) ** 40
    outermost = cv2.erode(np.where(drawn.mask, drawn.depth, np.float32(1e3)), np.ones((9 * FINE, 9 * FINE), np.uint8))
    deep = np.maximum(drawn.depth - cv2.blur(outermost, (9 * FINE, 9 * FINE)), 0.0)[drawn.mask]
    varied = np.random.default_rng(0).uniform(0.6, 1.3, groom.strands.n_strands)[drawn.strand[drawn.mask]]
    bright = (0.15 + 0.85 * across_light * varied) * np.exp(-deep / SHADE)
    colour = np.array([0.95, 0.8, 0.6]) * (1.0 - 0.8 * melanin)
    shaded = bright[:, None] * colour + (0.35 * glint * np.exp(-deep / SHADE))[:, None]
    return np.clip(shaded, 0.0, 1.0).astype(np.float32)
