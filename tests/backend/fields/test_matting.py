"""Masks by graph cuts on pictures of known regions; outlines that give the mask back."""

import itertools

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.fields.matting import first_guess, mask_from_outline, moved_outline, outline, segment

SIZE = 160
Y, X = np.mgrid[:SIZE, :SIZE].astype(float)


def portrait(seed: int = 0, size: int = SIZE) -> tuple[np.ndarray, np.ndarray]:
    """A drawn person before a grey wall and the true hair: dark brown around a skin-coloured face, a blue shirt."""
    y, x = np.mgrid[:size, :size] / size
    rng = np.random.default_rng(seed)
    picture = np.empty((size, size, 3))
    picture[:] = (200, 205, 210)
    hair = ((x - 0.5) / 0.24) ** 2 + ((y - 0.4) / 0.3) ** 2 < 1
    face = ((x - 0.5) / 0.15) ** 2 + ((y - 0.45) / 0.2) ** 2 < 1
    shirt = (y > 0.72) & (np.abs(x - 0.5) < 0.35)
    picture[shirt] = (40, 60, 160)
    picture[hair] = (70, 45, 30)
    picture[face] = (225, 170, 140)
    picture += rng.normal(0, 6, picture.shape) + 12 * np.sin(40 * x)[..., None] * hair[..., None]
    return np.clip(picture, 0, 255).astype(np.uint8), hair & ~face & ~shirt


def line(points: list[tuple[float, float]], size: int = SIZE) -> np.ndarray:
    mask = np.zeros((size, size), bool)
    for (x0, y0), (x1, y1) in itertools.pairwise(points):
        for t in np.linspace(0, 1, 200):
            mask[int((y0 + t * (y1 - y0)) * size), int((x0 + t * (x1 - x0)) * size)] = True
    return mask


HAIR = [(0.3, 0.45), (0.35, 0.2), (0.5, 0.14), (0.65, 0.2), (0.7, 0.45)]
NOT_HAIR = [(0.5, 0.3), (0.5, 0.6), (0.5, 0.8), (0.2, 0.8), (0.08, 0.5), (0.08, 0.05), (0.9, 0.05), (0.92, 0.9)]


def overlap(a, b):
    return (a & b).sum() / (a | b).sum()


def test_scribbles_cut_the_hair_out():
    picture, hair = portrait()
    assert overlap(segment(picture, line(HAIR), line(NOT_HAIR)), hair) > 0.95


def test_large_pictures_are_refined_at_their_border():
    size = 1300
    picture, hair = portrait(size=size)
    mask = segment(picture, line(HAIR, size), line(NOT_HAIR, size))
    assert overlap(mask, hair) > 0.97


def test_scribbles_win_over_colours_and_background_over_foreground():
    picture, _ = portrait()
    odd = np.zeros((SIZE, SIZE), bool)
    odd[5:9, 5:60] = True
    mask = segment(picture, line(HAIR) | odd, line(NOT_HAIR))
    assert mask[odd & ~line(NOT_HAIR)].all()
    assert not segment(picture, line(HAIR) | odd, line(NOT_HAIR) | odd)[odd].any()


def test_correcting_scribbles_change_a_guess():
    picture, hair = portrait()
    wrong = Y < 0.8 * SIZE
    mask = segment(picture, line(HAIR), line(NOT_HAIR), guess=wrong)
    assert overlap(mask, hair) > 0.95


def test_first_guess_finds_the_hair():
    picture, hair = portrait()
    assert overlap(first_guess(picture), hair) > 0.6  # a start for scribbles, no more


def test_first_guess_of_nothing_is_not_empty():
    assert first_guess(np.full((50, 40, 3), 128, np.uint8)).any()


def test_same_bytes_again():
    picture, _ = portrait()
    one, two = (segment(picture, line(HAIR), line(NOT_HAIR)) for _ in range(2))
    assert np.array_equal(one, two)


def test_outline_gives_the_mask_back():
    mask = ((X - 80) / 50) ** 2 + ((Y - 70) / 40) ** 2 < 1
    mask &= ~(((X - 80) / 15) ** 2 + ((Y - 70) / 12) ** 2 < 1)
    mask[140:150, 10:30] = True
    polygons = outline(mask, tolerance_px=0.5)
    assert len(polygons) == 3  # an island with a hole, and an island
    again = mask_from_outline(polygons, (SIZE, SIZE))
    assert overlap(again, mask) > 0.985
    rough = mask_from_outline(outline(mask, 4.0), (SIZE, SIZE))
    assert sum(map(len, outline(mask, 4.0))) < sum(map(len, polygons))
    assert 0.9 < overlap(rough, mask) < overlap(again, mask)


def test_outline_of_a_box_has_its_corners():
    mask = np.zeros((10, 12), bool)
    mask[2:5, 3:9] = True
    (polygon,) = outline(mask)
    assert np.abs(np.sort(polygon[:, 0])[[0, -1]] - [3, 9]).max() <= 0.5
    assert np.abs(np.sort(polygon[:, 1])[[0, -1]] - [2, 5]).max() <= 0.5


def test_outline_at_the_pictures_border():
    mask = np.ones((6, 8), bool)
    assert mask_from_outline(outline(mask), (8, 6)).all()


@pytest.mark.parametrize("seed", range(4))
def test_an_exact_outline_gives_the_same_mask_again(seed):
    # islands, holes, and pixels that touch at a corner alone
    noise = np.random.default_rng(seed).random((23, 31)) < 0.55
    assert np.array_equal(mask_from_outline(outline(noise, 0.0), (31, 23)), noise)
    coarse = np.kron(noise, np.ones((7, 5), bool))
    assert np.array_equal(mask_from_outline(outline(coarse, 0.0), (31 * 5, 23 * 7)), coarse)


