"""Blending of views and the screened Poisson equation over chart seams (Z-13, M-36)."""

import os
import subprocess
import sys

import numpy as np
import pytest
from hair_shapes import hair_shape
from hairloom.errors import InputError
from hairloom.fourview.poisson import PoissonSolver, blend_views
from hairloom.fourview.surface import SurfaceParams, make_surface
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import spsolve


@pytest.fixture(scope="module")
def texels():
    return make_surface(hair_shape()[0], SurfaceParams(128, 1, atlas_vertices=400)).levels[0].texels


def incidence(edges, count):
    """(E, T): the step along each edge, second - first."""
    number = np.arange(len(edges))
    values = np.concatenate([-np.ones(len(edges)), np.ones(len(edges))])
    return coo_array((values, (np.tile(number, 2), edges.T.ravel())), shape=(len(edges), count)).tocsc()


def least_squares(edges, colours, gradients, weight):
    step = incidence(edges, len(colours))
    matrix = csc_array(step.T @ step + diags_array(np.full(len(colours), weight)))
    return spsolve(matrix, weight * colours.astype(float) + step.T @ gradients.astype(float))


def energy(edges, values, colours, gradients, weight):
    steps = values[edges[:, 1]] - values[edges[:, 0]] - gradients
    return weight * ((values - colours) ** 2).sum() + (steps**2).sum()


@pytest.mark.parametrize("weight", [0.01, 0.1, 1.0])
def test_agrees_with_a_sparse_solve(texels, weight):
    rng = np.random.default_rng(3)
    colours = rng.uniform(0, 1, (texels.n_texels, 3)).astype(np.float32)
    gradients = rng.normal(0, 0.1, (len(texels.edges), 3)).astype(np.float32)
    truth = least_squares(texels.edges, colours, gradients, weight)
    exact = PoissonSolver(texels.edges, texels.n_texels, weight, 1e-6).solve(colours, gradients)
    np.testing.assert_allclose(exact, truth, atol=2e-5)  # float32 steps
    usual = PoissonSolver(texels.edges, texels.n_texels, weight)
    quick = usual.solve(colours, gradients)
    # white noise is the hardest start; the bound holds in the energy's norm scaled by the degrees, here in the mean
    assert np.linalg.norm(quick - truth) < 0.05 * np.linalg.norm(colours - truth)
    assert usual.n_steps < 80
    best = energy(texels.edges, truth, colours, gradients, weight)
    off = energy(texels.edges, truth + rng.normal(0, 1e-3, truth.shape), colours, gradients, weight)
    assert best < off


def test_colours_with_their_own_steps_stay(texels):
    colours = texels.points * np.float32(3)
    gradients = colours[texels.edges[:, 1]] - colours[texels.edges[:, 0]]
    solved = PoissonSolver(texels.edges, texels.n_texels).solve(colours, gradients)
    np.testing.assert_allclose(solved, colours, atol=1e-5)


def test_a_step_between_charts_is_smoothed_over_the_seam(texels):
    """One colour a chart and no wanted steps: across a seam the colours flow as inside a chart."""
    rows, columns = texels.texels // texels.size, texels.texels % texels.size
    one, other = texels.edges.T
    seam = np.abs(rows[one] - rows[other]) + np.abs(columns[one] - columns[other]) > 1
    assert seam.sum() > 50
    side = texels.points[:, 0] > 0
    rng = np.random.default_rng(0)
    chart_colour = np.where(side[:, None], np.float32(0.2), np.float32(0.8)) * np.ones(3, np.float32)
    noisy = (chart_colour + rng.normal(0, 0.05, chart_colour.shape)).astype(np.float32)
    zero = np.zeros((len(texels.edges), 3), np.float32)
    solved = PoissonSolver(texels.edges, texels.n_texels, 0.05).solve(noisy, zero)
    before = np.abs(noisy[one] - noisy[other])[seam].mean()
    after = np.abs(solved[one] - solved[other])[seam].mean()
    assert after < 0.3 * before
    # without the seams' edges the same texels stay apart
    apart = PoissonSolver(np.ascontiguousarray(texels.edges[~seam]), texels.n_texels, 0.05).solve(noisy, zero[~seam])
    assert np.abs(apart[one] - apart[other])[seam].mean() > 1.3 * after


