"""Deforming a closed mesh until its silhouettes are the hair masks (Z-5, eq. 2; M-32)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import igl
import numpy as np
from scipy.ndimage import gaussian_filter1d, map_coordinates
from scipy.sparse import csc_array, identity
from scipy.sparse.linalg import SuperLU, splu

from ..errors import require
from ..geometry.camera import project, resized, towards, unproject
from ..geometry.view_raster import raster_mesh
from ..progress import NO_PROGRESS, Progress
from ..types import Bools, Camera, Float64, Floats, Head, Mesh
from .contours import match_outlines, outline, outward_normals, resample_closed
from .solid import scalp_centre
from .views import View

_FACING = 0.5  # cosine between the normals of matched points, from which on a match counts
_BLEND = 0.06  # metres of depth around the head's middle over which the two warps of a view pass into each other
_GRAIN = 1.5  # points of an outline over which moves are averaged
_SLIDING = 3.0  # pixels, up to which a move along the outline says nothing; from three times that it counts in full
_UNSEEN = 0.3  # sum over views of the squared sine between a direction and theirs, below which none sees along it
_LATTICE = 40  # nodes along the longer side of a picture at which a warp is evaluated


@dataclass(frozen=True, slots=True)
class DeformationParams:
    """Settings of deform_to_masks.

    rounds : matchings of outlines, each followed by a solve. smoothness : lambda of eq. 2.
    picture_px : longer side of the pictures in which outlines are compared. outline_points : points of an outline.
    warp_smoothing : stiffness of the thin-plate splines; 0 goes through all landmarks.
    held : weight that keeps vertices inside the head in their places. still : the same for all vertices. depth : the
        same along directions that no view sees across, so that the hairstyle decides the depth there.
    """

    rounds: int = 4
    solves: int = 2
    smoothness: float = 1.0
    picture_px: int = 320
    outline_points: int = 200
    warp_smoothing: float = 1e-3
    held: float = 4.0
    still: float = 1e-3
    depth: float = 0.1

    def __post_init__(self) -> None:
        require(0 <= self.rounds <= 50, f"{self.rounds} rounds of deformation; take 0 to 50")
        require(1 <= self.solves <= 50, f"{self.solves} solves a round; take 1 to 50")
        require(self.smoothness >= 0, f"the smoothness is {self.smoothness}; it must be 0 or more")
        require(self.picture_px >= 32, f"pictures of {self.picture_px} pixels are too small; take 32 or more")
        require(self.outline_points >= 16, f"an outline of {self.outline_points} points; take 16 or more")
        require(self.warp_smoothing >= 0, f"the warp's smoothing is {self.warp_smoothing}; it must be 0 or more")
        weights = f"held {self.held}, still {self.still}, depth {self.depth}"
        require(min(self.held, self.depth) >= 0 and self.still > 0, f"{weights}: 0 or more, and still above 0")


class ThinPlateSpline:
    """f(x) = a0 + A x + sum_k w_k r_k^2 log r_k through landmarks (M-32), r_k the distance to landmark k.

    Parameters
    ----------
    sources, values : (n, 2) and (n, c) float64. smoothing : 0 interpolates; more lets the landmarks be missed for a
        smoother function (in units of the spread of the sources).
    """

    def __init__(self, sources: Float64, values: Float64, smoothing: float = 0.0) -> None:
        self._middle = sources.mean(axis=0)
        self._scale = max(float(np.abs(sources - self._middle).max()), 1e-12)
        self._sources = (sources - self._middle) / self._scale
        count = len(sources)
        system = np.zeros((count + 3, count + 3))
        system[:count, :count] = _bending(self._sources, self._sources) + smoothing * np.eye(count)
        system[:count, count:] = np.column_stack([np.ones(count), self._sources])
        system[count:, :count] = system[:count, count:].T
        right = np.concatenate([values, np.zeros((3, values.shape[1]))])
        system[count:, count:] = -1e-9 * np.eye(3)  # landmarks on one line leave the affine part open
        self._weights: Float64 = np.linalg.solve(system, right)

    def __call__(self, points: Float64) -> Float64:
        """(m, c) float64, the function at points (m, 2)."""
        places = (points - self._middle) / self._scale
        terms = np.column_stack([_bending(places, self._sources), np.ones(len(places)), places])
        return np.asarray(terms @ self._weights)


@dataclass(frozen=True, slots=True)
class Warp:
    """W_i: where a view wants points to move in its picture; thin-plate splines, evaluated on a lattice.

    The border of the hair on the head tells of the hair before the head alone, so there are two: one through all
    landmarks, for points nearer than the middle of the head, and one through those on the border with the background.

    before, behind : (rows, columns, 2) float64, pixels. low : (2,), the pixel of node (0, 0). step : pixels between
    nodes. middle : metres, the depth of the head's middle.
    """

    camera: Camera
    before: Float64
    behind: Float64
    low: Float64
    step: float
    middle: float

    def targets(self, points: Float64) -> Float64:
        """(n, 3) float64, metres: points (n, 3), metres, moved in the plane of the picture, at their depth."""
        seen = project(self.camera, points)
        nodes = ((seen[:, :2] - self.low) / self.step)[:, ::-1].T
        share = np.clip(0.5 + (seen[:, 2:] - self.middle) / _BLEND, 0.0, 1.0)
        moves = (1.0 - share) * _sampled(self.before, nodes) + share * _sampled(self.behind, nodes)
        return unproject(self.camera, seen[:, :2] + moves, seen[:, 2])


@dataclass(frozen=True, slots=True)
class Displacement:
    """The deformation as a map of space: the warps of each round, without the smoothness term of eq. 2."""

    rounds: tuple[tuple[Warp, ...], ...] = field(default_factory=tuple)
    still: float = 1e-3

    def __call__(self, points: Floats) -> Float64:
        """(n, 3) float64, metres: where points (n, 3), metres, world space, go."""
        moved = np.asarray(points, np.float64)
        for warps in self.rounds:
            system, right = _projections(warps, moved)
            system = system + self.still * np.eye(3)
            right += self.still * moved
            moved = np.linalg.solve(system, right[..., None])[..., 0]
        return moved


class _Silhouette:
    """A view in a small picture: its mask's outline, and which parts of that border on the head."""

    def __init__(self, view: View, head: Head, picture_px: int, count: int) -> None:
        scale = min(1.0, picture_px / max(view.camera.size))
        self.camera = resized(view.camera, scale)
        self.mask = shrink_mask(view.mask, self.camera.size)
        self._head_depth = raster_mesh(self.camera, head.vertices, head.triangles).depth
        self._head = np.isfinite(self._head_depth)
        self._diagonal = float(np.hypot(*self.camera.size))
        self._count = count
        self.middle = float(project(view.camera, scalp_centre(head))[2])
        self._target = self._outline(self.mask, 2 * count)
        self._around = self._outline(self.mask | self._head, 2 * count)

    def landmarks(self, mesh: Mesh, points: Float64) -> tuple[Float64, Float64, Bools]:
        """(n, 2) places on the mesh's outline as seen, (n, 2) their moves to the mask's, (n,) which border the head.

        Where the hair borders on the head in one of the two outlines and on the background in the other, or they face
        different ways, a pair says nothing. When most do, as for a ring of hair against an open one, the outlines of
        hair and head together are taken.
        """
        depth = raster_mesh(self.camera, points, mesh.triangles).depth
        seen = depth < self._head_depth
        own = self._outline(seen, self._count)
        if len(own) and len(self._target):
            target = match_outlines(own, self._target, self._diagonal)
            facing, wanted = outward_normals(own), outward_normals(target)
            sound = (facing * wanted).sum(axis=1) > _FACING
            on_head = _at(self._head, own + 2.0 * facing)
            sound &= on_head == _at(self._head, target + 2.0 * wanted)
            if sound.mean() > 0.5:
                return own[sound], _without_sliding(target - own, facing)[sound], on_head[sound]
        own = self._outline(np.isfinite(depth) | self._head, self._count)
        if not (len(own) and len(self._around)):
            return np.empty((0, 2)), np.empty((0, 2)), np.empty(0, np.bool_)
        target = match_outlines(own, self._around, self._diagonal)
        # where both outlines are the head's there is no hair, and nothing to move
        matters = _near(seen, own) | _near(self.mask, target)
        moves = _without_sliding(target - own, outward_normals(own))
        return own[matters], moves[matters], np.zeros(int(matters.sum()), np.bool_)

    def _outline(self, region: Bools, count: int) -> Float64:
        curve = outline(region)
        return resample_closed(curve, count) if len(curve) >= 8 else np.empty((0, 2))


