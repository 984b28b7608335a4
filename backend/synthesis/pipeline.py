"""Example-based hair synthesis, end to end (Wang et al. 2009, sec. 5 and Fig. 1): its stages also run alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from ..errors import require
from ..geometry.roots import Roots, scatter_roots
from ..geometry.scalp_region import triangle_areas
from ..geometry.scalp_space import ScalpSpace, fit_scalp_space, root_strands, unroot_strands
from ..progress import NO_PROGRESS, Progress, subrange
from ..types import Bools, FeatureMap, Head, Int32, RootedStrands, StrandSet, WispHierarchy
from .features import cells_around_roots, feature_map, fit_features, sample_map
from .hierarchy import HierarchyParams, build_hierarchy
from .refinement import RefineParams, RefineReport, refine
from .texture import TextureParams, TextureResult, synthesize_texture
from .transfer import TransferParams, transfer_details
from .wisps import WispSet

StageTimer = Callable[[str], None]
# of the relaxation of roots: the nearest distances then vary by 7 % (0.52 at random, 6 % after the 40 of M-4)
ROOT_ITERATIONS = 12


def no_timer(stage: str) -> None:
    """Called at the start of each stage; the command line and the benchmarks pass one that looks at the clock."""


@dataclass(frozen=True, slots=True)
class SynthesisParams:
    """Settings of synthesize (Table 1 of the paper). Defaults live here only."""

    n_strands: int = 0  # strands of the result; 0 keeps the example's density
    n_samples: int = 64  # n_s, points per strand
    n_features: int = 16  # n_f, PCA dimensions of the feature map
    map_spacing: float = 0.02  # Delta_2D, radians of (u, v)
    hierarchy: HierarchyParams = field(default_factory=HierarchyParams)
    # hair hangs: a wisp of the nape on the brow is no hairstyle, so sources come from about the same place;
    # 0 is the paper's; 5 keeps the layout of a real groom (tip directions) with three quarters of the strands new.
    texture: TextureParams = field(default_factory=lambda: TextureParams(layout_weight=5.0))
    # share of the most similar example strand in a coarsest strand; 0, the paper's reconstruction from the map alone,
    # loses length and curls (curly hair: a third of its length), as the map averages neighbours and truncates the PCA
    sharpness: float = 1.0
    transfer: TransferParams = field(default_factory=TransferParams)
    # spacing is the coarsest level's, halved per finer level. The paper's blend of 1 straightens waves and curls: on
    # the wavy groom, curvature is 0.03 from the example's without refinement, 0.42 with this, 0.7 at 0.5 and 60 degrees
    refine: RefineParams = field(default_factory=lambda: RefineParams(blend=0.25, angle_limit_deg=30.0))
    use_refinement: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        require(0 <= self.n_strands <= 2_000_000, f"n_strands is {self.n_strands}; it must be in 0..2000000")
        require(4 <= self.n_samples <= 512, f"n_samples is {self.n_samples}; it must be in 4..512")
        require(1 <= self.n_features <= 256, f"n_features is {self.n_features}; it must be in 1..256")
        require(0 <= self.sharpness <= 1, f"sharpness is {self.sharpness}; it must be in 0..1")
        require(0.002 <= self.map_spacing <= 0.5, f"map_spacing is {self.map_spacing}; it must be in 0.002..0.5")


@dataclass(frozen=True, slots=True)
class Example:
    """An analysed input hairstyle: what synthesis, transfer and the comb need of it.

    space : scalp space of its head. hierarchy : its levels. wisp_sets : how each level was clustered.
    """

    space: ScalpSpace
    hierarchy: WispHierarchy
    wisp_sets: tuple[WispSet, ...]


@dataclass(frozen=True, slots=True)
class SynthesisResult:
    """A new hairstyle and everything that led to it (Fig. 1 d-h).

    strands : S strands, world space, metres.
    roots : where on the head each strand grows.
    levels : the output's levels, finest first; level 0 is `strands` in root frames.
    example_map, result_map : feature maps of the coarsest level.
    donors : per level but the coarsest, (S_l, D) int32, the input strands that lent their displacement.
    texture_energies, refine_reports : per stage, coarsest level first.
    """

    strands: StrandSet
    roots: Roots
    levels: tuple[RootedStrands, ...]
    example_map: FeatureMap
    result_map: FeatureMap
    donors: tuple[Int32, ...]
    texture_energies: tuple[float, ...]
    refine_reports: tuple[RefineReport, ...]


def analyze(
    strands: StrandSet, head: Head, params: SynthesisParams = SynthesisParams(), *, progress: Progress = NO_PROGRESS
) -> Example:
    """Put a hairstyle into scalp space and find its wisp hierarchy (sec. 3 and 4).

    Raises
    ------
    InputError : no strands, a head without scalp, or fewer strands than wisps.
    """
    require(strands.n_strands > 0, "the groom has no strands; choose one that has")
    progress(0.0, "Fitting the scalp space")
    space = fit_scalp_space(head)
    rooted = root_strands(strands, space, params.n_samples)
    hierarchy, wisp_sets = build_hierarchy(rooted, space, params.hierarchy, progress=subrange(progress, 0.05, 1.0))
    return Example(space, hierarchy, wisp_sets)


def level_counts(example: WispHierarchy, area_ratio: float, n_strands: int) -> tuple[int, ...]:
    """Strands of each output level: the input's density on the output's area (W-19); level 0 as asked for."""
    counts = [max(1, round(level.n_strands * area_ratio)) for level in example.levels]
    if n_strands > 0:
        counts[0] = n_strands
    return tuple(counts)


def region_area(head: Head, region: Bools) -> float:
    """Area of the triangles `region` (F,) bool of the head, square metres; InputError if there is none."""
    require(region.shape == head.scalp.shape, f"the region has {region.size} triangles, the head {head.scalp.size}")
    area = float(triangle_areas(head)[region].sum())
    require(area > 0, "the scalp region has no area; choose faces of the head where hair shall grow")
    return area


def place_roots(space: ScalpSpace, roots: Roots, n_points: int) -> RootedStrands:
    """Strands without a shape yet, all points at their roots, in the frames of the scalp (W-5)."""
    in_head_space = space.world_to_head(roots.points)
    uv = np.ascontiguousarray(space.to_scalp(in_head_space)[:, :2])
    points = np.zeros((len(in_head_space), n_points, 3), np.float32)
    return RootedStrands(in_head_space, space.frames_at(uv), uv, points)


def synthesize_coarsest(
    example: RootedStrands, roots: RootedStrands, params: SynthesisParams, *, progress: Progress = NO_PROGRESS
) -> tuple[RootedStrands, FeatureMap, TextureResult]:
    """The coarsest output level by 2D texture synthesis of PCA features (sec. 5.1; W-16 to W-20).

    Each root takes the spatially closest vector of the synthesised map; its strand is the vector's own and that of the
    example strand with the most similar features, in the shares of `params.sharpness` (0: the paper).

    Returns
    -------
    strands at `roots`; the example's feature map; the synthesised map with its energies.
    """
    basis = fit_features(example.points, params.n_features)
    features = basis.encode(example.points)
    example_map = feature_map(example.uv, features, params.map_spacing)
    origin, mask = cells_around_roots(roots.uv, params.map_spacing)
    texture = synthesize_texture(
        example_map, mask, replace(params.texture, seed=params.seed), origin=origin, progress=progress
    )
    wanted = sample_map(texture.map, roots.uv)
    similar = example.points[cKDTree(features).query(wanted)[1]]
    share = np.float32(params.sharpness)
    return roots.with_points((1 - share) * basis.decode(wanted) + share * similar), example_map, texture


def synthesize(
    strands: StrandSet,
    head: Head,
    params: SynthesisParams = SynthesisParams(),
    *,
    region: Bools | None = None,
    progress: Progress = NO_PROGRESS,
    timer: StageTimer = no_timer,
) -> SynthesisResult:
    """A new hairstyle that is statistically like `strands` (Wang et al. 2009).

    Parameters
    ----------
    strands : the example, world space, metres, on `head`.
    head : the head with its scalp.
    region : (F,) bool, the triangles where the new hair grows (W-U1); None is the head's scalp.

    Raises
    ------
    InputError : no strands, a scalp or region without area, fewer strands than wisps.
    """
    timer("cluster")
    example = analyze(strands, head, params, progress=subrange(progress, 0.0, 0.3))
    return synthesize_from(example, head, params, region=region, progress=subrange(progress, 0.3, 1.0), timer=timer)


def synthesize_from(
    example: Example,
    head: Head,
    params: SynthesisParams = SynthesisParams(),
    *,
    region: Bools | None = None,
    progress: Progress = NO_PROGRESS,
    timer: StageTimer = no_timer,
) -> SynthesisResult:
    """`synthesize` from an example that is analysed already; other seeds, regions and counts need no new analysis."""
    space, hierarchy = example.space, example.hierarchy
    region = head.scalp if region is None else region
    counts = level_counts(hierarchy, region_area(head, region) / region_area(head, head.scalp), params.n_strands)
    timer("roots")
    progress(0.0, "Placing roots")
    scattered = [
        scatter_roots(head, region, count, params.seed + level, iterations=ROOT_ITERATIONS)
        for level, count in enumerate(counts)
    ]
    placed = [place_roots(space, roots, params.n_samples) for roots in scattered]
    timer("texture")
    coarsest = hierarchy.n_levels - 1
    current, example_map, texture = synthesize_coarsest(
        hierarchy.levels[coarsest], placed[coarsest], params, progress=subrange(progress, 0.05, 0.4)
    )
    current, report = _refine_level(current, example, coarsest, params, timer)
    levels, reports, donors = [current], [report], []
    for level in range(coarsest - 1, -1, -1):
        progress(0.4 + 0.6 * (coarsest - 1 - level) / coarsest, f"Adding the details of level {level}")
        timer("transfer")
        transferred = transfer_details(hierarchy, level, current, placed[level], params.transfer)
        donors.append(transferred.donors)
        current, report = _refine_level(transferred.strands, example, level, params, timer)
        levels.append(current)
        reports.append(report)
    timer("output")
    progress(1.0, "Done")
    return SynthesisResult(
        unroot_strands(current, space), scattered[0], tuple(levels[::-1]), example_map, texture.map,
        tuple(donors[::-1]), tuple(map(float, texture.energies)), tuple(r for r in reports if r is not None),
    )  # fmt: skip


def _refine_level(
    strands: RootedStrands, example: Example, level: int, params: SynthesisParams, timer: StageTimer
) -> tuple[RootedStrands, RefineReport | None]:
    if not params.use_refinement:
        return strands, None
    timer("refine")
    finer = example.hierarchy.n_levels - 1 - level
    spacing = params.refine.spacing / 2**finer
    # a step over many cells skips what the finer field says
    step = min(params.refine.step, 3 * spacing)
    settings = replace(params.refine, spacing=spacing, step=step, seed=params.seed)
    return refine(strands, example.space, settings, example=example.hierarchy.levels[level])
