"""PatchMatch: patch updates a second beside the published program, and a hole filled beside PyPatchMatch in this run.

A patch update is propagation and random search of one patch in one iteration, 7 x 7 pixels, 5 iterations. The numbers
of plain C++ PatchMatch (pm_minimal.cpp, Barnes et al. 2009, one thread) are those of its table: 0.89 million a second
for 800^2 in 800^2, 0.63 for 2048^2 in 800^2; the program itself is not at hand. The peer: `pip install PyPatchMatch`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from hairloom.fourview.patch_match import fill_hole, match_patches

try:
    import patchmatch
except ImportError:
    patchmatch = None

PUBLISHED = {800: 3.58, 2048: 33.2}  # seconds
FASTER = 6


def photo(side: int, seed: int) -> np.ndarray:
    """Locks of hair, uint8: noise drawn out along a slowly turning direction, the same content at any size."""
    rng = np.random.default_rng(seed)
    base = 512
    noise = cv2.GaussianBlur(rng.normal(size=(base, base, 3)).astype(np.float32), (0, 0), 0.8)
    swirl = cv2.GaussianBlur(rng.normal(size=(base, base)).astype(np.float32), (0, 0), 60)
    angle = 3 * swirl / swirl.std()
    y, x = np.mgrid[:base, :base].astype(np.float32)
    total = np.zeros_like(noise)
    for step in range(-12, 13):
        total += cv2.remap(
            noise, x + step * np.cos(angle), y + step * np.sin(angle), cv2.INTER_LINEAR, None, cv2.BORDER_REFLECT
        )
    grey = total.mean(axis=2, keepdims=True) + 0.3 * total
    image = 110 + 45 * (grey - grey.mean()) / grey.std() * np.array([1.0, 0.8, 0.6])
    return cv2.resize(np.clip(image, 0, 255).astype(np.uint8), (side, side), interpolation=cv2.INTER_CUBIC)


def best_of(function: Callable[[], Any], count: int) -> tuple[float, float, Any]:
    """Least wall and CPU seconds of several runs, and the result."""
    walls, works, result = [], [], None
    for _ in range(count):
        wall, work = time.perf_counter(), time.process_time()
        result = function()
        walls.append(time.perf_counter() - wall)
        works.append(time.process_time() - work)
    return min(walls), min(works), result


def seam_error(result: np.ndarray, truth: np.ndarray, hole: np.ndarray) -> float:
    """Mean over the hole's patches of the least squared distance to the unbroken image; 0 if all is copied from it."""
    found = match_patches(result, truth)
    inner = hole[3:-3, 3:-3]
    return float(found.distance[inner].mean())


def run(quick: bool) -> list[dict[str, Any]]:
    """The rows of this benchmark."""
    count = 1 if quick else 3
    source = photo(800, 1)
    match_patches(source[:80, :80], source[:80, :80])
    rows: list[dict[str, Any]] = []
    for side in (800,) if quick else (800, 2048):
        image = photo(side, 2)
        wall, work, found = best_of(lambda image=image: match_patches(image, source), count)
        rate = 5 * found.distance.size / wall / 1e6
        note = f"{rate:.2f} M updates/s; mean SSD {found.distance.mean():.0f}; CPU {work:.2f} s"
        size = f"{side}^2 in 800^2, 7x7, 5 it"
        rows.append(
            {"size": size, "who": "hairloom", "seconds": wall, "target": PUBLISHED[side] / FASTER, "note": note}
        )
        rows.append(
            {"size": size, "who": "pm_minimal.cpp, published", "seconds": PUBLISHED[side], "target": None,
             "note": f"{5 * (side - 6) ** 2 / PUBLISHED[side] / 1e6:.2f} M updates/s, one thread, not in this run"}
        )  # fmt: skip
    for side in (400,) if quick else (800,):
        rows += fill_rows(side, count)
    return rows


def fill_rows(side: int, count: int) -> list[dict[str, Any]]:
    """A square hole of 1/16 of the area, 7 x 7 patches, by us and by PyPatchMatch."""
    truth = photo(side, 3)
    hole = np.zeros((side, side), np.bool_)
    hole[side * 3 // 8 : side * 5 // 8, side * 3 // 8 : side * 5 // 8] = True
    broken = np.where(hole[..., None], np.uint8(255), truth)
    fill_hole(broken[: side // 2], hole[: side // 2])
    wall, work, ours = best_of(lambda: fill_hole(broken, hole), count)
    size = f"{side}^2, hole 1/16"
    note = f"seam error {seam_error(ours, truth, hole):.0f}; CPU {work:.2f} s"
    rows = [{"size": size, "who": "hairloom fill_hole", "seconds": wall, "target": None, "note": note}]
    if patchmatch is None:
        return rows
    theirs, busy, result = best_of(lambda: patchmatch.inpaint(broken, hole.astype(np.uint8) * 255, patch_size=3), count)
    rows[0]["target"] = theirs / 8
    note = f"seam error {seam_error(result, truth, hole):.0f}; CPU {busy:.2f} s"
    return [*rows, {"size": size, "who": "PyPatchMatch inpaint", "seconds": theirs, "target": None, "note": note}]
