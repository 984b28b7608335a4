"""A four-view project: PROJECT.toml with photos, masks or scribbles, cameras, strokes and settings, read and written.

    format = "hairloom-four-view"
    version = 1
    head = "head.obj"                       # without: Hairloom's own head
    scalp = "Scalp"                         # the head's group of faces that hair grows on; without: guessed
    [[view]]
    name = "front"                          # front, back, left, right, top, or any other word with a camera
    image = "front.png"
    mask = "front_mask.png"                 # without: cut out by the scribbles, or guessed
    [view.landmarks]                        # pixels; help to place a view that has no camera
    nose = [400.0, 380.0]
    [view.camera]
    orthographic = true
    intrinsics = [[...], [...], [...]]      # or: direction, centre, pixels_per_metre (position, target, focal_px)
    world_to_camera = [[...], [...], [...], [...]]
    [[view.scribble]]
    kind = "hair"                           # or "background"
    width = 8.0
    points = [[10.0, 20.0], [30.0, 40.0]]
    [[stroke]]
    view = "front"                          # or "top" without a photo: then with a camera of its own
    points = [[10.0, 20.0], [30.0, 40.0]]
    [settings]
    with_detail = true
    [settings.strands]
    n_strands = 30000

Every file lies in the project's folder or below.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import cv2
import numpy as np

from ..errors import InputError, require
from ..geometry.camera import orthographic_camera, perspective_camera
from ..io.files import atomic_write
from ..io.toml import Table, check_names, read_toml
from ..types import Bools, Camera, Float64
from .views import MAX_VIEWS

FORMAT, VERSION = "hairloom-four-view", 1
KINDS = ("hair", "background")
SINGLE = ("n_tried", "with_detail")  # the settings of `pipeline.FourViewParams` that are no groups

_TOP = {"format", "version", "head", "head_units", "scalp", "grooms", "view", "stroke", "settings"}
_VIEW = {"name", "image", "mask", "camera", "landmarks", "scribble"}
_CAMERA = {
    "orthographic", "intrinsics", "world_to_camera", "direction", "up", "centre", "pixels_per_metre", "position",
    "target", "focal_px", "size",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Scribble:
    """A line drawn on a photo that says what is hair. points : (n, 2) float64, pixels. width : pixels."""

    kind: str
    points: Float64
    width: float = 8.0

    def __post_init__(self) -> None:
        require(self.kind in KINDS, f"a scribble is of kind '{self.kind}'; take one of {', '.join(KINDS)}")
        require(0 < self.width <= 1000, f"a scribble is {self.width} px wide; take above 0 to 1000")
        fits = self.points.ndim == 2 and self.points.shape[1] == 2 and len(self.points) >= 1
        require(fits, f"a scribble's points must have shape (n, 2), not {self.points.shape}")


@dataclass(frozen=True, slots=True)
class ProjectView:
    """A photo of the project. image, mask : files, relative to the project's folder."""

    name: str
    image: str
    mask: str | None = None
    camera: Camera | None = None
    landmarks: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    scribbles: tuple[Scribble, ...] = ()


@dataclass(frozen=True, slots=True)
class ProjectStroke:
    """A stroke from root to tip on a view; `camera` where no photo has that name. points : (n, 2) float64, pixels."""

    view: str
    points: Float64
    camera: Camera | None = None


@dataclass(frozen=True, slots=True)
class Project:
    """What PROJECT.toml says; `folder` is where it lies.

    grooms : folders of the user's own hairstyles. scalp : the group of the head's faces that hair grows on.
    settings : as `registry.build_params` takes them for `pipeline.FourViewParams`.
    """

    folder: Path
    views: tuple[ProjectView, ...]
    strokes: tuple[ProjectStroke, ...] = ()
    head: str | None = None
    head_units: str | None = None
    grooms: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    scalp: str | None = None

    def __post_init__(self) -> None:
        require(1 <= len(self.views) <= MAX_VIEWS, f"a project has {len(self.views)} views; give 1 to {MAX_VIEWS}")
        names = [view.name for view in self.views]
        for name in names:
            require(names.count(name) == 1, f"two views are called '{name}'; give each its own name")

    def path(self, name: str) -> Path:
        """The file of the project's folder that `name` means.

        Raises
        ------
        InputError : an absolute path, or one that leaves the folder.
        """
        return inside(self.folder, name)


def inside(folder: Path, name: str) -> Path:
    """`folder / name`, refused where it leads out of the folder, also by symbolic links."""
    pure = PurePosixPath(name.replace("\\", "/"))
    drive = len(name) > 1 and name[1] == ":"
    escapes = pure.is_absolute() or drive or ".." in pure.parts or "\0" in name
    require(name and not escapes, f"the project names '{name}', which is outside its folder; copy the file into it")
    path = folder / pure
    real, root = path.resolve(), folder.resolve()
    require(
        real.is_relative_to(root), f"the project names '{name}', which leads out of its folder; copy the file into it"
    )
    return path


