"""Strokes of the comb: what the brush was and where it went, and the JSON file in which strokes are kept (W-U5).

A stroke is all that its replay needs: the same groom and the same stroke give the same strands, to the byte, in the
viewport, in a script and on the command line.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import FileError, InputError, require
from ..io.files import atomic_write, damaged, read_file
from ..types import Float32, Float64

FORMAT, VERSION = "hairloom-strokes", 1
MODES = ("comb", "lift", "twist", "smooth", "length")


@dataclass(frozen=True, slots=True)
class CombParams:
    """Settings of the comb's brush. Defaults live here only."""

    mode: str = "comb"  # one of MODES
    radius: float = 50.0  # of the brush, pixels of the view
    strength: float = 1.0  # 0 .. 1; in `comb`, 1 holds the hair in the brush
    hardness: float = 0.7  # share of the radius in which the brush has its full strength; it fades to 0 at the edge
    profile: tuple[float, float, float] = (1.0, 1.0, 1.0)  # strength at root, middle and tip of a strand
    through: bool = False  # act on all hair under the brush; else only on the front, to the depth of the radius
    level: int = -1  # what is gripped: 0 single strands, 1 the smallest wisps, and so on; -1 the largest wisps
    drag: float = 0.3  # 0 .. 1, how much neighbouring wisps turn along
    slip: float = 1.0  # 0 .. 1, how freely the comb slides along the hair; 0 pulls at it
    only_first: bool = False  # keep to the wisps that the first touch of the stroke found
    invert: bool = False  # press down instead of lift, trim instead of grow, the other way round
    pressure_radius: bool = False  # the pen's pressure scales the radius
    pressure_strength: bool = True  # the pen's pressure scales the strength
    mirror: tuple[bool, bool, bool] = (False, False, False)  # also across the planes x, y, z = 0 of the groom's object

    def __post_init__(self) -> None:
        require(self.mode in MODES, f"the comb's mode is '{self.mode}'; it must be one of {', '.join(MODES)}")
        require(0.5 <= self.radius <= 100_000, f"the comb's radius is {self.radius} pixels; it must be 0.5 or more")
        for name in ("strength", "hardness", "drag", "slip"):
            value = getattr(self, name)
            require(0 <= value <= 1, f"the comb's {name} is {value}; it must be in 0..1")
        require(len(self.profile) == 3, f"the comb's profile has {len(self.profile)} values; it needs 3")
        require(min(self.profile) >= 0 and max(self.profile) <= 1, f"the profile is {self.profile}; it must be in 0..1")
        require(len(self.mirror) == 3, f"the comb's mirror has {len(self.mirror)} values; it needs 3")
        require(-1 <= self.level <= 3, f"the comb's level is {self.level}; it must be in -1..3")


@dataclass(frozen=True, slots=True)
class View:
    """Where the stroke was seen from.

    matrix : (4, 4) float64, world space (metres) to clip space: Blender's `RegionView3D.perspective_matrix`.
    width, height : of the view's region, pixels.
    """

    matrix: Float64
    width: float
    height: float

    def __post_init__(self) -> None:
        _check_matrix("the view's matrix", self.matrix)
        require(self.width > 0 and self.height > 0, f"the view is {self.width} x {self.height} pixels; it needs a size")


@dataclass(frozen=True, slots=True)
class Stroke:
    """One stroke of the comb.

    frame : (4, 4) float64, the groom object's space to world space; its planes x, y, z = 0 are those of `mirror`.
    samples : (n, 3) float64, n >= 1: x and y in pixels from the view's lower left corner, and the pressure in 0..1.
    selection : (S,) float32 in 0..1, how much each strand takes part; None is all.
    """

    params: CombParams
    view: View
    frame: Float64
    samples: Float64
    selection: Float32 | None = None

    def __post_init__(self) -> None:
        _check_matrix("the stroke's frame", self.frame)
        samples = self.samples
        require(samples.ndim == 2 and samples.shape[1] == 3, f"samples must have shape (n, 3), not {samples.shape}")
        require(len(samples) > 0, "the stroke has no samples; it needs one")
        require(bool(np.isfinite(samples).all()), "the stroke's samples have NaN or infinite values")
        require(
            samples[:, 2].min() >= 0 and samples[:, 2].max() <= 1,
            "the pressure of the stroke's samples must be in 0..1",
        )
        if self.selection is not None:
            inside = self.selection.ndim == 1 and bool(((self.selection >= 0) & (self.selection <= 1)).all())
            require(inside, "the stroke's selection must be one value in 0..1 for each strand")


@dataclass(frozen=True, slots=True)
class StrokeFile:
    """Strokes and the groom that they belong to, told by its numbers of strands and points."""

    n_strands: int
    n_points: int
    strokes: tuple[Stroke, ...]

    def check(self, n_strands: int, n_points: int, name: str) -> None:
        """Raises InputError where the strokes are for another groom."""
        require(
            (self.n_strands, self.n_points) == (n_strands, n_points),
            f"{name} was recorded on a groom of {self.n_strands} strands and {self.n_points} points, and this one has "
            f"{n_strands} and {n_points}; use the groom that it was recorded on",
        )


def stroke_to_json(stroke: Stroke) -> str:
    """The stroke as one line of JSON; `stroke_from_json` gives it back to the bit."""
    return json.dumps(_stroke_values(stroke), allow_nan=False)


