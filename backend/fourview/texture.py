"""The hair texture: photos from several sides made one over the rough shape by patch-based synthesis.

Zhang et al. 2017, sec. 4.2 and 4.3 (Z-10 ... Z-18). At each of several scales, coarse first, and in each of some
iterations: for every view the texels that it does not see well are synthesised from patches of its photo that resemble
the texture so far; the results are blended by how much the view faces the surface; and a screened Poisson equation
draws the blend towards the strongest gradients, so that it is not blurred (Algorithm 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..errors import require
from ..fields.nearest import fill_pixels
from ..geometry.camera import project
from ..progress import NO_PROGRESS, Progress, subrange
from ..types import Bools, Float32, Int32, Mesh, check_array
from ._voting_kernels import pack, patches_of_texels, sample_pixels, vote
from .patch_search import Matches, PatchSearch, carry_to_finer, start_matches, turns
from .patch_sources import Sources, UInt32, sources_at, surface_in_photo
from .poisson import PoissonSolver, blend_views
from .projection import ViewsOnTexels, initial_texture, project_views
from .shape import RoughShape
from .surface import HairSurface, Level
from .texels import TexelMap
from .views import View

UInt8 = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class SurfaceTextureParams:
    """Settings of synthesize_texture."""

    iterations: tuple[int, ...] = (20, 10, 5, 2)  # of each scale, coarse first (sec. 5)
    rotation: float = float(np.pi / 15)  # the largest turn of a patch in its plane, radians (Z-16)
    scale: float = 1.1  # a patch is at most so much larger, or 2 - this as small (Z-16)
    screening: float = 0.1  # w_s, weight of colours against gradients; not stated in the paper
    keep_angle: float = 1.3  # texels that no view sees within theta keep the photo that faces them most, up to here
    least_facing: float = 0.2  # a texel that no view faces by this cosine takes part of it from every view
    seed: int = 0

    def __post_init__(self) -> None:
        require(len(self.iterations) >= 1, "iterations is empty; name the number for each scale, coarse first")
        require(
            all(0 <= n <= 1000 for n in self.iterations), f"iterations are {self.iterations}; each must be 0 to 1000"
        )
        require(0 <= self.rotation <= np.pi, f"rotation is {self.rotation:g}; it must be 0 to pi")
        require(1 <= self.scale <= 1.9, f"scale is {self.scale:g}; it must be 1 to 1.9")
        require(self.screening > 0, f"screening is {self.screening:g}; it must be above 0")
        require(0 <= self.keep_angle <= np.pi / 2, f"keep_angle is {self.keep_angle:g}; it must be 0 to pi / 2")
        require(0 < self.least_facing <= 1, f"least_facing is {self.least_facing:g}; it must be above 0, at most 1")


@dataclass(frozen=True, slots=True)
class HairTexture:
    """The colours of T texels of a texture of size x size.

    texels : (T,) int32, row * size + column, as in the surface's finest TexelMap. colour : (T, 3) float32 in [0, 1],
    sRGB. coverage : (T,) float32 in [0, 1], how well the best view sees the texel: the cosine between normal and view,
    0 where the texel is synthesised.
    """

    size: int
    texels: Int32
    colour: Float32
    coverage: Float32

    def __post_init__(self) -> None:
        check_array("texels", self.texels, np.int32, (None,))
        check_array("colour", self.colour, np.float32, (len(self.texels), 3))
        check_array("coverage", self.coverage, np.float32, (len(self.texels),))

    def image(self) -> UInt8:
        """(size, size, 3) uint8; what lies outside the charts has the nearest texel's colour."""
        picture = np.zeros((self.size * self.size, 3), np.uint8)
        picture[self.texels] = np.rint(np.clip(self.colour, 0, 1) * 255)
        known = np.zeros(self.size * self.size, np.bool_)
        known[self.texels] = True
        return fill_pixels(picture.reshape(self.size, self.size, 3), known.reshape(self.size, self.size))


