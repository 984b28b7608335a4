"""How well strands fit the photos they were made from, and the head: the report of a project (issue 5, I)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from ..errors import require
from ..fields.orientation import OrientationParams, orientation_map
from ..geometry.head import HeadSurface
from ..geometry.strand_raster import StrandRaster, hair_mask, raster_strands, without_sense
from ..types import Bools, Float32, Floats, Head, StrandSet
from .views import View


@dataclass(frozen=True, slots=True)
class QualityParams:
    """Settings of quality_report.

    confident_share : of each hair mask, this share of its pixels is compared: those with the surest orientation.
    smooth_px : the strands' orientation is averaged over so many pixels, as the photo's is by its filters.
    tolerance : metres; points less deep than this do not count as inside the head.
    max_points : at most so many points, evenly chosen, are tested against the head.
    orientation : how the photos' orientation is measured.
    """

    confident_share: float = 0.5
    smooth_px: float = 2.0
    tolerance: float = 0.0005
    max_points: int = 200_000
    orientation: OrientationParams = field(default_factory=OrientationParams)

    def __post_init__(self) -> None:
        require(0 < self.confident_share <= 1, f"confident_share is {self.confident_share}; take above 0 to 1")
        require(0 <= self.smooth_px <= 50, f"smooth_px is {self.smooth_px}; take 0 to 50")
        require(self.tolerance >= 0, f"tolerance is {self.tolerance} m; take 0 or more")
        require(self.max_points >= 1, f"max_points is {self.max_points}; take 1 or more")


def quality_report(
    strands: StrandSet, views: Sequence[View], head: Head, params: QualityParams = QualityParams()
) -> dict[str, Any]:
    """Compare strands with each photo, and with the head.

    Parameters
    ----------
    strands, head : world space, metres.

    Returns
    -------
    A dict of plain numbers, names and dicts (ready for JSON):
        views : by name, mask_iou (the mask against what a person would mark on the strands); orientation_median_deg and
            orientation_mean_deg, between the strands and the photo where the photo's orientation is sure, None where
            nothing can be compared; compared_share, the share of the photo's mask that was compared.
        mask_iou, orientation_median_deg : means over the views.
        penetration : point_share and strand_share deeper than the tolerance in the head, deepest (metres).
    """
    by_view = {view.name: _compare(strands, view, head, params) for view in views}
    return {
        "views": by_view,
        "mask_iou": _mean([found["mask_iou"] for found in by_view.values()]),
        "orientation_median_deg": _mean([found["orientation_median_deg"] for found in by_view.values()]),
        "penetration": penetration(strands, head, params),
    }


def mask_iou(a: Bools, b: Bools) -> float:
    """Pixels in both masks (H, W) over pixels in either; 1 for two empty masks."""
    require(a.shape == b.shape, f"masks of {a.shape} and {b.shape} pixels cannot be compared; make them alike")
    either = np.count_nonzero(a | b)
    return np.count_nonzero(a & b) / either if either else 1.0


def orientation_error(angle_a: Floats, angle_b: Floats, where: Bools) -> tuple[float, float]:
    """Median and mean angle in degrees, 0 to 90, between unsigned orientations (H, W), radians, where (H, W) bool.

    Raises
    ------
    InputError : `where` is nowhere.
    """
    require(where.any(), "there is no pixel to compare orientations at; check masks and confidence")
    apart = np.mod(angle_a[where].astype(np.float64) - angle_b[where], np.pi)
    errors = np.degrees(np.minimum(apart, np.pi - apart))
    return float(np.median(errors)), float(errors.mean())


def penetration(strands: StrandSet, head: Head, params: QualityParams = QualityParams()) -> dict[str, float]:
    """Shares of points and strands deeper than the tolerance inside the head, and the deepest, metres (0: none)."""
    step = -(-len(strands.points) // params.max_points)
    chosen = np.arange(0, len(strands.points), step)
    depth = -HeadSurface(head).signed_distance(strands.points[chosen])
    inside = depth > params.tolerance
    strand = np.searchsorted(strands.offsets, chosen, side="right") - 1
    tested, touched = np.unique(strand), np.unique(strand[inside])
    return {
        "point_share": float(inside.mean()) if len(chosen) else 0.0,
        "strand_share": len(touched) / max(len(tested), 1),
        "deepest": max(float(depth.max(initial=0.0)), 0.0),
    }


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _compare(strands: StrandSet, view: View, head: Head, params: QualityParams) -> dict[str, float | None]:
    drawn = raster_strands(view.camera, strands, head)
    measured = orientation_map(view.image, view.mask, params.orientation)
    sure = measured.confidence >= np.quantile(measured.confidence[view.mask], 1.0 - params.confident_share)
    where = view.mask & sure & (measured.confidence > 0) & drawn.mask
    median: float | None = None
    mean: float | None = None
    if where.any():
        median, mean = orientation_error(smooth_angle(drawn, params.smooth_px), measured.angle, where)
    return {
        "mask_iou": mask_iou(hair_mask(view.camera, strands, head), view.mask),
        "orientation_median_deg": median,
        "orientation_mean_deg": mean,
        "compared_share": np.count_nonzero(where) / np.count_nonzero(view.mask),
    }


def smooth_angle(drawn: StrandRaster, smooth_px: float) -> Float32:
    """(H, W) float32, radians in [0, pi): the drawn orientation averaged over `smooth_px` (standard deviation)."""
    if smooth_px == 0:
        return drawn.angle
    twice = 2.0 * drawn.angle
    parts = [np.where(drawn.mask, part(twice), 0.0).astype(np.float32) for part in (np.cos, np.sin)]
    cosine, sine = (cv2.GaussianBlur(part, (0, 0), smooth_px) for part in parts)
    return without_sense(0.5 * np.arctan2(sine, cosine))
