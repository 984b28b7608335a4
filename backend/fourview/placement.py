"""A first placement of the cameras from masks and a few face landmarks, and views that seem swapped (Z-2, M-30)."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

import numpy as np
from scipy.optimize import least_squares

from ..errors import require
from ..geometry.camera import STANDARD_DIRECTIONS, orthographic_camera, project, standard_camera
from ..geometry.head import HeadSurface
from ..geometry.scalp_space import fit_scalp_space
from ..types import Bools, Camera, Float64, Head
from .database import HairDatabase
from .placement_search import LEVEL, Lead, mask_height, placed_by_styles, top_row, upper_middle

Pixel = tuple[float, float]
Landmarks = Mapping[str, Pixel]

LANDMARKS = ("eye_left", "eye_right", "nose", "chin")
# fractions of a head's height, crown to chin, in adults: the tip of the nose, the eyes, half the distance of the pupils
_NOSE, _EYES, _HALF_PUPILS = 0.68, 0.5, 0.137
_THICKNESS = 0.25  # head radii: hair over the scalp where nothing tells how thick it is
_TURN_PRIOR = math.radians(8.0)  # how far a photographed head is usually off the class of its view
_PIXEL_SPREAD = 0.02  # of the face's size: how well a landmark is clicked
_SWAP_MARGIN = 0.04  # of the mask's width, that the hair must lie nearer the wrong side before a swap is offered


def head_landmarks(head: Head) -> dict[str, Float64]:
    """Where the landmarks lie on a head: name -> (3,) float64, metres, world space.

    The tip of the nose is the foremost point of the middle of the face; the others follow from the proportions of
    adult faces, dropped onto the mesh. "left" is the person's.
    """
    surface, space = HeadSurface(head), fit_scalp_space(head)
    vertices = head.vertices.astype(np.float64)
    crown = float(vertices[:, 2].max())
    middle = (np.abs(vertices[:, 0] - space.centre[0]) < 0.15 * space.radius) & (
        vertices[:, 2] > space.centre[2] - 1.2 * space.radius
    )
    middle &= vertices[:, 2] < space.centre[2] - 0.2 * space.radius
    require(middle.any(), "no face was found on the head below its skull; does it look towards -y?")
    nose = vertices[middle][np.argmin(vertices[middle, 1])]
    height = (crown - nose[2]) / _NOSE
    found = {"nose": nose}
    for name, across, down in (
        ("eye_left", _HALF_PUPILS, _EYES),
        ("eye_right", -_HALF_PUPILS, _EYES),
        ("chin", 0.0, 0.97),
    ):
        place = np.array([nose[0] + across * height, vertices[:, 1].min() - 1.0, crown - down * height])
        distance, triangle = surface.first_hits(place[None], np.array([[0.0, 1.0, 0.0]]))
        ahead = float(distance[0]) if triangle[0] >= 0 else nose[1] - place[1]
        found[name] = place + ahead * np.array([0.0, 1.0, 0.0])
    return found


def landmarks_of_face(box: tuple[float, float, float, float]) -> dict[str, Pixel]:
    """Landmarks from the square that `fields.matting.find_face` gives, of a person who looks into the camera.

    The square ends below the mouth. Where the landmarks lie in it is the mean over a photo of a person and renderings
    of three heads, of which each is up to 9 % off in size; on one and the same head with other hair the square's size
    varies by 3 %.
    """
    left, top, width, height = box
    return {
        "eye_left": (left + 0.726 * width, top + 0.385 * height),
        "eye_right": (left + 0.274 * width, top + 0.385 * height),
        "nose": (left + 0.5 * width, top + 0.665 * height),
        "chin": (left + 0.5 * width, top + 1.15 * height),
    }


def place_cameras(
    masks: Mapping[str, Bools],
    head: Head,
    landmarks: Mapping[str, Landmarks] | None = None,
    *,
    face: tuple[float, float, float, float] | None = None,
    database: HairDatabase | None = None,
    exclude: Collection[str] = (),
) -> dict[str, Camera]:
    """Orthographic cameras for the standard views, from the extents of the hair masks and clicked landmarks (Z-2).

    A view with two or more landmarks is placed by them: scale, move, and a turn of the head that is kept small. The
    others get their scale by their masks: all show the same hair, so their heights tell their scales relative to a view
    with landmarks, else each by the width of its hair beside the skull. With a database the scales, and the places of
    views without landmarks, become those at which its hairstyles look most like the masks (`placement_search`). Rough
    on purpose: the user fine-tunes.

    Parameters
    ----------
    masks : name of a standard view -> (H, W) bool, true on hair.
    landmarks : name of a view -> name of a landmark (`LANDMARKS`) -> (x, y), pixels.
    face : of the front view as `fields.matting.find_face` gives it; used where less than two landmarks are given.
    exclude : names of hairstyles of the database that are not compared.

    Raises
    ------
    InputError : a name that is no standard view, an empty mask, a landmark that is not known.
    """
    landmarks = {name: dict(marks) for name, marks in (landmarks or {}).items()}
    by_face = "front" in masks and face is not None and len(landmarks.get("front", {})) < 2
    if by_face and face is not None:
        landmarks["front"] = {**landmarks_of_face(face), **landmarks.get("front", {})}
    for name, mask in masks.items():
        require(
            name in STANDARD_DIRECTIONS, f"view '{name}' has no class; take one of {', '.join(STANDARD_DIRECTIONS)}"
        )
        require(mask.any(), f"the mask of view '{name}' is empty; mark where its hair is")
    places = head_landmarks(head)
    placed = {
        name: _by_landmarks(name, masks[name].shape, landmarks[name], places)
        for name in masks
        if len(landmarks.get(name, {})) >= 2
    }
    scales = _scales(masks, placed, head)
    first = {name: placed.get(name) or _by_mask(name, masks[name], scales[name], head, masks, placed) for name in masks}
    level = {name: mask for name, mask in masks.items() if name in LEVEL}
    if database is None or not level or not set(database.names) - set(exclude):
        return first
    exact = [name for name in placed if not (by_face and name == "front")]
    lead = next((name for name in [*exact, *placed, "back", "left", *level] if name in level), "")
    compared = {name: mask for name, mask in level.items() if name == lead or name not in exact}
    return first | _by_styles(compared, head, first, lead, placed, lead in exact, landmarks, database, exclude)


def find_swapped(masks: Mapping[str, Bools]) -> list[str]:
    """Views that seem to be swapped or mirrored, one line each with what to do; [] where nothing is suspicious.

    In a side view the hair hangs behind the face, so the lower half of its mask lies further back than the upper half;
    and only the front view has a face in its middle.
    """
    remarks = []
    lean = {name: _lean(masks[name]) for name in ("left", "right") if name in masks}
    # seen from the person's left the back of the head is at the right of the picture
    wrong = [name for name, value in lean.items() if (value if name == "left" else -value) < -_SWAP_MARGIN]
    if len(wrong) == 2:
        remarks.append("left and right seem to be swapped: the hair of both hangs where the face should be; swap them")
    elif wrong and len(lean) == 1:
        other = "right" if wrong[0] == "left" else "left"
        remarks.append(f"view '{wrong[0]}' seems to be mirrored, or to be the {other} view; change its class")
    elif wrong:
        remarks.append(f"view '{wrong[0]}' seems to be mirrored: its hair hangs where the face should be; flip it")
    if "front" in masks and "back" in masks and _hole(masks["back"]) > _hole(masks["front"]) + 0.08:
        remarks.append("front and back seem to be swapped: the face shows in the back view; swap them")
    return remarks


def _by_landmarks(name: str, shape: tuple[int, ...], clicked: Landmarks, places: Mapping[str, Float64]) -> Camera:
    """The camera of the view's class, turned a little, that takes the head's landmarks to the clicked pixels."""
    for landmark in clicked:
        require(landmark in places, f"'{landmark}' is no landmark; take one of {', '.join(LANDMARKS)}")
    targets = np.array([clicked[landmark] for landmark in clicked], np.float64)
    points = np.array([places[landmark] for landmark in clicked])
    spread = max(float(np.ptp(targets, axis=0).max()), 1.0)
    start = standard_camera(name, points.mean(axis=0), 1.0, (shape[1], shape[0]))
    flat = project(start, points)[:, :2]
    size = max(float(np.ptp(flat, axis=0).max()), 1e-9)

    def camera(values: Float64) -> Camera:
        yaw, pitch, log_scale, x, y = values
        return turned_camera(name, points.mean(axis=0), yaw, pitch, spread / size * math.exp(log_scale), (x, y), shape)

    def misfit(values: Float64) -> Float64:
        off = (project(camera(values), points)[:, :2] - targets) / (_PIXEL_SPREAD * spread)
        return np.concatenate([off.ravel(), values[:2] / _TURN_PRIOR])

    middle = targets.mean(axis=0)
    found = least_squares(misfit, np.array([0.0, 0.0, 0.0, middle[0], middle[1]]), x_scale=[0.1, 0.1, 0.1, 10.0, 10.0])
    return camera(found.x)


def turned_camera(
    name: str, centre: Float64, yaw: float, pitch: float, scale: float, pixel: Pixel, shape: tuple[int, ...]
) -> Camera:
    """The standard camera turned about the vertical and then up or down, with `centre` at a pixel of the picture."""
    ahead = np.array(STANDARD_DIRECTIONS[name])
    if name == "top":
        return _shifted(standard_camera(name, centre, scale, (shape[1], shape[0])), centre, pixel)
    turned = np.array([
        ahead[0] * math.cos(yaw) - ahead[1] * math.sin(yaw), ahead[0] * math.sin(yaw) + ahead[1] * math.cos(yaw), 0.0
    ])  # fmt: skip
    direction = turned * math.cos(pitch) + np.array([0.0, 0.0, math.sin(pitch)])
    return _shifted(orthographic_camera(direction, centre, scale, (shape[1], shape[0])), centre, pixel)


def _shifted(camera: Camera, point: Float64, pixel: Pixel) -> Camera:
    """The camera moved in its picture's plane so that a world point lies on a pixel."""
    off = (np.asarray(pixel) - project(camera, point)[:2]) / camera.intrinsics[0, 0]
    matrix = camera.world_to_camera.copy()
    matrix[:2, 3] += off
    return Camera(camera.intrinsics, matrix, camera.size, camera.orthographic)


