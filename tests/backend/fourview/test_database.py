"""The database and its search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from database_scenes import SHAPES, camera_of, simple_hair, view_of
from hairloom.errors import InputError
from hairloom.fourview.database import HairDatabase, SearchParams, distance_field, mask_distance, search
from hairloom.fourview.database_entries import entry_head, make_hairstyle
from hairloom.fourview.database_fit import frame_of_head
from hairloom.fourview.database_masks import (
    COLUMNS,
    ROWS,
    backdrop,
    grid_backdrops,
    grid_camera,
    grid_masks,
    render_mask,
    view_grid,
)
from hairloom.fourview.views import View
from hairloom.geometry.camera import STANDARD_DIRECTIONS, orthographic_camera, perspective_camera
from hairloom.geometry.head import default_head
from hairloom.types import Bools, Head


@pytest.fixture(scope="module")
def head() -> Head:
    return default_head()


@pytest.fixture(scope="module")
def database(head: Head) -> HairDatabase:
    fitted = entry_head(head)
    return HairDatabase(
        tuple(make_hairstyle(name, simple_hair(head, name), fitted, tags=(name,), family=name[0]) for name in SHAPES)
    )


def four_views(head: Head, shape: str, seed: int = 7, names: tuple[str, ...] = ("front", "back", "left", "right")):
    strands = simple_hair(head, shape, 1200, seed=seed)
    return [view_of(strands, head, camera_of(name, head), name) for name in names]


def naive_distance(mask: Bools, other: Bools) -> float:
    """Eq. (1) from all pairs of pixels: |D| is the distance to the nearest of the other kind, less 1/2."""
    places = np.argwhere(np.ones(mask.shape, bool)).astype(float)
    inside = mask.ravel()
    total = 0.0
    for index in np.flatnonzero((mask ^ other).ravel()):
        total += np.linalg.norm(places[inside != inside[index]] - places[index], axis=1).min() - 0.5
    return total / mask.sum()


def test_equation_1_agrees_with_looking_at_all_pixels() -> None:
    rng = np.random.default_rng(0)
    first, second = (np.kron(rng.random((6, 5)) > 0.5, np.ones((3, 3))).astype(bool) for _ in range(2))
    # OpenCV's exact distances are float32
    assert mask_distance(first, second, 1.0) == pytest.approx(naive_distance(first, second), rel=1e-5)
    assert mask_distance(first, first, 1.0) == 0.0
    assert mask_distance(first, second, 0.5) == pytest.approx(0.5 * naive_distance(first, second), rel=1e-5)


def test_a_mask_that_is_all_hair_has_a_distance() -> None:
    assert mask_distance(np.ones((4, 4), bool), np.zeros((4, 4), bool), 1.0) == 1.0
    assert np.isfinite(distance_field(np.ones((4, 4), bool))).all()
    with pytest.raises(InputError, match="empty"):
        mask_distance(np.zeros((4, 4), bool), np.ones((4, 4), bool), 1.0)


def test_the_grid_has_the_classes_of_view() -> None:
    directions = view_grid()
    assert np.allclose(np.linalg.norm(directions, axis=1), 1.0)
    for direction in STANDARD_DIRECTIONS.values():
        assert (directions @ np.array(direction)).max() == pytest.approx(1.0)


def test_grid_cameras_show_the_same_head_at_the_same_size() -> None:
    for direction in view_grid():
        camera = grid_camera(direction)
        assert camera.size == (COLUMNS, ROWS)
        assert np.allclose(camera.world_to_camera[2, :3], direction)


def test_the_mask_of_a_ball_of_hair_is_its_disc(head: Head) -> None:
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(6000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ball = (directions[:, None] * np.linspace(1.0, 2.0, 8)[None, :, None]).astype(np.float32)
    far = replace(head, vertices=head.vertices * np.float32(0.01))
    masks = np.unpackbits(grid_masks(ball, grid_backdrops(far)), axis=1).sum(axis=1)
    # a disc of radius 20 half cells, whose border is blurred by one
    assert np.abs(masks / (np.pi * 20.0**2) - 1.0).max() < 0.06


def test_the_head_hides_hair_behind_it(head: Head) -> None:
    frame = frame_of_head(head)
    camera = camera_of("front", head)
    grid = np.linspace(-0.3, 0.3, 40)
    x, z = (a.ravel() for a in np.meshgrid(grid, grid))
    curtain = frame.centre + frame.radius * np.stack(
        [np.stack([x, np.full(1600, 3.0), z + 0.02 * k], 1) for k in (0, 1)], 1
    )
    behind, before = (
        render_mask(camera, curtain + np.array([0.0, shift * frame.radius, 0.0]), backdrop(camera, head), 1.3, 0.002)
        for shift in (0.0, -6.0)
    )
    assert not behind.any() and before.sum() > 50


@pytest.mark.parametrize("shape", SHAPES)
def test_every_hairstyle_is_found_from_its_masks(database: HairDatabase, head: Head, shape: str) -> None:
    found = search(database, four_views(head, shape), head, n_best=3)
    assert found[0].name == shape and database.names[found[0].index] == shape
    assert found[0].distance < 0.3 * found[1].distance
    assert [match.distance for match in found] == sorted(match.distance for match in found)
    assert found[0].distance == pytest.approx(found[0].per_view.sum())


@pytest.mark.parametrize("count", [1, 2, 3, 8])
def test_one_to_eight_views(database: HairDatabase, head: Head, count: int) -> None:
    strands = simple_hair(head, "tent", 1200, seed=3)
    views = []
    for number in range(count):  # not on the grid's directions
        angle = 0.19 + 2.0 * np.pi * number / count
        centre = frame_of_head(head).centre
        camera = orthographic_camera((-np.sin(angle), np.cos(angle), -0.2), centre, 250.0, (180, 220))
        views.append(view_of(strands, head, camera, f"view {number}"))
    found = search(database, views, head)
    assert [match.name for match in found] == ["tent"] and found[0].per_view.shape == (count,)


def test_the_first_pass_alone_finds_it_too(database: HairDatabase, head: Head) -> None:
    """With one rendered, the precomputed masks must have put the right one first."""
    for shape in SHAPES:
        assert search(database, four_views(head, shape), head, params=SearchParams(n_refined=1))[0].name == shape


def test_left_and_right_are_not_mixed_up(database: HairDatabase, head: Head) -> None:
    mirrored = [
        View(view.name, view.image, np.ascontiguousarray(view.mask[:, ::-1]), view.camera)
        for view in four_views(head, "half", names=("front",))
    ]
    right, wrong = (
        next(m.distance for m in search(database, views, head, n_best=9) if m.name == "half")
        for views in (four_views(head, "half", names=("front",)), mirrored)
    )
    assert wrong > 5.0 * right


def test_moved_and_scaled_heads_find_the_same(database: HairDatabase, head: Head) -> None:
    move = np.float32([1.0, -2.0, 0.5])
    other = replace(head, vertices=1.3 * head.vertices + move)
    first = search(database, four_views(head, "long"), head)[0]
    second = search(database, four_views(other, "long"), other)[0]
    assert second.name == first.name
    # distances are in head radii
    assert second.distance == pytest.approx(first.distance, rel=0.3, abs=0.003)


def test_perspective_cameras(database: HairDatabase, head: Head) -> None:
    centre = frame_of_head(head).centre
    camera = perspective_camera(centre + np.array([0.9, -0.9, 0.2]), centre - [0.0, 0.0, 0.05], 350.0, (200, 240))
    assert search(database, [view_of(simple_hair(head, "ball", 1500), head, camera, "a")], head)[0].name == "ball"


def test_excluded_hairstyles_are_not_found(database: HairDatabase, head: Head) -> None:
    views = four_views(head, "long")
    assert search(database, views, head, exclude=["long"])[0].name != "long"
    assert database.named("l") == ("long",)
    with pytest.raises(InputError, match="excluded"):
        search(database, views, head, exclude=database.names)


def test_bad_input(database: HairDatabase, head: Head) -> None:
    views = four_views(head, "cap", names=("front",))
    with pytest.raises(InputError, match="0 views"):
        search(database, [], head)
    with pytest.raises(InputError, match="9 views"):
        search(database, views * 9, head)
    with pytest.raises(InputError, match="n_best"):
        search(database, views, head, n_best=0)
    with pytest.raises(InputError, match="no hairstyle 9"):
        database.strands(9, head)
    with pytest.raises(InputError, match="no hairstyle 'x'"):
        database.index("x")
    with pytest.raises(InputError, match="same name"):
        HairDatabase(database.styles + database.styles[:1])
    with pytest.raises(InputError, match="n_refined"):
        SearchParams(n_refined=0)


def test_a_mask_beside_the_head_is_no_error(database: HairDatabase, head: Head) -> None:
    view = four_views(head, "cap", names=("front",))[0]
    mask = np.zeros_like(view.mask)
    mask[:2, :2] = True
    assert len(search(database, [replace(view, mask=mask)], head)) == 1


def test_strands_are_on_the_head(database: HairDatabase, head: Head) -> None:
    for index in range(len(database)):
        strands = database.strands(index, head)
        assert strands.n_strands > 0.9 * database.styles[index].n_strands
        assert strands.points.dtype == np.float32
