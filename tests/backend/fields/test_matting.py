"""Masks by graph cuts on pictures of known regions; outlines that give the mask back."""

import itertools

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.fields.matting import first_guess, mask_from_outline, outline, segment

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


def test_bad_input():
    picture, _ = portrait()
    none = np.zeros((SIZE, SIZE), bool)
    with pytest.raises(InputError, match="foreground"):
        segment(picture, none, none)
    with pytest.raises(InputError, match="background scribbles have"):
        segment(picture, line(HAIR), np.zeros((3, 3), bool))
    with pytest.raises(InputError, match="uint8"):
        segment(picture.astype(float), line(HAIR), none)