def stroke_from_json(text: str) -> Stroke:
    """A stroke from its JSON.

    Raises
    ------
    InputError : it is no JSON, or a value is missing or wrong.
    """
    try:
        values = json.loads(text)
    except ValueError as error:
        raise InputError(f"the stroke is no JSON ({error}); use one that was recorded") from None
    return _stroke(values)


def write_strokes(path: str | os.PathLike[str], file: StrokeFile) -> None:
    """Write a strokes file (JSON), whole or not at all; raises FileError."""
    values = {
        "format": FORMAT,
        "version": VERSION,
        "strands": file.n_strands,
        "points": file.n_points,
        "strokes": [_stroke_values(stroke) for stroke in file.strokes],
    }
    with atomic_write(path) as stream:
        stream.write(json.dumps(values, allow_nan=False).encode())


def read_strokes(path: str | os.PathLike[str]) -> StrokeFile:
    """Read what `write_strokes` wrote.

    Raises
    ------
    FileError : missing, damaged, or not a file of strokes.
    """
    path = Path(path)
    try:
        values = json.loads(bytes(read_file(path)).decode())
    except (ValueError, RecursionError):
        raise damaged(path, "it is no JSON") from None
    if not isinstance(values, dict) or values.get("format") != FORMAT or values.get("version") != VERSION:
        raise damaged(path, f"it is no {FORMAT} of version {VERSION}")
    n_strands, n_points, contents = (values.get(name) for name in ("strands", "points", "strokes"))
    if not isinstance(n_strands, int) or not isinstance(n_points, int) or not isinstance(contents, list):
        raise damaged(path, "it lacks its strands, points or strokes")
    strokes = []
    for number, content in enumerate(contents, 1):
        try:
            strokes.append(_stroke(content))
        except InputError as error:
            raise FileError(f"{path}: stroke {number}: {error}") from None
    return StrokeFile(n_strands, n_points, tuple(strokes))


def _stroke_values(stroke: Stroke) -> dict[str, Any]:
    return {
        "params": asdict(stroke.params),
        "view": {
            "matrix": stroke.view.matrix.tolist(),
            "width": float(stroke.view.width),
            "height": float(stroke.view.height),
        },
        "frame": stroke.frame.tolist(),
        "samples": stroke.samples.tolist(),
        # float32 values as their shortest decimals; back in float32 they are the same bits
        "selection": None if stroke.selection is None else [float(str(v)) for v in stroke.selection],
    }


def _stroke(values: Any) -> Stroke:
    require(isinstance(values, Mapping), "a stroke must be a group of values")
    for name in ("params", "view", "frame", "samples"):
        require(name in values, f"the stroke has no '{name}'")
    view = values["view"]
    require(isinstance(view, Mapping) and {"matrix", "width", "height"} <= set(view), "the stroke's view is incomplete")
    selection = values.get("selection")
    return Stroke(
        comb_params(values["params"]),
        View(_numbers("matrix", view["matrix"], 2), *(_number(name, view[name]) for name in ("width", "height"))),
        _numbers("frame", values["frame"], 2),
        _numbers("samples", values["samples"], 2),
        None if selection is None else _numbers("selection", selection, 1).astype(np.float32),
    )


def comb_params(values: Any) -> CombParams:
    """CombParams from a dict as JSON gives it; what is missing keeps its default.

    Raises
    ------
    InputError : an unknown name or a value of the wrong kind.
    """
    require(isinstance(values, Mapping), "the stroke's params must be a group of values")
    defaults = {field.name: field.default for field in fields(CombParams)}
    found: dict[str, Any] = {}
    for name, value in values.items():
        require(name in defaults, f"the comb has no setting '{name}'; it has {', '.join(sorted(defaults))}")
        found[name] = _like(name, value, defaults[name])
    return CombParams(**found)


def _like(name: str, value: Any, default: Any) -> Any:
    if isinstance(default, tuple):
        is_list = isinstance(value, Sequence) and not isinstance(value, str) and len(value) == len(default)
        require(is_list, f"the comb's {name} must have {len(default)} values, not {value!r}")
        return tuple(_like(name, part, default[0]) for part in value)
    if isinstance(default, float):
        return _number(name, value)
    require(type(value) is type(default), f"the comb's {name} must be {type(default).__name__}, not {value!r}")
    return value


def _number(name: str, value: Any) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
    require(is_number, f"'{name}' of the stroke must be a number, not {value!r}")
    return float(value)


def _numbers(name: str, value: Any, n_dimensions: int) -> Float64:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"'{name}' of the stroke must be numbers in rows of one length") from None
    require(array.ndim == n_dimensions, f"'{name}' of the stroke must have {n_dimensions} dimensions, not {array.ndim}")
    require(bool(np.isfinite(array).all()), f"'{name}' of the stroke has NaN or infinite values")
    return array


def _check_matrix(name: str, matrix: Float64) -> None:
    require(matrix.shape == (4, 4), f"{name} must be 4 x 4, not {matrix.shape}")
    sound = bool(np.isfinite(matrix).all()) and abs(np.linalg.det(matrix)) > 1e-30
    require(sound, f"{name} cannot be inverted; use the matrix of a view or an object that has a size")
