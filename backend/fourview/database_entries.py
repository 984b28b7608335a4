"""Entries of the database from grooms: of our own script, of the command line, and of the user's folders (Z-3).

A folder may hold grooms in any strand format. A groom's head is the mesh NAME.head.obj or head.obj beside it; without
one it is guessed from the roots (`database_fit.frame_of_roots`). What was made of a groom is kept beside it, in
GROOM.hairstyle.npz, and taken from there until groom or head change. A .hairstyle.npz without its groom counts too, so
that hairstyles can be handed on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import FileError, HairloomError, require
from ..geometry.head import default_head, find_scalp, read_head
from ..geometry.strands import resample, select_strands
from ..io.files import read_file
from ..io.strands import read_strands, suffixes
from ..io.units import Units
from ..types import Float32, Head, Int64, StrandSet
from .database_files import Hairstyle, fingerprint, order_of_roots, pack_strands, read_hairstyles, write_hairstyles
from .database_fit import HeadFrame, frame_of_head, frame_of_roots
from .database_masks import Backdrop, grid_backdrops, grid_masks

CACHE_SUFFIX = ".hairstyle.npz"
# Suffixes of strands that a folder is searched for: .obj and .ply are meshes more often than strands.
GROOM_SUFFIXES = tuple(suffix for suffix in suffixes() if suffix not in (".obj", ".ply"))
USER_FAMILY = "user"


@dataclass(frozen=True, slots=True)
class EntryParams:
    """How much of a groom is kept. Defaults live here only."""

    n_strands: int = 1200  # at most
    n_points: int = 14  # of a strand
    n_mask_strands: int = 8000  # strands that the masks are rendered from, at most
    n_mask_points: int = 32

    def __post_init__(self) -> None:
        require(self.n_strands >= 1 and self.n_mask_strands >= 1, "an entry needs a strand")
        require(2 <= self.n_points <= 1000, f"n_points is {self.n_points}; it must be in 2..1000")
        require(2 <= self.n_mask_points <= 1000, f"n_mask_points is {self.n_mask_points}; it must be in 2..1000")


@dataclass(frozen=True, slots=True)
class EntryHead:
    """The head that grooms stand on: fitted space, and the head in the views of the grid."""

    frame: HeadFrame
    backdrops: tuple[Backdrop, ...]


def entry_head(head: Head) -> EntryHead:
    """Of a head with a scalp; InputError without one."""
    frame = frame_of_head(head)
    return EntryHead(frame, grid_backdrops(replace(head, vertices=frame.to_fitted(head.vertices))))


def guessed_head(strands: StrandSet) -> EntryHead:
    """Of hair whose head is not known: a sphere through the roots, and Hairloom's own head for what it hides."""
    return EntryHead(frame_of_roots(strands.roots), entry_head(default_head()).backdrops)


def make_hairstyle(
    name: str,
    strands: StrandSet,
    head: EntryHead,
    *,
    tags: Sequence[str] = (),
    family: str = USER_FAMILY,
    params: EntryParams = EntryParams(),
) -> Hairstyle:
    """An entry of the database from a groom.

    strands : world space, metres, on `head`. Masks come from up to `n_mask_strands` of them, and fewer are kept,
    evenly over the head. The same groom gives the same entry.

    Raises
    ------
    InputError : no strands, or hair that reaches farther than any could (wrong units).
    """
    require(strands.n_strands > 0, f"the groom '{name}' has no strands; choose one that has")
    order = order_of_roots(head.frame.to_fitted(strands.roots))
    rendered = select_strands(strands, order[_evenly(len(order), params.n_mask_strands)])
    masks = grid_masks(head.frame.to_fitted(resample(rendered, params.n_mask_points)), head.backdrops)
    kept = select_strands(strands, order[_evenly(len(order), params.n_strands)])
    points: Float32 = head.frame.to_fitted(resample(kept, params.n_points))
    return Hairstyle(name, tuple(tags), family, len(points), params.n_points, pack_strands(points), masks)


def _evenly(count: int, wanted: int) -> Int64:
    """Indices of `wanted` of `count` things, one from the middle of each equal part; all where there are fewer."""
    number = min(count, wanted)
    return ((np.arange(number) + 0.5) * count / number).astype(np.int64)


def hairstyle_of_file(
    path: Path, head_path: Path | None = None, *, units: Units | None = None, tags: Sequence[str] = (), name: str = ""
) -> Hairstyle:
    """An entry from a groom's file. head_path : .obj of its head, in the units of the groom's file or its own usual.

    Raises
    ------
    FileError, InputError : as the readers, and where no head can be found in the roots.
    """
    strands = read_strands(path, units=units)
    require(strands.n_strands > 0, f"{path} has no strands; choose a groom that has")
    if head_path is None:
        head = guessed_head(strands)
    else:
        head = entry_head(find_scalp(read_head(head_path, units), strands.roots))
    return make_hairstyle(name or path.stem, strands, head, tags=tags)


def read_folder(folder: str | Path) -> tuple[list[Hairstyle], list[str]]:
    """The hairstyles of a user's folder, by file name, and a remark for each file that could not be used.

    Raises
    ------
    InputError : it is no folder.
    """
    folder = Path(folder)
    require(folder.is_dir(), f"{folder} is no folder; choose one with grooms")
    files = sorted(path for path in folder.iterdir() if path.is_file())
    styles: list[Hairstyle] = []
    remarks: list[str] = []
    for path in files:
        try:
            if path.name.endswith(CACHE_SUFFIX):
                if not path.with_name(path.name.removesuffix(CACHE_SUFFIX)).exists():
                    styles += read_hairstyles(path)
            elif path.suffix.lower() in GROOM_SUFFIXES:
                styles.append(_cached_hairstyle(path, remarks))
        except HairloomError as error:
            remarks.append(str(error))
    return styles, remarks


def _cached_hairstyle(path: Path, remarks: list[str]) -> Hairstyle:
    """The entry of a groom from its cache, or made and cached."""
    beside = [path.with_name(f"{path.stem}.head.obj"), path.with_name("head.obj")]
    head_path = next((candidate for candidate in beside if candidate.is_file()), None)
    source = fingerprint(read_file(path), read_file(head_path) if head_path else b"")
    cache = path.with_name(path.name + CACHE_SUFFIX)
    if cache.is_file():
        try:
            found = read_hairstyles(cache, source)
            if len(found) == 1:
                return found[0]
        except FileError:
            remarks.append(f"{cache} was damaged and is made again")
    style = hairstyle_of_file(path, head_path)
    try:
        write_hairstyles(cache, [style], source)
    except FileError as error:
        remarks.append(f"{error}; the hairstyle is made again each time")
    return style
