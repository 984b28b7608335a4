"""Files as a whole: reading with checked bounds, and writing that leaves either the new file or the old one."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..errors import FileError

_REASONS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EACCES: "no permission",
    errno.EPERM: "no permission",
    errno.EROFS: "the file system is read-only",
    errno.ENOENT: "no such file or folder",
    errno.EISDIR: "it is a folder",
    errno.ENOTDIR: "a part of its path is not a folder",
    errno.ENAMETOOLONG: "the name is too long",
}
_MAX_LEFTOVERS = 100  # temporary files that dead processes may have left before a new name is given up


def damaged(path: Path, reason: str, offset: int | None = None) -> FileError:
    """The error of a file that was opened but does not hold what it should; `offset` is in bytes."""
    place = "" if offset is None else f" at byte {offset}"
    return FileError(f"cannot read {path}{place}: {reason}")


def read_file(path: Path) -> bytes:
    """The bytes of an ordinary file.

    Raises
    ------
    FileError : it is missing, no ordinary file, not readable, or does not fit in memory.
    """
    _refuse_nul(path)
    try:
        if path.exists() and not path.is_file():
            raise FileError(f"cannot read {path}: it is not an ordinary file")
        return path.read_bytes()
    except OSError as error:
        raise FileError(f"cannot read {path}: {reason_of(error)}") from error
    except MemoryError as error:
        raise FileError(f"cannot read {path}: it does not fit in memory") from error


def array_at(path: Path, data: bytes, offset: int, dtype: DTypeLike, count: int, what: str) -> NDArray[Any]:
    """`count` values of `dtype` from byte `offset` of `data`, read-only, not copied; errors call them `what`."""
    size = np.dtype(dtype).itemsize * count
    if count < 0 or offset < 0 or offset + size > len(data):
        raise damaged(path, f"{what} need {size} bytes, but the file has {max(len(data) - offset, 0)} left", offset)
    return np.frombuffer(data, dtype=dtype, count=count, offset=offset)


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """A binary file to write, which takes the place of `path` when the block ends and vanishes when it fails.

    The temporary file lies beside the target, so the last step is one rename: readers see the old or the new file.
    A symbolic link keeps pointing to its target.

    Raises
    ------
    FileError : folder missing or not writable, target write-protected, disk full, or any other OSError of the block.
    """
    _refuse_nul(path)
    target = Path(os.path.realpath(path))
    temporary: Path | None = None
    try:
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if target.exists() and not os.access(target, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        temporary, stream = _open_beside(target)
        with stream:
            yield stream
        os.replace(temporary, target)
        temporary = None
    except OSError as error:
        raise FileError(f"cannot write {target}: {reason_of(error)}; choose another place") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def _refuse_nul(path: str | os.PathLike[str]) -> None:
    if "\0" in os.fspath(path):
        raise FileError(f"cannot read or write {os.fspath(path)!r}: a name cannot hold a NUL character")


def _open_beside(target: Path) -> tuple[Path, IO[bytes]]:
    for attempt in range(_MAX_LEFTOVERS):
        temporary = target.with_name(f".{target.name}.{os.getpid()}-{attempt}.part")
        try:
            return temporary, temporary.open("xb")
        except FileExistsError:
            continue
    raise FileError(f"cannot write {target}: its folder is full of old .part files; delete them")


def reason_of(error: OSError) -> str:
    """Why the system refused, in words for the user."""
    return _REASONS.get(error.errno or 0, error.strerror or str(error))
