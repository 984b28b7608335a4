"""The head's mesh: rays, closest points, signs of open busts, scalps found from roots, files."""

import numpy as np
import pytest
from hairloom.errors import FileError, InputError
from hairloom.geometry.head import (
    HeadSurface,
    default_head,
    find_scalp,
    pack_triangles,
    read_head,
    sphere_head,
    submesh,
    unwrap,
)
from hairloom.geometry.scalp_region import adjacent_triangles, components, weld
from hairloom.types import Head


@pytest.fixture(scope="module")
def sphere():
    return sphere_head(0.1, (0.3, -0.2, 1.6))


@pytest.fixture(scope="module")
def surface(sphere):
    return HeadSurface(sphere)


CENTRE = np.array([0.3, -0.2, 1.6])
# a ring of the polyhedron lies at most this far under the sphere of 0.1 m with 64 rings: R (1 - cos(pi / 128)^2)
SAG = 1.3e-4


def _shell(count=500, seed=0):
    """Random unit directions."""
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_sphere_head_is_closed_and_faces_outwards(sphere, surface):
    middles = sphere.vertices[sphere.triangles].mean(axis=1) - CENTRE
    assert (np.einsum("fc,fc->f", middles, surface.face_normals) > 0).all()
    assert len(adjacent_triangles(weld(sphere))) == 1.5 * len(sphere.triangles)
    assert surface.areas.sum() == pytest.approx(4 * np.pi * 0.01, rel=2e-3)
    assert sphere.scalp.mean() == 0.5
    assert (middles[sphere.scalp, 2] > 0).all()


def test_first_hits(surface):
    directions = _shell()
    distance, triangle = surface.first_hits(np.broadcast_to(CENTRE, directions.shape), directions)
    assert (triangle >= 0).all()
    np.testing.assert_allclose(distance, 0.1, atol=SAG)
    away = CENTRE + 0.2 * directions
    missed, none = surface.first_hits(away, directions)
    assert np.isinf(missed).all() and (none == -1).all()
    # distances count in lengths of the direction
    half, _ = surface.first_hits(away, -2.0 * directions)
    np.testing.assert_allclose(half, 0.05, atol=SAG)


def test_closest_points(surface):
    directions = _shell()
    closest, triangle, barycentric = surface.closest_points(CENTRE + 0.15 * directions)
    np.testing.assert_allclose(closest, CENTRE + 0.1 * directions, atol=2e-3)
    np.testing.assert_allclose(np.linalg.norm(closest - CENTRE, axis=1), 0.1, atol=SAG)
    assert (barycentric >= 0).all()
    np.testing.assert_allclose(barycentric.sum(axis=1), 1.0, atol=1e-6)
    # metres in float32 around 1.6 m
    np.testing.assert_allclose(surface.points_at(triangle, barycentric), closest, atol=1e-6)
    # the smooth normals of a sphere are its radii; 64 rings make them 1e-3 right
    radii = (closest - CENTRE) / 0.1
    np.testing.assert_allclose(surface.normals_at(triangle, barycentric), radii, atol=5e-3)


def test_signed_distance_of_a_closed_head(surface):
    generator = np.random.default_rng(1)
    points = CENTRE + generator.uniform(0.0, 0.2, (400, 1)) * _shell(400, 1)
    expected = np.linalg.norm(points - CENTRE, axis=1) - 0.1
    np.testing.assert_allclose(surface.signed_distance(points), expected, atol=SAG)


def test_signed_distance_of_an_open_bust(sphere):
    """Without its lower third, the sphere is closed by a flat lid: inside above the lid, outside below it."""
    kept = sphere.vertices[sphere.triangles][..., 2].min(axis=1) > CENTRE[2] - 0.04
    bust = HeadSurface(submesh(sphere, kept))
    generator = np.random.default_rng(2)
    points = CENTRE + generator.uniform(-0.12, 0.12, (4000, 3))
    lid = sphere.vertices[sphere.triangles[kept]][..., 2].min()
    inside = (np.linalg.norm(points - CENTRE, axis=1) < 0.1) & (points[:, 2] > lid)
    margin = np.minimum(abs(np.linalg.norm(points - CENTRE, axis=1) - 0.1), abs(points[:, 2] - lid))
    clear = margin > 2 * SAG
    assert ((bust.signed_distance(points) < 0)[clear] == inside[clear]).all()


