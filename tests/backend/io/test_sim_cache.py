"""io.sim_cache: what is written is played, killed workers and full disks leave good caches, damage is said."""

from __future__ import annotations

import errno
import json
import os

import numpy as np
import pytest
from hairloom.errors import FileError, InputError
from hairloom.io.sim_cache import HEADER, CacheReader, CacheWriter, delete_cache, is_cache

N_POINTS = 40


def frames(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, N_POINTS, 3)).astype(np.float32)


def write(folder, points: np.ndarray, **options) -> None:
    options = {"fps": 24.0, "frame_start": 5, "fingerprint": "abc", "meta": {"guides": 7}} | options
    with CacheWriter.create(folder, N_POINTS, **options) as writer:
        for frame in points:
            writer.append(frame)


def test_frames_come_back_bit_by_bit(tmp_path):
    points = frames(4)
    write(tmp_path / "new" / "cache", points, n_planned=10)
    reader = CacheReader(tmp_path / "new" / "cache")
    assert (reader.n_frames, reader.n_points, reader.fps, reader.frame_start, reader.frame_end) == (4, 40, 24.0, 5, 8)
    assert (reader.fingerprint, reader.meta, reader.header.n_planned) == ("abc", {"guides": 7}, 10)
    for i, frame in enumerate(points):
        assert np.array_equal(reader.frame(5 + i), frame)
        assert reader.frame(5 + i).flags.writeable is False


def test_between_frames_is_the_straight_line_into_the_buffer(tmp_path):
    points = frames(3)
    write(tmp_path, points)
    reader, out = CacheReader(tmp_path), np.full((N_POINTS, 3), np.nan, np.float32)
    assert reader.frame(6.25, out) is out
    # one rounding each of a difference, a product and a sum of values of about 3
    assert np.allclose(out, 0.75 * points[1] + 0.25 * points[2], rtol=0, atol=2e-6)
    assert np.array_equal(reader.frame(6, out), points[1])


@pytest.mark.parametrize(("number", "index"), [(-100, 0), (4.99, 0), (7, 2), (7.5, 2), (1e9, 2)])
def test_outside_is_the_nearest_frame(tmp_path, number, index):
    points = frames(3)
    write(tmp_path, points)
    assert np.array_equal(CacheReader(tmp_path).frame(number), points[index])


def test_a_reader_sees_frames_that_come_later(tmp_path):
    points = frames(3)
    writer = CacheWriter.create(tmp_path, N_POINTS, fps=24)
    reader = CacheReader(tmp_path)
    assert reader.n_frames == 0
    with pytest.raises(FileError, match="no whole frame yet"):
        reader.frame(1)
    for i, frame in enumerate(points):
        writer.append(frame)
        assert np.array_equal(reader.frame(1 + i), frame)
    writer.close()


def test_a_new_simulation_leaves_what_is_being_played(tmp_path):
    old, new = frames(3), frames(1, seed=1)
    write(tmp_path, old)
    reader = CacheReader(tmp_path)
    playing = reader.frame(5)
    write(tmp_path, new)
    assert np.array_equal(playing, old[0])  # its memory is still there
    with pytest.raises(FileError, match="no such file"):
        reader.frame(5)
    assert np.array_equal(CacheReader(tmp_path).frame(5), new[0])
    assert sorted(os.listdir(tmp_path)) == [HEADER, "positions-2.f32"]


def test_killed_within_a_frame(tmp_path):
    write(tmp_path, frames(3))
    file = tmp_path / "positions-1.f32"
    file.write_bytes(file.read_bytes()[:-7])
    reader = CacheReader(tmp_path)
    assert (reader.n_frames, reader.frame_end) == (2, 6)
    assert np.array_equal(reader.frame(100), frames(3)[1])


def test_resume_goes_on_after_the_state(tmp_path):
    points = frames(5)
    with CacheWriter.create(tmp_path, N_POINTS, fps=24, fingerprint="abc") as writer:
        writer.append(points[0])
        writer.append(points[1])
        writer.write_state({"rates": points[1, :2], "time": 0.5})
        writer.append(points[2])
        writer._stream.write(b"half a frame")
    with pytest.raises(FileError, match="another groom or with other settings"):
        CacheWriter.resume(tmp_path, "other")
    with CacheWriter.resume(tmp_path, "abc") as writer:
        state = writer.read_state()
        assert (writer.n_frames, state["time"]) == (2, 0.5)
        assert np.array_equal(state["rates"], points[1, :2])
        for frame in points[2:]:
            writer.append(frame)
    reader = CacheReader(tmp_path)
    assert reader.n_frames == 5
    assert all(np.array_equal(reader.frame(1 + i), frame) for i, frame in enumerate(points))


def test_resume_wants_a_state_that_fits(tmp_path):
    write(tmp_path, frames(2))
    with pytest.raises(FileError, match=r"no state to resume from; simulate again from the start"):
        CacheWriter.resume(tmp_path, "abc")
    with CacheWriter.create(tmp_path, N_POINTS, fps=24, fingerprint="abc") as writer:
        writer.append(frames(1)[0])
        writer.write_state({})
    (tmp_path / "positions-2.f32").write_bytes(b"")
    with pytest.raises(FileError, match=r"of frame 1, but the cache has 0"):
        CacheWriter.resume(tmp_path, "abc")
    (tmp_path / "state.npz").write_bytes(b"PK nonsense")
    with pytest.raises(FileError, match=r"state\.npz"):
        CacheWriter.resume(tmp_path, "abc")


