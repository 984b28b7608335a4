"""Wavefront .obj polylines: strands are the `l` elements, root first, over `v` vertices.

No attribute is kept. A vertex that two lines share becomes a point of both. Lines of one vertex are points without a
strand and count as strands of one point.
"""

from __future__ import annotations

from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from ..types import Float64
from .files import damaged
from .raw import RawStrands
from .text import Indices, KeywordLines


def vertices_of(lines: KeywordLines) -> tuple[Float64, Indices]:
    """(V, 3) float64 positions of the `v` lines (further numbers are left out), and those lines.

    Raises
    ------
    FileError : a `v` line with less than three numbers, or something else than numbers.
    """
    found = lines.find("v")
    return _first_columns(lines, found, 3), found


def texture_coordinates_of(lines: KeywordLines) -> tuple[Float64, Indices]:
    """(T, 2) float64 of the `vt` lines, and those lines; a missing second coordinate is not allowed."""
    found = lines.find("vt")
    return _first_columns(lines, found, 2), found


def resolve(
    lines: KeywordLines, references: Indices, users: Indices, counts: Indices, targets: Indices, what: str
) -> Indices:
    """Indices from 0 of references as written: from 1, or negative and counted back from the user's own line.

    Parameters
    ----------
    references : (n,) as written. users, counts : the lines they are from, and how many of them each has.
    targets : lines of the things that are referred to. what : their name for the error.

    Raises
    ------
    FileError : one that does not exist.
    """
    defined = np.repeat(np.searchsorted(targets, users), counts)
    indices = np.where(references > 0, references - 1, references + defined)
    bad = np.flatnonzero((references == 0) | (indices < 0) | (indices >= len(targets)))
    if len(bad):
        line = int(users[np.searchsorted(np.cumsum(counts), bad[0], side="right")])
        raise lines.error(line, f"names {what} {references[bad[0]]}, but there are {len(targets)}")
    return indices


def read(path: Path, data: bytes) -> RawStrands:
    """Read the polylines of an .obj."""
    lines = KeywordLines(path, data)
    vertices, vertex_lines = vertices_of(lines)
    polylines = lines.find("l")
    if not len(polylines):
        what = "a mesh" if len(lines.find("f")) else "empty"
        raise damaged(path, f"it has no strands ('l' lines); it is {what}, so choose another file")
    references, _, counts = lines.references(polylines, 1)
    indices = resolve(lines, references, polylines, counts, vertex_lines, "vertex")
    return RawStrands(vertices[indices], counts)


def write(stream: IO[bytes], raw: RawStrands) -> None:
    """Write one `l` line a strand."""
    stream.write(b"# strands, one line each, root first\n")
    ends = np.cumsum(raw.counts)
    # Loops over blocks of strands: text is formatted in one call a block, so that memory stays bounded.
    for start in range(0, len(raw.points), 100_000):
        block = raw.points[start : start + 100_000]
        stream.write(("v %.9g %.9g %.9g\n" * len(block) % tuple(block.ravel().tolist())).encode())
    for start, end in zip((ends - raw.counts).tolist(), ends.tolist()):
        stream.write(f"l {' '.join(map(str, range(start + 1, end + 1)))}\n".encode())


def _first_columns(lines: KeywordLines, found: Indices, n_columns: int) -> Float64:
    numbers, counts = lines.numbers(found, n_columns)
    places: NDArray[np.int64] = np.cumsum(counts) - counts
    return numbers[places[:, None] + np.arange(n_columns)]
