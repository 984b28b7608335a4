"""Pictures: round trips, EXIF's turn, masks by brightness or opacity, and files that lie about their size."""

import struct
import zlib

import cv2
import numpy as np
import pytest
from hairloom.errors import FileError, InputError
from hairloom.io.images import read_image, read_mask, write_image

RNG = np.random.default_rng(1)
PICTURE = RNG.integers(0, 255, (20, 30, 3), dtype=np.uint8)


def test_png_comes_back_to_the_bit(tmp_path):
    write_image(tmp_path / "a.png", PICTURE)
    assert np.array_equal(read_image(tmp_path / "a.png"), PICTURE)


def test_first_channel_is_red(tmp_path):
    red = np.zeros((4, 4, 3), np.uint8)
    red[..., 0] = 255
    write_image(tmp_path / "a.png", red)
    assert cv2.imread(str(tmp_path / "a.png"))[0, 0].tolist() == [0, 0, 255]  # OpenCV has blue first


@pytest.mark.parametrize("suffix", [".jpg", ".bmp"])
def test_other_formats(tmp_path, suffix):
    smooth = cv2.GaussianBlur(PICTURE, (0, 0), 3)
    cv2.imwrite(str(tmp_path / f"a{suffix}"), smooth[..., ::-1])
    read = read_image(tmp_path / f"a{suffix}")
    assert read.shape == smooth.shape
    assert np.abs(read.astype(int) - smooth).max() < 20  # JPEG's loss on a smooth picture


def test_masks_by_brightness_and_by_opacity(tmp_path):
    mask = RNG.random((9, 7)) > 0.5
    write_image(tmp_path / "m.png", mask)
    assert np.array_equal(read_mask(tmp_path / "m.png"), mask)
    cut = np.dstack([np.full((9, 7, 3), 80, np.uint8), np.where(mask, 255, 0).astype(np.uint8)])
    cv2.imwrite(str(tmp_path / "cut.png"), cut)
    assert np.array_equal(read_mask(tmp_path / "cut.png"), mask)
    opaque = np.dstack([np.where(mask, 200, 20).astype(np.uint8)] * 3 + [np.full((9, 7), 255, np.uint8)])
    cv2.imwrite(str(tmp_path / "opaque.png"), opaque)
    assert np.array_equal(read_mask(tmp_path / "opaque.png"), mask)


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def test_a_bomb_is_refused_before_memory_is_taken(tmp_path):
    header = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    bomb = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")
    (tmp_path / "bomb.png").write_bytes(bomb)
    with pytest.raises(InputError, match="60000 x 60000"):
        read_image(tmp_path / "bomb.png")


def test_the_size_of_a_jpeg_is_known_from_its_header(tmp_path):
    cv2.imwrite(str(tmp_path / "a.jpg"), np.zeros((300, 500, 3), np.uint8))
    with pytest.raises(InputError, match="500 x 300"):
        read_image(tmp_path / "a.jpg", max_pixels=100_000)


@pytest.mark.parametrize(
    "data",
    [b"", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff\xe0\x00", b"BM1234", b"GIF89a", b"\xff\xd8" + b"\xff\xe0\x00\x02" * 5],
)
def test_what_is_no_picture_is_one_line(tmp_path, data):
    (tmp_path / "a.png").write_bytes(data)
    with pytest.raises(FileError, match=r"a\.png"):
        read_image(tmp_path / "a.png")


def test_a_cut_off_picture(tmp_path):
    write_image(tmp_path / "a.png", PICTURE)
    whole = (tmp_path / "a.png").read_bytes()
    (tmp_path / "a.png").write_bytes(whole[:40])
    with pytest.raises(FileError, match=r"a\.png"):
        read_image(tmp_path / "a.png")


def test_missing_file(tmp_path):
    with pytest.raises(FileError, match="no such file"):
        read_image(tmp_path / "none.png")


def test_only_pictures_are_written(tmp_path):
    with pytest.raises(InputError, match="uint8"):
        write_image(tmp_path / "a.png", np.zeros((3, 3, 4), np.uint8))
    assert not (tmp_path / "a.png").exists()
