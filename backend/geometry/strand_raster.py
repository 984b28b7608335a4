"""Which strand each pixel of a view shows and how it runs there, and the hair mask that a person would draw."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..errors import require
from ..types import Bools, Camera, Float32, Head, Int32, Mesh, StrandSet
from ._strand_raster_kernels import draw_segments
from .camera import project
from .view_raster import raster_mesh

SMALLEST_SHARE = 2e-4  # holes and specks below this share of the picture are not worth a person's stroke
DENSE = 0.45  # covered share that counts as hair; a border of dense hair stays where it is at 0.5
CLOSE_PX = 3.0
PARTING = 5.0
STRAND_WIDTH = 2.8e-4  # metres; 30,000 strands stand for 100,000 hairs of 0.08 mm
LEAST_SHARE = 0.4  # lines much thinner than a pixel cover all where they are dense, which tells nothing any more


@dataclass(frozen=True, slots=True)
class StrandRaster:
    """The nearest strand of each pixel.

    strand : (H, W) int32, -1 for none. segment : (H, W) int32, the point that the drawn piece starts with.
    depth : (H, W) float32, metres along the viewing direction: of the strand, or of the occluder, or inf.
    signed_angle : (H, W) float32, radians in (-pi, pi], root to tip, from +x (right) towards +y (down); 0 for none.
    angle : (H, W) float32, radians in [0, pi), the same without the sense.
    mask : (H, W) bool, where there is a strand.
    """

    strand: Int32
    segment: Int32
    depth: Float32
    signed_angle: Float32
    angle: Float32
    mask: Bools


def raster_strands(
    camera: Camera, strands: StrandSet, occluder: Mesh | Head | None = None, width_px: float = 1.0
) -> StrandRaster:
    """Draw strands as lines of `width_px` into a z-buffer; the same bits for any number of threads.

    occluder : world space, metres; hides what lies behind it. Strands of a single point are not drawn, and pieces that
        are not in front of a perspective camera neither.

    Raises
    ------
    InputError : a width that is not above 0.
    """
    require(width_px > 0 and np.isfinite(width_px), f"strands cannot be {width_px} pixels wide; take a number above 0")
    seen = np.ascontiguousarray(project(camera, strands.points))
    width, height = camera.size
    last = np.zeros(len(strands.points), np.bool_)
    last[strands.offsets[1:] - 1] = True
    starts = np.flatnonzero(~last).astype(np.int32)
    depth = np.full((height, width), np.inf, np.float32)
    if occluder is not None:
        depth = raster_mesh(camera, occluder.vertices, occluder.triangles).depth
    drawn = np.full((height, width), -1, np.int32)
    draw_segments(seen, starts, width_px / 2.0, depth, drawn)
    mask = drawn >= 0
    segment = np.full((height, width), -1, np.int32)
    segment[mask] = starts[drawn[mask]]
    strand = np.full((height, width), -1, np.int32)
    strand[mask] = np.searchsorted(strands.offsets, segment[mask], side="right") - 1
    signed = np.zeros((height, width), np.float32)
    step = seen[segment[mask] + 1, :2] - seen[segment[mask], :2]
    signed[mask] = np.arctan2(step[:, 1], step[:, 0])
    return StrandRaster(strand, segment, depth, signed, without_sense(signed), mask)


def hair_mask(
    camera: Camera,
    strands: StrandSet,
    occluder: Mesh | Head | None = None,
    *,
    close_px: float = CLOSE_PX,
    strand_width: float = STRAND_WIDTH,
) -> Bools:
    """(H, W) bool: what a person would mark as hair in a photo of the strands.

    That is where strands are dense: gaps of about `close_px` between them are closed, single strands that fly away are
    left out, and so are small holes and specks. The occluder (the head) hides what lies behind it; where its scalp
    shows near hair (a parting), a person marks that too.

    strand_width : metres that a strand stands for. Lines are drawn a pixel wide at least; what they cover too much is
        taken off as for lines that lie by chance: of the share 1 - exp(-n) that n lines cover, 1 - exp(-n w) is left,
        w being their true width in pixels, 0.4 at least.
    """
    width_px = strand_width * _pixels_per_metre(camera, strands)
    drawn = raster_strands(camera, strands, occluder, max(width_px, 1.0)).mask
    scalp = scalp_pixels(camera, occluder) if isinstance(occluder, Head) else None
    return marked_region(
        drawn.astype(np.float32), scalp, close_px=close_px, line_share=float(np.clip(width_px, LEAST_SHARE, 1.0))
    )


def marked_region(
    coverage: Float32, scalp: Bools | None = None, *, close_px: float = CLOSE_PX, line_share: float = 1.0
) -> Bools:
    """(H, W) bool: the region that a person would mark, see `hair_mask`.

    coverage : (H, W) float32 in [0, 1], the share of each pixel that hair covers.
    scalp : (H, W) bool, where the scalp would show without hair; it counts as hair up to `PARTING` `close_px` from it.
    line_share : what the lines' true width is of the width that they cover (above 0, up to 1).
    """
    require(close_px > 0, f"gaps of {close_px} pixels cannot be closed; take a number above 0")
    require(0 < line_share <= 1, f"lines cannot have {line_share} of their width; take above 0 to 1")
    density = cv2.GaussianBlur(coverage, (0, 0), close_px, borderType=cv2.BORDER_REPLICATE)
    region = density >= 1.0 - (1.0 - DENSE) ** (1.0 / line_share)
    if scalp is not None:
        reach = PARTING * close_px
        region |= scalp & _closed(region, reach)
    smallest = SMALLEST_SHARE * coverage.size
    filled = ~_without_small(~region, smallest)
    return _without_small(filled, smallest)


def _pixels_per_metre(camera: Camera, strands: StrandSet) -> float:
    scale = float(camera.intrinsics[0, 0])
    if camera.orthographic or len(strands.points) == 0:
        return scale
    depth = project(camera, strands.points)[:, 2]
    return scale / max(float(np.median(depth)), 1e-6)


def scalp_pixels(camera: Camera, head: Head) -> Bools:
    """(H, W) bool: where the bald head would show its scalp."""
    seen = raster_mesh(camera, head.vertices, head.triangles).triangle
    return np.asarray((seen >= 0) & head.scalp[seen])


def _closed(region: Bools, radius: float) -> Bools:
    """The region and the pixels that no disc of `radius` beside it reaches."""
    rim = int(np.ceil(radius)) + 1  # nothing beyond the picture is hair
    padded = np.pad(region, rim)
    grown = cv2.distanceTransform((~padded).astype(np.uint8), cv2.DIST_L2, 5) <= radius
    within = cv2.distanceTransform(grown.astype(np.uint8), cv2.DIST_L2, 5) > radius
    return np.asarray(within[rim:-rim, rim:-rim])


def without_sense(signed_angle: Float32) -> Float32:
    """Angles modulo pi, in [0, pi), float32."""
    angle = np.mod(signed_angle.astype(np.float64), np.pi).astype(np.float32)
    return np.where(angle >= np.float32(np.pi), np.float32(0.0), angle)


def _without_small(region: Bools, smallest: float) -> Bools:
    """The region without its connected parts of fewer than `smallest` pixels."""
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(region.astype(np.uint8), connectivity=8)
    kept = statistics[:, cv2.CC_STAT_AREA] >= smallest
    kept[0] = False
    return np.asarray(kept[labels])
