"""Strokes and their file: what was written comes back to the bit, and what is damaged is refused in one line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hairloom.editing.strokes import (
    CombParams,
    Stroke,
    StrokeFile,
    View,
    comb_params,
    read_strokes,
    stroke_from_json,
    stroke_to_json,
    write_strokes,
)
from hairloom.errors import FileError, InputError


def stroke(n_samples: int = 5, selection: np.ndarray | None = None) -> Stroke:
    rng = np.random.default_rng(3)
    matrix = np.eye(4) + 0.1 * rng.normal(size=(4, 4))
    samples = np.column_stack([rng.uniform(0, 1000, (n_samples, 2)), rng.uniform(0, 1, n_samples)])
    params = CombParams(mode="twist", radius=10 / 3, profile=(0.1, 0.2, 0.3), mirror=(True, False, False))
    return Stroke(params, View(matrix, 801.0, 600.0), np.eye(4), samples, selection)


def test_a_stroke_comes_back_to_the_bit() -> None:
    selection = np.random.default_rng(0).random(50).astype(np.float32)
    before = stroke(selection=selection)
    after = stroke_from_json(stroke_to_json(before))
    assert after.params == before.params
    assert after.view.width == 801.0
    for name in ("frame", "samples", "selection"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
        assert getattr(after, name).dtype == getattr(before, name).dtype
    np.testing.assert_array_equal(after.view.matrix, before.view.matrix)


def test_a_file_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "strokes.json"
    write_strokes(path, StrokeFile(10, 80, (stroke(), stroke(2))))
    file = read_strokes(path)
    assert (file.n_strands, file.n_points, len(file.strokes)) == (10, 80, 2)
    assert stroke_to_json(file.strokes[1]) == stroke_to_json(stroke(2))


def test_strokes_for_another_groom_are_refused() -> None:
    file = StrokeFile(10, 80, ())
    file.check(10, 80, "a.json")
    with pytest.raises(InputError, match=r"a\.json was recorded on a groom of 10 strands and 80 points"):
        file.check(10, 81, "a.json")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mode": "iron"}, "mode is 'iron'"),
        ({"radius": 0.0}, "radius is 0.0"),
        ({"radius": float("nan")}, "radius is nan"),
        ({"strength": 1.5}, "strength is 1.5"),
        ({"slip": -0.1}, "slip is -0.1"),
        ({"profile": (0.0, 2.0, 0.0)}, "profile is"),
        ({"level": 7}, "level is 7"),
    ],
)
def test_bad_params(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(CombParams(), **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"radius": "wide"}, "'radius' of the stroke must be a number"),
        ({"radius": True}, "must be a number"),
        ({"sharpness": 1.0}, "no setting 'sharpness'"),
        ({"through": 1}, "through must be bool"),
        ({"mirror": [True]}, "mirror must have 3 values"),
        ({"level": 1.0}, "level must be int"),
        ([], "group of values"),
    ],
)
def test_params_of_the_wrong_kind(values: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        comb_params(values)


def broken(change: object) -> str:
    values = json.loads(stroke_to_json(stroke()))
    change(values)  # type: ignore[operator]
    return json.dumps(values)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "no JSON"),
        ("[]", "group of values"),
        (broken(lambda v: v.pop("samples")), "no 'samples'"),
        (broken(lambda v: v.update(samples=[])), "2 dimensions"),
        (broken(lambda v: v.update(samples=[[1, 2]])), r"shape \(n, 3\)"),
        (broken(lambda v: v.update(samples=[[1, 2, 3]])), "pressure"),
        (broken(lambda v: v.update(samples=[[1, 2, 1], [1]])), "rows of one length"),
        (broken(lambda v: v.update(samples=[["x", 2, 1]])), "must be numbers"),
        (broken(lambda v: v.update(frame=np.zeros((4, 4)).tolist())), "cannot be inverted"),
        (broken(lambda v: v["view"].update(width=0)), "needs a size"),
        (broken(lambda v: v["view"].pop("matrix")), "incomplete"),
        (broken(lambda v: v.update(selection=[0.5, 2.0])), "selection"),
        (broken(lambda v: v.update(samples=[[1, float("inf"), 1]])), "NaN or infinite"),
    ],
)
def test_damaged_strokes(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        stroke_from_json(text)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\xff\xfe", "no JSON"),
        (b"[" * 100_000, "no JSON"),
        (b"{}", "no hairloom-strokes"),
        (b'{"format": "hairloom-strokes", "version": 9}', "version 1"),
        (b'{"format": "hairloom-strokes", "version": 1, "strands": 1, "points": "x", "strokes": []}', "lacks"),
        (b'{"format": "hairloom-strokes", "version": 1, "strands": 1, "points": 2, "strokes": [{}]}', "stroke 1"),
    ],
)
def test_damaged_files(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "bad.json"
    path.write_bytes(content)
    with pytest.raises(FileError, match=message) as error:
        read_strokes(path)
    assert "bad.json" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no such file"):
        read_strokes(tmp_path / "none.json")
