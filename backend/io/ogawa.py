"""Ogawa, the container of Alembic files: groups and blocks of data, and Alembic's objects and properties in them.

Ours, since PyPI has no library for it that could ship in the add-on: the one with wheels for all our platforms
(alembic3d) is an unofficial build of 112 MB unpacked that puts a second Alembic and a top-level module `imath` into
Blender's process. What is here is what strands need; `alembic.py` has the schemas.

    file       "Ogawa", FF when complete, version 0 1, u64 place of the root group; all little endian
    data       u64 size, bytes                     group   u64 count, u64 places; bit 63 marks data, place 0 is empty
    root       data version, data library version, group top object, data metadata, data time samplings, data indexed
               metadata
    object     group of its compound, group a child object, data: headers of the children, 32 bytes of hashes
    compound   group a property, data: headers of the properties
    property   scalar: data a sample; array: data and dimensions a sample; a sample starts with 16 bytes of its hash

Samples that are the same are stored once in the whole file. Hashes serve to tell equal from unequal only, so any good
hash does; ours is BLAKE2b where Alembic's own library has SpookyHash.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import require

MAGIC = b"Ogawa"
IS_DATA = 1 << 63
LIBRARY_VERSION = 10803  # of the Alembic library whose layout this is, 1.8.3
# plain old data types by number; strings are handled apart
PODS: tuple[Any, ...] = (
    np.dtype("?"), np.dtype("u1"), np.dtype("i1"), np.dtype("<u2"), np.dtype("<i2"), np.dtype("<u4"), np.dtype("<i4"),
    np.dtype("<u8"), np.dtype("<i8"), np.dtype("<f2"), np.dtype("<f4"), np.dtype("<f8"), str,
)  # fmt: skip
STRING = 12
SCALAR, ARRAY = 1, 2
_INLINE_METADATA = 0xFF


def pod_of(values: NDArray[Any] | Sequence[str]) -> int:
    """The number of the type of some values.

    Raises
    ------
    InputError : no type that Alembic knows.
    """
    if not isinstance(values, np.ndarray):
        return STRING
    for number, dtype in enumerate(PODS[:STRING]):
        if values.dtype.newbyteorder("<") == dtype:
            return number
    require(False, f"Alembic has no type {values.dtype}; use whole or floating point numbers, booleans or text")
    raise AssertionError


def serialized(metadata: Mapping[str, str]) -> bytes:
    """Metadata as Alembic writes it."""
    for key, value in metadata.items():
        require(not set(";=\0") & set(key) and not set(";\0") & set(value), f"metadata {key}={value!r} is not allowed")
    return ";".join(f"{key}={metadata[key]}" for key in sorted(metadata)).encode()


@dataclass(slots=True)
class Sampled:
    """A scalar or array property while it is written: where its samples are, not what they are."""

    name: str
    kind: int
    pod: int
    extent: int
    sampling: int = 0
    metadata: bytes = b""
    places: list[tuple[int, int]] = field(default_factory=list)  # of data and dimensions, a sample
    counts: list[int] = field(default_factory=list)  # values a sample


@dataclass(slots=True)
class Compound:
    """Properties together; itself a property."""

    name: str = ""
    metadata: bytes = b""
    properties: list[Compound | Sampled] = field(default_factory=list)

    def compound(self, name: str, metadata: Mapping[str, str] | None = None) -> Compound:
        """Add a compound."""
        added = Compound(_checked_name(name), serialized(metadata or {}))
        self.properties.append(added)
        return added


@dataclass(slots=True)
class Node:
    """An object: properties and children."""

    name: str = ""
    metadata: bytes = b""
    properties: Compound = field(default_factory=Compound)
    children: list[Node] = field(default_factory=list)

    def child(self, name: str, metadata: Mapping[str, str]) -> Node:
        """Add a child; a name that is taken gets a number."""
        taken, base, number = {node.name for node in self.children}, _checked_name(name), 1
        name = base
        while name in taken:
            name, number = f"{base}_{number}", number + 1
        added = Node(name, serialized(metadata))
        self.children.append(added)
        return added


def _checked_name(name: str) -> str:
    require(name and not set("/\0") & set(name), f"{name!r} is no name of an Alembic object; leave out '/'")
    return name


class ArchiveWriter:
    """Writes an archive in one pass; memory holds one sample at a time and 16 bytes for each sample before it.

    stream : binary, empty, can seek. `finish` makes the file complete; before that readers refuse it.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream
        self._end = 16
        self._known: dict[bytes, int] = {}  # places of data by hash
        self._indexed: dict[bytes, int] = {}  # metadata of properties and objects
        self._samplings: list[tuple[float, tuple[float, ...]]] = [(1.0, (0.0,))]
        self._n_samples: list[int] = [0]
        self.top = Node("ABC")
        stream.write(MAGIC + b"\x00\x00\x01" + bytes(8))

    def add_sampling(self, first: float, step: float) -> int:
        """A uniform time sampling, seconds; its number."""
        self._samplings.append((step, (first,)))
        self._n_samples.append(0)
        return len(self._samplings) - 1

    def scalar(
        self, owner: Compound, name: str, pod: int, extent: int = 1, metadata: Mapping[str, str] | None = None,
        sampling: int = 0,
    ) -> Sampled:  # fmt: skip
        """Add a scalar property; a sample is `extent` numbers or one text."""
        return self._add(owner, Sampled(_checked_name(name), SCALAR, pod, extent, sampling, serialized(metadata or {})))

    def array(
        self, owner: Compound, name: str, pod: int, extent: int = 1, metadata: Mapping[str, str] | None = None,
        sampling: int = 0,
    ) -> Sampled:  # fmt: skip
        """Add an array property; a sample is n values of `extent` numbers each, or n texts."""
        return self._add(owner, Sampled(_checked_name(name), ARRAY, pod, extent, sampling, serialized(metadata or {})))

    def _add(self, owner: Compound, added: Sampled) -> Sampled:
        require(1 <= added.extent <= 255, f"a value of '{added.name}' has {added.extent} numbers; 255 are possible")
        require(all(known.name != added.name for known in owner.properties), f"'{added.name}' is there twice")
        owner.properties.append(added)
        return added

    def write(self, target: Sampled, values: NDArray[Any] | Sequence[str]) -> None:
        """Write the next sample of a property.

        Raises
        ------
        InputError : another type or extent than the property's, or text with NUL. OSError : the disk is full...
        """
        if target.pod == STRING:
            require(not isinstance(values, np.ndarray) and all("\0" not in v for v in values), "text must not hold NUL")
            content: Any = b"".join(str(value).encode() + b"\0" for value in values)
            count = len(values)
        else:
            assert isinstance(values, np.ndarray)
            require(pod_of(values) == target.pod, f"'{target.name}' takes other numbers than {values.dtype}")
            content = np.ascontiguousarray(values, PODS[target.pod]).reshape(-1).view(np.uint8).data
            count, rest = divmod(values.size, target.extent)
            require(rest == 0, f"'{target.name}' takes {target.extent} numbers a value, not {values.size} in all")
        if target.kind == SCALAR:
            require(count == 1, f"a sample of '{target.name}' is one value, not {count}")
        dimensions = IS_DATA
        if target.kind == ARRAY and target.pod == STRING:
            dimensions = self._data(struct.pack("<Q", count))
        target.places.append((self._sample(content, is_text=target.pod == STRING), dimensions))
        target.counts.append(count)

    def repeat(self, target: Sampled) -> None:
        """The next sample of a property is that before."""
        target.places.append(target.places[-1])
        target.counts.append(target.counts[-1])

    def _sample(self, content: Any, *, is_text: bool) -> int:
        if not len(content) and not is_text:
            return IS_DATA
        digest = hashlib.blake2b(content, digest_size=16, person=b"text" if is_text else b"").digest()
        if digest not in self._known:
            self._known[digest] = self._data(digest, content)
        return self._known[digest]

    def _data(self, *parts: Any) -> int:
        place, size = self._end, sum(len(part) for part in parts)
        if not size:
            return IS_DATA
        for part in (struct.pack("<Q", size), *parts):
            self._stream.write(part)
        self._end += 8 + size
        return place | IS_DATA

    def _group(self, children: Sequence[int]) -> int:
        if not children:
            return 0
        place = self._end
        self._stream.write(struct.pack(f"<{len(children) + 1}Q", len(children), *children))
        self._end += 8 * (len(children) + 1)
        return place

    def finish(self, metadata: Mapping[str, str]) -> None:
        """Write objects, headers and what else the file needs to be complete."""
        top, _ = self._object(self.top)
        samplings = b"".join(
            struct.pack("<IdI", n_samples, step, len(times)) + struct.pack(f"<{len(times)}d", *times)
            for n_samples, (step, times) in zip(self._n_samples, self._samplings)
        )
        indexed = b"".join(bytes([len(text)]) + text for text in self._indexed)
        parts = [
            self._data(struct.pack("<i", 0)),
            self._data(struct.pack("<i", LIBRARY_VERSION)),
            top,
            self._data(serialized(metadata)),
            self._data(samplings),
            self._data(indexed),
        ]
        root = self._group(parts)
        self._stream.seek(8)
        self._stream.write(struct.pack("<Q", root))
        self._stream.seek(5)
        self._stream.write(b"\xff")

    def _object(self, node: Node) -> tuple[int, bytes]:
        """Place and hash of an object with all that is below it."""
        below = [self._object(child) for child in node.children]
        compound, data_hash = self._compound(node.properties)
        children_hash = _hash(h for _, h in below) if below else bytes(16)
        headers = b"".join(self._object_header(child) for child in node.children)
        place = self._group([compound, *(place for place, _ in below), self._data(headers, data_hash, children_hash)])
        return place, _hash((data_hash, children_hash, node.name.encode(), node.metadata))

    def _object_header(self, node: Node) -> bytes:
        name, index = node.name.encode(), self._index(node.metadata)
        inline = struct.pack("<I", len(node.metadata)) + node.metadata if index == _INLINE_METADATA else b""
        return struct.pack("<I", len(name)) + name + bytes([index]) + inline

    def _compound(self, compound: Compound) -> tuple[int, bytes]:
        places, headers, hashes = [], [], []
        for item in compound.properties:
            if isinstance(item, Compound):
                place, below = self._compound(item)
                header = self._header(item.name, item.metadata, 0, b"", 0)
            else:
                place, header, below = self._property(item)
            places.append(place)
            headers.append(header)
            hashes.append(_hash((header, below)))
        if places:
            places.append(self._data(b"".join(headers)))
        return self._group(places), _hash(hashes)

    def _property(self, item: Sampled) -> tuple[int, bytes, bytes]:
        """Place, header and hash of a property: sample 0, then those from the first change to the last."""
        places, n_samples = item.places, len(item.places)
        changes = [i for i in range(1, n_samples) if places[i] != places[i - 1]]
        first, last = (changes[0], changes[-1]) if changes else (0, 0)
        stored = places[:1] + (places[first : last + 1] if changes else [])
        flat = [place for pair in stored for place in pair] if item.kind == ARRAY else [place for place, _ in stored]
        self._n_samples[item.sampling] = max(
            self._n_samples[item.sampling], n_samples if changes else min(n_samples, 1)
        )
        is_scalar_like = item.kind == SCALAR or all(count == 1 for count in item.counts)
        info = item.kind | is_scalar_like | item.pod << 4 | item.extent << 12
        info |= 0x400 * (len(set(item.counts)) <= 1) | 0x100 * (item.sampling != 0)
        numbers = [n_samples]
        if not changes:
            info |= 0x800
        elif (first, last) != (1, n_samples - 1):
            info |= 0x200
            numbers += [first, last]
        if item.sampling:
            numbers.append(item.sampling)
        largest = max(n_samples, item.sampling)
        header = self._header(item.name, item.metadata, info, numbers, largest)
        return self._group(flat), header, _hash(struct.pack("<QQ", *pair) for pair in stored)

    def _header(self, name: str, metadata: bytes, info: int, numbers: Sequence[int], largest: int) -> bytes:
        """A property's header; its numbers have one, two or four bytes as the largest of them needs."""
        text = name.encode()
        largest = max(largest, len(text), len(metadata))
        hint = (largest > 0xFF) + (largest > 0xFFFF)
        index = self._index(metadata)
        code = "<BHI"[hint + 1]
        packed = struct.pack(f"<I{len(numbers) + 1}{code}", info | hint << 2 | index << 20, *numbers, len(text)) + text
        if index == _INLINE_METADATA:
            packed += struct.pack(f"<{code}", len(metadata)) + metadata
        return packed

    def _index(self, metadata: bytes) -> int:
        """0 for none, else its number in the indexed metadata counted from 1; 255 where it must be written out."""
        if not metadata:
            return 0
        if metadata not in self._indexed and (len(metadata) > 0xFF or len(self._indexed) >= 254):
            return _INLINE_METADATA
        return self._indexed.setdefault(metadata, len(self._indexed)) + 1


def _hash(parts: Iterable[bytes]) -> bytes:
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        digest.update(part)
    return digest.digest()
