"""The rough hair shape: the volume of a database hairstyle, deformed to the masks and clipped (Zhang et al. 2017)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter
from scipy.spatial import cKDTree

from ..errors import require
from ..geometry.head import HeadSurface, find_scalp
from ..geometry.strands import arc_lengths, resample, select_strands, strand_lengths
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
_LET_OUT = (0.003, 0.006, 0.01, 0.015, 0.02, 0.03)  # metres
_WIDEST = 0.03  # metres, the widest gaps between strands that are taken for a thin sample of dense hair
_SHELL = 0.02  # metres, how deep below the scalp the hair's volume reaches: its inner side is in the head


@dataclass(frozen=True, slots=True)
class ShapeParams:
    """Settings of find_shape.

    resolution : voxels along the bounding cube (Z-4). blur : sigma of the Gaussian, voxels.
    gap : metres, gaps between strands, and between hair and head, up to twice that are filled; more where the strands
        are a thin sample of the hair (`strand_spacing`).
    tube : metres, half the thickness of a lone strand.
    scalp_layer : metres, least thickness of hair on the scalp where the masks allow it.
    growth_rounds : carvings and growings by the masks after the deformation.
    conflict : share of a mask that no shape can cover from which on a remark names the view.
    exclusion : share from which on a view that alone contradicts the others is left out.
    """

    resolution: int = 100
    blur: float = 3.0
    gap: float = 0.012
    tube: float = 0.004
    scalp_layer: float = 0.004
    growth_rounds: int = 2
    conflict: float = 0.03
    exclusion: float = 0.15
    deformation: DeformationParams = field(default_factory=DeformationParams)

    def __post_init__(self) -> None:
        require(32 <= self.resolution <= 400, f"the resolution is {self.resolution} voxels; take 32 to 400")
        require(0 <= self.blur <= 10, f"the blur is {self.blur} voxels; take 0 to 10")
        require(0 < self.tube <= self.gap <= 0.1, f"tube {self.tube} and gap {self.gap} m: 0 < tube <= gap <= 0.1")
        require(0 <= self.scalp_layer <= 0.05, f"the scalp layer is {self.scalp_layer} m; take 0 to 0.05")
        require(0 <= self.growth_rounds <= 20, f"{self.growth_rounds} rounds of growth; take 0 to 20")
        shares = f"conflict {self.conflict} and exclusion {self.exclusion}"
        require(0 < self.conflict <= 1 and 0 < self.exclusion <= 1, f"{shares} are shares; take more than 0, up to 1")


@dataclass(frozen=True, slots=True)
class RoughShape:
    """The hair's rough shape (Z-4 ... Z-7).

    closed : G_DEF, closed. open : G, its outer surface. Both metres, world space.
    strands : the database hairstyle carried along by the deformation, a prior for directions; roots as they were.
    style : the hairstyle's name. mask_iou : (n_views,) float64, intersection over union of the closed mesh, seen before
        the head, with each mask. remarks : lines for the user. left_out : names of views that contradict the others.
    """

    closed: Mesh
    open: Mesh
    strands: StrandSet
    style: str
    mask_iou: Float64
    remarks: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

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
    cones = make_cones(views, head)
    vertices = mesh.vertices.astype(np.float64)
    used, slack, remarks = _find_conflicts(cones, (vertices.min(axis=0), vertices.max(axis=0)), params)
    fitted = [views[k] for k in used]
    deformed, displacement = deform_to_masks(
        mesh, fitted, head, params.deformation, held=held, progress=subrange(progress, 0.2, 0.5)
    )
    closed = _fill_masks(deformed, [cones[k] for k in used], slack, head, params, subrange(progress, 0.5, 0.9))
    progress(0.9, "clipping the shape")
    opened = clip_shape(closed, fitted, head)
    require(len(opened.triangles) > 0, "nothing of the shape is seen as hair; check the masks and cameras")
    iou = np.array([mask_overlap(cone, closed) for cone in cones])
    left_out = tuple(views[k].name for k in range(len(views)) if k not in used)
    return RoughShape(closed, opened, carry_strands(strands, displacement), style, iou, remarks, left_out)


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
    gap, tube = max(params.gap, strand_spacing(strands)) / voxels.cell, params.tube / voxels.cell
    from_hair = distance_transform_edt(~hair)
    closed = distance_transform_edt(~(hair | inside)) <= gap
    closed = distance_transform_edt(closed) > gap  # closing: gaps between hairs and to the head
    solid = ((closed & (from_hair <= gap)) | (from_hair <= max(tube, 1.0))) & ~inside
    solid |= inside & scalp_shell(head, voxels, max(_SHELL, 5.0 * voxels.cell))
    blurred = gaussian_filter(solid.astype(np.float32), params.blur, truncate=3.0) if params.blur > 0 else solid
    return without_specks(blurred.astype(np.float32) - np.float32(0.5)), voxels


def strand_spacing(strands: StrandSet) -> float:
    """Metres, about the distance between a strand and those around it; at most _WIDEST.

    Three in four points, a quarter, half, three quarters and all of the way along their strands, have four of the other
    strands' points within it. 0 for fewer than 8 strands.
    """
    if strands.n_strands < 8:
        return 0.0
    points = resample(strands, 5)[:, 1:].astype(np.float64)
    fourth = [cKDTree(level).query(level, k=5)[0][:, -1] for level in points.transpose(1, 0, 2)]
    return min(float(np.percentile(fourth, 75.0)), _WIDEST)


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
    deformed: Mesh, cones: Sequence[Cone], slack: float, head: Head, params: ShapeParams, progress: Progress
) -> Mesh:
    """The closed mesh after carving and growing the deformed one by the masks, let out by `slack`, metres."""
    vertices = deformed.vertices.astype(np.float64)
    low, high = hull_box(cones, vertices.min(axis=0), vertices.max(axis=0))
    voxels = voxels_around(low, high, params.resolution, 4.0)
    field = signed_distance(deformed, voxels)
    allowed = allowed_distance(voxel_points(voxels), cones, voxels.cell).reshape(voxels.shape) + np.float32(slack)
    scalp = _scalp_distance(head, voxels)
    inside = head_voxels(head, voxels)
    core = np.where(inside, np.float32(max(_SHELL, 3.0 * voxels.cell)), np.float32(params.scalp_layer)) - scalp
    field = np.maximum(field, core)
    for number in range(params.growth_rounds):
        progress(number / params.growth_rounds, "filling the masks")
        field = np.minimum(settle_rims(field, voxels, cones, head), allowed)
        field = grow(field, allowed, voxels, cones, head, slack)
        field = gaussian_filter(np.clip(field, -3.0 * voxels.cell, 3.0 * voxels.cell), 1.0)
    field = np.minimum(settle_rims(field, voxels, cones, head), allowed)
    return surface(without_specks(field), voxels)


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


def _find_conflicts(
    cones: Sequence[Cone], box: tuple[Float64, Float64], params: ShapeParams
) -> tuple[list[int], float, tuple[str, ...]]:
    """Which views to fit the shape to, how far outside their masks it may be (metres), and remarks on conflicts.

    A view that alone makes a large part of the masks impossible is left out when there are two or more others; for
    smaller conflicts (cameras a little off) the masks are let out half-way.
    """
    everyone = list(range(len(cones)))
    voxels = voxels_around(*hull_box(cones, *box), params.resolution, 1.0)
    slack = 2.0 * voxels.cell  # of the coarse pictures of this test

    def worst(views: list[int], more: float = 0.0) -> float:
        return max((uncoverable(i, cones, voxels, views, slack + more) for i in views), default=0.0)

    share = worst(everyone)
    if share < params.conflict:
        return everyone, 0.0, ()
    without = np.array([worst([i for i in everyone if i != k]) for k in everyone])
    blamed = [k for k in everyone if without[k] <= without.min() + 0.25 * params.conflict]
    names = " and ".join(f"'{cones[k].name}'" for k in blamed)
    remark = f"no shape fills all masks: {share:.0%} of one is outside the others; check the mask and camera of {names}"
    if len(blamed) == 1 and len(cones) >= 3 and share > params.exclusion and without.min() < 0.4 * share:
        left = [k for k in everyone if k not in blamed]
        return left, _let_out(worst, left, params), (f"{remark}, which was left out of the shape",)
    return everyone, _let_out(worst, everyone, params), (remark,)


def _let_out(worst: Callable[[list[int], float], float], views: list[int], params: ShapeParams) -> float:
    """Half of the least way, metres, by which all masks must be let out so that hardly any of one is impossible."""
    for way in _LET_OUT:
        if worst(views, way) < params.conflict:
            return 0.5 * way
    return 0.5 * _LET_OUT[-1]


def _with_scalp(head: Head, strands: StrandSet) -> Head:
    return head if head.scalp.any() else find_scalp(head, strands.roots)
