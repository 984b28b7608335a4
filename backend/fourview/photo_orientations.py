"""The photos' own orientation, carried from their pixels to the tangent planes of the texels that they show.

The paper filters the texture alone (Z-19). Where a photo shows the surface, the texture is that photo sampled twice and
merged with others, and its thinnest lines are lost; the photo itself still has them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..fields.orientation import orientation_map
from ..geometry.camera import towards
from ..types import Camera, Float32, Float64, Mesh
from .projection import project_views
from .regions import outer_products, unit
from .texels import TexelMap
from .views import View

_FACING_POWER = 2  # of the cosine between normal and view: flat views of a surface tell little of what lies on it


def photo_orientations(texels: TexelMap, views: Sequence[View], occluder: Mesh) -> tuple[Float32, Float32]:
    """Sums over the photos of w o o^T, o being the orientation (unit, tangential) that a photo shows at a texel.

    A photo's orientation is that of `fields.orientation`; seen from the camera the texel's o has it too. w is its
    confidence times the squared cosine between normal and view.

    Parameters
    ----------
    views : any number. occluder : world space, metres; hides texels from views.

    Returns
    -------
    tensors : (T, 6) float32, see regions.outer_products. weights : (T,) float32, the sums of w, 0 where no photo sees
    the texel.
    """
    tensors, weights = np.zeros((texels.n_texels, 6), np.float32), np.zeros(texels.n_texels, np.float32)
    if not views:
        return tensors, weights
    on_views = project_views(texels, views, occluder)
    for index, view in enumerate(views):
        shown = np.flatnonzero(on_views.visible[index])
        column, row = on_views.pixels[index, shown].astype(np.int64).T
        found = orientation_map(view.image, view.mask)
        weight = found.confidence[row, column] * on_views.facing[index, shown] ** _FACING_POWER
        along = _on_planes(view.camera, texels.points[shown], texels.normals[shown], found.angle[row, column])
        tensors[shown] += weight[:, None] * outer_products(along)
        weights[shown] += weight
    return tensors, weights


def _on_planes(camera: Camera, points: Float32, normals: Float32, angles: Float32) -> Float64:
    """(n, 3) unit: the lines at `angles` in the picture, on the tangent planes of points; 0 on planes seen edge-on."""
    right, down, _ = camera.world_to_camera[:3, :3]
    line = np.cos(angles)[:, None] * right + np.sin(angles)[:, None] * down
    return unit(np.cross(normals, np.cross(towards(camera, points), line)))
