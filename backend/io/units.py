"""Units and axes of files against world space (metres, z up, a face looks along -y, as in Blender)."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from ..errors import require
from ..types import Float32, Float64, Floats

_AXES: dict[str, tuple[float, float, float]] = {
    "X": (1, 0, 0), "Y": (0, 1, 0), "Z": (0, 0, 1), "-X": (-1, 0, 0), "-Y": (0, -1, 0), "-Z": (0, 0, -1),
}  # fmt: skip
_DEFAULT_FORWARD = {"X": "Z", "-X": "Z", "Y": "Z", "-Y": "Z", "Z": "-Y", "-Z": "-Y"}
_SCALES = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
_TOKEN = re.compile(r"([+-]?[xyz])[ -]?(up|forward)")


@dataclass(frozen=True, slots=True)
class Units:
    """Unit of length and axes of a file.

    scale_to_metres : one unit of the file in metres, above 0.
    up : the file's axis that points up, one of X, Y, Z, -X, -Y, -Z.
    forward : the file's axis that the face looks along; empty for the usual one (y up: Z, z up: -Y), with which
        y-up files become (x, y, z) -> (x, -z, y) and z-up files keep their coordinates.
    """

    scale_to_metres: float = 1.0
    up: str = "Z"
    forward: str = ""

    def __post_init__(self) -> None:
        require(
            math.isfinite(self.scale_to_metres) and 1e-9 <= self.scale_to_metres <= 1e9,
            f"the file's unit is {self.scale_to_metres} metres; it must be from 1e-9 to 1e9",
        )
        require(self.up in _AXES, f"the up axis is {self.up!r}; choose one of {', '.join(_AXES)}")
        require(
            self.forward in _AXES or self.forward == "",
            f"the forward axis is {self.forward!r}; choose one of {', '.join(_AXES)}",
        )
        require(self._forward[-1] != self.up[-1], f"forward and up are the same axis, {self.up}; choose another")

    @property
    def _forward(self) -> str:
        return self.forward or _DEFAULT_FORWARD[self.up]

    @property
    def rotation(self) -> Float64:
        """(3, 3) float64, file axes to world axes (column vectors), entries 0 and +-1."""
        up, forward = np.array(_AXES[self.up]), np.array(_AXES[self._forward])
        return np.array([np.cross(up, forward), -forward, up]).astype(np.float64) + 0.0

    def to_world(self, points: Floats) -> Float32:
        """Points (P, 3) of the file as float32, metres, world axes; infinite where float32 cannot hold them."""
        return _permuted(points, self.rotation * self.scale_to_metres)

    def from_world(self, points: Floats) -> Float32:
        """World points (P, 3), metres, as float32 in the unit and axes of the file; infinite as above."""
        return _permuted(points, self.rotation.T / self.scale_to_metres)

    @staticmethod
    def parse(text: str) -> Units:
        """Units from a short text: parts split by commas, a unit (m, dm, cm, mm, in, ft or a number of metres), axes.

        Examples: "cm,y-up", "z-up", "0.0254,y-up,-z-forward". What is not named is metres, z up, the usual forward.

        Raises
        ------
        InputError : a part that is none of these.
        """
        scale, axes = 1.0, {"up": "Z", "forward": ""}
        for part in text.lower().split(","):
            token = part.strip()
            axis = _TOKEN.fullmatch(token)
            if axis:
                axes[axis[2]] = axis[1].upper().removeprefix("+")
            elif token in _SCALES:
                scale = _SCALES[token]
            else:
                scale = _number(token, text)
        return Units(scale, axes["up"], axes["forward"])


def _permuted(points: Floats, matrix: Float64) -> Float32:
    """points @ matrix.T for a matrix of one entry a row, rounded once to float32."""
    if np.array_equal(matrix, np.eye(3)) and points.dtype == np.float32:
        return np.ascontiguousarray(points, dtype=np.float32)
    moved = np.empty(points.shape, dtype=np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        for row in range(3):
            column = int(np.flatnonzero(matrix[row])[0])
            moved[:, row] = points[:, column].astype(np.float64) * matrix[row, column]
    return moved


def _number(token: str, text: str) -> float:
    try:
        return float(token)
    except ValueError:
        scale = None
    require(scale, f"units {text!r}: {token!r} is not understood; write for example cm,y-up or 0.01,z-up,-y-forward")
    return 0.0


METRES_Z_UP = Units(1.0, "Z")
METRES_Y_UP = Units(1.0, "Y")
PRESETS: dict[str, Units] = {
    "metres_z_up": METRES_Z_UP,
    "metres_y_up": METRES_Y_UP,
    "decimetres_y_up": Units(0.1, "Y"),
    "centimetres_y_up": Units(0.01, "Y"),
    "centimetres_z_up": Units(0.01, "Z"),
    "millimetres_z_up": Units(0.001, "Z"),
}
