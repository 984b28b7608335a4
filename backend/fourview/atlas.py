"""The atlas of a surface (Z-9, M-34): charts by xatlas, in the unit square."""

from __future__ import annotations

import numpy as np
import xatlas
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..errors import require
from ..types import Float32, Int32, Mesh

RESOLUTION = 512  # of xatlas' packing: fine enough for its exhaustive search, which fills a tenth more of the texture
MAX_COST = 0.5  # where a chart ends; xatlas' 2.0 makes fewer but branched charts, which fill a tenth less


def make_atlas(mesh: Mesh, gutter: float) -> tuple[Float32, Int32]:
    """Texture coordinates of a mesh, charts without overlap at one scale; takes seconds for 10,000 triangles.

    gutter : the least distance between charts, in units of the texture's side.

    Returns
    -------
    corner_uv : (F, 3, 2) float32 in [0, 1]. charts : (F,) int32, the chart of each triangle.

    Raises
    ------
    InputError : triangles that cannot be unwrapped.
    """
    atlas = xatlas.Atlas()
    atlas.add_mesh(np.ascontiguousarray(mesh.vertices), np.ascontiguousarray(mesh.triangles, np.uint32))
    charts, packing = xatlas.ChartOptions(), xatlas.PackOptions()
    charts.max_cost = MAX_COST
    packing.resolution, packing.bilinear, packing.bruteForce = RESOLUTION, False, True
    # xatlas uses about 0.6 of the resolution that it is asked for
    packing.padding = max(1, int(np.ceil(gutter * 0.6 * RESOLUTION)))
    atlas.generate(charts, packing)
    _, corners, uv = atlas[0]
    count = len(mesh.triangles)
    require(
        len(corners) == count and atlas.atlas_count == 1,
        f"only {len(corners)} of {count} triangles of the hair's shape could be unwrapped; smooth the shape first",
    )
    sides = np.array([atlas.width, atlas.height], np.float64)
    scaled = uv.astype(np.float64) * (sides / sides.max())
    links = np.concatenate([corners[:, :2], corners[:, 1:]]).astype(np.int64)
    graph = coo_array((np.ones(len(links), np.int8), (links[:, 0], links[:, 1])), shape=(len(uv), len(uv)))
    _, labels = connected_components(graph, directed=False)
    return scaled[corners].astype(np.float32), labels[corners[:, 0]].astype(np.int32)
