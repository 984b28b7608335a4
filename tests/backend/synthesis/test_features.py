"""Feature vectors against analytic truth; feature maps against linear fields, holes and borders."""

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.synthesis.features import feature_map, fit_features, sample_map
from hairloom.types import FeatureMap


def strands_of_rank(rng, n_strands, rank, n_points=20):
    """Strands that differ in `rank` independent shapes, roots at 0."""
    shapes = rng.normal(size=(rank, n_points, 3))
    shapes[:, 0] = 0.0
    amounts = rng.normal(size=(n_strands, rank)) * 0.5 ** np.arange(rank)
    straight = np.linspace(0, 1, n_points)[:, None] * np.array([0.0, 1.0, 0.3])
    return (straight + np.einsum("sr,rnc->snc", amounts, shapes)).astype(np.float32)


def random_roots(rng, count, low=0.8, high=2.3):
    return rng.uniform(low, high, (count, 2)).astype(np.float32)


def test_strands_survive_encoding_when_all_axes_are_kept():
    points = strands_of_rank(np.random.default_rng(0), 300, 5)
    basis = fit_features(points, 16)
    assert basis.n_features == 5  # no axis without variance is kept
    # float32 sums of 60 numbers of about 1
    assert np.abs(basis.decode(basis.encode(points)) - points).max() < 1e-5
    assert basis.retained == pytest.approx(1.0, abs=1e-9)


def test_feature_distances_are_strand_distances():
    points = strands_of_rank(np.random.default_rng(1), 100, 4)
    features = fit_features(points, 16).encode(points)
    geometric = ((points[:50] - points[50:]) ** 2).sum(axis=(1, 2))
    np.testing.assert_allclose(((features[:50] - features[50:]) ** 2).sum(axis=1), geometric, rtol=1e-4)


def test_axes_and_variances_of_two_known_directions():
    rng = np.random.default_rng(2)
    points = np.zeros((4000, 2, 3), np.float32)
    points[:, 1, 0] = 3.0 * rng.choice([-1, 1], 4000) + 10.0
    points[:, 1, 2] = 1.0 * rng.choice([-1, 1], 4000)
    basis = fit_features(points, 1)
    # the two are drawn independently, so the axes turn by about their correlation, 1/sqrt(4000)
    np.testing.assert_allclose(basis.axes[0], [0, 0, 0, 1, 0, 0], atol=0.02)
    assert basis.variances[0] == pytest.approx(9.0, rel=0.01)
    assert basis.retained == pytest.approx(0.9, rel=0.01)
    np.testing.assert_allclose(basis.mean[3], points[:, 1, 0].mean(), rtol=1e-6)


def test_axes_are_orthonormal_and_do_not_depend_on_the_order_of_strands():
    rng = np.random.default_rng(3)
    points = strands_of_rank(rng, 200, 8)
    basis = fit_features(points, 6)
    np.testing.assert_allclose(basis.axes @ basis.axes.T, np.eye(6), atol=1e-6)
    shuffled = fit_features(points[rng.permutation(200)], 6)
    np.testing.assert_allclose(shuffled.axes, basis.axes, atol=1e-4)
    assert (np.take_along_axis(basis.axes, np.abs(basis.axes).argmax(axis=1)[:, None], axis=1) > 0).all()
    assert (np.diff(basis.variances) <= 0).all()


def test_fewer_strands_than_features():
    points = strands_of_rank(np.random.default_rng(4), 3, 5)
    basis = fit_features(points, 16)
    assert basis.n_features == 2
    np.testing.assert_allclose(basis.decode(basis.encode(points)), points, atol=1e-5)
    one = fit_features(points[:1], 16)
    np.testing.assert_allclose(one.decode(one.encode(points[:1])), points[:1], atol=1e-6)
    assert one.retained == 1.0


def test_decoded_strands_start_at_their_roots():
    rng = np.random.default_rng(5)
    basis = fit_features(strands_of_rank(rng, 50, 5), 3)
    assert (basis.decode(rng.normal(size=(10, 3)).astype(np.float32))[:, 0] == 0.0).all()


@pytest.mark.parametrize("n_features", [0, -3])
def test_refuses_no_features(n_features):
    with pytest.raises(InputError, match="n_features"):
        fit_features(np.zeros((4, 5, 3), np.float32), n_features)


def test_refuses_bad_strands():
    with pytest.raises(InputError, match="no strands"):
        fit_features(np.zeros((0, 5, 3), np.float32))
    points = np.zeros((4, 5, 3), np.float32)
    points[2, 3, 1] = np.nan
    with pytest.raises(InputError, match="NaN"):
        fit_features(points)
    basis = fit_features(np.zeros((4, 5, 3), np.float32))
    with pytest.raises(InputError, match="resample"):
        basis.encode(np.zeros((4, 6, 3), np.float32))
    with pytest.raises(InputError, match="features"):
        basis.decode(np.zeros((4, 7), np.float32))


def test_map_of_a_linear_field_is_linear():
    uv = random_roots(np.random.default_rng(6), 500)
    features = np.stack([2 * uv[:, 0] - uv[:, 1], 3 + uv[:, 1]], axis=1)
    made = feature_map(uv, features)
    rows, columns = np.nonzero(made.mask)
    u, v = made.origin[0] + columns * made.spacing, made.origin[1] + rows * made.spacing
    # cells on the rim outside all triangles take their nearest root, less than a cell away
    inside = (np.abs(u - 1.55) < 0.68) & (np.abs(v - 1.55) < 0.68)
    expected = np.stack([2 * u - v, 3 + v], axis=1)[inside]
    # float32 values of about 5
    np.testing.assert_allclose(made.values[rows, columns][inside], expected, atol=5e-6)
    assert inside.sum() > 4000  # the mask covers the square


