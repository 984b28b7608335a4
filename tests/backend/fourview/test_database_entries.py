"""Grooms and folders of the user in the database."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from database_scenes import camera_of, simple_hair, view_of
from hairloom.errors import InputError
from hairloom.fourview.database import open_database, search
from hairloom.fourview.database_entries import (
    CACHE_SUFFIX,
    EntryParams,
    entry_head,
    guessed_head,
    make_hairstyle,
    read_folder,
)
from hairloom.fourview.database_files import read_hairstyles, write_hairstyles
from hairloom.geometry.head import default_head
from hairloom.io.strands import write_strands
from hairloom.types import Head


@pytest.fixture(scope="module")
def head() -> Head:
    return default_head()


def write_head(path: Path, head: Head) -> None:
    """An .obj in metres, y up."""
    x, y, z = head.vertices.T
    lines = [f"v {a} {b} {c}" for a, b, c in zip(x, z, -y)]
    lines += [f"f {a} {b} {c}" for a, b, c in head.triangles + 1]
    path.write_text("\n".join(lines) + "\n")


def test_an_entry_keeps_some_strands_of_many(head: Head) -> None:
    groom = simple_hair(head, "long", 900)
    style = make_hairstyle("a", groom, entry_head(head), params=EntryParams(n_strands=200, n_points=7))
    assert (style.n_strands, style.n_points) == (200, 7)
    again = make_hairstyle("a", groom, entry_head(head), params=EntryParams(n_strands=200, n_points=7))
    assert again.packed == style.packed and np.array_equal(again.masks, style.masks)
    few = make_hairstyle("b", simple_hair(head, "long", 50), entry_head(head))
    assert few.n_strands == 50


def test_kept_strands_are_spread_evenly(head: Head) -> None:
    groom = simple_hair(head, "cap", 900)
    style = make_hairstyle("a", groom, entry_head(head), params=EntryParams(n_strands=100))
    roots = style.points()[:, 0]
    own = entry_head(head).frame.to_fitted(groom.roots)
    assert np.abs(roots.mean(axis=0) - own.mean(axis=0)).max() < 0.05


def test_a_folder_joins_in(head: Head, tmp_path: Path) -> None:
    write_strands(tmp_path / "long one.hair", simple_hair(head, "long"))
    write_strands(tmp_path / "ball.npz", simple_hair(head, "ball"))
    write_strands(tmp_path / "half.data", simple_hair(head, "half"))
    (tmp_path / "notes.txt").write_text("no hair")
    (tmp_path / "broken.hair").write_bytes(b"HAIR" + b"x" * 300)
    write_head(tmp_path / "head.obj", head)
    write_hairstyles(tmp_path / "empty.db", [])
    database = open_database(tmp_path / "empty.db", [tmp_path])
    assert database.names == ("ball", "half", "long one")
    assert len(database.remarks) == 1 and "broken.hair" in database.remarks[0]
    assert (tmp_path / f"ball.npz{CACHE_SUFFIX}").is_file()
    for shape, name in (("ball", "ball"), ("long", "long one"), ("half", "half")):
        strands = simple_hair(head, shape, seed=4)
        views = [view_of(strands, head, camera_of(view, head), view) for view in ("front", "left")]
        assert search(database, views, head)[0].name == name


def test_the_cache_is_used_until_the_groom_changes(head: Head, tmp_path: Path) -> None:
    groom = tmp_path / "mine.hair"
    write_strands(groom, simple_hair(head, "long"))
    first = read_folder(tmp_path)[0][0]
    cache = tmp_path / f"mine.hair{CACHE_SUFFIX}"
    before = cache.read_bytes()
    assert read_folder(tmp_path)[0][0].packed == first.packed and cache.read_bytes() == before
    write_strands(groom, simple_hair(head, "ball"))
    assert read_folder(tmp_path)[0][0].packed != first.packed and cache.read_bytes() != before
    cache.write_bytes(b"damaged")
    styles, remarks = read_folder(tmp_path)
    assert len(styles) == 1 and "made again" in remarks[0]
    assert len(read_hairstyles(cache)) == 1


def test_a_hairstyle_file_without_its_groom_counts(head: Head, tmp_path: Path) -> None:
    style = make_hairstyle("handed on", simple_hair(head, "tent"), entry_head(head))
    write_hairstyles(tmp_path / f"any{CACHE_SUFFIX}", [style])
    assert [found.name for found in read_folder(tmp_path)[0]] == ["handed on"]


def test_names_that_are_taken_get_a_number(head: Head, tmp_path: Path) -> None:
    style = make_hairstyle("ball", simple_hair(head, "ball"), entry_head(head))
    for name in ("a", "b"):
        write_hairstyles(tmp_path / f"{name}{CACHE_SUFFIX}", [style])
    write_hairstyles(tmp_path / "base.db", [style])
    assert open_database(tmp_path / "base.db", [tmp_path]).names == ("ball", "ball (2)", "ball (3)")


def test_a_guessed_head_is_about_the_real_one(head: Head) -> None:
    groom = simple_hair(head, "ball")
    known, guessed = (make_hairstyle("x", groom, frame).masks for frame in (entry_head(head), guessed_head(groom)))
    both, either = np.unpackbits(known & guessed).sum(), np.unpackbits(known | guessed).sum()
    assert both / either > 0.85


def test_bad_input(head: Head, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no folder"):
        read_folder(tmp_path / "nowhere")
    with pytest.raises(InputError, match="n_points"):
        EntryParams(n_points=1)
