"""The four-view wizard and the backend: the inputs of its jobs, one function each, and their results in the scene."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Vector

from .. import fourview, fourview_materials, fourview_strokes, scene
from ..backend.errors import require
from ..backend.fourview.project import Project, ProjectStroke, ProjectView, Scribble
from ..backend.fourview.project import write_project as write_project_file
from ..backend.fourview.views import DirectionStroke, View
from ..backend.geometry import camera as cameras
from ..backend.geometry.head import HeadSurface
from ..backend.geometry.strand_raster import hair_mask
from ..backend.geometry.view_raster import raster_mesh
from ..backend.io.files import atomic_write
from ..backend.io.images import write_image
from ..backend.types import Camera, Head, StrandSet
from . import camera, curves, image, inputs, mesh
from .attributes import write_values

Values = dict[str, Any]
_LINES = 6000  # directions shown: more hide each other
_LINE_LENGTH = 0.006  # metres
_SILHOUETTE_PX = 500  # longer side of the picture in which a result's border is looked for
_HEAD_UNITS = "m,z-up"
_SCALP = "Scalp"  # the group of faces in the head's file


# --- inputs of the jobs ------------------------------------------------------------------------------------------


def read_views(context: bpy.types.Context) -> list[View]:
    """All photos as the method sees them.

    Raises
    ------
    InputError : a photo without mask, an empty mask, a plane that is no camera.
    """
    return [
        View(name, image.read_pixels(photo.image), image.read_mask(photo.mask), camera.camera_of(photo))
        for name, photo in fourview.named_photos(context).items()
    ]


def place_inputs(context: bpy.types.Context) -> Values:
    """The inputs of the job `four_view_place`: masks, pictures, landmarks of the photos of usual views; the head."""
    named = {name: p for name, p in fourview.named_photos(context).items() if name in cameras.STANDARD_DIRECTIONS}
    require(named, "no photo has a view that can be placed by itself: choose Front, Back, Left, Right or Top for one")
    for photo in named.values():
        image.take_stock(photo)
    return {
        "masks": {name: image.read_mask(photo.mask) for name, photo in named.items()},
        "images": {name: image.read_pixels(photo.image) for name, photo in named.items()},
        "landmarks": {name: json.loads(photo.landmarks) for name, photo in named.items() if photo.landmarks},
        "head": inputs.read_scalp(fourview.head_of(context)),
    }


def stage_inputs(context: bpy.types.Context, stage: str) -> Values:
    """The inputs of the job of a stage: views, head, and what the stages before have made."""
    for photo in fourview.project(context).photos:
        image.take_stock(photo)
    values: Values = {"views": read_views(context), "head": inputs.read_scalp(fourview.head_of(context))}
    for before, names in _NEEDS[stage].items():
        made = fourview.read_result(context, before)
        values |= {name: made[name] for name in names}
    if stage == "directions":
        values["strokes"] = read_strokes(context)
    own = scene.settings(context).four_view.grooms_folder
    if stage == "shape" and own:
        values["folders"] = [os.path.abspath(bpy.path.abspath(own))]
    return values


_NEEDS: dict[str, dict[str, tuple[str, ...]]] = {
    "shape": {},
    "texture": {"shape": ("shape",)},
    "directions": {"shape": ("shape",), "texture": ("surface", "texture")},
    "strands": {"shape": ("shape",), "directions": ("directions",)},
}


def read_strokes(context: bpy.types.Context) -> list[DirectionStroke]:
    """The strokes along the hair; those on photos that are gone are left out."""
    found = []
    for stroke in fourview_strokes.read(fourview.project(context).strokes):
        seen = camera_of_stroke(context, stroke)
        if seen is not None:
            found.append(DirectionStroke(seen, np.array(stroke["points"], np.float64)))
    return found


def camera_of_stroke(context: bpy.types.Context, stroke: Values) -> Camera | None:
    """Whose pixels a stroke's points are: those of a photo, or of the 3D view in which it was drawn."""
    if "view" not in stroke:
        return camera.camera_from_numbers(stroke["camera"])
    photo = fourview.named_photos(context).get(stroke["view"])
    return camera.camera_of(photo) if photo is not None and photo.plane is not None else None


