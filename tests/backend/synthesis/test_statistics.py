"""Style statistics: helices with known curvature and torsion, equal and different styles, copies."""

import numpy as np
from hairloom.synthesis.statistics import compare_styles, copied_share, curvature_and_torsion, kolmogorov_smirnov
from hairloom.types import RootedStrands
from scipy.stats import ks_2samp


def helix(radius, pitch, length, n_points):
    c = np.hypot(radius, pitch)
    angle = np.linspace(0, length / c, n_points)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), pitch * angle], axis=-1).astype(np.float32)


def field_of_hair(rng, n_strands, wave):
    uv = rng.uniform(0.9, 2.2, (n_strands, 2)).astype(np.float32)
    t = np.linspace(0, 1, 64)[None, :, None]
    length = rng.uniform(0.8, 1.2, (n_strands, 1, 1))
    points = length * t * np.array([0.3, 1.0, 0.1]) + wave * np.sin(20 * t) * np.array([1.0, 0, 0.5])
    points += 0.02 * rng.normal(size=(n_strands, 1, 3)) * t
    frames = np.broadcast_to(np.eye(3, dtype=np.float32), (n_strands, 3, 3)).copy()
    roots = np.concatenate([uv, np.zeros((n_strands, 1), np.float32)], axis=1)
    return RootedStrands(roots, frames, uv, points.astype(np.float32))


def test_curvature_and_torsion_of_a_helix():
    radius, pitch = 0.2, 0.1
    points = np.stack([helix(radius, pitch, 3.0, 400), helix(radius, -pitch, 3.0, 400)])
    curvature, torsion = curvature_and_torsion(points)
    square = radius**2 + pitch**2
    # second-order differences over 400 points, and one missing vertex at each end
    np.testing.assert_allclose(curvature, radius / square, rtol=5e-3)
    np.testing.assert_allclose(torsion, pitch / square, rtol=2e-2)


def test_a_straight_strand_has_neither():
    line = np.linspace(0, 1, 64)[None, :, None] * np.array([1.0, 2.0, 0.5])
    curvature, torsion = curvature_and_torsion(line.astype(np.float32))
    assert curvature[0] < 1e-2 and np.isfinite(torsion[0])


def test_a_style_is_like_itself_and_unlike_another():
    one, again = field_of_hair(np.random.default_rng(0), 900, 0.0), field_of_hair(np.random.default_rng(1), 900, 0.0)
    other = field_of_hair(np.random.default_rng(2), 900, 0.1)
    alike, unlike = compare_styles(one, again), compare_styles(one, other)
    assert alike.curvature < 0.15  # two-sample Kolmogorov-Smirnov at 900 strands: 0.064 is the 5 % limit
    assert alike.length < 0.1
    assert unlike.curvature > 0.9
    assert unlike.mean_distance > alike.mean_distance


def test_a_copy_is_found_and_new_hair_is_not():
    style = field_of_hair(np.random.default_rng(3), 500, 0.05)
    far = field_of_hair(np.random.default_rng(4), 500, 0.2)
    assert copied_share(style, style) == 1.0
    assert copied_share(style, far) == 0.0


def test_kolmogorov_smirnov_agrees_with_scipy():
    rng = np.random.default_rng(5)
    for size in (1, 7, 400):
        first, second = rng.normal(size=size), np.round(rng.normal(0.3, 2.0, 3 * size), 1)
        second[0] = first[0]  # ties within and between the samples
        assert abs(kolmogorov_smirnov(first, second) - ks_2samp(first, second).statistic) < 1e-12
