"""Scalp space: eq. (1) and (2), frames, root remap, the fit and the maps (W-2 ... W-6)."""

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.geometry.head import HeadSurface, default_head, sphere_head
from hairloom.geometry.scalp_space import ScalpSpace, fit_scalp_space, root_strands, unroot_strands
from hairloom.geometry.strands import from_dense, resample_smooth
from hairloom.types import Head

CENTRE = np.array([0.3, -0.2, 1.6])


def _unit_space(polar_scale=1.0, height=1.0, resolution=65):
    """Head space is world space; the head is a sphere."""
    angle = np.linspace(0, np.pi, resolution)
    v, u = np.meshgrid(angle, angle, indexing="ij")
    bare = ScalpSpace(
        np.zeros(3), 1.0, np.eye(3), polar_scale, np.full((resolution, resolution), height, np.float32),
        np.zeros((3, resolution, resolution), np.float32),
    )  # fmt: skip
    directions = bare.from_scalp(np.stack([u, v, np.full_like(u, 1 - height)], axis=-1))
    normal = np.ascontiguousarray(directions.transpose(2, 0, 1))
    return ScalpSpace(bare.centre, 1.0, bare.rotation, polar_scale, bare.height, normal)


def _points(count=2000, seed=0, largest=6.0):
    generator = np.random.default_rng(seed)
    directions = generator.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return directions * generator.uniform(0.05, largest, (count, 1))


def test_equation_1_as_corrected():
    """u and v by arc cosine with hatted coordinates, as the paper means them; w is the height over d = 1."""
    points = _points()
    r = np.linalg.norm(points, axis=1)
    x, y, z = (points / r[:, None]).T
    u = np.arccos(x / np.sqrt(x**2 + (y + 1) ** 2))
    v = np.arccos(z / np.sqrt(z**2 + (y + 1) ** 2))
    result = _unit_space().to_scalp(points)
    # float32 storage of angles up to pi
    np.testing.assert_allclose(result[:, 0], u, atol=3e-7)
    np.testing.assert_allclose(result[:, 1], v, atol=3e-7)
    np.testing.assert_allclose(result[:, 2], r - 1.0, atol=1e-6)


def test_known_places():
    space = _unit_space()
    half = 0.5 * np.pi
    places = {(0, 1, 0): (half, half), (1, 0, 0): (half / 2, half), (-1, 0, 0): (1.5 * half, half)}
    places |= {(0, 0, 1): (half, half / 2), (0, 0, -1): (half, 1.5 * half)}
    for point, uv in places.items():
        np.testing.assert_allclose(space.to_scalp(np.array([point], float))[0], [*uv, 0.0], atol=3e-7)


def test_upper_hemisphere_has_78_cells_of_0_02():
    """W-17: u and v within [pi/4, 3 pi/4] for y >= 0."""
    points = _points(20000)
    uv = _unit_space().to_scalp(points[points[:, 1] >= 0])[:, :2]
    assert uv.min() > np.pi / 4 - 1e-6 and uv.max() < 3 * np.pi / 4 + 1e-6
    assert round(float(np.ptp(uv)) / 0.02) in (78, 79)


@pytest.mark.parametrize("polar_scale", [1.0, 0.999, 0.8, 0.6])
def test_round_trip(polar_scale):
    space = _unit_space(polar_scale)
    points = _points(20000)
    # 1e-5 head radii is the promise; float32 coordinates at 6 radii already cost 1e-6
    np.testing.assert_allclose(space.from_scalp(space.to_scalp(points)), points, atol=5e-6)


@pytest.mark.parametrize("polar_scale", [1.0, 0.7])
def test_round_trip_at_the_singularity_and_the_centre(polar_scale):
    space = _unit_space(polar_scale)
    south = np.array([[0, -2, 0], [1e-6, -2, 0], [0, -2, 1e-7], [-1e-4, -2, 1e-4], [0, -1e-3, 0]], float)
    np.testing.assert_allclose(space.from_scalp(space.to_scalp(south)), south, atol=2e-6)
    centre = space.to_scalp(np.zeros((1, 3)))
    assert np.isfinite(centre).all()
    np.testing.assert_allclose(space.from_scalp(centre), 0.0, atol=1e-6)
    corners = np.array([[0, 0, 0], [np.pi, 0, 0], [np.pi, np.pi, 0], [0, 1, 0], [1, np.pi, 0]], float)
    np.testing.assert_allclose(space.from_scalp(corners), np.tile([0, -1.0, 0], (5, 1)), atol=1e-6)


