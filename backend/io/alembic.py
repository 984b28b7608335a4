"""Strands as curves in Alembic files: static, or one sample a frame, with any attributes.

Frames are written as they come, so a file of any length needs the memory of one frame; what does not change is stored
once. Alembic's own axes are y up with no unit; Blender takes its numbers for metres. Frame f is at f / fps seconds, as
in Blender's own files.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..errors import require
from ..types import Float32, Int32
from .files import atomic_write
from .ogawa import PODS, STRING, ArchiveWriter, Compound, Node, Sampled, pod_of

_CURVE_SCHEMA = {"schema": "AbcGeom_Curve_v2", "schemaBaseType": "AbcGeom_GeomBase_v1"}
_XFORM_SCHEMA = {"schema": "AbcGeom_Xform_v3"}
_FLOAT32, _FLOAT64, _INT32, _UINT8 = 10, 11, 6, 1
_LINEAR, _CATMULL_ROM = (1, 0, 0, 0), (0, 0, 3, 3)  # type, periodicity, basis twice
SCOPES = ("con", "uni", "vtx")  # one value, one a strand, one a point
_MAX_POINTS = 2**31 - 1


@dataclass(frozen=True, slots=True)
class Axes:
    """The axes and unit of a file: file = scale * (signs * world)[order], world being metres, z up."""

    order: tuple[int, int, int]
    signs: tuple[int, int, int]
    scale: float = 1.0

    def apply(self, points: Float32) -> Float32:
        """(N, 3) float32 in the file's axes; exact where scale is 1."""
        turned = np.empty_like(points)
        for axis, (source, sign) in enumerate(zip(self.order, self.signs)):
            np.multiply(points[:, source], np.float32(sign * self.scale), out=turned[:, axis])
        return turned


Y_UP = Axes((0, 2, 1), (1, 1, -1))  # Alembic's, metres
UNREAL = Axes((0, 1, 2), (1, -1, 1), 100.0)  # left-handed, z up, centimetres: imported without any conversion


@dataclass(frozen=True, slots=True)
class GeomParam:
    """An attribute of curves.

    scope : one of SCOPES. values : (n,) or (n, extent) numbers, or n texts. interpretation : such as 'vector', 'rgb'.
    """

    name: str
    scope: str
    values: NDArray[Any] | Sequence[str]
    interpretation: str = ""

    def __post_init__(self) -> None:
        require(self.scope in SCOPES, f"the scope of '{self.name}' is {self.scope!r}; it must be con, uni or vtx")
        if isinstance(self.values, np.ndarray):
            require(self.values.ndim in (1, 2), f"'{self.name}' must have one or two axes, not {self.values.ndim}")
            finite = self.values.dtype.kind != "f" or np.isfinite(self.values).all()
            require(finite, f"'{self.name}' has NaN or infinite values")


