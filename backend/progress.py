"""Progress reporting: a callable of (fraction in [0, 1], message) that may raise `Cancelled`."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Called with the finished fraction and what is being done; raises `Cancelled` to stop the work."""

    def __call__(self, fraction: float, message: str, /) -> None: ...


def _ignore(fraction: float, message: str, /) -> None:
    pass


NO_PROGRESS: Progress = _ignore


def subrange(progress: Progress, start: float, end: float) -> Progress:
    """The part [start, end] of `progress` as a progress of its own, for one stage of a longer job."""

    def part(fraction: float, message: str, /) -> None:
        progress(start + (end - start) * fraction, message)

    return part
