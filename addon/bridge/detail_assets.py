"""Saved details written to disk: the .npz, its picture, and an asset of a few strands for the asset browser."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from ..backend.geometry.scalp_space import unroot_strands
from ..backend.synthesis.details import Detail, write_detail
from ..backend.types import Head, StrandSet, WispHierarchy
from ..detail_library import FILE_PROPERTY, write_asset, written_together
from . import curves, hierarchies, thumbnail
from .inputs import with_radius_of

TAG = "detail"


def write(
    place: Path, hierarchy: WispHierarchy, groom: bpy.types.Object, read: hierarchies.Groom, catalog_id: str = ""
) -> None:
    """Write NAME.npz, NAME.png and NAME.blend, all or none; the open file is left as it was.

    Parameters
    ----------
    place : the .npz. hierarchy : reduced. groom, read : the groom it is from, as object and as it was read.

    Raises
    ------
    FileError : a file cannot be written.
    """
    strands = unroot_strands(hierarchy.levels[0], hierarchies.space_of(read))
    picture = draw(strands, read.head)
    with written_together(place) as path, _asset(place, strands, groom) as obj:
        write_detail(path, Detail(place.stem, hierarchy))
        thumbnail.write_png(picture, path.with_suffix(".png"))
        thumbnail.set_preview(obj, picture)
        obj.asset_data.description = f"Details of '{groom.name}', to be put onto other hair: choose it in Details From"
        obj.asset_data.tags.new(TAG)
        if catalog_id:
            obj.asset_data.catalog_id = catalog_id
        write_asset(obj, path.with_suffix(".blend"))


def draw(strands: StrandSet, head: Head) -> np.ndarray:
    """The picture of a detail whose strands all have the same number of points; as `thumbnail.draw_hair`."""
    return thumbnail.draw_hair(strands.points.reshape(strands.n_strands, -1, 3), head)


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
