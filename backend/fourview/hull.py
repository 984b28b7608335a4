"""What the masks allow: carving a region of voxels by them, and growing it where a mask is not filled (Z-5, Z-7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, map_coordinates
from scipy.spatial import cKDTree

from ..geometry.camera import project, resized, unproject
from ..geometry.view_raster import raster_mesh
from ..types import Bools, Camera, Float32, Float64, Floats, Head, Mesh
from ._hull_kernels import cone_distances
from .deformation import shrink_mask
from .solid import Voxels, point_voxels, surface
from .views import View

_GROWN = 2.0  # voxels, half the thickness of what is grown
_BOX_SAMPLES = 40  # along each side of a box whose allowed part is wanted
_DEPTH_BLUR = 3.0  # pixels, of the depths that are wanted in a gap
_RIM = 6.0  # voxels from a border up to which settle_rims moves the surface
_MOST_MOVE = 2.5  # voxels, the furthest it moves it at once: less than signed distances reach
_RIM_PIXEL = 0.5  # voxels, a pixel's edge in the pictures in which it compares borders
_MOVE_BLUR = 2.5  # of those pixels
_TEST_PIXEL = 3.0  # voxels, a pixel's edge in the pictures in which masks are compared with each other
_PIXEL = 1.0  # voxels, a pixel's edge in the pictures in which growing looks for gaps


@dataclass(frozen=True, slots=True)
class Cone:
    """Where one view allows hair: along the rays of its mask, and behind the head.

    inside_px : (H, W) float32, pixels, distance to the mask's border, positive in the mask.
    head_depth : (H, W) float32, metres, inf beside the head.
    """

    name: str
    camera: Camera
    mask: Bools
    inside_px: Float32
    head_depth: Float32


def make_cones(views: Sequence[View], head: Head) -> list[Cone]:
    """One cone a view, at the size of its picture."""
    cones = []
    for view in views:
        depth = raster_mesh(view.camera, head.vertices, head.triangles).depth
        cones.append(Cone(view.name, view.camera, view.mask, inside_distance(view.mask), depth))
    return cones


def inside_distance(mask: Bools) -> Float32:
    """(H, W) float32, pixels: distance of each pixel's middle to the border of the mask, positive inside."""
    inside = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    outside = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # between a pixel and the next the border lies half a pixel from both
    return np.asarray(np.where(mask, np.minimum(inside, 1e6) - 0.5, 0.5 - np.minimum(outside, 1e6)), np.float32)


def allowed_distance(points: Floats, cones: Sequence[Cone], skin: float = 0.0) -> Float32:
    """(n,) float32, metres: how far inside all cones points (n, 3), metres, lie; negative outside of one.

    skin : metres, how deep behind the head's surface hair may begin where a mask shows the head: a voxel, so that the
        surface between voxels does not come out of the head.
    """
    places = np.ascontiguousarray(points, np.float64)
    distance = np.full(len(places), 10.0, np.float32)
    for cone in cones:
        camera = cone.camera
        cone_distances(
            places,
            camera.world_to_camera,
            camera.intrinsics,
            not camera.orthographic,
            cone.inside_px,
            cone.head_depth,
            skin,
            distance,
        )
    return distance


def hull_box(cones: Sequence[Cone], low: Float64, high: Float64) -> tuple[Float64, Float64]:
    """The box, low and high (3,) metres, of what the masks allow of the box given and of their own extents.

    Where no view tells, as along the only view's direction, the box given counts.
    """
    for cone in cones:
        rows, columns = np.nonzero(cone.mask)
        corners = np.array([(x, y) for x in (columns.min(), columns.max() + 1) for y in (rows.min(), rows.max() + 1)])
        depth = project(cone.camera, 0.5 * (low + high))[2]
        points = unproject(cone.camera, corners, np.full(4, depth))
        low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    axes = [np.linspace(low[axis], high[axis], _BOX_SAMPLES) for axis in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    step = (high - low) / (_BOX_SAMPLES - 1)
    allowed = points[allowed_distance(points, cones) > -step.max()]
    if len(allowed) == 0:
        return low, high
    return np.maximum(low, allowed.min(axis=0) - step), np.minimum(high, allowed.max(axis=0) + step)


def voxel_points(voxels: Voxels) -> Float64:
    """(n^3, 3) float64, metres: the middles of all voxels, z fastest."""
    axes = [voxels.origin[axis] + np.arange(voxels.count) * voxels.cell for axis in range(3)]
    return np.asarray(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3))


