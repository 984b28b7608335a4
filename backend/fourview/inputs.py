"""From a project's files to what the method sees: photos read, masks cut out, cameras placed (Z-1, Z-2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError, require
from ..fields.matting import find_face, first_guess, segment
from ..geometry.head import default_head, read_head
from ..geometry.scalp_guess import guess_scalp
from ..io.images import read_image, read_mask
from ..io.units import Units
from ..progress import NO_PROGRESS, Progress
from ..types import Bools, Camera, Head
from .database import open_database
from .placement import find_swapped, place_cameras
from .project import Project, ProjectView, paint_scribbles, sized
from .views import DirectionStroke, UInt8, View

_LEAST_HAIR = 0.001  # of the picture: a smaller mask is a mistake
_MAX_PIXELS = 50_000_000


@dataclass(frozen=True, slots=True)
class Inputs:
    """Views in the project's order, the strokes on them, the head that hair grows on, and remarks for the user."""

    views: tuple[View, ...]
    strokes: tuple[DirectionStroke, ...]
    head: Head
    remarks: tuple[str, ...]


def read_inputs(project: Project, head: Head | None = None, progress: Progress = NO_PROGRESS) -> Inputs:
    """Read the photos of a project; masks and cameras that it does not name are found automatically.

    Parameters
    ----------
    head : instead of the project's.

    Raises
    ------
    FileError : a file cannot be read. InputError : pictures and masks that do not fit, an empty mask, strokes off the
        hair; the line names the view.
    """
    head = head or project_head(project)
    images: dict[str, UInt8] = {}
    masks: dict[str, Bools] = {}
    for number, view in enumerate(project.views):
        progress(number / len(project.views), f"Reading view '{view.name}'")
        images[view.name] = read_image(project.path(view.image), max_pixels=_MAX_PIXELS)
        masks[view.name] = find_mask(project, view, images[view.name])
    cameras, remarks = _cameras(project, images, masks, head)
    views = tuple(View(name, images[name], masks[name], cameras[name]) for name in images)
    strokes = tuple(_strokes(project, {view.name: view for view in views}))
    return Inputs(views, strokes, head, (*remarks, *find_swapped(_levels(masks))))


def project_head(project: Project) -> Head:
    """The head that the project names, with the scalp that it names or a guessed one; or Hairloom's own.

    Raises
    ------
    FileError : the file cannot be read, or has no such group. InputError : no scalp is named, and it is no head.
    """
    if project.head is None:
        return default_head()
    units = Units.parse(project.head_units) if project.head_units else None
    head = read_head(project.path(project.head), units, scalp=project.scalp)
    return guess_scalp(head) if project.scalp is None else head


def find_mask(project: Project, view: ProjectView, image: UInt8) -> Bools:
    """The hair mask of a view: its file, or cut out by its scribbles, or guessed.

    Raises
    ------
    InputError : a mask of another shape than the image, or without hair. FileError : the file cannot be read.
    """
    height, width = image.shape[:2]
    if view.mask is not None:
        mask = read_mask(project.path(view.mask), max_pixels=_MAX_PIXELS)
        require(
            mask.shape == (height, width),
            f"the mask of view '{view.name}' has {mask.shape[1]} x {mask.shape[0]} pixels, its image {width} x {height}"
            "; export it at the image's size",
        )
    else:
        mask = cut_out(image, view)
    share = float(mask.mean())
    require(share > _LEAST_HAIR, f"the mask of view '{view.name}' has almost no hair ({share:.2%}); mark its hair")
    require(share < 0.98, f"the mask of view '{view.name}' covers the whole picture; mark its background")
    return mask


def cut_out(image: UInt8, view: ProjectView) -> Bools:
    """The mask by a view's scribbles, and without any the first guess (Z-1)."""
    size = (image.shape[1], image.shape[0])
    guess = first_guess(image)
    if not view.scribbles:
        return guess
    hair, background = (paint_scribbles(view.scribbles, kind, size) for kind in ("hair", "background"))
    return segment(image, hair, background, guess)


def _cameras(
    project: Project, images: dict[str, UInt8], masks: dict[str, Bools], head: Head
) -> tuple[dict[str, Camera], list[str]]:
    cameras, remarks = {}, []
    missing = {}
    landmarks = {}
    for view in project.views:
        size = (images[view.name].shape[1], images[view.name].shape[0])
        if view.camera is not None:
            camera = sized(view.camera, size)
            require(
                camera.size == size,
                f"the camera of view '{view.name}' is for {camera.size} pixels, its image has {size}",
            )
            cameras[view.name] = camera
            continue
        missing[view.name] = masks[view.name]
        landmarks[view.name] = dict(view.landmarks)
    if missing:
        face = find_face(images["front"]) if "front" in missing else None
        cameras |= place_cameras(missing, head, landmarks, face=face, database=open_database())
        remarks.append(f"cameras placed automatically: {', '.join(missing)}; check them")
    return cameras, remarks


def _levels(masks: dict[str, Bools]) -> dict[str, Bools]:
    return {name: mask for name, mask in masks.items() if name in ("front", "back", "left", "right")}


def _strokes(project: Project, views: dict[str, View]) -> list[DirectionStroke]:
    found = []
    for number, stroke in enumerate(project.strokes, 1):
        camera = stroke.camera or (views[stroke.view].camera if stroke.view in views else None)
        if camera is None:
            raise InputError(f"stroke {number} is on view '{stroke.view}', which has no photo; give it a camera")
        if stroke.view in views and stroke.camera is None:
            mask = views[stroke.view].mask
            x = np.clip(stroke.points[:, 0].astype(int), 0, mask.shape[1] - 1)
            y = np.clip(stroke.points[:, 1].astype(int), 0, mask.shape[0] - 1)
            require(mask[y, x].any(), f"stroke {number} on view '{stroke.view}' is off the hair; draw it on the hair")
        found.append(DirectionStroke(camera, stroke.points))
    return found