def test_blend_of_views_by_hand():
    """Three texels in a row; the second view is weaker but has the stronger step at the first texel."""
    edges = np.int32([[0, 1], [1, 2]])
    colours = np.float32([[[0.5] * 3, [0.6] * 3, [0.9] * 3], [[0.1] * 3, [0.9] * 3, [0.9] * 3]])
    alpha = np.float32([[0.75, 0.75, 1.0], [0.25, 0.25, 0.0]])
    blended, gradients = blend_views(colours, alpha, edges)
    np.testing.assert_allclose(blended[:, 0], [0.4, 0.675, 0.9], atol=1e-6)
    # first texel: 0.75 * 0.1 < 0.25 * 0.8; second texel: 0.75 * 0.3 > 0
    np.testing.assert_allclose(gradients[:, 1], [0.8, 0.3], atol=1e-6)


def test_blend_agrees_with_the_reference(texels):
    rng = np.random.default_rng(5)
    colours = rng.uniform(0, 1, (3, texels.n_texels, 3)).astype(np.float32)
    alpha = rng.uniform(0, 1, (3, texels.n_texels)).astype(np.float32)
    alpha /= alpha.sum(axis=0)
    blended, gradients = blend_views(colours, alpha, texels.edges)
    np.testing.assert_allclose(blended, (alpha[..., None] * colours).sum(axis=0), atol=1e-6)
    steps = colours[:, texels.edges[:, 1]] - colours[:, texels.edges[:, 0]]
    square = np.zeros((3, texels.n_texels))
    for view in range(3):
        np.add.at(square[view], texels.edges[:, 0], (steps[view].astype(float) ** 2).sum(axis=1))
    best = (alpha * np.sqrt(square)).argmax(axis=0)[texels.edges[:, 0]]
    np.testing.assert_allclose(gradients, steps[best, np.arange(len(best))], atol=1e-6)


def test_one_view_comes_through_unchanged(texels):
    colours = np.random.default_rng(0).uniform(0, 1, (1, texels.n_texels, 3)).astype(np.float32)
    blended, gradients = blend_views(colours, np.ones((1, texels.n_texels), np.float32), texels.edges)
    solved = PoissonSolver(texels.edges, texels.n_texels).solve(blended, gradients)
    np.testing.assert_allclose(solved, colours[0], atol=1e-5)


def test_inputs_stay_as_they_are(texels):
    colours = np.random.default_rng(0).uniform(0, 1, (texels.n_texels, 3)).astype(np.float32)
    gradients = np.zeros((len(texels.edges), 3), np.float32)
    before = colours.tobytes(), texels.edges.tobytes()
    PoissonSolver(texels.edges, texels.n_texels).solve(colours, gradients)
    assert (colours.tobytes(), texels.edges.tobytes()) == before and not gradients.any()


def test_a_graph_without_edges_and_bad_input():
    empty = np.empty((0, 2), np.int32)
    colours = np.full((4, 3), 0.5, np.float32)
    solved = PoissonSolver(empty, 4).solve(colours, np.empty((0, 3), np.float32))
    np.testing.assert_allclose(solved, colours, atol=1e-6)
    for weight, tolerance in ((0.0, 0.1), (-1.0, 0.1), (0.1, 0.0), (0.1, 1.0)):
        with pytest.raises(InputError):
            PoissonSolver(empty, 4, weight, tolerance)
    with pytest.raises(InputError, match="shape"):
        PoissonSolver(empty, 4).solve(colours[:3], np.empty((0, 3), np.float32))


_BYTES = """
import hashlib, numpy as np
from hair_shapes import hair_shape, painted_views
from hairloom.fourview.surface import SurfaceParams, make_surface
from hairloom.fourview.projection import initial_texture, project_views
from hairloom.fourview.poisson import PoissonSolver, blend_views
open_mesh, closed = hair_shape(32)
texels = make_surface(open_mesh, SurfaceParams(128, 1, atlas_vertices=300)).levels[0].texels
views = painted_views(open_mesh, closed)
seen = project_views(texels, views, closed)
colours = initial_texture(texels, seen, views)
several = np.stack([colours, colours[::-1].copy(), colours * colours, 1 - colours])
blended, gradients = blend_views(several, seen.alpha, texels.edges)
solved = PoissonSolver(texels.edges, texels.n_texels).solve(blended, gradients)
digest = hashlib.sha256()
for array in (texels.points, texels.edges, seen.visible, colours, solved):
    digest.update(array.tobytes())
print(digest.hexdigest())
"""


def test_the_same_bytes_for_any_number_of_threads():
    digests = set()
    for threads in ("1", "2"):
        path = os.pathsep.join([os.path.dirname(__file__), os.environ.get("PYTHONPATH", "")])
        environment = os.environ | {"NUMBA_NUM_THREADS": threads, "PYTHONPATH": path}
        ran = subprocess.run(
            [sys.executable, "-c", _BYTES], env=environment, capture_output=True, text=True, check=True
        )
        digests.add(ran.stdout)
    assert len(digests) == 1
