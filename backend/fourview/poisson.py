"""Blending of views and the screened Poisson equation on the texels of a surface (Zhang et al. 2017, algorithm 1).

The texels are a graph whose edges run over chart seams too (`texels.TexelMap`), so seams are like any other place.
"""

from __future__ import annotations

import numpy as np

from ..errors import require
from ..types import Float32, Int32, check_array
from ._poisson_kernels import add_divergence, blend_texels, chebyshev_step, write_neighbours


def blend_views(colours: Float32, alpha: Float32, edges: Int32) -> tuple[Float32, Float32]:
    """Blend textures that were made from one view each: colours by weight, gradients from the strongest (Z-13).

    Parameters
    ----------
    colours : (n, T, 3) float32. alpha : (n, T) float32, sum 1 over the views (Z-14; where all are 0, the result is
        black). edges : (E, 2) int32, sorted by their first texel, as in `TexelMap`.

    Returns
    -------
    blended : (T, 3) float32, sum_i alpha_i I_i. gradients : (E, 3) float32, step along each edge in the view with the
        greatest alpha_i |grad I_i| at the edge's first texel; |grad I_i|^2 is summed over the edges that start there.
    """
    check_array("colours", colours, np.float32, (None, None, 3))
    check_array("alpha", alpha, np.float32, colours.shape[:2])
    count = colours.shape[1]
    first_edges = np.searchsorted(edges[:, 0], np.arange(count + 1)).astype(np.int32)
    blended, gradients = np.empty((count, 3), np.float32), np.empty((len(edges), 3), np.float32)
    blend_texels(colours, alpha, edges, first_edges, blended, gradients)
    return blended, gradients


class PoissonSolver:
    """Solves (w - Laplacian) I = w C - div G on a graph of texels (Bhat et al. 2008; Z-13, M-36); built once a scale.

    I minimises the sum over texels of w |I - C|^2 and over edges of |I_b - I_a - G_ab|^2. Chebyshev iteration with the
    diagonal as preconditioner, whose spectrum is known: no sums over texels, so the result is the same for any number
    of threads; and since the wanted colours are the start, a few steps are enough.
    """

    def __init__(self, edges: Int32, n_texels: int, screen_weight: float = 0.1, tolerance: float = 0.05) -> None:
        """edges : (E, 2) int32, each once. screen_weight : w > 0, pull towards the colours against that of one edge.

        tolerance : what may be left of the distance between start and solution, in the norm that the iteration bounds.
        """
        check_array("edges", edges, np.int32, (None, 2))
        require(screen_weight > 0, f"the screen weight is {screen_weight}; it must be above 0")
        require(0 < tolerance < 1, f"the tolerance is {tolerance}; it must be between 0 and 1")
        self.n_texels, self.screen_weight = n_texels, float(screen_weight)
        self._edges = edges
        degrees = np.bincount(edges.ravel(), minlength=n_texels)
        most = int(degrees.max(initial=1))
        self._neighbours = np.repeat(np.arange(n_texels, dtype=np.uint32)[:, None], most, axis=1)
        write_neighbours(edges, self._neighbours, np.zeros(n_texels, np.int32))
        self._inverse_diagonal = (1.0 / (screen_weight + degrees)).astype(np.float32)
        # eigenvalues of A / diagonal: w / (w + degree) to less than 2
        self._low = screen_weight / (screen_weight + most)
        ratio = (2.0 + self._low) / (2.0 - self._low)
        self.n_steps = int(np.ceil(np.arccosh(1.0 / tolerance) / np.arccosh(ratio)))

    def solve(self, colours: Float32, gradients: Float32) -> Float32:
        """(T, 3) float32 from wanted colours (T, 3) and steps along the edges (E, 3, second - first), both float32."""
        check_array("colours", colours, np.float32, (self.n_texels, 3))
        check_array("gradients", gradients, np.float32, (len(self._edges), 3))
        right_side = np.float32(self.screen_weight) * colours
        add_divergence(self._edges, gradients, right_side)
        values, spare, steps = colours.copy(), np.empty_like(colours), np.zeros_like(colours)
        middle, half = 0.5 * (2.0 + self._low), 0.5 * (2.0 - self._low)
        sigma = middle / half
        rho, keep, add = 1.0 / sigma, 0.0, 1.0 / middle
        for _ in range(self.n_steps):
            chebyshev_step(
                self._neighbours,
                self._inverse_diagonal,
                np.float32(self.screen_weight),
                right_side,
                np.float32(keep),
                np.float32(add),
                values,
                steps,
                spare,
            )
            values, spare = spare, values
            following = 1.0 / (2.0 * sigma - rho)
            keep, add = following * rho, 2.0 * following / half
            rho = following
        return values
