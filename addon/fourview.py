"""The four-view wizard as operators and panels see it: its photos, what each step needs, and which results are stale.

A result lies in a file named by a key of all that it was made from, beside the .blend; the key and the parts of what
it was made from are kept in the scene, so that undo leads back to the result before, and a changed input is named.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix

from . import lazy, scene
from .backend.errors import FileError
from .fourview_settings import STEPS, VIEWS, FourViewPhoto, FourViewProject, FourViewStage

MAX_PHOTOS = 8
COLLECTION = "Four Views"
# the steps that a job does, each from the one before
STAGES = ("shape", "texture", "directions", "strands")
# places of the face for the automatic placement, and how they are asked for
LANDMARKS = (
    ("eye_left", "the person's left eye (at the right in the photo)"),
    ("eye_right", "the person's right eye (at the left in the photo)"),
    ("nose", "the tip of the nose"),
    ("chin", "the lowest point of the chin"),
)
NONE, DONE, STALE, LOST = "NONE", "DONE", "STALE", "LOST"
_SUFFIX = ".npz"
_middles: dict[str, tuple[float, float, float]] = {}


@dataclass(frozen=True, slots=True)
class State:
    """How a stage's result stands: NONE, DONE, STALE or LOST, and a sentence for the panel."""

    kind: str
    text: str = ""


def project(context: bpy.types.Context) -> FourViewProject:
    return context.scene.hairloom_four_view


# --- photos ------------------------------------------------------------------------------------------------------


def names(found: FourViewProject) -> list[str]:
    """A name of its own for each photo: its view's, with a number from the second of a view on."""
    counts: dict[str, int] = {}
    result = []
    for photo in found.photos:
        counts[photo.view] = counts.get(photo.view, 0) + 1
        result.append(photo.view if counts[photo.view] == 1 else f"{photo.view}_{counts[photo.view]}")
    return result


def named_photos(context: bpy.types.Context) -> dict[str, FourViewPhoto]:
    found = project(context)
    return dict(zip(names(found), found.photos))


def active_photo(context: bpy.types.Context) -> FourViewPhoto | None:
    found = project(context)
    return found.photos[found.active] if found.active < len(found.photos) else None


def active_name(context: bpy.types.Context) -> str:
    found = project(context)
    return names(found)[found.active] if found.active < len(found.photos) else ""


def photo_of_plane(context: bpy.types.Context, plane: bpy.types.Object | None) -> FourViewPhoto | None:
    """The photo that an object shows."""
    return next((p for p in project(context).photos if plane is not None and p.plane == plane), None)


def matrix_of(obj: bpy.types.Object) -> Matrix:
    """Where an object is in world space; `matrix_world` is void for a hidden one after a file was opened."""
    if obj.parent is None:
        return obj.matrix_basis.copy()
    return matrix_of(obj.parent) @ obj.matrix_parent_inverse @ obj.matrix_basis


def guess_view(file_name: str, taken: set[str]) -> str:
    """The view that a file's name tells, or the first that is free."""
    stem = Path(file_name).stem.lower()
    known = [view for view, _, _ in VIEWS if view != "other"]
    for view in known:
        if view in stem and view not in taken:
            return view
    return next((view for view in known if view not in taken), "other")


def collection(context: bpy.types.Context) -> bpy.types.Collection:
    """Where the wizard's objects are."""
    found = bpy.data.collections.get(COLLECTION)
    if found is None:
        found = bpy.data.collections.new(COLLECTION)
    if found.name not in context.scene.collection.children:
        context.scene.collection.children.link(found)
    return found


def show_photos(context: bpy.types.Context) -> None:
    """Show the planes of the photos as the step and the settings say."""
    found = project(context)
    is_in_front = found.step in {"SEGMENT"}
    for index, photo in enumerate(found.photos):
        plane = photo.plane
        if plane is None:
            continue
        is_shown = found.shown == "ALL" or (found.shown == "ACTIVE" and index == found.active)
        if plane.hide_viewport == is_shown:
            plane.hide_viewport = not is_shown
        plane.empty_image_depth = "FRONT" if is_in_front else "BACK"
        plane.use_empty_image_alpha = found.opacity < 1.0
        plane.color[3] = found.opacity