def _without_sliding(moves: Float64, normals: Float64) -> Float64:
    """Moves (n, 2), pixels, of a few pixels without their part along the outline.

    A match is no surer than a few pixels along the outline; without this the vertices would drift from round to round.
    """
    across = (moves * normals).sum(axis=1, keepdims=True) * normals
    # the grain of the pictures is in both outlines, and the splines would follow it
    moves, across = (gaussian_filter1d(part, _GRAIN, axis=0, mode="wrap") for part in (moves, across))
    sure = np.clip((np.linalg.norm(moves, axis=1, keepdims=True) - _SLIDING) / (2.0 * _SLIDING), 0.0, 1.0)
    return np.asarray(across + sure * (moves - across))


def shrink_mask(mask: Bools, size: tuple[int, int]) -> Bools:
    """The mask (H, W) in a picture of another size (width, height): pixels that are at least half covered."""
    return np.asarray(cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA) >= 0.5)


def deform_to_masks(
    mesh: Mesh,
    views: Sequence[View],
    head: Head,
    params: DeformationParams = DeformationParams(),
    *,
    held: Bools | None = None,
    progress: Progress = NO_PROGRESS,
) -> tuple[Mesh, Displacement]:
    """Move the vertices of a closed mesh until its silhouettes are those of the masks (Zhang et al. 2017, eq. 2; Z-5).

    A round: outlines of hair and head together are matched in order (M-32), a thin-plate spline W_i of each view takes
    one to the other, and the vertices solve

        sum_j [ sum_i |P_di (p'_j - W_i(p_j))|^2 + lambda |L p'_j - delta_j L p'_j / |L p'_j||^2 ]

    with L the cotangent Laplacian of the mesh given (not divided by areas, so that both terms are metres squared) and
    delta_j = |L p_j| there. The direction of L p' is frozen from the last iterate.

    Parameters
    ----------
    mesh : closed, 5,000-20,000 vertices for speed. views : 1 to 8. held : (V,) bool, vertices to keep in place.

    Returns
    -------
    The mesh G_DEF with the same triangles, and the deformation for any other point.
    """
    require(len(views) >= 1, "there is no view to fit the shape to; give one or more")
    require(len(mesh.triangles) > 0, "the shape to deform has no faces; choose another hairstyle")
    silhouettes = [_Silhouette(view, head, params.picture_px, params.outline_points) for view in views]
    solver = _ShapeSolver(mesh, [s.camera for s in silhouettes], params, held)
    points = mesh.vertices.astype(np.float64)
    rounds: list[tuple[Warp, ...]] = []
    for number in range(params.rounds):
        progress(number / params.rounds, "deforming the shape to the masks")
        warps = _warps(silhouettes, mesh, points, params)
        if not warps:
            break
        points = solver.solve(points, warps)
        rounds.append(warps)
    deformed = Mesh(points.astype(np.float32), mesh.triangles)
    return deformed, Displacement(tuple(rounds), params.still)


