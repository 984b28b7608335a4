"""How a photo's plane moves under its handles: from the matrix at the start of a drag and how far the handle went.

The plane's own x points right in the picture, y up, z out of it; turns go about a pivot, the middle of the head, so
that what was laid over the head there stays there.
"""

from __future__ import annotations

from mathutils import Matrix, Vector

_LEAST_SCALE = 0.02


def axis(matrix: Matrix, index: int) -> Vector:
    """The plane's own axis, unit length, world space."""
    return matrix.col[index].to_3d().normalized()


def moved(start: Matrix, index: int, metres: float) -> Matrix:
    """Along the plane's own x (0) or y (1)."""
    return Matrix.Translation(axis(start, index) * metres) @ start


def turned(start: Matrix, pivot: Vector, angle: float) -> Matrix:
    """In its plane, counter-clockwise in the picture, radians."""
    return _about(start, pivot, axis(start, 2), angle)


def tilted(start: Matrix, pivot: Vector, index: int, angle: float) -> Matrix:
    """Another view direction: about the plane's own x (0) or y (1), radians."""
    return _about(start, pivot, axis(start, index), angle)


def scaled(start: Matrix, pivot: Vector, factor: float) -> Matrix:
    """Larger or smaller, away from or towards the pivot's place in the picture."""
    factor = max(factor, _LEAST_SCALE)
    foot = pivot - axis(start, 2) * (pivot - start.translation).dot(axis(start, 2))
    shift = foot + (start.translation - foot) * factor
    result = start.copy()
    for index in range(3):
        result.col[index] = start.col[index] * factor
    result.translation = shift
    return result


def _about(start: Matrix, pivot: Vector, around: Vector, angle: float) -> Matrix:
    there = Matrix.Translation(pivot)
    return there @ Matrix.Rotation(angle, 4, around) @ there.inverted() @ start
