"""What the sessions of the comb look at: the groom's positions, where they are on the screen, and what must hold."""

from __future__ import annotations

import bpy
import driver
import numpy as np
import scenes


def hair() -> bpy.types.Object:
    """The groom, looked up anew: references do not outlive an undo."""
    return next(obj for obj in bpy.data.objects if obj.type == "CURVES")


def positions() -> np.ndarray:
    return scenes.positions(hair())


def settings() -> bpy.types.PropertyGroup:
    return bpy.context.scene.hairloom.comb


def world() -> np.ndarray:
    return scenes.module("bridge.curves").read_strands(hair()).points


def on_screen(user: driver.User, points: np.ndarray) -> np.ndarray:
    """(n, 2) pixels of the window of world points (n, 3)."""
    region = user.region()
    matrix = np.array(user.area().spaces.active.region_3d.perspective_matrix, np.float64)
    clip = points @ matrix[:3, :3].T + matrix[:3, 3]
    depth = points @ matrix[3, :3] + matrix[3, 3]
    size = np.array([region.width, region.height]) / 2
    return clip[:, :2] / depth[:, None] * size + size + (region.x, region.y)


def offsets() -> np.ndarray:
    data = hair().data.curve_offset_data
    found = np.empty(len(data), np.int32)
    data.foreach_get("value", found)
    return found


def check_strands(before: np.ndarray, after: np.ndarray, resized: bool = False) -> None:
    """Roots to the bit, lengths within the issue's 0.5 %."""
    starts = offsets()
    assert (after[starts[:-1]] == before[starts[:-1]]).all(), "roots moved"
    if resized:
        return
    ratio = lengths(after, starts) / np.maximum(lengths(before, starts), 1e-9)
    assert np.abs(ratio - 1).max() < 0.005, f"lengths changed by {np.abs(ratio - 1).max():.2%}"


def lengths(points: np.ndarray, starts: np.ndarray) -> np.ndarray:
    steps = np.linalg.norm(np.diff(points.astype(np.float64), axis=0), axis=1)
    steps = np.append(steps, 0.0)
    steps[starts[1:] - 1] = 0.0
    return np.add.reduceat(steps, starts[:-1])


def moved(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    return np.linalg.norm(after - before, axis=1)


def undo_to(user: driver.User, expected: np.ndarray, redo: bool = False) -> driver.Steps:
    """One Ctrl-Z, or with `redo` Ctrl-Shift-Z, which must lead to exactly these positions."""
    modifiers = {"ctrl": True, "shift": True} if redo else {"ctrl": True}
    yield from user.key("Z", **modifiers)
    what = "redo leads forth" if redo else "one Ctrl-Z leads back"
    yield from user.wait(lambda: positions().tobytes() == expected.tobytes(), 60, what)
