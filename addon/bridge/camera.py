"""A photo's plane in the scene and the backend's Camera: the plane's matrix is the camera.

The plane is an image empty: its own x points right in the picture, y up, and z out of the picture, towards the
camera. Pixels count right and down from the picture's upper left corner.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from bpy_extras import view3d_utils
from mathutils import Matrix, Vector

from .. import fourview
from ..backend.errors import InputError, require
from ..backend.geometry import camera as cameras
from ..backend.types import Camera
from . import mesh

_FLIP = np.diag([1.0, -1.0, -1.0])  # Blender's y up and z back <-> y down and z forward
_PICTURE_PER_HEAD = 2.4  # a new photo is this many times as large as the head


def new_plane(name: str, image: bpy.types.Image, matrix: Matrix, collection: bpy.types.Collection) -> bpy.types.Object:
    """An image empty whose longest side is as long as the matrix' scale says."""
    plane = bpy.data.objects.new(name, None)
    plane.empty_display_type = "IMAGE"
    plane.data = image
    plane.empty_display_size = 1.0
    plane.empty_image_offset = (-0.5, -0.5)
    plane.empty_image_side = "FRONT"
    plane.rotation_mode = "QUATERNION"
    plane.matrix_world = matrix
    collection.objects.link(plane)
    return plane


def head_box(head: bpy.types.Object | None) -> tuple[np.ndarray, float]:
    """The middle of the head above its neck, (3,) metres, and its height; of Hairloom's own head without one."""
    if head is None:
        return np.zeros(3), 0.25
    found = mesh.read_head(head, bpy.context.scene.hairloom.scalp_group)
    corners = found.vertices[np.unique(found.triangles[found.scalp])] if found.scalp.any() else found.vertices
    low, high = corners.min(axis=0).astype(np.float64), corners.max(axis=0).astype(np.float64)
    width = float((high - low)[:2].max())
    centre = 0.5 * (low + high)
    centre[2] = high[2] - 0.6 * width  # a head is about as deep as its upper half is high
    return centre, 1.3 * width


def standard_matrix(view: str, head: bpy.types.Object | None) -> Matrix:
    """Where a new photo's plane stands: through the head's middle, facing the side that its view is named after."""
    centre, height = head_box(head)
    known = view if view in cameras.STANDARD_DIRECTIONS else "front"
    # one metre of the picture's longest side for each unit: matrix_of_camera gives the scale
    longest = _PICTURE_PER_HEAD * height
    return matrix_of_camera(cameras.standard_camera(known, centre, 100.0 / longest, (100, 100)))


def matrix_of_camera(camera: Camera, distance: float = cameras.DISTANCE) -> Matrix:
    """The matrix of the plane whose camera is `camera`; for perspective, the plane stands `distance` before it."""
    width, height = camera.size
    turn = camera.world_to_camera[:3, :3]
    depth = cameras.DISTANCE if camera.orthographic else distance
    middle = cameras.unproject(camera, np.array([[0.5 * width, 0.5 * height]]), np.array([depth]))[0]
    per_pixel = (1.0 if camera.orthographic else depth) / np.diag(camera.intrinsics)[:2]
    scale = np.append(max(width, height) * per_pixel, max(width, height) * per_pixel.mean())
    matrix = np.eye(4)
    matrix[:3, :3] = (_FLIP @ turn).T * scale
    matrix[:3, 3] = middle
    return Matrix(matrix.tolist())


def camera_of(photo: Any) -> Camera:
    """The camera of a photo, from its plane.

    Raises
    ------
    InputError : a plane that is mirrored, sheared or flat.
    """
    plane, size = photo.plane, tuple(photo.image.size)
    turn, per_pixel, corner = _frame(plane, size)
    middle = corner + turn[0] * per_pixel[0] * size[0] / 2 + turn[1] * per_pixel[1] * size[1] / 2
    matrix, intrinsics = np.eye(4), np.eye(3)
    distance = photo.distance if photo.is_perspective else cameras.DISTANCE
    matrix[:3, :3] = turn
    matrix[:3, 3] = -turn @ middle
    matrix[2, 3] += distance
    scale = (photo.distance if photo.is_perspective else 1.0) / per_pixel
    intrinsics[0, 0], intrinsics[1, 1] = scale
    intrinsics[:2, 2] = size[0] / 2, size[1] / 2
    return Camera(intrinsics, matrix, size, orthographic=not photo.is_perspective)


