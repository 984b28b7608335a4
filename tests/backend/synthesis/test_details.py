"""Details as a small file: what is kept, how close its transfer is, and files that are no details."""

import numpy as np
import pytest
from hairloom.errors import FileError, InputError
from hairloom.geometry.strands import from_dense
from hairloom.io.bundle import write_bundle
from hairloom.io.strands import write_strands
from hairloom.synthesis.details import Detail, holds_detail, read_detail, reduce_details, write_detail
from hairloom.types import RootedStrands, WispHierarchy


def hair(n_coarse=10, per_coarse=8, per_wisp=12, n_points=16, seed=0):
    """Three levels of random strands, shuffled, every wisp around a root of its own."""
    rng = np.random.default_rng(seed)
    labels1 = np.repeat(np.arange(n_coarse, dtype=np.int32), per_coarse)
    labels0 = rng.permutation(np.repeat(np.arange(len(labels1), dtype=np.int32), per_wisp))
    counts = (len(labels0), len(labels1), n_coarse)
    top = rng.normal(size=(n_coarse, 3))
    middle = top[labels1] + 0.1 * rng.normal(size=(counts[1], 3))
    roots = (middle[labels0] + 0.02 * rng.normal(size=(counts[0], 3)), middle, top)
    levels = []
    for count, place in zip(counts, roots):
        points = np.cumsum(rng.normal(0, 0.1, (count, n_points, 3)), axis=1)
        frames = np.tile(np.eye(3), (count, 1, 1))
        arrays = (place, frames, rng.uniform(0.5, 2.5, (count, 2)), points - points[:, :1])
        levels.append(RootedStrands(*(np.ascontiguousarray(a, dtype=np.float32) for a in arrays)))
    return WispHierarchy(tuple(levels), (labels0, labels1))


def rows_of(small, whole):
    """(n,) the rows of `whole` that `small` was taken from, by their bytes."""
    places = {strand.tobytes(): row for row, strand in enumerate(whole.points)}
    return np.array([places[strand.tobytes()] for strand in small.points])


def test_small_hair_is_kept_whole():
    whole = hair(n_coarse=5, per_coarse=4, per_wisp=5)
    small = reduce_details(whole, 400)
    for made, own in zip(small.levels, whole.levels):
        assert made.points.tobytes() == own.points.tobytes()
    for made, own in zip(small.labels, whole.labels):
        assert (made == own).all()


@pytest.mark.parametrize("n_strands", [1, 40, 320, 600])
def test_what_is_kept_is_as_it_was(n_strands):
    whole = hair()
    small = reduce_details(whole, n_strands)
    rows = [rows_of(made, own) for made, own in zip(small.levels, whole.levels)]
    for level, labels in enumerate(small.labels):
        assert small.levels[level].n_strands <= max(1, n_strands // 4**level)
        # each strand is in the wisp it was in, and no wisp is empty
        assert (rows[level + 1][labels] == whole.labels[level][rows[level]]).all()
        assert (np.bincount(labels, minlength=small.levels[level + 1].n_strands) > 0).all()
    again = reduce_details(whole, n_strands)
    assert again.levels[0].points.tobytes() == small.levels[0].points.tobytes()
    # the budget is used as far as the kept wisps have strands
    members = np.isin(whole.labels[0], rows[1]).sum()
    assert small.levels[0].n_strands == min(n_strands, members)


def test_the_strands_kept_are_spread_over_their_wisp():
    whole = hair(n_coarse=1, per_coarse=1, per_wisp=200)
    small = reduce_details(whole, 20)
    gaps = np.linalg.norm(small.levels[0].roots[:, None] - small.levels[0].roots[None], axis=2)
    closest = np.sort(gaps, axis=1)[:, 1].min()
    at_random = whole.levels[0].roots[:20]
    assert closest > 2 * np.sort(np.linalg.norm(at_random[:, None] - at_random[None], axis=2), axis=1)[:, 1].min()


def test_a_detail_survives_its_file(tmp_path):
    path = tmp_path / "curls.npz"
    whole = hair()
    write_detail(path, Detail("Curls", whole))
    back = read_detail(path)
    assert back.name == "Curls" and holds_detail(path)
    for made, own in zip(back.hierarchy.levels, whole.levels):
        assert made.points.tobytes() == own.points.tobytes() and made.frames.tobytes() == own.frames.tobytes()
    write_bundle(tmp_path / "clustered.npz", {"hierarchy": whole})  # as `hairloom cluster` writes
    assert read_detail(tmp_path / "clustered.npz").name == "clustered"


def test_the_default_size_is_an_asset_of_a_few_megabytes(tmp_path):
    whole = hair(n_coarse=200, per_coarse=4, per_wisp=20, n_points=64)
    write_detail(tmp_path / "d.npz", Detail("d", reduce_details(whole)))
    assert (tmp_path / "d.npz").stat().st_size < 3e6


def test_a_groom_is_no_detail(tmp_path):
    write_strands(tmp_path / "groom.npz", from_dense(np.random.default_rng(0).normal(size=(5, 4, 3))))
    assert not holds_detail(tmp_path / "groom.npz") and not holds_detail(tmp_path / "groom.hair")
    with pytest.raises(FileError, match=r"groom\.npz"):
        read_detail(tmp_path / "groom.npz")


def test_bad_files_and_numbers_are_refused(tmp_path):
    whole = hair()
    path = tmp_path / "d.npz"
    write_bundle(path, {"hierarchy": WispHierarchy(whole.levels[:1], ())})
    with pytest.raises(FileError, match="no wisp hierarchy of two levels"):
        read_detail(path)
    write_bundle(path, {"format": "hairloom-detail", "version": 9, "name": "d", "hierarchy": whole})
    with pytest.raises(FileError, match="version 1"):
        read_detail(path)
    write_bundle(path, {"strands": 3})
    with pytest.raises(FileError, match="no wisp hierarchy"):
        read_detail(path)
    write_bundle(path, {"name": 3, "hierarchy": whole})
    with pytest.raises(FileError, match="name is no text"):
        read_detail(path)
    empty = WispHierarchy(whole.levels, (np.zeros_like(whole.labels[0]), whole.labels[1]))
    write_bundle(path, {"hierarchy": empty})
    with pytest.raises(FileError, match="has no strands"):
        read_detail(path)
    short = whole.levels[0].with_points(np.ascontiguousarray(whole.levels[0].points[:, :5]))
    write_bundle(path, {"hierarchy": WispHierarchy((short, *whole.levels[1:]), whole.labels)})
    with pytest.raises(FileError, match="strands of"):
        read_detail(path)
    write_detail(path, Detail("d", whole))
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(FileError, match=r"d\.npz"):
        read_detail(path)
    with pytest.raises(FileError, match=r"none\.npz"):
        read_detail(tmp_path / "none.npz")
    with pytest.raises(InputError, match="one level has no details"):
        write_detail(path, Detail("d", WispHierarchy(whole.levels[:1], ())))
    with pytest.raises(InputError, match="n_strands is 0"):
        reduce_details(whole, 0)