# --- results in the scene ----------------------------------------------------------------------------------------


def apply_cameras(context: bpy.types.Context, outputs: Values) -> str:
    """Lay the planes as the job `four_view_place` found; returns what to tell the user."""
    named = fourview.named_photos(context)
    for name, found in outputs["cameras"].items():
        named[name].plane.matrix_world = camera.matrix_of_camera(found)
        named[name].is_perspective = False
    project = fourview.project(context)
    project.remarks = "\n".join(outputs.get("remarks", ()))
    by_hand = [name for name in named if name not in outputs["cameras"]]
    text = f"{len(outputs['cameras'])} photos laid over the head: look through each and correct it"
    return "; ".join([text, *([f"place {', '.join(by_hand)} by hand"] if by_hand else []), *outputs.get("remarks", ())])


def apply_stage(context: bpy.types.Context, stage: str, outputs: Values) -> str:
    """Show a stage's result in the scene and keep it; returns what to tell the user."""
    show = {"shape": _show_shape, "texture": _show_texture, "directions": _show_directions, "strands": _show_strands}
    fourview.write_result(context, stage, outputs)  # first: a full disk must not leave half a result in the scene
    report = "\n".join(show[stage](context, outputs))
    fourview.remember_result(context, stage, report)
    return "; ".join(report.splitlines())


def _show_shape(context: bpy.types.Context, outputs: Values) -> list[str]:
    project, shape = fourview.project(context), outputs["shape"]
    project.closed_object = _mesh_object(context, project.closed_object, "Hair Solid", shape.closed)
    project.closed_object.hide_set(True)
    project.closed_object.hide_render = True
    project.open_object = _mesh_object(context, project.open_object, "Hair Shape", shape.open)
    names = fourview.names(project)
    fits = ", ".join(f"{name} {iou:.0%}" for name, iou in zip(names, shape.mask_iou.tolist()))
    return [f"Most like '{shape.style}'; covers the masks by {fits}", *outputs.get("remarks", ())]


def _show_texture(context: bpy.types.Context, outputs: Values) -> list[str]:
    project, surface = fourview.project(context), outputs["surface"]
    obj = _mesh_object(context, project.open_object, "Hair Shape", surface.mesh)
    project.open_object = obj
    layer = obj.data.uv_layers.new(name=mesh.UV_MAP)
    # our first row of texels is the uppermost
    uv = surface.corner_uv.reshape(-1, 2) * np.float32([1, -1]) + np.float32([0, 1])
    write_values(layer.uv, "vector", np.ascontiguousarray(uv, np.float32), np.float32, 2)
    old = bpy.data.images.get("Hair Texture")
    picture = image.new_image("Hair Texture", outputs["image"])
    material = fourview_materials.texture_material(picture)
    obj.data.materials.clear()
    obj.data.materials.append(material)
    if old is not None and old.users == 0:
        bpy.data.images.remove(old)
        picture.name = "Hair Texture"
    scene.show_colors(context)
    seen = float((outputs["texture"].coverage > 0).mean())
    return [
        f"{picture.size[0]} x {picture.size[1]} pixels; the photos show {seen:.0%} of the hair, the rest is made up"
    ]


