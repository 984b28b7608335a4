"""Simulation caches out of Blender: to Alembic, USD and Unreal's groom files, read frame by frame from the cache."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .. import air, playback
from ..backend.errors import FileError, InputError, require
from ..backend.io.alembic import UNREAL, Y_UP, AlembicWriter
from ..backend.io.sim_cache import CacheReader
from ..backend.io.unreal import UnrealGroom, write_unreal
from . import guides
from .attributes import read_attribute, read_values
from .motion import frames_kept
from .playback import positions

Report = Callable[[float], None]
_DEFAULT_WIDTH = 8e-5  # metres, of hair without a radius: a usual one
_USD_BYTES = (
    2**28
)  # a USD stage keeps its samples in memory until it is saved, so it is saved whenever it has this much
_COLORS = ("groom_color", "Color", "color", "Col")


@dataclass(frozen=True, slots=True)
class Frames:
    """The frames of a groom's cache: number of the first, how many, and each one's matrix (F, 4, 4) float64."""

    reader: CacheReader
    matrices: np.ndarray

    def __iter__(self) -> Iterator[np.ndarray]:
        """(P, 3) float32 of each frame; the same buffer, written anew."""
        buffer = np.empty((self.reader.n_points, 3), np.float32)
        for number, matrix in enumerate(self.matrices):
            self.reader.frame(self.reader.frame_start + number, buffer)
            yield placed(buffer, matrix)


def placed(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """(P, 3) float32 points moved by a matrix (4, 4); themselves where it is the identity."""
    if np.array_equal(matrix, np.eye(4)):
        return points
    return np.ascontiguousarray(points @ matrix[:3, :3].T + matrix[:3, 3], dtype=np.float32)


def cached_frames(context: bpy.types.Context, groom: bpy.types.Object, space: str) -> Frames:
    """All frames of the groom's cache.

    `space` is 'OBJECT' for the groom's own space; 'WORLD' with the motion of its object; 'START' for where its object
    is at the first frame, without its motion.

    Raises
    ------
    FileError : the cache is missing or damaged. InputError : it is of another groom.
    """
    folder = playback.folder(groom)
    require(folder is not None, f"'{groom.name}' has no simulation: press Simulate first")
    reader, n_points = CacheReader(folder), len(groom.data.points)
    require(reader.n_points == n_points, f"the cache has {reader.n_points:,} points, the groom {n_points:,}")
    if not reader.n_frames:
        raise FileError(f"the cache {folder} has no whole frame; simulate again")
    matrices = np.broadcast_to(np.eye(4), (reader.n_frames, 4, 4))
    if space != "OBJECT":
        n_visited = reader.n_frames if space == "WORLD" else 1
        with frames_kept(context.scene):
            found = [_world_matrix(context, groom, reader.frame_start + i) for i in range(n_visited)]
        matrices = (
            np.broadcast_to(found, (n_visited, 4, 4)) if space == "WORLD" else np.broadcast_to(found[0], matrices.shape)
        )
    return Frames(reader, matrices)


def _world_matrix(context: bpy.types.Context, groom: bpy.types.Object, frame: int) -> np.ndarray:
    context.scene.frame_set(frame)
    return np.array(groom.evaluated_get(context.evaluated_depsgraph_get()).matrix_world, np.float64)


def _counts(groom: bpy.types.Object) -> np.ndarray:
    return np.diff(read_values(groom.data.curve_offset_data, "value", np.int32))


def _widths(groom: bpy.types.Object) -> np.ndarray | None:
    """(P,) float32 diameters, Blender's units; None where the groom has no radius."""
    radius = groom.data.attributes.get("radius")
    if radius is None or (radius.data_type, radius.domain) != ("FLOAT", "POINT"):
        return None
    return np.maximum(read_attribute(radius), 0) * np.float32(2)


def _is_linear(groom: bpy.types.Object) -> bool:
    """Are these poly curves? Others are written as Catmull-Rom, which is what hair is otherwise."""
    kind = groom.data.attributes.get("curve_type")
    return kind is not None and bool((read_attribute(kind) == 1).all())


