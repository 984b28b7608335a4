"""Detail spectra: curves whose wavelength is known, invariance, and distances between them."""

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.synthesis.detail_statistics import compare_details, detail_spectrum, finer_spectrum, spectrum_distance
from hairloom.types import RootedStrands, WispHierarchy


def helix(radius=0.03, wavelength=0.3, length=2.0, n_points=128, count=5, hand=1.0):
    """Strands whose curl has `wavelength` along the strand."""
    angle = 2 * np.pi * np.linspace(0, length, n_points) / wavelength
    pitch = np.sqrt(wavelength**2 - (2 * np.pi * radius) ** 2)
    points = np.stack([radius * np.cos(angle), radius * hand * np.sin(angle), pitch * angle / (2 * np.pi)], axis=1)
    return np.tile(points[None].astype(np.float32), (count, 1, 1))


def peak(spectrum):
    """The wavelength of the middle of the strongest bin."""
    best = int(np.argmax(spectrum.curvature))
    return np.sqrt(spectrum.edges[best] * spectrum.edges[best + 1])


@pytest.mark.parametrize("wavelength", [0.2, 0.3, 0.6])
def test_a_helix_shows_at_its_wavelength_and_with_its_curvature(wavelength):
    strands = helix(0.02, wavelength)
    spectrum = detail_spectrum(strands)
    # bins are thirds of octaves. The frame that does not twist sees the curve turn with the torsion, whose wavelength
    # is longer than the curl's by the share of the length that is pitch
    pitch = np.sqrt(1 - (2 * np.pi * 0.02 / wavelength) ** 2)
    assert abs(np.log2(peak(spectrum) / (wavelength / pitch))) < 1 / 3
    curvature = 0.02 * (2 * np.pi / wavelength) ** 2
    np.testing.assert_allclose(np.linalg.norm(spectrum.curvature), curvature, rtol=0.05)  # smoothing takes a part
    torsion = pitch * 2 * np.pi / wavelength
    # half weight where the curvature is the mean one; even torsion lies in bins that a strand of length 2 cannot tell
    np.testing.assert_allclose(np.linalg.norm(spectrum.torsion[spectrum.edges[1:] > 0.8]), torsion / 2, rtol=0.12)


def test_a_planar_wave_shows_at_its_wavelength():
    s = np.linspace(0, 3, 200)
    points = np.stack([s, 0.01 * np.sin(2 * np.pi * s / 0.4), 0 * s], axis=1)[None].astype(np.float32)
    assert abs(np.log2(peak(detail_spectrum(points)) / 0.4)) < 1 / 3


def test_spectra_do_not_depend_on_pose_number_length_or_hand():
    first = detail_spectrum(helix())
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0].astype(np.float32)
    for other in (helix() @ turn + 3, helix(count=9), helix(length=4.0, n_points=255), helix(hand=-1.0)):
        same = detail_spectrum(other)
        # a longer strand has a narrower peak, of which less lies in the bins beside
        assert spectrum_distance(first.curvature, same.curvature) < (0.25 if other.shape[1] > 128 else 0.001)
    stretched = helix(length=2.0)
    stretched[:, :, 2] *= 3
    assert compare_details(helix(), stretched)["curvature"] > 0.8


def test_the_spectrum_of_two_kinds_is_their_mean_by_length():
    short, long = helix(length=1.0, n_points=64), helix(0.02, 0.6, length=2.0, n_points=64)
    one, other = detail_spectrum(short), detail_spectrum(long)
    both = detail_spectrum(np.concatenate([short, long]))
    # arc lengths after smoothing are not exactly 1 and 2
    np.testing.assert_allclose(
        both.curvature, one.curvature / 3 + other.curvature * 2 / 3, atol=0.03 * both.curvature.max()
    )


def test_distance_is_zero_to_itself_and_one_without_overlap():
    strands = helix()
    assert compare_details(strands, strands) == {"curvature": 0.0, "torsion": 0.0}
    assert spectrum_distance(np.array([1.0, 0]), np.array([0, 2.0])) == 1.0
    assert spectrum_distance(np.zeros(3), np.zeros(3)) == 0.0


def test_strands_of_no_length_are_left_out_and_bad_input_is_refused():
    strands = helix()
    with_point = np.concatenate([strands, np.zeros_like(strands[:1])])
    assert compare_details(strands, with_point)["curvature"] < 1e-9
    with pytest.raises(InputError, match="no strand has a length"):
        detail_spectrum(np.zeros((3, 16, 3), np.float32))
    with pytest.raises(InputError, match="8 points or more"):
        detail_spectrum(strands[:, :5])
    with pytest.raises(InputError, match="are no range"):
        detail_spectrum(strands, shortest=2.0, longest=1.0)


def test_the_finer_levels_are_measured_without_the_coarsest():
    """Curls of radius 0.03 and wavelength 0.3 on a straight and on a bent center, on which they are laid as details."""
    spectra = {}
    for bend in (0.0, 1.5):
        s = np.linspace(0, 2, 128)
        turn = bend * s / 2
        tangent = np.stack([np.sin(turn), np.cos(turn), 0 * turn], axis=1)
        normal = np.stack([np.cos(turn), -np.sin(turn), 0 * turn], axis=1)
        center = np.concatenate([[[0, 0, 0]], np.cumsum((tangent[1:] + tangent[:-1]) / 2, axis=0) * s[1]])
        angle = (2 * np.pi * s / 0.3)[:, None]
        hair = center + 0.03 * (np.cos(angle) - 1) * normal + 0.03 * np.sin(angle) * np.array([0.0, 0.0, 1.0])
        levels = [
            RootedStrands(np.zeros((1, 3), np.float32), np.eye(3, dtype=np.float32)[None], np.ones((1, 2), np.float32),
                          points[None].astype(np.float32))
            for points in (hair, center)
        ]  # fmt: skip
        spectra[bend] = finer_spectrum(WispHierarchy(tuple(levels), (np.zeros(1, np.int32),)))
    edges = detail_spectrum(helix()).edges
    best = int(np.argmax(spectra[0.0]))
    assert edges[best] <= 0.3 <= edges[best + 1]
    np.testing.assert_allclose(np.linalg.norm(spectra[0.0]), 0.03 * 2 * np.pi / 0.3, rtol=0.03)
    assert spectrum_distance(spectra[0.0], spectra[1.5]) < 0.01
