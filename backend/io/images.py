"""Pictures: PNG, JPEG and BMP files as arrays, read with checked sizes, and PNG written."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import FileError, InputError, require
from ..types import Bools
from .files import atomic_write, damaged, read_file

UInt8 = NDArray[np.uint8]

MAX_PIXELS = 100_000_000  # 300 MB as RGB
_JPEG_SIZES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # start-of-frame markers; the three are tables


def read_image(path: Path, *, max_pixels: int = MAX_PIXELS) -> UInt8:
    """(H, W, 3) uint8, sRGB; turned upright where a camera said so, transparency dropped.

    Raises
    ------
    FileError : missing, damaged or no picture. InputError : more than `max_pixels`.
    """
    picture = _decode(path, cv2.IMREAD_COLOR, max_pixels)
    return np.ascontiguousarray(picture[:, :, ::-1])


def read_mask(path: Path, *, max_pixels: int = MAX_PIXELS) -> Bools:
    """(H, W) bool, true where a grey picture is brighter than half.

    A picture with transparency that is not opaque everywhere is a mask by its opacity.

    Raises
    ------
    FileError : missing, damaged or no picture. InputError : more than `max_pixels`.
    """
    picture = _decode(path, cv2.IMREAD_UNCHANGED, max_pixels)
    half = np.iinfo(picture.dtype).max // 2 if picture.dtype.kind == "u" else 0.5
    if picture.ndim == 3 and picture.shape[2] == 4 and (picture[:, :, 3] <= half).any():
        return np.asarray(picture[:, :, 3] > half)
    return np.asarray((picture[:, :, :3].max(axis=2) if picture.ndim == 3 else picture) > half)


def write_image(path: Path, image: NDArray[np.uint8] | Bools) -> None:
    """Write a PNG: (H, W, 3) uint8 sRGB, (H, W) uint8 grey, or (H, W) bool as black and white.

    Raises
    ------
    InputError : another array. FileError : the file cannot be written.
    """
    if image.dtype == np.bool_:
        image = np.where(image, 255, 0).astype(np.uint8)
    fits = image.dtype == np.uint8 and (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)) and image.size > 0
    require(fits, f"a picture must be (H, W) or (H, W, 3) uint8, not {image.shape} {image.dtype}")
    good, data = cv2.imencode(".png", image if image.ndim == 2 else image[:, :, ::-1])
    require(good, f"a picture of {image.shape} cannot be written as PNG")
    with atomic_write(path) as stream:
        stream.write(data.tobytes())


def _decode(path: Path, flag: int, max_pixels: int) -> NDArray[np.uint8]:
    data = read_file(path)
    width, height = _stated_size(path, data)
    if width * height > max_pixels:
        raise InputError(f"{path} has {width} x {height} pixels; scale it down to {max_pixels / 1e6:g} megapixels")
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), flag)
    except cv2.error as error:
        raise damaged(path, f"no valid picture ({error.err})") from error
    if picture is None:
        raise damaged(path, "no valid picture; save it anew as PNG or JPEG")
    return np.asarray(picture)


def _stated_size(path: Path, data: bytes) -> tuple[int, int]:
    """Width and height as the header says, before any memory is taken for the pixels."""
    try:
        if data[:8] == b"\x89PNG\r\n\x1a\n":
            width, height = struct.unpack_from(">II", data, 16)
        elif data[:2] == b"BM":
            width, height = (abs(size) for size in struct.unpack_from("<ii", data, 18))
        elif data[:2] == b"\xff\xd8":
            width, height = _jpeg_size(data)
        else:
            raise FileError(f"cannot read {path}: it is no PNG, JPEG or BMP picture; save it as one")
    except (struct.error, IndexError) as error:
        raise damaged(path, "its header is cut off") from error
    if width <= 0 or height <= 0:
        raise damaged(path, f"it says that it has {width} x {height} pixels")
    return width, height


def _jpeg_size(data: bytes) -> tuple[int, int]:
    place = 2
    while True:
        while data[place] != 0xFF or data[place + 1] in (0x00, 0xFF):
            place += 1
        marker = data[place + 1]
        if marker in _JPEG_SIZES:
            height, width = struct.unpack_from(">HH", data, place + 5)
            return int(width), int(height)
        if marker == 0x01 or 0xD0 <= marker <= 0xD9:
            place += 2
            continue
        (length,) = struct.unpack_from(">H", data, place + 2)
        place += 2 + length
