"""Cameras: how world points come to lie on a picture, and back along rays (Z-2; `types.Camera` holds the axes)."""

from __future__ import annotations

import numpy as np

from ..errors import require
from ..types import Camera, Float64, Floats

# The class of a view and the direction that its camera looks in; the person faces -y, its left side is +x.
STANDARD_DIRECTIONS: dict[str, tuple[float, float, float]] = {
    "front": (0.0, 1.0, 0.0),
    "back": (0.0, -1.0, 0.0),
    "left": (-1.0, 0.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "top": (0.0, 0.0, -1.0),
}
DISTANCE = 2.0  # metres from an orthographic camera to the middle of its picture; only depths depend on it


def orthographic_camera(
    direction: Floats | tuple[float, float, float],
    centre: Floats | tuple[float, float, float],
    pixels_per_metre: float,
    size: tuple[int, int] = (800, 800),
    up: Floats | tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> Camera:
    """A camera without perspective.

    Parameters
    ----------
    direction : (3,), where the camera looks, any length but 0. up : (3,), up in the picture, not along `direction`.
    centre : (3,) metres, world space, the point in the middle of the picture, `DISTANCE` in front of the camera.
    size : (width, height), pixels.

    Raises
    ------
    InputError : a direction of no length or along `up`, a scale or a size that is not above 0.
    """
    turn = _turn(direction, up)
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    matrix[:3, 3] = -turn @ np.asarray(centre, np.float64)
    matrix[2, 3] += DISTANCE
    return Camera(_intrinsics(pixels_per_metre, size), matrix, size, orthographic=True)


def standard_camera(
    name: str,
    centre: Floats | tuple[float, float, float],
    pixels_per_metre: float,
    size: tuple[int, int] = (800, 800),
) -> Camera:
    """The orthographic camera of a class of view, a name of STANDARD_DIRECTIONS; "top" has the face at the bottom.

    Raises
    ------
    InputError : no such view.
    """
    require(name in STANDARD_DIRECTIONS, f"'{name}' is no standard view; take one of {', '.join(STANDARD_DIRECTIONS)}")
    up = (0.0, 1.0, 0.0) if name == "top" else (0.0, 0.0, 1.0)
    return orthographic_camera(STANDARD_DIRECTIONS[name], centre, pixels_per_metre, size, up)


def perspective_camera(
    position: Floats | tuple[float, float, float],
    target: Floats | tuple[float, float, float],
    focal_px: float,
    size: tuple[int, int] = (800, 800),
    up: Floats | tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> Camera:
    """A camera at `position` (3,) that has `target` (3,) in the middle of its picture; both metres, world space.

    focal_px : focal length, pixels. size : (width, height), pixels.

    Raises
    ------
    InputError : a target at the position or straight along `up` from it, a focal length that is not above 0.
    """
    start = np.asarray(position, np.float64)
    turn = _turn(np.asarray(target, np.float64) - start, up)
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    matrix[:3, 3] = -turn @ start
    return Camera(_intrinsics(focal_px, size), matrix, size, orthographic=False)


def project(camera: Camera, points: Floats) -> Float64:
    """(..., 3) float64: x and y in pixels, and depth in metres along the viewing direction, of points (..., 3), metres.

    The pixel of a point that is not in front of a perspective camera is NaN.
    """
    turn, move = camera.world_to_camera[:3, :3], camera.world_to_camera[:3, 3]
    seen = np.asarray(points, np.float64) @ turn.T + move
    depth = seen[..., 2:]
    if camera.orthographic:
        plane = seen[..., :2]
    else:
        plane = np.divide(seen[..., :2], depth, out=np.full_like(seen[..., :2], np.nan), where=depth > 0)
    pixels = plane @ camera.intrinsics[:2, :2].T + camera.intrinsics[:2, 2]
    return np.concatenate([pixels, depth], axis=-1)


def unproject(camera: Camera, pixels: Floats, depth: Floats) -> Float64:
    """(n, 3) float64, metres: the world points at `pixels` (n, 2) that lie `depth` (n,) metres deep."""
    plane = _on_plane(camera, pixels)
    depths = np.asarray(depth, np.float64)[:, None]
    seen = np.concatenate([plane if camera.orthographic else plane * depths, depths], axis=1)
    return np.asarray((seen - camera.world_to_camera[:3, 3]) @ camera.world_to_camera[:3, :3])


def rays(camera: Camera, pixels: Floats) -> tuple[Float64, Float64]:
    """World rays through `pixels` (n, 2), x and y; a pixel's middle lies at + 0.5.

    Returns
    -------
    origins : (n, 3) float64, metres: on the plane of depth 0, for perspective the camera itself.
    directions : (n, 3) float64, unit, away from the camera.
    """
    plane = _on_plane(camera, pixels)
    turn, position = camera.world_to_camera[:3, :3], camera_position(camera)
    if camera.orthographic:
        return position + plane @ turn[:2], np.tile(turn[2], (len(plane), 1))
    ahead = np.concatenate([plane, np.ones((len(plane), 1))], axis=1) @ turn
    return np.tile(position, (len(plane), 1)), ahead / np.linalg.norm(ahead, axis=1, keepdims=True)


def camera_position(camera: Camera) -> Float64:
    """(3,) float64, metres, world space. An orthographic camera's means nothing but the plane of depth 0."""
    return np.asarray(-camera.world_to_camera[:3, :3].T @ camera.world_to_camera[:3, 3])


def view_direction(camera: Camera) -> Float64:
    """(3,) float64, unit: where the camera looks, world space."""
    return np.array(camera.world_to_camera[2, :3])


def towards(camera: Camera, points: Floats) -> Float64:
    """(..., 3) float64, unit directions from points (..., 3), metres, to the camera."""
    places = np.asarray(points, np.float64)
    if camera.orthographic:
        return np.broadcast_to(-view_direction(camera), places.shape).copy()
    away = camera_position(camera) - places
    return np.asarray(away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-300))


def in_picture(camera: Camera, pixels: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """(...,) bool: whether pixels (..., 2 or more), x and y first, lie on the picture; NaN does not."""
    width, height = camera.size
    x, y = pixels[..., 0], pixels[..., 1]
    return np.asarray((x >= 0) & (x < width) & (y >= 0) & (y < height))


def resized(camera: Camera, scale: float) -> Camera:
    """The camera of the same picture at `scale` times its size (rounded to pixels, at least 1); for image pyramids.

    Raises
    ------
    InputError : a scale that is not above 0.
    """
    require(scale > 0 and np.isfinite(scale), f"a picture cannot be resized by {scale}; take a number above 0")
    size = (max(round(camera.size[0] * scale), 1), max(round(camera.size[1] * scale), 1))
    intrinsics = camera.intrinsics.copy()
    intrinsics[0] *= size[0] / camera.size[0]
    intrinsics[1] *= size[1] / camera.size[1]
    return Camera(intrinsics, camera.world_to_camera, size, camera.orthographic)


def _on_plane(camera: Camera, pixels: Floats) -> Float64:
    """(n, 2): camera x and y in metres (orthographic), or at depth 1 (perspective)."""
    places = np.asarray(pixels, np.float64)
    require(places.ndim == 2 and places.shape[1] == 2, f"pixels must have shape (n, 2), not {places.shape}")
    return np.asarray(np.linalg.solve(camera.intrinsics[:2, :2], (places - camera.intrinsics[:2, 2]).T).T)


def _intrinsics(scale: float, size: tuple[int, int]) -> Float64:
    return np.array([[scale, 0.0, size[0] / 2.0], [0.0, scale, size[1] / 2.0], [0.0, 0.0, 1.0]], np.float64)


def _turn(direction: Floats | tuple[float, float, float], up: Floats | tuple[float, float, float]) -> Float64:
    """(3, 3) rows right, down, forward."""
    ahead, upwards = np.asarray(direction, np.float64), np.asarray(up, np.float64)
    length = np.linalg.norm(ahead)
    require(length > 0 and np.isfinite(length), f"a camera cannot look along {ahead.tolist()}; give a direction")
    forward = ahead / length
    right = np.cross(forward, upwards)
    across = np.linalg.norm(right)
    require(
        across > 1e-6 * np.linalg.norm(upwards) > 0,
        f"the camera looks along its own up direction {upwards.tolist()}; give another `up`",
    )
    right /= across
    return np.stack([right, np.cross(forward, right), forward])
