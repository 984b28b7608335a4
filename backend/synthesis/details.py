"""The details of a hairstyle as a small file, to be put onto other hairstyles later without the groom."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import require
from ..geometry._grouping_kernels import list_members
from ..io.bundle import read_bundle, write_bundle
from ..io.files import damaged, read_file
from ..io.npz import read_arrays
from ..types import Bools, Int32, RootedStrands, WispHierarchy
from ._detail_kernels import spread_over_wisps

FORMAT, VERSION = "hairloom-detail", 1
SMALL = 2400  # hairs in a file: with their centers and 64 points they take 2.7 MB at most
RATIO = 4  # hairs kept for each wisp, and wisps for each wisp of the next level: the paper's


@dataclass(frozen=True, slots=True)
class Detail:
    """A hierarchy kept for its details, with the name that artists see."""

    name: str
    hierarchy: WispHierarchy


def reduce_details(hierarchy: WispHierarchy, n_strands: int = SMALL) -> WispHierarchy:
    """A copy with at most `n_strands` hairs, for the use as `detail` of transfer_style.

    Each coarser level keeps at most a quarter of the finer one's number, so that wisps keep their inner variety. Of a
    level the wisps lose about the same share, and what they keep is spread over their roots; one strand of each wisp
    that is kept is kept. Center strands stay as they are, so the details that are left do not change.

    Raises
    ------
    InputError : n_strands below 1.
    """
    require(n_strands >= 1, f"n_strands is {n_strands}; it must be 1 or more")
    coarsest = hierarchy.n_levels - 1
    budgets = [max(1, n_strands // RATIO**level) for level in range(hierarchy.n_levels)]
    top = hierarchy.levels[coarsest]
    kept = _spread(top, np.zeros(top.n_strands, np.int32), np.ones(1, np.bool_), budgets[coarsest])
    levels, labels = [_take(top, kept)], []
    for level in range(coarsest - 1, -1, -1):
        strands, wisps = hierarchy.levels[level], hierarchy.labels[level]
        chosen = _spread(strands, wisps, kept, budgets[level])
        numbers = np.cumsum(kept, dtype=np.int32) - 1
        levels.append(_take(strands, chosen))
        labels.append(np.ascontiguousarray(numbers[wisps[chosen]], dtype=np.int32))
        kept = chosen
    return WispHierarchy(tuple(levels[::-1]), tuple(labels[::-1]))


def _spread(strands: RootedStrands, wisps: Int32, kept_wisps: Bools, n_strands: int) -> Bools:
    """(S,) bool: about `n_strands` strands of the wisps that are kept, by share, one at least, spread over each."""
    sizes = np.bincount(wisps, minlength=len(kept_wisps)) * kept_wisps
    total = int(sizes.sum())
    if total <= n_strands:
        return np.asarray(kept_wisps[wisps])
    firsts = (sizes > 0).astype(np.int32)
    spare = max(0, n_strands - int(firsts.sum()))
    shares = np.maximum(sizes - 1, 0) * (spare / max(1, total - int(firsts.sum())))
    quotas = firsts + shares.astype(np.int32)
    # what rounding down left over goes to the largest remainders
    left = spare - int((quotas - firsts).sum())
    quotas[np.argsort(np.floor(shares) - shares, kind="stable")[:left]] += 1
    starts, members = list_members(wisps, len(sizes))
    chosen: Bools = spread_over_wisps(strands.roots, members, starts, quotas)
    return chosen


def _take(strands: RootedStrands, chosen: Bools) -> RootedStrands:
    return RootedStrands(strands.roots[chosen], strands.frames[chosen], strands.uv[chosen], strands.points[chosen])


def write_detail(path: str | os.PathLike[str], detail: Detail) -> None:
    """Write a detail asset, an .npz; reduce it first if it shall be small.

    Raises
    ------
    InputError : a hierarchy of one level has no details. FileError : the file cannot be written.
    """
    require(detail.hierarchy.n_levels >= 2, "a hairstyle of one level has no details; cluster it with 2 levels or more")
    write_bundle(path, {"format": FORMAT, "version": VERSION, "name": detail.name, "hierarchy": detail.hierarchy})


def read_detail(path: str | os.PathLike[str]) -> Detail:
    """Read a detail asset, or what `hairloom cluster` wrote.

    Raises
    ------
    FileError : missing or damaged, or a bundle without the details of a hairstyle.
    """
    values = read_bundle(path)
    where = Path(path)
    if values.get("format", FORMAT) != FORMAT or values.get("version", VERSION) != VERSION:
        raise damaged(where, f"it is no {FORMAT} of version {VERSION}; save the detail again")
    hierarchy = values.get("hierarchy")
    if not isinstance(hierarchy, WispHierarchy) or hierarchy.n_levels < 2:
        raise damaged(where, "it has no wisp hierarchy of two levels or more, so no details")
    _check_wisps(where, hierarchy)
    name = values.get("name", where.stem)
    if not isinstance(name, str):
        raise damaged(where, "its name is no text")
    return Detail(name, hierarchy)


def holds_detail(path: str | os.PathLike[str]) -> bool:
    """Whether a file is a bundle, for `read_detail`, and no groom; FileError if it is an .npz that cannot be read."""
    where = Path(path)
    return where.suffix.lower() == ".npz" and "manifest" in read_arrays(where, read_file(where))


def _check_wisps(path: Path, hierarchy: WispHierarchy) -> None:
    counts = {level.n_points for level in hierarchy.levels}
    if len(counts) != 1 or min(counts) < 2:
        raise damaged(path, f"its levels have strands of {sorted(counts)} points; all must have the same, 2 or more")
    for coarse, labels in zip(hierarchy.levels[1:], hierarchy.labels):
        if (np.bincount(labels, minlength=coarse.n_strands) == 0).any():
            raise damaged(path, "a wisp of it has no strands")
