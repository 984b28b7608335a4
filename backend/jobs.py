"""What each job of the registry does: values of a bundle in, values of a bundle out."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from .geometry.cleanup import CleanUpParams, clean_up
from .geometry.scalp_space import unroot_strands
from .progress import Progress, subrange
from .synthesis.pipeline import SynthesisParams, analyze, synthesize_from
from .synthesis.statistics import compare_styles
from .types import Int32, WispHierarchy
from .warm_up import compile_all

Values = dict[str, Any]


def run_clean_up(inputs: Values, params: CleanUpParams, progress: Progress) -> Values:
    """strands, head -> strands, report."""
    strands, report = clean_up(inputs["strands"], inputs["head"], params, progress=progress)
    return {"strands": strands, "report": asdict(report)}


def labels_of_strands(hierarchy: WispHierarchy) -> tuple[Int32, ...]:
    """Per coarser level, (S_0,) int32: the wisp that each strand of level 0 belongs to."""
    chained: list[Int32] = []
    for labels in hierarchy.labels:
        chained.append(labels if not chained else labels[chained[-1]])
    return tuple(chained)


def run_cluster_wisps(inputs: Values, params: SynthesisParams, progress: Progress) -> Values:
    """strands, head -> hierarchy, labels and centers (StrandSet, world space) per coarser level, report."""
    example = analyze(inputs["strands"], inputs["head"], params, progress=progress)
    hierarchy = example.hierarchy
    return {
        "hierarchy": hierarchy,
        "labels": labels_of_strands(hierarchy),
        "centers": tuple(unroot_strands(level, example.space) for level in hierarchy.levels[1:]),
        "report": {
            "wisps": [level.n_strands for level in hierarchy.levels[1:]],
            "energies": [list(wisps.energies) for wisps in example.wisp_sets],
            "splits": [list(map(list, wisps.splits)) for wisps in example.wisp_sets],
            "largest_error": float(example.wisp_sets[0].errors.max()),
        },
    }


def run_synthesize(inputs: Values, params: SynthesisParams, progress: Progress) -> Values:
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


def run_warm_up(inputs: Values, params: None, progress: Progress) -> Values:
    """Nothing -> report: the number of compiled kernels."""
    return {"report": {"kernels": compile_all(progress)}}