class CurvesWriter:
    """Writes the samples of one object of curves; made by `AlembicWriter.add_curves`."""

    def __init__(
        self, archive: ArchiveWriter, node: Node, counts: Int32, *, axes: Axes, sampling: int, is_linear: bool
    ) -> None:
        self._archive, self._axes, self._sampling = archive, axes, sampling
        self._n_points, self._n_strands = int(counts.sum()), len(counts)
        self._geom = geom = node.properties.compound(".geom", _CURVE_SCHEMA)
        point = {"geoScope": "vtx", "interpretation": "point"}
        self._bounds = archive.scalar(geom, ".selfBnds", _FLOAT64, 6, {"interpretation": "box"}, sampling)
        self._positions = archive.array(geom, "P", _FLOAT32, 3, point, sampling)
        self._counts = archive.array(geom, "nVertices", _INT32, 1, sampling=sampling)
        self._type = archive.scalar(geom, "curveBasisAndType", _UINT8, 4, sampling=sampling)
        self._widths: Sampled | None = None
        self._velocities: Sampled | None = None
        self._topology: tuple[NDArray[Any], ...] = (counts, np.array(_LINEAR if is_linear else _CATMULL_ROM, np.uint8))
        self._n_samples = 0

    def write(self, points: Float32, widths: Float32 | None = None, velocities: Float32 | None = None) -> None:
        """Write the next sample.

        Parameters
        ----------
        points : (P, 3) float32, metres, world axes (z up).
        widths : (1,), (S,) or (P,) float32, metres; without them those of the sample before, as many as in the first.
        velocities : (P, 3) float32, m/s; in every sample or in none.

        Raises
        ------
        InputError : shapes that do not fit, NaN, or a second sample of a static object. OSError : the disk is full...
        """
        require(self._sampling or not self._n_samples, "this object was added as static: it takes one sample")
        self._check("points", points)
        turned = self._axes.apply(points)
        # column by column: over axis 0 of three columns numpy takes twenty times as long
        bounds = (
            [column.min() for column in turned.T] + [column.max() for column in turned.T] if len(turned) else [0] * 6
        )
        self._archive.write(self._bounds, np.array(bounds, np.float64))
        self._archive.write(self._positions, turned)
        for target, values in zip((self._counts, self._type), self._topology):
            if self._n_samples:
                self._archive.repeat(target)
            else:
                self._archive.write(target, values)
        self._write_widths(widths)
        if velocities is not None or self._velocities is not None:
            self._write_velocities(velocities)
        self._n_samples += 1

    def _check(self, name: str, values: Float32 | None) -> None:
        require(values is not None, f"{name} are missing; give them in every sample or in none")
        assert values is not None
        fits = values.shape == (self._n_points, 3) and values.dtype == np.float32
        require(fits, f"{name} must be float32 {(self._n_points, 3)}, not {values.dtype} {values.shape}")
        require(np.isfinite(values).all(), f"{name} have NaN or infinite values")

    def _write_widths(self, widths: Float32 | None) -> None:
        if widths is None:
            if self._widths is not None:
                self._archive.repeat(self._widths)
            return
        scopes = {1: "con", self._n_strands: "uni", self._n_points: "vtx"}
        fits = widths.ndim == 1 and len(widths) in scopes and widths.dtype == np.float32
        require(fits, f"widths must be float32, one, one a strand or one a point, not {widths.dtype} {widths.shape}")
        require(np.isfinite(widths).all() and (widths >= 0).all(), "widths must be 0 or more")
        if self._widths is None:
            require(not self._n_samples, "widths must begin with the first sample")
            metadata = _param_metadata(_FLOAT32, 1, scopes[len(widths)], "")
            self._widths = self._archive.array(self._geom, "width", _FLOAT32, 1, metadata, self._sampling)
        known = self._widths.counts
        require(not known or known[0] == len(widths), "widths must keep their number from sample to sample")
        self._archive.write(self._widths, widths * np.float32(self._axes.scale))

    def _write_velocities(self, velocities: Float32 | None) -> None:
        self._check("velocities", velocities)
        assert velocities is not None
        if self._velocities is None:
            require(not self._n_samples, "velocities must begin with the first sample")
            metadata = {"geoScope": "vtx", "interpretation": "vector"}
            self._velocities = self._archive.array(self._geom, ".velocities", _FLOAT32, 3, metadata, self._sampling)
        self._archive.write(self._velocities, self._axes.apply(velocities))


def _param_metadata(pod: int, extent: int, scope: str, interpretation: str) -> dict[str, str]:
    name = "string" if pod == STRING else {"?": "bool_t"}.get(PODS[pod].char, f"{PODS[pod].name}_t")
    metadata = {"arrayExtent": "1", "geoScope": scope, "isGeomParam": "true", "podExtent": str(extent), "podName": name}
    return metadata | ({"interpretation": interpretation} if interpretation else {})


