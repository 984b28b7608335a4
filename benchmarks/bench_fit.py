"""Helix fitting of guides: three hairstyles as in the paper's Table 2, beside SciPy's splines and the two baselines."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from hairloom.geometry.head import default_head
from hairloom.geometry.strands import select_strands
from hairloom.rods.fitting import FitParams, fit_helices
from hairloom.rods.natural import natural_fit
from hairloom.types import Float64, StrandSet
from scipy.interpolate import splprep

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "blend_templates"))

from collider import Collider
from styles import STYLES, Style, grow_style

TARGET = 0.08  # seconds, 5,000 strands of 25 to 60 cm x 64 points
N_POINTS = 64
FIXED = 15  # elements of the paper's baselines
# As the paper's A, B, C: short straight, curly, long straight, about 25, 40 and 60 cm
HAIRSTYLES: dict[str, Style] = {
    "straight 25 cm": STYLES["straight"],
    "curly 40 cm": replace(STYLES["curly"], length=3.3, cut_height=-20.0),
    "long straight 60 cm": replace(STYLES["straight"], length=6.5, cut_height=-20.0),
}


@cache
def _grown(name: str) -> StrandSet:
    return grow_style(HAIRSTYLES[name], Collider(default_head()), 5000, N_POINTS)


def make_hair(name: str, n_strands: int) -> StrandSet:
    """One of HAIRSTYLES on our head, 64 points a strand; some of 5,000 strands, or copies of them."""
    return select_strands(_grown(name), (np.arange(n_strands) * max(1, 5000 // n_strands)) % 5000)


def best_of(runs: int, work: Callable[[], Any]) -> tuple[float, Any]:
    """The least seconds of several runs, and the last result."""
    best, result = float("inf"), None
    for _ in range(runs):
        start = time.perf_counter()
        result = work()
        best = min(best, time.perf_counter() - start)
    return best, result


def whole_rms(rms: Float64) -> str:
    """Over all strands, which have equally many points, in millimetres."""
    return f"rms {1e3 * float(np.sqrt((rms**2).mean())):.3f} mm"


def smooth_each(strands: StrandSet) -> None:
    """SciPy's smoothing spline, strand by strand, as many knots as 0.07 mm RMS take: about 26 on straight hair."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # curls would take more knots than it tries
        for points in strands.points.reshape(-1, N_POINTS, 3).astype(np.float64):
            splprep(points.T, s=N_POINTS * 7e-5**2)


def spline_each(strands: StrandSet) -> None:
    """SciPy's least-squares cubic spline with 26 knots given, strand by strand."""
    knots = np.linspace(0.0, 1.0, 26)[1:-1]
    places = np.linspace(0.0, 1.0, N_POINTS)
    for points in strands.points.reshape(-1, N_POINTS, 3).astype(np.float64):
        splprep(points.T, u=places, task=-1, t=knots)


def _row(size: str, who: str, seconds: float, target: float | None, note: str) -> dict[str, Any]:
    return {"size": size, "who": who, "seconds": seconds, "target": target, "note": note}


def _fits(name: str, strands: StrandSet, runs: int) -> list[dict[str, Any]]:
    size = f"{strands.n_strands} x {N_POINTS}, {name}"
    ways = {
        "": FitParams(),
        ", as in the paper": FitParams(tolerance=0.0),
        f", fixed N {FIXED}": FitParams(n_elements=FIXED),
        ", polish 5": FitParams(polish=5),
    }
    if strands.n_strands > 5000:
        ways = {"": FitParams()}
    rows = []
    for way, params in ways.items():
        seconds, fit = best_of(runs, lambda params=params: fit_helices(strands, params))
        note = f"N {fit.helices.element_counts.mean():.1f}, {whole_rms(fit.rms)}"
        target = TARGET if strands.n_strands == 5000 and not way else None
        rows.append(_row(size + way, "hairloom", seconds, target, note))
    return rows


def run(*, quick: bool = False) -> list[dict[str, Any]]:
    """Rows for `hairloom bench fit`."""
    rows = []
    for name in HAIRSTYLES:
        for count in (1000,) if quick else (1000, 5000, 50_000):
            strands = make_hair(name, count)
            rows += _fits(name, strands, 5 if count <= 5000 else 3)
            if count == 5000:
                for peer, note in ((smooth_each, "smoothing spline alone"), (spline_each, "spline of 26 knots alone")):
                    seconds, _ = best_of(2, lambda peer=peer, strands=strands: peer(strands))
                    rows.append(_row(f"{count} x {N_POINTS}, {name}", "scipy splprep", seconds, None, note))
            if count == 1000 and not quick:
                seconds, result = best_of(1, lambda strands=strands: natural_fit(strands, FIXED))
                note = f"N {FIXED}, {whole_rms(result.rms)}, {result.steps.mean():.0f} steps"
                size = f"{count} x {N_POINTS}, {name}, natural optimisation"
                rows.append(_row(size, "hairloom", seconds, None, note))
    return rows
