"""Mesh objects and Heads: triangles, scalp and texture coordinates in world space, metres."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ..backend.errors import InputError, require
from ..backend.types import Head
from .attributes import read_attribute, read_values, write_values

SCALP_GROUP = "Scalp"
UV_MAP = "UVMap"
_IN_GROUP = 0.5  # a vertex with at least this weight belongs to the region


@contextmanager
def evaluated_mesh(obj: bpy.types.Object, *, evaluated: bool = True) -> Iterator[bpy.types.Mesh]:
    """The mesh as the modifiers leave it, or, with `evaluated=False`, as it is stored."""
    if not evaluated:
        yield obj.data
        return
    shown = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    try:
        yield shown.to_mesh()
    finally:
        shown.to_mesh_clear()


def read_head(obj: bpy.types.Object, scalp_group: str = SCALP_GROUP, *, evaluated: bool = True) -> Head:
    """The mesh of `obj` in world space with its scalp and active UV map.

    The scalp is the region `scalp_group` (see `read_region`), empty where the mesh has no such region; without a UV
    map the texture coordinates are 0.

    Raises
    ------
    InputError : a mesh without faces.
    """
    with evaluated_mesh(obj, evaluated=evaluated) as mesh:
        triangles, loops, polygons = _triangles(obj, mesh)
        points = read_values(mesh.vertices, "co", np.float32, 3)
        scalp = _region(obj, mesh, scalp_group, triangles, polygons)
        corner_uv = np.zeros((len(triangles), 3, 2), np.float32)
        if mesh.uv_layers.active is not None:
            corner_uv = read_values(mesh.uv_layers.active.uv, "vector", np.float32, 2)[loops]
    transform = np.array(obj.matrix_world, np.float64)
    world = points @ transform[:3, :3].T + transform[:3, 3]
    if np.linalg.det(transform[:3, :3]) < 0:
        # a mirrored object turns its faces inside out
        triangles, corner_uv = triangles[:, ::-1], corner_uv[:, ::-1]
    return Head(
        np.ascontiguousarray(world, np.float32),
        np.ascontiguousarray(triangles),
        scalp if scalp is not None else np.zeros(len(triangles), np.bool_),
        np.ascontiguousarray(corner_uv),
    )


def read_region(obj: bpy.types.Object, name: str) -> np.ndarray:
    """(F,) bool per triangle of the evaluated mesh, in `read_head`'s order: is it in the region `name`?

    The region is a vertex group (a triangle is in when all its corners weigh 0.5 or more) or an attribute of the
    faces (0.5 or more, or true).

    Raises
    ------
    InputError : no such group or attribute, or no triangle in it.
    """
    with evaluated_mesh(obj) as mesh:
        triangles, _, polygons = _triangles(obj, mesh)
        region = _region(obj, mesh, name, triangles, polygons)
    require(region is not None, f"'{obj.name}' has no vertex group or face attribute '{name}'; choose one that it has")
    require(region.any(), f"no face of '{obj.name}' is in '{name}'; give the vertices of the region a weight of 1")
    return region


def has_region(obj: bpy.types.Object, name: str) -> bool:
    """Does the mesh have a vertex group or face attribute `name`? Cheap enough for panels."""
    attribute = obj.data.attributes.get(name)
    return name in obj.vertex_groups or (attribute is not None and attribute.domain == "FACE")


def _triangles(obj: bpy.types.Object, mesh: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (F, 3), loops (F, 3) and polygon (F,) of each triangle, int32."""
    mesh.calc_loop_triangles()
    found = mesh.loop_triangles
    require(len(found), f"'{obj.name}' has no faces; choose a head mesh that has")
    return (
        read_values(found, "vertices", np.int32, 3),
        read_values(found, "loops", np.int32, 3),
        read_values(found, "polygon_index", np.int32),
    )


def _region(
    obj: bpy.types.Object, mesh: bpy.types.Mesh, name: str, triangles: np.ndarray, polygons: np.ndarray
) -> np.ndarray | None:
    if name in obj.vertex_groups:
        return (_group_weights(mesh, obj.vertex_groups[name].index) >= _IN_GROUP)[triangles].all(axis=1)
    attribute = mesh.attributes.get(name)
    if attribute is None or attribute.domain != "FACE" or attribute.data_type not in {"FLOAT", "BOOLEAN", "INT"}:
        return None
    return (read_attribute(attribute) >= _IN_GROUP)[polygons]


