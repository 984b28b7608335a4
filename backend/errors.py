"""The errors that callers are meant to catch; anything else is a bug and keeps its traceback."""

from __future__ import annotations


class HairloomError(Exception):
    """Base of the errors whose one-line message is written for the user."""


class InputError(HairloomError):
    """Bad input, refused before anything changed: names the thing, the value and the remedy."""


class FileError(HairloomError):
    """A file that cannot be read or written: names the file, the offset where known, and the reason."""


class Cancelled(HairloomError):
    """The user cancelled; raised by a progress callback, and nothing was changed."""


def require(condition: object, message: str) -> None:
    """Raise `InputError(message)` unless `condition` is true."""
    if not condition:
        raise InputError(message)
