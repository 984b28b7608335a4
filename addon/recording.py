"""Recorded strokes: kept with the Curves, so that undo takes the last one back and saving keeps them.

The first line says how many strands and points the groom had, each further line is a stroke as JSON.
"""

from __future__ import annotations

import bpy

_KEY = "hairloom_strokes"


def strokes(curves: bpy.types.Curves) -> list[str]:
    """The recorded strokes, the oldest first."""
    return str(curves.get(_KEY, "")).splitlines()[1:]


def size(curves: bpy.types.Curves) -> tuple[int, int]:
    """The numbers of strands and points that the recorded strokes belong to."""
    n_strands, n_points = str(curves[_KEY]).split("\n", 1)[0].split()
    return int(n_strands), int(n_points)


def add(curves: bpy.types.Curves, stroke: str) -> None:
    """Append a stroke; those of another number of strands, before hair was added or removed, are dropped."""
    now = (len(curves.curves), len(curves.points))
    if _KEY not in curves or size(curves) != now:
        curves[_KEY] = f"{now[0]} {now[1]}"
    curves[_KEY] = f"{curves[_KEY]}\n{stroke}"


def clear(curves: bpy.types.Curves) -> None:
    if _KEY in curves:
        del curves[_KEY]
