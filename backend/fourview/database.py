"""The database of hairstyles: what it holds, and the search for those that look like the photos (Z-3, eq. 1).

Chai et al. 2016's database is not public, so ours is made by blend_templates/make_database.py and shipped as
data/hairstyles.npz; grooms and folders of the user join in (`database_entries`).

The search compares masks twice: all hairstyles by their precomputed masks, from the direction of the view grid nearest
to each view, and the best of these once more, rendered with the views' own cameras.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from ..errors import require
from ..geometry.camera import project, resized, towards, view_direction
from ..geometry.scalp_space import ScalpSpace
from ..geometry.strands import from_dense
from ..types import Bools, Camera, Float32, Float64, Floats, Head, Int64, StrandSet
from .database_files import Hairstyle, read_hairstyles
from .database_fit import HeadFrame, fit_to_head, frame_of_head
from .database_masks import CELL, CLOSING, COLUMNS, ROWS, backdrop, grid_camera, render_mask, view_grid
from .views import MAX_VIEWS, UInt8, View

DATABASE_PATH = Path(__file__).parent.parent / "data" / "hairstyles.npz"


@dataclass(frozen=True, slots=True)
class SearchParams:
    """Settings of search. Defaults live here only."""

    n_refined: int = 16  # hairstyles that are rendered with the views' own cameras
    width_px: int = 200  # of the larger side of a picture when comparing; pictures are made so small
    closing: float = CLOSING  # head radii; how far hair is smeared before dense places count as hair (`marked_region`)
    # share of a pixel that counts as covered where a strand goes through: with 1, masks of pictures this small come out
    # a border too wide (mean IoU with the full groom's at 800 pixels 0.88, with 0.75 it is 0.90)
    coverage: float = 0.75

    def __post_init__(self) -> None:
        require(1 <= self.n_refined <= 10_000, f"n_refined is {self.n_refined}; it must be in 1..10000")
        require(32 <= self.width_px <= 2000, f"width_px is {self.width_px}; it must be in 32..2000 pixels")
        require(0 < self.closing <= 2, f"closing is {self.closing}; it must be above 0, to 2 head radii")
        require(0.5 <= self.coverage <= 1, f"coverage is {self.coverage}; it must be in 0.5..1")


@dataclass(frozen=True, slots=True)
class Match:
    """A hairstyle that was found.

    index, name : of the hairstyle. distance : eq. (1), head radii (see `mask_distance`).
    per_view : (n_views,) float64, the summands of eq. (1).
    """

    index: int
    name: str
    distance: float
    per_view: Float64


@dataclass(frozen=True, slots=True)
class HairDatabase:
    """Hairstyles with strands and masks; `remarks` says what of the user's folders could not be read, and why."""

    styles: tuple[Hairstyle, ...]
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        names = [style.name for style in self.styles]
        require(len(set(names)) == len(names), "two hairstyles of the database have the same name; rename one")

    def __len__(self) -> int:
        return len(self.styles)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(style.name for style in self.styles)

    @property
    def tags(self) -> tuple[tuple[str, ...], ...]:
        return tuple(style.tags for style in self.styles)

    def family(self, index: int) -> str:
        """What hairstyle `index` was made from; those of one family are alike."""
        return self.styles[index].family

    def named(self, *families: str) -> tuple[str, ...]:
        """Names of all hairstyles of these families, for `search(exclude=)`."""
        return tuple(style.name for style in self.styles if style.family in families)

    def index(self, name: str) -> int:
        """The hairstyle called `name`. Raises InputError if there is none."""
        require(name in self.names, f"the database has no hairstyle '{name}'; see `hairloom hair-database list`")
        return self.names.index(name)

    def strands(self, index: int, head: Head, space: ScalpSpace | None = None) -> StrandSet:
        """A hairstyle on a head: world space, metres; roots on the scalp, nothing inside the head.

        Parameters
        ----------
        head : with a scalp. space : its scalp space, if at hand.

        Raises
        ------
        InputError : no such hairstyle, a head without scalp, or one whose scalp is nowhere near the style's.
        """
        require(0 <= index < len(self), f"there is no hairstyle {index}; the database has {len(self)}")
        return from_dense(fit_to_head(self.styles[index].points(), head, frame_of_head(head, space))[0])