def bake_alembic(context: bpy.types.Context, groom: bpy.types.Object, path: Path, space: str, report: Report) -> str:
    """Write the groom's cache to an .abc file; the path of the curves in it.

    Raises
    ------
    InputError, FileError : as `cached_frames`; FileError : it cannot be written.
    """
    frames, widths = cached_frames(context, groom, space), _widths(groom)
    name = groom.name.replace("/", "_")
    fps = context.scene.render.fps / context.scene.render.fps_base
    with AlembicWriter(path, fps=fps, frame_start=frames.reader.frame_start, axes=Y_UP) as file:
        curves = file.add_curves(name, _counts(groom), is_linear=_is_linear(groom))
        for number, points in enumerate(frames):
            report(number / len(frames.matrices))
            curves.write(points, widths)
            widths = None  # the same from now on
    return f"/{name}/{name}"


def bake_usd(context: bpy.types.Context, groom: bpy.types.Object, path: Path, space: str, report: Report) -> str:
    """Write the groom's cache to a .usd file; the path of the curves in it.

    Raises
    ------
    InputError : this Blender has no USD in Python, or as `cached_frames`. FileError : it cannot be written.
    """
    usd = _usd_modules()
    frames = cached_frames(context, groom, space)
    partial = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        prim = _write_usd(usd, context, groom, frames, partial, report)
        partial.replace(path)
    except (OSError, RuntimeError) as error:  # what USD raises
        reason = str(error).strip().splitlines()[-1] if str(error).strip() else type(error).__name__
        raise FileError(f"cannot write {path}: {reason}; choose another place") from error
    finally:
        partial.unlink(missing_ok=True)
    return prim


def _usd_modules() -> Any:
    try:
        return {name: importlib.import_module(f"pxr.{name}") for name in ("Usd", "UsdGeom", "Vt", "Tf")}
    except ImportError as error:
        raise InputError(
            "this Blender has no USD for Python; bake to Alembic, or use Blender from blender.org"
        ) from error


def _write_usd(
    usd: Any, context: bpy.types.Context, groom: bpy.types.Object, frames: Frames, path: Path, report: Report
) -> str:
    geom, vt = usd["UsdGeom"], usd["Vt"]
    name, reader = usd["Tf"].MakeValidIdentifier(groom.name), frames.reader
    stage = usd["Usd"].Stage.CreateNew(str(path))
    stage.SetStartTimeCode(reader.frame_start)
    stage.SetEndTimeCode(reader.frame_end)
    stage.SetTimeCodesPerSecond(context.scene.render.fps / context.scene.render.fps_base)
    geom.SetStageUpAxis(stage, geom.Tokens.z)
    geom.SetStageMetersPerUnit(stage, air.metres_per_unit(context.scene))
    stage.SetDefaultPrim(geom.Xform.Define(stage, f"/{name}").GetPrim())
    curves = geom.BasisCurves.Define(stage, f"/{name}/{name}")
    curves.CreateTypeAttr("linear" if _is_linear(groom) else "cubic")
    if not _is_linear(groom):
        curves.CreateBasisAttr("catmullRom")
        curves.CreateWrapAttr("pinned")
    curves.CreateCurveVertexCountsAttr(vt.IntArray.FromNumpy(_counts(groom)))
    widths = _widths(groom)
    if widths is not None:
        curves.CreateWidthsAttr(vt.FloatArray.FromNumpy(widths))
        curves.SetWidthsInterpolation("vertex")
    points, extent, unsaved = curves.CreatePointsAttr(), curves.CreateExtentAttr(), 0
    for number, frame in enumerate(frames):
        report(number / len(frames.matrices))
        code = reader.frame_start + number
        points.Set(vt.Vec3fArray.FromNumpy(frame), code)
        extent.Set(
            vt.Vec3fArray.FromNumpy(
                np.array([[column.min() for column in frame.T], [column.max() for column in frame.T]])
            ),
            code,
        )
        unsaved += frame.nbytes
        if unsaved > _USD_BYTES:
            stage.GetRootLayer().Save()
            unsaved = 0
    stage.GetRootLayer().Save()
    return f"/{name}/{name}"


