"""The file of hairstyles: strands on a fine grid as differences of whole numbers, masks as bits (Z-3, M-30).

A file is an .npz of numbers and texts. Strands of a hairstyle are sorted by their roots, rounded to `QUANTUM`, and kept
as second differences along the strand (roots and first steps as differences from the strand before), whose bytes are
deflated apart, low and high: two thirds of a byte a coordinate.
"""

from __future__ import annotations

import hashlib
import json
import os
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, require
from ..io.files import atomic_write, damaged, read_file
from ..io.npz import read_arrays, read_json, write_arrays
from ..types import Float32, Int32, check_array
from .database_masks import COLUMNS, ROWS, view_grid
from .views import UInt8

FORMAT, VERSION = "hairloom-hairstyles", 1
QUANTUM = 1.0 / 160.0  # head radii, 0.55 mm on a head of usual size
_LARGEST = 50.0  # head radii; farther points are no hair, and second differences of nearer ones fit into 16 bits
_MOST_STRANDS, _MOST_POINTS = 100_000, 1000


@dataclass(frozen=True, slots=True)
class Hairstyle:
    """One entry of the database, packed; `points` unpacks it.

    name : unique in a database. tags : words to choose by. family : what it was made from; hairstyles of one family are
        alike, so a test of the search on one of them leaves the others out too.
    n_strands, n_points : S strands of N points. packed : the strands, of `pack_strands`.
    masks : (D, ROWS * COLUMNS / 8) uint8, the hair mask from each direction of the view grid, 8 cells a byte.
    """

    name: str
    tags: tuple[str, ...]
    family: str
    n_strands: int
    n_points: int
    packed: bytes
    masks: UInt8 = field(repr=False)

    def __post_init__(self) -> None:
        require(self.name.strip() == self.name != "", f"a hairstyle cannot be called '{self.name}'; give it a name")
        check_array(f"the masks of '{self.name}'", self.masks, np.uint8, (len(view_grid()), ROWS * COLUMNS // 8))
        require(
            1 <= self.n_strands <= _MOST_STRANDS and 2 <= self.n_points <= _MOST_POINTS,
            f"'{self.name}' has {self.n_strands} strands of {self.n_points} points; it must have 1 to {_MOST_STRANDS} "
            f"of 2 to {_MOST_POINTS}",
        )

    def points(self) -> Float32:
        """(S, N, 3) float32, fitted space (`database_fit`), root first."""
        return unpack_strands(self.packed, self.n_strands, self.n_points)


def pack_strands(points: Float32) -> bytes:
    """Strands (S, N, 3) float32 of fitted space, in bytes; their order is changed to that of their roots' places.

    Raises
    ------
    InputError : points farther from the head than any hair.
    """
    check_array("the strands of a hairstyle", points, np.float32, (None, None, 3))
    require(
        bool((np.abs(points) < _LARGEST).all()), f"hair reaches farther than {_LARGEST:g} head radii; check its units"
    )
    grid = np.rint(points[order_of_roots(points[:, 0])].astype(np.float64) / QUANTUM).astype(np.int32)
    differences = grid.copy()
    differences[:, 1:] = np.diff(grid, axis=1)
    differences[:, 2:] = np.diff(differences[:, 1:], axis=1)
    differences[1:, :2] = np.diff(differences[:, :2], axis=0)
    # 0, -1, 1, -2, 2 ... become 0, 1, 2, 3, 4 ...; whole planes of one coordinate and one byte compress best
    folded = np.where(differences < 0, -2 * differences - 1, 2 * differences).astype(np.uint16)
    planes = np.ascontiguousarray(folded.transpose(2, 1, 0))
    deflate = zlib.compressobj(9, strategy=zlib.Z_FILTERED)  # for values that scatter around 0: 3 % smaller
    planes_of_bytes = (planes & 255).astype(np.uint8).tobytes() + (planes >> 8).astype(np.uint8).tobytes()
    return deflate.compress(planes_of_bytes) + deflate.flush()


def unpack_strands(packed: bytes, n_strands: int, n_points: int) -> Float32:
    """(S, N, 3) float32, fitted space: what `pack_strands` packed, to half a QUANTUM. Raises InputError if damaged."""
    count = n_strands * n_points * 3
    try:
        data = zlib.decompressobj().decompress(packed, 2 * count + 1)
    except zlib.error as error:
        raise InputError(f"a hairstyle of the database is damaged ({error}); install the database again") from error
    require(len(data) == 2 * count, "a hairstyle of the database is damaged; install the database again")
    low, high = np.frombuffer(data, np.uint8).reshape(2, 3, n_points, n_strands).astype(np.int32)
    folded = low | (high << 8)
    differences = np.where(folded & 1, -((folded + 1) >> 1), folded >> 1).transpose(2, 1, 0).copy()
    differences[:, :2] = np.cumsum(differences[:, :2], axis=0)
    differences[:, 1:] = np.cumsum(differences[:, 1:], axis=1)
    return np.asarray(np.cumsum(differences, axis=1) * QUANTUM, np.float32)


def order_of_roots(roots: Float32) -> NDArray[np.int64]:
    """(S,) neighbours after one another: strips along x, up and down along them by turns."""
    strip = np.floor(roots[:, 0] / 0.08).astype(np.int64)
    along = np.arctan2(roots[:, 2], -roots[:, 1]) * np.where(strip & 1, 1.0, -1.0)
    return np.asarray(np.lexsort((along, strip)), np.int64)


def write_hairstyles(path: str | os.PathLike[str], styles: Sequence[Hairstyle], source: str = "") -> None:
    """Write hairstyles to one file, whole or not at all; the same ones give the same bytes.

    source : `fingerprint` of the file that they were made from, for `read_hairstyles` of a cache.

    Raises
    ------
    FileError : it cannot be written.
    """
    entries = [
        {"name": s.name, "tags": list(s.tags), "family": s.family, "strands": s.n_strands, "points": s.n_points}
        for s in styles
    ]
    meta = {"format": FORMAT, "version": VERSION, "source": source, "quantum": QUANTUM, "hairstyles": entries}
    packed = b"".join(style.packed for style in styles)
    masks = zlib.compress(b"".join(style.masks.tobytes() for style in styles), 9)
    arrays: dict[str, NDArray[Any]] = {
        "meta": np.array(json.dumps(meta, separators=(",", ":"))),
        "strands": np.frombuffer(packed, np.uint8),
        "strand_ends": np.cumsum([len(style.packed) for style in styles]).astype(np.int64),
        "masks": np.frombuffer(masks, np.uint8),
    }
    with atomic_write(path) as stream:
        write_arrays(stream, arrays)


def read_hairstyles(path: str | os.PathLike[str], source: str | None = None) -> tuple[Hairstyle, ...]:
    """The hairstyles of a file; with `source`, none if the file was made from something else.

    Raises
    ------
    FileError : missing, damaged, or not written by this version.
    """
    path = Path(path)
    arrays = read_arrays(path, read_file(path))
    meta = read_json(path, arrays, "meta")
    if meta.get("format") != FORMAT or meta.get("version") != VERSION or meta.get("quantum") != QUANTUM:
        raise damaged(path, "it is no file of hairstyles of this version; make it again")
    if source is not None and meta.get("source") != source:
        return ()
    try:
        return _entries(arrays, meta["hairstyles"])
    except (KeyError, TypeError, ValueError, AttributeError, zlib.error, InputError) as error:
        raise damaged(path, f"its hairstyles are damaged ({error})") from error


def _entries(arrays: dict[str, NDArray[Any]], entries: Sequence[dict[str, Any]]) -> tuple[Hairstyle, ...]:
    size = (len(entries), len(view_grid()), ROWS * COLUMNS // 8)
    data = zlib.decompressobj().decompress(arrays["masks"].tobytes(), int(np.prod(size)) + 1)
    masks = np.frombuffer(data, np.uint8).reshape(size)
    ends: Int32 = arrays["strand_ends"]
    strands = arrays["strands"].tobytes()
    require(len(ends) == len(entries) and (not len(ends) or ends[-1] == len(strands)), "sizes differ")
    starts = [0, *ends[:-1].tolist()]
    return tuple(
        Hairstyle(
            str(entry["name"]), tuple(str(tag) for tag in entry["tags"]), str(entry["family"]), int(entry["strands"]),
            int(entry["points"]), strands[start:end], masks[number],
        )
        for number, (entry, start, end) in enumerate(zip(entries, starts, ends.tolist()))
    )  # fmt: skip


def fingerprint(*contents: bytes) -> str:
    """What a cache was made from: 32 hexadecimal digits of the contents' hash."""
    digest = hashlib.sha256()
    for content in contents:
        digest.update(len(content).to_bytes(8, "little") + content)
    return digest.hexdigest()[:32]
