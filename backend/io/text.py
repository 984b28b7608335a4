"""Text files of numbers, parsed as whole arrays: a 200 MB file takes seconds, not minutes."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import FileError
from ..types import Bools, Float64
from .files import damaged

Indices = NDArray[np.int64]
_SLASH, _SPACE, _NEWLINE = 47, 32, 10


def token_starts(text: bytes) -> Bools:
    """(len(text),) bool, true where a run of characters other than white space begins."""
    solid = np.frombuffer(text, dtype=np.uint8) > _SPACE
    starts = solid.copy()
    starts[1:] &= ~solid[:-1]
    return starts


def parse_numbers(path: Path, text: bytes, locate: Callable[[int], int] = int) -> Float64:
    """All the numbers of a text of numbers and white space.

    Parameters
    ----------
    locate : takes a byte of `text` to its byte in the file, for the error.

    Raises
    ------
    FileError : a token that is no number.
    """
    starts = np.flatnonzero(token_starts(text))
    numbers = _numbers_or_none(text, len(starts))
    if numbers is None:
        bad = int(starts[_first_bad_token(text, starts)])
        token = text[bad : bad + 24].split()[0].decode("ascii", "replace")
        raise damaged(path, f"{token!r} is no number", locate(bad))
    return numbers


def _numbers_or_none(text: bytes, count: int) -> Float64 | None:
    """The numbers of a text of `count` tokens; None when one of them is no number."""
    if not count:
        return np.zeros(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # numpy 1 warns at a bad token, numpy 2.5 raises
        try:
            numbers = np.fromstring(text, dtype=np.float64, sep=" ")
        except (ValueError, DeprecationWarning):
            return None
    return numbers if len(numbers) == count else None


def _first_bad_token(text: bytes, starts: Indices) -> int:
    """Which token is the first that is no number, found by halving; there is one."""
    good, bad = 0, len(starts)  # the tokens before `good` are numbers, and not all before `bad` are
    while bad - good > 1:
        middle = (good + bad) // 2
        if _numbers_or_none(text[starts[good] : starts[middle]], middle - good) is not None:
            good = middle
        else:
            bad = middle
    return good


class KeywordLines:
    """A text of lines that begin with a keyword, as .obj has them, split into tokens once.

    Comments (#) and the content of continued lines (a backslash at the end) are taken care of; byte offsets in
    errors are those of the text without comments.

    Attributes
    ----------
    path, text : the file, and its text with comments and carriage returns removed.
    tokens : (T,) int64, byte where each token begins.
    lines : (L + 1,) int64, index in `tokens` of each line's keyword, and T. Lines without tokens are left out.
    """

    def __init__(self, path: Path, data: bytes) -> None:
        self.path = path
        text = data.replace(b"\\\r\n", b"   ").replace(b"\\\n", b"  ").replace(b"\r", b"\n")
        self.text = re.sub(rb"#[^\n]*", b"", text) if b"#" in text else text
        self.tokens: Indices = np.flatnonzero(token_starts(self.text))
        newlines = np.flatnonzero(np.frombuffer(self.text, dtype=np.uint8) == _NEWLINE)
        is_first = np.zeros(len(self.tokens) + 1, dtype=np.bool_)
        is_first[np.searchsorted(self.tokens, newlines)] = True
        is_first[[0, -1]] = True
        self.lines: Indices = np.flatnonzero(is_first)

    @property
    def n_lines(self) -> int:
        return len(self.lines) - 1

    def find(self, keyword: str) -> Indices:
        """The lines that begin with `keyword`."""
        places = self.tokens[self.lines[:-1]]
        characters = np.frombuffer(self.text + b"\n" * 16, dtype=np.uint8)
        found = characters[places + len(keyword)] <= _SPACE
        for i, character in enumerate(keyword.encode()):
            found &= characters[places + i] == character
        return np.flatnonzero(found)

    def words(self, line: int) -> list[str]:
        """The tokens of a line after its keyword."""
        start, end = (self._byte(self.lines[i]) for i in (line, line + 1))
        return self.text[start:end].decode("utf-8", "replace").split()[1:]

    def n_values(self, lines: Indices) -> Indices:
        """(n,) how many tokens follow the keyword of each line."""
        return np.diff(self.lines)[lines] - 1

    def numbers(self, lines: Indices, least: int) -> tuple[Float64, Indices]:
        """The numbers after the keyword of the given lines, one after another, and how many of them each line has.

        Raises
        ------
        FileError : a token that is no number, or a line with less than `least` of them.
        """
        text, mask = self._body(lines)
        counts = self.n_values(lines)
        if len(counts) and counts.min() < least:
            raise self.error(int(lines[np.argmin(counts)]), f"needs {least} numbers")
        return parse_numbers(self.path, text, lambda bad: int(np.flatnonzero(mask)[bad])), counts

    def references(self, lines: Indices, least: int) -> tuple[Indices, Indices, Indices]:
        """The `v`, `v/vt`, `v//vn` or `v/vt/vn` tokens of the given lines.

        Returns
        -------
        v, vt : (n,) int64 as written (from 1, or negative); vt 0 where it is not given.
        counts : (lines,) tokens of each line.
        """
        text, _ = self._body(lines)
        counts = self.n_values(lines)
        if len(counts) and counts.min() < least:
            raise self.error(int(lines[np.argmin(counts)]), f"needs {least} vertices")
        text = text.replace(b"//", b"/0/")
        characters = np.frombuffer(text + b" ", dtype=np.uint8)
        is_slash = characters[:-1] == _SLASH
        plain = np.where(is_slash, _SPACE, characters[:-1]).astype(np.uint8)
        is_slash &= characters[1:] > _SPACE  # "1/" names no texture coordinate
        numbers = parse_numbers(self.path, plain.tobytes())
        if not (np.abs(numbers) < 2**31).all() or (numbers != np.rint(numbers)).any():
            raise FileError(f"cannot read {self.path}: a vertex number of a face or line is no whole number")
        starts = np.flatnonzero(token_starts(text))
        slashes = np.flatnonzero(is_slash)
        slashes_before = np.searchsorted(slashes, starts)
        first = np.arange(len(starts)) + slashes_before
        n_slashes = np.diff(np.append(slashes_before, len(slashes)))
        if len(numbers) != len(starts) + len(slashes):
            raise FileError(f"cannot read {self.path}: a face or line has a stray '/'")
        whole = np.append(numbers, 0.0).astype(np.int64)
        return whole[first], np.where(n_slashes > 0, whole[np.minimum(first + 1, len(numbers))], 0), counts

    def error(self, line: int, reason: str) -> FileError:
        """The error of a line: its keyword, its place and `reason`."""
        start = self._byte(self.lines[line])
        keyword = self.text[start : start + 20].split()[0].decode("ascii", "replace")
        return damaged(self.path, f"the line '{keyword} ...' {reason}", start)

    def _byte(self, token: np.int64) -> int:
        return int(self.tokens[token]) if token < len(self.tokens) else len(self.text)

    def _body(self, lines: Indices) -> tuple[bytes, Bools]:
        """The text of the lines without their keywords of one or two characters, and where it stands in `text`."""
        chosen = np.zeros(self.n_lines, dtype=np.bool_)
        chosen[lines] = True
        starts = self.tokens[self.lines[:-1]]
        mask = np.zeros(len(self.text), dtype=np.bool_)
        if len(starts):
            mask[starts[0] :] = np.repeat(chosen, np.diff(np.append(starts, len(self.text))))
        keywords = starts[lines]
        mask[keywords] = False
        mask[np.minimum(keywords + 1, len(self.text) - 1)] = False  # its second character, or white space
        return np.frombuffer(self.text, dtype=np.uint8)[mask].tobytes(), mask
