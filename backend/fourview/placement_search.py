"""Scales and places of the photos by the database: where hairstyles look most like the masks (Z-2 with Z-3).

A mask alone does not tell how large its photo is: hair may be thick or thin, long or short. But few sizes of a mask
look like any hairstyle on the head, and fewer of all masks like one and the same. So the hairstyles' precomputed masks
are compared with the photos' at many sizes, heights and shifts, and the best is taken, not far from a first placement.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from ..geometry.camera import STANDARD_DIRECTIONS, project
from ..types import Bools, Float32, Float64, Head
from .database import HairDatabase
from .database_fit import frame_of_head
from .database_masks import CELL, COLUMNS, ROWS, grid_camera, view_grid
from .views import UInt8

LEVEL = ("front", "back", "left", "right")
_WHOLE = LEVEL[1:]  # they show the same hair from its top to its ends; in the front view the face cuts it short
_FACTORS = np.exp(np.arange(-3, 4) * 0.05)  # by which the size of a face that was found may be off
_WIDE = np.exp(np.arange(-7, 8) * 0.08)  # the same for the extents of masks
_TOPS = np.arange(0.95, 1.8, 0.1)  # head radii from the head's middle up to the hair's top
_USUAL_TOP = 1.25
_SHIFTS = np.arange(-2, 3) * 0.15  # head radii that the upper hair's middle may lie off the head's in a side view
# standard deviations of the logarithm of a face's size, of a scale by the masks' extents, and of the scales of one
# series of photos; and of `_USUAL_TOP`
_BY_FACE, _BY_EXTENTS, _IN_SERIES, _OF_TOPS = 0.07, 0.15, 0.15, 0.25
_PRICE = 0.1  # twice the overlap (IoU, summed over views) that one such deviation costs
_STYLES = 5  # the mean of so many hairstyles counts, so that no odd one decides


@dataclass(frozen=True, slots=True)
class Lead:
    """The first placement of the view that the others follow.

    scale : pixels a metre. centre : (2,) float64, pixels of the head's middle.
    pivot : (2,) float64, the pixel that stays when the scale changes; None where the place is not known.
    is_exact : whether scale and place are the user's own.
    """

    name: str
    scale: float
    centre: Float64
    pivot: Float64 | None = None
    is_exact: bool = False


@dataclass(frozen=True, slots=True)
class _Choices:
    """Places to try in a view: (T, K, J, 3) float64 of pixels a head radius and the pixel of the head's middle.

    T : of the hair's top, the same in all views; K : of the scale; J : of the shift. cost : (T, K).
    """

    places: Float64
    cost: Float64


def placed_by_styles(
    masks: Mapping[str, Bools], head: Head, lead: Lead, database: HairDatabase, exclude: Collection[str] = ()
) -> dict[str, tuple[float, Float64]]:
    """Pixels a metre, and the pixel (2,) float64 of the middle of the head's scalp, for each view.

    Parameters
    ----------
    masks : name of a level view (`LEVEL`) -> (H, W) bool. exclude : names of hairstyles that are not compared.
    """
    radius = frame_of_head(head).radius
    kept = [style.masks for style in database.styles if style.name not in exclude]
    leading = _lead_choices(lead, masks[lead.name], radius)
    tops = (leading.places[:, 0, 0, 2] - top_row(masks[lead.name])) / leading.places[:, 0, 0, 0]
    choices = {lead.name: leading}
    reference = next((name for name in masks if name in _WHOLE and name != lead.name), lead.name)
    for name in masks:
        if name != lead.name:
            like = masks[reference if name in _WHOLE else name]
            choices[name] = _follower_choices(name, masks[name], like, lead.scale * radius, leading, tops)
    overlap = {name: _overlaps(np.stack([m[_nearest(name)] for m in kept]), masks[name], name, choices[name].places)
               for name in masks}  # fmt: skip
    best = {name: overlap[name].max(axis=3) for name in masks}
    shared = [name for name in masks if name in _WHOLE and name != lead.name]
    single = [name for name in masks if name not in shared]
    total = sum(((best[name] - choices[name].cost).max(axis=2) for name in single), np.zeros(best[lead.name].shape[:2]))
    together = total[:, :, None]
    if shared:
        together = together + sum(best[name] for name in shared) - choices[shared[0]].cost
    top, size = np.unravel_index(np.sort(together, axis=0)[-_STYLES:].mean(axis=0).argmax(), together.shape[1:])
    alike = np.argsort(-together[:, top, size], kind="stable")[:_STYLES]
    found = {}
    for name in masks:
        mean = overlap[name][alike, top].mean(axis=0)
        one = size if name in shared else int((mean.max(axis=1) - choices[name].cost[top]).argmax())
        per_radius, x, y = choices[name].places[top, one, mean[one].argmax()].tolist()
        found[name] = (per_radius / radius, np.array([x, y]))
    return found


def _lead_choices(lead: Lead, mask: Bools, radius: float) -> _Choices:
    """With a known place one scale for each top, about the pivot; without, all tops and scales."""
    if lead.pivot is not None:
        factors = np.ones(1) if lead.is_exact else _FACTORS
        centres = lead.pivot + (lead.centre - lead.pivot) * factors[:, None]
        places = np.column_stack([lead.scale * radius * factors, centres])[:, None, None]
        return _Choices(places, _price(np.log(factors) / _BY_FACE)[:, None])
    cost = _price((_TOPS - _USUAL_TOP) / _OF_TOPS)[:, None] + _price(np.log(_WIDE) / _BY_EXTENTS)
    return _Choices(_hanging(mask, lead.scale * radius * _WIDE, _TOPS, np.zeros(1)), cost)


def _follower_choices(
    name: str, mask: Bools, like: Bools, per_radius: float, leading: _Choices, tops: Float64
) -> _Choices:
    """All scales by the height of the mask `like`, whose scales are around `per_radius`, hung at the lead's tops."""
    heights = mask_height(like) / (per_radius * _WIDE)
    shifts = _SHIFTS if name in ("left", "right") else np.zeros(1)
    one_scale = leading.places.shape[1] == 1
    expected = leading.places[:, 0, 0, :1] if one_scale else np.full((len(tops), 1), per_radius)
    cost = _price(np.log(mask_height(like) / heights / expected) / _IN_SERIES)
    return _Choices(_hanging(mask, mask_height(mask) / heights, tops, shifts), cost)


