"""Compiled loops over groups of strands."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..kernels import kernel
from ..types import Int32


@kernel
def list_members(labels: Int32, n_wisps: int) -> Any:
    """Members of every wisp: starts (k + 1,) int32 and members (S,) int32, in rising order within a wisp."""
    starts = np.zeros(n_wisps + 1, np.int32)
    for label in labels:
        starts[label + 1] += 1
    for i in range(n_wisps):
        starts[i + 1] += starts[i]
    fill = starts[:-1].copy()
    members = np.empty(labels.shape[0], np.int32)
    for strand in range(labels.shape[0]):
        label = labels[strand]
        members[fill[label]] = strand
        fill[label] += 1
    return starts, members