def _frame(plane: bpy.types.Object, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows right, down, forward (3, 3); metres a pixel (2,) across and down; the upper left corner (3,), world."""
    matrix = np.array(fourview.matrix_of(plane), np.float64)
    axes = matrix[:3, :3]
    scale = np.linalg.norm(axes, axis=0)
    require((scale > 1e-9).all(), f"the photo '{plane.name}' is flat: give it a scale above 0")
    right, up = axes[:, 0] / scale[0], axes[:, 1] / scale[1]
    forward = np.cross(up, right)
    if abs(right @ up) > 1e-3 or forward @ axes[:, 2] > 0:
        raise InputError(
            f"the photo '{plane.name}' is mirrored or sheared: clear its scale (Alt-S) and scale it evenly"
        )
    up = np.cross(right, forward)  # exactly square, whatever float32 left
    up /= np.linalg.norm(up)
    forward = np.cross(up, right)
    unit = plane.empty_display_size / max(size)
    per_pixel = unit * scale[:2]
    offset = np.array(plane.empty_image_offset, np.float64) * size * per_pixel
    corner = matrix[:3, 3] + right * offset[0] + up * (offset[1] + size[1] * per_pixel[1])
    return np.stack([right, -up, forward]), per_pixel, corner


def pixels_in_world(photo: Any, pixels: np.ndarray) -> np.ndarray:
    """(n, 3) float32, metres: where pixels (n, 2) of the photo lie on its plane."""
    turn, per_pixel, corner = _frame(photo.plane, tuple(photo.image.size))
    places = np.asarray(pixels, np.float64).reshape(-1, 2) * per_pixel
    return (corner + places @ turn[:2]).astype(np.float32)


def pixel_of_ray(photo: Any, origin: np.ndarray, direction: np.ndarray) -> tuple[float, float] | None:
    """The pixel of the photo, also beyond its border, that a world ray meets; None where it runs along the plane."""
    turn, per_pixel, corner = _frame(photo.plane, tuple(photo.image.size))
    steep = float(turn[2] @ direction)
    if abs(steep) < 1e-6:
        return None
    hit = np.asarray(origin) + np.asarray(direction) * (turn[2] @ (corner - origin) / steep)
    x, y = (turn[:2] @ (hit - corner)) / per_pixel
    return float(x), float(y)


def pixel_under_mouse(
    photo: Any, region: Any, region_3d: Any, place: tuple[float, float]
) -> tuple[float, float] | None:
    """The pixel of the photo under a place of a 3D view's region."""
    origin = view3d_utils.region_2d_to_origin_3d(region, region_3d, place)
    direction = view3d_utils.region_2d_to_vector_3d(region, region_3d, place)
    return pixel_of_ray(photo, np.array(origin, np.float64), np.array(direction, np.float64))


def is_looked_through(photo: Any, region_3d: Any) -> bool:
    """Does a 3D view show what the photo's camera sees, but for zoom and pan?"""
    if region_3d.is_perspective:
        return False
    turn, _, _ = _frame(photo.plane, tuple(photo.image.size))
    ahead = np.array(region_3d.view_rotation @ Vector((0.0, 0.0, -1.0)))
    up = np.array(region_3d.view_rotation @ Vector((0.0, 1.0, 0.0)))
    return not photo.is_perspective and bool(ahead @ turn[2] > 0.99999 and up @ -turn[1] > 0.9999)


def viewport_camera(region: Any, region_3d: Any) -> Camera:
    """The camera of a 3D view: its region's pixels, counted from the upper left corner."""
    size = (int(region.width), int(region.height))
    view = np.array(region_3d.view_matrix, np.float64)
    window = np.array(region_3d.window_matrix, np.float64)
    turn, _, rest = np.linalg.svd(_FLIP @ view[:3, :3])
    matrix, intrinsics = np.eye(4), np.eye(3)
    matrix[:3, :3] = turn @ rest
    matrix[:3, 3] = _FLIP @ view[:3, 3]
    half = 0.5 * np.array(size, np.float64)
    intrinsics[0, 0], intrinsics[1, 1] = half[0] * window[0, 0], half[1] * window[1, 1]
    if region_3d.is_perspective:
        intrinsics[0, 2], intrinsics[1, 2] = half[0] * (1.0 - window[0, 2]), half[1] * (1.0 + window[1, 2])
    else:
        intrinsics[0, 2], intrinsics[1, 2] = half[0] * (1.0 + window[0, 3]), half[1] * (1.0 - window[1, 3])
    return Camera(intrinsics, matrix, size, orthographic=not region_3d.is_perspective)


def camera_numbers(camera: Camera) -> dict[str, Any]:
    """A camera as JSON takes it."""
    return {
        "intrinsics": camera.intrinsics.tolist(),
        "world_to_camera": camera.world_to_camera.tolist(),
        "size": list(camera.size),
        "orthographic": camera.orthographic,
    }


def camera_from_numbers(numbers: dict[str, Any]) -> Camera:
    return Camera(
        np.array(numbers["intrinsics"], np.float64),
        np.array(numbers["world_to_camera"], np.float64),
        (int(numbers["size"][0]), int(numbers["size"][1])),
        bool(numbers["orthographic"]),
    )


def looking_through(photo: Any) -> tuple[Any, Vector, float]:
    """Rotation, location and the picture's longest side, for a 3D view that looks through the photo's camera."""
    turn, per_pixel, corner = _frame(photo.plane, tuple(photo.image.size))
    size = np.array(photo.image.size, np.float64)
    middle = corner + (size / 2 * per_pixel) @ turn[:2]
    rotation = Matrix((_FLIP @ turn).T.tolist()).to_quaternion()
    return rotation, Vector(middle), float((size * per_pixel).max())
