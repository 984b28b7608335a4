"""Streamlines: straight lines, circles, order of convergence, ends, dense and sparse lookups (W-26, W-A3)."""

import numba
import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.fields.grid import DirectionGrid, build_direction_grid, dense_grid
from hairloom.fields.tracing import follow, near_order, trace, trace_steps
from hairloom.geometry.analytic_heads import sphere_head
from hairloom.geometry.scalp_space import fit_scalp_space
from scipy.ndimage import map_coordinates


def circular_field(n_cells: int = 160) -> DirectionGrid:
    """Around the z axis, counter-clockwise, on [-2, 2]^2 x [-0.5, 0.5]; not normalised, so exactly linear."""
    spacing = 4.0 / n_cells
    middle = -2.0 + spacing * (np.arange(n_cells) + 0.5)
    x, y = np.meshgrid(middle, middle, indexing="ij")
    field = np.zeros((n_cells, n_cells, 8, 3), np.float32)
    field[..., 0], field[..., 1] = -y[:, :, None], x[:, :, None]
    return dense_grid(field, (-2.0, -2.0, -4 * spacing), spacing)


def naive_lines(field, origin, spacing, roots, length, step):
    """(S, K, 3) Euler points with scipy's trilinear interpolation, strand by strand in one numpy step."""
    points = [roots.astype(float)]
    for _ in range(round(length / step)):
        at = (points[-1] - origin) / spacing - 0.5
        mean = np.stack([map_coordinates(field[..., c], at.T, order=1, mode="constant") for c in range(3)], axis=1)
        points.append(points[-1] + step * mean / np.linalg.norm(mean, axis=1, keepdims=True))
    return np.stack(points, axis=1)


def smooth_field(shape=(30, 20, 25), seed=0):
    i, j, k = np.meshgrid(*[np.arange(n) for n in shape], indexing="ij")
    field = np.stack([np.cos(i / 7 + j / 9), np.sin(j / 5 - k / 8) + 0.2, np.cos(k / 6 + i / 10)], axis=-1)
    return field.astype(np.float32)


def test_constant_field_gives_straight_lines():
    direction = np.array([0.6, 0.0, 0.8], np.float32)
    grid = dense_grid(np.broadcast_to(direction, (40, 40, 40, 3)), (0, 0, 0), 0.1)
    roots = np.array([[0.5, 1.0, 0.5], [1.0, 2.0, 0.3]], np.float32)
    points, reached = trace(grid, roots, np.array([1.0, 1.73]), 0.02, n_points=11)
    for strand, length in enumerate((1.0, 1.73)):
        expected = roots[strand] + np.linspace(0, length, 11)[:, None] * direction
        np.testing.assert_allclose(points[strand], expected, atol=2e-6)
    np.testing.assert_allclose(reached, [1.0, 1.73], atol=1e-6)


def test_circles_grow_as_euler_does():
    """Each Euler step of h on a circle field takes the radius to sqrt(r^2 + h^2), exactly."""
    grid, step, n_steps = circular_field(), 0.02, 200
    roots = np.array([[1.0, 0.0, 0.0], [0.0, -0.7, 0.0]], np.float32)
    points, counts = trace_steps(grid, roots, np.full(2, n_steps * step), step)
    assert (counts == n_steps + 1).all()
    radii = np.linalg.norm(points, axis=2)
    expected = np.sqrt(radii[:, :1] ** 2 + np.arange(n_steps + 1) * step**2)
    np.testing.assert_allclose(radii, expected, atol=2e-5)  # float32 interpolation over 200 steps
    assert points[0, 10, 1] > 0.15, "counter-clockwise"


def test_convergence_is_of_first_order():
    grid, root = circular_field(), np.array([[1.0, 0.0, 0.0]], np.float32)
    exact = np.array([np.cos(1.0), np.sin(1.0), 0.0])
    errors = []
    for step in (0.1, 0.05, 0.025):
        points, _ = trace(grid, root, np.ones(1), step)
        errors.append(np.linalg.norm(points[0, -1] - exact))
    assert 1.9 < errors[0] / errors[1] < 2.1 and 1.9 < errors[1] / errors[2] < 2.1


