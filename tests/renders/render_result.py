"""Modelled hair, lit as the photos were: `python tests/renders/render_result.py RENDERS RESULTS [GROOM ...]`.

RENDERS is what render_views.py wrote, RESULTS what evaluate.py wrote; each RESULTS/GROOM gets rendered_front.png and so
on of its result.npz on the groom's head, in the colours that it took from the photos.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import photo_scene
from grooms import Groom
from hairloom.io.bundle import read_bundle
from hairloom.io.strands import read_strands
from hairloom.types import Camera, Head, StrandSet
from render_views import PLAIN, photo

RADIUS = 7e-5  # metres at the root
SAMPLES = 8


def render_strands(strands: StrandSet, head: Head, cameras: Mapping[str, Camera]) -> dict[str, np.ndarray]:
    """Pictures (H, W, 3) uint8 sRGB by view."""
    share = np.concatenate([np.linspace(0.0, 1.0, count) for count in strands.point_counts])
    radius = (RADIUS * (1.0 - 0.75 * share)).astype(np.float32)
    hair = StrandSet(strands.points, strands.offsets, {"radius": radius}, strands.strand_attributes)
    scene = photo_scene.make_scene(Groom(hair, head, 0.5, 0.5, dict(cameras)), SAMPLES, 0.5, 0.5, False)
    random = np.random.default_rng(0)
    return {name: photo(photo_scene.render_view(scene, camera), PLAIN, 0.0, 0.0, random)
            for name, camera in cameras.items()}  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("renders", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("grooms", nargs="*")
    options = parser.parse_args(arguments)
    for groom in options.grooms or sorted(path.parent.name for path in options.results.glob("*/result.npz")):
        seen = read_bundle(options.renders / groom / "cameras.npz")
        strands = read_strands(options.results / groom / "result.npz")
        for name, image in render_strands(strands, seen["head"], seen["cameras"]).items():
            cv2.imwrite(str(options.results / groom / f"rendered_{name}.png"), image[..., ::-1])
        print(groom, flush=True)
    return 0


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # pip's bpy may hang at interpreter exit
