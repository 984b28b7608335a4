from dataclasses import replace

import numba
import numpy as np
import pytest
from cylinder_surface import PIXELS_PER_METRE, look, make_level, make_surface, make_view, stripes
from hairloom.errors import InputError
from hairloom.fourview import texture as texture_module
from hairloom.fourview._patch_kernels import patch_distance, turned
from hairloom.fourview._voting_kernels import patches_of_texels
from hairloom.fourview.patch_search import start_matches, turns
from hairloom.fourview.patch_sources import sources_at, surface_in_photo
from hairloom.fourview.texture import (
    HairTexture,
    SurfaceTextureParams,
    blend_weights,
    kept_texels,
    packed,
    synthesize_texture,
)
from hairloom.geometry.camera import project

SIZES = (128, 256)
QUICK = SurfaceTextureParams(iterations=(8, 4))


def coarse_stripes(theta, z):
    return stripes(theta, z, period=0.03)


@pytest.fixture
def analytic(monkeypatch):
    """What views see of the cylinder in closed form, since its mesh is no more than a triangle."""

    def use(views):
        monkeypatch.setattr(texture_module, "project_views", lambda texels, _views, _shape: look_at(texels, views))

    return use


def look_at(texels, views):
    class OfTexels:
        pass

    level = OfTexels()
    level.texels = texels
    return look(level, views)


def synthesize(surface, views, params, analytic, **more):
    analytic(views)
    return synthesize_texture(surface, surface.mesh, views, params, **more)


def truth_of(texels, pattern):
    theta = np.arctan2(texels.points[:, 1], texels.points[:, 0])
    return pattern(theta, texels.points[:, 2].astype(np.float64))


def slope_error(texels, colour, chosen):
    """Median angle (degrees) between the stripes that a texture has and those of the pattern, from its gradients."""
    grid = texels.grid()
    red = np.where(grid >= 0, colour[grid, 0], np.nan)
    down, across = np.gradient(red)
    strong = (grid >= 0) & np.isfinite(down) & np.isfinite(across)
    strong[strong] &= chosen[grid[strong]]
    strong &= np.hypot(np.nan_to_num(down), np.nan_to_num(across)) > 0.05
    # columns run against theta, rows against z: phase grows by slope * (R theta) + z
    angle = np.degrees(np.arctan(down[strong] / across[strong])) - 45
    return float(np.median(np.abs((angle + 90) % 180 - 90)))


def test_the_back_gets_the_stripes_of_the_front(analytic):
    surface, views = make_surface(SIZES), [make_view("front", coarse_stripes)]
    result = synthesize(surface, views, QUICK, analytic)
    texels = surface.levels[-1].texels
    seen = look(surface.levels[-1], views)
    # where the photo sees the surface well its colours stay, but for the resampling of photo and screened Poisson
    known = seen.seen[0]
    assert np.sqrt(((result.colour - truth_of(texels, coarse_stripes))[known] ** 2).mean()) < 0.08
    hidden = ~seen.visible[0]
    assert hidden.mean() > 0.4
    # a texture that only went on from the border would have no slope; free stripes would be wrong by 45 on average
    assert slope_error(texels, result.colour, hidden) < 15
    assert 0.6 < result.colour[hidden].std() / truth_of(texels, coarse_stripes).std() < 1.2
    assert (result.coverage[hidden] == 0).all() and (result.coverage[known] > 0.7).all()


def test_four_views_of_one_pattern_give_the_pattern(analytic):
    surface = make_surface(SIZES)
    views = [make_view(name, coarse_stripes) for name in ("front", "left", "back", "right")]
    result = synthesize(surface, views, QUICK, analytic)
    error = result.colour - truth_of(surface.levels[-1].texels, coarse_stripes)
    assert np.sqrt((error**2).mean()) < 0.1


def test_same_for_any_number_of_threads_and_another_for_another_seed(analytic):
    surface, views = make_surface((128,)), [make_view("front", coarse_stripes), make_view("left", coarse_stripes)]
    params = SurfaceTextureParams(iterations=(3,))
    before = numba.get_num_threads()
    results = []
    try:
        for n_threads in (1, before):
            numba.set_num_threads(n_threads)
            results.append(synthesize(surface, views, params, analytic).colour)
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(results[0], results[1])
    assert not np.array_equal(results[0], synthesize(surface, views, replace(params, seed=1), analytic).colour)


def test_a_patch_of_the_source_is_what_the_surface_shows():
    """The photo around a pixel, through J, against the pattern on the tangent plane at the point that it shows."""
    level = make_level(256)
    views = [make_view("front", coarse_stripes)]
    seen = look(level, views)
    photo = surface_in_photo(views[0], level.texels, seen.pixels[0], seen.seen[0])
    sources = sources_at((photo,), level.texels.spacing, level.patch_size, 1.1)
    pixels = project(views[0].camera, level.vertices)[:, :2]
    vertex = int(np.argmax(level.normals @ np.array([0.45, -0.89, 0.0]) - 3 * np.abs(level.vertices[:, 2])))
    position = sources.pixels(0, pixels[vertex : vertex + 1])
    turn = turns(sources.jacobians_at(0, position), np.float32([[0, 1]]))[0]
    # by hand: moving along the tangent, normal x up, shrinks by the cosine; the bitangent points down
    normal = level.normals[vertex]
    scale = sources.scales[0][0] * PIXELS_PER_METRE * level.texels.spacing
    assert np.allclose(turn, [scale * normal[1], 0, 0, scale], atol=0.05)
    offset = (np.arange(10) - 4.5) * level.texels.spacing
    right, down = np.meshgrid(offset, offset)
    point = level.vertices[vertex] + right[..., None] * level.tangents[vertex]
    theta = np.arctan2(point[..., 1], point[..., 0])
    patch = np.rint(255 * coarse_stripes(theta, level.vertices[vertex, 2] - down)).astype(np.int32)
    cells = np.ascontiguousarray(patch.reshape(100, 3).T)
    width, known = sources.frames[0, 2], np.ones(100, np.int32)
    limit = np.int32(2147483647)

    def error(angle):
        x, y = position[0]
        bent = turns(sources.jacobians_at(0, position), np.float32([[angle, 1]]))[0]
        return patch_distance(sources.image(0), np.int32(width), x, y, bent, 10, cells, known, limit) / 100

    assert error(0.0) < 3 * 15**2  # nearest pixels of slopes of 20 levels a pixel
    assert error(0.0) < 0.3 * min(error(0.4), error(-0.4))