def test_steps_against_scipy():
    field, spacing, origin = smooth_field(), 0.1, np.array([-1.0, 0.3, 2.0])
    rng = np.random.default_rng(1)
    roots = (origin + rng.uniform(0.35, 0.65, (300, 3)) * np.array(field.shape[:3]) * spacing).astype(np.float32)
    expected = naive_lines(field, origin, spacing, roots, 0.4, 0.02)
    points, counts = trace_steps(dense_grid(field, origin, spacing), roots, np.full(300, 0.4), 0.02)
    assert (counts == 21).all()
    np.testing.assert_allclose(points, expected, atol=1e-5)  # float32 weights


def test_ends_where_there_is_no_direction():
    """A strand crosses 1.0 of hair and stops in the first place whose 8 cells are all empty (W-26)."""
    field = np.zeros((40, 5, 5, 3), np.float32)
    field[:20] = [1, 0, 0]
    points, reached = trace(
        dense_grid(field, (0, 0, 0), 0.05), np.array([[0.03, 0.12, 0.12]], np.float32), np.full(1, 5.0)
    )
    last = points[0, -1, 0]
    assert 1.0 + 0.025 <= last <= 1.0 + 0.025 + 0.02 + 1e-6  # half a cell of interpolation, then one step at most
    assert reached[0] == pytest.approx(last - 0.03, abs=1e-6)
    np.testing.assert_allclose(np.diff(points[0, :, 0]), reached[0] / 63, atol=1e-6)


def test_root_without_hair_stays_a_point():
    grid = dense_grid(np.zeros((4, 4, 4, 3), np.float32), (0, 0, 0), 1.0)
    points, reached = trace(grid, np.array([[2, 2, 2], [50, 0, 0]], np.float32), np.ones(2), n_points=5)
    assert reached.tolist() == [0, 0] and (points == points[:, :1]).all()


def test_sparse_grid_is_looked_up_like_a_dense_one():
    rng = np.random.default_rng(0)
    t = np.linspace(0, 1, 30)[:, None]
    bend = rng.normal(size=(500, 1, 3)) * 0.2 + [0, 1, 0]
    points = (rng.uniform(-0.3, 0.3, (500, 1, 3)) + bend * t + 0.3 * t**2).astype(np.float32)
    sparse = build_direction_grid(points, None, 0.03)
    dense = dense_grid(sparse.dense(), sparse.origin, sparse.spacing)
    assert (sparse.blocks < 0).any(), "the test wants empty blocks"
    roots, lengths = points[:, 3], np.full(500, 2.0)
    (sparse_lines, sparse_counts), (dense_lines, dense_counts) = (
        trace_steps(grid, roots, lengths) for grid in (sparse, dense)
    )
    np.testing.assert_array_equal(sparse_counts, dense_counts)
    np.testing.assert_allclose(sparse_lines, dense_lines, atol=1e-6)  # the 8 cells are added up in another order


def test_trace_in_scalp_space_follows_its_hair():
    space = fit_scalp_space(sphere_head())
    outward = np.random.default_rng(0).normal(size=(3000, 1, 3))
    outward[..., 1] = np.abs(outward[..., 1]) + 0.2
    outward /= np.linalg.norm(outward, axis=2, keepdims=True)
    points = (outward * np.linspace(1.0, 1.5, 20)[:, None]).astype(np.float32)
    grid = build_direction_grid(points, space, 0.05)
    traced, reached = trace(grid, points[:, 0], np.full(3000, 0.45), n_points=20)
    expected = outward * np.linspace(1.0, 1.45, 20)[:, None]
    # a cell averages radial directions over 0.1 radians
    assert np.linalg.norm(traced - expected, axis=2).max() < 0.03
    np.testing.assert_allclose(reached, 0.45, atol=1e-6)


