"""Scalp space: the (u, v, w) coordinates around a head in which hairstyles are compared (Wang et al. 2009, sec. 3).

W-2 ... W-6. Head space has its origin at the centre of the head's hemisphere, y up and the head's radius as unit.
(u, v) are the paper's coordinates of a direction, w is the height over the scalp. Everything is a bijection of space
without the centre, whatever the head: a bad fit makes coordinates unevenly spaced, never wrong.

Decisions (the paper leaves them open):

- W-6. The paper maps the roots to the upper hemisphere and does not say how. Here the polar angle is multiplied by
  `polar_scale` <= 1 as far as the scalp reaches; below, a parabola of the same slope leads on to S0, so that the map of
  the sphere stays one-to-one and no second singularity comes in. (The conformal map, which multiplies the tangent of
  half the angle, was tried: on real scalps it varies the area of a (u, v) cell 2.5 times as much.)
- W-4. d is measured from outside inwards, on the scalp and a margin around it only. Elsewhere (face, ears, neck,
  shoulders) it continues smoothly and falls back to the sphere of radius 1, and so do the normals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import require
from ..types import Float32, Float64, Floats, Head, RootedStrands, StrandSet
from ._scalp_space_kernels import (
    apply_affine,
    from_root_frames,
    map_frames,
    map_from_scalp,
    map_to_scalp,
    to_root_frames,
    unmap_angles,
)
from .scalp_fit import ScalpMaps, fit_axes, fit_sphere, measure_maps
from .strands import from_dense, resample_smooth

_ORIGIN = np.zeros(3)


@dataclass(frozen=True, slots=True)
class Distortion:
    """How unevenly (u, v) measure the sphere of directions at given places (W-6).

    stretch : (n, 2) float32, the largest and smallest way that the direction moves per radian of (u, v), in radians
        (singular values). An undistorted hemisphere has 2, 2 at the top and 2, 1 at worst, on its border.
    polar_scale : of the root remap; 1 where none was needed.
    largest, smallest : extremes of stretch. area_ratio : largest over smallest area of a unit of (u, v).
    """

    stretch: Float32
    polar_scale: float
    largest: float
    smallest: float
    area_ratio: float


@dataclass(frozen=True, slots=True)
class ScalpSpace:
    """A head's scalp coordinates; plain arrays, so that kernels can use them (`_scalp_space_kernels`).

    centre : (3,) float64, metres, world space. radius : metres.
    rotation : (3, 3) float64; its rows are the axes of head space in world space.
    polar_scale : the root remap of W-6, in (0, 1].
    height : (H, H) float32, head radii: d, the distance from the centre to the scalp (W-4); row i is
        v = pi i / (H - 1), column j is u = pi j / (H - 1), bilinear between.
    normal : (3, H, H) float32, x, y and z of the scalp's smooth unit normals in head space, on the same grid.
    """

    centre: Float64
    radius: float
    rotation: Float64
    polar_scale: float
    height: Float32
    normal: Float32

    def world_to_head(self, points: Floats) -> Float32:
        """World points (..., 3), metres -> head space (..., 3) float32, head radii."""
        return _affine(points, self.centre, self.rotation / self.radius, _ORIGIN)

    def head_to_world(self, points: Floats) -> Float32:
        """Head-space points (..., 3), head radii -> world (..., 3) float32, metres."""
        return _affine(points, _ORIGIN, self.rotation.T * self.radius, self.centre)

    def world_to_head_directions(self, directions: Floats) -> Float32:
        """World directions (..., 3) -> head axes (..., 3) float32; lengths are kept."""
        return _affine(directions, _ORIGIN, self.rotation, _ORIGIN)

    def head_to_world_directions(self, directions: Floats) -> Float32:
        """Head-space directions (..., 3) -> world axes (..., 3) float32; lengths are kept."""
        return _affine(directions, _ORIGIN, self.rotation.T, _ORIGIN)

    def to_scalp(self, points: Floats) -> Float32:
        """Head-space points (..., 3) -> (..., 3) float32: u, v in [0, pi] radians, w in head radii (eq. 1; W-2).

        The centre itself has no direction and is taken as lying below the top.
        """
        flat, result = _rows(points, 3)
        map_to_scalp(flat, self.polar_scale, self.height, result)
        return result.reshape(points.shape)

    def from_scalp(self, coordinates: Floats) -> Float32:
        """Scalp coordinates u, v, w (..., 3) -> head space (..., 3) float32 (eq. 2; W-3). u or v of 0 or pi is S0."""
        flat, result = _rows(coordinates, 3)
        map_from_scalp(flat, self.polar_scale, self.height, result)
        return result.reshape(coordinates.shape)

    def frames_at(self, uv: Floats) -> Float32:
        """Scalp frames at uv (..., 2) -> (..., 3, 3) float32, columns tangent, normal, binormal in head space (W-5).

        The smallest rotation that takes +y to the normal; in the volume the frame of the scalp point with the same uv.
        """
        flat, _ = _rows(uv, 2)
        frames = np.empty((len(flat), 3, 3), np.float32)
        map_frames(flat, self.normal, frames)
        return frames.reshape(*uv.shape[:-1], 3, 3)

    def distortion(self, uv: Floats) -> Distortion:
        """Stretch of the coordinates at uv (n, 2), radians, usually the roots (W-6).

        Raises InputError without a place.
        """
        flat, _ = _rows(uv, 2)
        require(len(flat) > 0, "the distortion needs a root to be measured at")
        stretch = _stretch(flat.astype(np.float64), self.polar_scale)
        areas = stretch.prod(axis=1)
        return Distortion(
            stretch.astype(np.float32),
            self.polar_scale,
            float(stretch.max()),
            float(stretch.min()),
            float(areas.max() / areas.min()),
        )


def fit_scalp_space(
    head: Head, *, up: tuple[float, float, float] = (0.0, 0.0, 1.0), resolution: int = 256
) -> ScalpSpace:
    """Fit scalp space to a head with a scalp (W-2, W-4, W-5, W-6).

    The rules are those of `scalp_fit`: centre and radius of a robust least squares sphere through the scalp; the axis
    nearest to `up` that brings the scalp (nearly) as far into the upper hemisphere as it can; the rest by the remap.

    Parameters
    ----------
    head : with a marked scalp. up : the head's up direction in world space, any length; z in Blender.
    resolution : nodes of the maps along each side.

    Raises
    ------
    InputError : the scalp has no area, `up` has no direction, or fewer than 8 nodes.
    """
    require(resolution >= 8, f"the resolution of the scalp maps is {resolution}; it must be 8 or more")
    upward = np.asarray(up, np.float64)
    length = float(np.linalg.norm(upward)) if upward.shape == (3,) else 0.0
    require(np.isfinite(length) and length > 0, f"the up direction is {up}; it needs three numbers that are not all 0")
    centre, radius = fit_sphere(head)
    rotation, polar_scale = fit_axes(head, centre, upward / length)
    maps: ScalpMaps = measure_maps(head, centre, radius, rotation, polar_scale, resolution)
    return ScalpSpace(centre, radius, rotation, polar_scale, maps.height, maps.normal)


def root_strands(strands: StrandSet, space: ScalpSpace, n_points: int = 64) -> RootedStrands:
    """Strands resampled to `n_points` of uniform arc length in the frames of their roots (W-5, W-7, W-8).

    Strands of fewer points are taken as the Catmull-Rom curves that Blender draws: their corners are no details.

    `strands` in world space, metres; the result in head radii. Raises InputError below 2 points.
    """
    points = resample_smooth(strands, n_points)
    roots = space.world_to_head(points[:, 0])
    uv = np.ascontiguousarray(space.to_scalp(roots)[:, :2])
    frames = space.frames_at(uv)
    local = np.empty_like(points)
    to_root_frames(points, space.rotation / space.radius, frames, local)
    return RootedStrands(roots, frames, uv, local)


def unroot_strands(rooted: RootedStrands, space: ScalpSpace) -> StrandSet:
    """The strands in world space, metres; the inverse of `root_strands` but for its resampling."""
    world = np.empty_like(rooted.points)
    points = np.ascontiguousarray(rooted.points)
    from_root_frames(points, rooted.frames, rooted.roots, space.rotation.T * space.radius, space.centre, world)
    return from_dense(world)


def _stretch(uv: Float64, polar_scale: float) -> Float64:
    """(n, 2) singular values, largest first, of the differential of the map from (u, v) to directions."""
    sines = np.maximum(np.sin(uv), 1e-9)
    stereographic = np.cos(uv) / sines
    squares = (stereographic**2).sum(axis=1)
    # eq. (2) is stereographic, so conformal in cot u and cot v: u and v move the direction at right angles
    by_uv = 2.0 / (1.0 + squares)[:, None] / sines**2
    mapped = 2.0 * np.arctan(np.sqrt(squares))
    azimuth = np.arctan2(stereographic[:, 1], stereographic[:, 0])
    angles = np.empty((len(uv), 2))
    unmap_angles(mapped, polar_scale, angles)
    theta, radial = angles.T
    around = np.divide(np.sin(theta), np.sin(mapped), out=radial.copy(), where=mapped > 1e-6)
    along = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1) * by_uv * radial[:, None]
    across = np.stack([-np.sin(azimuth), np.cos(azimuth)], axis=1) * by_uv * around[:, None]
    return np.asarray(np.linalg.svd(np.stack([along, across], axis=1), compute_uv=False))


def _rows(array: Floats, width: int) -> tuple[Floats, Float32]:
    """`array` (..., width) as contiguous float rows, and float32 rows of 3 for a result."""
    array = np.asarray(array)
    require(
        array.ndim >= 1 and array.shape[-1] == width, f"coordinates must have shape (..., {width}), not {array.shape}"
    )
    if array.dtype not in (np.float32, np.float64):
        array = array.astype(np.float64)
    flat = np.ascontiguousarray(array.reshape(-1, width))
    return flat, np.empty((len(flat), 3), np.float32)


def _affine(points: Floats, before: Float64, matrix: Float64, after: Float64) -> Float32:
    flat, result = _rows(points, 3)
    apply_affine(flat, before, np.ascontiguousarray(matrix), after, result)
    return result.reshape(np.shape(points))
