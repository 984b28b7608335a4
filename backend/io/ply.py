"""PLY of strands (NeuralHaircut and its kin): vertices strand after strand, the same number of points on each.

The number of points a strand is, in this order: what the caller says; a `comment points_per_strand N` of the header
(which we write); else guessed from the steps between neighbouring vertices. A *jump* is a step above 4 times the
median. A number n that divides the vertices fits when 9 of 10 of the steps between its strands are jumps and 9 of 10
of all jumps lie there; it is taken when exactly one number fits, else the file is refused.

Read are all encodings and the vertex properties x, y, z, `radius`, red green blue (`color`, from 0 to 1); written is
binary little endian with those. Other properties are lost.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import require
from ..types import Floats
from .files import array_at, damaged
from .raw import RawStrands
from .text import parse_numbers

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "="}
_MAX_HEADER = 65_536
_END = re.compile(rb"^end_header\r?\n", re.MULTILINE)
_JUMP, _FIT, _MAX_POINTS_PER_STRAND = 4.0, 0.9, 4096


@dataclass(frozen=True, slots=True)
class _Header:
    encoding: str
    n_vertices: int
    vertex: np.dtype[Any]
    points_per_strand: int  # 0: not stated
    end: int


def read(path: Path, data: bytes, points_per_strand: int | None = None) -> RawStrands:
    """Read a .ply of strands."""
    header = _parse_header(path, data)
    what = f"{header.n_vertices} vertices"
    if header.encoding == "ascii":
        vertices = _read_ascii(path, data, header)
    else:
        vertices = array_at(path, data, header.end, header.vertex, header.n_vertices, what)
    points = np.stack([vertices[axis].astype(np.float64) for axis in "xyz"], axis=1)
    n_points = points_per_strand or header.points_per_strand or guess_points_per_strand(points)
    if not n_points:
        raise damaged(path, "its number of points a strand is not stated and cannot be guessed; give points_per_strand")
    if n_points < 1 or len(points) % n_points:
        raise damaged(path, f"its {what} are no whole number of strands of {n_points} points")
    attributes: dict[str, NDArray[Any]] = {}
    names = header.vertex.names or ()
    if "radius" in names:
        attributes["radius"] = vertices["radius"].astype(np.float32)
    if {"red", "green", "blue"} <= set(names):
        color = np.stack([vertices[name].astype(np.float32) for name in ("red", "green", "blue")], axis=1)
        attributes["color"] = color / np.float32(255.0) if header.vertex["red"].kind == "u" else color
    return RawStrands(points, np.full(len(points) // n_points, n_points, dtype=np.int64), attributes)


def guess_points_per_strand(points: Floats) -> int:
    """The one number of points a strand that fits by the rule of this module; 0 when none or several do."""
    if len(points) < 4:
        return 0
    with np.errstate(invalid="ignore", over="ignore"):
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        jumps = np.flatnonzero(~(steps <= _JUMP * np.nanmedian(steps)))  # NaN counts as a jump
    fitting = []
    for n_points in range(2, min(len(points) // 2, _MAX_POINTS_PER_STRAND) + 1):
        if len(points) % n_points == 0:
            n_at_ends = int(((jumps + 1) % n_points == 0).sum())
            n_ends = len(points) // n_points - 1
            if n_at_ends >= _FIT * n_ends and n_at_ends >= _FIT * len(jumps):
                fitting.append(n_points)
    return fitting[0] if len(fitting) == 1 else 0


def _parse_header(path: Path, data: bytes) -> _Header:
    end = _END.search(data[:_MAX_HEADER])
    if not data.startswith(b"ply") or end is None:
        raise damaged(path, "it is no .ply file (header from 'ply' to 'end_header')", 0)
    encoding, element, stated = "", "", 0
    counts: dict[str, int] = {}
    fields: list[tuple[str, str]] = []
    for line in data[: end.start()].decode("ascii", "replace").splitlines():
        match line.split():
            case ["format", name, "1.0"] if name in _ORDERS:
                encoding = name
            case ["element", element, count] if count.isdecimal() and len(count) < 19:
                counts[element] = int(count)
            case ["property", kind, name] if element == "vertex" and kind in _TYPES:
                fields.append((name, _TYPES[kind]))
            case ["property", *_] if element == "vertex":
                raise damaged(path, f"it has a vertex property that is not known: {line[:60]!r}")
            case ["comment", "points_per_strand", count] if count.isdecimal() and len(count) < 10:
                stated = int(count)
    names = [name for name, _ in fields]
    if not encoding or next(iter(counts), "") != "vertex" or len(set(names)) < len(names) or not {*"xyz"} <= set(names):
        raise damaged(path, "its header has no format, or does not begin with vertices that have x, y and z")
    if counts.get("face"):
        raise damaged(path, f"it is a mesh of {counts['face']} faces, no strands; choose another file")
    vertex = np.dtype([(name, kind if kind[1] == "1" else _ORDERS[encoding] + kind) for name, kind in fields])
    return _Header(encoding, counts["vertex"], vertex, stated, end.end())


def _read_ascii(path: Path, data: bytes, header: _Header) -> NDArray[Any]:
    names = header.vertex.names or ()
    if header.n_vertices * len(names) * 2 > len(data) - header.end + 1:
        raise damaged(path, f"it states {header.n_vertices} vertices, more than it holds", header.end)
    numbers = parse_numbers(path, data[header.end :], lambda bad: header.end + bad)
    if len(numbers) < header.n_vertices * len(names):
        raise damaged(path, f"it states {header.n_vertices} vertices but has {len(numbers)} numbers", header.end)
    table = numbers[: header.n_vertices * len(names)].reshape(-1, len(names))
    vertices = np.empty(header.n_vertices, dtype=[(name, "f8") for name in names])
    for column, name in enumerate(names):
        vertices[name] = table[:, column]
    return vertices


def write(stream: IO[bytes], raw: RawStrands) -> None:
    """Write a binary .ply that states its points a strand.

    Raises
    ------
    InputError : strands of different numbers of points.
    """
    equal = not len(raw.counts) or bool((raw.counts == raw.counts[0]).all())
    require(equal, ".ply needs the same number of points on every strand; resample the hair or write another format")
    columns = [("x", raw.points[:, 0]), ("y", raw.points[:, 1]), ("z", raw.points[:, 2])]
    radius, color = raw.point_attributes.get("radius"), raw.point_attributes.get("color")
    if radius is not None and radius.ndim == 1:
        columns.append(("radius", radius))
    if color is not None and color.ndim == 2 and color.shape[1] >= 3:
        columns += [(name, color[:, channel]) for channel, name in enumerate(("red", "green", "blue"))]
    vertices = np.empty(len(raw.points), dtype=[(name, "<f4") for name, _ in columns])
    for name, values in columns:
        vertices[name] = values
    properties = "".join(f"property float {name}\n" for name, _ in columns)
    n_points = int(raw.counts[0]) if len(raw.counts) else 1
    stream.write(
        f"ply\nformat binary_little_endian 1.0\ncomment points_per_strand {n_points}\n"
        f"element vertex {len(vertices)}\n{properties}end_header\n".encode()
    )
    stream.write(vertices.tobytes())