def test_remap_multiplies_the_polar_angle():
    """W-6: what lies at the rim, 90 deg / polar_scale, comes to lie on the equator; azimuths stay."""
    scale = 0.72
    plain, mapped = _unit_space(), _unit_space(scale)
    polar = np.linspace(0.01, 0.5 * np.pi / scale, 50)
    for azimuth in (0.3, 2.0, -2.5):

        def at(angle, azimuth=azimuth):
            out = np.sin(angle)
            return np.stack([out * np.cos(azimuth), np.cos(angle), out * np.sin(azimuth)], axis=1)

        uv = mapped.to_scalp(at(polar))[:, :2]
        np.testing.assert_allclose(uv, plain.to_scalp(at(scale * polar))[:, :2], atol=1e-6)
    # beyond the rim it stays monotone up to S0
    beyond = np.linspace(0.01, np.pi - 1e-6, 400)
    along = mapped.to_scalp(np.stack([np.sin(beyond), np.cos(beyond), np.zeros(400)], axis=1))[:, 0]
    assert (np.diff(along) < 0).all()


def test_frames_take_up_to_the_normal():
    space = fit_scalp_space(sphere_head(0.1, tuple(CENTRE)))
    uv = space.to_scalp(_points(500, largest=1.0) * [1, 0.5, 1] + [0, 1.0, 0])[:, :2]
    frames = space.frames_at(uv)
    np.testing.assert_allclose(np.einsum("nji,njk->nik", frames, frames), np.tile(np.eye(3), (500, 1, 1)), atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-6)
    directions = space.from_scalp(np.column_stack([uv, np.zeros(500)]))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # normals of the polyhedron through a bilinear map: 2e-3
    np.testing.assert_allclose(frames[:, :, 1], directions, atol=3e-3)
    for frame, normal in zip(frames, frames[:, :, 1].astype(np.float64)):
        axis = np.cross([0, 1, 0], normal)
        # rotating y to n about y x n leaves the axis itself where it is, and nothing else does that
        np.testing.assert_allclose(frame @ axis, axis, atol=1e-6)
        assert np.trace(frame) == pytest.approx(1 + 2 * normal[1], abs=1e-5)


def test_frame_at_the_antipode_is_still_a_rotation():
    space = _unit_space()
    frame = space.frames_at(np.array([[1e-4, 1e-4]]))[0]
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), atol=1e-6)
    assert np.linalg.det(frame) == pytest.approx(1.0, abs=1e-6)


