"""The motion of an object in an Alembic file: world matrices over frames (B-28)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ..errors import FileError
from ..types import Float64
from .files import damaged
from .ogawa_read import Archive, Object, Property

_XFORM = "AbcGeom_Xform"
# Alembic files are y up by custom, and what Blender, Maya and Houdini write is: turned by 90 degrees about x, z is up.
_TO_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])
# operations of a transform, and how many numbers each takes
_SCALE, _TRANSLATE, _ROTATE, _MATRIX, _ROTATE_X, _ROTATE_Y, _ROTATE_Z = range(7)
_SIZES = (3, 3, 4, 16, 1, 1, 1)


def read_motion(path: str | os.PathLike[str], name: str = "") -> Float64:
    """(F, 4, 4) float64: world matrices, z up, of the animated object `name`, at the file's samples.

    An empty `name` takes the one transform that is animated. Units are the file's; the samples are the frames.

    Raises
    ------
    FileError : missing, damaged or no Alembic file; no object of that name, or several animated ones and no name.
    """
    found = [chain for chain in _chains(Archive(path).top) if not name or chain[-1].name == name]
    if not name:
        found = [chain for chain in found if max(_n_samples(xform) for xform in chain) > 1]
    names = ", ".join(sorted(chain[-1].name for chain in found)) or "none"
    if len(found) != 1:
        wanted = f"one object '{name}'" if name else "one animated object"
        raise FileError(f"{path} must have {wanted}, it has {names}; name the one to follow")
    (chain,) = found
    motion = np.stack([_world(Path(path), chain, frame) for frame in range(max(map(_n_samples, chain)))])
    return np.asarray(_TO_Z_UP @ motion @ _TO_Z_UP.T)


def _chains(top: Object) -> list[tuple[Object, ...]]:
    """Every transform, after those above it."""
    chains: list[tuple[Object, ...]] = []
    waiting: list[tuple[Object, tuple[Object, ...]]] = [(child, ()) for child in top.children()]
    while waiting:
        item, above = waiting.pop()
        chain = above
        if item.schema.startswith(_XFORM):
            chain = (*above, item)
            chains.append(chain)
        waiting.extend((child, chain) for child in item.children())
    return chains


def _xform(item: Object) -> Property | None:
    """The compound of the transform's operations; none where it was never set."""
    return item.properties[".xform"] if ".xform" in item.properties.names() else None


def _n_samples(item: Object) -> int:
    xform = _xform(item)
    return xform[".vals"].n_samples if xform is not None and ".vals" in xform.names() else 1


def _world(path: Path, chain: tuple[Object, ...], frame: int) -> Float64:
    world = np.eye(4)
    for item in chain:
        xform = _xform(item)
        if xform is None or ".ops" not in xform.names():
            continue
        if ".inherits" in xform.names():
            inherits = xform[".inherits"]
            if not np.asarray(inherits.sample(min(frame, inherits.n_samples - 1))).all():
                world = np.eye(4)
        values = xform[".vals"]
        operations = np.atleast_1d(np.asarray(xform[".ops"].sample(0))).astype(np.int64) >> 4
        numbers = np.asarray(values.sample(min(frame, values.n_samples - 1)), np.float64).reshape(-1)
        world = world @ _matrix(path, operations.tolist(), numbers)
    return world


def _matrix(path: Path, operations: list[int], numbers: Float64) -> Float64:
    """The product of operations; the last acts on points first."""
    fits = all(0 <= kind < len(_SIZES) for kind in operations)
    if not fits or sum(_SIZES[kind] for kind in operations) != len(numbers) or not np.isfinite(numbers).all():
        raise damaged(path, f"a transform has operations {operations[:8]} with {len(numbers)} numbers")
    matrix, start = np.eye(4), 0
    for kind in operations:
        part = numbers[start : start + _SIZES[kind]]
        start += _SIZES[kind]
        step = np.eye(4)
        if kind == _SCALE:
            step[:3, :3] = np.diag(part)
        elif kind == _TRANSLATE:
            step[:3, 3] = part
        elif kind == _MATRIX:
            step = part.reshape(4, 4).T
        elif kind == _ROTATE:
            axis = part[:3] / max(float(np.linalg.norm(part[:3])), 1e-300)
            step[:3, :3] = Rotation.from_rotvec(np.radians(part[3]) * axis).as_matrix()
        else:
            step[:3, :3] = Rotation.from_euler("xyz"[kind - _ROTATE_X], part[0], degrees=True).as_matrix()
        matrix = matrix @ step
    return matrix
