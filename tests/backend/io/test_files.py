"""Atomic writing: the new file or the old one, and nothing beside it."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
from hairloom.errors import FileError, HairloomError
from hairloom.io.files import array_at, atomic_write, read_file


def test_the_file_appears_whole(tmp_path):
    path = tmp_path / "new.bin"
    with atomic_write(path) as stream:
        stream.write(b"abc")
        assert not path.exists()
    assert path.read_bytes() == b"abc" and os.listdir(tmp_path) == ["new.bin"]


@pytest.mark.parametrize("error", [ValueError("bad"), KeyboardInterrupt(), HairloomError("no")])
def test_an_error_inside_leaves_the_old_file(tmp_path, error):
    path = tmp_path / "old.bin"
    path.write_bytes(b"old")
    with pytest.raises(type(error)), atomic_write(path) as stream:
        stream.write(b"new")
        raise error
    assert path.read_bytes() == b"old" and os.listdir(tmp_path) == ["old.bin"]


def test_a_full_disk_is_one_line(tmp_path):
    path = tmp_path / "old.bin"
    path.write_bytes(b"old")
    with pytest.raises(FileError, match="the disk is full") as caught, atomic_write(path) as stream:
        stream.write(b"new")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)
    assert path.read_bytes() == b"old" and os.listdir(tmp_path) == ["old.bin"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs the full device of Linux")
def test_a_really_full_device(tmp_path, monkeypatch):
    """The error that a full disk gives when the buffer is flushed, at the end of the block."""
    full = Path("/dev/full").open("wb")  # noqa: SIM115  atomic_write closes it
    monkeypatch.setattr("hairloom.io.files._open_beside", lambda target: (tmp_path / "gone", full))
    with pytest.raises(FileError, match="the disk is full"), atomic_write(tmp_path / "new.bin") as stream:
        stream.write(b"abc")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("name", ["missing/new.bin", ".", "file/new.bin", "x" * 300, "nul\0byte"])
def test_impossible_places_are_file_errors(tmp_path, name):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(FileError, match=r"cannot .*write"), atomic_write(f"{tmp_path}/{name}") as stream:
        stream.write(b"abc")
    assert os.listdir(tmp_path) == ["file"]


@pytest.mark.skipif(os.name == "nt" or os.getuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_without_permission(tmp_path):
    tmp_path.chmod(0o555)
    with pytest.raises(FileError, match="no permission"), atomic_write(tmp_path / "new.bin") as stream:
        stream.write(b"abc")
    tmp_path.chmod(0o755)


def test_a_write_protected_file_or_folder_is_not_replaced(tmp_path, monkeypatch):
    path = tmp_path / "old.bin"
    path.write_bytes(b"old")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(FileError, match="no permission"), atomic_write(path) as stream:
        stream.write(b"new")
    assert path.read_bytes() == b"old"


def test_a_link_keeps_pointing_to_its_target(tmp_path):
    target, link = tmp_path / "target.bin", tmp_path / "link.bin"
    target.write_bytes(b"old")
    link.symlink_to(target)
    with atomic_write(link) as stream:
        stream.write(b"new")
    assert link.is_symlink() and target.read_bytes() == b"new"


def test_leftovers_of_dead_processes_do_not_stop_a_write(tmp_path):
    path = tmp_path / "new.bin"
    (tmp_path / f".new.bin.{os.getpid()}-0.part").write_bytes(b"left over")
    with atomic_write(path) as stream:
        stream.write(b"abc")
    assert path.read_bytes() == b"abc"


@pytest.mark.parametrize("name", ["missing.hair", "", "nul\0byte"])
def test_what_cannot_be_read_is_a_file_error(tmp_path, name):
    with pytest.raises(FileError, match="cannot read"):
        read_file(tmp_path / name)


def test_arrays_are_bounded_by_the_data():
    data = bytes(range(16))
    assert array_at(Path("a"), data, 8, "<u4", 2, "two").tolist() == [0x0B0A0908, 0x0F0E0D0C]
    for offset, count in ((8, 3), (-4, 1), (0, -1), (0, 10**18)):
        with pytest.raises(FileError, match=rf"a at byte {offset}: two need"):
            array_at(Path("a"), data, offset, "<u4", count, "two")