def _by_styles(
    masks: Mapping[str, Bools], head: Head, first: Mapping[str, Camera], lead: str, placed: Mapping[str, Camera],
    is_exact: bool, landmarks: Mapping[str, Landmarks], database: HairDatabase, exclude: Collection[str],
) -> dict[str, Camera]:  # fmt: skip
    """The cameras of level views at the scales and places of `placement_search`; one placed exactly stays."""
    middle, camera = fit_scalp_space(head).centre, first[lead]
    pivot = np.mean(list(landmarks[lead].values()), axis=0) if lead in placed else None
    start = Lead(lead, float(camera.intrinsics[0, 0]), project(camera, middle)[:2], pivot, is_exact)
    found = placed_by_styles(masks, head, start, database, exclude)
    return {name: _shifted(_scaled(first[name], scale), middle, (float(pixel[0]), float(pixel[1])))
            for name, (scale, pixel) in found.items() if not (name == lead and is_exact)}  # fmt: skip


def _scaled(camera: Camera, scale: float) -> Camera:
    intrinsics = camera.intrinsics.copy()
    intrinsics[0, 0] = intrinsics[1, 1] = scale
    return Camera(intrinsics, camera.world_to_camera, camera.size, camera.orthographic)


def _scales(masks: Mapping[str, Bools], placed: Mapping[str, Camera], head: Head) -> dict[str, float]:
    """Pixels a metre of every view."""
    heights = {name: mask_height(mask) for name, mask in masks.items()}
    known = {name: camera.intrinsics[0, 0] / heights[name] for name, camera in placed.items() if name != "top"}
    if not known:
        known = {name: _scale_by_width(name, mask, head) / heights[name] for name, mask in masks.items()}
    per_height = float(np.median(list(known.values())))
    scales = {name: per_height * height for name, height in heights.items()}
    if "top" in masks:
        scales["top"] = _scale_by_width("top", masks["top"], head)
    return scales


