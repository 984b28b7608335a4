"""The cache of a simulated groom: a folder that a worker fills frame by frame while Blender plays it.

    header.json        what the cache is: `CacheHeader`, written atomically
    positions-N.f32    little-endian float32, P x 3 a frame, frame after frame and nothing else
    state.npz          a bundle from which the simulation goes on

Whole frames are counted from the size of the positions, so a worker that is killed, or a full disk, leaves a good
cache that is shorter. A new simulation starts a new positions file: a file that is being played is never cut short
under its reader, which would kill the process that has it in memory.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from ..errors import FileError, InputError, require
from ..types import Float32
from .bundle import read_bundle, write_bundle
from .files import atomic_write, damaged, read_file, reason_of

FORMAT, VERSION = "hairloom-simulation", 1
HEADER, STATE = "header.json", "state.npz"
_POSITIONS = re.compile(r"positions-(\d{1,9})\.f32")
_MAX_HEADER_BYTES = 2**24
_MAX_POINTS = 2**31 - 1  # StrandSet.offsets are int32
_MAX_FRAME = 2**20  # Blender's own limit of frame numbers
_REMEDY = "simulate again"

PathLike = str | os.PathLike[str]


@dataclass(frozen=True, slots=True)
class CacheHeader:
    """What a cache says of itself.

    n_points : P, points a frame. fps : frames a second. frame_start : number of the first frame.
    n_planned : frames that the simulation was asked for; 0 where it was not said.
    fingerprint : of what was simulated; another one means that the cache is stale.
    positions : name of the file of positions. meta : whatever JSON holds, of the simulation's.
    """

    n_points: int
    fps: float
    frame_start: int = 1
    n_planned: int = 0
    fingerprint: str = ""
    positions: str = "positions-1.f32"
    meta: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("n_points", "frame_start", "n_planned"):
            value = getattr(self, name)
            require(isinstance(value, int) and not isinstance(value, bool), f"{name} is {value!r:.40}, no whole number")
        require(0 < self.n_points <= _MAX_POINTS, f"n_points is {self.n_points}; it must be 1 to {_MAX_POINTS}")
        in_range = abs(self.frame_start) <= _MAX_FRAME and 0 <= self.n_planned <= _MAX_FRAME
        require(in_range, f"frames {self.frame_start} + {self.n_planned} lie outside what Blender can play")
        require(isinstance(self.fps, int | float) and math.isfinite(self.fps) and self.fps > 0, "fps must be above 0")
        require(isinstance(self.fingerprint, str), "the fingerprint must be text")
        require(isinstance(self.meta, Mapping), "meta must be a dict")
        named = isinstance(self.positions, str) and _POSITIONS.fullmatch(self.positions)
        require(named, f"{self.positions!r:.60} is no name of a file of positions")

    @property
    def frame_bytes(self) -> int:
        return 12 * self.n_points


def read_header(folder: PathLike) -> CacheHeader:
    """The header of the cache in `folder`.

    Raises
    ------
    FileError : no cache there, or its header is damaged.
    """
    path = Path(folder) / HEADER
    try:
        size = path.stat().st_size
    except (OSError, ValueError) as error:
        raise FileError(f"there is no simulation cache in {os.fspath(folder)!r}; {_REMEDY}") from error
    if size > _MAX_HEADER_BYTES:
        raise damaged(path, f"it has {size} bytes, too many for a header; {_REMEDY}")
    try:
        content = json.loads(read_file(path).decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise damaged(path, f"it is no JSON ({error}); {_REMEDY}") from error
    if not isinstance(content, dict) or content.pop("format", "") != FORMAT:
        raise damaged(path, f"it is no header of a {FORMAT}; {_REMEDY}")
    version = content.pop("version", None)
    if version != VERSION:
        raise damaged(path, f"it is of version {version!r:.20}, not {VERSION}; {_REMEDY}")
    try:
        return CacheHeader(**content)
    except (TypeError, InputError) as error:
        raise damaged(path, f"{error}; {_REMEDY}") from error


def _write_header(folder: Path, header: CacheHeader) -> None:
    try:
        text = json.dumps({"format": FORMAT, "version": VERSION} | asdict(header), indent=1, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(f"meta cannot be written as JSON: {error}; use numbers, text, lists and dicts") from error
    with atomic_write(folder / HEADER) as stream:
        stream.write(text.encode())


class CacheWriter:
    """Appends frames to a cache; made by `create` or `resume`, a context manager that closes it."""

    def __init__(self, folder: Path, header: CacheHeader, stream: BinaryIO, n_frames: int) -> None:
        self.folder = folder
        self.header = header
        self.n_frames = n_frames
        self._stream = stream

    @classmethod
    def create(
        cls,
        folder: PathLike,
        n_points: int,
        *,
        fps: float,
        frame_start: int = 1,
        fingerprint: str = "",
        n_planned: int = 0,
        meta: Mapping[str, Any] | None = None,
    ) -> Self:
        """Start an empty cache in `folder`, which is made where it is missing; a cache that was there is replaced.

        Raises
        ------
        InputError : a value out of range (see CacheHeader). FileError : the folder cannot be written.
        """
        path = Path(folder)
        try:
            path.mkdir(parents=True, exist_ok=True)
            numbers = [int(match[1]) for name in os.listdir(path) if (match := _POSITIONS.fullmatch(name))]
            name = f"positions-{max(numbers, default=0) % 999_999_999 + 1}.f32"
            header = CacheHeader(n_points, fps, frame_start, n_planned, fingerprint, name, dict(meta or {}))
            (path / STATE).unlink(missing_ok=True)
            stream = (path / name).open("xb", buffering=0)
        except (OSError, ValueError) as error:
            why = reason_of(error) if isinstance(error, OSError) else str(error)
            raise FileError(f"cannot write a cache in {path}: {why}; choose another folder") from error
        try:
            _write_header(path, header)
        except BaseException:
            stream.close()
            (path / name).unlink(missing_ok=True)
            raise
        for number in numbers:
            with suppress(OSError):  # Windows keeps a file that is being played; the next `create` removes it
                (path / f"positions-{number}.f32").unlink()
        return cls(path, header, stream, 0)

    @classmethod
    def resume(cls, folder: PathLike, fingerprint: str) -> Self:
        """Go on with the cache in `folder` after the frames that its state covers.

        Later frames, if the worker wrote some before it was killed, stay until they are written again: the same
        simulation gives the same values.

        Raises
        ------
        FileError : no cache, damaged, without a state, or of another fingerprint (something was changed since).
        """
        header, path = read_header(folder), Path(folder)
        if header.fingerprint != fingerprint:
            raise FileError(f"{path} was simulated from another groom or with other settings; {_REMEDY} from the start")
        n_frames, _ = _read_state(path, header)
        try:
            stream = (path / header.positions).open("r+b", buffering=0)
            stream.seek(n_frames * header.frame_bytes)
        except OSError as error:
            raise FileError(f"cannot write {path / header.positions}: {reason_of(error)}; {_REMEDY}") from error
        return cls(path, header, stream, n_frames)

    def append(self, points: Float32) -> None:
        """Write the next frame: (P, 3) float32, metres, the object's space.

        Raises
        ------
        InputError : another shape or dtype, or NaN. FileError : the disk is full...; earlier frames stay playable.
        """
        shape = (self.header.n_points, 3)
        require(points.shape == shape, f"a frame of this cache has shape {shape}, not {points.shape}")
        require(points.dtype == np.float32, f"frames must be float32, not {points.dtype}")
        require(np.isfinite(points).all(), f"frame {self.n_frames} has NaN or infinite positions; use more substeps")
        left = np.ascontiguousarray(points, dtype="<f4").data.cast("B")
        try:
            while left:
                left = left[self._stream.write(left) :]
        except OSError as error:
            kept = f"the {self.n_frames} frames so far can be played"
            raise FileError(
                f"cannot write {self.folder / self.header.positions}: {reason_of(error)}; {kept}. Make room and resume"
            ) from error
        self.n_frames += 1

    def write_state(self, values: Mapping[str, Any]) -> None:
        """Keep what `resume` needs to go on after the frames written so far; replaces an earlier state.

        Raises
        ------
        InputError : a value that a bundle cannot hold. FileError : it cannot be written.
        """
        file = self.header.positions
        write_bundle(self.folder / STATE, {"n_frames": self.n_frames, "positions": file, "values": dict(values)})

    def read_state(self) -> dict[str, Any]:
        """The values of the last `write_state`.

        Raises
        ------
        FileError : there is none, or it is damaged.
        """
        return _read_state(self.folder, self.header)[1]

    def close(self) -> None:
        self._stream.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _read_state(folder: Path, header: CacheHeader) -> tuple[int, dict[str, Any]]:
    path = folder / STATE
    if not path.is_file():
        raise FileError(f"{folder} has no state to resume from; {_REMEDY} from the start")
    state = read_bundle(path)
    n_frames, values = state.get("n_frames"), state.get("values")
    if not isinstance(n_frames, int) or not isinstance(values, dict) or state.get("positions") != header.positions:
        raise damaged(path, f"it is not the state of this cache; {_REMEDY} from the start")
    n_whole = _size(folder / header.positions) // header.frame_bytes
    if not 0 <= n_frames <= n_whole:
        raise damaged(path, f"it is of frame {n_frames}, but the cache has {n_whole}; {_REMEDY} from the start")
    return n_frames, values


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError as error:
        raise FileError(f"cannot read {path}: {reason_of(error)}; {_REMEDY}") from error


class CacheReader:
    """Frames of a cache through a memory map; sees the frames that a running simulation adds.

    Raises
    ------
    FileError : no cache in the folder, or a damaged one.
    """

    def __init__(self, folder: PathLike) -> None:
        self.folder = Path(folder)
        self.header = read_header(folder)
        self._path = self.folder / self.header.positions
        self._frames: NDArray[np.float32] | None = None
        self.refresh()

    @property
    def n_points(self) -> int:
        return self.header.n_points

    @property
    def n_frames(self) -> int:
        """Whole frames at the last `refresh`."""
        return 0 if self._frames is None else len(self._frames)

    @property
    def fps(self) -> float:
        return self.header.fps

    @property
    def frame_start(self) -> int:
        return self.header.frame_start

    @property
    def frame_end(self) -> int:
        """Number of the last frame; before `frame_start` where there is none."""
        return self.header.frame_start + self.n_frames - 1

    @property
    def fingerprint(self) -> str:
        return self.header.fingerprint

    @property
    def meta(self) -> Mapping[str, Any]:
        return self.header.meta

    def refresh(self) -> None:
        """Take in frames that were added, or lost, since.

        Raises
        ------
        FileError : the positions are gone, as after a new simulation into the same folder: open it again.
        """
        n_frames = min(_size(self._path) // self.header.frame_bytes, 2 * _MAX_FRAME)
        if n_frames == self.n_frames:
            return
        self._frames = None
        if n_frames:
            try:
                self._frames = np.memmap(self._path, np.dtype("<f4"), "r", shape=(n_frames, self.n_points, 3))
            except (OSError, ValueError, MemoryError) as error:
                why = reason_of(error) if isinstance(error, OSError) else str(error)
                raise FileError(f"cannot read {self._path}: {why}; {_REMEDY}") from error

    def frame(self, number: float, out: Float32 | None = None) -> Float32:
        """The positions at frame `number` of the animation, between two frames on the straight line.

        Before the first frame it is the first, after the last the last.

        Parameters
        ----------
        number : frame of the scene, such as `frame_current + frame_subframe`; the first is `frame_start`.
        out : (P, 3) float32, written and returned; nothing is allocated then. Without it a whole frame is a read-only
            view of the file.

        Raises
        ------
        InputError : `number` is NaN, or `out` does not fit. FileError : no frame yet, or the file is gone.
        """
        require(math.isfinite(number), f"frame {number} does not exist")
        self.refresh()
        if self._frames is None:
            raise FileError(f"{self._path} has no whole frame yet; {_REMEDY}")
        place = min(max(number - self.frame_start, 0.0), self.n_frames - 1.0)
        first = int(place)
        share = np.float32(place - first)
        if out is None:
            if share == 0.0:
                return np.asarray(self._frames[first])
            out = np.empty((self.n_points, 3), np.float32)
        fits = out.shape == (self.n_points, 3) and out.dtype == np.float32
        require(fits, f"out is {out.dtype} {out.shape}; it must be float32 {(self.n_points, 3)}")
        if share == 0.0:
            np.copyto(out, self._frames[first])
        else:
            np.subtract(self._frames[first + 1], self._frames[first], out=out)
            out *= share
            out += self._frames[first]
        return out

    def close(self) -> None:
        """Let go of the file, so that it can be deleted (Windows)."""
        self._frames = None


def is_cache(folder: PathLike) -> bool:
    """Is there a cache, good or damaged, in `folder`?"""
    return (Path(folder) / HEADER).is_file()


def delete_cache(folder: PathLike) -> None:
    """Delete a cache: its own files, and the folder if nothing else is in it. No cache there is no error.

    Raises
    ------
    FileError : a file cannot be deleted, as one that is being played on Windows.
    """
    path = Path(folder)
    try:
        if not path.is_dir():
            return
        for name in os.listdir(path):
            if name in (HEADER, STATE) or _POSITIONS.fullmatch(name):
                (path / name).unlink(missing_ok=True)
        if not os.listdir(path):
            path.rmdir()
    except OSError as error:
        raise FileError(f"cannot delete the cache {path}: {reason_of(error)}; close what uses it") from error
