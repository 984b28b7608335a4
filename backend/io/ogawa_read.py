"""Reading Alembic archives in the container Ogawa: objects, properties and their samples, sizes checked first.

Parts are read when they are asked for, so a large or hostile file costs no more than what is looked at; every place and
size is compared with the file's before memory is taken. `ogawa.py` describes the layout.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FileError
from .files import damaged, reason_of
from .ogawa import ARRAY, IS_DATA, MAGIC, PODS, SCALAR, STRING

_MAX_CHILDREN = 2**20
_MAX_DEPTH = 32


class _File:
    """A memory-mapped file and its groups and data."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with path.open("rb") as stream:
                self.size = os.fstat(stream.fileno()).st_size
                self.bytes: Any = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) if self.size else b""
        except (OSError, ValueError) as error:
            why = reason_of(error) if isinstance(error, OSError) else str(error)
            raise FileError(f"cannot read {path}: {why}") from error
        if self.size < 16 or self.bytes[:5] != MAGIC:
            raise damaged(path, "it is no Alembic file in Ogawa; older ones in HDF5 cannot be read")
        if self.bytes[5] != 0xFF:
            raise damaged(path, "it was not written to its end")
        self.indexed: list[dict[str, str]] = [{}]  # metadata by number, 0 for none

    def metadata(self, index: int) -> dict[str, str]:
        if index >= len(self.indexed):
            raise damaged(self.path, f"metadata {index} does not exist")
        return self.indexed[index]

    def group(self, place: int, what: str) -> tuple[int, ...]:
        """The places that a group holds."""
        if place == 0:
            return ()
        if place & IS_DATA or place + 8 > self.size:
            raise damaged(self.path, f"{what} is no group", place & ~IS_DATA)
        (count,) = struct.unpack_from("<Q", self.bytes, place)
        if count > (self.size - place - 8) // 8 or count > max(_MAX_CHILDREN, self.size // 16):
            raise damaged(self.path, f"{what} states {count} parts", place)
        return struct.unpack_from(f"<{count}Q", self.bytes, place + 8)

    def data(self, place: int, what: str) -> memoryview:
        """The bytes of a block of data, not copied."""
        offset = place & ~IS_DATA
        if place == IS_DATA:
            return memoryview(b"")
        if not place & IS_DATA or offset + 8 > self.size:
            raise damaged(self.path, f"{what} is no data", offset)
        (size,) = struct.unpack_from("<Q", self.bytes, offset)
        if size > self.size - offset - 8:
            raise damaged(self.path, f"{what} states {size} bytes", offset)
        return memoryview(self.bytes)[offset + 8 : offset + 8 + size]


class _Bytes:
    """Takes numbers and texts off a block of data."""

    def __init__(self, file: _File, block: memoryview, what: str) -> None:
        self._file, self._block, self._what, self._at = file, block, what, 0

    def __bool__(self) -> bool:
        return self._at < len(self._block)

    def take(self, size: int) -> bytes:
        if size > len(self._block) - self._at:
            raise damaged(self._file.path, f"{self._what} end too early")
        self._at += size
        return bytes(self._block[self._at - size : self._at])

    def number(self, code: str) -> Any:
        return struct.unpack(f"<{code}", self.take(struct.calcsize(f"<{code}")))[0]

    def text(self, size: int) -> str:
        return self.take(size).decode("utf-8", "replace")


def _metadata(text: str) -> dict[str, str]:
    pairs = (item.partition("=") for item in text.split(";") if item)
    return {key: value for key, _, value in pairs}


@dataclass(frozen=True, slots=True)
class Sampling:
    """When samples are, seconds: times[i], then again and again `step` later. n_samples : of the longest property."""

    n_samples: int
    step: float
    times: tuple[float, ...]

    def time(self, sample: int) -> float:
        cycle, place = divmod(sample, len(self.times))
        return self.times[place] + cycle * self.step