def seen_hair(camera: Camera, mesh: Mesh, head_depth: Float32) -> tuple[Bools, Float32]:
    """(H, W) bool, where the mesh is before the head, and (H, W) float32 its depth, metres."""
    depth = raster_mesh(camera, mesh.vertices, mesh.triangles).depth
    return np.asarray(depth < head_depth), depth


def settle_rims(field: Float32, voxels: Voxels, cones: Sequence[Cone], head: Head) -> Float32:
    """The field with its surface moved, where a view sees it edge-on, to the border of that view's mask.

    At the border of a mask with the background the outline of the shape is some way inside or outside; the surface
    nearby moves by that way, and by ever less up to `_RIM` voxels from the border, so that it stays smooth, where
    carving alone would leave a flat strip. Borders on the head are left alone: there no surface is seen edge-on.
    """
    mesh = surface(field, voxels)
    near = np.abs(field) < _RIM * voxels.cell
    if len(mesh.triangles) == 0 or not near.any():
        return field
    points = voxels.points(np.argwhere(near).astype(np.float64))
    offset = np.zeros(len(points))
    weight = np.zeros(len(points))
    for cone in cones:
        camera = _small_camera(cone.camera, voxels, _RIM_PIXEL)
        moves, distance = _rim_moves(mesh, cone, camera, head)
        seen = project(camera, points)
        nodes = seen[:, 1::-1].T - 0.5
        scale = _pixel_metres(camera, seen[:, 2])
        share = 1.0 - np.abs(map_coordinates(distance, nodes, order=1, mode="nearest")) * scale / (_RIM * voxels.cell)
        share = np.clip(share, 0.0, 1.0)
        offset += share * map_coordinates(moves, nodes, order=1, mode="nearest") * scale
        weight += share
    most = _MOST_MOVE * voxels.cell
    out = field.copy()
    out[near] += np.clip(offset / np.maximum(weight, 1.0), -most, most).astype(np.float32)
    return out


