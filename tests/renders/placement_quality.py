"""How well photos are placed without clicks: `python tests/renders/placement_quality.py RENDERS [GROOM ...]`.

RENDERS is what render_views.py wrote. Prints for each groom and view how large the photo is placed against the true
camera, and how far the middle of the scalp lies off (the larger of x and y, millimetres): with the face that is found
in the front view, and by the masks alone. Hairstyles of the groom's own family are left out of the database.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from evaluate import VIEWS, load_head, load_views, own_family
from hairloom.fields.matting import find_face
from hairloom.fourview.database import open_database
from hairloom.fourview.placement import place_cameras
from hairloom.geometry.camera import project
from hairloom.geometry.scalp_space import fit_scalp_space
from hairloom.types import Camera, Floats


def compare(placed: Camera, true: Camera, middle: Floats) -> tuple[float, float]:
    """Scale of the placed camera over the true one, and millimetres between the pixels of a point (3,)."""
    scale = float(true.intrinsics[0, 0])
    off = np.abs(project(placed, middle)[:2] - project(true, middle)[:2]).max() / scale
    return float(placed.intrinsics[0, 0]) / scale, 1000.0 * float(off)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("renders", type=Path)
    parser.add_argument("grooms", nargs="*")
    options = parser.parse_args(arguments)
    database = open_database()
    print("| | " + " | ".join(VIEWS) + " |\n" + "|---" * (len(VIEWS) + 1) + "|")
    for groom in options.grooms or sorted(path.name for path in options.renders.iterdir() if path.is_dir()):
        head, cameras = load_head(options.renders / groom)
        views = load_views(dict.fromkeys(VIEWS, options.renders / groom), cameras)
        masks, middle = {view.name: view.mask for view in views}, fit_scalp_space(head).centre
        for way, face in (("face", find_face(views[0].image)), ("masks", None)):
            placed = place_cameras(masks, head, face=face, database=database, exclude=own_family(database, groom))
            cells = [compare(placed[name], cameras[name], middle) for name in VIEWS]
            print(f"| {groom}, {way} | " + " | ".join(f"{scale:.3f}, {off:.0f} mm" for scale, off in cells) + " |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
