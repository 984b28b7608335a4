"""How scalp space is fitted to a head: the sphere, the axes and the maps of height and normals (W-2, W-4 ... W-6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import zoom
from scipy.sparse import csr_array, diags_array, eye_array, kron
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from ..types import Bools, Float32, Float64, Head
from ._scalp_space_kernels import map_directions
from .head import HeadSurface, submesh
from .scalp_region import require_scalp

# A sphere fit is trusted for a scalp that covers this solid angle (a hemisphere: 6.3) with this relative RMS error.
_SMALLEST_SOLID_ANGLE = 1.5
_LARGEST_FIT_ERROR = 0.25
# A scalp may reach this far from the axis before the remap is cut off, so that a fully hairy head keeps coordinates.
_LARGEST_POLAR_ANGLE = np.radians(150.0)
# The maps are measured this far around the scalp, head radii, and fall back to the sphere over this many radians of u.
_MARGIN = 0.1
_FALL_OFF = 0.3
# In the margin d may change by this many radii per radian of (u, v); steeper is a step.
_STEEPEST = 2.5
_SMOOTHING_SWEEPS = 24


@dataclass(frozen=True, slots=True)
class ScalpMaps:
    """height (H, H) float32 and normal (3, H, H) float32, as in `ScalpSpace`."""

    height: Float32
    normal: Float32


def fit_sphere(head: Head) -> tuple[Float64, float]:
    """Centre (3,) float64 and radius, metres, of the head's hemisphere.

    1. The sphere that fits the scalp best: least squares weighted by area, far-off parts weighed down.
    2. Where the scalp is too small or flat for that (see the constants): the median of the largest balls inside the
       head that touch the scalp, which is about half the skull's width; its centre lies below the scalp's middle.
    3. Where there is no inside either (a sheet): the radius of the hemisphere that has the scalp's area.

    Raises InputError for a scalp with no area.
    """
    require_scalp(head)
    corners = head.vertices[head.triangles[head.scalp]].astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(cross, axis=1)
    # the middles of the edges integrate quadratic functions over a triangle exactly
    middles = 0.5 * (corners + np.roll(corners, 1, axis=1))
    samples, weights = middles.reshape(-1, 3), np.repeat(areas / 3.0, 3)
    centre, radius, error = _robust_sphere(samples, weights)
    area = float(areas.sum())
    normal = cross.sum(axis=0)
    outside = float(np.einsum("fc,fc->", cross, corners.mean(axis=1) - centre)) > 0
    if outside and area >= _SMALLEST_SOLID_ANGLE * radius**2 and error <= _LARGEST_FIT_ERROR * radius:
        return centre, radius
    radius = _inner_radius(head, corners.mean(axis=1), cross, areas)
    middle = np.average(samples, axis=0, weights=weights)
    length = float(np.linalg.norm(normal))
    inward = -normal / length if length > 1e-9 * area else np.array([0.0, 0.0, 0.0])
    return middle + radius * inward, radius


def _robust_sphere(samples: Float64, weights: Float64) -> tuple[Float64, float, float]:
    """Centre, radius and weighted RMS distance error of the sphere through samples (n, 3); reweighted."""
    origin = np.average(samples, axis=0, weights=weights)
    offsets = samples - origin
    scale = max(float(np.sqrt(np.average((offsets**2).sum(axis=1), weights=weights))), 1e-30)
    offsets = offsets / scale
    squares = (offsets**2).sum(axis=1)
    design = np.column_stack([2.0 * offsets, np.ones(len(offsets))])
    trust = weights / weights.sum()
    centre, radius = np.zeros(3), 1.0
    for _ in range(10):
        root = np.sqrt(trust)[:, None]
        solution = np.linalg.lstsq(design * root, squares * root[:, 0], rcond=1e-9)[0]
        centre = solution[:3]
        radius = float(np.sqrt(max(solution[3] + centre @ centre, 1e-12)))
        residuals = np.linalg.norm(offsets - centre, axis=1) - radius
        # Cauchy weights: a residual of 0.15 radii counts half
        trust = weights / weights.sum() / (1.0 + (residuals / (0.15 * radius)) ** 2)
    error = float(np.sqrt(np.average(residuals**2, weights=weights)))
    return origin + scale * centre, scale * radius, scale * error


def _inner_radius(head: Head, middles: Float64, cross: Float64, areas: Float64) -> float:
    """Median radius of the balls inside the head that touch the scalp; not below a sphere of the scalp's area."""
    smallest = float(np.sqrt(areas.sum() / (4.0 * np.pi)))
    sound = np.flatnonzero(areas > 0)
    chosen = sound[np.linspace(0, len(sound) - 1, min(len(sound), 256)).astype(int)]
    surface = head.vertices[head.triangles].mean(axis=1, dtype=np.float64)
    surface = surface[np.linspace(0, len(surface) - 1, min(len(surface), 8192)).astype(int)]
    inward = -0.5 * cross[chosen] / areas[chosen, None]
    # the ball through p with centre p + r n touches q where r = |q - p|^2 / (2 n . (q - p))
    depth = inward @ surface.T - np.einsum("nc,nc->n", inward, middles[chosen])[:, None]
    squares = ((middles[chosen, None, :] - surface[None, :, :]) ** 2).sum(axis=2)
    ahead = depth > 0.2 * np.sqrt(squares)
    radii = np.where(ahead, squares / (2.0 * np.where(ahead, depth, 1.0)), np.inf).min(axis=1)
    finite = radii[np.isfinite(radii)]
    if len(finite) < 0.5 * len(radii):
        return float(np.sqrt(areas.sum() / (2.0 * np.pi)))
    return max(float(np.median(finite)), smallest)