def mask_distance(mask: Bools, other: Bools, scale: float) -> float:
    """One summand of eq. (1): the distance field of `mask` summed over where `other` differs, over the mask's area.

    The paper counts pixels, so that views with more pixels count more. Here `scale` (head radii a pixel) makes it head
    radii: the mean over the mask's area of how far the other's border is off, times how long the border is.

    Raises InputError for an empty mask.
    """
    require(mask.any(), "a mask is empty; mark where the hair is")
    return _summand(mask, distance_field(mask), other, scale)


def _summand(mask: Bools, far: Float32, other: Bools, scale: float) -> float:
    """`mask_distance` with the distance field of the mask at hand."""
    return float(far[mask ^ other].sum(dtype=np.float64) * scale / mask.sum())


def distance_field(mask: Bools) -> Float32:
    """(H, W) float32, pixels: |D|, how far each pixel's middle is from the border of the mask (H, W)."""
    inside = mask.astype(np.uint8)
    if mask.all() or not mask.any():
        return np.ones(mask.shape, np.float32)
    field = np.where(mask, _to_nearest_zero(inside), _to_nearest_zero((~mask).astype(np.uint8)))
    return np.asarray(field - 0.5, np.float32)


def _to_nearest_zero(values: UInt8) -> Float32:
    return np.asarray(cv2.distanceTransform(values, cv2.DIST_L2, cv2.DIST_MASK_PRECISE), np.float32)


def search(
    database: HairDatabase,
    views: Sequence[View],
    head: Head,
    *,
    n_best: int = 1,
    exclude: Collection[str] = (),
    params: SearchParams = SearchParams(),
) -> list[Match]:
    """The hairstyles whose masks are nearest to those of the views (Z-3, eq. 1), best first.

    Parameters
    ----------
    views : 1 to 8, their cameras in the head's world. head : with a scalp; the hairstyles are put on it.
    n_best : how many matches. exclude : names of hairstyles not to be found.

    Returns
    -------
    n_best matches, or as many as there are; `distance` of those beyond `params.n_refined` is that of the first pass.

    Raises
    ------
    InputError : no or too many views, a mask that does not show in its picture, or nothing left to search.
    """
    require(1 <= len(views) <= MAX_VIEWS, f"{len(views)} views were given; give 1 to {MAX_VIEWS}")
    require(n_best >= 1, f"n_best is {n_best}; it must be 1 or more")
    left = np.array([i for i, style in enumerate(database.styles) if style.name not in exclude], np.int64)
    require(len(left) > 0, "all hairstyles are excluded from the search; exclude fewer, or add some")
    frame = frame_of_head(head)
    small = [_small_view(view, params.width_px) for view in views]
    coarse = np.stack([_score_all(database, left, mask, camera, frame) for mask, camera in small], axis=1)
    order = np.argsort(coarse.sum(axis=1), kind="stable")
    count = min(max(params.n_refined, n_best), len(left))
    best = order[:count]
    fine = _refine(database, left[best[: params.n_refined]], small, head, frame, params)
    matches = [
        Match(int(left[place]), database.names[left[place]], float(score.sum()), score)
        for place, score in zip(best, [*fine, *coarse[best[len(fine) :]]])
    ]
    refined = sorted(matches[: len(fine)], key=lambda match: match.distance)
    return [*refined, *matches[len(fine) :]][:n_best]


def _small_view(view: View, width_px: int) -> tuple[Bools, Camera]:
    scale = min(width_px / max(view.camera.size), 1.0)
    camera = resized(view.camera, scale)
    share = cv2.resize(view.mask.astype(np.float32), camera.size, interpolation=cv2.INTER_AREA)
    mask = np.asarray(share >= 0.5)
    # a mask of a few thin locks must not vanish
    return (mask if mask.any() else np.asarray(share > 0)), camera


def _pixel_size(camera: Camera, frame: HeadFrame) -> float:
    """Head radii that a pixel measures at the middle of the head."""
    side = np.cross(view_direction(camera), [0.3, 0.5, 0.8])
    ends = project(camera, frame.centre + np.outer([-0.5, 0.5], side / np.linalg.norm(side)) * frame.radius)
    return 1.0 / max(float(np.linalg.norm(ends[1, :2] - ends[0, :2])), 1e-9)


