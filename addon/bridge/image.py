"""Photos and masks as Blender's images, and scribbles as pixels.

Blender's first row of pixels is the lowest, ours the uppermost.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import bpy
import cv2
import numpy as np

from ..backend.errors import FileError, require
from ..backend.fields import matting
from ..backend.io import images
from ..fourview_strokes import HAIR, read

# the method works on less; a longer side costs memory and time in every step and shows nothing more
LONGEST_SIDE = 2000
_SHIFT = 6  # fixed-point bits of OpenCV's drawing


def read_photo(path: Path) -> np.ndarray:
    """(H, W, 3) uint8 sRGB: a photo from a file; a huge one is scaled down.

    Raises
    ------
    FileError : missing, damaged or no picture. InputError : too large to be read.
    """
    pixels = images.read_image(path)
    longest = max(pixels.shape[:2])
    require(min(pixels.shape[:2]) >= 16, f"{path.name} has {pixels.shape[1]} x {pixels.shape[0]} pixels: too few")
    if longest > LONGEST_SIDE:
        scale = LONGEST_SIDE / longest
        size = (max(round(pixels.shape[1] * scale), 1), max(round(pixels.shape[0] * scale), 1))
        pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    return pixels


def load_mask(path: Path, size: tuple[int, int]) -> np.ndarray:
    """(H, W) bool from a file; one of another size must at least be of the photo's proportions.

    Raises
    ------
    FileError : missing, damaged or no picture. InputError : other proportions, or nothing marked.
    """
    mask = images.read_mask(path)
    require(mask.any(), f"{path.name} marks nothing as hair: hair must be white, or opaque")
    height, width = mask.shape
    if (width, height) == size:
        return mask
    same = abs(width * size[1] - height * size[0]) <= max(width, height, *size)
    require(
        same,
        f"{path.name} has {width} x {height} pixels, the photo {size[0]} x {size[1]}: take a mask of this photo",
    )
    return cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_AREA) > 0


def new_image(name: str, pixels: np.ndarray) -> bpy.types.Image:
    """A packed image of (H, W, 3) uint8 sRGB pixels or an (H, W) bool mask."""
    height, width = pixels.shape[:2]
    if pixels.dtype == np.bool_:
        pixels = np.where(pixels, np.uint8(255), np.uint8(0))[..., None].repeat(3, axis=2)
    image = bpy.data.images.new(name, width, height, alpha=False)
    values = np.ones((height, width, 4), np.float32)
    values[..., :3] = pixels[::-1].astype(np.float32) / np.float32(255)
    image.pixels.foreach_set(values.ravel())
    image.update()
    # the packed file is what is saved and what undo leads back to
    image.pack()
    return image


def read_pixels(image: bpy.types.Image) -> np.ndarray:
    """(H, W, 3) uint8, sRGB.

    Raises
    ------
    FileError : an image without pixels.
    """
    width, height = image.size
    if not width * height or image.channels < 3:
        raise FileError(f"the image '{image.name}' has no pixels: add the photo anew")
    values = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(values)
    rows = values.reshape(height, width, image.channels)[::-1, :, :3]
    return np.ascontiguousarray(np.rint(np.clip(rows, 0.0, 1.0) * 255.0).astype(np.uint8))


def read_mask(image: bpy.types.Image) -> np.ndarray:
    """(H, W) bool, true where there is hair."""
    return read_pixels(image).max(axis=2) > 127


def stamp(pixels: np.ndarray) -> str:
    """Equal for equal pixels."""
    digest = hashlib.blake2b(np.ascontiguousarray(pixels).data.cast("B"), digest_size=8)
    digest.update(str(pixels.shape).encode())
    return digest.hexdigest()


def set_mask(photo: Any, name: str, mask: np.ndarray, *, by_hand: bool = False) -> None:
    """Give a photo another mask; the old image goes when nothing else shows it. by_hand : the user's own work.

    Raises
    ------
    InputError : an empty mask.
    """
    require(mask.any(), f"the mask of '{name}' is empty; mark where its hair is")
    old = photo.mask
    # a new image, not new pixels: undo brings images back, not their pixels
    photo.mask = new_image(f"{name} mask", mask)
    photo.mask_stamp, photo.mask_by_hand = stamp(mask), by_hand
    if old is not None and old.users == 0:
        bpy.data.images.remove(old)


def take_stock(photo: Any) -> None:
    """Note whether the photo or its mask was painted on in the Image Editor."""
    photo.image_stamp = stamp(read_pixels(photo.image))
    if photo.mask is not None:
        photo.mask_stamp = stamp(read_mask(photo.mask))


def drawn(scribbles: str, kind: str, size: tuple[int, int]) -> np.ndarray:
    """(H, W) bool: the pixels under the scribbles of a kind; `size` is (width, height)."""
    canvas = np.zeros((size[1], size[0]), np.uint8)
    for scribble in read(scribbles):
        if scribble["kind"] == kind:
            _draw_path(canvas, scribble["points"], scribble["width"], 1)
    return canvas.astype(np.bool_)


def painted(mask: np.ndarray, kind: str, width: float, points: list[tuple[float, float]]) -> np.ndarray:
    """The mask (H, W) after a stroke of the brush that adds hair, or takes it away."""
    canvas = mask.astype(np.uint8)
    _draw_path(canvas, points, width, 1 if kind == HAIR else 0)
    return canvas.astype(np.bool_)


def paint_mask(photo: Any, name: str, kind: str, width: float, points: list[tuple[float, float]]) -> None:
    """Paint a stroke on a photo's mask; a photo without a mask gets one.

    Raises
    ------
    InputError : nothing would be left of the mask.
    """
    size = tuple(photo.image.size)
    before = read_mask(photo.mask) if photo.mask is not None else np.zeros((size[1], size[0]), np.bool_)
    set_mask(photo, name, painted(before, kind, width, points), by_hand=True)


def read_border(photo: Any) -> list[np.ndarray]:
    """The borders of a photo's mask as polygons (n, 2), pixels, that give exactly this mask again."""
    return matting.outline(read_mask(photo.mask), 0.0)


