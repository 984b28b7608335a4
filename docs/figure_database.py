"""Draw docs/pictures/hair_database.png: all hairstyles of the database, shaded strands from three quarters.

`python docs/figure_database.py [DATABASE.npz] [OUT.png] [--view front|left|back|quarter] [--labels]`
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from hairloom.fourview.database import open_database
from hairloom.fourview.database_fit import frame_of_head
from hairloom.geometry.camera import orthographic_camera, view_direction
from hairloom.geometry.head import default_head
from hairloom.geometry.strand_raster import raster_strands
from hairloom.geometry.strands import from_dense
from hairloom.geometry.view_raster import raster_mesh
from hairloom.types import Head, StrandSet
from numpy.typing import NDArray

HERE = Path(__file__).resolve().parent
VIEWS = {"front": (0.0, 1.0, 0.0), "left": (-1.0, 0.0, 0.0), "back": (0.0, -1.0, 0.0), "quarter": (-0.75, 0.9, -0.12)}
TILE = (68, 92)
PIXELS_PER_METRE = 116
FINER = 3
COLUMNS = 20


def tile(strands: StrandSet, head: Head, direction: tuple[float, float, float]) -> NDArray[np.uint8]:
    """(92, 68, 3) uint8: strands shaded by how they run and how deep they lie, the head in grey."""
    size = (TILE[0] * FINER, TILE[1] * FINER)
    camera = orthographic_camera(direction, (0.0, 0.03, 0.06), PIXELS_PER_METRE * FINER, size)
    skin = raster_mesh(camera, head.vertices, head.triangles)
    picture = np.full((size[1], size[0], 3), 255.0)
    corners = head.vertices[head.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    light = np.clip(normals @ -view_direction(camera), 0.0, 1.0)
    bare = skin.triangle >= 0
    picture[bare] = np.array([196.0, 205.0, 222.0]) * (0.45 + 0.55 * light[skin.triangle[bare]])[:, None]
    hair = raster_strands(camera, strands, head, width_px=1.6)
    shade = np.random.default_rng(0).uniform(0.55, 1.0, strands.n_strands)
    slope = 0.55 + 0.45 * np.abs(np.sin(hair.angle - 0.5))
    depth = hair.depth[hair.mask]
    near = 1.0 - 0.45 * (depth - depth.min()) / max(float(np.ptp(depth)), 1e-6)
    tone = shade[hair.strand[hair.mask]] * slope[hair.mask] * near
    picture[hair.mask] = tone[:, None] * np.array([70.0, 112.0, 168.0])
    small = cv2.resize(picture.astype(np.float32), TILE, interpolation=cv2.INTER_AREA)
    return small.astype(np.uint8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("database", nargs="?", default=None)
    parser.add_argument("out", nargs="?", type=Path, default=HERE / "pictures" / "hair_database.png")
    parser.add_argument("--view", choices=sorted(VIEWS), default="quarter")
    parser.add_argument("--labels", action="store_true", help="number each picture")
    options = parser.parse_args()
    database, head = open_database(options.database), default_head()
    frame = frame_of_head(head)
    tiles = []
    for index in range(len(database)):
        strands = from_dense(frame.to_world(database.styles[index].points()))
        picture = tile(strands, head, VIEWS[options.view])
        if options.labels:
            cv2.putText(picture, str(index), (2, 9), cv2.FONT_HERSHEY_SIMPLEX, 0.32, (0, 0, 200), 1, cv2.LINE_AA)
        tiles.append(picture)
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % COLUMNS)
    rows = [np.hstack(tiles[start : start + COLUMNS]) for start in range(0, len(tiles), COLUMNS)]
    sheet = np.vstack(rows)
    # 64 tones are enough for a sheet, and half the bytes
    cv2.imwrite(str(options.out), sheet // 6 * 6, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(f"{options.out}: {len(database)} hairstyles, {options.out.stat().st_size // 1024} kB")


if __name__ == "__main__":
    main()
