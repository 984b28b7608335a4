"""Numbers in text files, parsed as whole arrays."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..types import Bools, Float64
from .files import damaged


def token_starts(text: bytes) -> Bools:
    """(len(text),) bool, true where a run of characters other than white space begins."""
    solid = np.frombuffer(text, dtype=np.uint8) > 32
    starts = solid.copy()
    starts[1:] &= ~solid[:-1]
    return starts


def tokens_before(text: bytes, positions: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many tokens begin before each byte position."""
    return np.searchsorted(np.flatnonzero(token_starts(text)), positions)


def parse_numbers(path: Path, text: bytes, text_offset: int = 0) -> Float64:
    """All the numbers of a text of numbers and white space.

    Raises
    ------
    FileError : a token that is no number; its byte is counted from `text_offset`.
    """
    starts = np.flatnonzero(token_starts(text))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # numpy's word for the stop at a bad token, checked below
        try:
            numbers = np.fromstring(text, dtype=np.float64, sep=" ") if len(starts) else np.zeros(0)
        except ValueError:
            numbers = np.zeros(0)
    if len(numbers) != len(starts):
        bad = int(starts[min(len(numbers), len(starts) - 1)])
        token = text[bad : bad + 24].split()[0].decode("ascii", "replace")
        raise damaged(path, f"{token!r} is no number", text_offset + bad)
    return numbers
