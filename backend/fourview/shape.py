"""The rough hair shape: the volume of a database hairstyle, deformed to the masks and clipped (Zhang et al. 2017)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from ..errors import require
from ..geometry.head import HeadSurface, find_scalp
from ..geometry.strands import arc_lengths, select_strands, strand_lengths
from ..progress import NO_PROGRESS, Progress, subrange
from ..types import Bools, Float32, Float64, Head, Mesh, StrandSet, check_array
from .clipping import clip_shape
from .deformation import DeformationParams, Displacement, deform_to_masks
from .hull import Cone, allowed_distance, grow, hull_box, make_cones, seen_hair, settle_rims, uncoverable, voxel_points
from .solid import (
    Voxels,
    head_voxels,
    point_voxels,
    signed_distance,
    strand_voxels,
    surface,
    voxels_around,
    without_specks,
)
from .views import MAX_VIEWS, View

_MOST_STRANDS = 4000  # more do not change the volume
_MARGIN = 8.0  # voxels around the hair: the blur must not reach the cube's sides
_SHELL = 0.02  # metres, how deep below the scalp the hair's volume reaches: its inner side is in the head


@dataclass(frozen=True, slots=True)
class ShapeParams:
    """Settings of find_shape.

    resolution : voxels along the bounding cube (Z-4). blur : sigma of the Gaussian, voxels.
    gap : metres, gaps between strands, and between hair and head, up to twice that are filled.
    tube : metres, half the thickness of a lone strand.
    scalp_layer : metres, least thickness of hair on the scalp where the masks allow it.
    growth_rounds : carvings and growings by the masks after the deformation.
    conflict : share of a mask that no shape can cover from which on a remark names the view.
    """

    resolution: int = 100
    blur: float = 3.0
    gap: float = 0.012
    tube: float = 0.004
    scalp_layer: float = 0.004
    growth_rounds: int = 2
    conflict: float = 0.03
    deformation: DeformationParams = field(default_factory=DeformationParams)

    def __post_init__(self) -> None:
        require(32 <= self.resolution <= 400, f"the resolution is {self.resolution} voxels; take 32 to 400")
        require(0 <= self.blur <= 10, f"the blur is {self.blur} voxels; take 0 to 10")
        require(0 < self.tube <= self.gap <= 0.1, f"tube {self.tube} and gap {self.gap} m: 0 < tube <= gap <= 0.1")
        require(0 <= self.scalp_layer <= 0.05, f"the scalp layer is {self.scalp_layer} m; take 0 to 0.05")
        require(0 <= self.growth_rounds <= 20, f"{self.growth_rounds} rounds of growth; take 0 to 20")
        require(0 < self.conflict <= 1, f"the conflict share is {self.conflict}; take more than 0, up to 1")


@dataclass(frozen=True, slots=True)
class RoughShape:
    """The hair's rough shape (Z-4 ... Z-7).

    closed : G_DEF, closed. open : G, its outer surface. Both metres, world space.
    strands : the database hairstyle carried along by the deformation, a prior for directions; roots as they were.
    style : the hairstyle's name. mask_iou : (n_views,) float64, intersection over union of the closed mesh, seen before
        the head, with each mask. remarks : lines for the user.
    """

    closed: Mesh
    open: Mesh
    strands: StrandSet
    style: str
    mask_iou: Float64
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_array("mask_iou", self.mask_iou, np.float64, (None,))


def find_shape(
    strands: StrandSet,
    style: str,
    views: Sequence[View],
    head: Head,
    params: ShapeParams = ShapeParams(),
    *,
    progress: Progress = NO_PROGRESS,
) -> RoughShape:
    """From the best hairstyle of the database to the rough shape that fills the masks (sec. 4.1; Z-4 ... Z-7).

    After the deformation of eq. 2 the volume is carved by the masks and grown where a mask is not filled, at the depth
    of the hair around: what two views demand of a point that no outline passes, the deformation cannot know.

    Parameters
    ----------
    strands : of the database hairstyle on `head`, world space, metres. style : its name.
    views : 1 to 8, with masks and cameras. head : with a scalp, or else the roots tell where it is.

    Raises
    ------
    InputError : no strands, no views or too many, roots far off the head, a mask that the hair cannot come near.
    """
    require(1 <= len(views) <= MAX_VIEWS, f"{len(views)} views; give 1 to {MAX_VIEWS}")
    head = _with_scalp(head, strands)
    volume, voxels = hair_volume(strands, head, params)
    progress(0.15, "smoothed the database hairstyle")
    # the blur leaves nothing finer than two voxels: every other voxel holds the shape, at an eighth of the cost
    coarse = Voxels(voxels.origin, 2.0 * voxels.cell, (voxels.count + 1) // 2)
    mesh = surface(np.ascontiguousarray(volume[::2, ::2, ::2]), coarse)
    held = HeadSurface(head).signed_distance(mesh.vertices) < -0.25 * _SHELL
    deformed, displacement = deform_to_masks(
        mesh, views, head, params.deformation, held=held, progress=subrange(progress, 0.15, 0.6)
    )
    progress(0.6, "filling the masks")
    cones = make_cones(views, head)
    closed, final = _fill_masks(deformed, cones, head, params, subrange(progress, 0.6, 0.9))
    progress(0.9, "clipping the shape")
    opened = clip_shape(closed, views, head)
    require(len(opened.triangles) > 0, "nothing of the shape is seen as hair; check the masks and cameras")
    iou = np.array([mask_overlap(cone, closed) for cone in cones])
    remarks = _conflicts(cones, final, params.conflict)
    return RoughShape(closed, opened, carry_strands(strands, displacement), style, iou, remarks)


def remove_detail(strands: StrandSet, head: Head, params: ShapeParams = ShapeParams()) -> Mesh:
    """G_MC: the hair's volume without its details, as a closed mesh (Z-4); metres, world space."""
    return surface(*hair_volume(strands, _with_scalp(head, strands), params))