def _write_params(archive: ArchiveWriter, geom: Compound, params: Sequence[GeomParam], numbers: dict[str, int]) -> None:
    owner = geom.compound(".arbGeomParams")
    for param in params:
        pod, values = pod_of(param.values), param.values
        extent = values.shape[1] if isinstance(values, np.ndarray) and values.ndim == 2 else 1
        wanted = numbers[param.scope]
        require(len(values) == wanted, f"'{param.name}' ({param.scope}) needs {wanted} values, not {len(values)}")
        metadata = _param_metadata(pod, extent, param.scope, param.interpretation)
        archive.write(archive.array(owner, param.name, pod, extent, metadata), values)


class AlembicWriter:
    """Writes an Alembic file; a context manager: the file takes its place when the block ends, and none if it fails.

    Parameters
    ----------
    path : the .abc file, replaced where it exists. fps, frame_start : when the samples of animated objects are.
    axes : of the file. tool : what wrote it, for the archive's metadata.

    Raises
    ------
    InputError : fps is not above 0. FileError : it cannot be written, also while the block runs (full disk).
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        fps: float = 24.0,
        frame_start: float = 1.0,
        axes: Axes = Y_UP,
        tool: str = "Hairloom",
    ) -> None:
        require(np.isfinite(fps) and fps > 0, f"fps is {fps:g}; it must be above 0")
        require(np.isfinite(frame_start), f"the first frame is {frame_start:g}; it must be a number")
        self._path, self._axes, self._tool = Path(path), axes, tool
        self._first, self._step = frame_start / fps, 1.0 / fps
        self._sampling = 0
        self._closing = ExitStack()

    def __enter__(self) -> Self:
        self._stream = self._closing.enter_context(atomic_write(self._path))
        self._archive = ArchiveWriter(self._stream)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self._closing.__exit__(kind, error, trace)
            return
        with self._closing:
            tool = {"_ai_AlembicVersion": "Alembic 1.8.3", "_ai_Application": self._tool}
            self._archive.finish(tool)

    def add_transform(self, name: str, properties: Mapping[str, Any] | None = None) -> Node:
        """An object that holds curves, without a motion of its own; `properties` are texts and numpy scalars."""
        node = self._archive.top.child(name, _XFORM_SCHEMA | {"schemaObjTitle": "AbcGeom_Xform_v3:.xform"})
        xform = node.properties.compound(".xform", _XFORM_SCHEMA)
        self._archive.write(self._archive.scalar(xform, ".inherits", 0), np.ones(1, np.bool_))
        if properties:
            owner = xform.compound(".userProperties")
            for key, value in properties.items():
                values = [value] if isinstance(value, str) else np.atleast_1d(np.asarray(value))
                self._archive.write(self._archive.scalar(owner, key, pod_of(values)), values)
        return node

    def add_curves(
        self,
        name: str,
        counts: Int32,
        *,
        below: Node | None = None,
        params: Sequence[GeomParam] = (),
        is_linear: bool = True,
        is_animated: bool = True,
    ) -> CurvesWriter:
        """An object of curves; write its samples with what is returned.

        Parameters
        ----------
        counts : (S,) int32, points of each strand, the same in all samples. below : its transform; one of its own name
            without it. params : attributes, which do not change. is_linear : else Catmull-Rom through the points.

        Raises
        ------
        InputError : counts or attributes that do not fit, a name that Alembic does not take.
        """
        counts = np.ascontiguousarray(counts, np.int32)
        require(counts.ndim == 1 and (counts > 0).all(), "every strand must have a point")
        n_points = int(counts.sum(dtype=np.int64))
        require(n_points <= _MAX_POINTS, f"{n_points} points are too many for one object; export fewer strands")
        if is_animated and not self._sampling:
            self._sampling = self._archive.add_sampling(self._first, self._step)
        below = self.add_transform(name) if below is None else below
        node = below.child(name, _CURVE_SCHEMA | {"schemaObjTitle": "AbcGeom_Curve_v2:.geom"})
        sampling = self._sampling if is_animated else 0
        writer = CurvesWriter(self._archive, node, counts, axes=self._axes, sampling=sampling, is_linear=is_linear)
        if params:
            numbers = {"con": 1, "uni": len(counts), "vtx": n_points}
            _write_params(self._archive, writer._geom, params, numbers)
        return writer
