"""Saved details written to disk: the .npz, its picture, and an asset of a few strands for the asset browser."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from ..backend.geometry.scalp_space import ScalpSpace, unroot_strands
from ..backend.geometry.strands import resample, select_strands
from ..backend.synthesis.details import Detail, write_detail
from ..backend.types import Head, StrandSet, WispHierarchy
from ..detail_library import FILE_PROPERTY, write_asset, written_together
from . import curves, thumbnail
from .hierarchies import Groom
from .inputs import with_radius_of

TAG = "detail"
_DRAWN_STRANDS, _DRAWN_POINTS = 8000, 48


def write(place: Path, hierarchy: WispHierarchy, space: ScalpSpace, read: Groom, groom: bpy.types.Object) -> None:
    """Write NAME.npz, NAME.png and NAME.blend, all or none; the open file is left as it was.

    Parameters
    ----------
    place : the .npz. hierarchy : reduced. space : of the head. groom, read : the groom it is from, as object and as it
        was read.

    Raises
    ------
    FileError : a file cannot be written.
    """
    words = f"Details of '{groom.name}', to be put onto other hair: choose it in Details From"
    write_files(place, hierarchy, space, draw(read.strands, read.head), groom, words)


def write_files(
    place: Path,
    hierarchy: WispHierarchy,
    space: ScalpSpace,
    picture: np.ndarray,
    groom: bpy.types.Object,
    description: str,
    *,
    tags: Sequence[str] = (),
    catalog_id: str = "",
) -> None:
    """As `write`, with a picture, as `thumbnail.draw_hair`, and texts of one's own."""
    strands = unroot_strands(hierarchy.levels[0], space)
    with written_together(place) as path, _asset(place, strands, groom) as obj:
        write_detail(path, Detail(place.stem, hierarchy))
        thumbnail.write_png(picture, path.with_suffix(".png"))
        thumbnail.set_preview(obj, picture)
        obj.asset_data.description = description
        for tag in (TAG, *tags):
            obj.asset_data.tags.new(tag)
        if catalog_id:
            obj.asset_data.catalog_id = catalog_id
        write_asset(obj, path.with_suffix(".blend"))


def draw(strands: StrandSet, head: Head) -> np.ndarray:
    """The picture of a groom, of as many of its strands as it takes."""
    shown = select_strands(strands, np.arange(0, strands.n_strands, -(-strands.n_strands // _DRAWN_STRANDS)))
    return thumbnail.draw_hair(resample(shown, _DRAWN_POINTS), head)


@contextmanager
def _asset(place: Path, strands: StrandSet, groom: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """A Curves object in no scene that is an asset; removed at the end."""
    data = curves.new_curves(place.stem, with_radius_of(groom, strands))
    obj = bpy.data.objects.new(place.stem, data)
    try:
        if groom.data.materials:
            data.materials.append(groom.data.materials[0])
        obj[FILE_PROPERTY] = place.name
        obj.asset_mark()
        yield obj
    finally:
        bpy.data.hair_curves.remove(data)  # and the object with it
