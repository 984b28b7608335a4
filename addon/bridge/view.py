"""Blender's 3D views as the backend sees them."""

from __future__ import annotations

import bpy
import numpy as np

from ..backend.editing.strokes import View


def view_of(region: bpy.types.Region, region_3d: bpy.types.RegionView3D) -> View:
    """What a region of a 3D view shows: world space to its pixels, counted from its lower left corner."""
    return View(np.array(region_3d.perspective_matrix, np.float64), float(region.width), float(region.height))