def look_through(context: bpy.types.Context) -> None:
    """Turn the 3D view that an operator was called in to the camera of the active photo."""
    photo, region_3d, region = active_photo(context), context.region_data, context.region
    rotation, place, longest = lazy.bridge("camera").looking_through(photo)
    region_3d.view_rotation, region_3d.view_location = rotation, place
    region_3d.view_perspective = "PERSP" if photo.is_perspective else "ORTHO"
    # Blender shows 72 mm / lens of the distance along the region's longer side
    narrow = min(region.width, region.height) / max(region.width, region.height, 1)
    region_3d.view_distance = 1.2 * longest * context.space_data.lens / 72.0 / max(narrow, 0.2)


def pixels_per_photo_pixel(context: bpy.types.Context) -> float:
    """How large a pixel of the active photo is on the screen, in the 3D view that is drawn."""
    photo, view = active_photo(context), context.region_data
    if photo is None or photo.plane is None or photo.image is None or view is None:
        return 1.0
    size = photo.plane.empty_display_size * matrix_of(photo.plane).col[0].to_3d().length
    metres = size / max(*photo.image.size, 1)
    per_metre = 0.5 * context.region.height * view.window_matrix[1][1]
    return metres * per_metre / (max(view.view_distance, 1e-6) if view.is_perspective else 1.0)


def window_region(context: bpy.types.Context, event: bpy.types.Event) -> bpy.types.Region | None:
    """The 3D view's region under the mouse, where no sidebar covers it."""
    area = context.area
    if area is None or area.type != "VIEW_3D":
        return None

    def is_inside(region: bpy.types.Region) -> bool:
        across, up = event.mouse_x - region.x, event.mouse_y - region.y
        return 0 <= across < region.width and 0 <= up < region.height

    under = [region for region in area.regions if is_inside(region)]
    return under[0] if [region.type for region in under] == ["WINDOW"] else None


def swap(a: FourViewPhoto, b: FourViewPhoto) -> None:
    """Let two photos change places: pictures, masks and marks; views and planes stay where they are."""
    for name in ("image", "mask", "image_stamp", "mask_stamp", "mask_by_hand", "scribbles", "landmarks"):
        first, second = getattr(a, name), getattr(b, name)
        setattr(a, name, second)
        setattr(b, name, first)
    for photo in (a, b):
        if photo.plane is not None:
            photo.plane.data = photo.image


class LandmarkClicks:
    """The places of the face that are asked for one after another, and what was clicked for them."""

    def __init__(self, size: tuple[int, int]) -> None:
        self._size = size
        self._clicked: list[tuple[float, float] | None] = []

    @property
    def is_done(self) -> bool:
        return len(self._clicked) == len(LANDMARKS)

    @property
    def asked(self) -> str:
        """What to click next, in words."""
        return LANDMARKS[len(self._clicked)][1]

    def click(self, pixel: tuple[float, float] | None) -> bool:
        """Take a click; one beside the photo does not count."""
        if pixel is None or not (0 <= pixel[0] < self._size[0] and 0 <= pixel[1] < self._size[1]):
            return False
        self._clicked.append((round(pixel[0], 2), round(pixel[1], 2)))
        return True

    def skip(self) -> None:
        """The place is not seen in the photo."""
        self._clicked.append(None)

    def back(self) -> None:
        del self._clicked[-1:]

    def text(self) -> str:
        """JSON: pixels by name; '' when nothing was clicked."""
        found = {name: pixel for (name, _), pixel in zip(LANDMARKS, self._clicked) if pixel is not None}
        return json.dumps(found) if found else ""


# --- what results are made from ----------------------------------------------------------------------------------


def inputs_of(context: bpy.types.Context, stage: str) -> dict[str, str]:
    """What the stage is made from, by the user's words for it; equal texts mean equal inputs. Cheap: panels call it."""
    found, settings = project(context), scene.settings(context).four_view
    parts: dict[str, str] = {}
    for name, photo in named_photos(context).items():
        parts[f"the photo '{name}'"] = photo.image_stamp
        parts[f"the mask of '{name}'"] = photo.mask_stamp
        parts[f"the camera of '{name}'"] = camera_text(photo)
    parts["the head"] = _head_text(context)
    before = STAGES.index(stage) - 1
    if before >= 0:
        previous = STAGES[before]
        parts[f"the {previous}"] = getattr(found, previous).key
    if stage == "directions":
        parts["the strokes"] = found.strokes
    parts[f"the settings of the {stage}"] = json.dumps(settings.of_stage(stage), sort_keys=True)
    return parts


