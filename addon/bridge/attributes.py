"""One typed table between Blender attributes and numpy, and the only bulk read and write.

`foreach_get` and `foreach_set` copy at memory speed for an array of exactly the attribute's type and are 150 times
slower for any other, so a wrong dtype is an error here, never converted on the way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np


@dataclass(frozen=True, slots=True)
class Kind:
    """How one Blender attribute type is read: its `foreach` key, numpy type and number of components."""

    key: str
    dtype: type
    width: int


KINDS = {
    "FLOAT": Kind("value", np.float32, 1),
    "INT": Kind("value", np.int32, 1),
    "INT8": Kind("value", np.int8, 1),
    "BOOLEAN": Kind("value", np.bool_, 1),
    "FLOAT2": Kind("vector", np.float32, 2),
    "FLOAT_VECTOR": Kind("vector", np.float32, 3),
    "FLOAT_COLOR": Kind("color", np.float32, 4),
}


def read_values(data: Any, key: str, dtype: type, width: int = 1) -> np.ndarray:
    """All values of a Blender collection, (N,) or (N, width) of `dtype`."""
    values = np.empty(len(data) * width, dtype)
    data.foreach_get(key, values)
    return values if width == 1 else values.reshape(-1, width)


def write_values(data: Any, key: str, values: np.ndarray, dtype: type, width: int = 1) -> None:
    """Fill a Blender collection with (N,) or (N, width) values of exactly `dtype`.

    Raises
    ------
    TypeError : another dtype. ValueError : another count.
    """
    if values.dtype != dtype:
        raise TypeError(f"bulk write of {values.dtype} into {np.dtype(dtype)}: cast once, before this call")
    if values.size != len(data) * width:
        raise ValueError(f"{values.size} values for {len(data)} elements of {width}")
    data.foreach_set(key, np.ascontiguousarray(values).ravel())


def read_attribute(attribute: bpy.types.Attribute) -> np.ndarray:
    """The values of an attribute of one of KINDS."""
    kind = KINDS[attribute.data_type]
    return read_values(attribute.data, kind.key, kind.dtype, kind.width)


def write_attribute(owner: Any, name: str, kind_name: str, domain: str, values: np.ndarray) -> None:
    """Create or overwrite attribute `name` of `owner` (Curves or Mesh); one of another type or domain is replaced."""
    attribute = owner.attributes.get(name)
    if attribute is not None and (attribute.data_type, attribute.domain) != (kind_name, domain):
        owner.attributes.remove(attribute)
        attribute = None
    if attribute is None:
        owner.attributes.new(name, kind_name, domain)
    kind = KINDS[kind_name]
    # fetched again by name: in Blender 4.5 a new attribute invalidates every reference held from before
    write_values(owner.attributes[name].data, kind.key, values, kind.dtype, kind.width)


def blender_form(values: np.ndarray) -> tuple[str, np.ndarray] | None:
    """The attribute type that holds `values` and the values in its dtype; None where Blender has no such type."""
    width = 1 if values.ndim == 1 else int(values.shape[1]) if values.ndim == 2 else 0
    if values.dtype == np.bool_ and width == 1:
        return "BOOLEAN", values
    if values.dtype == np.int8 and width == 1:
        return "INT8", values
    if values.dtype.kind in "iu" and width == 1:
        return "INT", values.astype(np.int32, copy=False)
    by_width = {1: "FLOAT", 2: "FLOAT2", 3: "FLOAT_VECTOR", 4: "FLOAT_COLOR"}
    if values.dtype.kind in "f" and width in by_width:
        return by_width[width], values.astype(np.float32, copy=False)
    return None
