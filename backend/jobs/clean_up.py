"""The job `clean_up`."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from ..geometry.cleanup import CleanUpParams, clean_up
from ..progress import Progress

Values = dict[str, Any]


def run(inputs: Values, params: CleanUpParams, progress: Progress) -> Values:
    """strands, head -> strands, report."""
    strands, report = clean_up(inputs["strands"], inputs["head"], params, progress=progress)
    return {"strands": strands, "report": asdict(report)}
