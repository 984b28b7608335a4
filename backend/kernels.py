"""How numba kernels are compiled: cached where a cache can be written, and never two at a time.

numba's `workqueue` threading layer (the fall-back on machines without TBB and OpenMP) aborts the whole process
when two threads are in parallel kernels at once, so every call from Python goes through one lock.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numba

_LOCK = threading.RLock()
KERNELS: list[Kernel] = []


def _compile(
    function: Callable[..., Any], parallel: bool, fastmath: set[str] | bool = False, inline: str = "never"
) -> Any:
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "parallel": parallel}
    options |= {"fastmath": fastmath, "inline": inline}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError as error:
        # numba's word for "neither the package folder nor a user cache folder can be written"
        if "cannot cache function" not in str(error):
            raise
        return numba.njit(cache=False, **options)(function)


class Kernel:
    """A compiled function to be called from Python, under the process-wide kernel lock."""

    def __init__(self, function: Callable[..., Any], parallel: bool) -> None:
        self.__doc__ = function.__doc__
        self.name = f"{function.__module__}.{function.__name__}"
        self.dispatcher = _compile(function, parallel)
        KERNELS.append(self)

    def __call__(self, *arguments: Any) -> Any:
        with _LOCK:
            return self.dispatcher(*arguments)


def kernel(function: Callable[..., Any]) -> Kernel:
    """Compile a serial kernel that Python calls."""
    return Kernel(function, parallel=False)


def parallel_kernel(function: Callable[..., Any]) -> Kernel:
    """Compile a kernel with `numba.prange` loops that Python calls; results must not depend on the thread count."""
    return Kernel(function, parallel=True)


def device(function: Callable[..., Any]) -> Any:
    """Compile a helper that only other kernels call."""
    return _compile(function, parallel=False)


def summing_device(function: Callable[..., Any]) -> Any:
    """Compile a `device` whose float sums may be re-ordered so that they use vector registers (3x for L2 distances).

    The order is fixed in the machine code, so results stay the same from run to run and for any thread count.
    """
    return _compile(function, parallel=False, fastmath={"reassoc", "contract"})


def inlined_device(function: Callable[..., Any]) -> Any:
    """A `device` whose body is copied into its callers; for inner loops where handing arrays over costs too much."""
    return _compile(function, parallel=False, inline="always")
