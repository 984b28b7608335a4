"""The job `save_detail`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ..errors import require
from ..progress import Progress, subrange
from ..synthesis.details import SMALL, Detail, reduce_details, write_detail
from ..synthesis.pipeline import SynthesisParams, analyze

Values = dict[str, Any]


@dataclass(frozen=True, slots=True)
class SaveDetailParams:
    """Settings of the job: where to, the name that artists see, and how large the asset may be."""

    path: str = ""
    name: str = ""
    n_strands: int = SMALL
    analysis: SynthesisParams = field(default_factory=SynthesisParams)


def run(inputs: Values, params: SaveDetailParams, progress: Progress) -> Values:
    """hierarchy, or strands and head -> hierarchy (reduced), report; written to params.path unless that is empty."""
    hierarchy = inputs.get("hierarchy")
    if hierarchy is None:
        require("strands" in inputs and "head" in inputs, "the job needs a hierarchy, or strands and a head")
        part = subrange(progress, 0.0, 0.9)
        hierarchy = analyze(inputs["strands"], inputs["head"], params.analysis, progress=part).hierarchy
    progress(0.9, "Choosing strands")
    small = reduce_details(hierarchy, params.n_strands)
    if params.path:
        write_detail(params.path, Detail(params.name, small))
    return {"hierarchy": small, "report": {"levels": [level.n_strands for level in small.levels]}}
