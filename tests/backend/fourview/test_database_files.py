"""Hairstyles packed into bytes and files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hairloom.errors import FileError, InputError
from hairloom.fourview.database_files import (
    QUANTUM,
    Hairstyle,
    fingerprint,
    order_of_roots,
    pack_strands,
    read_hairstyles,
    unpack_strands,
    write_hairstyles,
)
from hairloom.fourview.database_masks import COLUMNS, ROWS, view_grid
from hairloom.types import Float32


def some_strands(count: int = 50, n_points: int = 9, seed: int = 0) -> Float32:
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(count, 1, 3))
    roots /= np.linalg.norm(roots, axis=2, keepdims=True)
    return (roots + np.cumsum(rng.normal(0.0, 0.2, (count, n_points, 3)), axis=1)).astype(np.float32)


def entry(name: str, seed: int = 0) -> Hairstyle:
    points = some_strands(seed=seed)
    masks = np.random.default_rng(seed).integers(0, 256, (len(view_grid()), ROWS * COLUMNS // 8), np.uint8)
    return Hairstyle(name, ("long", "a tag"), "family", 50, 9, pack_strands(points), masks)


def test_strands_come_back_to_half_a_quantum() -> None:
    points = some_strands()
    back = unpack_strands(pack_strands(points), *points.shape[:2])
    # float32 of numbers below 10: rounding is far below a quantum
    assert np.abs(back - points[order_of_roots(points[:, 0])]).max() <= 0.5 * QUANTUM + 1e-5


def test_strands_of_two_points_and_single_strands() -> None:
    for shape in ((1, 2), (3, 2), (1, 7)):
        points = some_strands(*shape)
        back = unpack_strands(pack_strands(points), *shape)
        assert np.abs(back - points[order_of_roots(points[:, 0])]).max() <= 0.5 * QUANTUM + 1e-5


def test_wild_strands_do_not_overflow() -> None:
    points = np.random.default_rng(0).uniform(-49.9, 49.9, (20, 6, 3)).astype(np.float32)
    points[:2, ::2], points[:2, 1::2] = 49.9, -49.9  # the largest second differences there are
    back = unpack_strands(pack_strands(points), 20, 6)
    assert np.abs(back - points[order_of_roots(points[:, 0])]).max() <= 0.5 * QUANTUM + 1e-4


def test_smooth_strands_take_less_than_a_byte_a_coordinate() -> None:
    points = np.cumsum(np.full((500, 12, 3), 0.1, np.float32), axis=1) + some_strands(500, 1)
    assert len(pack_strands(points)) < 0.5 * points.size


def test_hair_out_of_reach_is_refused() -> None:
    with pytest.raises(InputError, match="check its units"):
        pack_strands(some_strands() * 1000)


def test_files_come_back_and_are_the_same_bytes(tmp_path: Path) -> None:
    styles = [entry("one"), entry("two", 1)]
    for name in ("a.npz", "b.npz"):
        write_hairstyles(tmp_path / name, styles, "made of this")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    back = read_hairstyles(tmp_path / "a.npz")
    assert [style.name for style in back] == ["one", "two"]
    for old, new in zip(styles, back):
        assert (old.packed, old.tags, old.family) == (new.packed, new.tags, new.family)
        assert np.array_equal(old.masks, new.masks)
        assert np.array_equal(old.points(), new.points())
    assert len(read_hairstyles(tmp_path / "a.npz", "made of this")) == 2
    assert read_hairstyles(tmp_path / "a.npz", "of something else") == ()


def test_damaged_files_say_so(tmp_path: Path) -> None:
    path = tmp_path / "styles.npz"
    write_hairstyles(path, [entry("one")])
    whole = path.read_bytes()
    for broken in (whole[: len(whole) // 2], whole.replace(b"\x00v\x00\x00\x00e\x00\x00\x00r\x00\x00\x00s", b"x" * 14)):
        path.write_bytes(broken)
        if broken != whole:
            with pytest.raises(FileError):
                read_hairstyles(path)
    with pytest.raises(FileError, match="no such file"):
        read_hairstyles(tmp_path / "nowhere.npz")
    with pytest.raises(InputError, match="damaged"):
        unpack_strands(pack_strands(some_strands())[:-9], 50, 9)
    with pytest.raises(InputError, match="damaged"):
        unpack_strands(pack_strands(some_strands()), 49, 9)


def test_a_hairstyle_needs_a_name_and_strands() -> None:
    good = entry("one")
    with pytest.raises(InputError, match="give it a name"):
        Hairstyle(" ", (), "", 50, 9, good.packed, good.masks)
    with pytest.raises(InputError, match="0 strands"):
        Hairstyle("none", (), "", 0, 9, good.packed, good.masks)


def test_fingerprints_tell_contents_and_their_borders_apart() -> None:
    assert fingerprint(b"ab", b"c") != fingerprint(b"a", b"bc") != fingerprint(b"abc")
    assert fingerprint(b"ab", b"c") == fingerprint(b"ab", b"c")