class Property:
    """A property: compound, scalar or array."""

    def __init__(self, file: _File, place: int, name: str, metadata: dict[str, str], depth: int) -> None:
        self._file, self._place, self._depth = file, place, depth
        self.name, self.metadata = name, metadata
        self.kind = 0
        self.pod, self.extent, self.n_samples, self.first, self.last, self.sampling = 0, 0, 0, 0, 0, 0

    @property
    def is_compound(self) -> bool:
        return self.kind == 0

    @property
    def is_constant(self) -> bool:
        return self.last == 0

    def __getitem__(self, name: str) -> Property:
        """A property of a compound.

        Raises
        ------
        FileError : there is none of this name.
        """
        for found in self.properties():
            if found.name == name:
                return found
        raise damaged(self._file.path, f"it has no property '{name}' in '{self.name}'")

    def names(self) -> list[str]:
        return [found.name for found in self.properties()]

    def properties(self) -> list[Property]:
        """The properties of a compound.

        Raises
        ------
        FileError : damaged.
        """
        what = f"the compound '{self.name[:80]}'"
        if self._depth > _MAX_DEPTH:
            raise damaged(self._file.path, f"{what} is nested too deep")
        places = self._file.group(self._place, what)
        if not places or not self.is_compound:
            return []
        headers = _Bytes(self._file, self._file.data(places[-1], what), f"the headers of {what}")
        return [self._read_header(headers, place) for place in places[:-1]]

    def _read_header(self, headers: _Bytes, place: int) -> Property:
        info = headers.number("I")
        code = "BHII"[info >> 2 & 3]
        values = dict.fromkeys(("n_samples", "first", "last", "sampling"), 0)
        if info & 3:
            values["n_samples"] = headers.number(code)
            if info & 0x200:
                values["first"], values["last"] = headers.number(code), headers.number(code)
            elif not info & 0x800:
                values["first"], values["last"] = 1, max(values["n_samples"] - 1, 0)
            if info & 0x100:
                values["sampling"] = headers.number(code)
        name = headers.text(headers.number(code))
        index = info >> 20 & 0xFF
        if index == 0xFF:
            metadata = _metadata(headers.text(headers.number(code)))
        else:
            metadata = self._file.metadata(index)
        made = Property(self._file, place, name, metadata, self._depth + 1)
        made.kind = {0: 0, 1: SCALAR}.get(info & 3, ARRAY)
        made.pod, made.extent = info >> 4 & 0xF, info >> 12 & 0xFF
        for key, value in values.items():
            setattr(made, key, value)
        return made

    def sample(self, number: int = 0) -> NDArray[Any] | list[str]:
        """One sample: (extent,) of a scalar, (n,) or (n, extent) of an array; texts as a list. Not copied, read-only.

        Raises
        ------
        FileError : there is no such sample, or it is damaged.
        """
        what = f"sample {number} of '{self.name[:80]}'"
        if self.is_compound or not 0 <= number < self.n_samples or self.pod > STRING:
            raise damaged(self._file.path, f"{what} does not exist")
        place = 0 if number < max(self.first, 1) or self.last == 0 else min(number, self.last) - self.first + 1
        places = self._file.group(self._place, what)
        index = 2 * place if self.kind == ARRAY else place
        if index >= len(places):
            raise damaged(self._file.path, f"{what} is missing")
        block = self._file.data(places[index], what)[16:]
        if self.pod == STRING:
            return bytes(block).decode("utf-8", "replace").removesuffix("\0").split("\0") if len(block) else []
        dtype = PODS[self.pod]
        if self.extent == 0 or len(block) % (dtype.itemsize * self.extent):
            raise damaged(self._file.path, f"{what} has {len(block)} bytes, not whole values")
        values = np.frombuffer(block, dtype)
        return values if self.kind == SCALAR or self.extent == 1 else values.reshape(-1, self.extent)


class Object:
    """An object of the archive."""

    def __init__(self, file: _File, place: int, path: str, metadata: dict[str, str], depth: int) -> None:
        self._file, self._depth = file, depth
        self.path, self.metadata = path, metadata
        self._places = file.group(place, f"the object '{path[:80]}'")

    @property
    def name(self) -> str:
        return self.path.rpartition("/")[2]

    @property
    def schema(self) -> str:
        """Such as AbcGeom_Curve_v2; '' where it has none."""
        return self.metadata.get("schema", "")

    @property
    def properties(self) -> Property:
        """The compound of all its properties."""
        place = self._places[0] if self._places else 0
        return Property(self._file, place, self.path, self.metadata, 0)

    def children(self) -> list[Object]:
        """The objects below.

        Raises
        ------
        FileError : damaged, or nested too deep.
        """
        places, what = self._places[1:-1], f"the headers of '{self.path[:80]}'"
        if not places:
            return []
        if self._depth > _MAX_DEPTH:
            raise damaged(self._file.path, f"'{self.path[:80]}' is nested too deep")
        headers = _Bytes(self._file, self._file.data(self._places[-1], what)[:-32], what)
        found = []
        for place in places:
            name = headers.text(headers.number("I"))
            index = headers.number("B")
            metadata = _metadata(headers.text(headers.number("I"))) if index == 0xFF else self._file.metadata(index)
            found.append(Object(self._file, place, f"{self.path}/{name}", metadata, self._depth + 1))
        return found

    def walk(self) -> Iterator[Object]:
        """This object and all below it.

        Raises
        ------
        FileError : damaged, or more objects than a file of this size can have, as in a ring.
        """
        waiting, left = [self], self._file.size // 16
        while waiting:
            found = waiting.pop()
            left -= 1
            if left < 0:
                raise damaged(self._file.path, "its objects form a ring")
            yield found
            waiting.extend(reversed(found.children()))


class Archive:
    """An Alembic archive.

    top : the object that all others are below. samplings : when samples are, by number. metadata : of the archive.

    Raises
    ------
    FileError : missing, damaged, not in Ogawa, or not written to its end.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        file = _File(Path(path))
        (root,) = struct.unpack_from("<Q", file.bytes, 8)
        parts = file.group(root, "the root")
        if len(parts) < 6:
            raise damaged(file.path, f"its root has {len(parts)} parts, not 6", root)
        self.metadata = _metadata(bytes(file.data(parts[3], "the archive's metadata")).decode("utf-8", "replace"))
        self.samplings = self._read_samplings(_Bytes(file, file.data(parts[4], "time"), "the time samplings"))
        indexed = _Bytes(file, file.data(parts[5], "the indexed metadata"), "the indexed metadata")
        while indexed:
            file.indexed.append(_metadata(indexed.text(indexed.number("B"))))
        self.top = Object(file, parts[2], "", {}, 0)

    @staticmethod
    def _read_samplings(block: _Bytes) -> list[Sampling]:
        found = []
        while block:
            n_samples, step, count = block.number("I"), block.number("d"), block.number("I")
            times = tuple(np.frombuffer(block.take(8 * count), "<f8").tolist())
            found.append(Sampling(n_samples, step, times or (0.0,)))
        return found
