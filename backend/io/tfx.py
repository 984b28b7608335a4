"""AMD TressFX .tfx: ASCII "version 2.0", binary 3.x and binary 4.x.

2.0, text: `version 2.0`, then `strand I numVerts N ...` before each strand's N lines `x y z`.
3.x: 296 bytes of header (f32 version, u32 strands, u32 points a strand), then points f32[3 n k].
4.x: 160 bytes of header (f32 version, u32 strands, u32 points a strand, u32 byte offsets of points, strand uv, point
uv, strand thickness and colour, 0 for an absent array), points f32[4 n k] with w the inverse mass. Kept as the point
attributes `inverse_mass`, `uv`, `color` (RGBA) and strand attributes `surface_uv_coordinate`, `radius` (half the
thickness).

Versions 3 and 4 need the same number of points on every strand; 2 and 3 hold no attributes.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import require
from .files import array_at, damaged
from .raw import RawStrands
from .text import parse_numbers, token_starts

V3_HEADER, V4_HEADER = 296, 160
_V3_OFFSET_FIELD = 144  # every 3.0 file seen states there where its points start, 296
_STRAND = re.compile(rb"strand[ \t]+(\d{1,18})[ \t]+numVerts[ \t]+(\d{1,18})\b[^\n]*")


def read(path: Path, data: bytes) -> RawStrands:
    """Read any of the three generations, told apart by their first bytes."""
    if data[:256].lstrip().startswith(b"version"):
        return _read_text(path, data)
    version = float(array_at(path, data, 0, "<f4", 1, "the version")[0])
    n_strands, n_points = (int(n) for n in array_at(path, data, 4, "<u4", 2, "the counts"))
    if n_strands and n_points < 1:
        raise damaged(path, f"it states {n_points} points a strand", 8)
    if 3.0 <= version < 4.0:
        points = array_at(path, data, V3_HEADER, "<f4", n_strands * n_points * 3, f"{n_strands} x {n_points} points")
        return RawStrands(points.reshape(-1, 3), np.full(n_strands, n_points, dtype=np.int64))
    if 4.0 <= version < 5.0:
        return _read_v4(path, data, n_strands, n_points)
    raise damaged(path, f"it is no .tfx file of version 2.0, 3.x or 4.x (states {version:g})", 0)


def _read_v4(path: Path, data: bytes, n_strands: int, n_points: int) -> RawStrands:
    places = [int(n) for n in array_at(path, data, 12, "<u4", 5, "the array offsets")]
    total = n_strands * n_points
    if places[0] < 32:
        raise damaged(path, f"it states that its points start at byte {places[0]}, inside the header", 12)

    def array(place: int, count: int, channels: int, what: str) -> NDArray[Any]:
        values = array_at(path, data, place, "<f4", count * channels, what)
        return values.reshape(count, channels) if channels > 1 else values

    points = array(places[0], total, 4, f"{n_strands} x {n_points} points")
    of_points: dict[str, NDArray[Any]] = {"inverse_mass": points[:, 3]}
    of_strands: dict[str, NDArray[Any]] = {}
    if places[1]:
        of_strands["surface_uv_coordinate"] = array(places[1], n_strands, 2, "strand uv")
    if places[2]:
        of_points["uv"] = array(places[2], total, 2, "point uv")
    if places[3]:
        of_strands["radius"] = array(places[3], n_strands, 1, "strand thickness") * np.float32(0.5)
    if places[4]:
        of_points["color"] = array(places[4], total, 4, "colours")
    return RawStrands(points[:, :3], np.full(n_strands, n_points, dtype=np.int64), of_points, of_strands)


def _read_text(path: Path, data: bytes) -> RawStrands:
    text = data.replace(b"\r", b"\n")
    strands = list(_STRAND.finditer(text))
    body_start = strands[0].start() if strands else len(text)
    version = text[:body_start].split(None, 2)[1:2]
    if version not in ([b"2.0"], [b"2"], [b"1.0"]):
        raise damaged(path, f"text version {b''.join(version).decode('ascii', 'replace')!r:.20} is not known")
    counts = np.array([int(match[2]) for match in strands], dtype=np.int64)
    if counts.size and counts.max() > len(text):
        raise damaged(path, f"a strand states {counts.max()} points, more than the file holds")
    body = _STRAND.sub(lambda line: b" " * len(line[0]), text[body_start:])
    starts = np.array([match.start() - body_start for match in strands] + [len(body)], dtype=np.int64)
    have = np.diff(np.searchsorted(np.flatnonzero(token_starts(body)), starts))
    wrong = np.flatnonzero(have != counts * 3)
    if len(wrong):
        strand = int(wrong[0])
        reason = f"strand {strand} states {counts[strand]} points but has {have[strand]} numbers, not 3 a point"
        raise damaged(path, reason, int(starts[strand]) + body_start)
    numbers = parse_numbers(path, body, lambda bad: body_start + bad)
    return RawStrands(numbers.reshape(-1, 3), counts)


def write(stream: IO[bytes], raw: RawStrands, version: int | None = None) -> None:
    """Write version 2, 3 or 4; without one, 4 when all strands have the same number of points, else 2.

    Raises
    ------
    InputError : an unknown version, or strands of unequal length for version 3 or 4.
    """
    equal = not len(raw.counts) or bool((raw.counts == raw.counts[0]).all())
    version = version or (4 if equal else 2)
    require(version in (2, 3, 4), f"there is no .tfx version {version}; choose 2, 3 or 4")
    require(
        equal or version == 2,
        f".tfx version {version} needs the same number of points on every strand; resample the hair or write version 2",
    )
    if version == 2:
        _write_text(stream, raw)
        return
    n_points = int(raw.counts[0]) if len(raw.counts) else 0
    header = struct.pack("<fII", float(version), len(raw.counts), n_points)
    if version == 3:
        stream.write(header.ljust(_V3_OFFSET_FIELD, b"\0") + struct.pack("<Q", V3_HEADER).ljust(152, b"\0"))
        stream.write(raw.points.astype("<f4").tobytes())
        return
    _write_v4(stream, raw, header)


def _write_v4(stream: IO[bytes], raw: RawStrands, header: bytes) -> None:
    points = np.ones((len(raw.points), 4), dtype="<f4")
    points[:, :3] = raw.points
    inverse_mass = raw.point_attributes.get("inverse_mass")
    if inverse_mass is not None:
        points[:, 3] = inverse_mass
    else:
        points[np.cumsum(raw.counts) - raw.counts, 3] = 0.0  # TressFX holds the roots
    color = raw.point_attributes.get("color")
    if color is not None and color.shape[1:] == (3,):
        color = np.concatenate([color, np.ones((len(color), 1), dtype=color.dtype)], axis=1)
    radius = raw.strand_attributes.get("radius")
    arrays = [
        points,
        raw.strand_attributes.get("surface_uv_coordinate"),
        raw.point_attributes.get("uv"),
        None if radius is None else radius * 2.0,
        color,
    ]
    blocks = [b"" if array is None else array.astype("<f4").tobytes() for array in arrays]
    places, end = [], V4_HEADER
    for block in blocks:
        places.append(end if block or block is blocks[0] else 0)
        end += len(block)
    require(end < 2**32, ".tfx version 4 holds at most 4 GB; write fewer strands")
    stream.write((header + struct.pack("<5I", *places)).ljust(V4_HEADER, b"\0"))
    for block in blocks:
        stream.write(block)


def _write_text(stream: IO[bytes], raw: RawStrands) -> None:
    stream.write(f"version 2.0\nnumStrands {len(raw.counts)}\n".encode())
    ends = np.cumsum(raw.counts)
    # A loop over strands: each has a line of its own between its points, and each is one formatting call.
    for strand, (start, end) in enumerate(zip((ends - raw.counts).tolist(), ends.tolist())):
        block = raw.points[start:end]
        lines = "%.9g %.9g %.9g\n" * len(block) % tuple(block.ravel().tolist())
        stream.write(f"strand {strand} numVerts {end - start}\n{lines}".encode())
