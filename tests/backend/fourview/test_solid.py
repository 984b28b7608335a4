import numpy as np
import pytest
from hairloom.fourview.solid import (
    Voxels,
    head_voxels,
    mesh_voxels,
    scalp_centre,
    signed_distance,
    strand_voxels,
    surface,
    voxels_around,
    without_specks,
)
from hairloom.geometry.head import HeadSurface, default_head, sphere_head
from hairloom.geometry.strands import from_dense
from hairloom.types import Mesh
from radial_hair import HEAD, RADIUS, boundary_edges, radial_strands, volume

CUBE = voxels_around(np.full(3, -0.12), np.full(3, 0.12), 40, 2.0)


def grid(voxels):
    return voxels.points(np.argwhere(np.ones(voxels.shape)).astype(np.float64)).reshape(*voxels.shape, 3)


def ball(voxels, radius=0.1):
    return (radius - np.linalg.norm(grid(voxels), axis=-1)).astype(np.float32)


def test_a_cube_has_its_margin():
    voxels = voxels_around(np.array([0.0, 0.0, 0.0]), np.array([1.0, 0.5, 0.2]), 11, 2.0)
    ends = voxels.indices(np.array([[0.0, 0.25, 0.1], [1.0, 0.25, 0.1]]))
    assert np.allclose(ends, [[2.0, 5.0, 5.0], [8.0, 5.0, 5.0]])
    assert np.allclose(voxels.points(ends), [[0.0, 0.25, 0.1], [1.0, 0.25, 0.1]])


def test_the_surface_of_a_ball_is_closed_and_looks_outwards():
    mesh = surface(ball(CUBE), CUBE)
    assert boundary_edges(mesh.triangles) == 0
    # inscribed triangles of half a voxel's sagitta: a little less than the ball
    assert volume(mesh) == pytest.approx(4.0 / 3.0 * np.pi * 0.1**3, rel=0.01)
    assert np.allclose(np.linalg.norm(mesh.vertices, axis=1), 0.1, atol=0.05 * CUBE.cell)


def test_a_surface_is_closed_at_the_sides_of_the_cube_and_where_the_field_is_0_at_voxels():
    mesh = surface(np.ones(CUBE.shape, np.float32), CUBE)
    assert boundary_edges(mesh.triangles) == 0 and volume(mesh) > 0
    steps = np.rint(ball(CUBE) / CUBE.cell).astype(np.float32)
    stepped = surface(steps, CUBE)
    assert (steps == 0).any() and boundary_edges(stepped.triangles) == 0
    corners = stepped.vertices[stepped.triangles].astype(np.float64)
    assert (np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) > 0).all()


def test_nothing_inside_has_no_surface():
    assert len(surface(np.full(CUBE.shape, -1.0, np.float32), CUBE).triangles) == 0


def test_mesh_voxels_are_those_inside_also_where_meshes_overlap():
    head = sphere_head(0.1, n_rings=48)
    moved = head.vertices + np.array([0.03, 0.0, 0.0], np.float32)
    both = np.concatenate([head.vertices, moved]), np.concatenate([head.triangles, head.triangles + len(moved)])
    inside = mesh_voxels(*both, CUBE)
    places = grid(CUBE)
    away = np.minimum(np.linalg.norm(places, axis=-1), np.linalg.norm(places - [0.03, 0.0, 0.0], axis=-1))
    # the mesh's facets lie up to 0.2 % inside the spheres
    assert inside[away < 0.0995].all() and not inside[away > 0.1].any()


def test_mesh_voxels_of_a_mesh_turned_inside_out_are_none():
    head = sphere_head(0.1, n_rings=16)
    assert not mesh_voxels(head.vertices, head.triangles[:, ::-1], CUBE).any()


def test_mesh_voxels_agree_with_a_mesh_from_the_same_grid():
    field = ball(CUBE)
    mesh = surface(field, CUBE)
    assert ((field > 0) == mesh_voxels(mesh.vertices, mesh.triangles, CUBE)).all()


def test_signed_distance_is_exact_near_the_surface_and_bounded_beyond():
    head = sphere_head(0.08, n_rings=64)
    distance = signed_distance(Mesh(head.vertices, head.triangles), CUBE)
    truth = ball(CUBE, 0.08)
    near = np.abs(truth) < 3.0 * CUBE.cell
    assert np.allclose(distance[near], truth[near], atol=2e-4)  # facets
    assert np.abs(distance).max() <= 3.0 * CUBE.cell + 1e-6
    assert (np.sign(distance) == np.sign(truth))[np.abs(truth) > 2e-4].all()


def test_strand_voxels_have_no_gaps():
    strands = from_dense(np.array([[[-0.1, -0.1, -0.1], [0.1, 0.1, 0.1]], [[0.05, 0.0, 0.0], [0.05, 0.0, 0.0]]]))
    filled = np.argwhere(strand_voxels(strands, CUBE))
    diagonal = filled[(filled[:, 0] == filled[:, 1]) & (filled[:, 1] == filled[:, 2])]
    first, last = CUBE.indices(np.array([[-0.1] * 3, [0.1] * 3])).round().astype(int)
    assert (np.diff(diagonal[:, 0]) == 1).all()
    assert (diagonal[0] == first).all() and (diagonal[-1] == last).all()
    assert len(filled) > len(diagonal)  # the strand of no length too


def test_strands_outside_the_cube_are_left_out():
    assert not strand_voxels(radial_strands(20, 0.01), Voxels(np.full(3, 5.0), 0.01, 10)).any()


def test_head_voxels_close_the_neck():
    head = default_head()
    voxels = voxels_around(head.vertices.min(axis=0), head.vertices.max(axis=0), 24, 2.0)
    inside = head_voxels(head, voxels)
    places = grid(voxels).reshape(-1, 3)
    distance = HeadSurface(head).signed_distance(places).reshape(voxels.shape)
    clear = np.abs(distance) > 0.002  # the two count the fan below the neck a little differently
    assert (inside == (distance < 0))[clear].mean() > 0.999


def test_specks_go_and_large_parts_stay():
    field = np.full(CUBE.shape, -1.0, np.float32)
    field[5:20, 5:20, 5:20] = 1.0
    field[25:35, 25:35, 25:35] = 1.0
    field[38, 38, 38] = 1.0
    cleaned = without_specks(field)
    assert (
        cleaned[38, 38, 38] < 0 and (cleaned[5:20, 5:20, 5:20] > 0).all() and (cleaned[25:35, 25:35, 25:35] > 0).all()
    )


def test_the_scalp_centre_is_the_balls():
    assert np.allclose(scalp_centre(HEAD), 0.0, atol=0.01 * RADIUS)