def blend_weights(on_texels: ViewsOnTexels, least_facing: float) -> Float32:
    """(n, T) float32, alpha of Z-14: cosines between normal and view over their sum.

    Where the best cosine is below `least_facing` what is missing is added to all views, so that texels that no view
    faces (top and underside of four level views, the back of one) are synthesised too. Views without any texel of S
    have no weight, nor have shares of below 0.02.
    """
    usable = on_texels.seen.any(axis=1)
    weights = on_texels.facing * usable[:, None]
    weights += np.maximum(np.float32(least_facing) - weights.max(axis=0), 0) * usable[:, None].astype(np.float32)
    total = weights.sum(axis=0)
    weights /= np.where(total > 0, total, 1)
    weights[weights < 0.02] = 0
    total = weights.sum(axis=0)
    return np.asarray(weights / np.where(total > 0, total, 1), np.float32)


def synthesize_texture(
    surface: HairSurface,
    shape: RoughShape | Mesh,
    views: Sequence[View],
    params: SurfaceTextureParams = SurfaceTextureParams(),
    *,
    progress: Progress = NO_PROGRESS,
) -> HairTexture:
    """One texture from all photos: Algorithm 1 of Zhang et al. 2017 (Z-12 ... Z-18; M-35, M-36).

    Parameters
    ----------
    surface : with as many levels as `params.iterations` has numbers. shape : the closed shape, which hides texels from
        views. views : 1 or more. progress : called once an iteration; may raise Cancelled.

    Returns
    -------
    HairTexture of the finest level's texels; the same for any number of threads.

    Raises
    ------
    InputError : another number of levels than of iterations; no views, or none sees the surface.
    """
    require(
        len(surface.levels) == len(params.iterations),
        f"the surface has {len(surface.levels)} scales, iterations are {params.iterations}; give one number a scale",
    )
    occluder = shape if isinstance(shape, Mesh) else shape.closed
    on_texels = []
    for number, level in enumerate(surface.levels):
        progress(0.05 * number / len(surface.levels), "Hair texture: what the views see")
        on_texels.append(project_views(level.texels, views, occluder))
    synthesis = _Synthesis(surface.levels, on_texels, views, params)
    initial = initial_texture(surface.levels[0].texels, on_texels[0], views)
    colour = np.clip(synthesis.run(initial, subrange(progress, 0.05, 1.0)), 0, 1)
    finest = on_texels[-1]
    kept = kept_texels(finest, params.keep_angle)
    coverage = np.where(kept, finest.facing, 0).max(axis=0).astype(np.float32)
    texels = surface.levels[-1].texels
    return HairTexture(texels.size, texels.texels, colour, coverage)


def kept_texels(on_texels: ViewsOnTexels, keep_angle: float) -> Bools:
    """(n, T) bool, the texels whose photo is taken as it is in the result of a view.

    S, as in the paper; and beyond it texels that are in no view's S, in the view that faces them most of those that see
    them, up to `keep_angle` between normal and view. Without these the top of the head, which four level views see at
    60 degrees, would be synthesised as if it were not in any photo. Source patches are of S alone.
    """
    lost = ~on_texels.seen.any(axis=0)
    facing = np.where(on_texels.visible & lost, on_texels.facing, 0)
    kept = on_texels.seen.copy()
    best = facing.argmax(axis=0)
    texels = np.flatnonzero(facing.max(axis=0) > np.cos(keep_angle) + 1e-6)
    kept[best[texels], texels] = True
    return kept


class _Scale:
    """What one scale keeps through its iterations."""

    def __init__(self, level: Level, sources: Sources, on_texels: ViewsOnTexels, weights: Float32, kept: Bools) -> None:
        self.level, self.sources, self.weights = level, sources, weights
        n_views, n_texels = weights.shape
        spacing = np.float32(level.texels.spacing)
        self._surface = level.vertices / spacing, level.normals, level.tangents, level.bitangents
        self._texels = level.texels.points / spacing, level.texels.normals
        self._offsets, self._members = patches_of_texels(level.patch_texels, n_texels)
        self.needed: Bools = _with_neighbours(weights > 0, level.texels.edges) & ~kept
        self._wanted = [np.flatnonzero(row) for row in self.needed]
        self.results = np.zeros((n_views, n_texels, 3), np.float32)
        for view in range(n_views):
            where = np.flatnonzero(kept[view])
            pixels = sources.pixels(view, on_texels.pixels[view])
            sample_pixels(sources.image(view), sources.frames[view], pixels, where, self.results[view])

    def vote(self, matches: Matches, colours: Float32) -> tuple[Float32, Float32]:
        """The results of all views from their matches (eq. 5, Z-18), blended: colours (T, 3) and gradients (E, 3)."""
        for view in range(len(self.results)):
            position = matches.position[view]
            turn = turns(self.sources.jacobians_at(view, position), matches.transform[view])
            table = np.concatenate([(matches.owner[view] != -2)[:, None], position, turn], axis=1, dtype=np.float32)
            vote(
                self.sources.image(view), self.sources.frames[view], table, self._surface, self._texels, self._offsets,
                self._members, self._wanted[view], colours, self.results[view],
            )  # fmt: skip
        return blend_views(self.results, self.weights, self.level.texels.edges)