def test_same_bytes_for_any_number_of_threads():
    field, roots = smooth_field(), np.random.default_rng(2).uniform(5, 15, (3000, 3)).astype(np.float32)
    strands = (roots[:, None] + np.linspace(0, 3, 16)[:, None] * [0.5, 0.5, 0.7]).astype(np.float32)
    grid, before, results = dense_grid(field, (0, 0, 0), 1.0), numba.get_num_threads(), []
    try:
        for n_threads in {1, before}:
            numba.set_num_threads(n_threads)
            lines = trace(grid, roots, np.full(3000, 4.0), 0.1)[0]
            followed = follow(grid, strands, np.full(3000, 0.5), 0.1)[0]
            results.append((lines.tobytes(), followed.tobytes()))
    finally:
        numba.set_num_threads(before)
    assert all(result == results[0] for result in results)


def test_order_of_strands_does_not_matter():
    field, rng = smooth_field(), np.random.default_rng(2)
    roots, lengths = rng.uniform(5, 15, (200, 3)).astype(np.float32), rng.uniform(0, 4, 200)
    mixed = rng.permutation(200)
    grid = dense_grid(field, (0, 0, 0), 1.0)
    np.testing.assert_array_equal(trace(grid, roots, lengths)[0][mixed], trace(grid, roots[mixed], lengths[mixed])[0])


def test_follow_with_all_weight_is_the_streamline():
    grid, step = circular_field(), 0.02
    own = np.zeros((1, 51, 3), np.float32)
    own[0, :, 0] = 1.0 + np.arange(51) * step  # straight outwards, at right angles to the field
    points, counts = follow(grid, own, np.ones(1), step)
    lines, _ = trace_steps(grid, own[:, 0], np.full(1, 50 * step), step)
    np.testing.assert_allclose(points, lines, atol=1e-5)
    assert counts[0] == 51


def test_follow_with_no_weight_is_the_strand():
    own = np.random.default_rng(0).normal(size=(20, 9, 3)).astype(np.float32)
    points, _ = follow(circular_field(), own, np.zeros(20))
    np.testing.assert_array_equal(points, own)


def test_follow_blends_directions():
    grid = dense_grid(np.broadcast_to(np.float32([1, 0, 0]), (50, 50, 4, 3)), (0, 0, -0.2), 0.1)
    own = np.zeros((1, 11, 3), np.float32)
    own[0] = [1.0, 1.0, 0.0]
    own[0, :, 1] += np.linspace(0, 1, 11)
    points, _ = follow(grid, own, np.array([0.25]), 0.1)
    direction = np.array([0.25, 0.75, 0]) / np.hypot(0.25, 0.75)
    np.testing.assert_allclose(points[0], own[0, 0] + np.linspace(0, 1, 11)[:, None] * direction, atol=1e-5)


@pytest.mark.parametrize(("limit", "trust"), [(100, 1.0), (90, 1.0), (60, 0.5), (45, 0.0), (30, 0.0)])
def test_field_beyond_the_angle_limit_is_trusted_less(limit, trust):
    """The field is at 90 degrees; trust falls with the cosine from 1 at the limit to 0 at twice the limit."""
    grid = dense_grid(np.broadcast_to(np.float32([1, 0, 0]), (50, 50, 4, 3)), (0, 0, -0.2), 0.1)
    own = np.zeros((1, 2, 3), np.float32)
    own[0] = [1.0, 1.0, 0.0]
    own[0, 1, 1] = 1.1
    points, _ = follow(grid, own, np.array([0.5]), 0.1, angle_limit=np.radians(limit))
    weight = 0.5 * trust
    expected = np.array([weight, 1 - weight, 0]) / np.hypot(weight, 1 - weight)
    np.testing.assert_allclose((points[0, 1] - points[0, 0]) / 0.1, expected, atol=1e-5)