def _score_all(database: HairDatabase, chosen: Int64, mask: Bools, camera: Camera, frame: HeadFrame) -> Float64:
    """(n,) float64: the summand of eq. (1) for one view, of the chosen hairstyles, from their precomputed masks.

    The cells of the grid's picture are looked up in the view: both share the plane through the middle of the head.
    """
    directions = view_grid()
    looks = frame.turn @ -towards(camera, frame.centre[None])[0]
    nearest = int(np.argmax(directions @ looks))
    seen = project(camera, _cell_places(directions[nearest], frame, looks))
    columns, rows = np.floor(seen[:, 0]).astype(np.int64), np.floor(seen[:, 1]).astype(np.int64)
    inside = (columns >= 0) & (columns < camera.size[0]) & (rows >= 0) & (rows < camera.size[1])
    place = rows[inside] * camera.size[0] + columns[inside]
    hair, far = np.zeros(len(seen)), np.zeros(len(seen))
    hair[inside] = mask.ravel()[place]
    far[inside] = distance_field(mask).ravel()[place] * _pixel_size(camera, frame)
    if not hair.any():  # a mask beside the grid's window, or smaller than a cell
        return np.zeros(len(chosen))
    packed = np.stack([database.styles[index].masks[nearest] for index in chosen])
    masks = np.unpackbits(packed, axis=1).astype(np.float32)
    # |D| summed over the cells that are in one mask only: all of the input's, less the common, plus the rest
    weight = (far * (1.0 - 2.0 * hair)).astype(np.float32)
    return np.asarray((masks @ weight + (far * hair).sum()) / hair.sum(), np.float64)


def _cell_places(direction: Float64, frame: HeadFrame, looks: Float64) -> Float64:
    """(ROWS * COLUMNS, 3) float64, metres, world space: the middles of the cells of a grid mask.

    On the plane through the middle of the head across `looks` (3,), the view's own direction in fitted space.
    """
    camera = grid_camera(direction)
    columns, rows = np.meshgrid(np.arange(COLUMNS) + 0.5, np.arange(ROWS) + 0.5)
    turn = camera.world_to_camera[:3, :3]
    middle = project(camera, np.zeros(3))
    right = (columns.ravel() - middle[0]) * CELL
    down = (rows.ravel() - middle[1]) * CELL
    # the smallest turn that takes the grid's direction to the view's, so that up stays up
    axes = turn[:2] @ _smallest_turn(direction, looks).T
    fitted = right[:, None] * axes[0] + down[:, None] * axes[1]
    return np.asarray(fitted @ frame.turn * frame.radius + frame.centre)


def _smallest_turn(start: Float64, end: Float64) -> Float64:
    """(3, 3): the rotation by the smallest angle that takes the unit vector `start` to `end`, not opposite to it."""
    axis = np.cross(start, end)
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / max(1.0 + float(start @ end), 1e-9))


def _refine(
    database: HairDatabase,
    chosen: Int64,
    views: Sequence[tuple[Bools, Camera]],
    head: Head,
    frame: HeadFrame,
    params: SearchParams,
) -> list[Float64]:
    """Per chosen hairstyle (n_views,) the summands of eq. (1), rendered with the cameras of the views."""
    behind = [backdrop(camera, head) for _, camera in views]
    sizes = [_pixel_size(camera, frame) for _, camera in views]
    fields = [distance_field(mask) for mask, _ in views]
    scores = []
    for index in chosen:
        points: Floats = frame.to_world(database.styles[index].points())
        found = []
        for (mask, camera), far, bald, size in zip(views, fields, behind, sizes):
            rendered = render_mask(camera, points, bald, params.closing / size, 0.03 * frame.radius, params.coverage)
            found.append(_summand(mask, far, rendered, size))
        scores.append(np.array(found))
    return scores


def open_database(path: str | Path | None = None, folders: Sequence[str | Path] = ()) -> HairDatabase:
    """The database of a file (None: the one that Hairloom ships) with the hairstyles of the user's folders.

    Folders hold grooms (.hair, .data, .tfx, .npz ...) or hairstyles that `hairloom hair-database add` wrote; see
    `database_entries`. What cannot be read is left out and said in `remarks`.

    Raises
    ------
    FileError : the database file cannot be read. InputError : a folder that is none.
    """
    from .database_entries import read_folder

    styles = list(read_hairstyles(DATABASE_PATH if path is None else path))
    remarks: list[str] = []
    for folder in folders:
        found, said = read_folder(folder)
        names = {style.name for style in styles}
        styles += [replace(style, name=_free_name(style.name, names)) for style in found]
        remarks += said
    return HairDatabase(tuple(styles), tuple(remarks))


def _free_name(name: str, taken: set[str]) -> str:
    """`name`, with a number if it is taken; it is taken from then on."""
    chosen, number = name, 2
    while chosen in taken:
        chosen, number = f"{name} ({number})", number + 1
    taken.add(chosen)
    return chosen