def _scale_by_width(name: str, mask: Bools, head: Head) -> float:
    """Pixels a metre if the hair's upper part is as wide as the skull with hair of the usual thickness around it."""
    space = fit_scalp_space(head)
    skull = head.vertices[head.vertices[:, 2] > space.centre[2]]
    size = np.ptp(skull, axis=0).astype(np.float64)
    width = (size[1] if name in ("left", "right") else size[0]) + 2.0 * _THICKNESS * space.radius
    rows = np.flatnonzero(mask.any(axis=1))
    columns = [np.flatnonzero(row) for row in mask[rows]]
    widths = np.maximum.accumulate([float(np.ptp(line) + 1) for line in columns])
    if name == "top":
        return float(widths[-1] / width)
    depth = np.arange(1, len(rows) + 1)
    # down to the skull's middle: the scale at which the picture's part of that depth is as wide as it should be
    deep = (1.0 + _THICKNESS) * space.radius
    scales = widths / width
    reached = depth >= deep * scales
    return float(scales[np.argmax(reached)] if reached.any() else scales[-1])


def _by_mask(
    name: str, mask: Bools, scale: float, head: Head, masks: Mapping[str, Bools], placed: Mapping[str, Camera]
) -> Camera:
    """A standard camera at a known scale: hair's top on the hair's top, upper part in the skull's middle."""
    space = fit_scalp_space(head)
    skull = head.vertices[head.vertices[:, 2] > space.centre[2]].astype(np.float64)
    middle = 0.5 * (skull.min(axis=0) + skull.max(axis=0))
    if name == "top":
        pixel = upper_middle(mask, mask.shape[0]), upper_middle(mask.T, mask.shape[1])
        return _shifted(standard_camera(name, middle, scale, (mask.shape[1], mask.shape[0])), middle, pixel)
    summit = _summit(head, masks, placed)
    point = np.array([middle[0], middle[1], summit])
    pixel = upper_middle(mask, space.radius * scale), top_row(mask)
    return _shifted(standard_camera(name, point, scale, (mask.shape[1], mask.shape[0])), point, pixel)


def _summit(head: Head, masks: Mapping[str, Bools], placed: Mapping[str, Camera]) -> float:
    """Height of the hair's top, metres: as a placed view shows it, else the usual thickness over the head."""
    space = fit_scalp_space(head)
    for name, camera in placed.items():
        if name != "top":
            pixel = project(camera, space.centre)
            return float(space.centre[2] + (pixel[1] - top_row(masks[name])) / camera.intrinsics[0, 0])
    return float(head.vertices[:, 2].max() + _THICKNESS * space.radius)


def _lean(mask: Bools) -> float:
    """How far the lower half's middle lies right of the upper half's, in widths of the mask."""
    rows, columns = np.nonzero(mask)
    lower = rows > 0.5 * (rows.min() + rows.max())
    if not lower.any() or lower.all():
        return 0.0
    return float((columns[lower].mean() - columns[~lower].mean()) / (np.ptp(columns) + 1))


def _hole(mask: Bools) -> float:
    """Share of what lies between the hair at the left and at the right of each row that is not hair: a face is."""
    rows = mask[mask.any(axis=1)]
    first = rows.argmax(axis=1)
    last = rows.shape[1] - rows[:, ::-1].argmax(axis=1)
    return float(1.0 - rows.sum() / (last - first).sum())
