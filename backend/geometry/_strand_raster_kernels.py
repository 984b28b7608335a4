"""Kernel of `strand_raster`: strands as round lines in a z-buffer, in bands of rows, each the work of one thread."""

from __future__ import annotations

import numpy as np
from numba import prange

from ..kernels import parallel_kernel
from ..types import Float32, Float64, Int32

BAND = 32  # rows


@parallel_kernel
def draw_segments(pixels: Float64, starts: Int32, half_width: float, depth: Float32, segment: Int32) -> None:
    """Draw the lines from point `starts[i]` to the next one; `pixels` (P, 3) x, y, depth.

    A pixel is covered where its middle is at most `half_width` from the line. `depth` comes with what hides strands and
    `segment` with -1; the latter gets i where line i is nearest, of equally deep ones the first.
    """
    height, width = segment.shape
    for band in prange((height + BAND - 1) // BAND):
        top, bottom = band * BAND, min(height, (band + 1) * BAND)
        for index in range(len(starts)):
            a, b = pixels[starts[index]], pixels[starts[index] + 1]
            low, high = min(a[1], b[1]) - half_width, max(a[1], b[1]) + half_width
            if not (high >= top and low <= bottom):  # NaN, behind the camera, is refused too
                continue
            along_x, along_y, deeper = b[0] - a[0], b[1] - a[1], b[2] - a[2]
            square = along_x * along_x + along_y * along_y
            if not np.isfinite(square):
                continue
            reach = half_width * np.sqrt(square)
            first, last = max(top, int(np.ceil(low - 0.5))), min(bottom - 1, int(np.floor(high - 0.5)))
            for row in range(first, last + 1):
                y = row + 0.5 - a[1]
                left, right = min(a[0], b[0]) - half_width, max(a[0], b[0]) + half_width
                if abs(along_y) > 1e-9:  # the strip around the endless line
                    middle = a[0] + y * along_x / along_y
                    left, right = max(left, middle - reach / abs(along_y)), min(right, middle + reach / abs(along_y))
                first_column = max(0, int(np.ceil(left - 0.5)))
                for column in range(first_column, min(width - 1, int(np.floor(right - 0.5))) + 1):
                    x = column + 0.5 - a[0]
                    share = min(max((x * along_x + y * along_y) / square, 0.0), 1.0) if square > 0.0 else 0.0
                    aside_x, aside_y = x - share * along_x, y - share * along_y
                    if aside_x * aside_x + aside_y * aside_y > half_width * half_width:
                        continue
                    deep = np.float32(a[2] + share * deeper)
                    if deep < depth[row, column]:
                        depth[row, column] = deep
                        segment[row, column] = index