def hair_volume(strands: StrandSet, head: Head, params: ShapeParams) -> tuple[Float32, Voxels]:
    """The blurred volume of the hair (Z-4): (n, n, n) float32 in [-0.5, 0.5], above 0 inside, and its voxels.

    Gaps between strands, and between hair and head, are filled; the part below the scalp is a shell, so that the volume
    has an inner side in the head.
    """
    require(strands.n_strands > 0, "the hairstyle has no strands; choose another")
    if strands.n_strands > _MOST_STRANDS:
        strands = select_strands(strands, np.linspace(0, strands.n_strands - 1, _MOST_STRANDS).astype(np.int64))
    scalp = head.vertices[head.triangles[head.scalp].ravel()]
    low = np.minimum(strands.points.min(axis=0), scalp.min(axis=0))
    high = np.maximum(strands.points.max(axis=0), scalp.max(axis=0))
    voxels = voxels_around(low, high, params.resolution, _MARGIN)
    hair = strand_voxels(strands, voxels)
    inside = head_voxels(head, voxels)
    gap, tube = params.gap / voxels.cell, params.tube / voxels.cell
    from_hair = distance_transform_edt(~hair)
    closed = distance_transform_edt(~(hair | inside)) <= gap
    closed = distance_transform_edt(closed) > gap  # closing: gaps between hairs and to the head
    solid = ((closed & (from_hair <= gap)) | (from_hair <= max(tube, 1.0))) & ~inside
    solid |= inside & scalp_shell(head, voxels, max(_SHELL, 5.0 * voxels.cell))
    blurred = gaussian_filter(solid.astype(np.float32), params.blur, truncate=3.0) if params.blur > 0 else solid
    return without_specks(blurred.astype(np.float32) - np.float32(0.5)), voxels


def scalp_shell(head: Head, voxels: Voxels, thickness: float) -> Bools:
    """(n, n, n) bool: the voxels within `thickness`, metres, of the scalp, on both sides of it."""
    return np.asarray(_scalp_distance(head, voxels) <= thickness)