def _rim_moves(mesh: Mesh, cone: Cone, camera: Camera, head: Head) -> tuple[Float64, Float32]:
    """How far out the shape's outline must go at the nearest border of the mask, (H, W) pixels; distance inside it."""
    head_depth = raster_mesh(camera, head.vertices, head.triangles).depth
    covered, _ = seen_hair(camera, mesh, head_depth)
    mask = shrink_mask(cone.mask, camera.size)
    inside = inside_distance(mask)
    if not covered.any():
        return np.zeros(mask.shape), inside
    border = (np.abs(inside) < 1.0) & mask
    # within three pixels of the head's picture a border may be one on the head
    on_head = cv2.dilate(np.isfinite(head_depth).astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    moves = np.where(border & ~on_head, inside - inside_distance(covered), 0.0)
    nearest = distance_transform_edt(~border, return_distances=False, return_indices=True)
    return cv2.GaussianBlur(moves[nearest[0], nearest[1]], (0, 0), _MOVE_BLUR), inside


def grow(
    field: Float32, allowed: Float32, voxels: Voxels, cones: Sequence[Cone], head: Head, slack: float = 0.0
) -> Float32:
    """The field with hair where a view has mask but no hair, as near in depth to the hair around as is allowed.

    field, allowed : (n, n, n) float32, metres, positive inside the hair, respectively inside all cones.
    slack : metres, how far outside a cone hair may be.
    """
    mesh = surface(field, voxels)
    seeds: list[Float64] = []
    for cone in cones:
        gaps = _find_gaps(mesh, voxels, cone, head)
        if gaps is not None:
            points, found = _nearest_allowed(*gaps, voxels, cones, -slack)
            seeds.append(voxels.indices(points[found]))
    places = np.concatenate(seeds) if seeds else np.empty((0, 3))
    if len(places) == 0:
        return field
    near = binary_dilation(point_voxels(places, voxels), iterations=int(np.ceil(_GROWN)) + 1)
    away, _ = cKDTree(places).query(np.argwhere(near), distance_upper_bound=_GROWN + 2.0)
    added = np.full(voxels.shape, -np.inf, np.float32)
    added[near] = (_GROWN - np.minimum(away, _GROWN + 2.0)) * voxels.cell
    return np.maximum(field, np.minimum(allowed, added))


def uncoverable(number: int, cones: Sequence[Cone], voxels: Voxels, others: Sequence[int], slack: float) -> float:
    """Share of the mask of view `number` where no hair can be: it would be outside the masks of the views `others`.

    slack : metres, how far outside a mask is let pass.
    """
    cone = cones[number]
    camera = _small_camera(cone.camera, voxels, _TEST_PIXEL)
    rows, columns = np.nonzero(shrink_mask(cone.mask, camera.size))
    if len(rows) == 0:
        return 0.0
    pixels = np.stack([columns, rows], axis=1) + 0.5
    limit = np.full(len(pixels), np.inf)
    wanted = np.full(len(pixels), _depths(camera, voxels).mean())
    _, found = _nearest_allowed(pixels, wanted, limit, camera, voxels, [cones[i] for i in others], -slack)
    return float(1.0 - found.mean())


def _small_camera(camera: Camera, voxels: Voxels, pixel: float) -> Camera:
    """The camera with pixels of so many voxels at the middle of the cube."""
    metres = float(_pixel_metres(camera, _depths(camera, voxels).mean(keepdims=True))[0])
    return resized(camera, min(1.0, metres / (pixel * voxels.cell)))


def _pixel_metres(camera: Camera, depths: Float64) -> Float64:
    """(n,) float64, metres: the edge of a pixel at depths (n,), metres."""
    scale = float(np.sqrt(abs(np.linalg.det(camera.intrinsics[:2, :2]))))
    return np.full(len(depths), 1.0 / scale) if camera.orthographic else np.maximum(depths, 1e-6) / scale


def _depths(camera: Camera, voxels: Voxels) -> Float64:
    corners = np.stack(np.meshgrid(*[[0.0, voxels.count - 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    depths = project(camera, voxels.points(corners))[:, 2]
    near, far = depths.min(), depths.max()
    return np.asarray(np.linspace(near, far, max(int(np.ceil((far - near) / voxels.cell)), 2)))


def _find_gaps(mesh: Mesh, voxels: Voxels, cone: Cone, head: Head) -> tuple[Float64, Float64, Float64, Camera] | None:
    """Pixels (n, 2) of the mask without hair, depths wanted there (n,), those of the head (n,), and their camera."""
    camera = _small_camera(cone.camera, voxels, _PIXEL)
    head_depth = raster_mesh(camera, head.vertices, head.triangles).depth
    covered, depth = seen_hair(camera, mesh, head_depth)
    mask = shrink_mask(cone.mask, camera.size)
    missing = mask & ~covered
    if not missing.any() or not covered.any():
        return None
    rows, columns = np.nonzero(missing)
    nearest = distance_transform_edt(~covered, return_distances=False, return_indices=True)
    filled = cv2.GaussianBlur(depth[nearest[0], nearest[1]], (0, 0), _DEPTH_BLUR)
    wanted = filled[missing].astype(np.float64)
    pixels = np.stack([columns, rows], axis=1) + 0.5
    return pixels, wanted, head_depth[missing].astype(np.float64), camera


def _nearest_allowed(
    pixels: Float64,
    wanted: Float64,
    limit: Float64,
    camera: Camera,
    voxels: Voxels,
    cones: Sequence[Cone],
    least: float = 0.0,
) -> tuple[Float64, Bools]:
    """(n, 3) the point of each pixel's ray that is allowed and nearest to the depth wanted; (n,) if there is one."""
    depths = _depths(camera, voxels)
    along = np.repeat(pixels, len(depths), axis=0)
    points = unproject(camera, along, np.tile(depths, len(pixels)))
    inside = allowed_distance(points, cones).reshape(len(pixels), -1) > least
    inside &= depths < limit[:, None]
    cost = np.where(inside, np.abs(depths - wanted[:, None]), np.inf)
    best = cost.argmin(axis=1)
    chosen = points.reshape(len(pixels), -1, 3)[np.arange(len(pixels)), best]
    return chosen, np.isfinite(cost[np.arange(len(pixels)), best])
