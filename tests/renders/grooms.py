"""The grooms that the four-view tests are rendered from, on their heads, and their cameras; no Blender."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "blend_templates"))

from hairloom.errors import require  # noqa: E402
from hairloom.geometry.camera import standard_camera  # noqa: E402
from hairloom.geometry.head import default_head, find_scalp, read_head  # noqa: E402
from hairloom.geometry.strands import join_strands  # noqa: E402
from hairloom.io.strands import read_strands  # noqa: E402
from hairloom.io.units import Units  # noqa: E402
from hairloom.types import Camera, Floats, Head, StrandSet  # noqa: E402
from styles import STYLES, make_style  # noqa: E402

VIEWS = ("front", "back", "left", "right")
MARGIN = 0.04  # of the picture, on each side
# All starter grooms are on one head and share their cameras, so that views of several of them can be mixed.
STARTER_CENTRE, STARTER_EXTENT = (0.0, 0.02, 0.155), 0.46  # metres
STARTER_STRANDS = 24_000


@dataclass(frozen=True, slots=True)
class RealGroom:
    """A groom of shared/data. radius : metres at the root, so that its few strands cover the head."""

    parts: tuple[str, ...]
    units: Units
    radius: float
    melanin: float
    redness: float


REAL = {
    "sintel": RealGroom(("hair",), Units(1.0, "Y"), 1.5e-4, 0.45, 0.8),
    "ponytail": RealGroom(("front_top", "side", "back", "tail"), Units(0.24 / 70.0, "Y", "-Z"), 2.6e-4, 0.55, 0.5),
}
NAMES = (*REAL, *STYLES)


@dataclass(frozen=True, slots=True)
class Groom:
    """Hair on a head, world space, metres, face to -y; melanin and redness are Principled Hair's; cameras by view."""

    strands: StrandSet
    head: Head
    melanin: float
    redness: float
    cameras: dict[str, Camera]


def load_groom(
    name: str,
    data: Path,
    size: int = 800,
    *,
    n_strands: int = STARTER_STRANDS,
    seed: int = 0,
    views: tuple[str, ...] = VIEWS,
) -> Groom:
    """One of NAMES. data : the folder shared/data, for the real ones; n_strands, seed : of a starter groom.

    Raises
    ------
    InputError : no such groom. FileError : its files cannot be read.
    """
    require(name in NAMES, f"no groom '{name}'; take one of {', '.join(NAMES)}")
    if name in REAL:
        real = REAL[name]
        files = [data / name / f"{part}.tfx" for part in real.parts]
        strands = join_strands([read_strands(path, units=real.units) for path in files])
        head = find_scalp(read_head(data / name / "head.obj", real.units), strands.roots)
        cameras = frame_cameras(_subject(strands, head), size, views)
        return Groom(_with_radius(strands, real.radius), head, real.melanin, real.redness, cameras)
    head, style = default_head(), STYLES[name]
    strands = make_style(name, head, n_strands, seed=seed)
    thinner = np.float32(min(1.0, (style.n_strands / n_strands) ** 0.5))
    strands.point_attributes["radius"][:] *= thinner
    scale = size * (1.0 - 2.0 * MARGIN) / STARTER_EXTENT
    cameras = {view: standard_camera(view, STARTER_CENTRE, scale, (size, size)) for view in views}
    return Groom(strands, head, style.melanin, style.redness, cameras)


def frame_cameras(points: Floats, size: int, views: tuple[str, ...]) -> dict[str, Camera]:
    """Square orthographic cameras of one scale that hold all points (n, 3), metres."""
    low, high = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    scale = size * (1.0 - 2.0 * MARGIN) / float((high - low).max())
    return {view: standard_camera(view, (low + high) / 2.0, scale, (size, size)) for view in views}


def _subject(strands: StrandSet, head: Head) -> Floats:
    """What a picture has to hold: the hair, and the head without the bust."""
    scalp = head.vertices[np.unique(head.triangles[head.scalp])]
    middle = (scalp.min(axis=0) + scalp.max(axis=0)) / 2.0
    near = np.linalg.norm(head.vertices - middle, axis=1) < 0.19
    return np.concatenate([strands.points, head.vertices[near]])


def _with_radius(strands: StrandSet, radius: float) -> StrandSet:
    """Strands that taper to a quarter of their radius at the tip."""
    counts = strands.point_counts
    along = np.arange(len(strands.points)) - np.repeat(strands.offsets[:-1], counts)
    taper = 1.0 - 0.75 * (along / np.repeat(np.maximum(counts - 1, 1), counts)) ** 2
    return StrandSet(strands.points, strands.offsets, {"radius": (radius * taper).astype(np.float32)})
