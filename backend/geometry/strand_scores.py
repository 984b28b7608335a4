"""How much of one groom is found in another: precision, recall and F-score of strands (as in Nam et al. 2019)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import require
from ..types import Float32, Float64, Int64, StrandSet
from ._strand_scores_kernels import match_points

PIECE = 0.002  # metres: strands are compared in pieces of at most this length
THRESHOLDS = ((0.002, 20.0), (0.003, 30.0), (0.004, 40.0))
MAX_CELLS = 20_000_000


@dataclass(frozen=True, slots=True)
class StrandScore:
    """What share of strand length agrees within `distance` metres and `angle_deg` degrees.

    precision : of the result, has a strand of the truth near. recall : of the truth, has a strand of the result near.
    """

    distance: float
    angle_deg: float
    precision: float
    recall: float

    @property
    def f_score(self) -> float:
        """Harmonic mean of precision and recall; 0 where both are."""
        total = self.precision + self.recall
        return 2.0 * self.precision * self.recall / total if total > 0 else 0.0


def strand_scores(
    result: StrandSet,
    truth: StrandSet,
    thresholds: Sequence[tuple[float, float]] = THRESHOLDS,
    *,
    signed: bool = False,
    max_samples: int = 60_000,
    seed: int = 0,
) -> tuple[StrandScore, ...]:
    """Compare strands with the true ones (cross-paper.md, ground truth).

    A place on a strand counts as found where some strand of the other set comes within a distance and runs within an
    angle of it; shares are of strand length. O(samples x pieces nearby).

    Parameters
    ----------
    thresholds : pairs of metres and degrees, up to 90 (180 when signed).
    signed : root to tip has to agree too; else only the line.
    max_samples : of each set at most so many pieces, chosen by `seed`, are looked up in the whole other set;
        the shares are then uncertain by 0.2 % (one standard deviation).

    Raises
    ------
    InputError : a threshold out of range, or strands without any length.
    """
    largest = 180.0 if signed else 90.0
    for distance, angle in thresholds:
        require(
            0 < distance <= 0.1 and 0 < angle <= largest,
            f"a threshold of {distance:g} m and {angle:g} degrees; take up to 0.1 m and {largest:g} degrees",
        )
    limits = np.array([[distance, np.cos(np.radians(angle))] for distance, angle in thresholds]).reshape(-1, 2)
    mine, others = _pieces(result, "result"), _pieces(truth, "truth")
    precision = _found_share(mine, others, limits, signed, max_samples, seed)
    recall = _found_share(others, mine, limits, signed, max_samples, seed)
    rows = zip(thresholds, precision, recall)
    return tuple(StrandScore(float(d), float(a), float(p), float(r)) for (d, a), p, r in rows)


def _pieces(strands: StrandSet, name: str) -> tuple[Float32, Float32]:
    """Starts and vectors (n, 3) of the strands' segments, cut into even pieces of at most PIECE."""
    inner = np.ones(len(strands.points), np.bool_)
    inner[strands.offsets[1:] - 1] = False
    first = np.flatnonzero(inner)
    starts = strands.points[first].astype(np.float64)
    vectors = strands.points[first + 1] - starts
    lengths = np.linalg.norm(vectors, axis=1)
    long = lengths > 1e-7
    starts, vectors, lengths = starts[long], vectors[long], lengths[long]
    require(len(starts) > 0, f"the strands of the {name} have no length; there is nothing to compare")
    counts = np.ceil(lengths / PIECE).astype(np.int64)
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    pieces = np.repeat(vectors / counts[:, None], counts, axis=0)
    cut = np.repeat(starts, counts, axis=0) + number[:, None] * pieces
    return cut.astype(np.float32), pieces.astype(np.float32)


def _found_share(
    samples: tuple[Float32, Float32],
    others: tuple[Float32, Float32],
    limits: Float64,
    signed: bool,
    max_samples: int,
    seed: int,
) -> Float64:
    starts, pieces = samples
    if len(starts) > max_samples:
        chosen = np.sort(np.random.default_rng(seed).choice(len(starts), max_samples, replace=False))
        starts, pieces = starts[chosen], pieces[chosen]
    lengths = np.linalg.norm(pieces, axis=1)
    matched = np.zeros((len(starts), len(limits)), np.bool_)
    if len(limits):
        grid, cell_starts, order = _cells(others, float(limits[:, 0].max()))
        middles, directions = starts + np.float32(0.5) * pieces, pieces / lengths[:, None]
        sorted_others = others[0][order], others[1][order]
        match_points(middles, directions, *sorted_others, cell_starts, grid, limits, signed, matched)
    return np.asarray((lengths[:, None] * matched).sum(axis=0, dtype=np.float64) / lengths.sum(dtype=np.float64))


def _cells(pieces: tuple[Float32, Float32], distance: float) -> tuple[tuple[Float64, float, Int64], Int64, Int64]:
    """The grid (origin, cell size, counts) over the pieces' middles, its CSR starts, and the pieces in its order."""
    middles = pieces[0] + np.float64(0.5) * pieces[1]
    origin = middles.min(axis=0)
    extent = middles.max(axis=0) - origin
    size = distance + 0.51 * PIECE
    while np.prod(np.floor(extent / size) + 1) > MAX_CELLS:  # hair that is strewn far: fewer, larger cells do too
        size *= 1.5
    counts = np.floor(extent / size).astype(np.int64) + 1
    cell = np.minimum(np.floor((middles - origin) / size).astype(np.int64), counts - 1)
    key = (cell[:, 0] * counts[1] + cell[:, 1]) * counts[2] + cell[:, 2]
    order = np.argsort(key, kind="stable")
    n_cells = int(counts.prod())
    cell_starts = np.zeros(n_cells + 1, np.int64)
    np.cumsum(np.bincount(key, minlength=n_cells), out=cell_starts[1:])
    return (origin, float(size), counts), cell_starts, order
