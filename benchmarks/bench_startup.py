"""Start-up: importing Hairloom, the first job from cached kernels, and compiling all kernels into an empty cache."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from typing import Any


def _seconds(code: str, **environment: str) -> float:
    """Wall time inside a fresh process that runs `code`, less the start of the interpreter and numpy."""
    program = f"import time, numpy\nsince = time.perf_counter()\n{code}\nprint(time.perf_counter() - since)"
    done = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True, env={**os.environ, **environment}
    )
    return float(done.stdout.split()[-1])


def run(*, quick: bool = False) -> list[dict[str, Any]]:
    """Rows for `hairloom bench startup`."""
    warm = "from hairloom.warm_up import compile_all; compile_all()"
    import_all = "import hairloom.registry"
    rows = [
        {"size": "import hairloom.registry", "seconds": min(_seconds(import_all) for _ in range(3)), "target": None},
    ]
    with tempfile.TemporaryDirectory() as cache:
        if not quick:
            cold = _seconds(warm, NUMBA_CACHE_DIR=cache)
            rows.append({"size": "all kernels, empty cache", "seconds": cold, "target": 25.0})
        else:
            _seconds(warm, NUMBA_CACHE_DIR=cache)
        since = time.perf_counter()
        _seconds(warm, NUMBA_CACHE_DIR=cache)
        rows.append(
            {"size": "process start to end of a tiny synthesis, cached", "seconds": time.perf_counter() - since}
        )
    return [{"who": "hairloom", "target": None, "note": "", **row} for row in rows]
