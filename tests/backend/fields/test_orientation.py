"""Orientation maps on gratings of known angle, under noise, turned pictures and masks."""

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.fields.orientation import OrientationParams, gabor_bank, orientation_map, smooth_angles

SIZE, MARGIN = 96, 12
Y, X = np.mgrid[:SIZE, :SIZE].astype(np.float32)


def grating(angle: float, wavelength: float = 5.0) -> np.ndarray:
    """Lines at `angle` from +x towards +y."""
    across = Y * np.cos(angle) - X * np.sin(angle)
    return (0.5 + 0.5 * np.cos(2 * np.pi * across / wavelength)).astype(np.float32)


def apart(a, b):
    return np.abs((a - b + np.pi / 2) % np.pi - np.pi / 2)


@pytest.mark.parametrize("degrees", [0, 10, 45, 63, 90, 135, 178])
def test_angle_of_a_grating(degrees):
    found = orientation_map(grating(np.radians(degrees)))
    inner = apart(found.angle, np.radians(degrees))[MARGIN:-MARGIN, MARGIN:-MARGIN]
    # the bank has a filter every 5.6 degrees; the parabola and the smoothing bring most below half of that
    assert np.degrees(np.median(inner)) < 2.5
    assert np.degrees(inner.max()) < 5.0


def test_noise_and_grey_levels_do_not_matter():
    rng = np.random.default_rng(0)
    noisy = 0.3 + 0.2 * grating(0.7) + rng.normal(0, 0.03, (SIZE, SIZE)).astype(np.float32)
    found = orientation_map(noisy.astype(np.float32))
    assert np.degrees(np.median(apart(found.angle, 0.7)[MARGIN:-MARGIN, MARGIN:-MARGIN])) < 3.0


def test_a_turned_picture_has_turned_angles():
    picture = grating(0.4) * (0.5 + 0.5 * np.sin(X / 17))
    straight, turned = orientation_map(picture), orientation_map(np.ascontiguousarray(np.rot90(picture)))
    # rot90 turns against the clock as seen, that is from +x towards -y
    back = np.rot90(turned.angle, -1) + np.pi / 2
    inner = np.s_[MARGIN:-MARGIN, MARGIN:-MARGIN]
    assert np.degrees(np.median(apart(straight.angle, back)[inner])) < 0.5
    assert np.abs(straight.confidence - np.rot90(turned.confidence, -1))[inner].max() < 0.05


def test_confidence_is_high_on_lines_and_low_on_flat_ground():
    picture = np.where(X < SIZE / 2, grating(1.0), 0.5).astype(np.float32)
    found = orientation_map(picture)
    assert found.confidence[:, 10:38].mean() > 5 * found.confidence[:, 64:].mean()
    assert found.confidence.max() <= 1.0


def test_the_border_of_a_mask_is_no_line():
    mask = (X - SIZE / 2) ** 2 + (Y - SIZE / 2) ** 2 < 30**2
    picture = np.where(mask, 0.3 + 0.1 * grating(0.3), 1.0).astype(np.float32)
    found = orientation_map(picture, mask)
    assert not found.confidence[~mask].any()
    rim = mask & ((X - SIZE / 2) ** 2 + (Y - SIZE / 2) ** 2 > 26**2)
    assert np.degrees(np.median(apart(found.angle[rim], 0.3))) < 8.0
    unmasked = orientation_map(picture)
    assert np.degrees(np.median(apart(unmasked.angle[rim], 0.3))) > 8.0, "without the mask its border shows"


def test_bytes_and_colours():
    grey = grating(0.9)
    colours = np.round(np.dstack([grey] * 3) * 255).astype(np.uint8)
    inner = np.s_[MARGIN:-MARGIN, MARGIN:-MARGIN]
    apart_by = apart(orientation_map(colours).angle, orientation_map(grey).angle)[inner]
    assert np.degrees(np.median(apart_by)) < 0.5


def test_the_bank_has_no_mean_and_unit_norm():
    bank = gabor_bank(OrientationParams())
    assert bank.shape == (32, 13, 13)
    assert np.abs(bank.sum(axis=(1, 2))).max() < 1e-5
    assert np.allclose((bank**2).sum(axis=(1, 2)), 1.0, atol=1e-5)


def test_strips_do_not_show():
    tall = np.tile(grating(0.5), (6, 1))[:500]
    found = orientation_map(tall, params=OrientationParams(smooth=0.0))
    apart_by = apart(found.angle[MARGIN : SIZE - MARGIN, MARGIN:-MARGIN], 0.5)
    beyond = apart(found.angle[250:262, MARGIN:-MARGIN], 0.5)
    assert beyond.max() <= max(apart_by.max(), np.radians(6.0)) + np.radians(1.0)


def test_angles_are_averaged_over_the_jump_at_pi():
    angle = np.where(X % 2 < 1, np.pi - 0.1, 0.1).astype(np.float32)
    smooth = smooth_angles(angle, np.ones_like(angle), 2.0)
    assert apart(smooth[20:-20, 20:-20], 0.0).max() < 0.02


def test_same_bytes_again():
    rng = np.random.default_rng(3)
    picture = rng.random((64, 64)).astype(np.float32)
    one, two = orientation_map(picture), orientation_map(picture)
    assert one.angle.tobytes() == two.angle.tobytes() and one.confidence.tobytes() == two.confidence.tobytes()


@pytest.mark.parametrize(
    ("image", "mask", "words"),
    [
        (np.zeros((4, 4, 2), np.float32), None, "shape"),
        (np.zeros((4, 4), np.float32), np.zeros((5, 4), bool), "pixels"),
        (np.full((4, 4), np.nan, np.float32), None, "NaN"),
    ],
)
def test_bad_pictures(image, mask, words):
    with pytest.raises(InputError, match=words):
        orientation_map(image, mask)


def test_bad_settings():
    with pytest.raises(InputError, match="n_orientations"):
        OrientationParams(n_orientations=2)


def test_a_mask_in_a_larger_picture_gives_the_same_map():
    rng = np.random.default_rng(3)
    small = rng.integers(0, 256, (200, 220, 3), np.uint8)
    mask = np.zeros((200, 220), np.bool_)
    mask[80:120, 85:130] = True
    large = rng.integers(0, 256, (520, 470, 3), np.uint8)
    large_mask = np.zeros((520, 470), np.bool_)
    large[150:350, 90:310], large_mask[150:350, 90:310] = small, mask
    alone, within = orientation_map(small, mask), orientation_map(large, large_mask)
    assert np.allclose(alone.angle[mask], within.angle[large_mask], atol=1e-6)
    assert np.allclose(alone.confidence[mask], within.confidence[large_mask], atol=1e-6)
    assert not within.confidence[~large_mask].any()
