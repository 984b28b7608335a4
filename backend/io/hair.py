"""Cem Yuksel's .hair: a header of 128 bytes and arrays of points, thickness, transparency and colour.

Kept as point attributes: `radius` (half the thickness, in the file's unit of length), `transparency`, `color` (RGB). A
default of the header is used for a strand file without the array only when it is not the format's own default, 1.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import require
from .files import array_at, damaged
from .raw import RawStrands

HEADER = struct.Struct("<4s4I5f88s")
_SEGMENTS, _POINTS, _THICKNESS, _TRANSPARENCY, _COLOR = 1, 2, 4, 8, 16
MAX_SEGMENTS = 65_535  # u16


def read(path: Path, data: bytes) -> RawStrands:
    """Read a .hair file."""
    if len(data) < HEADER.size or data[:4] != b"HAIR":
        raise damaged(path, "it is no .hair file (header of 128 bytes that starts with HAIR)", 0)
    _, n_strands, n_points, arrays, default_segments, *defaults, _ = HEADER.unpack_from(data)
    if not arrays & _POINTS:
        raise damaged(path, "it states that it has no points", 12)
    place = HEADER.size
    if arrays & _SEGMENTS:
        counts = array_at(path, data, place, "<u2", n_strands, f"{n_strands} segment counts").astype(np.int64) + 1
        place += 2 * n_strands
    else:
        if n_strands * 12 > len(data):
            raise damaged(path, f"it states {n_strands} strands, more than fit in its {len(data)} bytes", 4)
        counts = np.full(n_strands, default_segments + 1, dtype=np.int64)
    if counts.sum() != n_points:
        raise damaged(path, f"it states {n_points} points, but its strands have {counts.sum()}", 8)

    def take(channels: int, what: str) -> NDArray[Any]:
        nonlocal place
        values = array_at(path, data, place, "<f4", n_points * channels, f"{n_points} {what}")
        place += values.nbytes
        return values.reshape(n_points, channels) if channels > 1 else values

    points = take(3, "points")
    attributes: dict[str, NDArray[Any]] = {}
    for bit, name, channels, default in (
        (_THICKNESS, "radius", 1, defaults[0]),
        (_TRANSPARENCY, "transparency", 1, defaults[1]),
        (_COLOR, "color", 3, defaults[2:5]),
    ):
        if arrays & bit:
            attributes[name] = take(channels, name)
        elif not np.array_equal(default, np.ones_like(default)) and np.isfinite(default).all():
            shape = (n_points, channels) if channels > 1 else (n_points,)
            attributes[name] = np.full(shape, default, dtype=np.float32)
    if "radius" in attributes:
        attributes["radius"] = attributes["radius"] * np.float32(0.5)
    if place != len(data):
        raise damaged(path, f"it is {len(data) - place} bytes longer than its header says", place)
    return RawStrands(points, counts, attributes)


def write(stream: IO[bytes], raw: RawStrands) -> None:
    """Write a .hair file with segments, points and the attributes it has.

    Raises
    ------
    InputError : a strand of more than 65,536 points, or more than 2^32 - 1 of them in all.
    """
    most = int(raw.counts.max()) if len(raw.counts) else 1
    require(most - 1 <= MAX_SEGMENTS, f".hair holds up to 65536 points a strand, not {most}; resample the hair")
    arrays = _SEGMENTS | _POINTS
    blocks: list[NDArray[Any]] = [(raw.counts - 1).astype("<u2"), raw.points.astype("<f4")]
    for bit, name, channels, factor in (
        (_THICKNESS, "radius", 1, 2.0),
        (_TRANSPARENCY, "transparency", 1, 1.0),
        (_COLOR, "color", 3, 1.0),
    ):
        values = raw.point_attributes.get(name)
        if values is None or values.dtype.kind != "f" or values.ndim > 2:
            continue
        columns = values.reshape(len(values), -1)[:, :channels]
        if columns.shape[1] == channels:
            arrays |= bit
            blocks.append((columns * factor).astype("<f4"))
    header = HEADER.pack(b"HAIR", len(raw.counts), len(raw.points), arrays, 1, 1, 1, 1, 1, 1, b"Hairloom")
    for block in (header, *(block.tobytes() for block in blocks)):
        stream.write(block)
