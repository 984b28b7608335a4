"""Guides: the strands of a groom that are simulated, one for each wisp (Bao & Qi 2017, sec. VI; B-16, M-22)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import require
from ..geometry.strands import resample, strand_lengths
from ..types import Float64, Int32, StrandSet, check_array

_N_COMPARED = 16  # points of a strand that its wisp's mean is made of
_SHORTEST = 1e-4  # m; shorter strands have no shape that could be simulated


@dataclass(frozen=True, slots=True)
class GuideParams:
    """Settings of the job that makes guides.

    n_guides : wisps that the hair is clustered into, each with one guide; all strands where there are fewer.
    n_samples : points of a strand that the clustering looks at. max_iterations : Lloyd iterations of it, at most.
    seeds_per_wisp : random first seeds for each wisp. seed : of them.
    """

    n_guides: int = 1000
    n_samples: int = 32
    max_iterations: int = 40
    seeds_per_wisp: int = 16
    seed: int = 0

    def __post_init__(self) -> None:
        require(1 <= self.n_guides <= 1_000_000, f"n_guides is {self.n_guides}; it must be in 1..1000000")
        require(4 <= self.n_samples <= 512, f"n_samples is {self.n_samples}; it must be in 4..512")
        require(self.max_iterations >= 1, f"max_iterations is {self.max_iterations}; it must be 1 or more")
        require(self.seeds_per_wisp >= 1, f"seeds_per_wisp is {self.seeds_per_wisp}; it must be 1 or more")


def choose_guides(strands: StrandSet, labels: Int32) -> tuple[Int32, Int32]:
    """The guide of each wisp: of its strands the one nearest to their mean (B-16), so that it is hair of the artist's.

    Strands are compared in the space of `strands`, point by point at equal steps of arc length, so that a guide lies in
    the middle of its wisp. Of strands that are equally near, the first. Strands without length are no guides.

    Parameters
    ----------
    strands : S strands. labels : (S,) int32, 0 or more, the wisp of each strand; numbers may be left out.

    Returns
    -------
    guides : (G,) int32, rising with the wisps' numbers, the strand that each guide is.
    wisps : (S,) int32, which of the guides is that of a strand's wisp; strands of a wisp without length are with the
        nearest guide.

    Raises
    ------
    InputError : no strands, or none with a length; labels that do not fit.
    """
    require(strands.n_strands > 0, "the groom has no strands; choose one that has")
    check_array("labels", labels, np.int32, (strands.n_strands,))
    require(labels.min() >= 0, "a strand's wisp is below 0; cluster the hair again")
    usable = strand_lengths(strands) > _SHORTEST
    require(usable.any(), "every strand is shorter than 0.1 mm; guides need length")
    # wisps that have a usable strand are numbered anew
    members = np.flatnonzero(usable)
    kept, inverse = np.unique(labels[members], return_inverse=True)
    wisp = inverse.reshape(-1)  # numpy 2.0 gives it another shape
    points = resample(strands, _N_COMPARED).reshape(strands.n_strands, -1)[members].astype(np.float64)
    distances = _distances_to_means(points, wisp, len(kept))
    order = np.lexsort((members, distances, wisp))
    firsts = np.searchsorted(wisp[order], np.arange(len(kept)))
    guides = members[order[firsts]].astype(np.int32)
    number = np.full(labels.max() + 1, -1, np.int32)
    number[kept] = np.arange(len(kept))
    wisps = number[labels]
    lost = np.flatnonzero(wisps < 0)
    if len(lost):
        offsets = strands.roots[lost, None, :].astype(np.float64) - strands.roots[guides][None, :, :]
        wisps[lost] = np.einsum("lgx,lgx->lg", offsets, offsets).argmin(axis=1)
    wisps[guides] = np.arange(len(guides))
    return guides, wisps


def _distances_to_means(points: Float64, wisp: NDArray[np.int64], n_wisps: int) -> Float64:
    """(n,) squared distances of rows (n, D) to the means of their wisps (n,)."""
    order = np.argsort(wisp, kind="stable")
    firsts = np.searchsorted(wisp[order], np.arange(n_wisps))
    means = np.add.reduceat(points[order], firsts, axis=0) / np.bincount(wisp, minlength=n_wisps)[:, None]
    offsets = points - means[wisp]
    return np.asarray(np.einsum("nd,nd->n", offsets, offsets))