def test_follow_goes_on_or_ends_where_no_hair_is():
    field = np.zeros((40, 10, 10, 3), np.float32)
    field[:10] = np.float32([0.6, 0.8, 0])
    grid = dense_grid(field, (0, -0.5, -0.5), 0.1)
    own = np.zeros((1, 33, 3), np.float32)
    own[0, :, 0] = np.linspace(0.5, 3.7, 33)
    kept, counts = follow(grid, own, np.full(1, 0.5), 0.1)
    assert counts[0] == 33
    lengths = np.linalg.norm(np.diff(kept[0], axis=0), axis=1)
    np.testing.assert_allclose(lengths, 0.1, atol=1e-6)
    np.testing.assert_allclose(np.diff(kept[0, -5:], axis=0), [[0.1, 0, 0]] * 4, atol=1e-6)
    ended, counts = follow(grid, own, np.full(1, 0.5), 0.1, fill_gaps=False)
    assert counts[0] < 12
    np.testing.assert_allclose(ended[0, -1], kept[0, counts[0] - 1], atol=1e-6)
    np.testing.assert_array_equal(ended[0, 0], own[0, 0])


def test_follow_keeps_out_of_the_head():
    """A field straight into the head: no point gets under the clearance, or under its own strand if that is lower."""
    space = fit_scalp_space(sphere_head())
    inwards = np.broadcast_to(np.float32([0, -1, 0]), (40, 40, 40, 3))
    grid = dense_grid(inwards, (-2, -2, -2), 0.1)
    own = np.zeros((2, 30, 3), np.float32)
    own[:, :, 0] = 0.1 + np.linspace(0, 0.5, 30)
    own[:, :, 1] = np.sqrt(1.0 - own[:, :, 0] ** 2)
    own[0] *= np.linspace(1.0, 1.05, 30)[:, None]
    own[1] *= np.linspace(1.0, 0.95, 30)[:, None]  # this one runs inside
    height = space.to_scalp(own)[..., 2]
    pushed, _ = follow(grid, own, np.full(2, 0.7), 0.02, space=space, clearance=0.01)
    free, _ = follow(grid, own, np.full(2, 0.7), 0.02)
    assert space.to_scalp(free)[0, -1, 2] < -0.05, "the test wants a field that would go in"
    assert (space.to_scalp(pushed)[..., 2] >= np.minimum(0.01, height) - 1e-5).all()
    np.testing.assert_array_equal(pushed[:, 0], own[:, 0])


def test_near_order_is_a_permutation():
    points = np.random.default_rng(0).normal(size=(500, 3)).astype(np.float32)
    order = near_order(points)
    assert sorted(order) == list(range(500))
    hops = np.linalg.norm(np.diff(points[order], axis=0), axis=1).mean()
    assert hops < 0.7 * np.linalg.norm(np.diff(points, axis=0), axis=1).mean()
    assert len(near_order(points[:0])) == 0 and near_order(points[:1]).tolist() == [0]


def test_bad_input():
    grid = circular_field(20)
    roots = np.zeros((2, 3), np.float32)
    with pytest.raises(InputError, match="roots"):
        trace(grid, roots[:, :2], np.ones(2))
    with pytest.raises(InputError, match="lengths"):
        trace(grid, roots, np.ones(3))
    with pytest.raises(InputError, match="lengths"):
        trace(grid, roots, np.array([1.0, -1.0]))
    with pytest.raises(InputError, match="step"):
        trace(grid, roots, np.ones(2), 0.0)
    with pytest.raises(InputError, match="steps"):
        trace(grid, roots, np.ones(2), 1e-9)
    with pytest.raises(InputError, match="n_points"):
        trace(grid, roots, np.ones(2), n_points=1)
    with pytest.raises(InputError, match="strands"):
        follow(grid, roots, np.ones(2))
    with pytest.raises(InputError, match="weights"):
        follow(grid, np.zeros((2, 4, 3), np.float32), np.ones(3))
    assert trace(grid, roots[:0], np.ones(0))[0].shape == (0, 64, 3)
