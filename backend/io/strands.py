"""Reading and writing hair by file suffix: .hair, .data, .tfx, .ply, .obj and .npz.

suffix  unless told     attributes kept; others are lost on writing       strands it can hold
.hair   metres, z up    of points: radius, transparency, color (RGB)     up to 65,536 points
.data   metres, y up    none                                             two points or more; of one: empty
.tfx    metres, y up    version 4 only, of points: inverse_mass, uv,     version 2: any
                        color (RGBA); of strands: radius,                version 3 and 4: all with one number
                        surface_uv_coordinate                            of points
.ply    metres, y up    of points: radius, color (RGB)                   all with one number of points
.obj    metres, y up    none                                             any
.npz    metres, z up    all                                              any
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FileError, InputError, require
from ..types import StrandSet
from . import data, hair, npz, obj, ply, tfx
from .files import atomic_write, damaged, read_file
from .raw import Dropped, RawStrands, strands_from_raw
from .units import METRES_Y_UP, METRES_Z_UP, PRESETS, Units

__all__ = ["PRESETS", "ReadReport", "Units", "read_strands", "read_strands_report", "suffixes", "write_strands"]


@dataclass(frozen=True, slots=True)
class _Format:
    read: Callable[[Path, bytes], RawStrands]
    write: Callable[[IO[bytes], RawStrands], None]
    units: Units


_FORMATS: dict[str, _Format] = {
    ".hair": _Format(hair.read, hair.write, METRES_Z_UP),
    ".data": _Format(data.read, data.write, METRES_Y_UP),
    ".tfx": _Format(tfx.read, tfx.write, METRES_Y_UP),
    ".ply": _Format(ply.read, ply.write, METRES_Y_UP),
    ".obj": _Format(obj.read, obj.write, METRES_Y_UP),
    ".npz": _Format(npz.read, npz.write, METRES_Z_UP),
}


@dataclass(frozen=True, slots=True)
class ReadReport:
    """What was read and what was set aside."""

    n_strands_in_file: int
    dropped: Dropped
    units: Units


def suffixes() -> tuple[str, ...]:
    """The suffixes of the strand files that can be read and written."""
    return tuple(_FORMATS)


def default_units(path: str | os.PathLike[str]) -> Units:
    """The units assumed for a file of this name."""
    return _format_of(Path(path)).units


def read_strands(
    path: str | os.PathLike[str], *, units: Units | None = None, points_per_strand: int | None = None
) -> StrandSet:
    """`read_strands_report` without the report."""
    return read_strands_report(path, units=units, points_per_strand=points_per_strand)[0]


def read_strands_report(
    path: str | os.PathLike[str], *, units: Units | None = None, points_per_strand: int | None = None
) -> tuple[StrandSet, ReadReport]:
    """Read a strand file into world space (metres, z up).

    Strands without a point or with a NaN or infinite coordinate are set aside and counted in the report (W-1).

    Parameters
    ----------
    units : unit and axes of the file; the format's default when None.
    points_per_strand : for .ply only, which may leave it open; None takes what the file states, or guesses (see `ply`).

    Raises
    ------
    FileError : missing, damaged or of an unknown format, or all of its strands are unusable.
    """
    path = Path(path)
    file_format = _format_of(path)
    units = units or file_format.units
    read = file_format.read
    if points_per_strand is not None:
        require(path.suffix.lower() == ".ply", "points_per_strand is for .ply files only")
        require(points_per_strand >= 1, f"points_per_strand is {points_per_strand}; it must be 1 or more")
        read = partial(ply.read, points_per_strand=points_per_strand)
    with np.errstate(invalid="ignore", over="ignore"):  # NaN and infinite values are looked for below
        raw = read(path, read_file(path))
    scaled = RawStrands(
        units.to_world(raw.points),
        raw.counts,
        _scale_radius(dict(raw.point_attributes), units.scale_to_metres),
        _scale_radius(dict(raw.strand_attributes), units.scale_to_metres),
    )
    try:
        strands, dropped = strands_from_raw(scaled)
    except InputError as error:
        raise damaged(path, str(error)) from error
    if len(raw.counts) and not strands.n_strands:
        raise damaged(path, f"none of its {len(raw.counts)} strands is usable (no points, NaN or infinite values)")
    return strands, ReadReport(len(raw.counts), dropped, units)


def write_strands(
    path: str | os.PathLike[str],
    strands: StrandSet,
    *,
    units: Units | None = None,
    overwrite: bool = True,
    tfx_version: int | None = None,
) -> None:
    """Write strands to the format of the suffix; the file appears whole or not at all.

    Parameters
    ----------
    units : unit and axes that the file shall have; the format's default when None.
    overwrite : False refuses to replace a file.
    tfx_version : 2, 3 or 4 for .tfx; None is 4, or 2 when strands differ in their number of points.

    Raises
    ------
    FileError : it cannot be written. InputError : the format cannot hold these strands.
    """
    path = Path(path)
    file_format = _format_of(path)
    require(tfx_version is None or path.suffix.lower() == ".tfx", "tfx_version is for .tfx files only")
    if not overwrite and path.exists():
        raise FileError(f"cannot write {path}: it exists already; choose another name or allow overwriting")
    units = units or file_format.units
    points = units.from_world(strands.points)
    require(np.isfinite(points).all(), "the points are too large for a file in this unit; choose a larger unit")
    raw = RawStrands(
        points,
        strands.point_counts.astype(np.int64),
        _scale_radius(dict(strands.point_attributes), 1.0 / units.scale_to_metres),
        _scale_radius(dict(strands.strand_attributes), 1.0 / units.scale_to_metres),
    )
    write = partial(tfx.write, version=tfx_version) if tfx_version else file_format.write
    with atomic_write(path) as stream:
        write(stream, raw)


def _format_of(path: Path) -> _Format:
    file_format = _FORMATS.get(path.suffix.lower())
    if file_format is None:
        raise FileError(f"{path} has no known strand format; use one of {', '.join(_FORMATS)}")
    return file_format


def _scale_radius(attributes: dict[str, NDArray[Any]], scale: float) -> dict[str, NDArray[Any]]:
    radius = attributes.get("radius")
    if radius is not None and radius.dtype.kind == "f" and scale != 1.0:
        attributes["radius"] = (radius * scale).astype(radius.dtype)
    return attributes