def _warps(
    silhouettes: Sequence[_Silhouette], mesh: Mesh, points: Float64, params: DeformationParams
) -> tuple[Warp, ...]:
    warps = []
    for silhouette in silhouettes:
        sources, moves, on_head = silhouette.landmarks(mesh, points)
        if len(sources) >= 3:
            warps.append(make_warp(silhouette.camera, sources, moves, on_head, points, silhouette.middle, params))
    return tuple(warps)


def make_warp(
    camera: Camera,
    sources: Float64,
    moves: Float64,
    on_head: Bools,
    points: Float64,
    middle: float,
    params: DeformationParams,
) -> Warp:
    """The warp with landmarks (n, 2) and their moves (n, 2), pixels, on a lattice around points (m, 3), metres.

    on_head : (n,) bool, the landmarks on the border with the head. middle : metres, see Warp.
    """
    seen = project(camera, points)[:, :2]
    seen = seen[np.isfinite(seen).all(axis=1)]
    low = np.minimum(seen.min(axis=0), sources.min(axis=0)) - 0.1 * max(camera.size)
    high = np.maximum(seen.max(axis=0), sources.max(axis=0)) + 0.1 * max(camera.size)
    step = float((high - low).max()) / _LATTICE
    counts = np.ceil((high - low) / step).astype(np.int64) + 1
    nodes = np.stack(np.meshgrid(*(np.arange(n) * step for n in counts), indexing="xy"), axis=-1) + low

    def lattice(chosen: Bools) -> Float64:
        spline = ThinPlateSpline(sources[chosen], moves[chosen], params.warp_smoothing)
        # far from all landmarks the affine part runs away
        furthest = 1.5 * float(np.abs(moves[chosen]).max()) + 1e-9
        return np.clip(spline(nodes.reshape(-1, 2)).reshape(nodes.shape), -furthest, furthest)

    before = lattice(np.ones(len(sources), np.bool_))
    parted = on_head.any() and (~on_head).sum() >= 3
    return Warp(camera, before, lattice(~on_head) if parted else before, low, step, middle)


