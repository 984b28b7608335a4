"""PatchMatch between flat images, and filling of holes with it (Barnes et al. 2009, Wexler et al. 2007; M-35, M-36).

The four-view method does the same on a surface (`texture.py`); flat images are where it is compared with others.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..errors import require
from ..fields.nearest import fill_pixels
from ..types import Bools, Float32, Int32, check_array
from ._planar_kernels import LANES, first_matches, match_once, vote_flat
from .views import UInt8

# rows, about, that are searched one after another; other bands' matches are one iteration old at the border
_BAND = 50


@dataclass(frozen=True, slots=True)
class PatchMatchParams:
    """Settings of match_patches."""

    patch_size: int = 7  # pixels along a side
    n_iterations: int = 5
    seed: int = 0

    def __post_init__(self) -> None:
        require(1 <= self.patch_size <= 10, f"patch_size is {self.patch_size}; it must be 1 to 10")
        require(0 <= self.n_iterations <= 1000, f"n_iterations is {self.n_iterations}; it must be 0 to 1000")


@dataclass(frozen=True, slots=True)
class PatchMatches:
    """For each patch of an image its match in another.

    place : (h, w, 2) int32, column and row of the match's first pixel, for the patch whose first pixel is at (row,
    column) of the array. distance : (h, w) int32, sum of squared differences of 8-bit channels.
    """

    place: Int32
    distance: Int32


class FlatSearch:
    """Matches of the patches of image `a` in image `b`, improved iteration by iteration."""

    def __init__(self, a: UInt8, b: UInt8, patch_size: int, seed: int, allowed: Bools | None = None,
                 start: Int32 | None = None) -> None:  # fmt: skip
        """a, b : (H, W, 3) uint8. allowed : bool for each place of a patch in b, all by default; some place at least.

        start : (h, w, 2) int32, matches to begin with, -1 for one at random (which may lie where it is not allowed).
        """
        self._size, self._seed = patch_size, seed
        self._places = np.array([b.shape[0], b.shape[1]], np.int64) - patch_size + 1
        shape = a.shape[0] - patch_size + 1, a.shape[1] - patch_size + 1
        self._mask = np.zeros(LANES, np.uint8)
        self._mask[: 3 * patch_size] = 255
        self._allowed = np.ones(tuple(self._places), np.uint8) if allowed is None else allowed.astype(np.uint8)
        self._a, self._b = _padded(a), _padded(b)
        self._rows = 3 * a.shape[1], 3 * b.shape[1]
        n_bands = 2 * max(1, round(shape[0] / (2 * _BAND)))  # even: two threads have the same share
        self._bands = np.linspace(0, shape[0], n_bands + 1).astype(np.int64)
        self.place, self.distance = np.empty((*shape, 2), np.int32), np.empty(shape, np.int32)
        self._iteration = 0
        begin = np.full((*shape, 2), -1, np.int32) if start is None else start
        first_matches(
            self._a, self._rows[0], self._b, self._rows[1], self._places, self._size, self._mask, seed, begin,
            self.place, self.distance,
        )  # fmt: skip

    def improve(self) -> None:
        """One iteration of propagation and random search over all patches."""
        self._iteration += 1
        border = np.full((len(self._bands) - 1, self.place.shape[1], 2), -1, np.int32)
        if self._iteration % 2 == 1:
            border[1:] = self.place[self._bands[1:-1] - 1]
        else:
            border[:-1] = self.place[self._bands[1:-1]]
        match_once(
            self._a, self._rows[0], self._b, self._rows[1], self._places, self._size, self._mask, self._bands, border,
            self._iteration, self._seed, self._allowed, self.place, self.distance,
        )  # fmt: skip


def _padded(image: UInt8) -> UInt8:
    """The bytes of an image (H, W, 3), and some more to read beyond."""
    return np.concatenate([image.reshape(-1), np.zeros(LANES, np.uint8)])


def match_patches(a: UInt8, b: UInt8, params: PatchMatchParams = PatchMatchParams()) -> PatchMatches:
    """For each patch of `a` one of `b` that is much alike: PatchMatch (Barnes et al. 2009; M-35).

    Parameters
    ----------
    a, b : (H, W, 3) uint8, of any two sizes.

    Returns
    -------
    PatchMatches for the (H_a - m + 1) x (W_a - m + 1) patches of a. The same for any number of threads.

    Raises
    ------
    InputError : an image smaller than a patch.
    """
    for name, image in (("first", a), ("second", b)):
        check_array(f"the {name} image", image, np.uint8, (None, None, 3))
        require(
            min(image.shape[:2]) >= params.patch_size,
            f"the {name} image is {image.shape[1]} x {image.shape[0]} pixels, less than a patch of {params.patch_size}",
        )
    search = FlatSearch(a, b, params.patch_size, params.seed)
    for _ in range(params.n_iterations):
        search.improve()
    return PatchMatches(search.place, search.distance)


@dataclass(frozen=True, slots=True)
class FillParams:
    """Settings of fill_hole."""

    patch_size: int = 7  # pixels along a side
    n_searches: int = 1  # iterations of PatchMatch between two votes
    n_votes: int = 8  # at each scale but the two finest, which have half and a quarter of it
    coarsest: int = 24  # pixels of the shorter side at which the pyramid ends
    seed: int = 0

    def __post_init__(self) -> None:
        require(1 <= self.patch_size <= 10, f"patch_size is {self.patch_size}; it must be 1 to 10")
        require(1 <= self.n_searches <= 100, f"n_searches is {self.n_searches}; it must be 1 to 100")
        require(1 <= self.n_votes <= 100, f"n_votes is {self.n_votes}; it must be 1 to 100")
        require(self.coarsest >= 2 * self.patch_size, f"coarsest is {self.coarsest}; it must be two patches or more")


def fill_hole(image: UInt8, hole: Bools, params: FillParams = FillParams()) -> UInt8:
    """`image` with its hole filled by patches from around it, coarse to fine (Wexler et al. 2007; M-35, M-36).

    At each scale in turn: a match outside the hole for every patch that touches it, and each pixel of the hole becomes
    the mean of what the matches of the patches over it show there, patches that match well counting more.

    Parameters
    ----------
    image : (H, W, 3) uint8. hole : (H, W) bool.

    Raises
    ------
    InputError : sizes that differ, or no patch that lies outside the hole.
    """
    check_array("the image", image, np.uint8, (None, None, 3))
    check_array("the hole", hole, np.bool_, image.shape[:2])
    require(
        _places(hole, params.patch_size)[1].any(), "no patch of the image lies outside the hole; mark a smaller one"
    )
    if not hole.any():
        return image.copy()
    scales = [(image, hole)]
    while min(scales[-1][1].shape) >= 2 * params.coarsest:
        smaller = _halved(*scales[-1])
        if not _places(smaller[1], params.patch_size)[1].any():
            break
        scales.append(smaller)
    filled_image: UInt8 | None = None
    matches: Int32 | None = None
    for number, (picture, gap) in reversed(list(enumerate(scales))):
        if filled_image is None:
            filled_image = fill_pixels(picture, ~gap)
        else:
            larger = cv2.resize(filled_image, gap.shape[::-1], interpolation=cv2.INTER_LINEAR)
            filled_image = np.where(gap[..., None], larger, picture)
        filled_image, matches = _fill_scale(
            filled_image, gap, matches, params, max(1, params.n_votes >> max(0, 2 - number))
        )
    assert filled_image is not None
    return filled_image


def _halved(image: UInt8, hole: Bools) -> tuple[UInt8, Bools]:
    """Image and hole at half the size; what is known of a pixel is the mean of its known parts."""
    size = hole.shape[1] // 2, hole.shape[0] // 2
    known = (~hole).astype(np.float32)
    weight = cv2.resize(known, size, interpolation=cv2.INTER_AREA)
    mean = cv2.resize(image * known[..., None], size, interpolation=cv2.INTER_AREA)
    small = np.rint(mean / np.maximum(weight, 1e-6)[..., None]).astype(np.uint8)
    return small, np.asarray(weight < 0.5)


def _places(hole: Bools, size: int) -> tuple[Bools, Bools]:
    """For each place of a patch whether it touches the hole, and whether it may be a source."""
    sums = np.pad(np.cumsum(np.cumsum(hole, axis=0, dtype=np.int32), axis=1, dtype=np.int32), ((1, 0), (1, 0)))
    inside = sums[size:, size:] - sums[:-size, size:] - sums[size:, :-size] + sums[:-size, :-size]
    return inside > 0, inside == 0


def _fill_scale(
    image: UInt8, hole: Bools, coarse: Int32 | None, params: FillParams, n_votes: int
) -> tuple[UInt8, Int32]:
    """One scale: the image with new colours in the hole, and the matches (h, w, 2), -1 outside the hole's surroundings.

    Only the box of patches that touch the hole is searched. coarse : the matches of the scale before.
    """
    size = params.patch_size
    touched, allowed = _places(hole, size)
    rows, columns = np.flatnonzero(touched.any(axis=1)), np.flatnonzero(touched.any(axis=0))
    box = slice(rows[0], rows[-1] + size), slice(columns[0], columns[-1] + size)
    inner = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    start = _random_places(allowed, touched[inner].shape, params.seed)
    if coarse is not None:
        larger = _larger(coarse, inner)
        good = (larger[..., 0] >= 0) & (larger[..., 0] < allowed.shape[1]) & (larger[..., 1] < allowed.shape[0])
        good[good] = allowed[larger[good][:, 1], larger[good][:, 0]]
        start[good] = larger[good]
    image = image.copy()
    for vote in range(n_votes):
        search = FlatSearch(image[box], image, size, params.seed + vote, allowed, start)
        for _ in range(params.n_searches):
            search.improve()
        start = search.place
        voted = np.empty((*hole[box].shape, 3), np.uint8)
        vote_flat(image, start, _vote_weights(search.distance, touched[inner]), size, voted)
        image[box] = np.where(hole[box][..., None], voted, image[box])
    matches = np.full((*touched.shape, 2), -1, np.int32)
    matches[inner] = start
    return image, matches


def _vote_weights(distance: Int32, touched: Bools) -> Float32:
    """(h, w) float32, exp(-d / 2 s^2) of patches that touch the hole, s^2 being half their median (M-36); else 0."""
    middle = max(float(np.median(distance[touched])), 1.0)
    # none is 0, so that every pixel of the hole gets a vote
    likeness = np.maximum(np.exp(-distance / np.float32(middle)), 1e-6)
    return np.asarray(np.where(touched, likeness, 0), np.float32)


def _random_places(allowed: Bools, shape: tuple[int, ...], seed: int) -> Int32:
    """(h, w, 2) int32: a place that may be a source, column and row, for each patch."""
    places = np.flatnonzero(allowed)
    chosen = places[np.random.default_rng(seed).integers(0, len(places), shape)]
    rows, columns = np.divmod(chosen, allowed.shape[1])
    return np.asarray(np.stack([columns, rows], axis=2), np.int32)


def _larger(coarse: Int32, box: tuple[slice, slice]) -> Int32:
    """Matches (h, w, 2) of the scale before for a box of patches at twice the size; -1 where there was none."""
    rows, columns = (np.arange(side.start, side.stop) for side in box)
    c_rows = np.minimum(rows // 2, coarse.shape[0] - 1)
    c_columns = np.minimum(columns // 2, coarse.shape[1] - 1)
    found = coarse[c_rows[:, None], c_columns]
    offset = np.stack(np.broadcast_arrays(columns - 2 * c_columns, (rows - 2 * c_rows)[:, None]), axis=2)
    return np.asarray(np.where(found < 0, -1, 2 * found + offset), np.int32)
