"""The job `synthesize`."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from ..progress import Progress, subrange
from ..synthesis.pipeline import SynthesisParams, analyze, synthesize_from
from ..synthesis.statistics import compare_styles

Values = dict[str, Any]


def run(inputs: Values, params: SynthesisParams, progress: Progress) -> Values:
    """strands, head, region (or None) -> strands, surface_triangle, surface_barycentric, report."""
    head = inputs["head"]
    example = analyze(inputs["strands"], head, params, progress=subrange(progress, 0.0, 0.3))
    result = synthesize_from(example, head, params, region=inputs.get("region"), progress=subrange(progress, 0.3, 0.95))
    progress(0.95, "Comparing the styles")
    style = compare_styles(example.hierarchy.levels[0], result.levels[0], seed=params.seed)
    return {
        "strands": result.strands,
        "surface_triangle": result.roots.triangles,
        "surface_barycentric": np.asarray(result.roots.barycentric, dtype=np.float32),
        "report": {
            "strands": result.strands.n_strands,
            "levels": [level.n_strands for level in result.levels],
            "texture_energy": result.texture_energies[-1],
            "refinement": [asdict(report) for report in result.refine_reports],
            "style": asdict(style),
        },
    }