def mask_from_outline_naive(polygons, size):
    """How often the polygons go round the middle of each pixel, by the angle that they turn."""
    found = np.zeros(size[::-1])
    for row, column in np.ndindex(*found.shape):
        for polygon in polygons:
            turn = np.unwrap(np.arctan2(*(polygon - [column + 0.5, row + 0.5]).T[::-1]))
            whole = turn[-1] + np.angle(np.exp(1j * (turn[0] - turn[-1])))
            found[row, column] += np.rint((whole - turn[0]) / (2 * np.pi))
    return found > 0


def test_mask_of_polygons_that_cross_themselves():
    rng = np.random.default_rng(5)
    polygons = [rng.uniform(-4, 24, (7, 2)) for _ in range(3)]
    assert np.array_equal(mask_from_outline(polygons, (20, 17)), mask_from_outline_naive(polygons, (20, 17)))


def disc(x=80.0, y=80.0, radius=40.0):
    return (X + 0.5 - x) ** 2 + (Y + 0.5 - y) ** 2 < radius**2


def test_a_pulled_border_goes_where_it_is_pulled_to():
    mask = disc()
    # grabbed two pixels beside the border at the right, pulled 25 to the right
    moved = mask_from_outline(moved_outline(outline(mask, 0.0), (122.0, 80.0), (25.0, 0.0), 20.0), (SIZE, SIZE))
    assert not (mask & ~moved).any()
    added = moved & ~mask
    assert abs(np.flatnonzero(moved[80])[-1] + 1 - 145) <= 1.5  # the border was at 120
    rows, columns = np.nonzero(added)
    assert np.abs(rows + 0.5 - 80).max() <= 20 and columns.min() >= 115
    # a bump of the falloff's form: its area is the integral of (1 - t^2)^2 over -20 .. 20, times 25
    assert added.sum() == pytest.approx(25 * 20 * 16 / 15, rel=0.08)
    pushed = mask_from_outline(moved_outline(outline(mask, 0.0), (120.0, 80.0), (-25.0, 0.0), 20.0), (SIZE, SIZE))
    assert not (pushed & ~mask).any()
    assert abs(np.flatnonzero(pushed[80])[-1] + 1 - 95) <= 1.5


def test_a_hole_can_be_pulled_too():
    mask = disc() & ~disc(radius=15.0)
    moved = mask_from_outline(moved_outline(outline(mask, 0.0), (80.0, 95.0), (0.0, 12.0), 12.0), (SIZE, SIZE))
    assert not moved[104, 80] and mask[104, 80]
    assert not (moved & ~mask).any()


def test_a_border_pulled_over_itself_leaves_no_hole():
    mask = disc()
    # along the border, so far that it folds; and right through the disc
    for offset in ((0.0, 60.0), (-140.0, 0.0)):
        moved = mask_from_outline(moved_outline(outline(mask, 0.0), (120.0, 80.0), offset, 25.0), (SIZE, SIZE))
        assert len(outline(moved)) <= 2 and all(np.ptp(p, axis=0).max() > 5 for p in outline(moved))
        assert not (moved & (X < 39)).any()


def test_one_side_of_a_lock_is_pulled_alone():
    lock = (np.abs(X + 0.5 - 80) < 8) & (Y > 10)
    polygons = outline(lock, 0.0)
    wider = mask_from_outline(moved_outline(polygons, (88.0, 80.0), (20.0, 0.0), 25.0), (SIZE, SIZE))
    assert not (lock & ~wider).any() and wider[80, 106] and np.array_equal(wider[:, :80], lock[:, :80])
    thinner = mask_from_outline(moved_outline(polygons, (88.0, 80.0), (-10.0, 0.0), 25.0), (SIZE, SIZE))
    assert np.flatnonzero(thinner[80]).tolist() == list(range(72, 78))
    cut = mask_from_outline(moved_outline(polygons, (88.0, 80.0), (-40.0, 0.0), 25.0), (SIZE, SIZE))
    assert not cut[80].any() and not (cut & ~lock).any()


def test_what_is_not_grabbed_stays_as_it_is():
    mask = disc() | disc(20.0, 20.0, 9.0)
    polygons = outline(mask, 0.0)
    moved = moved_outline(polygons, (120.0, 80.0), (9.0, 3.0), 30.0)
    assert np.array_equal(moved[1], polygons[1])
    again = mask_from_outline(moved, (SIZE, SIZE))
    away = (X + 0.5 - 120) ** 2 + (Y + 0.5 - 80) ** 2 > (30 + 10) ** 2
    assert np.array_equal(again[away], mask[away])
    still = moved_outline(polygons, (120.0, 80.0), (0.0, 0.0), 30.0)
    assert np.array_equal(mask_from_outline(still, (SIZE, SIZE)), mask)


def test_nothing_to_grab():
    with pytest.raises(InputError, match="press nearer"):
        moved_outline(outline(disc()), (5.0, 5.0), (1.0, 1.0), 20.0)
    with pytest.raises(InputError, match="press nearer"):
        moved_outline([], (5.0, 5.0), (1.0, 1.0), 20.0)
    with pytest.raises(InputError, match="above 0"):
        moved_outline(outline(disc()), (5.0, 5.0), (1.0, 1.0), 0.0)


def test_bad_input():
    picture, _ = portrait()
    none = np.zeros((SIZE, SIZE), bool)
    with pytest.raises(InputError, match="foreground"):
        segment(picture, none, none)
    with pytest.raises(InputError, match="background scribbles have"):
        segment(picture, line(HAIR), np.zeros((3, 3), bool))
    with pytest.raises(InputError, match="uint8"):
        segment(picture.astype(float), line(HAIR), none)