def test_map_is_a_regular_grid_that_holds_all_roots():
    uv = random_roots(np.random.default_rng(7), 100)
    made = feature_map(uv, uv, spacing=0.05)
    last = made.origin + made.spacing * (np.array(made.mask.shape[::-1]) - 1)
    assert (made.origin <= uv.min(axis=0)).all() and (last >= uv.max(axis=0)).all()
    assert made.mask.shape == (31, 31)
    np.testing.assert_allclose(made.origin / 0.05, np.rint(made.origin / 0.05), atol=1e-9)


def test_bald_spots_and_concave_borders_stay_holes():
    uv = random_roots(np.random.default_rng(8), 4000)
    spot = np.linalg.norm(uv - [1.2, 1.6], axis=1) < 0.2
    corner = (uv > 1.7).all(axis=1)
    uv = uv[~spot & ~corner]
    made = feature_map(uv, uv)

    def valid_at(u, v):
        column, row = np.rint((np.array([u, v]) - made.origin) / made.spacing).astype(int)
        return bool(made.mask[row, column])

    assert not valid_at(1.2, 1.6) and not valid_at(1.3, 1.6)
    assert not valid_at(1.8, 1.8) and not valid_at(2.2, 2.2)
    assert valid_at(1.0, 1.0) and valid_at(2.1, 1.2) and valid_at(1.2, 2.2)
    area = 1.5**2 - np.pi * 0.2**2 - 0.6**2
    assert made.mask.sum() * made.spacing**2 == pytest.approx(area, rel=0.05)
    assert (made.values[~made.mask] == 0).all()


def test_map_does_not_depend_on_the_order_of_roots():
    rng = np.random.default_rng(9)
    uv, order = random_roots(rng, 300), rng.permutation(300)
    features = rng.normal(size=(300, 4)).astype(np.float32)
    first, second = feature_map(uv, features), feature_map(uv[order], features[order])
    assert (first.mask == second.mask).all()
    np.testing.assert_allclose(first.values, second.values, atol=1e-5)


@pytest.mark.parametrize("uv", [[[1.0, 1.0]], [[1.0, 1.0], [1.2, 1.0]], [[1.0, 1.0], [1.1, 1.1], [1.2, 1.2]]])
def test_roots_that_span_no_triangle_still_have_a_map(uv):
    uv = np.array(uv, np.float32)
    features = np.arange(len(uv), dtype=np.float32)[:, None]
    made = feature_map(uv, features)
    assert made.mask.any()
    np.testing.assert_array_equal(sample_map(made, uv), features)


def test_coinciding_roots_are_harmless():
    uv = np.repeat(random_roots(np.random.default_rng(10), 50), 2, axis=0)
    made = feature_map(uv, uv)
    assert np.isfinite(made.values).all() and made.mask.any()


def test_samples_are_the_nearest_valid_cells():
    rng = np.random.default_rng(11)
    mask = rng.random((12, 9)) < 0.4
    values = rng.normal(size=(12, 9, 3)).astype(np.float32)
    source = FeatureMap(values, mask, np.array([0.8, 1.1]), 0.02)
    uv = rng.uniform([0.75, 1.05], [1.02, 1.38], (200, 2))
    rows, columns = np.nonzero(mask)
    cells = np.stack([0.8 + 0.02 * columns, 1.1 + 0.02 * rows], axis=1)
    nearest = ((uv[:, None] - cells) ** 2).sum(axis=2).argmin(axis=1)
    np.testing.assert_array_equal(sample_map(source, uv), values[rows[nearest], columns[nearest]])


def test_smooth_samples_are_bilinear_over_the_valid_cells():
    v, u = np.mgrid[0:8, 0:10]
    values = np.stack([u + 2.0 * v, 1.0 * v], axis=2).astype(np.float32)
    mask = np.ones((8, 10), bool)
    mask[:, 7:] = False
    source = FeatureMap(values, mask, np.array([1.0, 2.0]), 0.1)
    at = np.array([[3.25, 4.5], [0.0, 0.0], [6.5, 2.25], [8.9, 3.0]])  # cells: inside, corner, half outside, outside
    sampled = sample_map(source, at * 0.1 + [1.0, 2.0], smooth=True)
    expected = [[3.25 + 9.0, 4.5], [0.0, 0.0], [6.0 + 4.5, 2.25], [6.0 + 6.0, 3.0]]
    np.testing.assert_allclose(sampled, expected, atol=1e-5)


def test_refuses_bad_maps():
    uv = random_roots(np.random.default_rng(12), 5)
    with pytest.raises(InputError, match="no roots"):
        feature_map(uv[:0], uv[:0])
    with pytest.raises(InputError, match="fit"):
        feature_map(uv, uv[:3])
    with pytest.raises(InputError, match="spacing"):
        feature_map(uv, uv, spacing=0.0)
    with pytest.raises(InputError, match="larger spacing"):
        feature_map(uv, uv, spacing=1e-5)
    with pytest.raises(InputError, match="margin"):
        feature_map(uv, uv, margin=0.0)
    with pytest.raises(InputError, match="NaN"):
        feature_map(np.full((5, 2), np.nan, np.float32), uv)
    empty = FeatureMap(np.zeros((3, 3, 2), np.float32), np.zeros((3, 3), bool), np.zeros(2), 0.02)
    with pytest.raises(InputError, match="no valid cell"):
        sample_map(empty, uv)
