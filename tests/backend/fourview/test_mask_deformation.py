import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.fourview.deformation import (
    DeformationParams,
    Displacement,
    ThinPlateSpline,
    _projections,
    _ShapeSolver,
    cotangent_laplacian,
    deform_to_masks,
    make_warp,
)
from hairloom.geometry.camera import project, towards
from hairloom.types import Mesh
from radial_hair import FOUR, HEAD, dome, overlap, views

ROUND = dome(0.14, n_rings=24)


def scattered(count=30, seed=0):
    return np.random.default_rng(seed).uniform(-50.0, 150.0, (count, 2))


def test_a_spline_goes_through_its_landmarks():
    sources = scattered()
    values = np.random.default_rng(1).normal(size=(30, 2))
    assert np.allclose(ThinPlateSpline(sources, values)(sources), values, atol=1e-6)


def test_a_spline_of_an_affine_map_is_that_map_everywhere():
    sources, elsewhere = scattered(), scattered(50, 2) * 3.0
    turn = np.array([[1.2, 0.3], [-0.4, 0.8]])
    spline = ThinPlateSpline(sources, sources @ turn + [3.0, -2.0])
    assert np.allclose(spline(elsewhere), elsewhere @ turn + [3.0, -2.0], atol=1e-5)


def test_a_spline_bends_less_than_any_other_way_through_the_landmarks():
    # the bending energy is w' K w: it must be 0 for affine values and positive else; smoothing lowers it
    sources = scattered()
    values = np.random.default_rng(3).normal(size=(30, 1))

    def second_differences(spline):
        line = np.stack([np.linspace(-40.0, 140.0, 400), np.full(400, 50.0)], axis=1)
        return (np.diff(spline(line), n=2, axis=0) ** 2).sum()

    stiffness = [second_differences(ThinPlateSpline(sources, values, smoothing)) for smoothing in (0.0, 0.01, 1.0)]
    assert stiffness[0] > stiffness[1] > stiffness[2]


def test_landmarks_on_a_line_are_followed():
    sources = np.stack([np.linspace(0.0, 100.0, 12), np.full(12, 20.0)], axis=1)
    spline = ThinPlateSpline(sources, np.full((12, 2), [5.0, -3.0]), 1e-3)
    assert np.allclose(spline(sources), [5.0, -3.0], atol=1e-3)


def naive_laplacian(mesh):
    count = len(mesh.vertices)
    matrix = np.zeros((count, count))
    points = mesh.vertices.astype(np.float64)
    for triangle in mesh.triangles:
        for k in range(3):
            a, b, c = triangle[k], triangle[(k + 1) % 3], triangle[(k + 2) % 3]
            u, v = points[b] - points[a], points[c] - points[a]
            cotangent = 0.5 * (u @ v) / np.linalg.norm(np.cross(u, v))
            cotangent = min(max(cotangent, 0.01), 5.0)
            matrix[b, c] += cotangent
            matrix[c, b] += cotangent
    return matrix - np.diag(matrix.sum(axis=1))


def test_the_laplacian_agrees_with_the_slow_one():
    octahedron = Mesh(
        np.array([[1, 0, 0], [-1, 0, 0], [0, 1.5, 0], [0, -1, 0.2], [0, 0, 1], [0.1, 0, -1]], np.float32),
        np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]], np.int32),
    )
    assert np.allclose(cotangent_laplacian(octahedron).toarray(), naive_laplacian(octahedron))


def test_the_solver_finds_the_least_of_equation_2_with_the_direction_frozen():
    sample = views(dome(0.15, (1.2, 1.0, 1.1)), ("front", "left"), perspective=True)
    params = DeformationParams(solves=30, still=1e-2, depth=0.0)
    points = ROUND.vertices.astype(np.float64)
    warps = []
    for view in sample:
        seen = project(view.camera, points)[:, :2]
        middle = seen.mean(axis=0)
        on_head = np.zeros(len(seen[::9]), np.bool_)
        warps.append(make_warp(view.camera, seen[::9], 0.1 * (seen[::9] - middle), on_head, points, 1.5, params))
    solved = _ShapeSolver(ROUND, [view.camera for view in sample], params, None).solve(points, warps)

    def energy(moved, frozen):
        # targets and directions are those of the points that the round began with
        total = 0.0
        for warp in warps:
            off = moved - warp.targets(points)
            away = towards(warp.camera, points)
            total += ((off - (off * away).sum(axis=1, keepdims=True) * away) ** 2).sum()
        bent = cotangent_laplacian(ROUND) @ moved - frozen
        return total + (bent**2).sum() + params.still * ((moved - points) ** 2).sum()

    laplacian = cotangent_laplacian(ROUND)
    bent = laplacian @ solved
    lengths = np.linalg.norm(laplacian @ points, axis=1)
    frozen = bent * (lengths / np.linalg.norm(bent, axis=1))[:, None]
    least = energy(solved, frozen)
    rng = np.random.default_rng(0)
    for scale in (1e-3, 1e-4):
        for _ in range(5):
            step = scale * rng.normal(size=solved.shape)
            # least up to what is left after 30 solves of the iteration
            assert energy(solved + step, frozen) > least
            assert energy(solved - step, frozen) > least


