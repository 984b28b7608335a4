"""The hairstyles that Hairloom ships: many, different, on the scalp, and the recipes that they are made by."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hairloom.fourview.database import DATABASE_PATH, HairDatabase, open_database
from hairloom.fourview.database_fit import fit_to_head, frame_of_head
from hairloom.fourview.database_masks import COLUMNS, ROWS
from hairloom.geometry.head import HeadSurface, default_head, submesh
from hairloom.geometry.strands import resample, strand_lengths

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "blend_templates"))
import make_database  # noqa: E402
from hairstyle_shapes import Hair, Tie, cut, keep, strip, sweep, tie, trim  # noqa: E402


@pytest.fixture(scope="module")
def database() -> HairDatabase:
    return open_database()


def test_many_different_hairstyles(database: HairDatabase) -> None:
    assert len(database) >= 200
    assert DATABASE_PATH.stat().st_size <= 8_000_000
    families = Counter(style.family for style in database.styles)
    assert len(families) >= 30 and max(families.values()) < 0.12 * len(database)
    assert all(style.tags for style in database.styles)
    # shaved heads have few
    assert np.quantile([style.n_strands for style in database.styles], 0.1) >= 600
    assert min(style.n_strands for style in database.styles) >= 150


def test_no_two_hairstyles_are_the_same(database: HairDatabase) -> None:
    """The masks of the four sides and from above differ by a cell for each 60 of them, at the least."""
    chosen = [0, 4, 8, 12, 38]
    masks = np.stack([np.unpackbits(style.masks[chosen]) for style in database.styles]).astype(np.float32)
    common = masks @ masks.T
    area = masks.sum(axis=1)
    overlap = common / (area[:, None] + area[None] - common)
    np.fill_diagonal(overlap, 0.0)
    alike = overlap > 1.0 - 1.0 / 60.0
    # straight and wavy hair of one length and cut may share their outlines, not their strands
    assert alike.any(axis=1).mean() < 0.1


def test_lengths_and_widths_are_spread(database: HairDatabase) -> None:
    masks = np.stack([np.unpackbits(style.masks[8]).reshape(ROWS, COLUMNS) for style in database.styles])  # the back
    lowest = ROWS - 1 - masks.any(axis=2)[:, ::-1].argmax(axis=1)
    widest = masks.sum(axis=2).max(axis=1)
    # cells of a tenth of a head radius: from the ears to the waist, from the skull to three heads wide
    assert np.ptp(np.quantile(lowest, [0.05, 0.95])) > 35
    assert np.ptp(np.quantile(widest, [0.02, 0.98])) > 18


def test_all_is_made_by_the_script(database: HairDatabase) -> None:
    assert database.names == tuple(make_database.all_by_name())
    for name, made in make_database.all_by_name().items():
        style = database.styles[database.index(name)]
        assert (style.tags, style.family, style.n_points) == (made.tags, made.family, made.n_points)


def test_one_made_again_is_the_same(database: HairDatabase) -> None:
    again = make_database.make_entry("pony tail, high, long")
    shipped = database.styles[database.index(again.name)]
    # to the byte on the machine that made it; elsewhere the compiler's rounding may move a strand
    assert np.abs(again.points().mean(axis=(0, 1)) - shipped.points().mean(axis=(0, 1))).max() < 0.02
    assert np.mean(np.unpackbits(again.masks) != np.unpackbits(shipped.masks)) < 0.002


def test_on_a_head_roots_are_on_the_scalp_and_nothing_is_inside(database: HairDatabase) -> None:
    head = default_head()
    frame, surface, scalp = frame_of_head(head), HeadSurface(head), HeadSurface(submesh(head, head.scalp))
    for index in range(0, len(database), 29):
        strands, kept = fit_to_head(database.styles[index].points(), head, frame)
        assert kept.mean() > 0.97
        assert np.abs(scalp.signed_distance(strands[:, 0])).max() < 1e-5
        assert surface.signed_distance(strands[:, 1:].reshape(-1, 3)).min() > 0


def hair(n_strands: int = 300) -> Hair:
    """Straight strands 2 head radii long that stand off the scalp."""
    collider = make_database.collider()
    roots = collider.to_unit(make_database.grow_style(make_database.recipes()[0].style, collider, n_strands, 4).roots)
    out = roots / np.linalg.norm(roots, axis=1, keepdims=True)
    strands = roots[:, None] + out[:, None] * np.linspace(0.0, 2.0, 21)[None, :, None]
    return Hair(strands, np.zeros(n_strands, np.int32), collider)


def test_steps_cut_shave_and_turn() -> None:
    before, rng = hair(), np.random.default_rng(0)
    assert np.abs(keep(strip(0.2))(before, rng).roots[:, 0]).max() < 0.3
    half = trim(0.5, spread=0.0)(before, rng).strands
    assert np.allclose(np.linalg.norm(half[:, -1] - half[:, 0], axis=1), 1.0)
    flat = cut(1.5, over=True, spread=0.0)(before, rng).strands
    assert flat[..., 2].max() <= 1.5 + 0.1  # one step of the strands
    turned = sweep(90.0, lambda roots: np.ones(len(roots)), reach=1e-6)(before, rng).strands[:, -1]
    last = before.strands[:, -1]
    # the left goes to the back; strands that the turn brings into the head are pushed out of it
    off = np.abs(turned - np.stack([-last[:, 1], last[:, 0], last[:, 2]], axis=1)).max(axis=1)
    assert np.median(off) < 1e-6


def test_tied_hair_meets_at_the_tie() -> None:
    before, rng = hair(), np.random.default_rng(0)
    made = Tie((0.0, 1.0, 0.3), length=1.5)
    tied = tie(made)(before, rng).strands
    assert np.array_equal(tied[:, 0], before.roots)
    knot = np.array([0.0, 1.0, 0.3]) / np.hypot(1.0, 0.3)
    nearest = np.linalg.norm(tied - knot * 1.25, axis=2).min(axis=1)
    assert np.quantile(nearest, 0.95) < 0.35
    assert tied[:, -1, 2].max() < 0.2 and tied[:, -1, 1].min() > 0.6


def test_the_stored_style_keeps_the_silhouette_of_the_full_groom(database: HairDatabase) -> None:
    """Masks of the stored strands against those of the grown ones, whose points are twice as many."""
    from database_scenes import camera_of, view_of

    head = default_head()
    recipe = make_database.recipe_named("wavy to the chest, middle parting")
    full = make_database.grow_recipe(recipe)
    stored = database.strands(database.index(recipe.name), head)
    assert strand_lengths(stored).mean() == pytest.approx(strand_lengths(full).mean(), rel=0.05)
    assert resample(full, 8).shape[0] > stored.n_strands
    for name in ("front", "left"):
        first, second = (view_of(each, head, camera_of(name, head, 240), name).mask for each in (full, stored))
        # thin locks and the border differ where fewer strands are as dense as hair
        assert (first & second).sum() / (first | second).sum() > 0.92
