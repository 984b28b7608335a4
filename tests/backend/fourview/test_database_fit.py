"""Hair of the database on other heads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from database_scenes import simple_hair
from hairloom.errors import InputError
from hairloom.fourview.database_fit import fit_to_head, frame_of_head, frame_of_roots
from hairloom.geometry.head import HeadSurface, default_head, sphere_head, submesh
from hairloom.geometry.strands import resample
from hairloom.types import Head


@pytest.fixture(scope="module")
def head() -> Head:
    return default_head()


def stretched(head: Head, factors: tuple[float, float, float]) -> Head:
    """The head made wider, longer, higher, and moved."""
    return replace(head, vertices=head.vertices * np.float32(factors) + np.float32([0.3, -0.2, 1.5]))


def test_there_and_back_again(head: Head) -> None:
    frame = frame_of_head(head)
    directions = np.random.default_rng(0).normal(size=(500, 3))
    points = (
        frame.centre
        + directions / np.linalg.norm(directions, axis=1, keepdims=True) * np.linspace(0.1, 0.5, 500)[:, None]
    )
    back = frame.to_world(frame.to_fitted(points))
    # float32 of metres, and 12 fixed-point steps
    assert np.abs(back - points).max() < 2e-5


def test_fitted_space_of_a_sphere_is_the_unit_sphere() -> None:
    head = sphere_head(radius=0.12, centre=(0.5, 0.1, 1.0))
    frame = frame_of_head(head)
    points = np.float32([[0.5, 0.1, 1.24], [0.62, 0.1, 1.0], [0.5, -0.26, 1.0]])
    # the sphere is made of triangles, so its fitted radius is a little small
    assert np.allclose(frame.to_fitted(points), [[0, 0, 2], [1, 0, 0], [0, -3, 0]], atol=0.02)


def test_the_scalp_comes_to_radius_one(head: Head) -> None:
    frame = frame_of_head(head)
    scalp = submesh(head, head.scalp).vertices
    radius = np.linalg.norm(frame.to_fitted(scalp), axis=1)
    assert np.median(np.abs(radius - 1.0)) < 0.01 and np.abs(radius - 1.0).max() < 0.12


@pytest.mark.parametrize("factors", [(1.0, 1.0, 1.0), (1.3, 0.9, 0.85), (0.8, 1.2, 1.15)])
@pytest.mark.parametrize("shape", ["cap", "long"])
def test_roots_on_the_scalp_and_nothing_inside(head: Head, factors: tuple[float, float, float], shape: str) -> None:
    fitted = frame_of_head(head).to_fitted(resample(simple_hair(head, shape, 400), 12))
    other = stretched(head, factors)
    strands, kept = fit_to_head(fitted, other, frame_of_head(other))
    assert kept.mean() > 0.98
    scalp = HeadSurface(submesh(other, other.scalp))
    assert np.abs(scalp.signed_distance(strands[:, 0])).max() < 1e-5
    surface = HeadSurface(other)
    assert surface.signed_distance(strands[:, 1:].reshape(-1, 3)).min() > 0
    middles = 0.5 * (strands[:, 1:] + strands[:, :-1])
    # chords may cut ears and the edges of hollows by a hair's breadth
    inside = surface.signed_distance(middles[:, 1:].reshape(-1, 3)) < -5e-4
    assert inside.mean() < 0.005


def test_hair_hangs_as_on_its_own_head(head: Head) -> None:
    """Ends of hanging hair lie as many head radii below the middle on every head, straight down."""
    own = simple_hair(head, "long", 300)
    frame = frame_of_head(head)
    fitted = frame.to_fitted(resample(own, 12))
    other = stretched(head, (1.2, 1.2, 1.2))
    strands, _ = fit_to_head(fitted, other, frame_of_head(other))
    scaled = frame_of_head(other)
    drop = (strands[:, -1, 2] - scaled.centre[2]) / scaled.radius
    assert np.abs(np.median(drop) - np.median(fitted[:, -1, 2])) < 0.02


def test_strands_without_a_scalp_are_left_out(head: Head) -> None:
    fitted = frame_of_head(head).to_fitted(resample(simple_hair(head, "cap", 400), 6))
    middle = frame_of_head(head).centre
    crown = head.scalp & (head.vertices[head.triangles].mean(axis=1)[:, 2] > middle[2] + 0.05)
    strands, kept = fit_to_head(fitted, replace(head, scalp=crown), frame_of_head(head))
    assert 0.2 < kept.mean() < 0.95
    assert len(strands) == kept.sum()
    with pytest.raises(InputError, match="larger scalp"):
        fit_to_head(np.float32([[[0.0, 0.0, -1.0], [0.0, 0.0, -1.5]]]), replace(head, scalp=crown), frame_of_head(head))


def test_a_tail_in_the_air_stays_where_it_is(head: Head) -> None:
    frame = frame_of_head(head)
    tail = np.float32([[[0.0, 1.6, 0.0], [0.0, 1.8, -1.0], [0.0, 1.8, -2.0]]])
    strands, kept = fit_to_head(tail, head, frame)
    assert kept.all()
    assert np.abs(strands - frame.to_world(tail)).max() < 1e-6


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_head_and_face_are_found_from_roots(head: Head, quarter: int) -> None:
    truth = frame_of_head(head)
    roots = simple_hair(head, "cap", 800).roots.astype(np.float64)
    angle = 0.5 * np.pi * quarter
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    frame = frame_of_roots(2.0 * roots @ turn.T + [1.0, 2.0, 3.0])
    assert frame.radius == pytest.approx(2.0 * truth.radius, rel=0.05)
    assert np.linalg.norm(frame.centre - (2.0 * turn @ truth.centre + [1.0, 2.0, 3.0])) < 0.1 * frame.radius
    assert np.allclose(frame.turn, turn.T, atol=1e-9)


def test_roots_that_tell_no_head_are_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="head's mesh"):
        frame_of_roots(rng.normal(size=(5, 3)))
    with pytest.raises(InputError, match="one place"):
        frame_of_roots(np.zeros((50, 3)))
    with pytest.raises(InputError, match="no round head"):
        frame_of_roots(rng.uniform(-1, 1, (500, 3)) * [1.0, 1.0, 0.01])
