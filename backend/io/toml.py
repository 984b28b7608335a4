"""TOML files that users write: projects and scenes."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import FileError, require
from .files import read_file

Table = Mapping[str, Any]


def read_toml(path: Path) -> dict[str, Any]:
    """The file's tables. Raises FileError: missing, or no TOML."""
    try:
        return tomllib.loads(read_file(path).decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise FileError(f"{path} is not a TOML file: {error}") from error


def check_names(table: Any, known: set[str], what: str) -> None:
    """Refuse what is no table, or has a name that is not known; errors call it `what`."""
    require(isinstance(table, Mapping), f"{what} must be a table of settings, not {table!r}")
    for name in table:
        require(name in known, f"{what} has no setting '{name}'; it has {', '.join(sorted(known))}")
