"""Detail transfer from cached hierarchies: curls of 10,000 strands onto 1,000 to 100,000 long straight ones."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

from hairloom.geometry.head import default_head
from hairloom.synthesis.detail_transfer import DetailParams, transfer_style
from hairloom.synthesis.details import reduce_details
from hairloom.synthesis.pipeline import analyze
from hairloom.types import WispHierarchy

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "blend_templates"))

from styles import make_style

TARGET = 2.0  # seconds, 100,000 strands x 64 points
CASES = {
    "": DetailParams(max_subdivision=1),
    ", curls drawn finely": DetailParams(),
    ", half": DetailParams(strength=0.5, max_subdivision=1),
    ", the paper's": DetailParams(length_mode="plain", matching="similar"),
}


def _hierarchy(style: str, n_strands: int) -> WispHierarchy:
    head = default_head()
    return analyze(make_style(style, head, n_strands), head).hierarchy


def _seconds(detail: WispHierarchy, base: WispHierarchy, params: DetailParams, runs: int) -> tuple[float, int]:
    best, points = float("inf"), 0
    for _ in range(runs):
        start = time.perf_counter()
        points = transfer_style(detail, base, params).strands.n_points
        best = min(best, time.perf_counter() - start)
    return best, points


def run(*, quick: bool = False) -> list[dict[str, Any]]:
    """Rows for `hairloom bench transfer`."""
    detail = _hierarchy("curly", 10_000)
    rows = []
    for count in (1000, 10_000) if quick else (1000, 10_000, 100_000):
        base = _hierarchy("straight", count)
        for name, params in CASES.items():
            seconds, points = _seconds(detail, base, params, 3 if quick else 5)
            rows.append(
                {
                    "size": f"{count} x {points} from 10000{name}",
                    "who": "hairloom",
                    "seconds": seconds,
                    "target": TARGET if count == 100_000 and not name else None,
                    "note": f"levels {[level.n_strands for level in base.levels]}" if not name else "",
                }
            )
    small = reduce_details(detail)
    seconds, points = _seconds(small, base, CASES[""], 3)
    note = f"a saved detail of {[level.n_strands for level in small.levels]} strands"
    rows.append({"size": f"{count} x {points}", "who": "hairloom", "seconds": seconds, "target": None, "note": note})
    return rows
