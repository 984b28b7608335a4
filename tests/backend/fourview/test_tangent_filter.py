"""Orientation on tangent planes: painted stripes whose direction is known, across charts and seams."""

import numpy as np
import pytest
from direction_scenes import degrees_between, ellipsoid_texels, level_lines
from hairloom.errors import InputError
from hairloom.fourview.tangent_filter import TangentFilterParams, tangent_bank, tangent_frames, texel_orientations

GRADIENT = np.array([0.3, 0.2, 1.0])


def striped(texels, gradient=GRADIENT, width=4.0, noise=0.0):
    """(T, 3) colours of stripes along the level lines of a linear function, `width` texels apart at the steepest."""
    height = texels.points @ (gradient / np.linalg.norm(gradient))
    grey = 0.5 + 0.3 * np.sin(2 * np.pi * height / (width * texels.spacing))
    grey = grey + noise * np.random.default_rng(0).normal(size=len(grey))
    return np.repeat(grey[:, None], 3, axis=1).astype(np.float32)


@pytest.fixture(scope="module")
def texels():
    return ellipsoid_texels(80)


def steep(texels):
    """Where the stripes are not much wider than the filters."""
    return np.linalg.norm(np.cross(texels.normals, GRADIENT), axis=1) > 0.6 * np.linalg.norm(GRADIENT)


@pytest.mark.parametrize(("iterations", "noise", "limit"), [(1, 0.0, 2.0), (3, 0.0, 4.0), (3, 0.3, 8.0)])
def test_stripes_on_an_ellipsoid(texels, iterations, noise, limit):
    colours = striped(texels, noise=noise)
    found, confidence = texel_orientations(texels, colours, TangentFilterParams(iterations=iterations))
    where = steep(texels)
    error = degrees_between(found, level_lines(texels.normals, GRADIENT))[where]
    # between the stripes there is nothing to see: only what is trusted counts; bins are 5.6 degrees wide
    assert np.average(error, weights=confidence[where]) < limit
    assert np.allclose(np.einsum("tc,tc->t", found, texels.normals), 0, atol=1e-5)


def test_seams_are_as_good_as_the_middle_of_charts(texels):
    found, confidence = texel_orientations(texels, striped(texels), TangentFilterParams(iterations=1))
    error = degrees_between(found, level_lines(texels.normals, GRADIENT))
    border = np.zeros(texels.n_texels, np.bool_)
    grid = texels.grid()
    padded = np.pad(grid, 1, constant_values=-1)
    size = texels.size
    beside = [padded[1 + i : 1 + i + size, 1 + j : 1 + j + size] < 0 for i in (-1, 0, 1) for j in (-1, 0, 1)]
    border[grid[(grid >= 0) & np.any(beside, axis=0)]] = True
    assert border.sum() > 1000
    at_seams = border & steep(texels)
    assert np.average(error[at_seams], weights=confidence[at_seams]) < 4.0
    inner = ~border & steep(texels)
    assert confidence[at_seams].mean() > 0.6 * confidence[inner].mean()


def test_same_bytes_twice(texels):
    colours = striped(texels, noise=0.2)
    assert texel_orientations(texels, colours)[0].tobytes() == texel_orientations(texels, colours)[0].tobytes()


def test_bank_has_no_mean_and_frames_are_right_handed():
    offsets, bank = tangent_bank(TangentFilterParams())
    assert bank.shape == (32, len(offsets))
    assert np.abs(bank.sum(axis=1)).max() < 1e-5
    # the first filter's line runs along the tangent: it does not change along it near the middle
    middle = np.flatnonzero((offsets == 0).all(axis=1))[0]
    right = np.flatnonzero((offsets == [1, 0]).all(axis=1))[0]
    below = np.flatnonzero((offsets == [0, 2]).all(axis=1))[0]
    assert bank[0, right] > 0.8 * bank[0, middle] and bank[0, below] < 0
    normals = np.array([[0, 0, 1], [0, -1, 0], [0.6, 0, 0.8]], np.float32)
    frames = tangent_frames(normals)
    assert np.allclose(np.cross(normals, frames[:, 0]), frames[:, 1], atol=1e-6)
    assert frames[1, 1] @ [0, 0, 1] == pytest.approx(-1)  # seen from the front: tangent to the picture's left, down


def test_bad_input(texels):
    with pytest.raises(InputError, match="colours must have shape"):
        texel_orientations(texels, np.zeros((3, 3), np.float32))
    with pytest.raises(InputError, match="wavelength is 0"):
        TangentFilterParams(wavelength=0)
