"""The z-buffer of meshes against embree's rays, what points a view sees, and equal bits for any number of threads."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from hairloom.geometry.camera import orthographic_camera, perspective_camera, rays, towards, unproject
from hairloom.geometry.head import HeadSurface, sphere_head
from hairloom.geometry.view_raster import raster_mesh, visible
from hairloom.types import Camera, Head

CENTRE = np.array([0.3, -0.2, 1.6])
CAMERAS = {
    "orthographic": orthographic_camera((0.2, 1.0, -0.3), CENTRE, 700.0, (200, 160)),
    "perspective": perspective_camera(CENTRE + np.array([0.1, -0.6, 0.2]), CENTRE, 420.0, (200, 160)),
}


@pytest.fixture(scope="module")
def sphere() -> Head:
    return sphere_head(0.1, CENTRE, n_rings=24)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_agrees_with_rays_through_the_pixel_middles(sphere: Head, camera: Camera) -> None:
    raster = raster_mesh(camera, sphere.vertices, sphere.triangles)
    row, column = np.mgrid[:160, :200]
    origins, directions = rays(camera, np.stack([column.ravel() + 0.5, row.ravel() + 0.5], axis=1))
    distance, triangle = HeadSurface(sphere).first_hits(origins, directions)
    # float32 knows depths of 2 m to 1e-7 m, and embree less where a ray grazes the surface: 2e-5
    same = raster.triangle.ravel() == triangle
    assert 0.2 < (triangle >= 0).mean() < 0.8
    # rays and edges round differently where a ray passes within float32's reach (1e-6) of an edge
    assert same.mean() > 0.998
    hit = same & (triangle >= 0)
    along = directions @ camera.world_to_camera[2, :3]
    np.testing.assert_allclose(raster.depth.ravel()[hit], (distance * along)[hit], atol=2e-5)
    places = np.stack([column.ravel() + 0.5, row.ravel() + 0.5], axis=1)[hit]
    points = unproject(camera, places, raster.depth.ravel()[hit])
    corners = sphere.vertices[sphere.triangles[triangle[hit]]]
    interpolated = np.einsum("nk,nkc->nc", raster.barycentric.reshape(-1, 3)[hit], corners)
    np.testing.assert_allclose(interpolated, points, atol=5e-6)
    assert np.isinf(raster.depth[raster.triangle < 0]).all()


def test_neither_order_nor_threads_change_anything(sphere: Head) -> None:
    camera = CAMERAS["perspective"]
    first = raster_mesh(camera, sphere.vertices, sphere.triangles)
    order = np.random.default_rng(0).permutation(len(sphere.triangles))
    shuffled = raster_mesh(camera, sphere.vertices, sphere.triangles[order])
    # the middle of a pixel on a common edge is as deep on either side, up to the last bit
    np.testing.assert_allclose(shuffled.depth, first.depth, rtol=1e-6)
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = raster_mesh(camera, sphere.vertices, sphere.triangles)
    finally:
        numba.set_num_threads(threads)
    for name in ("triangle", "depth", "barycentric"):
        assert getattr(alone, name).tobytes() == getattr(first, name).tobytes()


def test_closed_surfaces_have_no_pinholes() -> None:
    """Pixel middles exactly on edges and corners of a fan belong to a triangle."""
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0, 0.1], [0, 0, 0.1], [0.05, 0, 0.05]], np.float32)
    triangles = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]], np.int32)
    camera = orthographic_camera((0, 1, 0), (0.05, 0.0, 0.05), 200.0, (21, 21))
    assert np.count_nonzero(raster_mesh(camera, corners, triangles).triangle >= 0) in (20 * 20, 21 * 21)
    assert (raster_mesh(camera, corners, triangles).triangle[1:-1, 1:-1] >= 0).all()


def test_triangles_behind_a_perspective_camera_are_left_out() -> None:
    camera = perspective_camera((0, 0, 0), (0, 1, 0), 100.0, (50, 50))
    behind = np.array([[-1, -1, -1], [1, -1, -1], [0, -1, 1]], np.float32)
    assert (raster_mesh(camera, behind, np.array([[0, 1, 2]], np.int32)).triangle == -1).all()


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_a_view_sees_the_near_side_of_a_sphere(sphere: Head, camera: Camera) -> None:
    raster = raster_mesh(camera, sphere.vertices, sphere.triangles)
    normals = HeadSurface(sphere).normals
    facing = np.einsum("nc,nc->n", normals, towards(camera, sphere.vertices))
    seen = visible(sphere.vertices, raster, camera, 0.0005)
    assert seen[facing > 0.3].all()
    # the outline is known to a pixel, 1.4 mm: on this sphere that is up to 0.17 around it, and its facets are coarse
    assert not seen[facing < -0.3].any()
    assert not visible(CENTRE[None] + 5.0, raster, camera, 0.0005).any()  # beyond the picture
    in_front = CENTRE[None] + 0.2 * towards(camera, CENTRE[None])
    assert visible(in_front, raster, camera, 0.0).all()
