"""The job `warm_up`."""

from __future__ import annotations

from typing import Any

from ..progress import Progress
from ..warm_up import compile_all

Values = dict[str, Any]


def run(inputs: Values, params: None, progress: Progress) -> Values:
    """Nothing -> report: the number of compiled kernels."""
    return {"report": {"kernels": compile_all(progress)}}