class FullDisk:
    """Takes `room` bytes, then has none left, as a disk does."""

    def __init__(self, stream, room: int) -> None:
        self.stream, self.room = stream, room

    def write(self, data) -> int:
        if not self.room:
            raise OSError(errno.ENOSPC, "No space left on device")
        taken = self.stream.write(data[: self.room])
        self.room -= taken
        return taken

    def close(self) -> None:
        self.stream.close()


def test_a_full_disk_keeps_the_whole_frames(tmp_path):
    points = frames(4)
    with CacheWriter.create(tmp_path, N_POINTS, fps=24) as writer:
        writer._stream = FullDisk(writer._stream, 2 * points[0].nbytes + 100)
        writer.append(points[0])
        writer.append(points[1])
        with pytest.raises(FileError, match=r"the disk is full; the 2 frames so far can be played\. Make room"):
            writer.append(points[2])
    reader = CacheReader(tmp_path)
    assert reader.n_frames == 2
    assert np.array_equal(reader.frame(2), points[1])


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.zeros((3, 3), np.float32), "has shape"),
        (np.zeros((N_POINTS, 3)), "must be float32"),
        (np.full((N_POINTS, 3), np.nan, np.float32), "NaN or infinite"),
    ],
)
def test_frames_that_do_not_fit(tmp_path, points, words):
    writer = CacheWriter.create(tmp_path, N_POINTS, fps=24)
    with pytest.raises(InputError, match=words):
        writer.append(points)
    writer.close()
    assert CacheReader(tmp_path).n_frames == 0


@pytest.mark.parametrize(
    ("n_points", "options"),
    [
        (0, {}),
        (-4, {}),
        (2**31, {}),
        (5, {"fps": 0.0}),
        (5, {"fps": float("nan")}),
        (5, {"frame_start": 2**40}),
        (5, {"meta": {"x": float("nan")}}),
        (5, {"meta": {"x": object()}}),
    ],
)
def test_a_cache_that_cannot_be_leaves_the_old_one(tmp_path, n_points, options):
    write(tmp_path, frames(2))
    before = sorted(os.listdir(tmp_path))
    with pytest.raises(InputError):
        CacheWriter.create(tmp_path, n_points, **{"fps": 24.0, **options})
    assert sorted(os.listdir(tmp_path)) == before
    assert CacheReader(tmp_path).n_frames == 2


@pytest.mark.parametrize(
    "change",
    [
        {"format": "other"},
        {"version": 2},
        {"n_points": -1},
        {"n_points": 1e3},
        {"n_points": 10**30},
        {"n_points": True},
        {"fps": "fast"},
        {"fps": 0},
        {"positions": "../../secret.f32"},
        {"positions": "/etc/passwd"},
        {"positions": 4},
        {"frame_start": 10**9},
        {"meta": []},
        {"fingerprint": None},
        {"unknown": 1},
        {"n_points": None},
    ],
)
def test_hostile_headers(tmp_path, change):
    write(tmp_path, frames(1))
    path = tmp_path / HEADER
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(FileError) as caught:
        CacheReader(tmp_path)
    assert "header.json" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "simulate again" in str(caught.value)


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[1]", b"\xff\xfe", b"[" * 100_000, b'{"format": "hairloom-simulation"}']
)
def test_damaged_headers(tmp_path, content):
    (tmp_path / HEADER).write_bytes(content)
    with pytest.raises(FileError, match=r"header\.json"):
        CacheReader(tmp_path)


def test_missing_things(tmp_path):
    with pytest.raises(FileError, match=r"there is no simulation cache in .*nowhere.*; simulate again"):
        CacheReader(tmp_path / "nowhere")
    with pytest.raises(FileError, match="no simulation cache"):
        CacheReader("a\0b")
    write(tmp_path, frames(1))
    reader = CacheReader(tmp_path)
    (tmp_path / "positions-1.f32").unlink()
    with pytest.raises(FileError, match="no such file"):
        reader.frame(5)
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(FileError, match="choose another folder"):
        CacheWriter.create(tmp_path / "file" / "cache", N_POINTS, fps=24)


def test_delete_takes_its_own_files_only(tmp_path):
    write(tmp_path / "a", frames(1))
    (tmp_path / "a" / "notes.txt").write_text("mine")
    delete_cache(tmp_path / "a")
    assert os.listdir(tmp_path / "a") == ["notes.txt"]
    write(tmp_path / "b", frames(1))
    assert is_cache(tmp_path / "b")
    delete_cache(tmp_path / "b")
    delete_cache(tmp_path / "b")
    assert not (tmp_path / "b").exists()
    assert not is_cache(tmp_path / "b")


def test_the_same_frames_give_the_same_bytes(tmp_path):
    write(tmp_path / "a", frames(2))
    write(tmp_path / "b", frames(2))
    assert all(
        (tmp_path / "a" / n).read_bytes() == (tmp_path / "b" / n).read_bytes() for n in os.listdir(tmp_path / "a")
    )