def moved_border(
    border: list[np.ndarray], start: tuple[float, float], end: tuple[float, float], radius: float
) -> list[np.ndarray]:
    """The borders when they were grabbed at `start` and pulled to `end`, pixels; see `matting.moved_outline`."""
    return matting.moved_outline(border, start, (end[0] - start[0], end[1] - start[1]), radius)


def drag_border(
    photo: Any, name: str, start: tuple[float, float], end: tuple[float, float], radius: float
) -> bool:  # fmt: skip
    """Pull the border of a photo's mask from `start` to `end`; did that change the mask?

    Raises
    ------
    InputError : no border near `start`, or nothing would be left of the mask.
    """
    moved = matting.mask_from_outline(moved_border(read_border(photo), start, end, radius), tuple(photo.image.size))
    if np.array_equal(moved, read_mask(photo.mask)):
        return False
    set_mask(photo, name, moved, by_hand=True)
    return True


def mirror(photo: Any, name: str) -> None:
    """Turn a photo left to right, and all that is marked on it."""
    pixels, old = np.ascontiguousarray(read_pixels(photo.image)[:, ::-1]), photo.image
    width = pixels.shape[1]
    if photo.mask is not None:
        turned = np.ascontiguousarray(read_mask(photo.mask)[:, ::-1])
        set_mask(photo, name, turned, by_hand=photo.mask_by_hand)
    photo.image = new_image(old.name, pixels)
    photo.image_stamp = stamp(pixels)
    photo.plane.data = photo.image
    if old.users == 0:
        bpy.data.images.remove(old)
    photo.scribbles = mirrored_scribbles(photo.scribbles, width)
    if photo.landmarks:
        photo.landmarks = json.dumps({key: [width - x, y] for key, (x, y) in json.loads(photo.landmarks).items()})


def mirrored_scribbles(text: str, width: float) -> str:
    turned = [{**one, "points": [[width - x, y] for x, y in one["points"]]} for one in read(text)]
    return json.dumps(turned) if turned else ""


def _draw_path(canvas: np.ndarray, points: list[tuple[float, float]], width: float, value: int) -> None:
    # OpenCV's pixel centres are at whole numbers
    path = np.round((np.asarray(points, np.float64) - 0.5) * (1 << _SHIFT)).astype(np.int32)
    thickness = max(round(width), 1)
    if len(path) > 1:
        cv2.polylines(canvas, [path.reshape(-1, 1, 2)], False, value, thickness, cv2.LINE_8, _SHIFT)
    for end in (path[0], path[-1]):
        radius = max(round(0.5 * width * (1 << _SHIFT)), 1)
        cv2.circle(canvas, tuple(end.tolist()), radius, value, -1, cv2.LINE_8, _SHIFT)


def outline_segments(mask: np.ndarray) -> np.ndarray:
    """(n, 2, 2) float64, pixels: the lines of the mask's borders."""
    found = [np.stack([polygon, np.roll(polygon, -1, axis=0)], axis=1) for polygon in matting.outline(mask)]
    return np.concatenate(found) if found else np.zeros((0, 2, 2))


def segment_inputs(photo: Any, *, guess: bool) -> dict[str, Any]:
    """The inputs of the segmentation of one photo."""
    size = tuple(photo.image.size)
    return {
        "image": read_pixels(photo.image),
        "hair": drawn(photo.scribbles, HAIR, size),
        "background": drawn(photo.scribbles, "background", size),
        "guess": read_mask(photo.mask) if photo.mask is not None and not guess else None,
    }