def read_project(path: Path) -> Project:
    """Read a PROJECT.toml; the files that it names are looked at later.

    Raises
    ------
    FileError : missing, or no TOML. InputError : a name that is not known, or a bad value; one line that says which.
    """
    table = read_toml(path)
    try:
        return _project(path, table)
    except (TypeError, KeyError, AttributeError) as error:
        raise InputError(f"{path}: a value has another form than the format says ({error!r})") from error


def write_project(path: Path, project: Project) -> None:
    """Write a PROJECT.toml that `read_project` gives back; equal projects give equal bytes.

    Raises
    ------
    FileError : the file cannot be written. InputError : a file outside of the project's folder.
    """
    lines = [f'format = "{FORMAT}"', f"version = {VERSION}"]
    whole = {
        "head": project.head, "head_units": project.head_units, "scalp": project.scalp, "grooms": list(project.grooms)
    }  # fmt: skip
    lines += [f"{name} = {_text(value)}" for name, value in whole.items() if value]
    for view in project.views:
        lines += ["", "[[view]]", *_view_lines(project, view)]
    for stroke in project.strokes:
        lines += ["", "[[stroke]]", f"view = {_text(stroke.view)}", f"points = {_text(stroke.points.tolist())}"]
        if stroke.camera is not None:
            lines += ["[stroke.camera]", *_camera_lines(stroke.camera)]
    single = {name: value for name, value in project.settings.items() if not isinstance(value, Mapping)}
    lines += ["", "[settings]", *_table_lines(single)] if single else []
    for group, values in project.settings.items():
        if group not in single:
            lines += ["", f"[settings.{group}]", *_table_lines(values)]
    with atomic_write(path) as stream:
        stream.write(("\n".join(lines) + "\n").encode("utf-8"))


def paint_scribbles(scribbles: tuple[Scribble, ...], kind: str, size: tuple[int, int]) -> Bools:
    """(H, W) bool: where scribbles of a kind cover a picture of `size` (width, height)."""
    canvas = np.zeros((size[1], size[0]), np.uint8)
    for scribble in scribbles:
        if scribble.kind == kind:
            corners = np.round(np.clip(scribble.points, -1e4, 1e5) - 0.5).astype(np.int32)
            thickness = max(1, round(scribble.width))
            cv2.polylines(canvas, [corners if len(corners) > 1 else corners.repeat(2, axis=0)], False, 1, thickness)
    return canvas.astype(np.bool_)


def _project(path: Path, table: Table) -> Project:
    check_names(table, _TOP, str(path))
    require(table.get("format") == FORMAT, f'{path} is no four-view project; it must say format = "{FORMAT}"')
    require(table.get("version") == VERSION, f"{path} has version {table.get('version')}; {VERSION} is known")
    require(isinstance(table.get("view"), list), f"{path} has no [[view]]; give 1 to {MAX_VIEWS}")
    settings = table.get("settings", {})
    fits = isinstance(settings, dict) and all(isinstance(v, dict) or name in SINGLE for name, v in settings.items())
    require(fits, f"{path}: [settings] must hold {', '.join(SINGLE)} or groups such as [settings.strands]")
    scalp = table.get("scalp")
    is_group = scalp is None or (isinstance(scalp, str) and scalp and "head" in table)
    require(is_group, f"{path}: scalp is {scalp!r}; it must be the name of a group of faces in the file of head")
    project = Project(
        folder=path.parent,
        views=tuple(_view(view, number) for number, view in enumerate(table["view"], 1)),
        strokes=tuple(_stroke(stroke, number) for number, stroke in enumerate(table.get("stroke", []), 1)),
        head=table.get("head"),
        head_units=table.get("head_units"),
        grooms=tuple(table.get("grooms", ())),
        settings=settings,
        scalp=scalp,
    )
    for name in [project.head, *project.grooms, *[f for v in project.views for f in (v.image, v.mask)]]:
        if name is not None:
            require(isinstance(name, str), f"{path}: a file's name must be text, not {name!r}")
            project.path(name)
    return project


def _view(table: Table, number: int) -> ProjectView:
    where = f"view {number}"
    check_names(table, _VIEW, where)
    for name in ("name", "image"):
        require(isinstance(table.get(name), str) and table[name], f"{where} has no {name}; give it as text")
    where = f"view '{table['name']}'"
    marks = {}
    for name, pixel in table.get("landmarks", {}).items():
        x, y = _numbers(pixel, (2,), f"{where}: landmark '{name}'")
        marks[name] = (float(x), float(y))
    scribbles = tuple(
        Scribble(
            str(scribble.get("kind")),
            _numbers(scribble.get("points"), (None, 2), f"{where}: a scribble"),
            float(scribble.get("width", 8.0)),
        )
        for scribble in table.get("scribble", [])
    )
    camera = _camera(table["camera"], where) if "camera" in table else None
    return ProjectView(table["name"], table["image"], table.get("mask"), camera, marks, scribbles)


