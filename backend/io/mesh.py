"""Meshes from Wavefront .obj: `v`, `vt` and `f` with polygons of any size, groups and objects."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import FileError
from ..types import Bools, Float32, Int32
from .files import damaged, read_file
from .obj import resolve, texture_coordinates_of, vertices_of
from .text import Indices, KeywordLines
from .units import METRES_Y_UP, Units


@dataclass(frozen=True, slots=True)
class MeshFile:
    """A triangulated mesh of a file, in world space.

    vertices : (V, 3) float32, metres. vertex_in_file : (V,) int32, its number in the file, from 0.
    triangles : (F, 3) int32, in the file's winding. polygon_in_file : (F,) int32, the `f` line it is from, from 0.
    corner_uv : (F, 3, 2) float32, or None when a chosen face has no texture coordinates.
    """

    vertices: Float32
    vertex_in_file: Int32
    triangles: Int32
    polygon_in_file: Int32
    corner_uv: Float32 | None


def read_mesh(
    path: str | os.PathLike[str], units: Units | None = None, group: str | None = None
) -> tuple[Float32, Int32, Float32 | None]:
    """Vertices, triangles and corner uv of `read_mesh_file`."""
    mesh = read_mesh_file(path, units, group)
    return mesh.vertices, mesh.triangles, mesh.corner_uv


def read_mesh_file(path: str | os.PathLike[str], units: Units | None = None, group: str | None = None) -> MeshFile:
    """Read an .obj mesh; polygons become fans of triangles around their first corner.

    Parameters
    ----------
    units : unit and axes of the file; metres, y up when None.
    group : only the faces of this `g` group or `o` object, and the vertices they use; all faces and vertices when None.

    Raises
    ------
    FileError : missing or damaged file, a face that names a vertex that does not exist, no faces, no such group, or a
        coordinate that is NaN or infinite.
    """
    path = Path(path)
    if path.suffix.lower() != ".obj":
        raise FileError(f"{path} has no known mesh format; use .obj")
    lines = KeywordLines(path, read_file(path))
    positions, vertex_lines = vertices_of(lines)
    faces = lines.find("f")
    if not len(faces):
        raise damaged(path, "it has no faces ('f' lines); choose a mesh")
    corners, texture, counts = lines.references(faces, 3)
    corners = resolve(lines, corners, faces, counts, vertex_lines, "vertex")
    chosen = np.ones(len(faces), dtype=np.bool_) if group is None else _faces_of_group(lines, faces, group)
    fans, polygons = _fans(counts, chosen)
    triangles = corners[fans]
    used = np.arange(len(positions)) if group is None else np.unique(triangles)
    renumbered = np.zeros(len(positions), dtype=np.int32)
    renumbered[used] = np.arange(len(used), dtype=np.int32)
    vertices = (units or METRES_Y_UP).to_world(positions[used])
    if not np.isfinite(vertices).all():
        raise damaged(path, "a vertex is NaN, infinite or too far away")
    uv = None
    if (texture[fans] != 0).all():
        coordinates, texture_lines = texture_coordinates_of(lines)
        named = np.where(texture == 0, 1, texture)  # 0, none given, is left only on faces that are not chosen
        given = resolve(lines, named, faces, counts, texture_lines, "texture coordinate")
        with np.errstate(over="ignore"):
            uv = coordinates[given[fans]].astype(np.float32)
        if not np.isfinite(uv).all():
            raise damaged(path, "a texture coordinate is NaN or infinite")
    return MeshFile(vertices, used.astype(np.int32), renumbered[triangles], polygons.astype(np.int32), uv)


def _fans(counts: Indices, chosen: Bools) -> tuple[Indices, Indices]:
    """(F, 3) places in the corner list of each triangle of the chosen faces, and (F,) its face."""
    n_triangles = np.where(chosen, counts - 2, 0)
    polygons = np.repeat(np.arange(len(counts)), n_triangles)
    first = (np.cumsum(counts) - counts)[polygons]
    step = np.arange(len(polygons)) - np.repeat(np.cumsum(n_triangles) - n_triangles, n_triangles)
    return np.stack([first, first + step + 1, first + step + 2], axis=1), polygons


def _faces_of_group(lines: KeywordLines, faces: Indices, group: str) -> Bools:
    chosen = np.zeros(len(faces), dtype=np.bool_)
    names: set[str] = set()
    for keyword in ("g", "o"):
        headings = lines.find(keyword)
        # A loop over group lines, which are few: their names are text.
        words = [lines.words(int(heading)) for heading in headings]
        names.update(name for line in words for name in line)
        named = np.array([False] + [group in line or group == " ".join(line) for line in words])
        chosen |= named[np.searchsorted(headings, faces)]
    if not chosen.any():
        known = ", ".join(sorted(names)[:8]) or "none"
        raise FileError(f"{lines.path} has no faces in a group {group!r}; its groups are {known}")
    return chosen
