"""Hair or not: masks of photos from scribbles by graph cuts, a first guess without any, and editable outlines (Z-1)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from ..errors import require
from ..types import Bools, Float32, Float64, Floats, check_array

UInt8 = NDArray[np.uint8]

LARGEST = 640  # pixels along the longer side on which the graph is cut; the border is then refined at full size
_SEED = 5  # of OpenCV's k-means, which starts the colour models
_SMALLEST_PART = 0.002  # of the picture; smaller islands and holes of a mask are specks
_ITERATIONS = 5
_SMOOTHED_PX = 3.0  # along a border that is pulled
_MOST_COLOURS = 2000  # of a kind of scribble that are compared with


def segment(
    image: UInt8, foreground: Bools, background: Bools, guess: Bools | None = None, *, iterations: int = _ITERATIONS
) -> Bools:
    """The mask of what the foreground scribbles touch, by graph cuts on colour models (Z-1, M-29).

    Two Gaussian mixtures of colours and a contrast-dependent border (GrabCut, in OpenCV) on a reduced picture, then
    once more in a band around the border at full size. Scribbles are kept as drawn; where both are, background wins.

    Parameters
    ----------
    image : (H, W, 3) uint8, sRGB. foreground, background : (H, W) bool, the scribbles.
    guess : (H, W) bool, where hair probably is; None: the neighbourhood of the foreground scribbles decides.

    Returns
    -------
    (H, W) bool. Parts that hold no scribble and are specks are left out, small holes are closed.

    Raises
    ------
    InputError : scribbles of another size, or no foreground at all.
    """
    check_array("the image", image, np.uint8, (None, None, 3))
    size = image.shape[:2]
    for name, scribbles in (("foreground", foreground), ("background", background)):
        require(scribbles.shape == size, f"the {name} scribbles have {scribbles.shape} pixels, the image {size}")
    foreground = foreground & ~background
    start = foreground if guess is None else guess | foreground
    require(start.any(), "nothing says where the hair is; draw a foreground scribble on it")
    scale = min(1.0, LARGEST / max(size))
    small = (max(1, round(size[1] * scale)), max(1, round(size[0] * scale)))
    reduced = cv2.resize(image, small, interpolation=cv2.INTER_AREA)
    drawn = _shrink(foreground, small), _shrink(background, small)
    labels = _labels(reduced, *drawn, _shrink(start, small), guess is None)
    coarse = _cut(reduced, labels, iterations)
    if scale == 1.0:
        return _tidy(coarse, foreground, background)
    mask = cv2.resize(coarse.astype(np.uint8), size[::-1], interpolation=cv2.INTER_LINEAR) > 0
    return _tidy(_refine_border(image, mask, foreground, background, round(2 / scale)), foreground, background)


def first_guess(image: UInt8) -> Bools:
    """Where hair probably is in a portrait without any scribble (Z-1).

    The background is what is like the picture's side and top borders. With a face (OpenCV's frontal-face cascade) hair
    is searched around it, else around the top of the figure; skin is told by its hue. Graph cuts make a mask of that: a
    start for scribbles, not a result to trust.

    image : (H, W, 3) uint8 -> (H, W) bool; never empty.
    """
    check_array("the image", image, np.uint8, (None, None, 3))
    height, width = image.shape[:2]
    scale = min(1.0, LARGEST / max(height, width))
    size = (max(8, round(width * scale)), max(8, round(height * scale)))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    labels = _guess_around(small)
    hair = _cut(small, labels, 3)
    seeds = hair & (labels == cv2.GC_FGD)
    hair = _touching(hair, seeds) if seeds.any() else hair
    if not hair.any():
        hair[: max(1, size[1] // 3), size[0] // 3 : max(1, 2 * size[0] // 3)] = True
    full = cv2.resize(hair.astype(np.uint8), (width, height), interpolation=cv2.INTER_LINEAR) > 0
    return _without_specks(np.asarray(full))


def find_face(image: UInt8) -> tuple[float, float, float, float] | None:
    """The largest frontal face: left, top, width and height in pixels of the square from brow to mouth; None without.

    One cascade says where the face is, since it sees few that are none; another says how large, since hair beside the
    face disturbs it less: the square of one head with different hair varies by 3 % instead of 9 %.

    image : (H, W, 3) uint8, sRGB.
    """
    grey = cv2.equalizeHist(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
    faces = _faces(grey, "default", 1.1, max(20, min(image.shape[:2]) // 12))
    if len(faces) == 0:
        return None
    found = faces[np.argmax(faces[:, 2])]
    near = _faces(grey, "alt2", 1.03, max(20, round(0.7 * found[2])))
    off = np.abs(near[:, :2] + 0.5 * near[:, 2:] - found[:2] - 0.5 * found[2:]).max(axis=1, initial=0.0) / found[2]
    near = near[(off < 0.2) & (near[:, 2] < 1.4 * found[2])]
    left, top, width, height = (near[np.argmax(near[:, 2])] if len(near) else found).tolist()
    return left, top, width, height


def _faces(grey: UInt8, cascade: str, step: float, smallest: int) -> Float64:
    """(n, 4) left, top, width and height of the squares that one of OpenCV's cascades finds."""
    folder = Path(str(cv2.__file__)).parent / "data"
    classifier = cv2.CascadeClassifier(str(folder / f"haarcascade_frontalface_{cascade}.xml"))
    found = [] if classifier.empty() else classifier.detectMultiScale(grey, step, 5, minSize=(smallest, smallest))
    return np.asarray(found, np.float64).reshape(-1, 4)


