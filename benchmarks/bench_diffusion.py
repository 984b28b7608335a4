"""Diffusion on voxels beside SciPy (performance.md, row h).

Three components from scattered known voxels, 3 % and 0.03 % of the grid, to a residual of 1e-5, set-up included.
SciPy's conjugate gradients with Jacobi solve one component; their time is multiplied by three, the assembly is not.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from hairloom.fields.diffusion import diffuse
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.linalg import LinearOperator, cg

Row = dict[str, Any]
TARGET = 0.25


def best(work: Callable[[], object], repeats: int) -> float:
    """Seconds of the fastest run."""
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def assemble(fixed: np.ndarray) -> csr_array:
    """The Laplacian of the whole box; its rows of fixed voxels are cut out by the caller."""
    number = np.arange(fixed.size, dtype=np.int32).reshape(fixed.shape)
    pairs = [
        np.stack([np.moveaxis(number, a, 0)[:-1].ravel(), np.moveaxis(number, a, 0)[1:].ravel()]) for a in range(3)
    ]
    a, b = np.concatenate(pairs, axis=1)
    ones = np.ones(2 * len(a), np.float32)
    adjacency = coo_array((ones, (np.concatenate([a, b]), np.concatenate([b, a]))), shape=(fixed.size, fixed.size))
    return csr_array(diags_array(adjacency.sum(axis=1)) - adjacency.tocsr())


def scipy_seconds(values: np.ndarray, fixed: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Seconds of the assembly, seconds of one component, and that component."""
    start = time.perf_counter()
    matrix = assemble(fixed)
    free, held = np.flatnonzero(~fixed), np.flatnonzero(fixed)
    inner = matrix[free][:, free]
    right = -matrix[free][:, held] @ values[..., 0].ravel()[held]
    middle = time.perf_counter()
    inverse = 1.0 / inner.diagonal()
    found, _ = cg(inner, right, rtol=1e-5, M=LinearOperator(inner.shape, lambda r: inverse * r))
    out = values[..., 0].ravel().copy()
    out[free] = found
    return middle - start, time.perf_counter() - middle, out.reshape(fixed.shape)


def run(quick: bool) -> list[Row]:
    """Our seconds and, when not quick, SciPy's for the same three components."""
    shape = (60, 40, 40) if quick else (200, 100, 100)
    rng = np.random.default_rng(0)
    rows: list[Row] = []
    for share in (0.03, 0.0003):
        fixed = rng.random(shape) < share
        values = rng.normal(size=(*shape, 3)).astype(np.float32)
        found = diffuse(values, fixed)  # compiles
        seconds = best(partial(diffuse, values, fixed), 2 if quick else 7)
        size = f"{shape[0]} x {shape[1]} x {shape[2]}, {share:.2%} known, 3 components"
        note = f"{found.iterations} iterations, residual {found.residuals.max():.1e}"
        rows.append({"size": size, "who": "hairloom", "seconds": seconds, "target": TARGET, "note": note})
        if not quick:
            assembly, solving, theirs = scipy_seconds(values, fixed)
            apart = float(np.abs(theirs - found.values[..., 0]).max())
            total = assembly + 3 * solving
            note = f"assembly {assembly:.2f} s + 3 x {solving:.2f} s; {total / seconds:.0f} x ours; apart {apart:.1e}"
            rows.append({"size": size, "who": "scipy cg + Jacobi", "seconds": total, "note": note})
    return rows
