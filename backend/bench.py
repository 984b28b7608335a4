"""`hairloom bench`: runs the measurements in `benchmarks/` and writes them as a table. Needs a source checkout."""

from __future__ import annotations

import importlib.util
import os
import platform
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from .errors import InputError
from .io.files import atomic_write

FOLDER = Path(__file__).resolve().parent.parent / "benchmarks"
COLUMNS = ("job", "size", "who", "seconds", "target", "note")
Row = dict[str, Any]


def jobs() -> dict[str, Path]:
    """Name -> file of every measurement, `bench_<name>.py`, in the order they run."""
    return {path.stem.removeprefix("bench_"): path for path in sorted(FOLDER.glob("bench_*.py"))}


def _load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run_benchmarks(job: str | None, *, quick: bool, out: Path | None) -> dict[str, Any]:
    """Run one measurement, or all, and return their rows.

    Each file of `benchmarks/` has `run(quick: bool) -> list of rows` with the keys of COLUMNS: `who` is "hairloom" or
    the peer measured in the same run, `seconds` the best of several, `target` the number to reach or None.

    Raises
    ------
    InputError : no such job, or Hairloom is installed without its source.
    """
    known = jobs()
    if not known:
        raise InputError(f"no benchmarks in {FOLDER}; run `hairloom bench` from a source checkout (pip install -e .)")
    if job is not None and job not in known:
        raise InputError(f"there is no benchmark '{job}'; the benchmarks are {', '.join(known)}")
    rows: list[Row] = []
    for name, path in known.items():
        if job in (None, name):
            rows += [{"job": name, **row} for row in _load(path).run(quick=quick)]
    if out is not None:
        with atomic_write(out) as stream:
            stream.write(as_markdown(rows, job).encode())
    return {"machine": machine(), "rows": rows}


def machine() -> str:
    """One line on what this was measured on."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [
            line.split(":")[1].strip() for line in cpuinfo.read_text().splitlines() if line.startswith("model name")
        ]
        model = names[0] if names else model
    versions = f"Python {platform.python_version()}, numpy {np.__version__}"
    return f"{model}, {os.cpu_count()} cores, {platform.system()}, {versions}"


def as_markdown(rows: list[Row], job: str | None) -> str:
    """The rows as the page `benchmarks/RESULTS.md`."""
    command = "hairloom bench" + (f" {job}" if job else "")
    lines = [
        "# Benchmark results",
        "",
        f"`{command} --out benchmarks/RESULTS.md`; {machine()}. Seconds are the best of several runs, kernels warm.",
        "",
        "| " + " | ".join(COLUMNS) + " |",
        "|" + "---|" * len(COLUMNS),
    ]
    for row in rows:
        cells = [row.get(column) for column in COLUMNS]
        lines.append(
            "| " + " | ".join("" if c is None else f"{c:.4g}" if isinstance(c, float) else str(c) for c in cells) + " |"
        )
    return "\n".join(lines) + "\n"
