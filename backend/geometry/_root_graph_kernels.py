"""Compiled loops of the neighbourhood of roots."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..kernels import kernel
from ..types import Float64


@kernel
def second_shortest(edges: Any, lengths: Float64, count: int) -> Any:
    """The second least length of the edges (E, 2) at each of `count` nodes, (count,) float64; inf for less than two."""
    least = np.full(count, np.inf)
    second = np.full(count, np.inf)
    for e in range(edges.shape[0]):
        length = lengths[e]
        for side in range(2):
            node = edges[e, side]
            if length < least[node]:
                second[node] = least[node]
                least[node] = length
            elif length < second[node]:
                second[node] = length
    return second
