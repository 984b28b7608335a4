"""What hair must not enter: the head."""

from __future__ import annotations

import numpy as np
from hairloom.geometry.head import HeadSurface
from hairloom.geometry.scalp_region import require_scalp
from hairloom.types import Float32, Float64, Floats, Head
from scipy.ndimage import map_coordinates

_GRID_CELLS = 52  # along the longest side of the head's box
_GRID_MARGIN = 0.5  # head radii around the head
_EXACT_BELOW = 0.1  # head radii: nearer than that to the skin, the mesh itself is asked


class Collider:
    """Distances to a head in the groom's own unit: origin at the middle of the scalp's sphere, its radius 1.

    Growing asks for distances a million times, and roughly is enough there: `distance` looks them up on a grid.
    `push_out` asks the mesh itself where it matters.

    Attributes
    ----------
    centre : (3,) float64, metres, and radius : metres, of the sphere that fits the scalp best.
    """

    def __init__(self, head: Head) -> None:
        require_scalp(head)
        self.surface = HeadSurface(head)
        self.centre, self.radius = fit_sphere(head.vertices[np.unique(head.triangles[head.scalp])])
        low, high = (self.to_unit(extreme(head.vertices, axis=0)) for extreme in (np.min, np.max))
        self._origin = low - _GRID_MARGIN
        size = high + _GRID_MARGIN - self._origin
        self._spacing = float(size.max() / (_GRID_CELLS - 1))
        shape = np.ceil(size / self._spacing).astype(int) + 1
        axes = [self._origin[axis] + self._spacing * np.arange(shape[axis]) for axis in range(3)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        distance = self.surface.signed_distance(self.to_world(points.reshape(-1, 3))) / self.radius
        distance = distance.reshape(points.shape[:3]).astype(np.float64)
        self._fields = [distance, *np.gradient(distance, self._spacing)]

    def to_world(self, points: Floats) -> Float32:
        """(..., 3) float32, metres."""
        return np.asarray(points * self.radius + self.centre, dtype=np.float32)

    def to_unit(self, points: Floats) -> Float64:
        """(..., 3) float64, scalp radii."""
        return np.asarray((points - self.centre) / self.radius, dtype=np.float64)

    def distance(self, points: Floats) -> tuple[Float64, Float64]:
        """Distance (n,) to the head, negative inside, and its unit gradient (n, 3), by interpolation."""
        coordinates = ((points - self._origin) / self._spacing).T
        values = [map_coordinates(field, coordinates, order=1, mode="nearest") for field in self._fields]
        gradient = np.stack(values[1:], axis=-1)
        gradient /= np.maximum(np.linalg.norm(gradient, axis=-1, keepdims=True), 1e-9)
        return values[0], gradient

    def push_out(self, points: Float64, soft: Float64) -> Float64:
        """Move points (n, 3) out of the head, and squeeze the layer `soft` (n,) thick above the skin to make room.

        A point at height h < soft over the skin (h < 0: inside) goes to soft exp(h / soft - 1): above 0, and in the
        order of before, so that strands bend away from the head instead of lying flattened on it.
        """
        moved = points.copy()
        near = np.flatnonzero((self.distance(points)[0] < _EXACT_BELOW) & (soft > 0))
        if len(near) == 0:
            return moved
        world = self.to_world(points[near])
        height = self.surface.signed_distance(world).astype(np.float64) / self.radius
        low = height < soft[near]
        near, height, thickness = near[low], height[low], soft[near][low]
        closest, triangle, barycentric = self.surface.closest_points(world[low])
        normals = self.surface.normals_at(triangle, barycentric)
        new_height = thickness * np.exp(np.maximum(height / thickness, -12.0) - 1.0)
        moved[near] = self.to_unit(closest) + normals * new_height[:, None]
        return moved


def fit_sphere(points: Floats) -> tuple[Float64, float]:
    """Centre (3,) and radius of the least-squares sphere through points (n, 3), n >= 4 and not in a plane."""
    points = np.asarray(points, dtype=np.float64)
    middle = points.mean(axis=0)
    local = points - middle
    system = np.hstack([2.0 * local, np.ones((len(local), 1))])
    solution = np.linalg.lstsq(system, (local**2).sum(axis=1), rcond=None)[0]
    return middle + solution[:3], float(np.sqrt(solution[3] + solution[:3] @ solution[:3]))