class _ShapeSolver:
    """Eq. 2 for fixed warps: sparse factors of (S + lambda L'L) that last for all rounds."""

    def __init__(self, mesh: Mesh, cameras: Sequence[Camera], params: DeformationParams, held: Bools | None) -> None:
        rest = mesh.vertices.astype(np.float64)
        self._rest, self._params = rest, params
        self._laplacian = cotangent_laplacian(mesh)
        self._lengths = np.linalg.norm(self._laplacian @ rest, axis=1)
        self._anchor = np.full(len(rest), params.still)
        if held is not None:
            self._anchor[held] += params.held
        # all views see all vertices from about the same side: one matrix S, in whose axes the three coordinates part
        middle = rest.mean(axis=0, keepdims=True)
        self._axes, self._factors = self._factor([towards(camera, middle)[0] for camera in cameras])

    def _factor(self, directions: Sequence[Float64]) -> tuple[Float64, list[SuperLU]]:
        self._common = sum((np.eye(3) - np.outer(d, d) for d in directions), np.zeros((3, 3)))
        strengths, axes = np.linalg.eigh(self._common)
        self._depth = np.where(strengths < _UNSEEN, self._params.depth, 0.0)
        strengths = strengths + self._depth
        squared = self._params.smoothness * (self._laplacian.T @ self._laplacian)
        anchors = csc_array((self._anchor, (np.arange(len(self._rest)),) * 2), shape=squared.shape)
        factors: list[SuperLU] = []
        for number, strength in enumerate(strengths):
            if number and abs(strength - strengths[number - 1]) < 1e-9:
                factors.append(factors[-1])
                continue
            system = squared + anchors + strength * identity(len(self._rest))
            factors.append(splu(csc_array(system), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}))
        return np.asarray(axes), factors

    def solve(self, points: Float64, warps: Sequence[Warp]) -> Float64:
        """(V, 3) float64, metres: the vertices after a round that begins at points (V, 3)."""
        system, wanted = _projections(warps, points)
        wanted += self._anchor[:, None] * self._rest
        wanted += (self._rest @ self._axes * self._depth) @ self._axes.T
        for _ in range(self._params.solves):
            laplace = self._laplacian @ points
            lengths = np.linalg.norm(laplace, axis=1)
            frozen = laplace * (self._lengths / np.maximum(lengths, 1e-12))[:, None]
            right = wanted + self._params.smoothness * (self._laplacian.T @ frozen)
            # what perspective makes of S at each vertex beyond the common one is taken from the last iterate
            right += np.einsum("vij,vj->vi", self._common - system, points)
            turned = right @ self._axes
            solved = np.stack([factor.solve(turned[:, k]) for k, factor in enumerate(self._factors)], axis=1)
            points = solved @ self._axes.T
        return points


