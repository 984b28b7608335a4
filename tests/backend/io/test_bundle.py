"""Bundles: every kind of value comes back as it went, and a file cannot make anything else."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from hairloom.errors import FileError, InputError
from hairloom.io import bundle
from hairloom.io.bundle import TYPES, read_bundle, write_bundle
from hairloom.io.npz import read_arrays, write_arrays
from hairloom.types import FeatureMap, Head, RootedStrands, StrandSet, WispHierarchy


def rooted(n_strands: int) -> RootedStrands:
    rng = np.random.default_rng(n_strands)
    return RootedStrands(
        rng.random((n_strands, 3)).astype(np.float32),
        np.tile(np.eye(3, dtype=np.float32), (n_strands, 1, 1)),
        rng.random((n_strands, 2)).astype(np.float32),
        rng.random((n_strands, 5, 3)).astype(np.float32),
    )


def values() -> dict[str, object]:
    points = np.arange(15, dtype=np.float32).reshape(5, 3)
    strands = StrandSet(
        points,
        np.array([0, 2, 5], dtype=np.int32),
        {"radius": np.ones(5, dtype=np.float32)},
        {"hairloom_wisp": np.array([1, 0], dtype=np.int32)},
    )
    head = Head(points, np.array([[0, 1, 2]], dtype=np.int32), np.array([True]), np.zeros((1, 3, 2), dtype=np.float32))
    return {
        "strands": strands,
        "head": head,
        "hierarchy": WispHierarchy((rooted(4), rooted(2)), (np.array([0, 1, 1, 0], dtype=np.int32),)),
        "map": FeatureMap(np.zeros((2, 3, 4), np.float32), np.ones((2, 3), bool), np.array([0.5, 0.25]), 0.1),
        "nothing": None,
        "mixed": (1, 2.5, "text", True, [None, (3,)], {"a": {"b": np.arange(4)}}),
        "scalar": np.float32(0.5),
        "infinite": -math.inf,
        "empty": np.zeros((0, 3), dtype=np.float32),
        "turned": np.asfortranarray(np.arange(6).reshape(2, 3)),
        "": "a nameless value",
    }


def same(have: object, want: object) -> bool:
    if isinstance(want, np.ndarray):
        return isinstance(have, np.ndarray) and have.dtype == want.dtype and np.array_equal(have, want)
    if dataclasses.is_dataclass(want):
        return type(have) is type(want) and all(
            same(getattr(have, f.name), getattr(want, f.name)) for f in dataclasses.fields(want)
        )
    if isinstance(want, list | tuple):
        return type(have) is type(want) and len(have) == len(want) and all(map(same, have, want))
    if isinstance(want, dict):
        return isinstance(have, dict) and have.keys() == want.keys() and all(same(have[k], want[k]) for k in want)
    return have == want


def test_values_come_back_as_they_went(tmp_path):
    write_bundle(tmp_path / "values.npz", values())
    back = read_bundle(tmp_path / "values.npz")
    for name, want in values().items():
        assert same(back[name], want), name
    back["empty"].resize((1, 3))
    back["mixed"][5]["a"]["b"][0] = 7  # arrays are the reader's own


def test_same_values_same_bytes(tmp_path):
    write_bundle(tmp_path / "a.npz", values())
    write_bundle(tmp_path / "b.npz", values())
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_every_allowed_type_exists():
    for name in TYPES:
        assert dataclasses.is_dataclass(bundle._class(name))


@pytest.mark.parametrize(
    "value", [{1, 2}, {"a": {3: 4}}, np.array([object()]), lambda: None, np.zeros(2, dtype="f4,i4")]
)
def test_other_values_are_refused_before_the_file_changes(tmp_path, value):
    path = tmp_path / "values.npz"
    path.write_bytes(b"before")
    with pytest.raises(InputError):
        write_bundle(path, {"value": value})
    assert path.read_bytes() == b"before" and len(list(tmp_path.iterdir())) == 1


def test_a_class_of_the_same_name_is_refused(tmp_path):
    @dataclasses.dataclass
    class StrandSet:
        points: int

    with pytest.raises(InputError, match="StrandSet"):
        write_bundle(tmp_path / "values.npz", {"value": StrandSet(1)})


def test_endless_nesting_is_refused(tmp_path):
    nested: list[object] = []
    nested.append(nested)
    with pytest.raises(InputError, match="deep"):
        write_bundle(tmp_path / "values.npz", {"value": nested})


def _deep(levels: int) -> object:
    node: object = None
    for _ in range(levels):
        node = {"list": [node]}
    return node


@pytest.mark.parametrize(
    "node",
    [
        {"type": "Popen", "fields": {}},
        {"type": "StrandSet", "fields": {}},
        {"type": "StrandSet", "fields": {"points": 1, "offsets": 2, "point_attributes": 3, "strand_attributes": 4}},
        {"type": "RootedStrands", "fields": {"roots": None, "frames": None, "uv": None, "points": None}},
        {"array": "array9"},
        {"float": "1e5"},
        {"dict": [1]},
        {"unknown": 1},
        [1, 2],
        _deep(200),
    ],
)
def test_damaged_manifests_are_refused(tmp_path, node):
    path = tmp_path / "values.npz"
    manifest = json.dumps({"format": bundle.FORMAT, "version": bundle.VERSION, "values": {"value": node}})
    with path.open("wb") as stream:
        write_arrays(stream, {"manifest": np.array(manifest)})
    with pytest.raises(FileError, match=r"values\.npz"):
        read_bundle(path)


def test_invalid_content_of_a_type_is_refused(tmp_path):
    """A strand set with a NaN, as a damaged file could hold it."""
    path = tmp_path / "values.npz"
    write_bundle(path, {"strands": values()["strands"]})
    arrays = read_arrays(path, path.read_bytes())
    arrays["array0"][0, 0] = np.nan
    with path.open("wb") as stream:
        write_arrays(stream, arrays)
    with pytest.raises(FileError, match="NaN"):
        read_bundle(path)


def test_strand_files_are_no_bundles(tmp_path):
    path = tmp_path / "strands.npz"
    np.savez(path, points=np.zeros(3))
    with pytest.raises(FileError, match="manifest"):
        read_bundle(path)
