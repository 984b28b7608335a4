"""The job `cluster_wisps`."""

from __future__ import annotations

from typing import Any

from ..geometry.scalp_space import unroot_strands
from ..progress import Progress
from ..synthesis.pipeline import SynthesisParams, analyze
from ..types import Int32, WispHierarchy

Values = dict[str, Any]


def labels_of_strands(hierarchy: WispHierarchy) -> tuple[Int32, ...]:
    """Per coarser level, (S_0,) int32: the wisp that each strand of level 0 belongs to."""
    chained: list[Int32] = []
    for labels in hierarchy.labels:
        chained.append(labels if not chained else labels[chained[-1]])
    return tuple(chained)


def run(inputs: Values, params: SynthesisParams, progress: Progress) -> Values:
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