def _stroke(table: Table, number: int) -> ProjectStroke:
    where = f"stroke {number}"
    check_names(table, {"view", "points", "camera"}, where)
    require(isinstance(table.get("view"), str), f"{where} has no view; name the view that it was drawn on")
    points = _numbers(table.get("points"), (None, 2), where)
    require(len(points) >= 2, f"{where} has {len(points)} points; it needs 2 or more")
    return ProjectStroke(table["view"], points, _camera(table["camera"], where) if "camera" in table else None)


def _camera(table: Table, where: str) -> Camera:
    """A camera by its matrices, or by where it looks; the picture's size is put in when the image is read."""
    where = f"{where}: camera"
    check_names(table, _CAMERA, where)
    size = tuple(int(value) for value in _numbers(table.get("size", [1, 1]), (2,), f"{where}: size"))
    up = _numbers(table.get("up", [0.0, 0.0, 1.0]), (3,), f"{where}: up")
    orthographic = bool(table.get("orthographic", True))
    if "intrinsics" in table:
        intrinsics = _numbers(table["intrinsics"], (3, 3), f"{where}: intrinsics")
        matrix = _numbers(table.get("world_to_camera"), (4, 4), f"{where}: world_to_camera")
        return Camera(intrinsics, matrix, (size[0], size[1]), orthographic)
    if orthographic:
        direction = _numbers(table.get("direction"), (3,), f"{where}: direction")
        centre = _numbers(table.get("centre"), (3,), f"{where}: centre")
        scale = float(_numbers([table.get("pixels_per_metre")], (1,), f"{where}: pixels_per_metre")[0])
        return orthographic_camera(direction, centre, scale, (size[0], size[1]), up)
    position = _numbers(table.get("position"), (3,), f"{where}: position")
    target = _numbers(table.get("target"), (3,), f"{where}: target")
    focal = float(_numbers([table.get("focal_px")], (1,), f"{where}: focal_px")[0])
    return perspective_camera(position, target, focal, (size[0], size[1]), up)


def sized(camera: Camera, size: tuple[int, int]) -> Camera:
    """The camera for a picture of `size` (width, height): one that was given without a size looks at its middle."""
    if camera.size == size or camera.size != (1, 1):
        return camera
    intrinsics = camera.intrinsics.copy()
    if np.allclose(intrinsics[:2, 2], 0.5):
        intrinsics[:2, 2] = size[0] / 2.0, size[1] / 2.0
    return Camera(intrinsics, camera.world_to_camera, size, camera.orthographic)


def _numbers(value: Any, shape: tuple[int | None, ...], where: str) -> Float64:
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{where} must be numbers, not {value!r}") from None
    fits = array.ndim == len(shape) and all(want is None or have == want for have, want in zip(array.shape, shape))
    require(fits, f"{where} must have shape {shape} (None: any), not {array.shape}")
    require(np.isfinite(array).all(), f"{where} has values that are not finite")
    return array


def _view_lines(project: Project, view: ProjectView) -> list[str]:
    lines = [f"name = {_text(view.name)}"]
    for name in ("image", "mask"):
        if getattr(view, name):
            project.path(getattr(view, name))
            lines.append(f"{name} = {_text(getattr(view, name))}")
    if view.landmarks:
        lines += ["[view.landmarks]", *[f"{_text(name)} = {_text(list(at))}" for name, at in view.landmarks.items()]]
    if view.camera is not None:
        lines += ["[view.camera]", *_camera_lines(view.camera)]
    for scribble in view.scribbles:
        lines += ["[[view.scribble]]", f"kind = {_text(scribble.kind)}", f"width = {_text(scribble.width)}"]
        lines.append(f"points = {_text(scribble.points.tolist())}")
    return lines


def _camera_lines(camera: Camera) -> list[str]:
    return [
        f"orthographic = {_text(camera.orthographic)}",
        f"size = {_text(list(camera.size))}",
        f"intrinsics = {_text(camera.intrinsics.tolist())}",
        f"world_to_camera = {_text(camera.world_to_camera.tolist())}",
    ]


def _table_lines(values: Table) -> list[str]:
    return [f"{name} = {_value(value)}" for name, value in values.items()]


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {_value(part)}" for name, part in value.items()) + " }"
    return _text(value)


def _text(value: Any) -> str:
    """A text, number, truth value or list as TOML; JSON's forms of these are TOML's."""
    if isinstance(value, float):
        require(math.isfinite(value), f"a project cannot hold the number {value}")
    return json.dumps(list(value) if isinstance(value, tuple) else value, allow_nan=False)
