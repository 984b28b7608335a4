"""Contacts: detection on known shapes, and the coupling of the solver with the time step."""

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.geometry.collider import Collider
from hairloom.rods.contacts import ContactParams, Solid, find_contacts
from hairloom.rods.detection import near_pairs, place_legs, sample_rods
from hairloom.rods.helices import Helices
from hairloom.rods.material import MaterialParams
from hairloom.rods.model import make_rods
from scipy.spatial.transform import Rotation

GRAVITY = np.array([0.0, 0.0, -9.81])
STEP = 1.0 / 48.0


def grid_of(function, low, high, cell):
    """A collider from an analytic signed distance, exact at its nodes."""
    axes = [np.arange(a, b + cell, cell) for a, b in zip(low, high, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return Collider(function(nodes).astype(np.float32), np.array(low, np.float64), cell)


def sphere_grid(radius=0.1, cell=0.004):
    size = [radius + 4 * cell] * 3
    return grid_of(lambda p: np.linalg.norm(p, axis=-1) - radius, [-s for s in size], size, cell)


def floor_grid(half=0.6, cell=0.02):
    """What is below z = 0."""
    return grid_of(lambda p: p[..., 2], [-half, -half, -0.1], [half, half, 0.1], cell)


def moved(vector=(0.0, 0.0, 0.0), rotation=(0.0, 0.0, 0.0)):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_rotvec(rotation).as_matrix(), vector
    return matrix


def resting(grid, matrix=None, friction=0.3):
    matrix = np.eye(4) if matrix is None else matrix
    return Solid(grid, matrix, matrix, friction)


def frames_along(tangents):
    """(S, 3, 3) with tangents (S, 3) as first columns."""
    t = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    other = np.eye(3)[np.abs(t).argmin(axis=1)]
    n1 = np.cross(t, other)
    n1 /= np.linalg.norm(n1, axis=1, keepdims=True)
    return np.stack([t, n1, np.cross(t, n1)], axis=2)


def straight(roots, tangents, length, n_elements):
    roots, tangents = np.atleast_2d(np.asarray(roots, float)), np.atleast_2d(np.asarray(tangents, float))
    count = len(roots)
    offsets = np.arange(count + 1, dtype=np.int32) * n_elements
    lengths = np.full(count * n_elements, length / n_elements)
    return Helices(roots, frames_along(tangents), offsets, lengths, np.zeros((count * n_elements, 3)))


def random_helices(count=6, n_elements=4, seed=0):
    rng = np.random.default_rng(seed)
    helices = straight(rng.uniform(-0.1, 0.1, (count, 3)), rng.normal(size=(count, 3)), 0.2, n_elements)
    return Helices(
        helices.roots, helices.frames, helices.offsets, helices.lengths, rng.normal(0, 10, (count * n_elements, 3))
    )


# --- detection ----------------------------------------------------------------------------------------------------


def test_samples_are_at_most_their_spacing_apart():
    helices = random_helices()
    rods = make_rods(helices, MaterialParams())
    samples = sample_rods(rods, 0.012)
    # 0.05 m an element: 5 parts of 1 cm each, and the root
    assert len(samples.arcs) == 6 * (4 * 5 + 1)
    assert samples.is_root.sum() == samples.is_tip.sum() == 6
    assert samples.is_root[::21].all() and samples.is_tip[20::21].all()
    assert (samples.strands == np.repeat(np.arange(6), 21)).all()
    along = samples.elements * 0.05 + samples.arcs
    assert np.allclose(along.reshape(6, 21), np.arange(6)[:, None] * 0.2 + np.arange(21) * 0.01)


@pytest.mark.parametrize("radius", [0.001, 0.03])
def test_contacts_with_a_moved_sphere(radius):
    helices = random_helices(40)
    rods = make_rods(helices, MaterialParams(friction=0.2), radius=radius)
    params = ContactParams(radius=radius)
    matrix = moved((0.05, -0.02, 0.03), (0.3, 1.0, -2.0))
    contacts = find_contacts(rods, params, helices, [resting(sphere_grid(), matrix, 0.5)])
    samples = sample_rods(rods, params.spacing)
    points = place_legs(helices, samples.elements, samples.arcs)
    away = points - matrix[:3, 3]
    distance = np.linalg.norm(away, axis=1) - 0.1
    # the trilinear distance of a 4 mm grid is 4 mm^2 / 8 (1 / R + 1 / R) = 40 um off; beyond the grid 0.15 mm more
    inside_well = (distance < radius - 2e-4) & (distance > -0.08) & ~samples.is_root
    assert inside_well.sum() > 50 and np.isin(np.flatnonzero(inside_well), contacts.keys).all()
    assert (distance[contacts.keys] < radius + 2e-4).all() and not samples.is_root[contacts.keys].any()
    deep = distance[contacts.keys] < -0.08
    assert np.abs(contacts.gaps - distance[contacts.keys])[~deep].max() < 2e-4
    normals = away[contacts.keys] / np.linalg.norm(away[contacts.keys], axis=1, keepdims=True)
    # a trilinear gradient is exact in the middle of a cell only
    assert (np.einsum("ci,ci->c", contacts.axes[:, 0], normals)[~deep] > 0.99).all()
    assert np.allclose(contacts.axes @ np.swapaxes(contacts.axes, 1, 2), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(contacts.axes), 1.0)
    assert (contacts.friction == 0.5).all() and (contacts.offsets == contacts.gaps).all()
    assert (contacts.elements[:, 0] == samples.elements[contacts.keys]).all() and (contacts.elements[:, 1] == -1).all()


def test_velocity_of_a_solid_is_that_of_its_material():
    turn, way = np.array([0.0, 0.0, 0.02]), np.array([0.001, 0.0, 0.0])
    before = moved((0.1, 0.2, 0.3), (0.5, 0.0, 0.0))
    now = moved(way) @ moved(rotation=turn) @ before
    points = np.random.default_rng(0).normal(size=(5, 3))
    velocity = Solid(sphere_grid(), now, before).velocities(points, 0.01)
    inverse = np.linalg.inv(moved(way) @ moved(rotation=turn))
    assert np.allclose(velocity, (points - (points @ inverse[:3, :3].T + inverse[:3, 3])) / 0.01, atol=1e-12)
    # about the axis, to second order in the turn
    assert np.allclose(velocity, (np.cross(turn, points) + way) / 0.01, atol=0.06)


def naive_distance(points, a, b):
    """Distance of two segments by a fine grid of their places."""
    places = np.linspace(0, 1, 201)[:, None]
    first = points[a - 1] + places * (points[a] - points[a - 1])
    second = points[b - 1] + places * (points[b] - points[b - 1])
    return np.linalg.norm(first[:, None] - second[None], axis=2).min()


def test_near_pairs_against_all_pairs():
    helices = random_helices(12, 4, seed=3)
    rods = make_rods(helices, MaterialParams())
    samples = sample_rods(rods, 0.025)
    points = place_legs(helices, samples.elements, samples.arcs)
    reach = 0.02
    pairs, places = near_pairs(samples, points, np.zeros_like(points), reach, reach)
    found = {tuple(pair) for pair in pairs}
    assert len(found) == len(pairs) > 20
    segments = np.flatnonzero(~samples.is_root)
    distances = {
        (a, b): naive_distance(points, a, b)
        for a in segments
        for b in segments
        if a < b and samples.strands[a] != samples.strands[b]
    }
    for (a, b), distance in distances.items():
        if (a, b) in found:
            assert distance < reach + 1e-3
    for (a, b), (s, t) in zip(pairs, places, strict=True):
        gap = np.linalg.norm(
            points[a - 1] + s * (points[a] - points[a - 1]) - points[b - 1] - t * (points[b] - points[b - 1])
        )
        # the grid of 200 steps is up to (25 mm / 200 / 2)^2 / gap above
        assert gap <= distances[a, b] + 1e-9 and distances[a, b] - gap < 2e-4
    # every two strands that come near have their nearest place among the pairs
    for first in range(12):
        for second in range(first + 1, 12):
            near = [
                d for (a, b), d in distances.items() if samples.strands[a] == first and samples.strands[b] == second
            ]
            got = [distances[a, b] for a, b in found if samples.strands[a] == first and samples.strands[b] == second]
            if min(near) < reach - 1e-3:
                assert got and min(got) < min(near) + 1e-9


def test_pairs_that_move_apart_are_left_out():
    helices = straight([[0, 0, 0], [0.05, -0.05, 0.004]], [[1, 0, 0], [0, 1, 0]], 0.1, 2)
    rods = make_rods(helices, MaterialParams())
    samples = sample_rods(rods, 0.02)
    points = place_legs(helices, samples.elements, samples.arcs)
    for lift, expected in ((-0.003, 1), (-0.001, 0), (0.003, 0)):
        moves = np.where(samples.strands[:, None] == 1, [[0.0, 0.0, lift]], 0.0)
        pairs, _ = near_pairs(samples, points, moves, 0.01, 0.002)
        assert len(pairs) == expected


def test_bad_input():
    with pytest.raises(InputError, match="scales"):
        Solid(sphere_grid(), np.diag([2.0, 1, 1, 1]), np.eye(4))
    with pytest.raises(InputError, match="mirrors"):
        Solid(sphere_grid(), np.eye(4), np.diag([-1.0, 1, 1, 1]))
    with pytest.raises(InputError, match="friction"):
        resting(sphere_grid(), friction=-1.0)
    for bad in ({"radius": -1.0}, {"spacing": 0.0}, {"iterations": 0}, {"tolerance": np.nan}, {"push_speed": np.inf}):
        with pytest.raises(InputError, match=next(iter(bad))):
            ContactParams(**bad)