def _show_directions(context: bpy.types.Context, outputs: Values) -> list[str]:
    project, found = fourview.project(context), outputs["directions"]
    # every n-th, so that they cover the whole surface
    chosen = np.arange(0, len(found.points), max(1, len(found.points) // _LINES))
    start = found.points[chosen] + 0.001 * found.normals[chosen]
    ends = start + _LINE_LENGTH * found.directions[chosen]
    # an arrow: the line and one barb at its tip
    side = np.cross(found.directions[chosen], found.normals[chosen])
    barbs = ends - 0.3 * _LINE_LENGTH * (found.directions[chosen] + 0.6 * side)
    count = len(chosen)
    vertices = np.concatenate([start, ends, barbs]).astype(np.float32)
    first = np.arange(count, dtype=np.int32)
    edges = np.concatenate([np.stack([first, first + count], 1), np.stack([first + count, first + 2 * count], 1)])
    obj = _object(context, project.lines_object, "Hair Directions")
    obj.data.vertices.add(len(vertices))
    obj.data.edges.add(len(edges))
    write_values(obj.data.vertices, "co", vertices, np.float32, 3)
    write_values(obj.data.edges, "vertices", edges.astype(np.int32), np.int32, 2)
    obj.data.update()
    obj.hide_render = True
    project.lines_object = obj
    return [f"{len(found.points):,} directions; arrows point from root to tip"]


def _show_strands(context: bpy.types.Context, outputs: Values) -> list[str]:
    project, head, strands = fourview.project(context), fourview.head_of(context), outputs["strands"]
    uv_map = mesh.active_uv_map(head)
    if "radius" not in strands.point_attributes:
        radius = np.full(len(strands.points), inputs.DEFAULT_RADIUS, np.float32)
        strands = StrandSet(
            strands.points, strands.offsets, {**strands.point_attributes, "radius": radius}, strands.strand_attributes
        )
    old = _visible(context, project.hair_object)
    if old is not None:
        curves.replace_strands(old, strands)
        obj = old
    else:
        obj = curves.new_object("Four-View Hair", strands, fourview.collection(context))
    surface = HeadSurface(mesh.read_head(head))
    _, triangle, barycentric = surface.closest_points(strands.roots)
    curves.attach(obj, head, uv_map, surface.uv_at(triangle, barycentric))
    if not obj.data.materials:
        obj.data.materials.append(fourview_materials.hair_material())
    project.hair_object = obj
    for other in (project.open_object, project.lines_object):
        if _visible(context, other) is not None:
            other.hide_set(True)
    scene.select_only(context, obj)
    scene.show_colors(context)
    return _report_lines(strands, outputs.get("report") or {})


def _report_lines(strands: StrandSet, report: Values) -> list[str]:
    """What `fourview.quality.quality_report` found, in the user's words."""
    lines = [f"{strands.n_strands:,} strands"]
    for name, found in report.get("views", {}).items():
        angle = found["orientation_median_deg"]
        off = "" if angle is None else f", directions {angle:.0f}° off"
        lines.append(f"{name.capitalize()}: mask {found['mask_iou']:.0%}{off}")
    inside = report.get("penetration", {}).get("point_share", 0.0)
    return [*lines, f"{inside:.1%} of the points are inside the head"] if inside else lines


def _visible(context: bpy.types.Context, obj: bpy.types.Object | None) -> bpy.types.Object | None:
    """An object where it is still in the scene."""
    return obj if obj is not None and obj.name in context.view_layer.objects else None


def _object(context: bpy.types.Context, old: bpy.types.Object | None, name: str) -> bpy.types.Object:
    """The object with a new, empty mesh; the old mesh goes when nobody else has it."""
    data = bpy.data.meshes.new(name)
    obj = _visible(context, old)
    if obj is None:
        obj = bpy.data.objects.new(name, data)
        fourview.collection(context).objects.link(obj)
        return obj
    before, obj.data = obj.data, data
    if before.users == 0:
        bpy.data.meshes.remove(before)
    obj.hide_set(False)
    return obj


def _mesh_object(context: bpy.types.Context, old: bpy.types.Object | None, name: str, found: Any) -> bpy.types.Object:
    obj = _object(context, old, name)
    count = len(found.triangles)
    data = obj.data
    data.vertices.add(len(found.vertices))
    data.loops.add(3 * count)
    data.polygons.add(count)
    inverse = obj.matrix_world.inverted()
    write_values(data.vertices, "co", curves.transformed(found.vertices, inverse), np.float32, 3)
    write_values(data.loops, "vertex_index", np.ascontiguousarray(found.triangles).ravel(), np.int32)
    write_values(data.polygons, "loop_start", np.arange(0, 3 * count, 3, dtype=np.int32), np.int32)
    data.update(calc_edges=True)
    data.shade_smooth()
    return obj


# --- lines over the view -----------------------------------------------------------------------------------------


def mask_outline(photo: Any) -> np.ndarray:
    """(2 n, 3) float32, metres: pairs of ends of the lines of the mask's border, on the photo's plane."""
    return camera.pixels_in_world(photo, image.outline_segments(image.read_mask(photo.mask)).reshape(-1, 2))


def silhouette(context: bpy.types.Context, photo: Any) -> np.ndarray:
    """The same for the border of the hair as the photo's camera sees it, or of its shape before there is hair."""
    project, seen = fourview.project(context), camera.camera_of(photo)
    scale = min(1.0, _SILHOUETTE_PX / max(seen.size))
    small = cameras.resized(seen, scale)
    hair, solid = _visible(context, project.hair_object), _visible(context, project.closed_object)
    head = fourview.head_of(context)
    if hair is not None:
        covered = hair_mask(small, curves.read_strands(hair), mesh.read_head(head) if head is not None else None)
    elif solid is not None:
        covered = _covered(small, solid, head)
    else:
        return np.zeros((0, 3), np.float32)
    lines = image.outline_segments(covered).reshape(-1, 2)
    return camera.pixels_in_world(photo, lines * np.divide(seen.size, small.size))


def _covered(seen: Camera, solid: bpy.types.Object, head: bpy.types.Object | None) -> np.ndarray:
    """(H, W) bool: where the shape is seen before the head."""
    shape = mesh.read_head(solid)
    drawn = raster_mesh(seen, shape.vertices, shape.triangles)
    if head is None:
        return drawn.triangle >= 0
    other = mesh.read_head(head)
    behind = raster_mesh(seen, other.vertices, other.triangles)
    return (drawn.triangle >= 0) & (drawn.depth <= behind.depth)


def scribbles_in_world(photo: Any) -> list[tuple[str, float, np.ndarray]]:
    """Kind, width in pixels of the photo, and points (n, 3) of each scribble."""
    return [
        (one["kind"], float(one["width"]), camera.pixels_in_world(photo, np.array(one["points"])))
        for one in fourview_strokes.read(photo.scribbles)
    ]


def landmarks_in_world(photo: Any) -> np.ndarray:
    """(n, 3) float32, metres."""
    return camera.pixels_in_world(photo, np.array(list(json.loads(photo.landmarks).values())))


# --- strokes along the hair --------------------------------------------------------------------------------------


def stroke_camera(context: bpy.types.Context) -> str:
    """Whose pixels a stroke drawn in this 3D view has, as JSON: the active photo's where one looks through it."""
    photo = fourview.active_photo(context)
    if photo.plane is not None and camera.is_looked_through(photo, context.region_data):
        return json.dumps({"view": fourview.active_name(context)})
    return json.dumps({"camera": camera.camera_numbers(camera.viewport_camera(context.region, context.region_data))})


def stroke_pixel(context: bpy.types.Context, seen: Values, place: tuple[float, float]) -> tuple[float, float] | None:
    """The pixel under the mouse, of the photo or of the 3D view."""
    if "view" in seen:
        photo = fourview.named_photos(context)[seen["view"]]
        return camera.pixel_under_mouse(photo, context.region, context.region_data, place)
    return float(place[0]), float(context.region.height - place[1])


def stroke_in_world(context: bpy.types.Context, stroke: Values) -> np.ndarray:
    """(n, 3) float32, metres: a stroke on the shape; beside it, as deep as the point before."""
    hits, distance, origins, directions = _hits(context, stroke)
    if not hits.any():
        distance[:] = cameras.DISTANCE
    else:
        known = np.flatnonzero(hits)
        nearest = known[np.abs(np.arange(len(hits))[:, None] - known[None]).argmin(axis=1)]
        distance = distance[nearest]
    return (origins + directions * (distance - 0.002)[:, None]).astype(np.float32)


def strokes_in_world(context: bpy.types.Context) -> list[np.ndarray]:
    strokes = fourview_strokes.read(fourview.project(context).strokes)
    return [stroke_in_world(context, s) for s in strokes if camera_of_stroke(context, s) is not None]


def share_on_hair(context: bpy.types.Context, stroke: Values) -> float:
    """Which share of a stroke's points lies on the shape."""
    return float(_hits(context, stroke)[0].mean())


def _hits(context: bpy.types.Context, stroke: Values) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Does each point meet the shape (n,), at which distance (n,), along rays from (n, 3) in directions (n, 3)?"""
    seen = camera_of_stroke(context, stroke)
    require(seen is not None, f"the photo '{stroke.get('view')}' of a stroke is gone")
    origins, directions = cameras.rays(seen, np.array(stroke["points"], np.float64).reshape(-1, 2))
    obj = fourview.visible_shape(context)
    hits, distance = np.zeros(len(origins), np.bool_), np.zeros(len(origins))
    if obj is None:
        return hits, distance, origins, directions
    inverse = obj.matrix_world.inverted()
    # one over the points of a stroke, of which there are dozens
    for index, (origin, direction) in enumerate(zip(origins.tolist(), directions.tolist())):
        # from far before: a 3D view's camera may stand within the hair
        start = Vector(origin) - 10.0 * Vector(direction) if seen.orthographic else Vector(origin)
        hit, place, _, _ = obj.ray_cast(inverse @ start, (inverse.to_3x3() @ Vector(direction)).normalized())
        if hit:
            hits[index] = True
            distance[index] = (obj.matrix_world @ place - Vector(origin)).dot(Vector(direction))
    return hits, distance, origins, directions


# --- the project's file ------------------------------------------------------------------------------------------


def write_project(context: bpy.types.Context, path: Path) -> list[Path]:
    """Write PROJECT.toml and, beside it, photos, masks and the head; returns these files.

    Raises
    ------
    InputError : a photo without mask, a plane that is no camera. FileError : a file cannot be written.
    """
    folder, written = path.parent, []
    views = []
    for name, photo in fourview.named_photos(context).items():
        files = {"image": f"{path.stem}_{name}.png", "mask": f"{path.stem}_{name}_mask.png"}
        write_image(folder / files["image"], image.read_pixels(photo.image))
        write_image(folder / files["mask"], image.read_mask(photo.mask))
        written += [folder / file for file in files.values()]
        marks = {key: (x, y) for key, (x, y) in json.loads(photo.landmarks or "{}").items()}
        scribbles = tuple(
            Scribble(one["kind"], np.array(one["points"], np.float64), float(one["width"]))
            for one in fourview_strokes.read(photo.scribbles)
        )
        views.append(ProjectView(name, files["image"], files["mask"], camera.camera_of(photo), marks, scribbles))
    head = folder / f"{path.stem}_head.obj"
    _write_head(head, inputs.read_scalp(fourview.head_of(context)))
    settings = scene.settings(context).four_view.to_params()
    strokes = tuple(
        ProjectStroke(
            one.get("view", "free"),
            np.array(one["points"], np.float64),
            None if "view" in one else camera.camera_from_numbers(one["camera"]),
        )
        for one in fourview_strokes.read(fourview.project(context).strokes)
    )
    write_project_file(
        path, Project(folder, tuple(views), strokes, head.name, _HEAD_UNITS, settings=settings, scalp=_SCALP)
    )
    return [*written, head]


def _write_head(path: Path, head: Head) -> None:
    """The head as an .obj, metres, z up; the faces of its scalp are a group."""
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in head.vertices.tolist()]
    lines += [f"vt {u:.7g} {v:.7g}" for u, v in head.corner_uv.reshape(-1, 2).tolist()]
    # in the order of the triangles: a group's name wherever another one begins
    first = np.diff(head.scalp.astype(np.int8), prepend=2) != 0
    for number, (a, b, c) in enumerate((head.triangles + 1).tolist()):
        if first[number]:
            lines.append(f"g {_SCALP if head.scalp[number] else 'Skin'}")
        uv = 3 * number + 1
        lines.append(f"f {a}/{uv} {b}/{uv + 1} {c}/{uv + 2}")
    with atomic_write(path) as stream:
        stream.write(("\n".join(lines) + "\n").encode("ascii"))
