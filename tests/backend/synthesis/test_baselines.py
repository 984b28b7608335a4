"""The two baselines of the paper's Fig. 8: what they keep, what they are exact on, bad input."""

import numpy as np
import pytest
from hairloom.errors import Cancelled, InputError
from hairloom.geometry.analytic_heads import sphere_head
from hairloom.geometry.scalp_space import fit_scalp_space
from hairloom.geometry.strands import polyline_lengths
from hairloom.synthesis.baselines import Synthesis2DParams, Synthesis3DParams, synthesize_2d, synthesize_3d
from hairloom.types import RootedStrands

COARSE = Synthesis2DParams(map_spacing=0.05)


@pytest.fixture(scope="module")
def space():
    return fit_scalp_space(sphere_head(0.1, n_rings=32))


def strands_on(space, rng, count, points):
    """Strands at random roots of the upper half of the sphere; points (N, 3) or (count, N, 3) in root frames."""
    uv = rng.uniform(1.0, 2.1, (count, 2)).astype(np.float32)
    roots = space.from_scalp(np.column_stack([uv, np.zeros(count)]).astype(np.float32))
    shape = np.broadcast_to(points, (count, *np.shape(points)[-2:]))
    return RootedStrands(roots, space.frames_at(uv), uv, np.ascontiguousarray(shape, dtype=np.float32))


def bristles(n_points=16, length=0.3):
    """A strand along the normal of the scalp, 0.3 head radii long."""
    return np.linspace(0, length, n_points)[:, None] * np.array([0.0, 1.0, 0.0])


def test_2d_gives_equal_strands_back(space):
    rng = np.random.default_rng(0)
    example, roots = strands_on(space, rng, 400, bristles()), strands_on(space, rng, 300, bristles() * 0)
    made = synthesize_2d(example, roots, COARSE)
    np.testing.assert_allclose(made.points, np.broadcast_to(bristles(), made.points.shape), atol=1e-5)
    np.testing.assert_array_equal(made.roots, roots.roots)


def test_2d_strands_are_mixtures_of_the_examples(space):
    rng = np.random.default_rng(1)
    lean = rng.uniform(-0.2, 0.2, (400, 1, 1)) * np.linspace(0, 1, 16)[:, None] * np.array([1.0, 0.0, 0.0])
    example = strands_on(space, rng, 400, bristles() + lean)
    made = synthesize_2d(example, strands_on(space, rng, 300, bristles()), COARSE, seed=3)
    tips = made.points[:, -1]
    assert (tips[:, 0] >= example.points[:, -1, 0].min() - 1e-4).all()
    assert (tips[:, 0] <= example.points[:, -1, 0].max() + 1e-4).all()
    assert tips[:, 0].std() > 0.02
    np.testing.assert_allclose(tips[:, 1:], np.broadcast_to([0.3, 0.0], (300, 2)), atol=1e-4)


def test_the_same_seed_gives_the_same_strands(space):
    rng = np.random.default_rng(2)
    lean = rng.uniform(-0.2, 0.2, (300, 1, 1)) * np.linspace(0, 1, 16)[:, None] * np.array([1.0, 0.0, 0.5])
    example = strands_on(space, rng, 300, bristles() + lean)
    params = Synthesis3DParams(spacing=0.08, n_iterations=2)
    for make in (
        lambda seed: synthesize_2d(example, example, COARSE, seed=seed),
        lambda seed: synthesize_3d(example, example, space, params, seed=seed),
    ):
        assert make(1).points.tobytes() == make(1).points.tobytes()
        assert make(1).points.tobytes() != make(2).points.tobytes()


def test_3d_follows_bristles(space):
    rng = np.random.default_rng(3)
    example, roots = strands_on(space, rng, 4000, bristles()), strands_on(space, rng, 500, bristles() * 0)
    made = synthesize_3d(example, roots, space, Synthesis3DParams(spacing=0.06))
    np.testing.assert_array_equal(made.roots, roots.roots)
    assert (made.points[:, 0] == 0).all()
    inner = (np.abs(roots.uv - 1.55) < 0.45).all(axis=1)
    direction = made.points[inner, -1] / np.linalg.norm(made.points[inner, -1], axis=1, keepdims=True)
    # cells are 0.06 rad wide, and the normal turns by as much within one
    assert np.median(direction[:, 1]) > 0.99
    assert np.median(polyline_lengths(made.points[inner])) > 0.25


def test_3d_leans_as_the_example_does(space):
    rng = np.random.default_rng(4)
    lean = np.linspace(0, 0.2, 16)[:, None] * np.array([1.0, 0.0, -0.5])
    example = strands_on(space, rng, 4000, bristles() + lean)
    made = synthesize_3d(example, strands_on(space, rng, 300, bristles()), space, Synthesis3DParams(spacing=0.06))
    tips = made.points[(np.abs(made.uv - 1.55) < 0.4).all(axis=1), -1]
    np.testing.assert_allclose(np.median(tips, axis=0), [0.2, 0.3, -0.1], atol=0.06)  # a cell


def test_refuses_bad_input(space):
    example = strands_on(space, np.random.default_rng(5), 50, bristles())
    nothing = RootedStrands(example.roots[:0], example.frames[:0], example.uv[:0], example.points[:0])
    for make in (lambda a, b: synthesize_2d(a, b), lambda a, b: synthesize_3d(a, b, space)):
        with pytest.raises(InputError, match="no strands"):
            make(nothing, example)
        with pytest.raises(InputError, match="no roots"):
            make(example, nothing)
    for settings in ({"map_spacing": 0.0}, {"n_features": 0}):
        with pytest.raises(InputError, match=next(iter(settings))):
            Synthesis2DParams(**settings)
    for settings in ({"spacing": 0.0}, {"window": 1}, {"depth": 0}, {"n_iterations": 0}):
        with pytest.raises(InputError, match=next(iter(settings))):
            Synthesis3DParams(**settings)


def test_both_can_be_cancelled(space):
    example = strands_on(space, np.random.default_rng(6), 300, bristles())

    def cancel(fraction, _):
        if fraction > 0.1:
            raise Cancelled

    with pytest.raises(Cancelled):
        synthesize_2d(example, example, COARSE, progress=cancel)
    with pytest.raises(Cancelled):
        synthesize_3d(example, example, space, Synthesis3DParams(spacing=0.06), progress=cancel)
