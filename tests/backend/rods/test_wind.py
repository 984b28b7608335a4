"""Air from force fields: analytic directions and falloff, gusts, turbulence without sources."""

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.rods.scene import ForceField, Scene
from hairloom.rods.wind import wind_at
from scipy.spatial.transform import Rotation

N_FRAMES = 10
POINTS = np.random.default_rng(0).uniform(-0.5, 0.5, (200, 3))


def scene(*fields: ForceField) -> Scene:
    return Scene(24.0, np.tile(np.eye(4), (N_FRAMES, 1, 1)), fields=fields)


def field(kind: str, *, axis=(0.0, 0.0, 1.0), origin=(0.0, 0.0, 0.0), strength=2.0, noise=0.0, **more) -> ForceField:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.align_vectors([axis], [[0, 0, 1]])[0].as_matrix()
    matrix[:3, 3] = origin
    constant = np.ones(N_FRAMES)
    return ForceField(kind, np.tile(matrix, (N_FRAMES, 1, 1)), strength * constant, noise * constant, **more)


def test_no_fields_no_air():
    assert (wind_at(scene(), 3.0, POINTS) == 0).all()


def test_wind_blows_along_the_objects_z_axis():
    blown = wind_at(scene(field("wind", axis=(0, 1, 0))), 0.0, POINTS)
    np.testing.assert_allclose(blown, np.tile([0, 2.0, 0], (len(POINTS), 1)), atol=1e-12)


def test_a_force_blows_away_and_a_vortex_around():
    origin = np.array([0.1, -0.2, 0.3])
    away = wind_at(scene(field("force", origin=origin)), 0.0, POINTS)
    around = wind_at(scene(field("vortex", origin=origin)), 0.0, POINTS)
    offset = POINTS - origin
    np.testing.assert_allclose(away, 2.0 * offset / np.linalg.norm(offset, axis=1)[:, None], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(around, axis=1), 2.0, atol=1e-12)
    np.testing.assert_allclose(np.einsum("ni,ni->n", around, offset), 0.0, atol=1e-12)
    # counter-clockwise seen from the tip of the axis
    assert (np.cross(offset, around)[:, 2] > 0).all()


def test_falloff_and_its_ends():
    far = np.array([[0.05, 0, 0], [0.3, 0, 0], [0.6, 0, 0]])
    speeds = wind_at(scene(field("force", falloff_power=2.0, distance_min=0.1, distance_max=0.5)), 0.0, far)[:, 0]
    np.testing.assert_allclose(speeds, [2.0, 2.0 * (1 + 0.2) ** -2, 0.0])


def test_fields_add_up_and_frames_are_linear_between():
    one, other = field("wind"), field("force", origin=(0, 0, 2))
    rising = ForceField("wind", one.matrices, np.arange(N_FRAMES, dtype=float), np.zeros(N_FRAMES))
    together = wind_at(scene(one, other), 0.0, POINTS)
    np.testing.assert_allclose(together, wind_at(scene(one), 0, POINTS) + wind_at(scene(other), 0, POINTS))
    np.testing.assert_allclose(wind_at(scene(rising), 2.25, POINTS)[:, 2], 2.25)


def test_gusts_stay_within_their_share_and_follow_the_seed():
    frames = np.linspace(0, N_FRAMES - 1, 60)

    def speeds(seed: int) -> np.ndarray:
        gusty = scene(field("wind", noise=0.5, seed=seed))
        return np.array([wind_at(gusty, frame, POINTS[:1])[0, 2] for frame in frames])

    assert np.ptp(speeds(1)) > 0.05
    assert (np.abs(speeds(1) / 2.0 - 1.0) <= 0.5).all()
    assert (speeds(1) == speeds(1)).all()
    assert (speeds(1) != speeds(2)).any()


def test_turbulence_has_no_sources():
    """Its divergence, by central differences, is 0; its root mean square is the strength."""
    swirling, step = scene(field("turbulence", size=0.2, seed=4)), 1e-4
    divergence = np.zeros(len(POINTS))
    for axis in range(3):
        ahead = POINTS + step * np.eye(3)[axis]
        behind = POINTS - step * np.eye(3)[axis]
        change = wind_at(swirling, 1.0, ahead) - wind_at(swirling, 1.0, behind)
        divergence += change[:, axis] / (2 * step)
    # of the size of one derivative, about 2 pi / 0.2 * 2 m/s, times the difference's error
    assert np.abs(divergence).max() < 1e-4
    many = np.random.default_rng(1).uniform(-5, 5, (20000, 3))
    speeds = wind_at(swirling, 1.0, many)
    assert 1.7 < np.sqrt((speeds**2).sum(axis=1).mean()) < 2.3


def test_bad_fields_are_refused():
    with pytest.raises(InputError, match="'magnet' is not known"):
        field("magnet")
    with pytest.raises(InputError, match="size of a turbulence is 0 m"):
        field("turbulence", size=0.0)
    with pytest.raises(InputError, match="another number of frames"):
        Scene(24.0, np.tile(np.eye(4), (3, 1, 1)), fields=(field("wind"),))