def test_parts_inside_one_another_stay_inside(sphere):
    """An eyeball inside the head does not make a hole."""
    eye = sphere_head(0.02, tuple(CENTRE + np.array([0.05, 0, 0])), n_rings=16)
    count = len(sphere.vertices)
    both = Head(
        np.vstack([sphere.vertices, eye.vertices]),
        np.vstack([sphere.triangles, eye.triangles + count]).astype(np.int32),
        np.concatenate([sphere.scalp, np.zeros_like(eye.scalp)]),
        np.concatenate([sphere.corner_uv, eye.corner_uv]),
    )
    surface = HeadSurface(both)
    assert (surface.signed_distance(CENTRE + np.array([[0.05, 0, 0], [0.08, 0, 0], [0.0, 0, 0]])) < 0).all()
    assert (surface.signed_distance(CENTRE + np.array([[0.12, 0, 0], [0, 0, -0.2]])) > 0).all()


def test_seams_do_not_break_normals(sphere):
    """Every triangle with vertices of its own, as some files have them: the same normals and the same sign."""
    count = len(sphere.triangles)
    apart = Head(
        sphere.vertices[sphere.triangles].reshape(-1, 3),
        np.arange(3 * count, dtype=np.int32).reshape(count, 3),
        sphere.scalp,
        sphere.corner_uv,
    )
    surface, whole = HeadSurface(apart), HeadSurface(sphere)
    triangle = np.arange(0, count, 7, dtype=np.int32)
    middle = np.full((len(triangle), 3), 1 / 3)
    np.testing.assert_allclose(surface.normals_at(triangle, middle), whole.normals_at(triangle, middle), atol=1e-6)
    assert surface.signed_distance(CENTRE[None])[0] < 0


def test_uv_at_interpolates(sphere, surface):
    triangle = np.array([5, 100, 9000], np.int32)
    corners = np.eye(3)
    for corner in range(3):
        at = surface.uv_at(triangle, np.tile(corners[corner], (3, 1)))
        np.testing.assert_array_equal(at, sphere.corner_uv[triangle, corner])


def _roots_on_cap(sphere, count, polar_deg, seed=0):
    directions = _shell(count * 40, seed)
    chosen = directions[directions[:, 2] > np.cos(np.radians(polar_deg))][:count]
    return CENTRE + 0.1 * chosen


@pytest.mark.parametrize(("n_rings", "count"), [(12, 4000), (64, 300), (64, 20000), (200, 1500)])
def test_find_scalp_on_coarse_and_fine_meshes(n_rings, count):
    """A cap of roots of 60 degrees is found as one piece whose border is right to the root spacing or a triangle."""
    head = sphere_head(0.1, tuple(CENTRE), n_rings=n_rings)
    roots = _roots_on_cap(head, count, 60.0)
    found = find_scalp(head, roots)
    assert components(found.scalp, adjacent_triangles(weld(head))).max() == 0
    middles = head.vertices[head.triangles].mean(axis=1) - CENTRE
    polar = np.degrees(np.arccos(np.clip(middles[:, 2] / np.linalg.norm(middles, axis=1), -1, 1)))
    spacing = np.degrees(np.sqrt(np.pi / count))  # of the cap of 2 pi (1 - cos 60) = pi steradians
    slack = 3.0 * spacing + 180.0 / n_rings
    assert found.scalp[polar < 60.0 - slack].all()
    assert not found.scalp[polar > 60.0 + slack].any()
    surface = HeadSurface(found)
    assert surface.areas[found.scalp].sum() == pytest.approx(np.pi * 0.01, rel=0.25)


def test_find_scalp_closes_partings_and_drops_strays(sphere):
    roots = _roots_on_cap(sphere, 8000, 60.0)
    parted = roots[np.abs(roots[:, 0] - CENTRE[0]) > 0.002]
    stray = CENTRE + 0.1 * np.array([[0, 0, -1.0], [0.1, 0, -0.995]])
    air = CENTRE + np.array([[0.0, 0.0, 0.25]])
    found = find_scalp(sphere, np.vstack([parted, stray, air]))
    whole = find_scalp(sphere, roots)
    pieces = components(found.scalp, adjacent_triangles(weld(sphere)))
    assert pieces.max() == 0
    assert (found.scalp != whole.scalp).mean() < 0.01
    middles = sphere.vertices[sphere.triangles].mean(axis=1) - CENTRE
    assert not found.scalp[middles[:, 2] < 0].any()