def camera_text(photo: FourViewPhoto) -> str:
    plane = photo.plane
    if plane is None:
        return ""
    numbers = [value for row in matrix_of(plane) for value in row]
    numbers += [plane.empty_display_size, *plane.empty_image_offset]
    numbers += [photo.distance] if photo.is_perspective else []
    return " ".join(f"{number:.5f}" for number in numbers)


def _head_text(context: bpy.types.Context) -> str:
    head = head_of(context)
    if head is None:
        return ""
    numbers = " ".join(f"{value:.5f}" for row in matrix_of(head) for value in row)
    return f"{head.name} {len(head.data.vertices)} {scene.settings(context).scalp_group} {numbers}"


def key_of(parts: dict[str, str]) -> str:
    return hashlib.blake2b(json.dumps(parts, sort_keys=True).encode(), digest_size=8).hexdigest()


def state(context: bpy.types.Context, stage: str) -> State:
    """How the stage's result stands, and why it is stale."""
    record: FourViewStage = getattr(project(context), stage)
    if not record.key:
        return State(NONE)
    if not result_path(stage, record.key).is_file():
        return State(LOST, f"The file of the {stage} is gone; run this step again")
    now, then = inputs_of(context, stage), json.loads(record.inputs)
    changed = [part for part in [*then, *(p for p in now if p not in then)] if now.get(part) != then.get(part)]
    if changed:
        more = f" and {len(changed) - 1} more" if len(changed) > 1 else ""
        return State(STALE, f"Out of date: {changed[0]} changed{more} since")
    before = STAGES.index(stage) - 1
    if before >= 0:
        earlier = state(context, STAGES[before])
        if earlier.kind == STALE:
            return State(STALE, f"Out of date, as the {STAGES[before]} is")
    return State(DONE)


# --- why an operator cannot run ----------------------------------------------------------------------------------


def head_of(context: bpy.types.Context) -> bpy.types.Object | None:
    return scene.head_for(context, None)


def head_middle(context: bpy.types.Context) -> tuple[float, float, float] | None:
    """The middle of the head, world space; gizmos ask at every redraw, so it is found once for a head's place."""
    key, head = _head_text(context), head_of(context)
    if head is None:
        return None
    if key not in _middles:
        _middles.clear()
        _middles[key] = tuple(lazy.bridge("camera").head_box(head)[0].tolist())
    return _middles[key]


def why_no_photo(context: bpy.types.Context) -> str:
    return "" if active_photo(context) is not None else "Add photos first, in step Images"


def why_no_more_photos(context: bpy.types.Context) -> str:
    full = len(project(context).photos) >= MAX_PHOTOS
    return scene.why_no_object_mode(context) or (f"There are {MAX_PHOTOS} photos, which is the most" if full else "")


def why_no_segment(context: bpy.types.Context) -> str:
    return (
        scene.why_busy(context) or scene.why_no_object_mode(context) or why_no_photo(context) or why_no_image(context)
    )


def why_no_image(context: bpy.types.Context) -> str:
    for name, photo in named_photos(context).items():
        if photo.image is None or photo.plane is None or photo.plane.name not in context.view_layer.objects:
            return f"The photo '{name}' was deleted from the file: remove it from the list, or undo"
    return ""


def why_no_border(context: bpy.types.Context) -> str:
    """Why the border of the active photo's mask cannot be dragged."""
    missing = scene.why_no_object_mode(context) or why_no_photo(context) or why_no_image(context)
    if not missing and active_photo(context).mask is None:
        return "The photo has no mask yet: press Guess Masks or Segment, or load one"
    return missing


def why_no_masks(context: bpy.types.Context) -> str:
    missing = why_no_segment(context)
    without = [name for name, photo in named_photos(context).items() if photo.mask is None]
    if not missing and without:
        return f"The photo '{without[0]}' has no mask yet: go to step Segment"
    return missing


def why_no_cameras(context: bpy.types.Context) -> str:
    missing = why_no_masks(context)
    if not missing and head_of(context) is None:
        return "Choose a head in the Head panel: add one, or set up a mesh of yours"
    return missing


