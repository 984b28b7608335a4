"""The two conventional methods that the paper compares with (Wang et al. 2009, sec. 6, Fig. 8; W-E7).

2D: the feature map of all strands is synthesised directly at the finest level, without wisps, details or refinement.
3D: the tangents of the hair are synthesised in slices of its volume, the one closest to the scalp first, and strands
are traced through them. Both are here to be compared with, not to be used.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import binary_closing, distance_transform_edt
from scipy.spatial import cKDTree

from ..errors import require
from ..fields.grid import build_direction_grid, dense_grid
from ..fields.tracing import trace
from ..geometry.scalp_space import ScalpSpace
from ..geometry.strands import polyline_lengths
from ..progress import NO_PROGRESS, Progress
from ..types import Bools, FeatureMap, Float32, Int32, RootedStrands
from ._texture_kernels import blend_patches
from .features import cells_around_roots, feature_map, fit_features, sample_map
from .patch_search import PatchPlaces, PatchSearch
from .texture import TextureParams, falloff_weights, fit_window, place_patches, synthesize_texture


@dataclass(frozen=True, slots=True)
class Synthesis2DParams:
    """Settings of synthesize_2d."""

    map_spacing: float = 0.01  # radians between the cells: about a root a cell at ten thousand strands
    n_features: int = 16
    texture: TextureParams = field(default_factory=TextureParams)

    def __post_init__(self) -> None:
        require(self.map_spacing > 0, f"map_spacing is {self.map_spacing}; it must be above 0")
        require(self.n_features >= 1, f"n_features is {self.n_features}; it must be 1 or more")


@dataclass(frozen=True, slots=True)
class Synthesis3DParams:
    """Settings of synthesize_3d."""

    spacing: float = 0.04  # edge of a cell, radians and head radii
    window: int = 8  # cells of a neighbourhood in u and v
    depth: int = 3  # slices of a neighbourhood: the one in work and those below it
    n_iterations: int = 10  # M- and E-steps a slice
    texture: TextureParams = field(default_factory=TextureParams)  # of the first slice; its exponent for all

    def __post_init__(self) -> None:
        require(self.spacing > 0, f"spacing is {self.spacing}; it must be above 0")
        require(self.window >= 2, f"window is {self.window}; it must be 2 or more")
        require(self.depth >= 1, f"depth is {self.depth}; it must be 1 or more")
        require(self.n_iterations >= 1, f"n_iterations is {self.n_iterations}; it must be 1 or more")


def synthesize_2d(
    example: RootedStrands,
    roots: RootedStrands,
    params: Synthesis2DParams = Synthesis2DParams(),
    *,
    seed: int = 0,
    progress: Progress = NO_PROGRESS,
) -> RootedStrands:
    """Conventional 2D synthesis at the finest level (Wang et al. 2009, sec. 6, Fig. 8 top; W-E7).

    Parameters
    ----------
    example : the example's finest level.
    roots : where the new strands grow; only its roots, frames and uv are used.

    Returns
    -------
    RootedStrands at `roots` with the example's number of points.

    Raises
    ------
    InputError : no strands or no roots; Cancelled : from `progress`.
    """
    basis = fit_features(example.points, params.n_features)
    source = feature_map(example.uv, basis.encode(example.points), params.map_spacing)
    origin, mask = cells_around_roots(roots.uv, params.map_spacing)
    settings = replace(params.texture, seed=seed)
    made = synthesize_texture(source, mask, settings, origin=origin, progress=progress).map
    return roots.with_points(basis.decode(sample_map(made, roots.uv)))


def synthesize_3d(
    example: RootedStrands,
    roots: RootedStrands,
    space: ScalpSpace,
    params: Synthesis3DParams = Synthesis3DParams(),
    *,
    seed: int = 0,
    progress: Progress = NO_PROGRESS,
) -> RootedStrands:
    """Conventional 3D synthesis of the tangent field (Wang et al. 2009, sec. 6, Fig. 8 bottom; W-E7).

    The field lies on a grid of scalp space (u, v, w) and its vectors are turned into the frames of the scalp below
    them. A neighbourhood spans `window` cells in u and v and `depth` slices in w, of which all but the uppermost are
    done already; it is compared with the example's neighbourhoods at the same height. The strands are streamlines,
    each as long as the example's strand with the nearest root.

    Parameters
    ----------
    example : strands of the example. space : the scalp that they and `roots` are on.
    roots : where the new strands grow; only its roots, frames and uv are used.

    Returns
    -------
    RootedStrands at `roots` with the example's number of points.

    Raises
    ------
    InputError : no strands or no roots; Cancelled : from `progress`.
    """
    require(example.n_strands > 0, "the example has no strands; choose one with strands")
    require(roots.n_strands > 0, "there are no roots to make hair for; choose a larger scalp region or more strands")
    grid = build_direction_grid(example.in_head_space(), space, params.spacing)
    n_u, n_v, _ = grid.shape
    u, v = (grid.origin[axis] + grid.spacing * (np.arange(n) + 0.5) for axis, n in ((0, n_u), (1, n_v)))
    centers = np.stack(np.meshgrid(u, v, indexing="ij"), axis=2).reshape(-1, 2)
    frames = space.frames_at(centers).reshape(n_u, n_v, 3, 3)
    slices = np.einsum("uvij,uvwi->wuvj", frames, grid.dense()).astype(np.float32)
    # the cells at the scalp; what lies below them is its unevenness
    scalp = min(max(int(-grid.origin[2] / grid.spacing), 0), len(slices) - 1)
    rooted = np.zeros((n_u, n_v), np.bool_)
    at = ((roots.uv - grid.origin[:2]) / grid.spacing).astype(int)
    rooted[tuple(np.clip(at, 0, np.array(rooted.shape) - 1).T)] = True
    made = _synthesize_slices(slices[scalp:], binary_closing(rooted), params, seed, progress)
    made = np.concatenate([np.repeat(made[:1], scalp, axis=0), made])
    vectors = np.einsum("uvij,wuvj->uvwi", frames, made)
    lengths = np.linalg.norm(vectors, axis=3, keepdims=True)
    # averages of full and empty cells are short; those with more emptiness than hair end the strands, as cells without
    vectors = np.where(lengths > 0.5, vectors / np.maximum(lengths, 1e-9), 0.0).astype(np.float32)
    field_grid = replace(dense_grid(vectors, grid.origin, grid.spacing), space=space)
    _, nearest = cKDTree(example.uv).query(roots.uv)
    reach = polyline_lengths(example.points)[nearest]
    points, _ = trace(field_grid, roots.roots, reach, 0.5 * grid.spacing, n_points=example.n_points)
    local = np.matmul(points - roots.roots[:, None, :], roots.frames)
    return roots.with_points(np.ascontiguousarray(local, dtype=np.float32))


def _synthesize_slices(
    slices: Float32, rooted: Bools, params: Synthesis3DParams, seed: int, progress: Progress
) -> Float32:
    """New slices (W, H, V, 3) of vectors like those of the example, from the scalp outwards; cells without hair are 0.

    slices (W, H, V, 3): the example's. rooted (H, V): where the new hair has roots.
    """
    require(slices[0].any(), "the example has no hair at the scalp; check that its roots are on the head")
    bottom = FeatureMap(np.ascontiguousarray(slices[0]), slices[0].any(axis=2), np.zeros(2), params.spacing)
    first = synthesize_texture(bottom, rooted, replace(params.texture, seed=seed))
    made = [first.map.values]
    rows, columns = distance_transform_edt(~rooted, return_distances=False, return_indices=True)
    sources = first.source[rows, columns]
    # hair may leave the columns of its roots, but not those of the example's hair
    mask = slices.any(axis=(0, 3))
    for height in range(1, len(slices)):
        progress(height / len(slices), "Synthesizing the slices of the hair volume")
        below = range(max(0, height - params.depth + 1), height)
        known = np.concatenate([np.empty((*mask.shape, 0), np.float32), *(made[k] for k in below)], axis=2)
        example = np.concatenate([*(slices[k] for k in below), slices[height]], axis=2)
        values, sources = _synthesize_slice(example, known, mask, sources, params)
        made.append(values)
    return np.stack(made)


def _synthesize_slice(
    example: Float32, known: Float32, mask: Bools, sources: Int32, params: Synthesis3DParams
) -> tuple[Float32, Int32]:
    """One slice (H, V, 3) and its sources, by texture optimisation of its channels with the others held.

    example (H, V, 3 d): the example's slices from the lowest to this one; known (H, V, 3 (d - 1)): those that are done;
    mask (H, V): the cells to use and to make; sources (H, V, 2): of the slice below, where this one starts from.
    """
    window, corners = fit_window(mask, params.window)
    positions = np.zeros((len(corners), 2))
    search = PatchSearch(np.ascontiguousarray(example), mask, PatchPlaces(corners, positions), falloff_weights(window))
    grid = place_patches(mask, window)
    places = PatchPlaces(grid.corners, np.zeros((len(grid.corners), 2)))
    start = example[sources[..., 0], sources[..., 1], known.shape[2] :]
    image = np.ascontiguousarray(np.concatenate([known, start], axis=2))
    half = window // 2
    matches = search.first_matches(sources[tuple((grid.corners + half).T)] - half)
    tiny = max(1e-6 * search.variance, 1e-30)
    for _ in range(params.n_iterations):
        before = matches.chosen
        matches = search.improve(image, places, matches)
        weights = (matches.costs + tiny) ** (0.5 * params.texture.exponent - 1.0)
        chosen = search.candidates[matches.chosen]
        image, used = blend_patches(
            image, search.example, grid.rows, grid.columns, grid.patch_at, chosen, weights, search.falloff
        )
        image[..., : known.shape[2]] = known
        sources = np.where(used >= 0, used, sources)
        if np.array_equal(before, matches.chosen):
            break
    return np.where(mask[..., None], image[..., known.shape[2] :], np.float32(0.0)), sources
