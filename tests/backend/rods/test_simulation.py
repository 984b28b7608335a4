"""Guides over a scene: at rest nothing moves, colliders keep hair out, wind blows, saved states go on the same."""

from dataclasses import replace

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.geometry.head import HeadSurface, sphere_head
from hairloom.rods.fitting import FitParams, fit_helices
from hairloom.rods.helices import Helices
from hairloom.rods.material import MaterialParams
from hairloom.rods.model import Rods, make_rods
from hairloom.rods.scene import CollisionMesh, ForceField, Scene
from hairloom.rods.simulation import Simulation, SimulationParams
from hairloom.types import Head, StrandSet
from scipy.spatial.transform import Rotation

N_GUIDES, N_POINTS = 40, 33
HAIRS = 100.0  # that each guide stands for


def fallen_hair(head: Head) -> StrandSet:
    """Strands that leave the upper half of a ball, turn down beside it and hang, 20 cm long, with a wave."""
    radius = float(np.linalg.norm(head.vertices, axis=1).max())
    rng = np.random.default_rng(2)
    height, azimuth = rng.uniform(0.1, 0.9, N_GUIDES), rng.uniform(0, 2 * np.pi, N_GUIDES)
    flat = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1)
    roots = radius * (np.sqrt(1 - height**2)[:, None] * flat + height[:, None] * [0, 0, 1])
    along = np.linspace(0, 0.2, N_POINTS)[None, :, None]
    # over the ball until its equator, with a little space, then straight down
    angle = np.minimum(np.arccos(height)[:, None, None] + along / radius, 0.5 * np.pi)
    reached = radius * (angle - np.arccos(height)[:, None, None])
    over = (radius + 0.15 * reached) * (np.sin(angle) * flat[:, None] + np.cos(angle) * [0, 0, 1.0])
    points = over - np.maximum(along - reached, 0) * [0, 0, 1.0]
    points = points + 0.003 * np.sin(60 * along) * along / 0.2 * flat[:, None]
    points[:, 0] = roots
    offsets = np.arange(N_GUIDES + 1, dtype=np.int32) * N_POINTS
    return StrandSet(points.reshape(-1, 3).astype(np.float32), offsets)


@pytest.fixture(scope="module")
def head() -> Head:
    return sphere_head()


@pytest.fixture(scope="module")
def guides(head: Head) -> Helices:
    return fit_helices(fallen_hair(head), FitParams(n_elements=8)).helices


@pytest.fixture(scope="module")
def rods(guides: Helices) -> Rods:
    return make_rods(guides, MaterialParams(), hairs=np.full(N_GUIDES, HAIRS))


def still(n_frames: int) -> np.ndarray:
    return np.tile(np.eye(4), (n_frames, 1, 1))


def shake(n_frames: int, degrees: float, hertz: float, fps: float = 24.0) -> np.ndarray:
    angles = np.radians(degrees) * np.sin(2 * np.pi * hertz * np.arange(n_frames) / fps)
    motion = still(n_frames)
    motion[:, :3, :3] = Rotation.from_rotvec(angles[:, None] * np.array([0, 0, 1.0])).as_matrix()
    return motion


def scene_of(head: Head, motion: np.ndarray, **more) -> Scene:
    return Scene(24.0, motion, colliders=(CollisionMesh(head.triangles, head.vertices, motion),), **more)


def test_pressing_play_moves_nothing(head: Head, guides: Helices, rods: Rods):
    """10 s: no point of a stable guide moves by more than 0.1 mm; started naively, hair falls by centimetres."""
    scene = scene_of(head, still(2))
    simulation, naive = (
        Simulation(rods, guides, scene, SimulationParams(start_in_equilibrium=start)) for start in (True, False)
    )
    rest = simulation.sample(N_POINTS)[0]
    assert simulation.equilibrium is not None and simulation.equilibrium.stable.all()
    for _ in range(240):
        simulation.advance()
    for _ in range(24):
        naive.advance()
    assert np.linalg.norm(simulation.sample(N_POINTS)[0] - rest, axis=2).max() < 1e-4
    assert np.linalg.norm(naive.sample(N_POINTS)[0] - rest, axis=2).max() > 0.01


