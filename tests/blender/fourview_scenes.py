"""A small project of the four-view wizard: the ball as the head, and pictures of a cap of hair on it."""

from __future__ import annotations

import bpy
import numpy as np
import scenes

SIZE = (90, 100)  # width, height: not square, so that they cannot be mixed up
VIEWS = ("front", "back", "left", "right")


def picture(number: int = 0, size: tuple[int, int] = SIZE) -> np.ndarray:
    """(H, W, 3) uint8: a brown disc of hair over skin, a mark at the upper left, noise of its own for each number."""
    width, height = size
    rng = np.random.default_rng(number)
    pixels = np.full((height, width, 3), 200, np.uint8)
    pixels += rng.integers(0, 20, pixels.shape, np.uint8)
    pixels[mask(size)] = np.array([90, 60, 30 + 20 * number], np.uint8)
    pixels[:4, :6] = (10, 200, 30)
    return pixels


def mask(size: tuple[int, int] = SIZE) -> np.ndarray:
    """(H, W) bool: the upper part of a disc."""
    width, height = size
    y, x = np.mgrid[:height, :width] + 0.5
    disc = (x - 0.5 * width) ** 2 + (y - 0.5 * height) ** 2 < (0.35 * width) ** 2
    return disc & (y < 0.6 * height)


def write_pictures(folder: object, views: tuple[str, ...] = VIEWS) -> list[str]:
    """The files of the pictures."""
    images = scenes.module("backend.io.images")
    paths = []
    for number, view in enumerate(views):
        paths.append(str(folder / f"photo_{view}.png"))
        images.write_image(paths[-1], picture(number))
    return paths


def add_photos(paths: list[str]) -> None:
    folder = paths[0].rsplit("/", 1)[0]
    names = [{"name": path.rsplit("/", 1)[1]} for path in paths]
    bpy.ops.hairloom.four_view_add_images(directory=folder, files=names, filepath=paths[0])


def project() -> bpy.types.PropertyGroup:
    return bpy.context.scene.hairloom_four_view


def start(folder: object, views: tuple[str, ...] = VIEWS, *, with_masks: bool = False) -> bpy.types.Object:
    """A head, and photos in their usual places."""
    head = scenes.sphere_head()
    bpy.context.scene.hairloom.head = head
    add_photos(write_pictures(folder, views))
    if with_masks:
        give_masks()
    bpy.context.view_layer.update()
    return head


def give_masks() -> None:
    image = scenes.module("bridge.image")
    for photo in project().photos:
        image.set_mask(photo, photo.view, mask(tuple(photo.image.size)))