def test_fit_of_a_hemisphere():
    """A perfect hemisphere: its own centre and radius, y up, no remap, and d = 1."""
    space = fit_scalp_space(sphere_head(0.1, tuple(CENTRE)))
    # the polyhedron's faces lie up to 1.2e-4 m under the sphere
    np.testing.assert_allclose(space.centre, CENTRE, atol=1e-4)
    assert space.radius == pytest.approx(0.1, abs=1e-4)
    np.testing.assert_allclose(space.rotation, [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-6)
    assert space.polar_scale > 0.999
    np.testing.assert_allclose(space.height, 1.0, atol=1.5e-3)


def test_other_up_axes_move_the_axes_along():
    """A head whose up is world y, of the same shape: the same coordinates."""
    head = sphere_head(0.1)
    turned = Head(head.vertices[:, [1, 2, 0]], head.triangles, head.scalp, head.corner_uv)
    space = fit_scalp_space(turned, up=(0, 2.0, 0))
    np.testing.assert_allclose(space.rotation[1], [0, 1, 0], atol=1e-6)
    assert np.linalg.det(space.rotation) == pytest.approx(1.0)
    assert space.world_to_head(np.array([[0, 0.1, 0]]))[0, 1] == pytest.approx(1.0, abs=2e-3)


def test_axis_tilts_towards_the_scalp():
    """A cap of 110 deg whose middle leans back by 25 deg: tilted, and the rest remapped onto y >= 0."""
    head = sphere_head(0.1, scalp_angle_deg=110.0)
    lean = np.radians(25.0)
    rotation = np.array([[1, 0, 0], [0, np.cos(lean), np.sin(lean)], [0, -np.sin(lean), np.cos(lean)]])
    leaning = Head((head.vertices @ rotation.T).astype(np.float32), head.triangles, head.scalp, head.corner_uv)
    space = fit_scalp_space(leaning)
    tilt = np.degrees(np.arccos(space.rotation[1, 2]))
    assert 22.0 <= tilt <= 26.0
    assert 90.0 / space.polar_scale == pytest.approx(110.0, abs=3.5)
    roots = leaning.vertices[np.unique(leaning.triangles[leaning.scalp])]
    uv = space.to_scalp(space.world_to_head(roots))[:, :2].astype(np.float64)
    stereographic = 1 / np.tan(uv)
    # y >= 0 after the remap: within the unit circle of (cot u, cot v)
    assert ((stereographic**2).sum(axis=1) <= 1 + 1e-5).all()


def test_distortion_matches_finite_differences():
    space = _unit_space(0.7)
    generator = np.random.default_rng(4)
    uv = generator.uniform(0.9, 2.2, (200, 2))
    report = space.distortion(uv)
    h = 1e-3
    expected = []
    for place in uv:
        columns = []
        for axis in np.eye(2) * h:
            ends = space.from_scalp(np.array([[*(place + axis), 0.0], [*(place - axis), 0.0]])).astype(np.float64)
            columns.append((ends[0] - ends[1]) / (2 * h))
        expected.append(np.linalg.svd(np.array(columns).T, compute_uv=False))
    # float32 points over a step of 2e-3: 1e-4
    np.testing.assert_allclose(report.stretch, expected, rtol=2e-3)
    assert report.largest == pytest.approx(np.max(expected), rel=2e-3)
    assert report.area_ratio >= 1 and report.polar_scale == 0.7
    undistorted = _unit_space().distortion(np.array([[np.pi / 2, np.pi / 2], [np.pi / 4, np.pi / 2]]))
    np.testing.assert_allclose(undistorted.stretch, [[2, 2], [2, 1]], rtol=1e-6)


def test_small_and_flat_scalps_get_a_sensible_sphere():
    """A patch too small for a sphere fit takes the size of the head below it."""
    head = sphere_head(0.1, tuple(CENTRE), scalp_angle_deg=12.0)
    space = fit_scalp_space(head)
    assert space.radius == pytest.approx(0.1, rel=0.1)
    np.testing.assert_allclose(space.centre, CENTRE, atol=0.015)
    strip = np.zeros_like(head.scalp)
    middles = head.vertices[head.triangles].mean(axis=1) - CENTRE
    strip[(np.abs(middles[:, 0]) < 0.008) & (middles[:, 2] > 0)] = True
    mohawk = fit_scalp_space(Head(head.vertices, head.triangles, strip, head.corner_uv))
    assert mohawk.radius == pytest.approx(0.1, rel=0.15)
    np.testing.assert_allclose(mohawk.centre, CENTRE, atol=0.05)


def test_a_flat_sheet_still_has_coordinates():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    sheet = Head(vertices, triangles, np.ones(2, np.bool_), np.zeros((2, 3, 2), np.float32))
    space = fit_scalp_space(sheet)
    assert space.radius == pytest.approx(np.sqrt(1 / (2 * np.pi)))
    np.testing.assert_allclose(space.centre, [0.5, 0.5, -space.radius], atol=1e-6)
    points = np.array([[0.3, 0.4, 0.0], [0.5, 0.5, 0.2]])
    coordinates = space.to_scalp(space.world_to_head(points))
    np.testing.assert_allclose(coordinates[:, 2], [0.0, 0.2 / space.radius], atol=2e-3)
    np.testing.assert_allclose(space.head_to_world(space.from_scalp(coordinates)), points, atol=1e-5)


def test_world_and_head_space_are_inverse():
    space = fit_scalp_space(default_head())
    points = CENTRE * 0 + np.random.default_rng(0).uniform(-0.4, 0.6, (5, 200, 3))
    head = space.world_to_head(points)
    assert head.shape == points.shape and head.dtype == np.float32
    np.testing.assert_allclose(space.head_to_world(head), points, atol=1e-6)
    directions = space.world_to_head_directions(points)
    np.testing.assert_allclose(directions / space.radius, head - space.world_to_head(np.zeros(3)), atol=1e-5)
    np.testing.assert_allclose(space.head_to_world_directions(directions), points, atol=1e-6)


def test_own_head_scalp_lies_at_height_zero():
    head = default_head()
    space = fit_scalp_space(head)
    surface = HeadSurface(head)
    assert surface.signed_distance(space.centre[None])[0] < 0
    middles = head.vertices[head.triangles[head.scalp]].mean(axis=1)
    w = space.to_scalp(space.world_to_head(middles))[:, 2]
    # a 5 mm mesh through a map of 256^2: almost everywhere within half a millimetre
    assert np.percentile(np.abs(w), 95) * space.radius < 0.0005
    normals = surface.normals_at(np.flatnonzero(head.scalp).astype(np.int32), np.full((len(middles), 3), 1 / 3))
    frames = space.frames_at(space.to_scalp(space.world_to_head(middles))[:, :2])
    cosines = np.einsum("nc,nc->n", frames[:, :, 1], space.world_to_head_directions(normals))
    assert np.percentile(cosines, 5) > np.cos(np.radians(5.0))
    # no steps: the hair over the ears, the face and the neck keeps coordinates that change slowly
    step = np.pi / (space.height.shape[0] - 1)
    assert np.abs(np.diff(space.height, axis=0)).max() < 4.0 * step
    assert np.abs(np.diff(space.height, axis=1)).max() < 4.0 * step
    assert space.height.min() > 0.7 and space.height.max() < 1.4


def test_root_strands_and_back():
    head = default_head()
    space = fit_scalp_space(head)
    generator = np.random.default_rng(5)
    roots = head.vertices[head.triangles[head.scalp]].mean(axis=1)[::40]
    steps = generator.normal(size=(len(roots), 30, 3)) * 0.003 + [0, 0.001, -0.004]
    strands = from_dense((roots[:, None] + np.cumsum(steps, axis=1)).astype(np.float32))
    rooted = root_strands(strands, space, 48)
    assert rooted.n_points == 48 and (rooted.points[:, 0] == 0).all()
    expected = resample_smooth(strands, 48)
    back = unroot_strands(rooted, space)
    np.testing.assert_allclose(back.points.reshape(expected.shape), expected, atol=1e-6)
    np.testing.assert_allclose(rooted.in_head_space(), space.world_to_head(expected), atol=1e-5)
    # a strand straight along the scalp's normal is the y axis of its root frame
    normals = space.head_to_world_directions(rooted.frames[:, :, 1])
    straight = from_dense(strands.roots[:, None] + np.linspace(0, 0.1, 9)[None, :, None] * normals[:, None])
    local = root_strands(straight, space, 9).points
    np.testing.assert_allclose(local[:, -1], np.tile([0, 0.1 / space.radius, 0], (len(roots), 1)), atol=1e-5)


def test_moving_the_head_changes_nothing():
    head = default_head()
    offset = np.array([3.0, -2.0, 5.0], np.float32)
    moved = Head(head.vertices + offset, head.triangles, head.scalp, head.corner_uv)
    space, there = fit_scalp_space(head), fit_scalp_space(moved)
    # vertices rounded to float32 at 5 m: 5e-7 m
    np.testing.assert_allclose(there.centre, space.centre + offset, atol=1e-6)
    assert there.radius == pytest.approx(space.radius, rel=1e-5)
    assert there.polar_scale == pytest.approx(space.polar_scale, rel=1e-4)
    assert np.percentile(np.abs(there.height - space.height), 99) < 1e-4


def test_same_input_same_bytes():
    first, second = fit_scalp_space(default_head()), fit_scalp_space(default_head())
    assert first.height.tobytes() == second.height.tobytes()
    assert first.normal.tobytes() == second.normal.tobytes()


def test_bad_input():
    head = sphere_head(n_rings=8)
    bald = Head(head.vertices, head.triangles, np.zeros_like(head.scalp), head.corner_uv)
    with pytest.raises(InputError, match="no scalp"):
        fit_scalp_space(bald)
    collapsed = Head(np.zeros_like(head.vertices), head.triangles, head.scalp, head.corner_uv)
    with pytest.raises(InputError, match="no area"):
        fit_scalp_space(collapsed)
    with pytest.raises(InputError, match="up direction"):
        fit_scalp_space(head, up=(0, 0, 0))
    with pytest.raises(InputError, match="resolution"):
        fit_scalp_space(head, resolution=2)
    with pytest.raises(InputError, match="shape"):
        _unit_space().to_scalp(np.zeros((4, 2)))
    with pytest.raises(InputError, match="root"):
        _unit_space().distortion(np.zeros((0, 2)))
