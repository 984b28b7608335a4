"""The comb without Blender: the start of a stroke and each move, for a brush that touches a tenth of the strands."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from hairloom.editing.comb import CombSession
from hairloom.editing.strokes import CombParams, View
from hairloom.geometry.collider import Collider, build_collider
from hairloom.geometry.head import default_head
from hairloom.synthesis.pipeline import analyze
from hairloom.types import Float64, Int32, StrandSet

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "blend_templates"))
sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from comb_quality import composed_labels, drag, look, share_held
from styles import make_style

N_POINTS = 64
TOUCHED = 0.1  # share of the strands that the brush holds in a move, on average
START, WAY = (0.09, 0.05, 0.15), (-100.0, 20.0)
STEPS = 20
RUNS = 3
BEGIN_TARGET = 0.5  # seconds
MOVE_TARGETS = {20_000: 0.033, 100_000: 0.1}  # seconds


def _groom(n_strands: int) -> tuple[StrandSet, tuple[Int32, ...]]:
    head = default_head()
    strands = make_style("wavy", head, n_strands, N_POINTS)
    return strands, composed_labels(analyze(strands, head).hierarchy)


def _stroke(
    hair: tuple[StrandSet, tuple[Int32, ...]], collider: Collider, view: View, params: CombParams, samples: Float64
) -> tuple[float, list[float], float]:
    """Seconds to begin (session included) and of each move, and the mean share of strands that a move holds."""
    strands, labels = hair
    start = time.perf_counter()
    session = CombSession(strands, labels, collider)
    session.begin(params, view, np.eye(4))
    session.move(*samples[0].tolist())
    begun = time.perf_counter() - start
    moves, held = [], []
    for sample in samples[1:].tolist():
        start = time.perf_counter()
        session.move(*sample)
        moves.append(time.perf_counter() - start)
        held.append(share_held(session))
    return begun, moves, float(np.mean(held))


def _find_radius(hair: tuple[StrandSet, tuple[Int32, ...]], collider: Collider, view: View, level: int) -> float:
    """Pixels with which a move holds TOUCHED of the strands, as near as halving the range seven times gets."""
    low, high = 5.0, 320.0
    samples = drag(view, START, WAY, STEPS)
    for _ in range(7):
        radius = float(np.sqrt(low * high))
        share = _stroke(hair, collider, view, CombParams(radius=radius, level=level), samples)[2]
        low, high = (radius, high) if share < TOUCHED else (low, radius)
    return high


def run(*, quick: bool = False) -> list[dict[str, Any]]:
    """Rows for `hairloom bench comb`."""
    collider = build_collider([default_head()])
    view = look((1.0, 0.05, 0.15), (0.0, 0.02, 0.15))
    samples = drag(view, START, WAY, STEPS)
    rows: list[dict[str, Any]] = []
    radii: dict[int, float] = {}
    for count in (1000, 20_000) if quick else (1000, 20_000, 100_000):
        hair = _groom(count)
        for level, name in ((-1, "largest wisps"), (0, "single strands")):
            if count <= 20_000 or level != 0:
                radii[level] = _find_radius(hair, collider, view, level)  # also compiles
            # for very many single strands the search takes minutes: as with the largest wisps
            radius = radii[level] if count <= 20_000 else radii[-1]
            runs = [_stroke(hair, collider, view, CombParams(radius=radius, level=level), samples) for _ in range(RUNS)]
            # of each move the best of the runs: what the same move costs when nothing else runs
            moves = np.min([moves for _, moves, _ in runs], axis=0)
            size = f"{count} x {N_POINTS}, {name}"
            note = f"radius {radius:.0f} px, {runs[0][2]:.0%} of the strands held"
            timed = (
                ("begin", min(begun for begun, _, _ in runs), BEGIN_TARGET if count <= 20_000 else None),
                ("move, median", float(np.median(moves)), MOVE_TARGETS.get(count)),
                ("move, worst", float(moves.max()), None),
            )
            rows += [
                {"size": f"{size}: {what}", "who": "hairloom", "seconds": seconds, "target": target, "note": note}
                for what, seconds, target in timed
            ]
    return rows