def _scalp_distance(head: Head, voxels: Voxels) -> Float32:
    corners = head.vertices[head.triangles[head.scalp]].astype(np.float64)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    n = max(int(np.ceil(longest / voxels.cell)), 1)
    steps = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)], np.float64) / n
    samples = np.einsum("sk,fkc->fsc", steps, corners).reshape(-1, 3)
    near = point_voxels(voxels.indices(samples), voxels)
    return np.asarray(distance_transform_edt(~near) * voxels.cell, np.float32)


def _fill_masks(
    deformed: Mesh, cones: Sequence[Cone], head: Head, params: ShapeParams, progress: Progress
) -> tuple[Mesh, Voxels]:
    """The closed mesh after carving and growing the deformed one by the masks, and its voxels."""
    vertices = deformed.vertices.astype(np.float64)
    low, high = hull_box(cones, vertices.min(axis=0), vertices.max(axis=0))
    voxels = voxels_around(low, high, params.resolution, 4.0)
    field = signed_distance(deformed, voxels)
    allowed = allowed_distance(voxel_points(voxels), cones, voxels.cell).reshape(voxels.shape)
    scalp = _scalp_distance(head, voxels)
    inside = head_voxels(head, voxels)
    core = np.where(inside, np.float32(max(_SHELL, 3.0 * voxels.cell)), np.float32(params.scalp_layer)) - scalp
    field = np.maximum(field, core)
    for number in range(params.growth_rounds):
        progress(number / params.growth_rounds, "filling the masks")
        field = np.minimum(settle_rims(field, voxels, cones, head), allowed)
        field = grow(field, allowed, voxels, cones, head)
        field = gaussian_filter(np.clip(field, -4.0 * voxels.cell, 4.0 * voxels.cell), 1.0)
    field = np.minimum(settle_rims(field, voxels, cones, head), allowed)
    return surface(without_specks(field), voxels), voxels


def mask_overlap(cone: Cone, mesh: Mesh) -> float:
    """Intersection over union of what the view sees of the mesh before the head, and its mask."""
    seen, _ = seen_hair(cone.camera, mesh, cone.head_depth)
    return float((seen & cone.mask).sum() / max((seen | cone.mask).sum(), 1))


def carry_strands(strands: StrandSet, displacement: Displacement) -> StrandSet:
    """The strands moved by the deformation, each from its root on: the root's own move fades out along the strand."""
    moved = displacement(strands.points)
    counts = strands.point_counts
    root_moves = np.repeat((moved - strands.points)[strands.offsets[:-1]], counts, axis=0)
    lengths = np.repeat(np.maximum(strand_lengths(strands), 1e-9), counts)
    share = np.clip(1.0 - arc_lengths(strands) / (0.5 * lengths), 0.0, 1.0)
    points = (moved - root_moves * share[:, None]).astype(np.float32)
    return StrandSet(points, strands.offsets, dict(strands.point_attributes), dict(strands.strand_attributes))


def _conflicts(cones: Sequence[Cone], voxels: Voxels, least: float) -> tuple[str, ...]:
    """Remarks on views whose masks the others contradict."""
    everyone = list(range(len(cones)))
    shares = np.array([uncoverable(i, cones, voxels, everyone) for i in everyone])
    if shares.max(initial=0.0) < least:
        return ()
    without = np.array(
        [
            max(
                (uncoverable(i, cones, voxels, [j for j in everyone if j != k]) for i in everyone if i != k),
                default=0.0,
            )
            for k in everyone
        ]
    )
    blamed = np.flatnonzero(without <= without.min() + 0.25 * least)
    names = " and ".join(f"'{cones[k].name}'" for k in blamed)
    worst = int(shares.argmax())
    return (
        f"no shape fills all masks: {shares[worst]:.0%} of the mask of view '{cones[worst].name}' is outside "
        f"the others; check the mask and the camera of {names}",
    )


def _with_scalp(head: Head, strands: StrandSet) -> Head:
    return head if head.scalp.any() else find_scalp(head, strands.roots)
