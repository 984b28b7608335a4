"""The job `transfer_details`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from ..errors import require
from ..geometry.scalp_space import ScalpSpace, unroot_strands
from ..geometry.strands import resample_set
from ..progress import Progress, subrange
from ..synthesis.detail_statistics import compare_details, finer_spectrum, spectrum_distance
from ..synthesis.detail_transfer import DetailParams, DetailResult, smooth_strands, transfer_style
from ..synthesis.pipeline import SynthesisParams, analyze
from ..types import RootedStrands, StrandSet, WispHierarchy

Values = dict[str, Any]
MAX_COMPARED = 4000  # strands of a hairstyle that the report looks at


@dataclass(frozen=True, slots=True)
class TransferJobParams:
    """Settings of the job: how hairstyles without hierarchy are clustered, and the transfer's own."""

    analysis: SynthesisParams = field(default_factory=SynthesisParams)
    detail: DetailParams = field(default_factory=DetailParams)
    compare: bool = True  # measure the spectra for the report; live updates leave it out


def run(inputs: Values, params: TransferJobParams, progress: Progress) -> Values:
    """Details of one groom on another (W-U6).

    Inputs: `detail_hierarchy`, or `detail_strands` and `detail_head`; `base_strands`, and `base_hierarchy` with
    `base_space`, or `base_head`. Outputs: strands (world space, in the order and with the attributes of base_strands;
    as many points each as the hierarchies have, more where max_subdivision lets curls need it), detail_hierarchy,
    base_hierarchy and base_space for the next run, report.
    """
    detail = inputs.get("detail_hierarchy")
    if detail is None:
        progress(0.0, "Clustering the detail groom")
        strands, head = _given(inputs, "detail_strands"), _given(inputs, "detail_head")
        detail = analyze(strands, head, params.analysis, progress=subrange(progress, 0.0, 0.4)).hierarchy
    strands = _given(inputs, "base_strands")
    base, space = inputs.get("base_hierarchy"), inputs.get("base_space")
    if base is None or space is None:
        progress(0.4, "Clustering the base groom")
        part = subrange(progress, 0.4, 0.8)
        example = analyze(strands, _given(inputs, "base_head"), fitting(params.analysis, detail), progress=part)
        base, space = example.hierarchy, example.space
    n_base = base.levels[0].n_strands
    require(
        n_base == strands.n_strands,
        f"the base groom has {strands.n_strands} strands, its hierarchy {n_base}; cluster it again",
    )
    result = transfer_style(detail, base, params.detail, progress=subrange(progress, 0.8, 0.95))
    progress(0.95, "Writing the strands")
    return {
        "strands": as_strand_set(result.strands, space, strands),
        "detail_hierarchy": detail,
        "base_hierarchy": base,
        "base_space": space,
        "report": transfer_report(detail, base, result, params.detail, params.compare),
    }


def fitting(analysis: SynthesisParams, detail: WispHierarchy) -> SynthesisParams:
    """`analysis` with the numbers of levels and points that the details have, which may come from a file."""
    hierarchy = replace(analysis.hierarchy, n_levels=detail.n_levels)
    return replace(analysis, hierarchy=hierarchy, n_samples=detail.levels[0].n_points)


def _given(inputs: Values, name: str) -> Any:
    value = inputs.get(name)
    require(value is not None, f"the input '{name}' is missing; give it, or the hierarchy that was found before")
    return value


def as_strand_set(made: RootedStrands, space: ScalpSpace, strands: StrandSet) -> StrandSet:
    """The made strands in world space with the attributes of `strands`, whose order they have."""
    carried = resample_set(strands, made.n_points)
    points = unroot_strands(made, space).points
    return StrandSet(points, carried.offsets, carried.point_attributes, carried.strand_attributes)


def transfer_report(
    detail: WispHierarchy, base: WispHierarchy, result: DetailResult, params: DetailParams, compare: bool = True
) -> Values:
    """Counts, and how far the details are from the detail hairstyle's before and after, 0 (alike) to 1.

    `details` compares what the finer levels add to the coarsest (finer_spectrum; the detail hairstyle's coarsest level
    smoothed as for the transfer), `curvature` and `torsion` whole strands, so with the base's own coarsest level.
    """
    levels = result.levels
    report: Values = {
        "strands": levels[0].n_strands,
        "points": levels[0].n_points,
        "levels": [level.n_strands for level in levels],
    }
    if compare:
        smoothed = (*detail.levels[:-1], smooth_strands(detail.levels[-1], params.smoothing))
        styles = (WispHierarchy(smoothed, detail.labels), base, WispHierarchy(levels, base.labels))
        spectra = [finer_spectrum(style) for style in styles]
        looked_at = [style.levels[0].points[:: -(-style.levels[0].n_strands // MAX_COMPARED)] for style in styles]
        for name, other in (("distance_before", 1), ("distance_after", 2)):
            distances = compare_details(looked_at[0], looked_at[other])
            report[name] = {"details": spectrum_distance(spectra[0], spectra[other])} | distances
    return report
