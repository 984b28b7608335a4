"""What the views see of a surface's texels: pixels, visibility, weights (Z-12, Z-14, Z-15)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import require
from ..geometry.view_raster import raster_mesh
from ..types import Bools, Float32, Mesh, check_array
from ._projection_kernels import fill_from_border, sample_picture, see_texels
from .texels import TexelMap
from .views import View

MAX_PAIRS = 4e8  # of holes and their borders, beyond which the borders are thinned


@dataclass(frozen=True, slots=True)
class ProjectionParams:
    """Settings of project_views."""

    source_angle: float = np.pi / 4  # theta, radians between normal and view within which a texel is a source (Z-15)
    tolerance: float = 0.004  # metres that a texel may lie behind the shape that hides it: they are meshed differently

    def __post_init__(self) -> None:
        require(0 < self.source_angle <= np.pi / 2, f"source_angle is {self.source_angle}; it must be up to pi / 2")
        require(0 < self.tolerance < 1, f"tolerance is {self.tolerance} m; it must be above 0 and below 1")


@dataclass(frozen=True, slots=True)
class ViewsOnTexels:
    """T texels in n views, of one scale.

    pixels : (n, T, 2) float32, where each texel lies in each view (x right, y down).
    visible : (n, T) bool, unobstructed, facing the camera at any angle, in the picture and in the hair mask.
    seen : (n, T) bool, the source region S of Z-15: visible, and less than 45 degrees between normal and view.
    facing : (n, T) float32 in [0, 1], dot(normal, direction towards the camera), 0 where negative.
    """

    pixels: Float32
    visible: Bools
    seen: Bools
    facing: Float32

    def __post_init__(self) -> None:
        check_array("pixels", self.pixels, np.float32, (None, None, 2))
        shape = self.pixels.shape[:2]
        check_array("visible", self.visible, np.bool_, shape)
        check_array("seen", self.seen, np.bool_, shape)
        check_array("facing", self.facing, np.float32, shape)

    @property
    def alpha(self) -> Float32:
        """(n, T) float32: `facing`, normalised to sum 1 over the views; 0 where no view faces the texel (Z-14)."""
        total = self.facing.sum(axis=0)
        return np.asarray(self.facing / np.where(total > 0, total, 1), np.float32)


def project_views(
    texels: TexelMap, views: Sequence[View], occluder: Mesh, params: ProjectionParams = ProjectionParams()
) -> ViewsOnTexels:
    """Where the texels lie in the views, and which views see them (Zhang et al. 2017, sec. 4.3; Z-14, Z-15).

    Parameters
    ----------
    views : at the size of this scale; pixels are of their cameras. occluder : the closed shape that may hide texels.

    Raises
    ------
    InputError : no views.
    """
    require(len(views) > 0, "there are no views; give a photo with its mask and camera")
    shape = (len(views), texels.n_texels)
    pixels, facing = np.empty((*shape, 2), np.float32), np.empty(shape, np.float32)
    visible, seen = np.empty(shape, np.bool_), np.empty(shape, np.bool_)
    for index, view in enumerate(views):
        camera = view.camera
        raster = raster_mesh(camera, occluder.vertices, occluder.triangles)
        see_texels(
            texels.points,
            texels.normals,
            np.ascontiguousarray(camera.world_to_camera),
            np.ascontiguousarray(camera.intrinsics),
            camera.orthographic,
            raster.depth,
            view.mask,
            params.tolerance,
            float(np.cos(params.source_angle)),
            pixels[index],
            visible[index],
            seen[index],
            facing[index],
        )
    return ViewsOnTexels(pixels, visible, seen, facing)


def sample_view(view: View, pixels: Float32, where: Bools) -> Float32:
    """(T, 3) float32 in [0, 1], sRGB: bilinear colours of a view's hair at `pixels` (T, 2), 0 but for texels `where`.

    Pixels outside the mask add nothing, so that no background mixes in.
    """
    colours = np.zeros((len(pixels), 3), np.float32)
    image = view.image.astype(np.float32) / np.float32(255)
    sample_picture(image, view.mask, np.ascontiguousarray(pixels), np.ascontiguousarray(where), colours)
    return colours


def initial_texture(texels: TexelMap, on_views: ViewsOnTexels, views: Sequence[View]) -> Float32:
    """(T, 3) float32 in [0, 1]: each texel from the view that faces it most among those that see it (Z-12).

    Texels that no view sees are filled by inverse squared distance from the borders of such holes.

    Raises
    ------
    InputError : no view sees anything of the surface.
    """
    found = on_views.visible.any(axis=0)
    names = ", ".join(view.name for view in views)
    require(found.any(), f"none of the views ({names}) sees hair on the shape; check their cameras and masks")
    best = np.where(on_views.visible, on_views.facing, np.float32(-1)).argmax(axis=0)
    colours = np.zeros((texels.n_texels, 3), np.float32)
    for index, view in enumerate(views):
        chosen = found & (best == index)
        colours[chosen] = sample_view(view, on_views.pixels[index], chosen)[chosen]
    return fill_holes(texels, colours, found)


def fill_holes(texels: TexelMap, colours: Float32, known: Bools) -> Float32:
    """Colours (T, 3) float32 with those that are not `known` (T,) filled from the holes' borders (Z-12).

    By inverse squared distance in space from the known texels that have an edge to a hole; these are thinned evenly
    where there would be more than MAX_PAIRS of hole and border. Known colours stay.
    """
    filled = colours.copy()
    holes = np.flatnonzero(~known)
    if len(holes) == 0:
        return filled
    ends = texels.edges[known[texels.edges[:, 0]] != known[texels.edges[:, 1]]]
    border = np.unique(np.where(known[ends[:, 0]], ends[:, 0], ends[:, 1]))
    if len(border) == 0:  # holes are whole parts of the surface
        border = np.flatnonzero(known)
    step = int(np.ceil(len(border) * len(holes) / MAX_PAIRS))
    border = border[:: max(step, 1)]
    values = np.empty((len(holes), 3), np.float32)
    fill_from_border(texels.points[holes], texels.points[border], colours[border], values)
    filled[holes] = values
    return filled