@numba.njit
def _turned(jacobian, angle, scale):
    return turned(jacobian, angle, scale)


def test_rotation_and_scale_come_before_the_surface_in_search_and_votes():
    jacobian = np.float32([0.7, 0.2, -0.1, 0.9])
    angle, scale = np.float32(0.2), np.float32(1.1)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    truth = (scale * jacobian.reshape(2, 2) @ turn).ravel()
    assert np.allclose(turns(jacobian[None], np.float32([[angle, scale]]))[0], truth, atol=1e-6)
    assert np.allclose(_turned(jacobian, angle, scale), truth, atol=1e-6)


def test_start_matches_are_where_the_view_sees_the_vertex_or_may_look():
    level, views = make_level(128), [make_view("front"), make_view("back")]
    seen = look(level, views)
    photos = tuple(surface_in_photo(v, level.texels, seen.pixels[i], seen.seen[i]) for i, v in enumerate(views))
    sources = sources_at(photos, level.texels.spacing, level.patch_size, 1.1)
    pixels = np.stack([project(view.camera, level.vertices)[:, :2] for view in views])
    needed = (blend_weights(seen, 0.2) > 0) & ~seen.seen
    matches = start_matches(level, sources, pixels, seen.seen, needed, 0)
    facing = level.normals @ np.array([0, -1.0, 0])
    inside = facing > np.cos(np.pi / 6)
    assert (matches.owner[0, inside] == -1).all()
    assert np.allclose(matches.position[0, inside], sources.pixels(0, pixels[0])[inside], atol=0.01)
    lost = (facing < 0.5) & (matches.owner[0] >= 0)
    assert lost.any()
    first, _, width = sources.frames[0]
    place = matches.position[0, lost].astype(int)
    assert sources.usable[first + place[:, 1] * width + place[:, 0]].all()
    assert len(np.unique(matches.position[0, lost], axis=0)) > 0.9 * lost.sum()
    counts = np.bincount(matches.targets, minlength=level.n_vertices)
    assert np.array_equal(counts, (matches.owner >= 0).sum(axis=0))


def test_patches_of_texels_against_a_loop():
    rng = np.random.default_rng(0)
    cells = rng.integers(-1, 30, (40, 9)).astype(np.int32)
    offsets, members = patches_of_texels(cells, 30)
    for texel in range(30):
        assert (
            members[offsets[texel] : offsets[texel + 1]].tolist()
            == np.flatnonzero((cells == texel).any(axis=1)).tolist()
        )


def test_weights_and_kept_texels():
    level, views = make_level(128), [make_view("front"), make_view("left")]
    seen = look(level, views)
    weights = blend_weights(seen, 0.2)
    assert np.allclose(weights.sum(axis=0), 1, atol=1e-5)
    # nothing faces the far corner: the views share it
    corner = level.texels.normals @ np.array([-0.7, 0.7, 0]) > 0.98
    assert np.allclose(weights[:, corner], 0.5)
    middle = (seen.facing > 0.6).all(axis=0)
    assert np.allclose(weights[:, middle], seen.alpha[:, middle], atol=0.01)
    kept = kept_texels(seen, 1.3)
    extra = kept & ~seen.seen
    assert not extra[:, seen.seen.any(axis=0)].any()
    assert extra.any() and (seen.facing[extra] > np.cos(1.3)).all()
    assert np.array_equal(kept_texels(seen, 0.0), seen.seen)


def test_image_fills_the_gutter():
    texture = HairTexture(4, np.array([5, 6], np.int32), np.float32([[1, 0, 0], [0, 1, 0]]), np.zeros(2, np.float32))
    image = texture.image()
    assert image.shape == (4, 4, 3)
    assert (image[:, :2] == (255, 0, 0)).all() and (image[:, 2:] == (0, 255, 0)).all()
    assert packed(texture.colour).tolist() == [0xFF, 0xFF00]


class Stop(Exception):
    pass


def test_bad_input_and_cancel(analytic):
    surface, views = make_surface((128,)), [make_view("front")]
    with pytest.raises(InputError, match="1 scales, iterations are"):
        synthesize_texture(surface, surface.mesh, views)
    with pytest.raises(InputError, match="no views"):
        synthesize_texture(surface, surface.mesh, [], SurfaceTextureParams(iterations=(1,)))
    for bad in ({"iterations": ()}, {"rotation": 4.0}, {"scale": 0.5}, {"screening": 0.0}, {"keep_angle": 2.0}):
        with pytest.raises(InputError):
            SurfaceTextureParams(**bad)

    def stop(fraction, message):
        assert 0 <= fraction <= 1 and message
        if fraction > 0.5:
            raise Stop

    with pytest.raises(Stop):
        synthesize(surface, views, SurfaceTextureParams(iterations=(4,)), analytic, progress=stop)
