"""The job `fit_helices`."""

from __future__ import annotations

from typing import Any

from ..errors import require
from ..progress import Progress
from ..rods.fitting import FitParams, fit_helices
from ..types import StrandSet

Values = dict[str, Any]


def run(inputs: Values, params: FitParams, progress: Progress) -> Values:
    """Input: `strands`, world space. Outputs: fit (HelixFit), report."""
    strands = inputs.get("strands")
    require(isinstance(strands, StrandSet), "the input 'strands' is missing; give the guides to fit")
    assert isinstance(strands, StrandSet)
    fit = fit_helices(strands, params, progress=progress)
    return {"fit": fit, "report": fit.report(strands)}
