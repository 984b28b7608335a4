"""Scalp space and heads on the real characters: scalps from real roots, sensible hemispheres, round trips, signs."""

import numpy as np
import pytest
from hairloom.geometry.head import HeadSurface, find_scalp, read_head
from hairloom.geometry.roots import scatter_roots
from hairloom.geometry.scalp_region import adjacent_triangles, components, weld
from hairloom.geometry.scalp_space import fit_scalp_space
from hairloom.geometry.strands import join_strands
from hairloom.io.mesh import read_mesh_file
from hairloom.io.strands import read_strands
from hairloom.io.units import Units
from hairloom.types import Head

PONYTAIL_UNIT = 0.24 / 70.0  # metres; the head is about 70 units high
SINTEL, PONYTAIL = Units(1.0, "Y"), Units(PONYTAIL_UNIT, "Y", "-Z")
MAKEHUMAN, ICT = Units(0.1, "Y"), Units(0.01, "Y")


@pytest.fixture(scope="module")
def sintel(data_dir):
    strands = read_strands(data_dir / "sintel" / "hair.tfx", units=SINTEL)
    return find_scalp(read_head(data_dir / "sintel" / "head.obj", SINTEL), strands.roots), strands


@pytest.fixture(scope="module")
def ponytail(data_dir):
    parts = ("front_top", "side", "back", "tail")
    strands = join_strands([read_strands(data_dir / "ponytail" / f"{name}.tfx", units=PONYTAIL) for name in parts])
    return find_scalp(read_head(data_dir / "ponytail" / "head.obj", PONYTAIL), strands.roots), strands


@pytest.fixture(scope="module")
def makehuman(data_dir):
    """The body of base.obj with the scalp that its authors marked."""
    path = data_dir / "makehuman" / "base.obj"
    mesh = read_mesh_file(path, MAKEHUMAN, "body")
    marked = np.isin(mesh.vertex_in_file, np.load(data_dir / "makehuman" / "scalp_region.npz")["vert_idx"])
    uv = mesh.corner_uv if mesh.corner_uv is not None else np.zeros((len(mesh.triangles), 3, 2), np.float32)
    return Head(mesh.vertices, mesh.triangles, marked[mesh.triangles].all(axis=1), uv)


@pytest.fixture(scope="module")
def ict(data_dir):
    """The ICT head; its scalp is what lies high and behind the hairline of its skull."""
    head = read_head(data_dir / "ict_facekit" / "head.obj", ICT)
    middles = head.vertices[head.triangles].mean(axis=1)
    skin = components(np.ones(len(middles), np.bool_), adjacent_triangles(weld(head)))
    largest = skin == np.argmax(np.bincount(skin))
    top, front = middles[largest, 2].max(), middles[largest, 1].min()
    scalp = largest & (middles[:, 2] > top - 0.12) & (middles[:, 1] - front > 2.0 * (top - middles[:, 2]))
    return Head(head.vertices, head.triangles, scalp, head.corner_uv)


@pytest.fixture(params=["sintel", "ponytail", "makehuman", "ict"])
def head(request):
    found = request.getfixturevalue(request.param)
    return found[0] if isinstance(found, tuple) else found


@pytest.mark.parametrize("name", ["sintel", "ponytail"])
def test_scalp_from_real_roots(name, request):
    head, strands = request.getfixturevalue(name)
    surface = HeadSurface(head)
    assert components(head.scalp, adjacent_triangles(weld(head))).max() == 0
    closest, triangle, _ = surface.closest_points(strands.roots)
    near = np.linalg.norm(closest - strands.roots, axis=1) < 0.005
    assert head.scalp[triangle[near]].mean() > 0.99
    # a human scalp has 500 to 700 cm^2, these characters' with sideburns and nape a little more
    assert 0.05 < surface.areas[head.scalp].sum() < 0.1
    # the face has none: nothing in front of and below the eyes' height
    middles = head.vertices[head.triangles[head.scalp]].mean(axis=1)
    assert middles[:, 1].min() > strands.roots[near][:, 1].min() - 0.01
    assert middles[:, 2].min() > strands.roots[near][:, 2].min() - 0.01


