"""Fixtures that all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real hair and heads: HAIRLOOM_DATA, or shared/data beside the project."""
    folder = Path(os.environ.get("HAIRLOOM_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
    if not folder.is_dir():
        pytest.skip(f"the real test data is not at {folder}; set HAIRLOOM_DATA")
    return folder
