"""NumPy's .npz without pickle, read with checked sizes; and our own strand format in it.

Our strands: `points` (P, 3) float32 metres z up, `offsets` (S + 1,) int32, attributes as `point.NAME` and
`strand.NAME`, and `meta`, a JSON text with `format: "hairloom-strands"` and `version: 1`. An attribute written by
others under its plain name is taken for a point attribute when it has P rows, else for a strand attribute when S.
"""

from __future__ import annotations

import io
import json
import re
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .files import damaged
from .raw import RawStrands

FORMAT, VERSION = "hairloom-strands", 1
_HEADER = re.compile(
    rb"\{'descr': '([<>|=]?[fiubU]\d{1,7})', 'fortran_order': (True|False), 'shape': \(([0-9, ]*)\), *\}\s*"
)
_NPY: Any = np.lib.format  # it has no type annotations in numpy 1
_MAX_HEADER = 10_000
SPARE, RATIO = 2**28, 200  # an archive may unpack to SPARE bytes and RATIO times its size
# What a damaged or hostile archive makes zipfile raise.
_ZIP_ERRORS = (
    zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, KeyError, RuntimeError, NotImplementedError,
    OverflowError, TypeError,
)  # fmt: skip


def write_arrays(stream: IO[bytes], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write an uncompressed .npz; the same arrays give the same bytes.

    Raises
    ------
    InputError : an array of objects, or another type that .npz holds only by pickling.
    """
    for name, array in arrays.items():
        if array.dtype.kind not in "fiubU":
            raise InputError(f"array '{name}' has type {array.dtype}, which a file cannot hold; use numbers or text")
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                _NPY.write_array(member, array, allow_pickle=False)


def read_arrays(path: Path, data: bytes) -> dict[str, NDArray[Any]]:
    """The arrays of an .npz of numbers, booleans and texts; each has its own memory and can be written to.

    Sizes are checked against the archive before memory is taken: no more than 256 MB + 200 times the file's size.

    Raises
    ------
    FileError : no .npz, damaged, objects inside (they would need pickle), or larger unpacked than the limit.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = archive.infolist()
            if sum(member.file_size for member in members) > SPARE + RATIO * len(data):
                raise damaged(path, f"it unpacks to more than {RATIO} times its size; it is damaged or hostile")
            arrays = {}
            for member in members:
                name = member.filename.removesuffix(".npy")
                arrays[name] = _parse_member(path, name, archive.read(member), member.file_size)
            return arrays
    except _ZIP_ERRORS as error:
        raise damaged(path, f"no valid .npz archive ({error})") from error


def _parse_member(path: Path, name: str, content: bytes, stated_size: int) -> NDArray[Any]:
    wide = content[6:7] in (b"\x02", b"\x03")
    start = 12 if wide else 10
    length = int.from_bytes(content[8:start], "little")
    header = _HEADER.fullmatch(content[start : start + min(length, _MAX_HEADER)])
    if content[:6] != b"\x93NUMPY" or header is None or len(content) != stated_size:
        raise damaged(path, f"array '{name}' is damaged or not made of numbers, booleans or text")
    dtype = np.dtype(header[1].decode())
    shape = tuple(int(size) for size in header[3].split(b",") if size.strip())
    count = 1
    for size in shape:
        count *= size
    if len(shape) > 32 or count * dtype.itemsize != len(content) - start - length:
        raise damaged(path, f"array '{name}' states shape {shape}, which does not fit its {len(content)} bytes")
    if not count:
        return np.zeros(shape, dtype=dtype)
    flat = np.frombuffer(content, dtype=dtype, offset=start + length)
    if dtype.kind == "b":
        flat = flat.view(np.uint8) != 0
    if dtype.kind == "U" and flat.astype(dtype.newbyteorder("=")).view(np.uint32).max() > 0x10FFFF:
        raise damaged(path, f"text '{name}' has characters that do not exist")
    return flat.reshape(shape, order="F" if header[2] == b"True" else "C").astype(dtype.newbyteorder("="), order="C")


def read_json(path: Path, arrays: Mapping[str, NDArray[Any]], name: str) -> dict[str, Any]:
    """The JSON object in the text array `name`."""
    text = arrays.get(name)
    if text is None or text.dtype.kind != "U" or text.size != 1:
        raise damaged(path, f"it has no text '{name}'; it was not written by Hairloom")
    try:
        content = json.loads(str(text.reshape(-1)[0]))
    except (ValueError, RecursionError) as error:
        raise damaged(path, f"the text '{name}' is no JSON ({error})") from error
    if not isinstance(content, dict):
        raise damaged(path, f"the text '{name}' is no JSON object")
    return content


def read(path: Path, data: bytes) -> RawStrands:
    """Read our strand format: metres, z up."""
    arrays = read_arrays(path, data)
    meta = read_json(path, arrays, "meta")
    if meta.get("format") != FORMAT or meta.get("version") != VERSION:
        stated = f"format {str(meta.get('format'))!r:.60} version {str(meta.get('version'))!r:.20}"
        raise damaged(path, f"it is {stated}, not {FORMAT!r} version {VERSION}")
    points, offsets = arrays.get("points"), arrays.get("offsets")
    if points is None or points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind != "f":
        raise damaged(path, "it has no float array 'points' of shape (P, 3)")
    if offsets is None or offsets.ndim != 1 or offsets.dtype.kind not in "iu" or not len(offsets):
        raise damaged(path, "it has no whole-number array 'offsets'")
    if offsets[0] != 0 or offsets[-1] != len(points) or (offsets[1:] < offsets[:-1]).any():
        raise damaged(path, f"'offsets' must rise from 0 to the number of points, {len(points)}")
    counts = np.diff(offsets.astype(np.int64))
    by_kind: dict[str, dict[str, NDArray[Any]]] = {"point": {}, "strand": {}}
    for name, array in arrays.items():
        if name in ("points", "offsets", "meta"):
            continue
        kind, _, short = name.partition(".")
        if kind not in by_kind or not short:
            kind, short = ("point" if array.shape[:1] == points.shape[:1] else "strand"), name
        if array.ndim < 1 or len(array) != (len(points) if kind == "point" else len(counts)):
            raise damaged(path, f"array '{name}' has shape {array.shape}: neither a value a point nor one a strand")
        by_kind[kind][short] = array
    return RawStrands(points, counts, by_kind["point"], by_kind["strand"])


def write(stream: IO[bytes], raw: RawStrands) -> None:
    """Write our strand format, uncompressed; every attribute is kept."""
    meta = json.dumps({"format": FORMAT, "version": VERSION, "unit": "metre", "up": "Z"})
    arrays: dict[str, NDArray[Any]] = {"meta": np.array(meta), "points": raw.points}
    arrays["offsets"] = np.concatenate([[0], np.cumsum(raw.counts)]).astype(np.int32)
    arrays |= {f"point.{name}": array for name, array in raw.point_attributes.items()}
    arrays |= {f"strand.{name}": array for name, array in raw.strand_attributes.items()}
    write_arrays(stream, arrays)
