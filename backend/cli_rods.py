"""The commands of the command line about rods: fit-helices."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .errors import require
from .io.strands import read_strands
from .io.units import Units
from .progress import Progress
from .rods.fitting import FitParams, fit_helices
from .rods.helix_files import write_helices
from .types import StrandSet

Report = dict[str, Any]
Clock = Callable[[str], None]


def add_commands(
    command: Callable[..., argparse.ArgumentParser], hair: argparse.ArgumentParser
) -> None:  # fmt: skip
    """Add the commands; `command(name, run, text, *parents)` makes one, `hair` is the parent that reads a groom."""
    _add_fit(command("fit-helices", _fit_helices, "Turn strands into helices, and say how near they are.", hair))


def _groom(options: argparse.Namespace) -> StrandSet:
    strands = read_strands(options.hair, units=Units.parse(options.units) if options.units else None)
    require(strands.n_strands > 0, f"{options.hair} has no strands; choose a groom that has")
    return strands


def _add_fit(parser: argparse.ArgumentParser) -> None:
    defaults = FitParams()
    parser.add_argument("out", type=Path, help="the .npz of helices to write")
    parser.add_argument("--exact", action="store_true", help="write float64 instead of float32")
    for name, kind, text in (
        ("n-min", int, "elements of short strands"),
        ("n-max", int, "elements of long strands, and the most of any"),
        ("n-elements", int, "elements of every strand; 0: adaptive"),
        ("l-min", float, "m; shorter strands are short"),
        ("l-max", float, "m; longer strands are long"),
        ("tolerance", float, "m; strands with a larger RMS distance get more elements; 0: the paper's numbers"),
        ("samples-per-segment", int, "points of a strand for each segment of its spline"),
    ):
        default = getattr(defaults, name.replace("-", "_"))
        parser.add_argument(f"--{name}", type=kind, default=default, help=f"{text} (default: {default})")


def _fit_helices(options: argparse.Namespace, clock: Clock, progress: Progress) -> Report:
    params = FitParams(
        n_min=options.n_min, n_max=options.n_max, l_min=options.l_min, l_max=options.l_max,
        n_elements=options.n_elements, tolerance=options.tolerance, samples_per_segment=options.samples_per_segment,
    )  # fmt: skip
    clock("read")
    strands = _groom(options)
    clock("fit")
    fit = fit_helices(strands, params, progress=progress)
    clock("write")
    write_helices(options.out, fit.helices, exact=options.exact)
    clock("report")
    return fit.report(strands) | {"out": str(options.out)}