def _guess_around(image: UInt8) -> UInt8:
    """GrabCut's labels: surely hair over the brow or at the figure's top, probably hair around, surely not the face."""
    figure, skin = _figure(image), _skin(image)
    height, width = image.shape[:2]
    face = find_face(image)
    if face is None:
        rows = np.flatnonzero(figure.any(axis=1))
        top = int(rows[0]) if len(rows) else height // 8
        columns = np.flatnonzero(figure[top : top + max(2, height // 8)].any(axis=0))
        middle = float(columns.mean()) if len(columns) else 0.5 * width
        side = 0.35 * min(height - top, width)
    else:
        middle, side = face[0] + 0.5 * face[2], face[2]
        top = round(face[1] - 0.25 * side)
    y, x = np.mgrid[:height, :width]
    across, down = (x + 0.5 - middle) / side, (y + 0.5 - top) / side
    around = (np.abs(across) < 1.2) & (down > -0.45) & (down < 2.6)
    labels = np.full((height, width), cv2.GC_PR_BGD, np.uint8)
    labels[around & figure & ~skin] = cv2.GC_PR_FGD
    labels[(np.abs(across) < 0.3) & (down > -0.02) & (down < 0.12) & ~skin] = cv2.GC_FGD
    labels[~around | ~_grown(figure, 9)] = cv2.GC_BGD
    if face is not None:
        # an ellipse within the square from brow to chin
        inner = (across / 0.36) ** 2 + ((down - 0.78) / 0.45) ** 2 < 1.0
        labels[inner] = cv2.GC_BGD
        labels[(down > 1.25) & (np.abs(across) < 0.28)] = cv2.GC_BGD  # neck and chest
    return labels


def _grown(mask: Bools, size: int) -> Bools:
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0)


def outline(mask: Bools, tolerance_px: float = 1.0) -> list[Float64]:
    """The borders of a mask as polygons: outer ones clockwise in the picture, holes the other way round.

    mask : (H, W) bool -> arrays (n, 2) float64 of pixels, longest first; (0, 0) is the corner of the first pixel.
    tolerance_px : how far the polygon may be off; larger gives fewer corners to edit.
    """
    padded = cv2.copyMakeBorder(mask.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    # twice as large, so that the contour of pixel centres lies a quarter of a pixel within the border, not half
    doubled = cv2.resize(padded, None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST)
    contours, _ = cv2.findContours(doubled, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    found = []
    for contour in contours:
        simple = cv2.approxPolyDP(contour, 2.0 * tolerance_px, True).reshape(-1, 2)
        if len(simple) >= 3:
            # findContours goes round outer borders against the clock as drawn, y down
            found.append((simple[::-1].astype(np.float64) + 0.5) / 2.0 - 1.0)
    return sorted(found, key=len, reverse=True)


def mask_from_outline(polygons: Sequence[Floats], size: tuple[int, int]) -> Bools:
    """The mask (H, W) bool of the pixels whose middle the polygons of `outline` go round; `size` is (width, height).

    A pixel counts where the border goes round it clockwise in sum: holes take away what their islands give, and where
    a border was pulled over itself nothing is cut out.
    """
    width, height = size
    change = np.zeros(height * (width + 1), np.int64)
    if polygons:
        starts = np.concatenate([np.asarray(polygon, np.float64) for polygon in polygons])
        ends = np.concatenate([np.roll(np.asarray(polygon, np.float64), -1, axis=0) for polygon in polygons])
        # the rows of pixel middles that each edge crosses, its upper end included
        first, last = (np.ceil(side(starts[:, 1], ends[:, 1]) - 0.5) for side in (np.minimum, np.maximum))
        first, last = (np.clip(row, 0, height).astype(np.int64) for row in (first, last))
        edge = np.repeat(np.arange(len(starts)), last - first)
        row = np.arange(len(edge)) - np.repeat(np.cumsum(last - first) - (last - first), last - first) + first[edge]
        (x, y), (across, down) = starts[edge].T, (ends - starts)[edge].T
        column = np.clip(np.ceil(x + (row + 0.5 - y) / down * across - 0.5), 0, width).astype(np.int64)
        np.add.at(change, row * (width + 1) + column, np.where(down < 0.0, 1, -1))
    return np.asarray(np.cumsum(change.reshape(height, width + 1), axis=1)[:, :width] > 0)


def moved_outline(
    polygons: Sequence[Floats], start: tuple[float, float], offset: tuple[float, float], radius: float
) -> list[Float64]:
    """The borders of a mask when one of them is grabbed and pulled (Z-1, the editable boundary).

    The border's point nearest to `start` goes all the way, points around it less, (1 - (d / radius)^2)^2 of it, those
    at `radius` and beyond stay. So does what else lies within the radius but is not joined to that point within it, as
    the other side of a lock. The steps of pixels are smoothed where the border moves, or they would be stretched.

    Parameters
    ----------
    polygons : as `outline` gives them; with its tolerance_px 0 what is not moved gives the same mask again.
    start, offset : (x, y), pixels: where the border was grabbed, and how far it was pulled. radius : pixels.

    Raises
    ------
    InputError : no border within `radius` of `start`; a radius of 0 or less.
    """
    require(radius > 0, f"the radius is {radius} pixels; it must be above 0")
    place, away = np.asarray(start, np.float64), np.asarray(offset, np.float64)
    fine = [_dense_polygon(np.asarray(polygon, np.float64)) for polygon in polygons]
    far = [np.linalg.norm(dense - place, axis=1) for dense in fine]
    chosen = int(np.argmin([distance.min() for distance in far])) if far else -1
    require(
        far and far[chosen].min() <= radius,
        f"no border of the mask is within {radius:.0f} pixels of ({place[0]:.0f}, {place[1]:.0f}); press nearer to it",
    )
    nearest = int(np.argmin(far[chosen]))
    # the grabbed point first, so that what is joined to it is at the list's beginning and end
    dense = np.roll(fine[chosen], -nearest, axis=0)
    near = np.linalg.norm(dense - dense[0], axis=1) / radius
    beyond = np.flatnonzero(near >= 1.0)
    if len(beyond):
        near[beyond[0] : beyond[-1]] = 1.0
    weight = np.square(np.maximum(1.0 - near * near, 0.0))[:, None]
    even = gaussian_filter1d(dense, _SMOOTHED_PX, axis=0, mode="wrap")
    smooth = min(1.0, float(np.hypot(*away)) / _SMOOTHED_PX)
    moved = [np.asarray(polygon, np.float64) for polygon in polygons]
    moved[chosen] = dense + weight * (smooth * (even - dense) + away)
    return moved


def _dense_polygon(polygon: Float64) -> Float64:
    """The polygon with more corners on its edges, so that none is longer than a pixel."""
    along = np.roll(polygon, -1, axis=0) - polygon
    count = np.maximum(np.ceil(np.linalg.norm(along, axis=1)), 1.0).astype(np.int64)
    edge = np.repeat(np.arange(len(polygon)), count)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    return np.asarray(polygon[edge] + along[edge] * (number / count[edge])[:, None])


def _labels(image: UInt8, foreground: Bools, background: Bools, start: Bools, scribbles_only: bool) -> UInt8:
    """What GrabCut begins with: sure where there are scribbles, probable by the guess, else around the scribbles.

    With scribbles of both kinds, pixels whose colour is much nearer to one kind's are probably of that kind, so that a
    wrong guess does not teach the colour models.
    """
    if scribbles_only:
        away = cv2.distanceTransform((~start).astype(np.uint8), cv2.DIST_L2, 3)
        start = np.asarray(away < 0.08 * max(start.shape))
    labels = np.where(start, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    if foreground.any() and background.any():
        lab = cv2.cvtColor(image, cv2.COLOR_RGB2LAB).astype(np.float32)
        to_hair, to_rest = (_colour_distance(lab, scribbles) for scribbles in (foreground, background))
        labels[start & (to_rest < 0.5 * to_hair)] = cv2.GC_PR_BGD
    labels[foreground], labels[background] = cv2.GC_FGD, cv2.GC_BGD
    return labels


def _colour_distance(lab: Float32, scribbles: Bools) -> Float32:
    """(H, W): distance of each pixel's colour (H, W, 3) to the nearest one under the scribbles."""
    under = lab[scribbles]
    tree = cKDTree(under[:: max(1, len(under) // _MOST_COLOURS)])
    return np.asarray(tree.query(lab.reshape(-1, 3))[0], np.float32).reshape(lab.shape[:2])


def _cut(image: UInt8, labels: UInt8, iterations: int) -> Bools:
    """GrabCut; a picture of which one side has no pixel is returned as the labels say."""
    labels = labels.copy()
    inside = (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)
    if inside.any() and not inside.all():
        cv2.setRNGSeed(_SEED)
        models = np.zeros((2, 1, 65))
        cv2.grabCut(image, labels, None, models[0], models[1], iterations, cv2.GC_INIT_WITH_MASK)
        inside = (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)
    return np.asarray(inside)


def _refine_border(image: UInt8, mask: Bools, foreground: Bools, background: Bools, width_px: int) -> Bools:
    """Cut once more at full size, everything but a band around the border being sure."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * width_px + 1, 2 * width_px + 1))
    grey = mask.astype(np.uint8)
    labels = np.where(mask, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[cv2.erode(grey, kernel, borderValue=1) > 0] = cv2.GC_FGD
    labels[cv2.dilate(grey, kernel) == 0] = cv2.GC_BGD
    labels[foreground], labels[background] = cv2.GC_FGD, cv2.GC_BGD
    return _cut(image, labels, 1)


def _tidy(mask: Bools, foreground: Bools, background: Bools) -> Bools:
    kept = _without_specks(mask)
    if foreground.any():
        kept |= _touching(mask, foreground)
    return np.asarray((kept | foreground) & ~background)


def _without_specks(mask: Bools) -> Bools:
    """The mask without islands and holes smaller than a part of the picture; its largest island always stays."""
    smallest = _SMALLEST_PART * mask.size
    kept = mask.copy()
    for value in (True, False):
        count, labels, stats, _ = cv2.connectedComponentsWithStats((kept == value).astype(np.uint8), connectivity=4)
        areas = stats[:, cv2.CC_STAT_AREA]
        small = areas < smallest
        if value and count > 1:
            small[1 + np.argmax(areas[1:])] = False
        small[0] = False
        kept[small[labels]] = not value
    return kept


def _touching(mask: Bools, seeds: Bools) -> Bools:
    """The connected parts of the mask that hold a seed."""
    _, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    return np.isin(labels, np.unique(labels[seeds & mask])) & mask


def _shrink(scribbles: Bools, size: tuple[int, int]) -> Bools:
    """Scribbles on a reduced picture: a pixel that any scribble touches."""
    return np.asarray(cv2.resize(scribbles.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.0)


def _figure(image: UInt8) -> Bools:
    """What is unlike the side and top borders of a picture."""
    lab = cv2.cvtColor(image, cv2.COLOR_RGB2LAB).astype(np.float32)
    height, width = lab.shape[:2]
    strip = max(2, min(height, width) // 40)
    upper = lab[: height // 2]
    border = np.concatenate([part.reshape(-1, 3) for part in (lab[:strip], upper[:, :strip], upper[:, -strip:])])
    middle = np.median(border, axis=0)
    spread = np.maximum(1.5 * np.median(np.abs(border - middle), axis=0), (6.0, 3.0, 3.0))
    distance = np.sqrt((((lab - middle) / spread) ** 2).sum(axis=2))
    return _without_specks(np.asarray(distance > 4.0))


def _skin(image: UInt8) -> Bools:
    """Pixels of skin's usual chroma (the ellipse of Hsu et al. 2002 in Cb and Cr is approximated by a box)."""
    channels = cv2.cvtColor(image, cv2.COLOR_RGB2YCrCb)
    y, red, blue = channels[:, :, 0], channels[:, :, 1], channels[:, :, 2]
    return np.asarray((y > 70) & (red > 136) & (red < 175) & (blue > 85) & (blue < 128))