def _price(deviations: Float64) -> Float64:
    return 0.5 * _PRICE * np.square(deviations)


def _hanging(mask: Bools, per_radius: Float64, tops: Float64, shifts: Float64) -> Float64:
    """(T, K, J, 3): the mask's top on the hair's top, the middle of its upper part beside the head's by the shift."""
    middles = np.array([upper_middle(mask, depth) for depth in per_radius])
    size, top, shift = np.broadcast_arrays(per_radius[:, None], tops[:, None, None], shifts)
    return np.stack([size, middles[:, None] + shift * size, top_row(mask) + top * size], axis=-1)


def top_row(mask: Bools) -> float:
    """The uppermost row of a mask (H, W)."""
    return float(np.flatnonzero(mask.any(axis=1))[0])


def mask_height(mask: Bools) -> float:
    """Rows from the first to the last of a mask (H, W)."""
    return float(np.ptp(np.flatnonzero(mask.any(axis=1))) + 1)


def upper_middle(mask: Bools, depth: float) -> float:
    """The column of the middle of the mask's uppermost `depth` pixels."""
    first = int(top_row(mask))
    columns = np.flatnonzero(mask[first : first + max(1, round(depth))].any(axis=0))
    return 0.5 * float(columns[0] + columns[-1] + 1)


def _nearest(name: str) -> int:
    """The direction of the grid that a view is taken from."""
    return int(np.argmax(view_grid() @ np.array(STANDARD_DIRECTIONS[name])))


def _overlaps(packed: UInt8, mask: Bools, name: str, places: Float64) -> Float32:
    """(S, T, K, J) float32: the IoU of each style's mask (S, bytes) with the photo's at each place (T, K, J, 3)."""
    styles = np.unpackbits(packed, axis=1).astype(np.float32)
    seen = _on_grid(mask, name, places.reshape(-1, 3))
    common = styles @ seen.T
    union = styles.sum(axis=1)[:, None] + seen.sum(axis=1) - common
    return np.asarray(common / np.maximum(union, 1.0), np.float32).reshape(len(styles), *places.shape[:3])


def _on_grid(mask: Bools, name: str, places: Float64) -> Float32:
    """(n, cells) float32, 0 or 1: the photo's mask on the cells of the grid's masks, for each place (n, 3)."""
    middle = project(grid_camera(view_grid()[_nearest(name)]), np.zeros(3))[:2]
    grey = mask.astype(np.float32)
    sizes, which = np.unique(places[:, 0] * CELL, return_inverse=True)  # pixels a cell
    found = np.empty((len(places), ROWS * COLUMNS), np.float32)
    # one over sizes and places, of which there are some hundreds
    for number, size in enumerate(sizes.tolist()):
        side = max(1, round(size))
        share = cv2.blur(grey, (side, side))
        for place in np.flatnonzero(which == number):
            shift = places[place, 1:] + (0.5 - middle) * size - 0.5
            turn = np.array([[size, 0.0, shift[0]], [0.0, size, shift[1]]])
            cells = cv2.warpAffine(share, turn, (COLUMNS, ROWS), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
            found[place] = (cells >= 0.5).ravel()
    return found
