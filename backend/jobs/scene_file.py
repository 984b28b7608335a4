"""Scenes for `hairloom simulate`: a TOML file that names head, motion, colliders, force fields and settings (B-28)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..errors import FileError, InputError, require
from ..geometry.head import read_head
from ..io.alembic_motion import read_motion
from ..io.files import read_file
from ..io.npz import read_arrays
from ..io.toml import Table, check_names, read_toml
from ..io.units import Units
from ..rods.material import PRESETS
from ..rods.scene import CollisionMesh, ForceField, Scene
from ..types import Float64, Head

_SCENE_KEYS = {"fps", "frames", "frame_start", "gravity", "head", "motion", "collider", "field", "guides", "settings"}
_MESH_KEYS = {"mesh", "units", "friction", "motion", "collide"}
_MOTION_KEYS = {"file", "object", "shake", "move"}
_FIELD_KEYS = {
    "kind", "strength", "noise", "origin", "direction", "falloff_power", "distance_min", "distance_max", "size", "seed"
}  # fmt: skip
_MOST_FRAMES = 100_000


@dataclass(frozen=True, slots=True)
class SceneFile:
    """The scene, the head that the hair grows on, and settings of the jobs `simulate` and `make_guides`."""

    scene: Scene
    head: Head | None
    settings: dict[str, Any]
    guides: dict[str, Any]


def read_scene_file(path: Path) -> SceneFile:
    """Read a scene; files that it names are relative to it.

    Raises
    ------
    FileError : missing, or no TOML. InputError : a name that is not known, or a bad value; one line that says which.
    """
    table = read_toml(path)
    check_names(table, _SCENE_KEYS, str(path))
    folder = path.parent
    fps, n_frames = _number(table, "fps", 24.0), int(_number(table, "frames", 0))
    require(fps > 0, f"fps is {fps:g}; it must be above 0")
    require(0 <= n_frames <= _MOST_FRAMES, f"frames is {n_frames}; it must be from 1 to {_MOST_FRAMES:,}")
    motion = _motion(table.get("motion", {}), folder, fps, n_frames)
    head_table = table.get("head", {})
    head = _mesh(head_table, folder, "head") if head_table else None
    colliders = []
    if head is not None and head_table.get("collide", True):
        # what the head collides with moves as the roots do
        carried = motion @ np.linalg.inv(motion[0])
        colliders.append(CollisionMesh(head.triangles, head.vertices, carried, _number(head_table, "friction", 0.3)))
    for one in _tables(table, "collider"):
        mesh = _mesh(one, folder, "collider")
        own = _motion(one.get("motion", {}), folder, fps, len(motion))
        require(len(own) == len(motion), f"a collider moves over {len(own)} frames and the head over {len(motion)}")
        colliders.append(CollisionMesh(mesh.triangles, mesh.vertices, own, _number(one, "friction", 0.3)))
    scene = Scene(
        fps=fps,
        motion=motion,
        frame_start=int(_number(table, "frame_start", 1)),
        colliders=tuple(colliders),
        fields=tuple(_field(one, len(motion)) for one in _tables(table, "field")),
        gravity=_vector(table, "gravity", (0.0, 0.0, -9.81)),
    )
    return SceneFile(scene, head, _settings(table.get("settings", {})), dict(table.get("guides", {})))


# --- parts --------------------------------------------------------------------------------------------------------


def _motion(table: Table, folder: Path, fps: float, n_frames: int) -> Float64:
    """(F, 4, 4) from a file, or of a shake or move about the world's origin; at rest where nothing is said."""
    check_names(table, _MOTION_KEYS, "motion")
    if "file" in table:
        motion = _motion_file(folder / str(table["file"]), str(table.get("object", "")))
        require(n_frames in (0, len(motion)), f"the motion has {len(motion)} frames and the scene {n_frames}")
        return motion
    require(n_frames > 0, "frames is missing; say how many frames the scene has, or give a motion file")
    seconds = np.arange(n_frames) / fps
    motion = np.tile(np.eye(4), (n_frames, 1, 1))
    if "shake" in table:
        shake = table["shake"]
        check_names(shake, {"frequency", "degrees", "axis", "pivot"}, "shake")
        axis = _vector(shake, "axis", (0.0, 0.0, 1.0))
        require(float(np.linalg.norm(axis)) > 0, "the shake's axis is 0 long; give a direction")
        angles = np.radians(_number(shake, "degrees", 20.0)) * np.sin(
            2.0 * np.pi * _number(shake, "frequency", 2.0) * seconds
        )
        pivot = _vector(shake, "pivot", (0.0, 0.0, 0.0))
        motion[:, :3, :3] = Rotation.from_rotvec(angles[:, None] * axis / np.linalg.norm(axis)).as_matrix()
        motion[:, :3, 3] = pivot - motion[:, :3, :3] @ pivot
    if "move" in table:
        move = table["move"]
        check_names(move, {"frequency", "way"}, "move")
        share = np.sin(2.0 * np.pi * _number(move, "frequency", 1.0) * seconds)
        motion[:, :3, 3] += share[:, None] * _vector(move, "way", (0.1, 0.0, 0.0))
    return motion


