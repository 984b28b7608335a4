"""The commands of the command line about rods: fit-helices, simulate, bake."""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import fields, is_dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from .errors import require
from .geometry.head import default_head, find_scalp
from .io.alembic import AlembicWriter
from .io.files import atomic_write
from .io.npz import write_arrays
from .io.sim_cache import CacheReader
from .io.strands import read_strands
from .io.units import Units
from .jobs.scene_file import SceneFile, read_scene_file
from .progress import Progress
from .registry import run_job
from .rods.fitting import FitParams, fit_helices
from .rods.helix_files import write_helices
from .types import StrandSet

Report = dict[str, Any]
Clock = Callable[[str], None]


def add_commands(
    command: Callable[..., argparse.ArgumentParser], hair: argparse.ArgumentParser
) -> None:  # fmt: skip
    """Add the commands; `command(name, run, text, *parents)` makes one, `hair` is the parent that reads a groom."""
    _add_fit(command("fit-helices", _fit_helices, "Turn strands into helices, and say how near they are.", hair))
    _add_simulate(command("simulate", _simulate, "Move hair over a scene: head motion, wind, colliders.", hair))
    _add_bake(command("bake", _bake, "Write a cache of `simulate` to an Alembic file.", hair))


def _groom(options: argparse.Namespace) -> StrandSet:
    strands = read_strands(options.hair, units=Units.parse(options.units) if options.units else None)
    require(strands.n_strands > 0, f"{options.hair} has no strands; choose a groom that has")
    return strands


def _add_fit(parser: argparse.ArgumentParser) -> None:
    defaults = FitParams()
    parser.add_argument("out", type=Path, help="the .npz of helices to write")
    parser.add_argument("--exact", action="store_true", help="write float64 instead of float32")
    for name, kind, text in (
        ("n-min", int, "elements of short strands"),
        ("n-max", int, "elements of long strands, and the most of any"),
        ("n-elements", int, "elements of every strand; 0: adaptive"),
        ("l-min", float, "m; shorter strands are short"),
        ("l-max", float, "m; longer strands are long"),
        ("tolerance", float, "m; strands with a larger RMS distance get more elements; 0: the paper's numbers"),
        ("samples-per-segment", int, "points of a strand for each segment of its spline"),
        ("polish", int, "least-squares steps after the fit, with the same elements; 0: the paper"),
    ):
        default = getattr(defaults, name.replace("-", "_"))
        parser.add_argument(f"--{name}", type=kind, default=default, help=f"{text} (default: {default})")


def _fit_helices(options: argparse.Namespace, clock: Clock, progress: Progress) -> Report:
    params = FitParams(
        n_min=options.n_min, n_max=options.n_max, l_min=options.l_min, l_max=options.l_max,
        n_elements=options.n_elements, tolerance=options.tolerance, samples_per_segment=options.samples_per_segment,
        polish=options.polish,
    )  # fmt: skip
    clock("read")
    strands = _groom(options)
    clock("fit")
    fit = fit_helices(strands, params, progress=progress)
    clock("write")
    write_helices(options.out, fit.helices, exact=options.exact)
    clock("report")
    return fit.report(strands) | {"out": str(options.out)}


def _add_simulate(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", type=Path, help="the .toml that says what happens (docs/simulation.md)")
    parser.add_argument("out", type=Path, help="the .npz to write: positions (frames, points, 3), offsets")
    parser.add_argument("--cache", type=Path, help="folder for the frames, to resume from; default: a temporary one")
    parser.add_argument("--resume", action="store_true", help="go on with the cache after its last frame")


def _simulate(options: argparse.Namespace, clock: Clock, progress: Progress) -> Report:
    require(not options.resume or options.cache is not None, "--resume needs --cache, the folder to go on with")
    clock("read")
    strands = _groom(options)
    scene_file = read_scene_file(options.scene)
    head = scene_file.head
    if head is not None and not head.scalp.any():
        head = find_scalp(head, strands.roots)
    clock("guides")
    made = run_job("make_guides", {"strands": strands, "head": head or default_head()}, scene_file.guides)
    with ExitStack() as stack:
        cache = options.cache or stack.enter_context(TemporaryDirectory())
        settings = scene_file.settings | {"cache": str(cache), "resume": options.resume}
        settings["fingerprint"] = fingerprint_of(strands, scene_file)
        inputs = {"strands": strands, "guides": made["guides"], "wisps": made["wisps"], "scene": scene_file.scene}
        clock("simulate")
        report: Report = run_job("simulate", inputs, settings, progress)["report"]
        clock("write")
        _write_frames(options.out, CacheReader(cache), strands)
    return report | {"out": str(options.out)}


def fingerprint_of(strands: StrandSet, scene_file: SceneFile) -> str:
    """What a cache to resume must have in common: the groom, the scene and all settings."""
    digest = hashlib.sha256()
    for value in (strands, scene_file.scene, repr(scene_file.settings), repr(scene_file.guides)):
        _add_to(digest, value)
    return digest.hexdigest()


def _add_to(digest: Any, value: Any) -> None:
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif is_dataclass(value):
        for entry in fields(value):
            _add_to(digest, getattr(value, entry.name))
    elif isinstance(value, tuple):
        for item in value:
            _add_to(digest, item)
    else:
        digest.update(repr(value).encode())


def _write_frames(path: Path, cache: CacheReader, strands: StrandSet) -> None:
    """All frames in one .npz, world space, metres."""
    frames = np.stack([cache.frame(cache.frame_start + number) for number in range(cache.n_frames)])
    arrays = {
        "positions": frames,
        "offsets": strands.offsets,
        "fps": np.array(cache.fps),
        "frame_start": np.array(cache.frame_start),
    }
    with atomic_write(path) as stream:
        write_arrays(stream, arrays)


def _add_bake(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("cache", type=Path, help="the folder that `simulate --cache` filled, of the same hair")
    parser.add_argument("out", type=Path, help="the .abc to write: curves, a sample a frame; metres, y up")


def _bake(options: argparse.Namespace, clock: Clock, progress: Progress) -> Report:
    clock("read")
    strands, cache = _groom(options), CacheReader(options.cache)
    n_points = len(strands.points)
    require(cache.n_points == n_points, f"the cache has {cache.n_points} points, {options.hair} has {n_points}")
    require(cache.n_frames > 0, f"the cache {options.cache} has no whole frame; simulate again")
    radius = strands.point_attributes.get("radius")
    widths = None if radius is None else np.maximum(2 * radius, 0).astype(np.float32)
    clock("write")
    with AlembicWriter(options.out, fps=cache.fps, frame_start=cache.frame_start) as file:
        curves = file.add_curves(Path(options.hair).stem, strands.point_counts)
        for number in range(cache.n_frames):
            progress(number / cache.n_frames, f"Frame {cache.frame_start + number}")
            curves.write(cache.frame(cache.frame_start + number), widths if number == 0 else None)
    return {"frames": cache.n_frames, "strands": strands.n_strands, "points": n_points, "out": str(options.out)}
