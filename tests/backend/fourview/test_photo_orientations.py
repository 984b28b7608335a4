"""Orientation of photos on the surface they show: stripes of a known solid, seen by cameras of both kinds."""

import numpy as np
import pytest
from direction_scenes import degrees_between, ellipsoid_mesh, ellipsoid_texels, level_lines
from hairloom.fourview.photo_orientations import photo_orientations
from hairloom.fourview.regions import axes_of
from hairloom.fourview.views import View
from hairloom.geometry.camera import perspective_camera, rays, standard_camera, unproject
from hairloom.geometry.view_raster import raster_mesh

AXIS = np.array([1.0, 0.2, 0.3]) / np.linalg.norm([1.0, 0.2, 0.3])
WAVELENGTH = 0.003  # metres; 5 to 6 pixels


def photo(name, camera):
    """What a camera sees of the ellipsoid whose colour changes along AXIS alone."""
    mesh = ellipsoid_mesh()
    raster = raster_mesh(camera, mesh.vertices, mesh.triangles)
    mask = np.isfinite(raster.depth)
    rows, columns = np.nonzero(mask)
    points = unproject(camera, np.stack([columns, rows], axis=1) + 0.5, raster.depth[mask])
    image = np.zeros((*mask.shape, 3), np.uint8)
    image[mask] = np.rint(128 + 90 * np.sin(2 * np.pi * (points @ AXIS) / WAVELENGTH))[:, None]
    return View(name, image, mask, camera)


@pytest.fixture(scope="module")
def texels():
    return ellipsoid_texels(72)


CAMERAS = {
    "orthographic": standard_camera("front", (0, 0, 0), 1800, (400, 400)),
    "perspective": perspective_camera((0.1, -0.5, 0.15), (0, 0, 0), 800, (400, 400)),
}


@pytest.mark.parametrize("kind", CAMERAS)
def test_stripes_of_a_photo_are_the_stripes_of_the_surface(texels, kind):
    camera = CAMERAS[kind]
    tensors, weights = photo_orientations(texels, [photo("front", camera)], ellipsoid_mesh())
    sure = weights > 0.05
    assert sure.sum() > 0.05 * texels.n_texels
    axes, _ = axes_of(tensors[sure], texels.normals[sure])
    error = degrees_between(axes, level_lines(texels.normals, AXIS)[sure])
    assert np.median(error) < 2 and np.percentile(error, 95) < 8  # filters are 5.6 degrees apart
    _, towards = rays(camera, np.array([[200.0, 200.0]]))
    behind = texels.normals @ towards[0] > 0.3
    assert not weights[behind].any() and not tensors[behind].any()


def test_photos_add_up_and_nothing_comes_from_none(texels):
    views = [photo(name, standard_camera(name, (0, 0, 0), 1800, (400, 400))) for name in ("front", "left")]
    both = photo_orientations(texels, views, ellipsoid_mesh())
    single = [photo_orientations(texels, [view], ellipsoid_mesh()) for view in views]
    for part in (0, 1):
        assert np.allclose(both[part], single[0][part] + single[1][part], atol=1e-6)
    tensors, weights = photo_orientations(texels, [], ellipsoid_mesh())
    assert not tensors.any() and not weights.any() and tensors.shape == (texels.n_texels, 6)