def _motion_file(path: Path, name: str) -> Float64:
    if path.suffix.lower() == ".abc":
        return read_motion(path, name)
    arrays = read_arrays(path, read_file(path))
    if "motion" not in arrays:
        raise FileError(f"{path} has no array 'motion' of shape (frames, 4, 4)")
    motion = np.asarray(arrays["motion"], np.float64)
    require(
        motion.ndim == 3 and motion.shape[1:] == (4, 4) and 0 < len(motion) <= _MOST_FRAMES,
        f"'motion' in {path} has shape {motion.shape}; it must be (frames, 4, 4)",
    )
    require(bool(np.isfinite(motion).all()), f"'motion' in {path} has NaN or infinite values")
    return np.ascontiguousarray(motion)


def _mesh(table: Table, folder: Path, what: str) -> Head:
    check_names(table, _MESH_KEYS, what)
    require("mesh" in table, f"a {what} has no 'mesh'; name its .obj file")
    units = Units.parse(str(table["units"])) if "units" in table else None
    return read_head(folder / str(table["mesh"]), units)


def _field(table: Table, n_frames: int) -> ForceField:
    check_names(table, _FIELD_KEYS, "field")
    axis = _vector(table, "direction", (1.0, 0.0, 0.0))
    length = float(np.linalg.norm(axis))
    require(length > 0, "a field's direction is 0 long; give a direction")
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.align_vectors([axis / length], [[0.0, 0.0, 1.0]])[0].as_matrix()
    matrix[:3, 3] = _vector(table, "origin", (0.0, 0.0, 0.0))
    return ForceField(
        kind=str(table.get("kind", "wind")),
        matrices=np.tile(matrix, (n_frames, 1, 1)),
        strength=np.full(n_frames, _number(table, "strength", 1.0)),
        noise=np.full(n_frames, _number(table, "noise", 0.0)),
        falloff_power=_number(table, "falloff_power", 0.0),
        distance_min=_number(table, "distance_min", 0.0),
        distance_max=_number(table, "distance_max", 0.0),
        size=_number(table, "size", 0.1),
        seed=int(_number(table, "seed", 0)),
    )


def _settings(table: Table) -> dict[str, Any]:
    """The settings with `preset` of the material filled in: what is said beside it comes on top."""
    settings = dict(table)
    material = dict(settings.get("material", {}))
    if "preset" in material:
        preset = material.pop("preset")
        require(preset in PRESETS, f"there is no preset '{preset}'; the presets are {', '.join(PRESETS)}")
        settings["material"] = asdict(PRESETS[preset]) | material
    return settings


# --- values -------------------------------------------------------------------------------------------------------


def _tables(table: Table, name: str) -> list[Table]:
    found = table.get(name, [])
    require(isinstance(found, list), f"write each {name} as [[{name}]]")
    return list(found)


def _value(table: Table, name: str, default: Any, convert: Callable[[Any], Any]) -> Any:
    try:
        return convert(table.get(name, default))
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is {table[name]!r}; it must be a number, or 3 of them for a vector") from error


def _number(table: Table, name: str, default: float) -> float:
    value = float(_value(table, name, default, float))
    require(np.isfinite(value), f"{name} is {value}; it must be finite")
    return value


def _vector(table: Table, name: str, default: tuple[float, float, float]) -> Float64:
    value: Float64 = _value(table, name, default, lambda given: np.array(given, np.float64))
    require(value.shape == (3,) and bool(np.isfinite(value).all()), f"{name} must be three finite numbers")
    return value
