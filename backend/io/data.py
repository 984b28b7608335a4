"""USC-HairSalon .data: i32 number of strands, then for each strand i32 number of points and f32[3 n] points.

A strand of one point is an empty hair of the database: it is set aside as empty. No attribute is kept.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from .files import array_at, damaged
from .raw import RawStrands


def read(path: Path, data: bytes) -> RawStrands:
    """Read a .data file."""
    n_strands = int(array_at(path, data, 0, "<i4", 1, "the strand count")[0])
    if n_strands < 0 or 4 + 4 * n_strands > len(data):
        raise damaged(path, f"it states {n_strands} strands, which do not fit in its {len(data)} bytes", 0)
    places, counts = _walk(path, data, n_strands)
    words = np.frombuffer(data, dtype="<f4", count=len(data) // 4)
    is_point = np.ones(len(words), dtype=np.bool_)
    is_point[0] = False
    is_point[places // 4] = False
    is_empty_hair = counts == 1
    is_point[(places[is_empty_hair] // 4)[:, None] + np.arange(1, 4)] = False
    return RawStrands(words[is_point].reshape(-1, 3), np.where(is_empty_hair, 0, counts))


def _walk(path: Path, data: bytes, n_strands: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(S,) byte of each strand's count, and (S,) the counts.

    A loop over strands: where a strand starts is known only after the one before; 0.1 s for 100,000 strands.
    """
    take = struct.Struct("<i").unpack_from
    places, counts = [], []
    place = 4
    for strand in range(n_strands):
        if place + 4 > len(data):
            raise damaged(path, f"it ends before strand {strand} of {n_strands}", place)
        (count,) = take(data, place)
        if count < 0 or place + 4 + 12 * count > len(data):
            raise damaged(path, f"strand {strand} states {count} points, which do not fit in the file", place)
        places.append(place)
        counts.append(count)
        place += 4 + 12 * count
    if place != len(data):
        raise damaged(path, f"it is {len(data) - place} bytes longer than its strands", place)
    return np.array(places, dtype=np.int64), np.array(counts, dtype=np.int64)


def write(stream: IO[bytes], raw: RawStrands) -> None:
    """Write a .data file."""
    words = np.empty(1 + len(raw.counts) + 3 * len(raw.points), dtype="<i4")
    words[0] = len(raw.counts)
    places = 1 + np.arange(len(raw.counts)) + 3 * (np.cumsum(raw.counts) - raw.counts)
    is_point = np.ones(len(words), dtype=np.bool_)
    is_point[0] = False
    is_point[places] = False
    words[places] = raw.counts
    words[is_point] = raw.points.astype("<f4").reshape(-1).view("<i4")
    stream.write(words.tobytes())