def fit_axes(head: Head, centre: Float64, up: Float64) -> tuple[Float64, float]:
    """Rotation (3, 3), rows the axes of head space in world space, and the polar scale of W-6.

    The axis y is `up` tilted towards the middle of the scalp by the smallest angle (in steps of a degree) that puts the
    whole scalp into the upper hemisphere or, where none does, within two degrees of the best. x stays as near to the
    world's x as that allows; for `up` = z the head's z is the world's -y, Blender's front.
    """
    vertices = head.vertices[np.unique(head.triangles[head.scalp])].astype(np.float64) - centre
    lengths = np.linalg.norm(vertices, axis=1, keepdims=True)
    directions = vertices / np.maximum(lengths, 1e-30)
    corners = head.vertices[head.triangles[head.scalp]].astype(np.float64)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    mean = np.average(corners.mean(axis=1) - centre, axis=0, weights=areas)
    angle, sideways = _angle_to(up, mean)
    tilts = np.radians(np.arange(0.0, np.degrees(angle) + 1.0)) if angle > 0 else np.zeros(1)
    tilts = np.minimum(tilts, angle)
    axes = np.cos(tilts)[:, None] * up + np.sin(tilts)[:, None] * sideways
    extents = np.arccos(np.clip((axes @ directions.T).min(axis=1), -1.0, 1.0))
    good = extents <= max(0.5 * np.pi, extents.min() + np.radians(2.0))
    first = int(np.argmax(good))
    extent = min(float(extents[first]), _LARGEST_POLAR_ANGLE)
    polar_scale = min(0.5 * np.pi / extent, 1.0)
    upright = _smallest_rotation(np.array([0.0, 0.0, 1.0]), axes[first])
    blender_axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    return blender_axes @ upright.T, polar_scale


def _angle_to(up: Float64, target: Float64) -> tuple[float, Float64]:
    """The angle from the unit vector `up` to `target`, and the unit vector orthogonal to `up` in whose way it lies."""
    length = float(np.linalg.norm(target))
    if length < 1e-12:
        return 0.0, np.zeros(3)
    target = target / length
    sideways = target - (target @ up) * up
    size = float(np.linalg.norm(sideways))
    if size < 1e-9:
        # straight up, or straight down: any way round will do, so the one of the smallest coordinate
        sideways = np.eye(3)[int(np.argmin(np.abs(up)))]
        sideways = sideways - (sideways @ up) * up
        return (0.0 if target @ up > 0 else float(np.pi)), sideways / np.linalg.norm(sideways)
    return float(np.arctan2(size, target @ up)), sideways / size


def _smallest_rotation(start: Float64, end: Float64) -> Float64:
    """(3, 3) rotation that takes the unit vector `start` to `end`; about x for opposite ones along z."""
    cosine = float(start @ end)
    if cosine < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    axis = np.cross(start, end)
    skew = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1.0 + cosine))


def measure_maps(
    head: Head, centre: Float64, radius: float, rotation: Float64, polar_scale: float, resolution: int
) -> ScalpMaps:
    """Height and normals over the (u, v) grid: measured at the scalp and its margin, continued smoothly elsewhere."""
    directions = _grid_directions(polar_scale, resolution)
    patch = submesh(head, _with_margin(head, centre, _MARGIN * radius))
    surface = HeadSurface(patch)
    world = directions @ rotation
    reach = 1.01 * float(np.linalg.norm(patch.vertices - centre, axis=1).max())
    # from outside, so that the outermost layer counts; a hit beyond the centre is the other side's inside
    distance, triangle = surface.first_hits(centre + reach * world, -world)
    height = (reach - distance) / radius
    hit = (triangle >= 0) & (height > 0.05)
    grid = (resolution, resolution)
    height = np.where(hit, height, 0.0)
    on_scalp = hit & patch.scalp[triangle]
    hit = _connected_heights(height.reshape(grid), on_scalp.reshape(grid), hit.reshape(grid)).ravel()
    offsets = np.zeros((4, len(world)))
    offsets[0, hit] = height[hit] - 1.0
    points = centre + (radius * height[hit])[:, None] * world[hit]
    normals = surface.normals_at(triangle[hit], surface.barycentric_at(triangle[hit], points))
    offsets[1:, hit] = (normals @ rotation.T - directions[hit]).T
    filled = _continue_smoothly(offsets.reshape(4, *grid), hit.reshape(grid))
    normal = filled[1:] + directions.T.reshape(3, *grid)
    lengths = np.linalg.norm(normal, axis=0)
    sound = lengths > 1e-3
    normal = np.where(sound, normal / np.where(sound, lengths, 1.0), directions.T.reshape(normal.shape))
    height_map = np.maximum(filled[0] + 1.0, 0.05)
    return ScalpMaps(height_map.astype(np.float32), np.ascontiguousarray(normal, np.float32))