def play_file(groom: bpy.types.Object, path: Path, prim: str, modifier_name: str) -> None:
    """Let Blender's own Mesh Sequence Cache play a file on the groom.

    Raises
    ------
    FileError : Blender cannot open it.
    """
    before = set(bpy.data.cache_files)
    try:
        bpy.ops.cachefile.open(filepath=str(path))
    except RuntimeError as error:
        raise FileError(f"Blender cannot open {path}: {str(error).strip().splitlines()[-1]}") from error
    found = [file for file in bpy.data.cache_files if file not in before]
    if not found:
        raise FileError(f"Blender cannot open {path}")
    modifier = groom.modifiers.get(modifier_name)
    if modifier is None:
        modifier = groom.modifiers.new(modifier_name, "MESH_SEQUENCE_CACHE")
    old = modifier.cache_file
    modifier.cache_file, modifier.object_path = found[0], prim
    # off in 5.2, where modifiers are made by scripts: without it there is no motion blur
    modifier.use_vertex_interpolation = True
    if old is not None and not old.users:
        bpy.data.cache_files.remove(old)
    # what the file moves comes first, what the user added works on it
    groom.modifiers.move(len(groom.modifiers) - 1, 0)
    if bpy.data.filepath:
        found[0].filepath = bpy.path.relpath(str(path))


def export_unreal(
    context: bpy.types.Context,
    groom: bpy.types.Object,
    path: Path,
    *,
    is_cache: bool,
    guides_only: bool,
    with_motion: bool,
    is_y_up: bool,
    report: Report,
) -> int:
    """Write the groom at rest, or its cache, for Unreal; how many guides it has.

    Raises
    ------
    InputError : no strands, no cache or no guides where they are needed. FileError : it cannot be written.
    """
    require(len(groom.data.curves), f"'{groom.name}' has no strands; choose a groom that has")
    unit = air.metres_per_unit(context.scene)
    in_metres = np.diag([unit, unit, unit, 1.0])
    frames = cached_frames(context, groom, "WORLD" if with_motion else "START") if is_cache else None
    matrix = np.array(groom.matrix_world, np.float64) if frames is None else frames.matrices[0]
    kept = playback.rest_positions(groom)
    rest = placed(positions(groom.data) if kept is None else kept, in_metres @ matrix)
    found = _unreal_groom(groom, unit)
    n_frames = 0 if frames is None else len(frames.matrices)
    write_unreal(
        path,
        found,
        rest,
        None if frames is None else Frames(frames.reader, in_metres @ frames.matrices),
        fps=context.scene.render.fps / context.scene.render.fps_base,
        frame_start=1 if frames is None else frames.reader.frame_start,
        axes=Y_UP if is_y_up else UNREAL,
        guides_only=guides_only,
        n_frames=n_frames,
        progress=lambda fraction, _: report(fraction),
    )
    return int(found.is_guide.sum())


def _unreal_groom(groom: bpy.types.Object, unit: float) -> UnrealGroom:
    data, counts = groom.data, _counts(groom)
    is_guide, own_guide = np.zeros(len(counts), np.bool_), None
    if guides.GUIDE in data.attributes:
        chosen, number = guides.read_guides(groom)
        is_guide[chosen] = True
        own_guide = chosen[number]
    widths = _widths(groom)
    widths = np.full(counts.sum(), _DEFAULT_WIDTH, np.float32) if widths is None else widths * np.float32(unit)
    groups = _of_strands(groom, "groom_group_id", "INT")
    groups = np.zeros(len(counts), np.int32) if groups is None else groups
    return UnrealGroom(
        counts,
        widths,
        is_guide,
        groups,
        group_names={} if len(np.unique(groups)) > 1 else {int(groups[0]): groom.name},
        root_uv=_of_strands(groom, "surface_uv_coordinate", "FLOAT2"),
        color=_colors(groom, counts),
        own_guide=own_guide,
        properties=f"Hairloom, Blender {bpy.app.version_string}",
    )


def _of_strands(groom: bpy.types.Object, name: str, kind: str) -> np.ndarray | None:
    attribute = groom.data.attributes.get(name)
    if attribute is None or (attribute.data_type, attribute.domain) != (kind, "CURVE"):
        return None
    return read_attribute(attribute)


def _colors(groom: bpy.types.Object, counts: np.ndarray) -> np.ndarray | None:
    """(P, 3) float32 linear, of the first color attribute that has one of the usual names."""
    for name in _COLORS:
        attribute = groom.data.attributes.get(name)
        if attribute is not None and attribute.data_type in ("FLOAT_COLOR", "FLOAT_VECTOR"):
            values = read_attribute(attribute)[:, :3]
            values = np.repeat(values, counts, axis=0) if attribute.domain == "CURVE" else values
            return np.ascontiguousarray(values)
    return None
