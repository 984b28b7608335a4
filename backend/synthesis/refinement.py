"""Refinement of strands by a 3D direction field (Wang et al. 2009, sec. 5.3; W-25 to W-27).

Every strand is redrawn as a streamline of the averaged tangents of all strands, so that hairs that meet far from
their roots agree. Decisions where the paper is silent or where its method does harm:

- W-A3. A streamline of the field forgets the strand's own details. Here the direction of every step is a blend of the
  field's and of the strand's own tangent at the same arc length, and a field that turns away from the strand by more
  than `angle_limit_deg` is trusted less (nothing is left of it at twice the limit): there another wisp crosses.
- W-L3. Curls that are smaller than a cell would be averaged away: a strand whose radius of curvature is below one
  cell is left as it is, and from `CURL_FADE` cells on the field has its full weight.
- W-L1. Cells of scalp space shrink towards the south pole; hair that hangs down there gets a grid in head space.
- W-26, W-A4. A refined strand keeps its length, because transferred displacements give it a sensible one; the
  paper's random length of an example strand close by is there with `keep_length=False`.
- Where a streamline enters cells without hair, it goes on in the strand's own shape instead of ending
  (`fill_gaps=False`: the paper), and no point is pushed into the head.

`PAPER` has the paper's settings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from ..errors import require
from ..fields.grid import DirectionGrid, build_direction_grid, tangent_spread
from ..fields.tracing import follow
from ..geometry.scalp_space import ScalpSpace
from ..geometry.strands import polyline_lengths
from ..progress import NO_PROGRESS, Progress
from ..types import Float32, Float64, RootedStrands
from ._refinement_kernels import measure_curl_radii

CURL_FADE = 2.5  # cells of curl radius from which on a strand is refined in full; below 1 cell not at all
POLE_STRETCH = 0.5  # radians of direction per radian of u or v: cells are a quarter of their size at the top
POLE_SHARE = 0.02  # of the points, that may lie where cells are smaller than that in a scalp-space grid
NEAR_ROOTS = 8  # example strands, from which a length is drawn

GridKind = Literal["auto", "scalp", "world"]


@dataclass(frozen=True, slots=True)
class RefineParams:
    """Settings of refine. Defaults live here only."""

    spacing: float = 0.02  # Delta_3D, edge of a cell: radians and head radii
    step: float = 0.02  # delta, step of Euler's method, head radii
    iterations: int = 2  # passes of eq. 9
    grid: GridKind = "auto"  # cells in scalp space, or in head space for draped hair
    blend: float = 0.5  # share of the field in a direction; 1: the field alone, as in the paper
    angle_limit_deg: float = 60.0  # a field that turns away farther is trusted less; 180: always trusted
    protect_curls: bool = True  # leave strands alone whose curls are smaller than a cell
    keep_length: bool = True  # otherwise the length of a random example strand that grows close by
    fill_gaps: bool = True  # where no hair is, go on in the strand's own shape; otherwise end there
    clearance: float = 0.003  # head radii over the scalp below which no strand is pushed
    seed: int = 0

    def __post_init__(self) -> None:
        require(1e-4 <= self.spacing <= 1, f"spacing is {self.spacing}; it must be in 0.0001..1")
        require(1e-4 <= self.step <= 1, f"step is {self.step}; it must be in 0.0001..1")
        require(1 <= self.iterations <= 16, f"iterations is {self.iterations}; it must be in 1..16")
        require(self.grid in ("auto", "scalp", "world"), f"grid is '{self.grid}'; it must be auto, scalp or world")
        require(0 <= self.blend <= 1, f"blend is {self.blend}; it must be in 0..1")
        limit = self.angle_limit_deg
        require(0 < limit <= 180, f"angle_limit_deg is {limit}; it must be above 0 and at most 180")
        require(-1 <= self.clearance <= 1, f"clearance is {self.clearance}; it must be in -1..1")


PAPER = RefineParams(
    blend=1.0, angle_limit_deg=180.0, protect_curls=False, keep_length=False, fill_gaps=False, clearance=-1.0
)


@dataclass(frozen=True, slots=True)
class RefineReport:
    """What refine did.

        grid : 'scalp' or 'world'. spacing : of the cells, coarser than asked for where memory demanded it.
    X
        protected : share of the strands that kept some of their shape as their curls are small.
        ended : share of the strands that ended early (only without fill_gaps).
    """

    grid: str
    spacing: float
    cells: int
    spread_before: float
    spread_after: float
    protected: float
    ended: float


def refine(
    strands: RootedStrands,
    space: ScalpSpace,
    params: RefineParams = RefineParams(),
    *,
    example: RootedStrands | None = None,
    progress: Progress = NO_PROGRESS,
) -> tuple[RootedStrands, RefineReport]:
    """Make strands that meet in space agree, by redrawing them along their averaged tangents (W-25 to W-27).

    Parameters
    ----------
    strands : S strands. space : the scalp space of their head.
    example : where lengths are drawn from with `keep_length=False`; None: strands keep their length.

    Returns
    -------
    RootedStrands : the same roots (exactly) and number of points. RefineReport.

    Raises
    ------
    InputError : no strands, or strands of fewer than two points.
    """
    require(strands.n_strands > 0, "there are no strands to refine")
    require(strands.n_points >= 2, "strands of one point have no direction; resample them first")
    progress(0.0, "Averaging directions")
    own = strands.in_head_space()
    kind = params.grid if params.grid != "auto" else choose_grid(own, space)
    grid = build_direction_grid(own, space if kind == "scalp" else None, params.spacing, iterations=params.iterations)
    cell = _cell_size(grid)
    spread_before = tangent_spread(own, cell)
    progress(0.5, "Tracing strands")
    weights = np.full(strands.n_strands, params.blend)
    shares = np.ones(strands.n_strands)
    if params.protect_curls:
        shares = curl_weights(own, cell)
    if not params.keep_length and example is not None:
        own = _with_example_lengths(own, strands, example, params.seed)
    points, counts = follow(
        grid, own, weights * shares, params.step, angle_limit=math.radians(params.angle_limit_deg), space=space,
        clearance=params.clearance, fill_gaps=params.fill_gaps,
    )  # fmt: skip
    progress(0.9, "Measuring the spread of directions")
    report = RefineReport(
        kind, grid.spacing, grid.n_cells, math.degrees(spread_before),
        math.degrees(tangent_spread(points, cell)), float((shares < 1.0).mean()),
        float((counts < strands.n_points).mean()),
    )  # fmt: skip
    return strands.with_points(_in_root_frames(points, strands)), report


def choose_grid(points: Float32, space: ScalpSpace) -> GridKind:
    """'world' if more than `POLE_SHARE` of the points (S, N, 3, head space) lie close to the south pole (W-L1).

    Close is where a radian of u or v covers less than `POLE_STRETCH` radians of direction; at the top it covers 2.
    """
    some = points[:: max(1, len(points) // 1024)]
    uv = space.to_scalp(some)[..., :2].reshape(-1, 2)
    close = (space.distortion(uv).stretch < POLE_STRETCH).any(axis=1)
    return "world" if close.mean() > POLE_SHARE else "scalp"


def curl_weights(points: Float32, cell: float) -> Float64:
    """(S,) in [0, 1]: 0 for strands that curl tighter than a cell, 1 from `CURL_FADE` cells on (W-L3).

    points : (S, N, 3) float32; cell : edge, same unit.
    """
    radii = np.empty(len(points))
    measure_curl_radii(np.ascontiguousarray(points, np.float32), 0.25 * cell, radii)
    share = np.clip((radii / cell - 1.0) / (CURL_FADE - 1.0), 0.0, 1.0)
    return np.asarray(share * share * (3.0 - 2.0 * share))


def _cell_size(grid: DirectionGrid) -> float:
    """Edge of a cell in head radii; in scalp space at the top of the head, where a radian of u or v covers 2."""
    return grid.spacing if grid.space is None else 2.0 * grid.spacing


def _with_example_lengths(own: Float32, strands: RootedStrands, example: RootedStrands, seed: int) -> Float32:
    """The strands scaled about their roots to the length of an example strand that grows close by (W-26, W-A4)."""
    near = min(NEAR_ROOTS, example.n_strands)
    _, nearest = cKDTree(example.roots).query(strands.roots, k=[*range(1, near + 1)])
    chosen = np.random.default_rng(seed).integers(0, near, strands.n_strands)
    lengths = polyline_lengths(example.points)[nearest[np.arange(strands.n_strands), chosen]]
    own_lengths = np.maximum(polyline_lengths(own), 1e-6)
    roots = strands.roots[:, None, :]
    return np.asarray(roots + (own - roots) * (lengths / own_lengths)[:, None, None], dtype=np.float32)


def _in_root_frames(points: Float32, strands: RootedStrands) -> Float32:
    """Head-space points (S, N, 3) as RootedStrands stores them; the roots come out as 0 exactly."""
    moved = points - strands.roots[:, None, :]
    return np.asarray(np.matmul(moved, strands.frames), dtype=np.float32)
