"""Helices in a small .npz, float32 but for what must be exact: 16 bytes an element, 28 a strand."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np

from ..errors import HairloomError
from ..io.files import atomic_write, damaged, read_file
from ..io.npz import read_arrays, read_json, write_arrays
from ..types import Float32, Float64
from .helices import Helices

FORMAT, VERSION = "hairloom-helices", 1
# Kind and shape, but for the first axis, of each array.
_ARRAYS = {
    "roots": ("f", (3,)),
    "rotations": ("f", (4,)),
    "counts": ("i", ()),
    "lengths": ("f", ()),
    "curvatures": ("f", (3,)),
}


def write_helices(path: str | os.PathLike[str], helices: Helices, *, exact: bool = False) -> None:
    """Write helices; the file appears whole or not at all, and equal helices give equal bytes.

    Arrays: roots (S, 3) m, rotations (S, 4) unit quaternions x y z w of the root frames, counts (S,) int32 elements,
    lengths (E,) m, curvatures (E, 3) 1/m. As float32, a strand of 60 cm that turns 15 times comes back within 0.02 mm;
    exact: float64, and frames come back to rounding.

    Raises
    ------
    FileError : the file cannot be written.
    """
    kind = np.float64 if exact else np.float32
    arrays = {
        "meta": np.array(json.dumps({"format": FORMAT, "version": VERSION})),
        "roots": helices.roots.astype(kind),
        "rotations": _to_quaternions(helices.frames).astype(kind),
        "counts": helices.element_counts.astype(np.int32),
        "lengths": helices.lengths.astype(kind),
        "curvatures": helices.curvatures.astype(kind),
    }
    with atomic_write(path) as stream:
        write_arrays(stream, arrays)


def read_helices(path: str | os.PathLike[str]) -> Helices:
    """Read what `write_helices` wrote.

    Raises
    ------
    FileError : missing, damaged, or no helices.
    """
    where = Path(path)
    arrays = read_arrays(where, read_file(where))
    meta = read_json(where, arrays, "meta")
    if meta.get("format") != FORMAT or meta.get("version") != VERSION:
        raise damaged(where, f"it is no {FORMAT} of version {VERSION}; fit the helices again")
    for name, (kind, shape) in _ARRAYS.items():
        array = arrays.get(name)
        if array is None or array.dtype.kind != kind or array.ndim == 0 or array.shape[1:] != shape:
            raise damaged(where, f"its array '{name}' is missing or of the wrong kind or shape")
    counts, rotations = arrays["counts"].astype(np.int64), arrays["rotations"].astype(np.float64)
    if (counts < 1).any() or counts.sum() != len(arrays["lengths"]) or len(rotations) != len(arrays["roots"]):
        raise damaged(where, "its numbers of strands or elements do not fit together")
    sizes = np.linalg.norm(rotations, axis=1)
    if not (np.abs(sizes - 1.0) < 1e-3).all():
        raise damaged(where, "a rotation of it is no unit quaternion")
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    floats = {name: arrays[name].astype(np.float64) for name in ("roots", "lengths", "curvatures")}
    frames = _to_matrices(rotations / sizes[:, None])
    try:
        return Helices(floats["roots"], frames, offsets, floats["lengths"], floats["curvatures"])
    except HairloomError as error:
        raise damaged(where, str(error)) from error


def _to_quaternions(frames: Float64) -> Float64:
    """(S, 4) x y z w of rotations (S, 3, 3), from the largest column of 4 q q^T, which never is near 0."""
    m = frames
    trace = m[:, 0, 0] + m[:, 1, 1] + m[:, 2, 2]
    products = np.empty((len(m), 4, 4))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        products[:, i, i] = 1.0 + 2.0 * m[:, i, i] - trace
        products[:, i, j] = products[:, j, i] = m[:, j, i] + m[:, i, j]
        products[:, i, 3] = products[:, 3, i] = m[:, k, j] - m[:, j, k]
    products[:, 3, 3] = 1.0 + trace
    largest = np.argmax(products[:, range(4), range(4)], axis=1)
    columns = products[np.arange(len(m)), :, largest]
    return np.asarray(columns / np.linalg.norm(columns, axis=1)[:, None])


def _to_matrices(quaternions: Float64 | Float32) -> Float64:
    """(S, 3, 3) of unit quaternions (S, 4), x y z w."""
    x, y, z, w = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.ascontiguousarray(np.array(rows).transpose(2, 0, 1))
