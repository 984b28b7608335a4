"""Scribbles on photos and strokes along the hair: the text that keeps them, and a stroke while it is drawn.

Pixels of the photo: x to the right, y down, (0, 0) the outer corner of the first pixel. Nothing here knows Blender, so
that tests feed it.
"""

from __future__ import annotations

import itertools
import json
import math
from typing import Any

HAIR, BACKGROUND, ERASE = "hair", "background", "erase"
KINDS = (HAIR, BACKGROUND, ERASE)
Point = tuple[float, float]
_SPACING_PX = 1.0  # nearer points of a stroke say nothing new


class Draft:
    """A stroke of the mouse over a picture, point by point."""

    def __init__(self) -> None:
        self.points: list[Point] = []

    def move(self, x: float, y: float) -> bool:
        """Go on to a pixel; was it far enough to count?"""
        if self.points and math.dist(self.points[-1], (x, y)) < _SPACING_PX:
            return False
        self.points.append((round(x, 2), round(y, 2)))
        return True

    @property
    def length(self) -> float:
        """Pixels."""
        return sum(math.dist(a, b) for a, b in itertools.pairwise(self.points))


def read(text: str) -> list[dict[str, Any]]:
    """The strokes in a property's text."""
    return json.loads(text) if text else []


def add_scribble(text: str, kind: str, width: float, points: list[Point]) -> str:
    """The text with one more scribble, or with what the eraser passes taken out."""
    if not points:
        return text
    scribbles = read(text)
    if kind == ERASE:
        scribbles = [piece for scribble in scribbles for piece in _rest(scribble, points, width)]
    else:
        scribbles.append({"kind": kind, "width": width, "points": points})
    return _text(scribbles)


def _rest(scribble: dict[str, Any], eraser: list[Point], width: float) -> list[dict[str, Any]]:
    """What is left of a scribble when an eraser of `width` has gone along `eraser`."""
    reach = 0.5 * (width + scribble["width"])
    pieces: list[list[Point]] = [[]]
    for point in _dense(scribble["points"], 0.5 * reach):
        if distance_to_path(point, eraser) <= reach:
            pieces.append([])
        else:
            pieces[-1].append(point)
    if len(pieces) == 1:
        return [scribble]
    return [{**scribble, "points": piece} for piece in pieces if piece]


def _dense(points: list[Point], spacing: float) -> list[Point]:
    """The path with so many points that an eraser does not slip between two."""
    found: list[Point] = [tuple(points[0])]
    for a, b in itertools.pairwise(points):
        count = max(1, math.ceil(math.dist(a, b) / spacing))
        found += [(a[0] + (b[0] - a[0]) * i / count, a[1] + (b[1] - a[1]) * i / count) for i in range(1, count + 1)]
    return found


def distance_to_path(point: Point, path: list[Point]) -> float:
    """From a point to a path of one point or more."""
    if len(path) == 1:
        return math.dist(point, path[0])
    return min(_to_segment(point, a, b) for a, b in itertools.pairwise(path))


def _to_segment(point: Point, a: Point, b: Point) -> float:
    across, down = b[0] - a[0], b[1] - a[1]
    squared = across * across + down * down
    along = ((point[0] - a[0]) * across + (point[1] - a[1]) * down) / squared if squared else 0.0
    along = min(max(along, 0.0), 1.0)
    return math.dist(point, (a[0] + along * across, a[1] + along * down))


def add_stroke(text: str, camera: dict[str, Any], points: list[Point]) -> str:
    """The text with one more stroke along the hair, root first; `camera` is {'view': name} or a camera's numbers."""
    return _text([*read(text), {**camera, "points": points}])


def without_last(text: str) -> str:
    return _text(read(text)[:-1])


def _text(strokes: list[dict[str, Any]]) -> str:
    return json.dumps(strokes, separators=(",", ":")) if strokes else ""
