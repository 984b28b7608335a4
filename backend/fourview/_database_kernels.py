"""Compiled parts of `database_masks`."""

from __future__ import annotations

import numpy as np

from ..kernels import kernel
from ..types import Float32, Float64
from .views import UInt8


@kernel
def mark_strands(seen: Float64, head_depth: Float32, tolerance: float, mask: UInt8) -> None:
    """Set the pixels of `mask` (H, W) that strands cover where they are not behind the head.

    seen : (S, N, 3) float64, x and y in pixels, depth in metres; points that are NaN hide their segments.
    head_depth : (H, W) float32, metres. tolerance : metres that hair may lie behind the head.
    """
    height, width = mask.shape
    for strand in range(seen.shape[0]):
        for point in range(seen.shape[1] - 1):
            x, y, z = seen[strand, point]
            step_x, step_y, step_z = seen[strand, point + 1] - seen[strand, point]
            longest = max(abs(step_x), abs(step_y))
            if not longest < 1e5:
                continue
            count = int(np.ceil(longest)) + 1
            for sample in range(count):
                share = sample / count
                column, row = int(np.floor(x + share * step_x)), int(np.floor(y + share * step_y))
                inside = 0 <= column < width and 0 <= row < height
                if inside and z + share * step_z <= head_depth[row, column] + tolerance:
                    mask[row, column] = 1