def _with_neighbours(chosen: Bools, edges: Int32) -> Bools:
    """(n, T): the chosen texels and those with an edge to one, so that each gradient of a result has both ends."""
    wider = chosen.copy()
    for row, wide in zip(chosen, wider):
        wide[edges[row[edges[:, 0]], 1]] = True
        wide[edges[row[edges[:, 1]], 0]] = True
    return wider


def packed(colours: Float32) -> UInt32:
    """(T,) uint32 of colours (T, 3) float32 in [0, 1]."""
    out = np.empty(len(colours), np.uint32)
    pack(np.ascontiguousarray(colours), out)
    return out


class _Synthesis:
    """The whole of Algorithm 1 over given levels, what the views see of them, and what to start with."""

    def __init__(self, levels: Sequence[Level], on_texels: Sequence[ViewsOnTexels], views: Sequence[View],
                 params: SurfaceTextureParams) -> None:  # fmt: skip
        self._levels, self._on_texels, self._views, self._params = levels, on_texels, views, params
        finest = on_texels[-1]
        self._photos = tuple(
            surface_in_photo(view, levels[-1].texels, finest.pixels[i], finest.seen[i]) for i, view in enumerate(views)
        )
        self._limits = np.array([params.rotation, 2 - params.scale, params.scale], np.float32)

    def _start(self, number: int, before: tuple[Level, Matches, Sources] | None) -> tuple[_Scale, Matches]:
        """A scale and its first matches, from those of the scale `before` it."""
        level, seen = self._levels[number], self._on_texels[number]
        sources = sources_at(self._photos, level.texels.spacing, level.patch_size, self._params.scale)
        weights = blend_weights(seen, self._params.least_facing)
        scale = _Scale(level, sources, seen, weights, kept_texels(seen, self._params.keep_angle))
        pixels = np.stack([project(view.camera, level.vertices)[:, :2] for view in self._views])
        seed = self._params.seed + number
        matches = start_matches(level, sources, pixels, seen.seen, scale.needed, seed)
        if before is not None:
            carry_to_finer(*before, level, matches, sources)
        return scale, matches

    def run(self, initial: Float32, progress: Progress) -> Float32:
        """Colours (T, 3) of the finest scale; initial (T, 3) are those of the coarsest."""
        colours, before = initial, None
        iterations = self._params.iterations
        for number, level in enumerate(self._levels):
            part = subrange(progress, number / len(self._levels), (number + 1) / len(self._levels))
            part(0.0, f"Hair texture: scale {number + 1} of {len(self._levels)}")
            scale, matches = self._start(number, before)
            solver = PoissonSolver(level.texels.edges, level.texels.n_texels, self._params.screening)
            if before is not None:
                colours = _to_finer(before[0].texels, level.texels, colours)
                colours = solver.solve(*scale.vote(matches, colours))
            searches = PatchSearch(level, scale.sources, self._limits, self._params.seed + number)
            for iteration in range(1, iterations[number] + 1):
                searches.improve(matches, packed(colours), iteration)
                colours = solver.solve(*scale.vote(matches, colours))
                part(iteration / iterations[number], f"Hair texture: scale {number + 1}, iteration {iteration}")
            before = level, matches, scale.sources
        return colours


def _to_finer(coarse: TexelMap, fine: TexelMap, colours: Float32) -> Float32:
    """(T, 3): each texel of the finer scale with the colour of the coarse texel that it lies in, or the nearest."""
    ratio = fine.size // coarse.size
    row, column = np.divmod(fine.texels.astype(np.int64), fine.size)
    found = coarse.grid()[row // ratio, column // ratio]
    lost = np.flatnonzero(found < 0)
    if len(lost):
        found[lost] = cKDTree(coarse.points).query(fine.points[lost])[1]
    return np.asarray(colours[found])