def test_scalp_does_not_depend_on_the_number_of_roots(sintel):
    head, strands = sintel
    few = find_scalp(head, strands.roots[::10])
    areas = HeadSurface(head).areas
    assert areas[few.scalp ^ head.scalp].sum() < 0.12 * areas[head.scalp].sum()


def test_hemisphere_is_the_skull(head):
    space = fit_scalp_space(head)
    surface = HeadSurface(head)
    assert 0.07 < space.radius < 0.12
    assert surface.signed_distance(space.centre[None])[0] < -0.5 * space.radius
    top = head.vertices[head.triangles[head.scalp]][..., 2].max()
    assert top - space.centre[2] == pytest.approx(space.radius, rel=0.35)
    # symmetric characters: the axes are too
    np.testing.assert_allclose(space.rotation[0], [1, 0, 0], atol=0.1)
    assert np.degrees(np.arccos(space.rotation[1, 2])) < 50
    assert space.rotation[2, 1] < -0.5
    # the heads' shape over the fitted sphere, without the ears, faces and shoulders
    assert space.height.min() > 0.6 and space.height.max() < 1.5
    assert 0.55 < space.polar_scale <= 1.0


def test_all_scalp_vertices_come_to_the_upper_hemisphere(head):
    space = fit_scalp_space(head)
    vertices = head.vertices[np.unique(head.triangles[head.scalp])]
    uv = space.to_scalp(space.world_to_head(vertices))[:, :2].astype(np.float64)
    assert ((1 / np.tan(uv)) ** 2).sum(axis=1).max() <= 1 + 1e-4
    report = space.distortion(uv)
    assert report.area_ratio < 5


def test_round_trip_on_the_scalp_and_around(head):
    """Under 1e-5 of the radius, on the scalp and in the hair volume."""
    space = fit_scalp_space(head)
    surface = HeadSurface(head)
    roots = scatter_roots(head, head.scalp, 2000, 0)
    on_scalp = space.world_to_head(roots.points)
    generator = np.random.default_rng(0)
    normals = space.world_to_head_directions(surface.normals_at(roots.triangles, roots.barycentric))
    above = on_scalp + generator.uniform(-0.1, 3.0, (2000, 1)) * normals + generator.normal(0, 0.3, (2000, 3))
    for points in (on_scalp, above):
        back = space.from_scalp(space.to_scalp(points))
        assert np.linalg.norm(back - points, axis=1).max() < 1e-5
    assert np.percentile(np.abs(space.to_scalp(on_scalp)[:, 2]), 90) < 0.02


@pytest.mark.parametrize("name", ["sintel", "ponytail"])
def test_round_trip_of_all_real_hair(name, request):
    head, strands = request.getfixturevalue(name)
    space = fit_scalp_space(head)
    points = space.world_to_head(strands.points)
    back = space.from_scalp(space.to_scalp(points))
    assert np.linalg.norm(back - points, axis=1).max() < 1e-5


def test_signs(head):
    """Inside and outside by a hair's breadth on either side of the scalp, on open busts too."""
    surface = HeadSurface(head)
    roots = scatter_roots(head, head.scalp, 1000, 1)
    normals = surface.normals_at(roots.triangles, roots.barycentric)
    for offset in (-0.002, 0.002):
        distance = surface.signed_distance(roots.points + offset * normals)
        assert (np.sign(distance) == np.sign(offset)).mean() > 0.99
        assert np.median(distance) == pytest.approx(offset, rel=0.05)
    box = np.stack([head.vertices.min(axis=0) - 0.1, head.vertices.max(axis=0) + 0.1])
    assert (surface.signed_distance(box) > 0).all()


def test_roots_on_a_real_scalp(head):
    roots = scatter_roots(head, head.scalp, 2500, 0)
    assert head.scalp[roots.triangles].all()
    assert roots.report.variation < 0.35 * roots.report.variation_before