def _grid_directions(polar_scale: float, resolution: int) -> Float64:
    """(H * H, 3) float64, head-space unit directions of the grid nodes, v slow and u fast (eq. 2)."""
    angle = np.linspace(0.0, np.pi, resolution)
    v, u = np.meshgrid(angle, angle, indexing="ij")
    directions = np.empty((resolution * resolution, 3))
    map_directions(np.stack([u.ravel(), v.ravel()], axis=1), polar_scale, directions)
    return directions


def _with_margin(head: Head, centre: Float64, margin: float) -> Bools:
    """(F,) bool: the scalp and the triangles around it, reachable along the mesh, with all vertices within `margin`."""
    scalp_vertices = np.unique(head.triangles[head.scalp])
    distance, _ = cKDTree(head.vertices[scalp_vertices]).query(head.vertices, distance_upper_bound=margin)
    near = np.isfinite(distance)
    allowed = near[head.triangles].all(axis=1)
    reached = head.scalp.copy()
    touched = np.zeros(len(head.vertices), bool)
    while True:
        touched[head.triangles[reached]] = True
        grown = reached | (allowed & touched[head.triangles].any(axis=1))
        if (grown == reached).all():
            return np.asarray(grown)
        reached = grown


def _connected_heights(height: Float64, scalp: Bools, margin: Bools) -> Bools:
    """(H, H) bool: the nodes over the scalp, and those of the margin that its surface reaches without a jump.

    An ear or a shoulder beside the scalp is a step in d, which would tear the coordinates of the hair above it.
    """
    step = _STEEPEST * np.pi / (height.shape[0] - 1)
    known = scalp.copy()
    while True:
        grown = known.copy()
        for axis, shift in ((0, 1), (0, -1), (1, 1), (1, -1)):
            beside, value = np.roll(known, shift, axis), np.roll(height, shift, axis)
            grown |= margin & beside & (np.abs(height - value) < step)
        if (grown == known).all():
            return known
        known = grown


def _continue_smoothly(values: Float64, known: Bools) -> Float64:
    """`values` (C, H, H) where `known`; elsewhere about the solution of L^2 Laplace(f) = f that is 0 on the border.

    The border of the grid is one point, S0; 0 there keeps the maps single-valued. L is `_FALL_OFF`. Smoothness is all
    that matters: solved on a quarter of the nodes each way, and evened out on the grid itself.
    """
    resolution = known.shape[0]
    fixed = known.copy()
    fixed[[0, -1], :] = True
    fixed[:, [0, -1]] = True
    values = np.where(fixed, values, 0.0)
    values[:, [0, -1], :] = 0.0
    values[:, :, [0, -1]] = 0.0
    coarse = np.rint(np.linspace(0, resolution - 1, max(resolution // 4, 8))).astype(int)
    picked = np.ix_(coarse, coarse)
    filled = _solve_screened(values[(slice(None), *picked)], fixed[picked])
    factor = resolution / len(coarse)
    guess = np.stack([zoom(channel, factor, order=1) for channel in filled])
    values = np.where(fixed, values, guess)
    screen = 4.0 + (np.pi / (_FALL_OFF * (resolution - 1))) ** 2
    free = ~fixed[1:-1, 1:-1]
    for _ in range(_SMOOTHING_SWEEPS):
        around = values[:, :-2, 1:-1] + values[:, 2:, 1:-1] + values[:, 1:-1, :-2] + values[:, 1:-1, 2:]
        values[:, 1:-1, 1:-1] = np.where(free, around / screen, values[:, 1:-1, 1:-1])
    return values


def _solve_screened(values: Float64, fixed: Bools) -> Float64:
    """The exact solution on a small grid (C, h, h)."""
    resolution = fixed.shape[0]
    if fixed.all():
        return values
    path = diags_array([np.full(resolution - 1, 1.0)] * 2, offsets=[-1, 1])
    line = eye_array(resolution)
    neighbours = csr_array(kron(path, line) + kron(line, path))
    free, held = np.flatnonzero(~fixed.ravel()), np.flatnonzero(fixed.ravel())
    rows = neighbours[free]
    screen = 4.0 + (np.pi / (_FALL_OFF * (resolution - 1))) ** 2
    matrix = diags_array(np.full(len(free), screen)) - rows[:, free]
    flat = values.reshape(len(values), -1).copy()
    factor = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    flat[:, free] = factor.solve(rows[:, held] @ flat[:, held].T).T
    return flat.reshape(values.shape)