def test_without_smoothness_vertices_go_where_the_warps_take_them():
    sample = views(dome(0.15, (1.2, 1.0, 1.1)))
    params = DeformationParams(smoothness=0.0, still=1e-9)
    points = ROUND.vertices.astype(np.float64)
    warps = []
    for view in sample:
        seen = project(view.camera, points)[:, :2]
        none = np.zeros(len(seen[::5]), np.bool_)
        warps.append(make_warp(view.camera, seen[::5], np.full((len(none), 2), [7.0, -4.0]), none, points, 2.0, params))
    solved = _ShapeSolver(ROUND, [view.camera for view in sample], params, None).solve(points, warps)
    system, right = _projections(warps, points)
    assert np.allclose(solved, np.linalg.solve(system, right[..., None])[..., 0], atol=1e-8)
    assert np.allclose(Displacement((tuple(warps),), 1e-9)(points), solved, atol=1e-8)
    # front and back, left and right move the same way in their pictures: sideways that cancels, upwards it adds up
    assert np.allclose(solved - points, [0.0, 0.0, 4.0 * 0.5 / 240], atol=1e-6)


def test_equation_2_by_a_dense_solve_of_the_whole_system():
    sample = views(dome(0.15, (1.2, 1.0, 1.1)), FOUR)
    small = dome(0.14, n_rings=6)
    params = DeformationParams(solves=1)
    points = small.vertices.astype(np.float64)
    warps = []
    for view in sample:
        seen = project(view.camera, points)[:, :2]
        none = np.zeros(len(seen), np.bool_)
        warps.append(make_warp(view.camera, seen, 0.05 * seen, none, points, 2.0, params))
    held = points[:, 2] < 0.01
    solved = _ShapeSolver(small, [view.camera for view in sample], params, held).solve(points, warps)
    laplacian = cotangent_laplacian(small).toarray()
    blocks, right = _projections(warps, points)
    anchor = params.still + params.held * held
    count = len(points)
    system = np.zeros((3 * count, 3 * count))
    for axis in range(3):
        system[axis::3, axis::3] += params.smoothness * laplacian.T @ laplacian + np.diag(anchor)
    for j in range(count):
        system[3 * j : 3 * j + 3, 3 * j : 3 * j + 3] += blocks[j]
    wanted = right + anchor[:, None] * points + params.smoothness * laplacian.T @ (laplacian @ points)
    assert np.allclose(solved, np.linalg.solve(system, wanted.ravel()).reshape(-1, 3), atol=1e-8)


@pytest.mark.parametrize("perspective", [False, True])
def test_a_round_dome_becomes_a_stretched_one(perspective):
    truth = dome(0.15, (1.15, 0.95, 1.1))
    sample = views(truth, perspective=perspective)
    before = [overlap(view, ROUND) for view in sample]
    deformed, displacement = deform_to_masks(ROUND, sample, HEAD)
    after = [overlap(view, deformed) for view in sample]
    # pictures of 240 pixels: half a pixel along the outline is 1 % of the mask
    assert max(before) < 0.84 and min(after) > 0.985
    assert (deformed.triangles == ROUND.triangles).all()
    outer = np.linalg.norm(ROUND.vertices, axis=1) > 0.13
    apart = np.linalg.norm(displacement(ROUND.vertices) - deformed.vertices, axis=1)[outer]
    assert np.median(apart) < 0.003  # the deformation of space lacks only the smoothness term


def test_masks_that_fit_already_change_little():
    deformed, _ = deform_to_masks(ROUND, views(ROUND), HEAD)
    outer = ROUND.vertices[:, 2] > 0.01  # the flat side below is in the head, where no outline passes
    assert np.abs(deformed.vertices - ROUND.vertices)[outer].max() < 0.5 / 240  # a pixel


def test_what_no_view_sees_keeps_its_depth():
    truth = dome(0.15, (1.2, 1.0, 1.0))
    deformed, _ = deform_to_masks(ROUND, views(truth, ("front",)), HEAD)
    moved = np.abs(deformed.vertices - ROUND.vertices)
    assert moved[:, 0].max() > 0.02 and np.median(moved[:, 1]) < 0.002 and moved[:, 1].max() < 0.01


def test_held_vertices_move_less():
    truth = dome(0.15, (1.2, 1.0, 1.1))
    held = ROUND.vertices[:, 0] > 0.1
    free, _ = deform_to_masks(ROUND, views(truth), HEAD)
    tied, _ = deform_to_masks(ROUND, views(truth), HEAD, held=held)
    moves = [np.linalg.norm(mesh.vertices - ROUND.vertices, axis=1)[held].mean() for mesh in (free, tied)]
    assert moves[1] < 0.5 * moves[0]


def test_the_same_bytes_again():
    sample = views(dome(0.15, (1.15, 0.95, 1.1)))
    one, two = (deform_to_masks(ROUND, sample, HEAD)[0].vertices.tobytes() for _ in range(2))
    assert one == two


def test_bad_input():
    with pytest.raises(InputError, match="no view"):
        deform_to_masks(ROUND, [], HEAD)
    empty = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    with pytest.raises(InputError, match="no faces"):
        deform_to_masks(empty, views(ROUND), HEAD)
    for wrong in ({"rounds": -1}, {"solves": 0}, {"smoothness": -1.0}, {"picture_px": 8}, {"outline_points": 3}):
        with pytest.raises(InputError):
            DeformationParams(**wrong)
