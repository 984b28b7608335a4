"""Values in one .npz without pickle: what travels between the add-on and its worker process, and results on disk.

A bundle is a dict of values by name. A value is None, a bool, int, float, text, numpy array of numbers, booleans or
text, one of our dataclasses (`TYPES`), or a list, tuple or dict by name of values. The arrays are members of the
archive, uncompressed; everything else is the JSON text `manifest`.
"""

from __future__ import annotations

import importlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FileError, HairloomError, InputError, require
from .files import atomic_write, damaged, read_file
from .npz import read_arrays, read_json, write_arrays

FORMAT, VERSION = "hairloom-bundle", 1
_MAX_DEPTH = 32

# The dataclasses that a bundle may hold and the module that each is from; no other class is ever made from a file.
TYPES: Mapping[str, str] = {
    "StrandSet": "..types",
    "Head": "..types",
    "RootedStrands": "..types",
    "WispHierarchy": "..types",
    "FeatureMap": "..types",
    "Mesh": "..types",
    "Camera": "..types",
    "OrientationMap": "..types",
    "View": "..fourview.views",
    "DirectionStroke": "..fourview.views",
    "RoughShape": "..fourview.shape",
    "HairSurface": "..fourview.surface",
    "Level": "..fourview.surface",
    "TexelMap": "..fourview.texels",
    "HairTexture": "..fourview.texture",
    "SurfaceDirections": "..fourview.directions",
    "ScalpSpace": "..geometry.scalp_space",
    "WispSet": "..synthesis.wisps",
    "FeatureBasis": "..synthesis.features",
    "Helices": "..rods.helices",
    "HelixFit": "..rods.fitting",
    "Followers": "..rods.interpolation",
    "Scene": "..rods.scene",
    "CollisionMesh": "..rods.scene",
    "ForceField": "..rods.scene",
}

Arrays = dict[str, NDArray[Any]]


def write_bundle(path: str | os.PathLike[str], values: Mapping[str, Any]) -> None:
    """Write a bundle; the file appears whole or not at all, and equal values give equal bytes.

    Raises
    ------
    InputError : a value that a bundle cannot hold. FileError : the file cannot be written.
    """
    arrays: Arrays = {}
    nodes = {_name(name, "the bundle"): _encode(name, value, arrays, 0) for name, value in values.items()}
    manifest = json.dumps({"format": FORMAT, "version": VERSION, "values": nodes}, allow_nan=False)
    with atomic_write(path) as stream:
        write_arrays(stream, {"manifest": np.array(manifest)} | arrays)


def read_bundle(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read what `write_bundle` wrote; arrays can be written to, dataclasses are checked as when they are made.

    Raises
    ------
    FileError : missing, damaged, no bundle, or a class or value that is not allowed.
    """
    path = Path(path)
    arrays = read_arrays(path, read_file(path))
    manifest = read_json(path, arrays, "manifest")
    if manifest.get("format") != FORMAT or manifest.get("version") != VERSION:
        raise damaged(path, f"it is no {FORMAT} of version {VERSION}")
    nodes = manifest.get("values")
    if not isinstance(nodes, dict):
        raise damaged(path, "its manifest has no values")
    decoder = _Decoder(path, arrays)
    return {name: decoder.value(name, node, 0) for name, node in nodes.items()}


def _encode(name: str, value: Any, arrays: Arrays, depth: int) -> Any:
    require(depth < _MAX_DEPTH, f"'{name}' is nested more than {_MAX_DEPTH} deep; a bundle cannot hold it")
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else {"float": str(value)}
    if isinstance(value, np.ndarray):
        key = f"array{len(arrays)}"
        arrays[key] = value
        return {"array": key}
    if isinstance(value, list | tuple):
        kind = "tuple" if isinstance(value, tuple) else "list"
        return {kind: [_encode(f"{name}[{i}]", item, arrays, depth + 1) for i, item in enumerate(value)]}
    if isinstance(value, Mapping):
        return {"dict": {_name(k, name): _encode(f"{name}.{k}", v, arrays, depth + 1) for k, v in value.items()}}
    cls = type(value)
    if is_dataclass(value) and cls.__name__ in TYPES and _class(cls.__name__) is cls:
        content = {
            field.name: _encode(f"{name}.{field.name}", getattr(value, field.name), arrays, depth + 1)
            for field in fields(value)
        }
        return {"type": cls.__name__, "fields": content}
    raise InputError(f"'{name}' is a {cls.__name__}, which a bundle cannot hold; use arrays, numbers, text or dicts")


def _name(name: object, owner: str) -> str:
    require(isinstance(name, str), f"{owner} has the name {name!r}; names in a bundle must be text")
    return str(name)


def _class(name: str) -> type:
    found = getattr(importlib.import_module(TYPES[name], __package__), name)
    assert isinstance(found, type)
    return found


class _Decoder:
    """Builds values from nodes of the manifest."""

    def __init__(self, path: Path, arrays: Arrays) -> None:
        self._path = path
        self._arrays = arrays

    def value(self, name: str, node: Any, depth: int) -> Any:
        if depth >= _MAX_DEPTH:
            raise self._error(name, "it is nested too deep")
        if node is None or isinstance(node, bool | int | float | str):
            return node
        if isinstance(node, dict) and isinstance(node.get("type"), str) and isinstance(node.get("fields"), dict):
            return self._instance(name, node["type"], node["fields"], depth)
        kind, content = next(iter(node.items())) if isinstance(node, dict) and len(node) == 1 else ("", None)
        if kind == "array" and isinstance(content, str) and content in self._arrays:
            return self._arrays[content]
        if kind == "float" and content in ("nan", "inf", "-inf"):
            return float(content)
        if kind in ("list", "tuple") and isinstance(content, list):
            items = [self.value(f"{name}[{i}]", item, depth + 1) for i, item in enumerate(content)]
            return tuple(items) if kind == "tuple" else items
        if kind == "dict" and isinstance(content, dict):
            return {key: self.value(f"{name}.{key}", item, depth + 1) for key, item in content.items()}
        raise self._error(name, "it is of no known kind, or its array is missing")

    def _instance(self, name: str, type_name: str, content: dict[str, Any], depth: int) -> Any:
        if type_name not in TYPES:
            raise self._error(name, f"the class {type_name[:40]!r} is not allowed")
        cls = _class(type_name)
        known = {field.name for field in fields(cls)}
        if set(content) != known:
            raise self._error(name, f"a {type_name} has the fields {', '.join(sorted(known))}")
        parts = {key: self.value(f"{name}.{key}", item, depth + 1) for key, item in content.items()}
        try:
            return cls(**parts)
        except (HairloomError, TypeError, ValueError, AttributeError, IndexError) as error:
            raise self._error(name, f"it makes no valid {type_name}: {error}") from error

    def _error(self, name: str, reason: str) -> FileError:
        return damaged(self._path, f"value '{name[:80]}': {reason}")
