"""Small pictures of hair, drawn by numpy: for assets, where neither a window nor a renderer may be at hand."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ..backend.types import Head

PIXELS = 256
_OVERSAMPLE = 2  # each pixel is the mean of so many samples squared
_TOWARDS_CAMERA = np.array([0.56, -0.80, 0.22])  # from the head's left front, a little above
_TOWARDS_LIGHT = np.array([-0.35, -0.55, 0.85])
_HAIR = np.array([0.46, 0.26, 0.14])  # sRGB, as all colours here
_GLOSS = np.array([0.34, 0.28, 0.22])
_SKIN = np.array([0.40, 0.37, 0.35])
_MARGIN = 0.06
_HEAD_SAMPLES = 500_000


def draw_hair(points: np.ndarray, head: Head | None, size: int = PIXELS) -> np.ndarray:
    """A picture of hair on a head.

    Parameters
    ----------
    points : (S, N, 3) float32, strands in world space, z up, the face towards -y.
    head : drawn in grey behind the hair; None for none.

    Returns
    -------
    (size, size, 4) float32 sRGB with transparent ground, bottom row first, as Blender keeps pixels.
    """
    axes = _camera_axes()
    samples = size * _OVERSAMPLE
    low, scale = _frame(points.reshape(-1, 3) @ axes.T[:, :2], samples)
    places, colors = _hair_samples(points, 0.7 * samples / _extent(points))
    if head is not None:
        skin_places, skin_colors = _head_samples(head)
        places, colors = np.concatenate([places, skin_places]), np.concatenate([colors, skin_colors])
    local = places @ axes.T
    pixel = np.floor((local[:, :2] - low) * scale).astype(np.int64)
    inside = ((pixel >= 0) & (pixel < samples)).all(axis=1)
    flat = pixel[inside, 1] * samples + pixel[inside, 0]
    # of all samples in a place the nearest is seen: sorted from far to near, the last write stays
    order = np.argsort(local[inside, 2], kind="stable")
    image = np.zeros((samples * samples, 4), np.float32)
    image[flat[order], :3] = colors[inside][order]
    image[flat[order], 3] = 1.0
    blocks = image.reshape(size, _OVERSAMPLE, size, _OVERSAMPLE, 4)
    alpha = blocks[..., 3:].mean(axis=(1, 3))
    color = (blocks[..., :3] * blocks[..., 3:]).mean(axis=(1, 3)) / np.maximum(alpha, 1e-6)
    return np.ascontiguousarray(np.concatenate([color, alpha], axis=-1), dtype=np.float32)


def _camera_axes() -> np.ndarray:
    """(3, 3): rows right, up and towards the camera."""
    back = _TOWARDS_CAMERA / np.linalg.norm(_TOWARDS_CAMERA)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back])


def _extent(points: np.ndarray) -> float:
    flat = points.reshape(-1, 3)
    return max(float((flat.max(axis=0) - flat.min(axis=0)).max()), 1e-9)


def _frame(flat: np.ndarray, samples: int) -> tuple[np.ndarray, float]:
    """The lower left corner and the samples per metre that hold all but a few stray hairs."""
    low, high = np.percentile(flat, [0.3, 99.7], axis=0)
    extent = max(float((high - low).max()), 1e-9)
    scale = samples * (1.0 - 2.0 * _MARGIN) / extent
    return (low + high) / 2.0 - samples / (2.0 * scale), scale


def _hair_samples(points: np.ndarray, samples_per_metre: float) -> tuple[np.ndarray, np.ndarray]:
    """Places (M, 3) along all segments, close enough to leave no gaps, and their colours (M, 3)."""
    segments = np.diff(points, axis=1)
    lengths = np.linalg.norm(segments, axis=2, keepdims=True)
    between = int(np.clip(np.ceil(np.percentile(lengths, 95) * samples_per_metre), 1, 16))
    steps = ((np.arange(between) + 0.5) / between)[:, None]
    places = points[:, :-1, None, :] + segments[:, :, None, :] * steps
    shade = _shade(segments / np.maximum(lengths, 1e-12), len(points), points.shape[1] - 1)
    colors = np.repeat(shade.reshape(-1, 3), between, axis=0)
    return places.reshape(-1, 3), colors


def _shade(tangents: np.ndarray, n_strands: int, n_segments: int) -> np.ndarray:
    """(S, N - 1, 3) colours: Kajiya and Kay's lighting of a thin cylinder, a little different for each strand."""
    light = _TOWARDS_LIGHT / np.linalg.norm(_TOWARDS_LIGHT)
    half = light + _TOWARDS_CAMERA / np.linalg.norm(_TOWARDS_CAMERA)
    half /= np.linalg.norm(half)
    diffuse = np.sqrt(np.clip(1.0 - (tangents @ light) ** 2, 0.0, 1.0))[..., None]
    gloss = np.clip(1.0 - (tangents @ half) ** 2, 0.0, 1.0)[..., None] ** 12
    # golden-ratio sequence: even, and the same for the same hair
    tint = 0.7 + 0.6 * ((np.arange(n_strands) * 0.618034) % 1.0)[:, None, None]
    from_root = (0.45 + 0.55 * np.linspace(0.0, 1.0, n_segments) ** 0.7)[None, :, None]
    return np.clip((_HAIR * (0.25 + 0.85 * diffuse) * tint + _GLOSS * gloss) * from_root, 0.0, 1.0)


def _head_samples(head: Head) -> tuple[np.ndarray, np.ndarray]:
    """Places (M, 3) spread over the mesh by area, and their colours (M, 3)."""
    corners = head.vertices[head.triangles].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    counts = np.ceil(areas / max(areas.sum(), 1e-30) * _HEAD_SAMPLES).astype(np.int64)
    triangle = np.repeat(np.arange(len(corners)), counts)
    # the R2 low-discrepancy sequence, folded into the triangle
    index = np.arange(len(triangle))
    u, v = (index * 0.7548776662) % 1.0, (index * 0.5698402910) % 1.0
    outside = u + v > 1.0
    u, v = np.where(outside, 1.0 - u, u)[:, None], np.where(outside, 1.0 - v, v)[:, None]
    chosen = corners[triangle]
    places = chosen[:, 0] * (1.0 - u - v) + chosen[:, 1] * u + chosen[:, 2] * v
    light = _TOWARDS_LIGHT / np.linalg.norm(_TOWARDS_LIGHT)
    lit = np.clip((normals / np.maximum(areas, 1e-30)[:, None]) @ light, 0.0, 1.0)
    return places, (_SKIN * (0.35 + 0.65 * lit[:, None]))[triangle]


def write_png(pixels: np.ndarray, path: Path) -> None:
    """Write (H, W, 4) float32 sRGB, bottom row first.

    Raises
    ------
    RuntimeError : the file cannot be written.
    """
    image = bpy.data.images.new("Hairloom Thumbnail", pixels.shape[1], pixels.shape[0], alpha=True)
    try:
        image.pixels.foreach_set(pixels.ravel())
        image.filepath_raw = str(path)
        image.file_format = "PNG"
        image.save()
    finally:
        bpy.data.images.remove(image)


def set_preview(item: bpy.types.ID, pixels: np.ndarray) -> None:
    """Show (H, W, 4) float32 sRGB, bottom row first, as the datablock's preview."""
    preview = item.preview_ensure()
    preview.image_size = (pixels.shape[1], pixels.shape[0])
    preview.image_pixels_float.foreach_set(pixels.ravel())
