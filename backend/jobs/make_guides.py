"""The job `make_guides`."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import require
from ..geometry.strands import strand_lengths
from ..progress import Progress, subrange
from ..rods.guides import GuideParams, choose_guides
from ..synthesis.hierarchy import HierarchyParams
from ..synthesis.pipeline import SynthesisParams, analyze
from ..synthesis.wisps import WispParams
from ..types import Head, Int32, StrandSet

Values = dict[str, Any]


def run(inputs: Values, params: GuideParams, progress: Progress) -> Values:
    """Guides by the clustering of Wang et al. 2009 (B-16, M-22).

    strands, head, or labels (S,) int32 of wisps that are there already instead of head
    -> guides (G,) int32 strand indices, wisps (S,) int32 the guide of each strand, an index of guides; report.
    """
    strands, labels = inputs["strands"], inputs.get("labels")
    require(strands.n_strands > 0, "the groom has no strands; choose one that has")
    if labels is None:
        require(inputs.get("head") is not None, "the job needs a head, or the labels of wisps")
        labels = wisp_labels(strands, inputs["head"], params, subrange(progress, 0.0, 0.95))
    progress(0.95, "Choosing guides")
    guides, wisps = choose_guides(strands, labels)
    sizes = np.bincount(wisps, minlength=len(guides))
    lengths = strand_lengths(strands)[guides]
    return {
        "guides": guides,
        "wisps": wisps,
        "report": {
            "strands": strands.n_strands,
            "guides": len(guides),
            "strands_per_guide": [int(sizes.min()), float(np.median(sizes)), int(sizes.max())],
            "guide_length": [float(lengths.min()), float(np.median(lengths)), float(lengths.max())],
        },
    }


def wisp_labels(strands: StrandSet, head: Head, params: GuideParams, progress: Progress) -> Int32:
    """(S,) int32: the wisp of each strand, n_guides wisps in all or as many as there are strands."""
    if params.n_guides >= strands.n_strands:
        return np.arange(strands.n_strands, dtype=np.int32)
    wisps = WispParams(
        n_wisps=params.n_guides,
        adaptive=False,
        max_iterations=params.max_iterations,
        seeds_per_wisp=params.seeds_per_wisp,
        seed=params.seed,
    )
    hierarchy = HierarchyParams(n_levels=2, wisps=wisps)
    settings = SynthesisParams(n_samples=params.n_samples, hierarchy=hierarchy)
    return analyze(strands, head, settings, progress=progress).hierarchy.labels[0]