def test_find_scalp_refuses_hair_elsewhere(sphere):
    roots = _roots_on_cap(sphere, 500, 60.0)
    with pytest.raises(InputError, match="units"):
        find_scalp(sphere, 100.0 * roots)
    with pytest.raises(InputError, match="no hair"):
        find_scalp(sphere, np.empty((0, 3)))


def test_few_roots(sphere):
    assert find_scalp(sphere, CENTRE + 0.1 * np.array([[0, 0, 1.0]])).scalp.any()
    assert find_scalp(sphere, CENTRE + 0.1 * np.array([[0, 0, 1.0], [0.05, 0, 1.0]])).scalp.any()


def test_default_head_is_a_head():
    head = default_head()
    surface = HeadSurface(head)
    size = np.ptp(head.vertices, axis=0)
    assert 0.15 < size[0] < 0.2 and 0.2 < size[1] < 0.26 and 0.28 < size[2] < 0.34
    assert head.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-3)
    # closed, one scalp, of human size (the literature has 500 to 700 cm^2), above the chin and mostly behind the face
    welded = weld(head)
    assert len(adjacent_triangles(welded)) == 1.5 * len(head.triangles)
    assert components(head.scalp, adjacent_triangles(welded)).max() == 0
    assert 0.045 < surface.areas[head.scalp].sum() < 0.075
    assert surface.signed_distance(np.array([[0, 0, 0.2], [0, 0, 0.35]]))[0] < 0
    mirrored = head.vertices * np.float32([-1, 1, 1])
    assert {tuple(v) for v in mirrored.tolist()} == {tuple((v + 0.0).tolist()) for v in head.vertices}
    # the nose is the foremost point, on the middle plane
    assert abs(head.vertices[head.vertices[:, 1].argmin(), 0]) < 1e-6


def _areas(uv):
    """Signed areas of triangles (F, 3, 2)."""
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    return 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def test_default_head_uv_is_one_to_one():
    """No triangle is flipped, and together they cover what they cover once: areas sum to at most the unit square."""
    uv = default_head().corner_uv.astype(np.float64)
    areas = _areas(uv)
    assert (areas > 0).all()
    assert uv.min() >= 0 and uv.max() <= 1
    grid = np.zeros((1024, 1024), np.int32)
    for triangle in uv:
        low, high = np.floor(triangle.min(axis=0) * 1024).astype(int), np.ceil(triangle.max(axis=0) * 1024).astype(int)
        x, y = np.meshgrid((np.arange(low[0], high[0]) + 0.5) / 1024, (np.arange(low[1], high[1]) + 0.5) / 1024)
        a, b = triangle[1] - triangle[0], triangle[2] - triangle[0]
        p, q = x - triangle[0, 0], y - triangle[0, 1]
        determinant = a[0] * b[1] - a[1] * b[0]
        s, t = (p * b[1] - q * b[0]) / determinant, (a[0] * q - a[1] * p) / determinant
        grid[low[1] : high[1], low[0] : high[0]] += (s > 0) & (t > 0) & (s + t < 1)
    assert grid.max() == 1


def test_pack_triangles_has_no_overlap():
    uv = pack_triangles(101).astype(np.float64)
    assert uv.min() >= 0 and uv.max() <= 1
    areas = _areas(uv)
    assert (areas > 0).all()
    # each pair of a cell lies on its own side of the diagonal, cells are apart
    cells = np.floor(uv.mean(axis=1) * 8).astype(int)
    assert len(np.unique(cells, axis=0)) == 51
    np.testing.assert_array_equal(np.floor(uv * 8).astype(int), np.repeat(cells[:, None], 3, axis=1))


def test_unwrap_covers_every_triangle():
    head = sphere_head(n_rings=8)
    uv = unwrap(head.vertices, head.triangles)
    assert uv.shape == head.corner_uv.shape and uv.min() >= 0 and uv.max() <= 1
    areas = np.abs(_areas(uv))
    assert (areas > 0).all()
    assert areas.sum() <= 1.0


def test_read_head(tmp_path):
    path = tmp_path / "head.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    head = read_head(path)
    assert len(head.triangles) == 4 and not head.scalp.any()
    assert HeadSurface(head).signed_distance(head.vertices.mean(axis=0)[None])[0] < 0
    with pytest.raises(FileError):
        read_head(tmp_path / "missing.obj")