def cotangent_laplacian(mesh: Mesh) -> csc_array:
    """(V, V) sparse: sum over neighbours of (cot a + cot b) / 2 (p_k - p_j), not divided by areas; cotangents >= 0.01.

    Slivers of marching cubes have cotangents of any size and sign; bounded ones keep the matrix well conditioned.
    """
    vertices, triangles = mesh.vertices.astype(np.float64), mesh.triangles.astype(np.int64)
    cotangents = np.clip(igl.cotmatrix_entries(vertices, triangles), 0.01, 5.0)
    # entry k of igl belongs to the edge opposite of corner k
    rows = np.concatenate([triangles[:, [1, 2, 0]].ravel(), triangles[:, [2, 0, 1]].ravel()])
    columns = np.concatenate([triangles[:, [2, 0, 1]].ravel(), triangles[:, [1, 2, 0]].ravel()])
    weights = np.tile(cotangents.ravel(), 2)
    count = len(vertices)
    off = csc_array((weights, (rows, columns)), shape=(count, count))
    sums = np.asarray(off.sum(axis=1)).ravel()
    diagonal = csc_array((sums, (np.arange(count),) * 2), shape=(count, count))
    return csc_array(off - diagonal)


def _projections(warps: Sequence[Warp], points: Float64) -> tuple[Float64, Float64]:
    """(n, 3, 3) sum_i P_di and (n, 3) sum_i P_di W_i(p)."""
    system = np.zeros((len(points), 3, 3))
    right = np.zeros((len(points), 3))
    for warp in warps:
        directions = towards(warp.camera, points)
        flat = np.eye(3) - directions[:, :, None] * directions[:, None, :]
        system += flat
        right += np.einsum("nij,nj->ni", flat, warp.targets(points))
    return system, right


def _sampled(lattice: Float64, nodes: Float64) -> Float64:
    values = [map_coordinates(lattice[..., axis], nodes, order=1, mode="nearest") for axis in range(2)]
    return np.stack(values, axis=1)


def _bending(points: Float64, sources: Float64) -> Float64:
    squares = ((points[:, None] - sources[None]) ** 2).sum(axis=-1)
    return np.asarray(0.5 * squares * np.log(np.maximum(squares, 1e-300)))


def _at(region: Bools, pixels: Float64) -> Bools:
    rows = np.clip(pixels[:, 1].astype(np.int64), 0, region.shape[0] - 1)
    columns = np.clip(pixels[:, 0].astype(np.int64), 0, region.shape[1] - 1)
    return np.asarray(region[rows, columns])


def _near(region: Bools, pixels: Float64) -> Bools:
    """As `_at`, with a pixel or two of slack: matched places are means along the outline."""
    grown = region.copy()
    grown[1:] |= region[:-1]
    grown[:-1] |= region[1:]
    grown[:, 1:] |= region[:, :-1]
    grown[:, :-1] |= region[:, 1:]
    return _at(grown, pixels)


__all__ = [
    "DeformationParams",
    "Displacement",
    "ThinPlateSpline",
    "Warp",
    "cotangent_laplacian",
    "deform_to_masks",
    "make_warp",
    "shrink_mask",
]
