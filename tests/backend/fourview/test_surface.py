"""The hair surface: atlas, texels, links over seams, vertices, scan order, patches (Z-8 ... Z-11, Z-17, M-34)."""

import numpy as np
import pytest
from hair_shapes import RADII, ellipsoid, hair_shape
from hairloom.errors import Cancelled, InputError
from hairloom.fourview.atlas import make_atlas
from hairloom.fourview.remeshing import remesh, vertex_areas
from hairloom.fourview.surface import SurfaceParams, _central_texels, make_surface, scan_order, tangent_frames
from hairloom.types import Mesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

PARAMS = SurfaceParams(texture_size=512, n_scales=3, atlas_vertices=600)


@pytest.fixture(scope="module")
def shape():
    return hair_shape()[0]


@pytest.fixture(scope="module")
def surface(shape):
    return make_surface(shape, PARAMS)


@pytest.fixture(scope="module")
def round_surface():
    """A closed smooth shape whose geometry is known; vertices a third of a patch apart."""
    return make_surface(ellipsoid(64), SurfaceParams(512, 2, atlas_vertices=1500, vertex_spacing=1 / 3))


def test_levels(surface, shape):
    assert [level.texels.size for level in surface.levels] == [128, 256, 512]
    area = vertex_areas(shape.vertices, shape.triangles).sum()
    for level in surface.levels:
        texels = level.texels
        # half the texture or more is used
        assert texels.n_texels > 0.5 * texels.size**2
        assert level.n_vertices == pytest.approx(texels.n_texels / 25, rel=0.01)
        assert texels.n_texels * texels.spacing**2 == pytest.approx(area, rel=0.05)
        assert level.patch_size == 10
        np.testing.assert_allclose(np.linalg.norm(texels.normals, axis=1), 1, atol=1e-5)
        # the texels' places, put together again from their triangles
        corners = surface.mesh.vertices[surface.mesh.triangles[texels.triangle]]
        np.testing.assert_allclose((corners * texels.barycentric[..., None]).sum(axis=1), texels.points, atol=1e-6)
        uv = (surface.corner_uv[texels.triangle] * texels.barycentric[..., None]).sum(axis=1) * texels.size
        np.testing.assert_allclose(uv[:, 0], texels.texels % texels.size + 0.5, atol=0.02)
        np.testing.assert_allclose(uv[:, 1], texels.texels // texels.size + 0.5, atol=0.02)
        assert np.array_equal(texels.grid().ravel()[texels.texels], np.arange(texels.n_texels))


def test_charts_do_not_overlap_and_are_nearly_conformal(shape):
    mesh = remesh(shape, 600)
    corner_uv, charts = make_atlas(mesh, 2 / 512)
    assert corner_uv.min() >= 0 and corner_uv.max() <= 1 and charts.max() >= 1
    drawn = np.zeros((512, 512), np.int32)
    grid = (np.arange(512) + 0.5) / 512
    for (a, b, c), _ in zip(corner_uv.astype(float), charts):
        columns = slice(*np.searchsorted(grid, [min(a[0], b[0], c[0]), max(a[0], b[0], c[0])]))
        rows = slice(*np.searchsorted(grid, [min(a[1], b[1], c[1]), max(a[1], b[1], c[1])]))
        x, y = grid[None, columns], grid[rows, None]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        u = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area
        v = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area
        drawn[rows, columns] += (u > 1e-9) & (v > 1e-9) & (u + v < 1 - 1e-9)
    assert drawn.max() == 1
    lengths = np.linalg.norm(mesh.vertices[mesh.triangles] - mesh.vertices[mesh.triangles[:, [1, 2, 0]]], axis=2)
    flat = np.linalg.norm(corner_uv - corner_uv[:, [1, 2, 0]], axis=2)
    scale = flat / lengths / np.median(flat / lengths)
    # xatlas allows a stretch of about a third before it cuts
    assert np.percentile(np.abs(np.log(scale)), 95) < 0.35


def test_edges(surface):
    for level in surface.levels:
        texels, edges = level.texels, level.texels.edges
        assert (edges[:, 0] < edges[:, 1]).all()
        assert (np.diff(edges[:, 0].astype(np.int64) * texels.n_texels + edges[:, 1]) > 0).all()
        degree = np.bincount(edges.ravel(), minlength=texels.n_texels)
        # fewer than four only at the open boundary, at the coarsest scale 3 % of the texels
        assert degree.max() <= 4 and (degree == 4).mean() > 0.95
        lengths = np.linalg.norm(texels.points[edges[:, 0]] - texels.points[edges[:, 1]], axis=1)
        assert np.median(lengths) == pytest.approx(texels.spacing, rel=0.02) and lengths.max() < 4 * texels.spacing


def test_seams_are_closed_by_edges(surface):
    """Without the edges across seams the charts fall apart; texels at seams without such an edge are few."""
    texels = surface.levels[-1].texels
    edges, count = texels.edges, texels.n_texels
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    assert connected_components(graph, directed=False)[0] == 1
    rows, columns = texels.texels // texels.size, texels.texels % texels.size
    apart = np.abs(rows[edges[:, 0]] - rows[edges[:, 1]]) + np.abs(columns[edges[:, 0]] - columns[edges[:, 1]])
    inside = edges[apart == 1]
    assert (apart > 1).sum() > 500
    graph = coo_array((np.ones(len(inside)), (inside[:, 0], inside[:, 1])), shape=(count, count))
    assert connected_components(graph, directed=False)[0] > 1
    seam = np.unique(edges[apart > 1])
    # along a seam every texel at the border of its chart is linked to the other side, but at corners
    inner_degree = np.bincount(inside.ravel(), minlength=count)
    border = np.flatnonzero(inner_degree < 4)
    alone = border[~np.isin(border, seam)]
    rim = np.unique(surface.mesh.triangles[_rim_triangles(surface.mesh)])
    distance, _ = cKDTree(surface.mesh.vertices[rim]).query(texels.points[alone])
    # what has no link across is at the open boundary, up to 5 % of the borders
    assert (distance > 0.006).sum() < 0.05 * len(border)


def _rim_triangles(mesh):
    directed = np.concatenate([mesh.triangles[:, [0, 1]], mesh.triangles[:, [1, 2]], mesh.triangles[:, [2, 0]]])
    forward = directed[:, 0].astype(np.int64) << 32 | directed[:, 1]
    backward = directed[:, 1].astype(np.int64) << 32 | directed[:, 0]
    alone = ~np.isin(forward, backward)
    return alone.reshape(3, -1).any(axis=0)


def test_frames():
    normals = np.float32([[0, -1, 0], [0.6, 0, 0.8], [0, 0, 1], [0, 0, -1], [-0.48, 0.64, 0.6]])
    tangents, bitangents = tangent_frames(normals)
    np.testing.assert_allclose(np.cross(tangents, bitangents), normals, atol=1e-6)
    np.testing.assert_allclose(tangents[0], np.cross([0, -1, 0], [0, 0, 1]), atol=1e-6)
    assert (bitangents[[0, 1, 4], 2] < 0).all()  # downwards
    np.testing.assert_allclose(tangents[:, 2], 0, atol=1e-6)


def test_one_rings_are_counter_clockwise_and_mutual(surface):
    level = surface.levels[-1]
    offsets, neighbours = level.neighbour_offsets, level.neighbours
    valence = np.diff(offsets)
    assert 5.7 < valence.mean() < 6.0 and valence.min() >= 2  # six, but at the boundary
    owner = np.repeat(np.arange(level.n_vertices), valence)
    assert set(zip(owner.tolist(), neighbours.tolist())) == set(zip(neighbours.tolist(), owner.tolist()))
    turn = 0
    for vertex in np.random.default_rng(0).choice(level.n_vertices, 200, replace=False):
        ring = level.vertices[neighbours[offsets[vertex] : offsets[vertex + 1]]] - level.vertices[vertex]
        around = np.einsum("nc,c->n", np.cross(ring, np.roll(ring, -1, axis=0)), level.normals[vertex])
        turn += (around > 0).sum() - (around < 0).sum()
        assert (around < 0).sum() <= 1  # at the boundary one step leads back
    assert turn > 0


def test_scan_order_goes_in_rings_from_the_top(surface):
    level = surface.levels[0]
    order, offsets, neighbours = level.order, level.neighbour_offsets, level.neighbours
    assert np.array_equal(np.sort(order), np.arange(level.n_vertices))
    assert order[0] == level.vertices[:, 2].argmax()
    ring = np.full(level.n_vertices, -1)
    ring[order[0]] = 0
    queue = [order[0]]
    for vertex in queue:
        for other in neighbours[offsets[vertex] : offsets[vertex + 1]]:
            if ring[other] < 0:
                ring[other] = ring[vertex] + 1
                queue.append(other)
    assert (np.diff(ring[order]) >= 0).all()
    middle = level.vertices[order[0]]
    for number in (2, 3):  # rings near the top, where the angle seen from above is the way around
        places = level.vertices[order[ring[order] == number]] - middle
        angle = np.unwrap(np.arctan2(places[:, 1], places[:, 0]))
        assert angle[-1] - angle[0] > np.pi  # counter-clockwise, nearly all around
        assert (np.diff(angle) > 0).mean() > 0.8


def test_scan_order_of_two_parts():
    vertices = np.float32([[0, 0, 1], [0, 0, 0], [0, 0, 5], [0, 0, 4]])
    order = scan_order(vertices, np.int32([0, 1, 2, 3, 4]), np.int32([1, 0, 3, 2]))
    assert order.tolist() == [2, 3, 0, 1]


def test_patches_lie_on_the_tangent_plane_along_the_normal(round_surface):
    """On a known smooth shape: each element's texel is where the normal through the plane's point meets the surface."""
    level = round_surface.levels[-1]
    texels, m, spacing = level.texels, level.patch_size, level.texels.spacing
    # patches of 10 texels of 1 mm do not reach a fold, and there is no boundary
    assert (level.patch_texels >= 0).mean() > 0.9999
    places = (np.arange(m) - (m - 1) / 2) * spacing
    b, a = np.meshgrid(places, places, indexing="ij")
    planes = level.vertices[:, None] + (
        a.ravel()[:, None] * level.tangents[:, None] + b.ravel()[:, None] * level.bitangents[:, None]
    )
    found = texels.points[level.patch_texels]
    off = found - planes
    along = np.einsum("vec,vc->ve", off, level.normals)
    sideways = np.linalg.norm(off - along[..., None] * level.normals[:, None], axis=2)
    # the nearest texel is at most half a diagonal away, in charts that stretch by up to a third
    assert np.percentile(sideways, 99.9) < 1.0 * spacing and np.median(sideways) < 0.45 * spacing
    assert (along < 0.3 * spacing).all()  # the ellipsoid falls away from its tangent plane
    assert np.abs(np.linalg.norm(found / RADII, axis=2) - 1).max() < 0.01


def test_patches_cover_the_texels(surface):
    for level in surface.levels:
        valid = level.patch_texels >= 0
        count = np.bincount(level.patch_texels[valid], minlength=level.texels.n_texels)
        assert 3.5 < count.mean() < 4.1  # vertices half a patch apart: four patches at each texel
        assert (count == 0).mean() < 0.005
        # only patches at the rim or at a fold have missing elements
        assert valid.mean() > 0.95


def test_what_lies_beyond_the_boundary_is_missing(surface):
    level = surface.levels[-1]
    centres = level.vertices[(level.patch_texels < 0).any(axis=1)]
    rim = surface.mesh.vertices[np.unique(surface.mesh.triangles[_rim_triangles(surface.mesh)])]
    distance, _ = cKDTree(rim).query(centres)
    reach = 0.75 * level.patch_size * level.texels.spacing
    assert (distance < reach + 0.004).all() and len(centres) > 50


def test_the_same_bytes_again(shape, surface):
    again = make_surface(shape, PARAMS)
    for one, other in zip(surface.levels, again.levels):
        for name in ("vertices", "neighbours", "order", "patch_texels"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
        assert one.texels.points.tobytes() == other.texels.points.tobytes()
        assert one.texels.edges.tobytes() == other.texels.edges.tobytes()


def test_bad_input_and_cancel(shape):
    with pytest.raises(InputError, match="no triangles"):
        make_surface(Mesh(shape.vertices, np.empty((0, 3), np.int32)))
    with pytest.raises(InputError, match="metres"):
        make_surface(Mesh(shape.vertices * np.float32(1e-5), shape.triangles))

    def stop(fraction, message):
        raise Cancelled("stopped")

    with pytest.raises(Cancelled):
        make_surface(shape, PARAMS, progress=stop)


@pytest.mark.parametrize(
    "bad",
    [
        {"n_scales": 0},
        {"texture_size": 300, "n_scales": 4},
        {"texture_size": 2047},
        {"patch_size": 2},
        {"vertex_spacing": 0.0},
        {"atlas_vertices": 10},
        {"subdivisions": -1},
        {"gutter": 0},
    ],
)
def test_bad_params(bad):
    with pytest.raises(InputError):
        SurfaceParams(**bad)


def test_a_cluster_of_slivers_has_a_middle_too():
    points = np.float32([[0, 0, 0], [1, 0, 0], [2, 0, 0], [5, 0, 0], [6, 0, 0], [7, 0, 0]])
    found = _central_texels(points, np.float32([1, 1, 1, 0, 0, 0]), np.int32([0, 0, 0, 1, 1, 1]))
    assert found.tolist() == [1, 4]