def _group_weights(mesh: bpy.types.Mesh, group: int) -> np.ndarray:
    # Blender has no bulk access to vertex groups; heads have thousands of vertices, and this takes a second a million
    weights = np.zeros(len(mesh.vertices), np.float32)
    for vertex in mesh.vertices:
        for membership in vertex.groups:
            if membership.group == group:
                weights[vertex.index] = membership.weight
    return weights


def write_scalp(obj: bpy.types.Object, head: Head, name: str = SCALP_GROUP) -> None:
    """Make vertex group `name` of exactly the corners of `head`'s scalp triangles, `head` read without modifiers."""
    group = obj.vertex_groups.get(name) or obj.vertex_groups.new(name=name)
    group.remove(list(range(len(obj.data.vertices))))
    group.add(np.unique(head.triangles[head.scalp]).tolist(), 1.0, "REPLACE")


def write_uv(obj: bpy.types.Object, corner_uv: np.ndarray, name: str = UV_MAP) -> None:
    """Give the mesh a UV map from corner_uv (F, 3, 2) float32 of its stored triangles.

    An unwrap of triangles may cut a polygon along its diagonal, and a polygon corner has only one coordinate: such
    polygons get islands of their own beside the unit square, so that every point of the surface keeps a UV of its own.
    """
    mesh = obj.data
    _, loops, polygons = _triangles(obj, mesh)
    uv = np.zeros((len(mesh.loops), 2), np.float32)
    uv[loops] = corner_uv
    cut = np.unique(polygons[(np.abs(uv[loops] - corner_uv) > 1e-6).any(axis=(1, 2))])
    columns = int(np.ceil(np.sqrt(len(cut)))) or 1
    # one over the few polygons that are cut
    for place, index in enumerate(cut.tolist()):
        polygon = mesh.polygons[index]
        corner = np.array([1.0 + (place % columns) / columns, (place // columns) / columns])
        uv[list(polygon.loop_indices)] = corner + _flat(mesh, polygon) * (0.9 / columns)
    layer = mesh.uv_layers.new(name=name)
    write_values(layer.uv, "vector", uv, np.float32, 2)
    mesh.uv_layers.active = layer


def _flat(mesh: bpy.types.Mesh, polygon: bpy.types.MeshPolygon) -> np.ndarray:
    """(n, 2) the polygon's corners in its own plane, scaled into the unit square."""
    points = np.array([mesh.vertices[v].co for v in polygon.vertices], np.float64)
    normal = np.array(polygon.normal, np.float64)
    across = points[1] - points[0]
    flat = np.stack([points @ across, points @ np.cross(normal, across)], axis=1)
    flat -= flat.min(axis=0)
    return flat / max(float(flat.max()), 1e-30)


def new_head_object(name: str, head: Head, collection: bpy.types.Collection) -> bpy.types.Object:
    """A mesh object with the head's faces, UV map and scalp vertex group, linked to `collection`."""
    mesh = bpy.data.meshes.new(name)
    count = len(head.triangles)
    mesh.vertices.add(len(head.vertices))
    mesh.loops.add(3 * count)
    mesh.polygons.add(count)
    write_values(mesh.vertices, "co", head.vertices, np.float32, 3)
    write_values(mesh.loops, "vertex_index", head.triangles.ravel(), np.int32)
    write_values(mesh.polygons, "loop_start", np.arange(0, 3 * count, 3, dtype=np.int32), np.int32)
    layer = mesh.uv_layers.new(name=UV_MAP)
    write_values(layer.uv, "vector", head.corner_uv.reshape(-1, 2), np.float32, 2)
    mesh.update(calc_edges=True)
    mesh.shade_smooth()
    obj = bpy.data.objects.new(name, mesh)
    collection.objects.link(obj)
    write_scalp(obj, head)
    return obj


def active_uv_map(obj: bpy.types.Object) -> str:
    """Name of the mesh's active UV map.

    Raises
    ------
    InputError : it has none.
    """
    layer = obj.data.uv_layers.active
    if layer is None:
        raise InputError(f"'{obj.name}' has no UV map, which attached hair needs; run Set Up Head on it")
    return layer.name