@pytest.mark.parametrize("times", [1, 10])
def test_a_shake_keeps_hair_out_of_the_head(head: Head, guides: Helices, rods: Rods, times: int):
    """2 Hz and 20 degrees: nowhere deeper than 1 mm. Ten times as fast nothing explodes."""
    n_frames = 24
    simulation = Simulation(rods, guides, scene_of(head, shake(n_frames, 20.0, 2.0 * times)))
    rest = HeadSurface(head).signed_distance(simulation.sample(N_POINTS)[0].reshape(-1, 3))
    lengths = guides.strand_lengths
    for frame in range(1, n_frames):
        simulation.advance()
        points = simulation.sample(N_POINTS)[0]
        assert np.isfinite(points).all()
        assert (np.linalg.norm(points - points[:, :1], axis=2) <= lengths[:, None] * (1 + 1e-9)).all()
        if times == 1:
            back = np.linalg.inv(simulation.scene.motion[frame])[:3, :3]
            depth = -HeadSurface(head).signed_distance((points.reshape(-1, 3) @ back.T).astype(np.float32))
            assert (depth - np.maximum(-rest, 0.0)).max() < 0.001
    assert simulation.log[-1]["kinetic"] < 1e3


def test_roots_go_where_the_head_carries_them(head: Head, guides: Helices, rods: Rods):
    motion = shake(6, 40.0, 1.0)
    simulation = Simulation(rods, guides, scene_of(head, motion))
    for frame in range(1, 6):
        simulation.advance()
        expected = guides.roots @ motion[frame, :3, :3].T
        np.testing.assert_allclose(simulation.state.roots, expected, atol=1e-12)


def test_wind_blows_hair_along(head: Head, guides: Helices, rods: Rods):
    matrices = still(25)
    matrices[:, :3, :3] = Rotation.from_euler("y", 90, degrees=True).as_matrix()  # z becomes x
    wind = ForceField("wind", matrices, np.full(25, 6.0), np.zeros(25))
    simulation = Simulation(rods, guides, scene_of(head, still(25), fields=(wind,)))
    before = simulation.sample(N_POINTS)[0][:, -1]
    for _ in range(24):
        simulation.advance()
    moved = simulation.sample(N_POINTS)[0][:, -1] - before
    assert np.median(moved[:, 0]) > 0.01
    assert abs(np.median(moved[:, 1])) < 0.2 * np.median(moved[:, 0])


def test_without_gravity_nothing_needs_to_be_found(head: Head, guides: Helices, rods: Rods):
    scene = replace(scene_of(head, still(2)), gravity=np.zeros(3))
    simulation = Simulation(rods, guides, scene)
    np.testing.assert_allclose(simulation.rods.rest, guides.curvatures, atol=1e-9)


def test_a_restored_simulation_goes_on_bit_for_bit(head: Head, guides: Helices, rods: Rods):
    scene = scene_of(head, shake(12, 20.0, 2.0))
    whole, second = Simulation(rods, guides, scene), Simulation(rods, guides, scene)
    for _ in range(5):
        whole.advance()
    second.restore(whole.save())
    for _ in range(6):
        whole.advance()
        second.advance()
    assert whole.state.curvatures.tobytes() == second.state.curvatures.tobytes()
    assert whole.log == second.log


def test_a_state_of_other_guides_is_refused(head: Head, guides: Helices, rods: Rods):
    simulation = Simulation(rods, guides, scene_of(head, still(2)))
    saved = simulation.save()
    saved["curvatures"] = saved["curvatures"][:-1]
    with pytest.raises(InputError, match="other guides"):
        simulation.restore(saved)


def test_a_bending_collider_pushes_hair_away(head: Head, guides: Helices, rods: Rods):
    """A ball whose vertices move, not its matrix, comes from the side into the hair and stays there."""
    radius = 0.3 * float(np.linalg.norm(head.vertices, axis=1).max())
    way = np.linspace([0.25, 0.0, -0.08], [0.11, 0.0, -0.08], 13)
    moving = (0.3 * head.vertices + way[:, None]).astype(np.float32)
    ball = CollisionMesh(head.triangles, moving, still(13))
    simulation = Simulation(rods, guides, Scene(24.0, still(13), colliders=(ball,)))
    rest = simulation.sample(N_POINTS)[0]
    for _ in range(36):
        simulation.advance()
    depth, depth_at_rest = (
        radius - np.linalg.norm(p - way[-1], axis=2) for p in (simulation.sample(N_POINTS)[0], rest)
    )
    assert (depth_at_rest > 0.002).sum() > 20
    assert (depth > 0.002).sum() < 0.05 * (depth_at_rest > 0.002).sum()


def test_bad_settings_are_refused():
    with pytest.raises(InputError, match="substeps is 0"):
        SimulationParams(substeps=0)
