"""Frame strips of the paper's simulations on our grooms (Bao & Qi 2017, Fig. 4 and 5): head shake, wind, head moving.

    python docs/figure_simulation.py [NAME ...]     writes docs/pictures/simulation_*.png, docs/figure_simulation.md
    python docs/figure_simulation.py --numbers      measures again, for the page, and keeps the pictures

Needs bpy (`pip install bpy`), renders with Cycles; about 12 minutes on 2 cores for all.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "blend_templates")]

import bpy  # noqa: E402, F401  before the modules that it brings
import numpy as np  # noqa: E402
from hairloom.geometry.head import HeadSurface  # noqa: E402
from hairloom.io.sim_cache import CacheReader  # noqa: E402
from hairloom.registry import run_job  # noqa: E402
from hairloom.rods.scene import CollisionMesh, ForceField, Scene  # noqa: E402
from hairloom.types import Float32, Float64, Head, StrandSet  # noqa: E402
from make_grooms import load_groom  # noqa: E402
from render import RenderParams, render_strands, side_by_side  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

PICTURES = HERE / "pictures"
PIXELS = 300
FPS = 24.0
N_GUIDES = 500


@dataclass(frozen=True)
class Strip:
    """A figure: what moves the hair of which style, the frames that are shown, and from where."""

    title: str
    style: str
    motion: str = "still"
    wind: float = 0.0
    shown: tuple[int, ...] = (0, 3, 9, 15, 21)
    view: str = "three_quarter"


STRIPS = {
    "shake_straight": Strip("Fig. 4, top: head shaking, straight (2 Hz, 20 degrees)", "straight", "shake"),
    "wind_wavy": Strip("Fig. 4, middle: wind (8 m/s, gusts), wavy", "wavy", wind=8.0, shown=(0, 8, 16, 24, 40)),
    "move_straight": Strip("Fig. 4, bottom: head moving (15 cm to either side, 1 Hz), straight", "straight", "move"),
    "wind_straight": Strip("Fig. 5, top: wind, straight", "straight", wind=8.0, shown=(0, 8, 16, 24, 40)),
    "shake_curly": Strip("Fig. 5, middle: head shaking, curly", "curly", "shake"),
}


def head_motion(kind: str, n_frames: int, pivot: Float64) -> Float64:
    seconds = np.arange(n_frames) / FPS
    motion = np.tile(np.eye(4), (n_frames, 1, 1))
    if kind == "shake":
        angles = np.radians(20.0) * np.sin(4.0 * np.pi * seconds)
        motion[:, :3, :3] = Rotation.from_rotvec(angles[:, None] * np.array([0, 0, 1.0])).as_matrix()
        motion[:, :3, 3] = pivot - motion[:, :3, :3] @ pivot
    elif kind == "move":
        motion[:, 0, 3] = 0.15 * np.sin(2.0 * np.pi * seconds)
    return motion


def wind_from_the_left(speed: float, n_frames: int) -> ForceField:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.align_vectors([[1.0, 0.4, 0.1]], [[0, 0, 1.0]])[0].as_matrix()
    rising = speed * np.minimum(np.arange(n_frames) / 6.0, 1.0)
    return ForceField("wind", np.tile(matrix, (n_frames, 1, 1)), rising, np.full(n_frames, 0.4), seed=1)


def moved_head(head: Head, matrix: Float64) -> Head:
    return replace(head, vertices=(head.vertices @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32))


def make(name: str, strip: Strip, folder: Path, render: bool) -> dict[str, Any]:
    """Simulate, render the strip, and measure: seconds, deepest hair, its way."""
    strands, head = load_groom(strip.style)
    n_frames = max(strip.shown) + 1
    motion = head_motion(strip.motion, n_frames, head.vertices.mean(axis=0).astype(float))
    fields = (wind_from_the_left(strip.wind, n_frames),) if strip.wind else ()
    scene = Scene(FPS, motion, colliders=(CollisionMesh(head.triangles, head.vertices, motion),), fields=fields)
    made = run_job("make_guides", {"strands": strands, "head": head}, {"n_guides": N_GUIDES})
    inputs = {"strands": strands, "guides": made["guides"], "wisps": made["wisps"], "scene": scene}
    since = time.perf_counter()
    report = run_job("simulate", inputs, {"cache": str(folder / name)})["report"]
    seconds = time.perf_counter() - since
    cache = CacheReader(folder / name)
    frames = [np.array(cache.frame(cache.frame_start + frame)) for frame in strip.shown]
    rest_depth = HeadSurface(head).signed_distance(strands.points)
    numbers = {"seconds": seconds, "frames": n_frames, "guides": report["guides"], "elements": report["elements"]}
    depths = []
    for frame, points in zip(strip.shown, frames):
        placed = moved_head(head, motion[frame])
        depths.append(np.minimum(rest_depth, 0.0) - HeadSurface(placed).signed_distance(points))
    if render:
        render_strip(name, strip, folder, strands, [moved_head(head, motion[frame]) for frame in strip.shown], frames)
    moved = float(np.linalg.norm(frames[-1] - frames[0], axis=1).max())
    over = int((np.array(depths) > 0.001).sum())
    return numbers | {"deepest": float(np.max(depths)), "over": over, "points": np.size(depths), "moved": moved}


def render_strip(
    name: str, strip: Strip, folder: Path, strands: StrandSet, heads: Sequence[Head], frames: Sequence[Float32]
) -> None:
    box, images = np.concatenate([head.vertices for head in heads] + list(frames)), []
    for frame, head, points in zip(strip.shown, heads, frames):
        now = StrandSet(points, strands.offsets, strands.point_attributes)
        params = RenderParams(view=strip.view, size=(PIXELS, PIXELS), samples=12)
        images.append(render_strands(now, head, folder / f"{name}-{frame}.png", params, frame_on=box))
    labels = [f"{frame / FPS:.2f} s" for frame in strip.shown]
    side_by_side(images, labels, PICTURES / f"simulation_{name}.png")


def write_page(numbers: dict[str, dict[str, Any]]) -> None:
    lines = [
        "# Simulations",
        "",
        "The scenes of Bao & Qi 2017, Fig. 4 and 5, on our starter grooms: all hair follows its guides, which start in",
        "equilibrium. Made by `docs/figure_simulation.py`. Depth is what hair is deeper in the head than at rest.",
        "",
    ]
    for name, strip in STRIPS.items():
        if name in numbers:
            found = numbers[name]
            lines += [
                f"## {strip.title}",
                "",
                f"![{strip.title}](pictures/simulation_{name}.png)",
                "",
                f"{found['guides']} guides of {found['elements']} elements, {found['frames']} frames in "
                f"{found['seconds']:.1f} s with fit, rest shape and all hair written; deepest "
                f"{1000 * found['deepest']:.2f} mm, {found['over']} of {found['points']:,} points over 1 mm; "
                f"farthest way {100 * found['moved']:.1f} cm.",
                "",
            ]
    (HERE / "figure_simulation.md").write_text("\n".join(lines), encoding="utf-8")


def main() -> int:
    render = "--numbers" not in sys.argv
    names = [name for name in sys.argv[1:] if name != "--numbers"] or list(STRIPS)
    with tempfile.TemporaryDirectory() as folder:
        numbers = {name: make(name, STRIPS[name], Path(folder), render) for name in names}
    for name, found in numbers.items():
        print(name, found)
    if len(names) == len(STRIPS):
        write_page(numbers)
    sys.stdout.flush()
    os._exit(0)  # bpy may hang at exit


if __name__ == "__main__":
    main()