def why_no_stage(context: bpy.types.Context, stage: str) -> str:
    """Why a stage cannot run."""
    missing = why_no_cameras(context)
    if missing or stage == STAGES[0]:
        return missing
    before = STAGES[STAGES.index(stage) - 1]
    earlier = state(context, before)
    if earlier.kind == NONE:
        return f"There is no {before} yet: go back one step"
    if earlier.kind in {STALE, LOST}:
        return f"{before.capitalize()}: {earlier.text[0].lower()}{earlier.text[1:]}; go back one step"
    return ""


def why_no_strokes(context: bpy.types.Context) -> str:
    """Why no stroke can be drawn along the hair."""
    missing = scene.why_no_object_mode(context) or why_no_photo(context)
    if not missing and visible_shape(context) is None:
        return "There is no shape yet to draw on: go back to step Shape"
    return missing


def visible_shape(context: bpy.types.Context) -> bpy.types.Object | None:
    """The shape's mesh where it is in the scene."""
    found = project(context).open_object
    return found if found is not None and found.name in context.view_layer.objects else None


def is_stage_step(step: str) -> bool:
    return step.lower() in STAGES


def step_number(step: str) -> int:
    return [item[0] for item in STEPS].index(step)


def step_name(number: int) -> str:
    """The step of a number, the nearest there is."""
    return STEPS[min(max(number, 0), len(STEPS) - 1)][0]


# --- results -----------------------------------------------------------------------------------------------------


def results_folder(blend: str | None = None) -> Path:
    """Where results lie: in the chosen folder, or in Blender's temporary one in a file that was never saved."""
    blend = bpy.data.filepath if blend is None else blend
    chosen = bpy.context.scene.hairloom.four_view.cache_folder
    if chosen.startswith("//") and not blend:
        return Path(bpy.app.tempdir, "hairloom", "four_view")
    base = os.path.join(os.path.dirname(blend), chosen[2:]) if chosen.startswith("//") else bpy.path.abspath(chosen)
    return Path(os.path.abspath(base), bpy.path.clean_name(Path(blend).stem or "unsaved"), "four_view")


def result_path(stage: str, key: str) -> Path:
    return results_folder() / f"{stage}-{key}{_SUFFIX}"


def write_result(context: bpy.types.Context, stage: str, values: dict[str, Any]) -> None:
    """Write a stage's result, of the inputs as they are now; the scene does not know it yet.

    Raises
    ------
    FileError : the file cannot be written.
    """
    path = result_path(stage, key_of(inputs_of(context, stage)))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"cannot make the folder {path.parent}: {error}; choose another Results folder") from error
    lazy.backend("io.bundle").write_bundle(path, values)


def remember_result(context: bpy.types.Context, stage: str, report: str) -> None:
    """Let the written result be the stage's; files of older results but the last one are deleted."""
    record: FourViewStage = getattr(project(context), stage)
    parts, before = inputs_of(context, stage), record.key
    record.key, record.inputs, record.report = key_of(parts), json.dumps(parts), report
    # undo leads back to the one before
    kept = {result_path(stage, record.key), result_path(stage, before)}
    for old in results_folder().glob(f"{stage}-*{_SUFFIX}"):
        if old not in kept:
            old.unlink(missing_ok=True)


def read_result(context: bpy.types.Context, stage: str) -> dict[str, Any]:
    """A stage's result.

    Raises
    ------
    FileError : the file is gone or damaged.
    """
    return lazy.backend("io.bundle").read_bundle(result_path(stage, getattr(project(context), stage).key))


@bpy.app.handlers.persistent
def _before_save(filepath: str, *_: object) -> None:
    """Take the results along to where the file is saved."""
    if not filepath:
        return
    target = results_folder(filepath)
    for stage in STAGES:
        for found in bpy.data.scenes:
            record = getattr(found.hairloom_four_view, stage)
            source, goal = result_path(stage, record.key), target / f"{stage}-{record.key}{_SUFFIX}"
            if record.key and source.is_file() and not goal.exists():
                try:
                    target.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(source, goal)
                except OSError as error:
                    sys.stderr.write(f"Hairloom: cannot copy {source} to {goal}: {error}; the step must be run again\n")


def register() -> None:
    bpy.app.handlers.save_pre.append(_before_save)


def unregister() -> None:
    bpy.app.handlers.save_pre.remove(_before_save)
